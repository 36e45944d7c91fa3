"""ETH3D, high-resolution multi-view: ``images`` and ``dslr_calibration_undistorted``.

The calibration is a COLMAP model in text, aligned to a laser scan (m); its pixels have COLMAP's
origin. Sizes of undistorted pictures differ from camera to camera: the rule of
:mod:`mvmatch.bench.datasets.colmap` applies. The scan itself is not read.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvmatch.bench.datasets import colmap
from mvmatch.bench.datasets.layout import GUIDE, Layout, folder_name
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from pathlib import Path

    from mvmatch.bench.datasets.sequence import Sequence

_PICTURES, _CALIBRATION = "dslr_images_undistorted", "dslr_calibration_undistorted"


def load(folder: Path) -> Sequence:
    """Read one scene."""
    for name in (f"images/{_PICTURES}", _CALIBRATION):
        if not (folder / name).is_dir():
            scene = folder_name(folder)
            raise DataError(
                f"{folder} has no {name}/: unpack {scene}_dslr_undistorted.7z of ETH3D; the "
                f"pictures of {scene}_dslr_jpg.7z are distorted ({GUIDE})"
            )
    return colmap.load_model(LAYOUT.name(folder), folder / _CALIBRATION, folder / "images")


def _files(folder: Path) -> list[Path]:
    found = [folder / _CALIBRATION / name for name in ("cameras.txt", "images.txt")]
    found += (folder / "images" / _PICTURES).glob("*")
    return sorted(path for path in found if path.is_file())


LAYOUT = Layout(
    title="ETH3D",
    recognises=lambda folder: any(
        (folder / name).is_dir()
        for name in (f"images/{_PICTURES}", _CALIBRATION, "images/dslr_images")
    ),
    load=load,
    files=_files,
)
