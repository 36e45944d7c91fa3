"""``images/`` and a COLMAP model in ``sparse/`` or ``sparse/0``, whose poses pass for the truth.

A video has one picture size and one order. So of the pictures with a pose in the model, in the
order of their names, the longest run of equal size and camera model is the sequence ("same
dimensions", "temporally adjacent": Zouein et al. 2025, which does not name the pictures). Of
several cameras in the run each parameter is the median over its pictures.
"""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.bench.datasets.layout import GUIDE, Layout, make_sequence
from mvmatch.encode.frames import natural_key
from mvmatch.errors import DataError
from mvmatch.export.model import read_model, registered_images

if TYPE_CHECKING:
    from pathlib import Path

    import pycolmap

    from mvmatch.bench.datasets.sequence import Sequence


def load(folder: Path) -> Sequence:
    """Read a sequence of this layout."""
    if not (folder / "images").is_dir():
        raise DataError(
            f"{folder} has sparse/ but no images/ beside it: give the folder that holds both "
            f"({GUIDE})"
        )
    return load_model(LAYOUT.name(folder), _model(folder), folder / "images")


def load_model(name: str, model: Path, pictures: Path) -> Sequence:
    """Make a sequence of a model.

    Parameters
    ----------
    name : str
        Of the sequence.
    model : Path
        Folder of the model.
    pictures : Path
        Folder that the names in the model are relative to. Pictures may have been scaled.

    Raises
    ------
    DataError
        There is no model, or no two neighbours of one size.
    """
    reconstruction = read_model(model)
    images = [
        image for image in registered_images(reconstruction) if (pictures / image.name).is_file()
    ]
    run = _longest_run(reconstruction, sorted(images, key=lambda image: natural_key(image.name)))
    if len(run) < 2:
        raise DataError(
            f"{pictures} holds {len(images)} of the images that {model} has poses of, and no two "
            f"of one size in a row: are they the pictures of this model? ({GUIDE})"
        )
    cameras = [reconstruction.camera(image.camera_id) for image in run]
    params = np.median([np.asarray(camera.params, np.float64) for camera in cameras], axis=0)
    numbers = [cameras[0].width, cameras[0].height, *map(float, params)]
    return make_sequence(
        name,
        [pictures / image.name for image in run],
        ",".join([cameras[0].model_name, *map(repr, numbers)]),
        np.array([image.cam_from_world().matrix() for image in run], np.float64),
    )


def _longest_run(
    model: pycolmap.Reconstruction, images: list[pycolmap.Image]
) -> list[pycolmap.Image]:
    """Return the first longest run of images of one size and camera model."""

    def kind(image: pycolmap.Image) -> tuple[str, int, int]:
        camera = model.camera(image.camera_id)
        return camera.model_name, camera.width, camera.height

    runs = [list(run) for _, run in groupby(images, kind)]
    return max(runs, key=len) if runs else []


def _model(folder: Path) -> Path:
    inner = folder / "sparse" / "0"
    return inner if inner.is_dir() else folder / "sparse"


def _files(folder: Path) -> list[Path]:
    # Points and descriptors beside them may take gigabytes and do not matter.
    found = [*(folder / "images").rglob("*")]
    for name in ("cameras", "images", "frames", "rigs"):
        found += _model(folder).glob(f"{name}.*")
    return sorted(path for path in found if path.is_file())


LAYOUT = Layout(
    title="COLMAP",
    recognises=lambda folder: (folder / "sparse").is_dir() and not (folder / "poses.txt").exists(),
    load=load,
    files=_files,
)
