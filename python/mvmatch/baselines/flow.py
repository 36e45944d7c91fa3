"""Dense inverse search optical flow (OpenCV's DIS), chained like motion vectors."""

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
class DisOptions:
    """Settings of the flow and of its chaining."""

    preset: int = 1
    """OpenCV's preset: 0 ultrafast, 1 fast, 2 medium."""
    cell: int = 8
    """px; one track per square cell."""
    min_gradient: float = 8.0
    """Grey values per px; flatter places start no track."""
    max_round_trip: float = 0.5
    """px between a point and itself after forward and backward flow."""
    min_length: int = 3
    """Observations."""


def track_dis(images: Sequence[Path], *, options: DisOptions | None = None) -> Tracks:
    """Chain dense flow through images.

    Parameters
    ----------
    images : sequence of Path
        Frames in display order, all of one size.
    options : DisOptions
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
    options = options or DisOptions()
    flow = require_opencv().DISOpticalFlow.create(options.preset)
    collector = TrackCollector()
    before: NDArray[np.uint8] | None = None
    for frame, image in enumerate(read_gray(images)):
        if before is not None and len(collector.xy):
            forward, backward = flow.calc(before, image, None), flow.calc(image, before, None)
            xy, alive = _follow(forward, backward, collector.xy, options)
            collector.move(frame, xy, alive)
        collector.start(frame, _seeds(image, collector.xy, options))
        before = image
    return collector.tracks(options.min_length)


def _follow(
    forward: NDArray[np.float32],
    backward: NDArray[np.float32],
    xy: NDArray[np.float32],
    options: DisOptions,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    moved = xy + _at(forward, xy)
    limit = np.array([forward.shape[1] - 1, forward.shape[0] - 1])
    inside = ((moved >= 0) & (moved <= limit)).all(axis=1)
    back = moved + _at(backward, np.clip(moved, 0, limit).astype(np.float32))
    close = np.linalg.norm(back - xy, axis=1) <= options.max_round_trip
    return moved.astype(np.float32), inside & close


def _at(flow: NDArray[np.float32], xy: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the flow at (N, 2) points, bilinear."""
    cv2 = require_opencv()
    # OpenCV's remap is limited to 32767 columns; points are laid out as an image of one column.
    rows = [
        cv2.remap(flow, part[:, None, 0].copy(), part[:, None, 1].copy(), cv2.INTER_LINEAR)
        for part in np.array_split(xy, len(xy) // 30000 + 1)
    ]
    return np.concatenate(rows).reshape(-1, 2)


def _seeds(
    image: NDArray[np.uint8], taken: NDArray[np.float32], options: DisOptions
) -> NDArray[np.float32]:
    """Return the centres of free cells with enough gradient."""
    cv2 = require_opencv()
    dx = cv2.Sobel(image, cv2.CV_32F, 1, 0, scale=0.125)
    dy = cv2.Sobel(image, cv2.CV_32F, 0, 1, scale=0.125)
    half = options.cell // 2
    x, y = np.meshgrid(
        np.arange(half, image.shape[1], options.cell), np.arange(half, image.shape[0], options.cell)
    )
    textured = np.hypot(dx, dy)[y, x].ravel() >= options.min_gradient
    xy = np.column_stack([x.ravel(), y.ravel()])[textured].astype(np.float32)
    return xy[free_cells(taken, xy, options.cell)]
