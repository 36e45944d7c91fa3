"""COLMAP models: read with every fault named, written as COLMAP's text or binary files."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import contextlib
import re
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.errors import DataError, cannot_write
from mvmatch.export.files import make_folder

if TYPE_CHECKING:
    from collections.abc import Generator

    import pycolmap

_FILES = ("cameras", "images", "points3D")
"""Every model has them; ``rigs`` and ``frames`` came with COLMAP 3.12."""

_RECORD_BYTES = {"cameras": 48, "images": 73, "points3D": 51, "rigs": 8, "frames": 84}
"""Least size of one record of each binary file."""


def read_model(folder: Path) -> pycolmap.Reconstruction:
    """Read a COLMAP model, binary if it is there, else text.

    Parameters
    ----------
    folder : Path
        Holds ``cameras``, ``images`` and ``points3D`` as ``.bin`` or ``.txt``.

    Returns
    -------
    pycolmap.Reconstruction
        With at least one image that has a pose; poses and cameras are finite.

    Raises
    ------
    DataError
        The folder holds no model, its files are damaged, or no image has a pose.
    """
    import pycolmap

    suffix = _model_suffix(folder)
    if suffix == ".bin":
        _check_sizes(folder)
    try:
        with quiet_colmap():
            model = pycolmap.Reconstruction(folder)
    except (ValueError, RuntimeError, LookupError, MemoryError, OSError) as error:
        # COLMAP begins its messages with a place in its own source.
        reason = re.sub(r"^\[\S+\]\s*", "", str(error)).strip()
        raise DataError(
            f"the {suffix} files in {folder} are not a whole COLMAP model ({reason}). "
            "Copy them again, or reconstruct anew"
        ) from error
    _check_content(model, folder)
    return model


def registered_images(model: pycolmap.Reconstruction) -> list[pycolmap.Image]:
    """Images that have a pose, in the order of their names."""
    images = [model.image(number) for number in model.reg_image_ids()]
    return sorted(images, key=lambda image: image.name)


def frame_number(name: str) -> int | None:
    """Frame that an image shows: the last number in its name, without folder and ending.

    >>> [frame_number(name) for name in ("frame_000012.png", "cam2/7.jpg", "left.png")]
    [12, 7, None]
    """
    numbers = re.findall(r"\d+", Path(name).stem)
    return int(numbers[-1]) if numbers else None


def images_by_frame(model: pycolmap.Reconstruction) -> dict[int, pycolmap.Image]:
    """Images that have a pose, by the frame number in their names, ascending.

    Raises
    ------
    DataError
        A name carries no number, or two carry the same.
    """
    found: dict[int, pycolmap.Image] = {}
    for image in registered_images(model):
        frame = frame_number(image.name)
        if frame is None:
            raise DataError(
                f"the image name {image.name} carries no frame number. "
                "Name the images like frame_000000.png and reconstruct anew"
            )
        if frame in found:
            raise DataError(
                f"the images {found[frame].name} and {image.name} have the same frame number "
                f"{frame}, but a trajectory belongs to one camera. Reconstruct each camera alone"
            )
        found[frame] = image
    return dict(sorted(found.items()))


def write_binary(model: pycolmap.Reconstruction, folder: Path) -> None:
    """Write ``cameras``, ``rigs``, ``frames``, ``images`` and ``points3D`` as ``.bin``.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Any model.
    folder : Path
        Made if missing; the files appear in it when all are complete, older ones are replaced.

    Raises
    ------
    DataError
        The folder cannot be written.
    """
    _write(model, folder, text=False)


def write_text(model: pycolmap.Reconstruction, folder: Path) -> None:
    """Write ``cameras``, ``rigs``, ``frames``, ``images`` and ``points3D`` as ``.txt``.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Any model.
    folder : Path
        Made if missing; the files appear in it when all are complete, older ones are replaced.

    Raises
    ------
    DataError
        The folder cannot be written, or holds a binary model: COLMAP would read that one.
    """
    if any((folder / f"{name}.bin").exists() for name in _FILES):
        raise DataError(
            f"{folder} holds a binary model, which COLMAP reads in the place of text. "
            "Choose another folder"
        )
    _write(model, folder, text=True)


@contextlib.contextmanager
def quiet_colmap() -> Generator[None]:
    """Keep COLMAP from writing to standard error."""
    import pycolmap

    level = pycolmap.logging.minloglevel
    pycolmap.logging.minloglevel = 3
    try:
        yield
    finally:
        pycolmap.logging.minloglevel = level


def _write(model: pycolmap.Reconstruction, folder: Path, *, text: bool) -> None:
    make_folder(folder)
    try:
        with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=folder) as name:
            if text:
                model.write_text(name)
            else:
                model.write_binary(name)
            for file in sorted(Path(name).iterdir()):
                file.replace(folder / file.name)
    except OSError as error:
        raise cannot_write(folder, error) from error


def _model_suffix(folder: Path) -> str:
    """Return the ending of the files that COLMAP reads."""
    for suffix in (".bin", ".txt"):
        if all((folder / f"{name}{suffix}").is_file() for name in _FILES):
            return suffix
    inside = next((deep for deep in (folder / "0", folder / "sparse" / "0") if deep.is_dir()), None)
    advice = "Give the folder of a model, such as out/sparse/0"
    if inside is not None:
        advice = f"Did you mean {inside}?"
    raise DataError(
        f"{folder} holds no COLMAP model: cameras, images and points3D, "
        f"all as .bin or all as .txt. {advice}"
    )


def _check_sizes(folder: Path) -> None:
    """Refuse files that lack whole records: COLMAP 4.2 may read them forever."""
    for name, record in _RECORD_BYTES.items():
        path = folder / f"{name}.bin"
        if not path.exists():
            continue
        with path.open("rb") as file:
            count = int.from_bytes(file.read(8), "little")
        if path.stat().st_size < 8 + count * record:
            raise DataError(
                f"{path} is cut: {path.stat().st_size} bytes cannot hold the {count} records it "
                "announces. Copy the model again, or reconstruct anew"
            )


def _check_content(model: pycolmap.Reconstruction, folder: Path) -> None:
    images = registered_images(model)
    if not images:
        raise DataError(
            f"the model in {folder} is empty: no image has a pose. Reconstruct anew; "
            "`mvmatch probe VIDEO` says whether the video is fit for it"
        )
    cameras: Any = model.cameras
    numbers = [image.cam_from_world().matrix().ravel() for image in images]
    numbers += [np.asarray(camera.params) for camera in cameras.values()]
    if not np.isfinite(np.concatenate(numbers)).all():
        raise DataError(
            f"the model in {folder} has poses or cameras that are not finite. Reconstruct anew"
        )
