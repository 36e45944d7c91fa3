"""Pictures as grey values, one at a time, in display order."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.encode.frames import open_frames

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from mvmatch.types import StrPath


def gray_pictures(source: StrPath, *, max_frames: int | None = None) -> Iterator[NDArray[np.uint8]]:
    """Decode the shown pictures of a video or read the images of a folder.

    Parameters
    ----------
    source : path
        A video FFmpeg decodes, AV1 included, or a folder of images in natural order.
    max_frames : int, optional
        Stop after so many.

    Yields
    ------
    ndarray
        (H, W) uint8 luma; picture i has display index i. Where a video breaks off, the pictures
        before are all there are.

    Raises
    ------
    FileNotFoundError
        There is no such file or folder.
    DataError
        Nothing in it can be decoded, or the pictures have different sizes.
    """
    # The rate only times the images of a folder, which nobody asks here.
    for picture in open_frames(Path(source), frame_rate=30.0, max_frames=max_frames):
        luma = picture.to_ndarray(format="gray")
        yield np.ascontiguousarray(luma, np.uint8)
