"""Frames in colour, as networks take them."""

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


def read_rgb(paths: Sequence[Path]) -> Iterator[NDArray[np.uint8]]:
    """Yield images as (H, W, 3) uint8 RGB; grey ones have three equal channels.

    Raises
    ------
    DataError
        A file is not an image.
    MissingExtraError
        OpenCV is not installed.
    """
    cv2 = require_opencv()
    for path in paths:
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if image is None:
            raise DataError(f"{path} is not an image that OpenCV can read")
        yield np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def grey_of(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W) grey values of an image, (H, W, 3) RGB."""
    cv2 = require_opencv()
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)


def require_opencv() -> ModuleType:
    """Import OpenCV.

    Raises
    ------
    MissingExtraError
        It is not installed.
    """
    return opencv.require_opencv("a learned matcher", extra="deep")
