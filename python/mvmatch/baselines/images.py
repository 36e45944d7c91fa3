"""Folders of frames."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvmatch import opencv
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path
    from types import ModuleType

    from numpy.typing import NDArray

SUFFIXES = {".bmp", ".jpeg", ".jpg", ".png", ".ppm", ".tif", ".tiff"}


def list_images(folder: Path, max_frames: int | None = None) -> list[Path]:
    """Return the image files of a folder in the order of their names, at most ``max_frames``.

    Raises
    ------
    DataError
        Fewer than two.
    """
    found = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    found = found[:max_frames]
    if len(found) < 2:
        raise DataError(f"{folder} holds {len(found)} images; matching needs at least two")
    return found


def read_gray(paths: Sequence[Path]) -> Iterator[NDArray[np.uint8]]:
    """Yield images as (H, W) uint8 grey values.

    Raises
    ------
    DataError
        A file is not an image.
    """
    cv2 = require_opencv()
    for path in paths:
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise DataError(f"{path} is not an image that OpenCV can read")
        yield np.asarray(image, np.uint8)


def require_opencv() -> ModuleType:
    """Import OpenCV.

    Raises
    ------
    MissingExtraError
        It is not installed.
    """
    return opencv.require_opencv("a baseline", extra="baselines")
