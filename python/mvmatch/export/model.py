"""COLMAP models: read with every fault named, written as COLMAP's text or binary files."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import mmap
import re
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mvmatch.colmap_log import quiet_colmap
from mvmatch.errors import DataError, cannot_write
from mvmatch.export.files import make_folder

if TYPE_CHECKING:
    import pycolmap

    from mvmatch.types import StrPath

_FILES = ("cameras", "images", "points3D")
"""Every model has them; ``rigs`` and ``frames`` came with COLMAP 3.12."""


class _Layout(NamedTuple):
    """Bytes of one record of a binary file."""

    fixed: int
    named: bool = False
    """Whether a name follows, up to a zero."""
    length: int = 0
    """Of the number of items."""
    item: int = 0


_LAYOUTS = {
    # Of cameras and rigs the least: their lengths depend on what is in them.
    "cameras": _Layout(48),
    "rigs": _Layout(16),
    "frames": _Layout(64, length=4, item=16),
    "images": _Layout(64, named=True, length=8, item=24),
    "points3D": _Layout(43, length=8, item=8),
}


def read_model(folder: StrPath) -> pycolmap.Reconstruction:
    """Read a COLMAP model, binary if it is there, else text.

    Parameters
    ----------
    folder : path
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

    folder = Path(folder)
    suffix = _model_suffix(folder)
    if suffix == ".bin":
        for name, layout in _LAYOUTS.items():
            _check_length(folder / f"{name}.bin", layout)
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


def write_binary(model: pycolmap.Reconstruction, folder: StrPath) -> None:
    """Write ``cameras``, ``rigs``, ``frames``, ``images`` and ``points3D`` as ``.bin``.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Any model.
    folder : path
        Made if missing; the files appear in it when all are complete, older ones are replaced.

    Raises
    ------
    DataError
        The folder cannot be written.
    """
    folder = Path(folder)
    _write(model, folder, text=False)


def write_text(model: pycolmap.Reconstruction, folder: StrPath) -> None:
    """Write ``cameras``, ``rigs``, ``frames``, ``images`` and ``points3D`` as ``.txt``.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Any model.
    folder : path
        Made if missing; the files appear in it when all are complete, older ones are replaced.

    Raises
    ------
    DataError
        The folder cannot be written, or holds a binary model: COLMAP would read that one.
    """
    folder = Path(folder)
    if any((folder / f"{name}.bin").exists() for name in _FILES):
        raise DataError(
            f"{folder} holds a binary model, which COLMAP reads in the place of text. "
            "Choose another folder"
        )
    _write(model, folder, text=True)


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


def _check_length(path: Path, layout: _Layout) -> None:
    """Refuse a file that ends within a record: COLMAP 4.2 may read it forever."""
    if not path.exists():  # rigs and frames before COLMAP 3.12
        return
    size = path.stat().st_size
    position = 8
    if size >= position:
        with (
            path.open("rb") as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data,
        ):
            for _ in range(int.from_bytes(data[:8], "little")):
                position += layout.fixed
                if layout.named:
                    end = data.find(b"\0", position)
                    position = size if end < 0 else end + 1
                items = int.from_bytes(data[position : position + layout.length], "little")
                position += layout.length + items * layout.item
                if position > size:
                    break
    if position > size:
        raise DataError(
            f"{path} is cut or damaged: its {size} bytes end within a record. "
            "Copy the model again, or reconstruct anew"
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
