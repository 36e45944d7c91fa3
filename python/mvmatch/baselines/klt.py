"""Pyramidal Lucas-Kanade tracking of corners (OpenCV), checked forward and backward."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.baselines.chain import TrackCollector, free_cells
from mvmatch.baselines.images import read_gray, require_opencv

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from mvmatch.types import Tracks


@dataclass(frozen=True, kw_only=True)
class KltOptions:
    """Settings of the tracker."""

    max_corners: int = 2000
    """Living tracks per frame."""
    quality: float = 0.005
    """Corners weaker than this share of the strongest are left out."""
    cell: int = 8
    """px; distance of new corners from each other and from tracks."""
    window: int = 15
    """px, side of the matched window."""
    levels: int = 4
    """Pyramid levels above the first."""
    max_round_trip: float = 0.5
    """px between a point and itself tracked there and back."""
    min_length: int = 3
    """Observations."""


def track_klt(images: Sequence[Path], *, options: KltOptions | None = None) -> Tracks:
    """Track corners through images.

    Parameters
    ----------
    images : sequence of Path
        Frames in display order, all of one size.
    options : KltOptions
        Settings.

    Returns
    -------
    Tracks
        px, origin at the upper-left image corner.

    Raises
    ------
    MissingExtraError
        OpenCV is not installed.
    DataError
        A file is not an image.
    """
    options = options or KltOptions()
    collector = TrackCollector()
    before: NDArray[np.uint8] | None = None
    for frame, image in enumerate(read_gray(images)):
        if before is not None and len(collector.xy):
            xy, alive = _follow(before, image, collector.xy, options)
            collector.move(frame, xy, alive)
        collector.start(frame, _corners(image, collector.xy, options))
        before = image
    return collector.tracks(options.min_length)


def _follow(
    before: NDArray[np.uint8],
    image: NDArray[np.uint8],
    xy: NDArray[np.float32],
    options: KltOptions,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    cv2 = require_opencv()
    settings = {"winSize": (options.window, options.window), "maxLevel": options.levels}
    points = xy.reshape(-1, 1, 2)
    there, found, _ = cv2.calcOpticalFlowPyrLK(before, image, points, None, **settings)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(image, before, there, None, **settings)
    moved = there.reshape(-1, 2)
    alive = (found.ravel() == 1) & (returned.ravel() == 1)
    alive &= np.linalg.norm(back.reshape(-1, 2) - xy, axis=1) <= options.max_round_trip
    limit = np.array([image.shape[1] - 1, image.shape[0] - 1])
    alive &= ((moved >= 0) & (moved <= limit)).all(axis=1)
    return moved, alive


def _corners(
    image: NDArray[np.uint8], taken: NDArray[np.float32], options: KltOptions
) -> NDArray[np.float32]:
    cv2 = require_opencv()
    wanted = options.max_corners - len(taken)
    if wanted <= 0:
        return np.empty((0, 2), np.float32)
    corners = cv2.goodFeaturesToTrack(image, options.max_corners, options.quality, options.cell)
    if corners is None:
        return np.empty((0, 2), np.float32)
    found = corners.reshape(-1, 2).astype(np.float32)
    return found[free_cells(taken, found, options.cell)][:wanted]
