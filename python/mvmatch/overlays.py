"""Static overlays: parts of the picture that stay where they are while the scene moves.

Logos, dashboards and letterboxes are drawn over the pictures or stand still before the lens. Their
vectors are zero, and right as motion, but they belong to no place of the scene: to a mapper they
are points at infinity that do not turn with the camera.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.cells import CELL

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from mvmatch.cells import FieldCells
    from mvmatch.types import MotionField


@dataclass(frozen=True, kw_only=True)
class OverlayOptions:
    """What counts as a static overlay."""

    min_still: float | None = 0.7
    """Share of the frames in which a cell stands still while the picture moves; None: overlays are
    not looked for."""
    min_motion: float = 1.0
    """px per frame; the picture moves when the median of its moving cells is at least this fast."""
    min_moving: float = 0.5
    """Share of the cells that do not stand still when the picture moves: with a static camera most
    do, and keep their tracks."""
    min_frames: int = 8
    """Moving frames that a verdict needs."""
    window: int = 60
    """Coded frames per verdict: overlays come and go."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Overlays:
    """Where overlays lie, window by window."""

    end: NDArray[np.int64]
    """(W,) first frame after each window, rising."""
    cells: NDArray[np.bool_]
    """(W, R, C) cells of 8 px under an overlay."""

    def at(self, frame: int) -> NDArray[np.bool_]:
        """(R, C) overlay cells of a frame."""
        return self.cells[self._window(frame)]

    def contain(self, frame: ArrayLike, xy: ArrayLike) -> NDArray[np.bool_]:
        """(N,) whether (N, 2) points, px, of (N,) frames lie on an overlay."""
        points = np.asarray(xy, np.float64).reshape(-1, 2)
        limit = np.array(self.cells.shape[:0:-1]) - 1
        column, row = np.clip(points // CELL, 0, limit).astype(np.int64).T
        return self.cells[self._window(frame), row, column]

    @property
    def area_share(self) -> float:
        """Largest share of the picture under overlays in any window."""
        shares = self.cells.mean(axis=(1, 2)) if self.cells.size else np.zeros(1)
        return float(shares.max())

    @property
    def mean_area_share(self) -> float:
        """Share of the picture under overlays, mean over all frames."""
        length = np.diff(self.end, prepend=0)
        return float(self.cells.mean(axis=(1, 2)) @ length / max(1, length.sum()))

    def _window(self, frame: ArrayLike) -> NDArray[np.int64]:
        window = np.searchsorted(self.end, np.asarray(frame), side="right")
        return np.minimum(window, len(self.end) - 1)


class OverlayFinder:
    """Counts, cell by cell, how often a part of the picture stands still while the rest moves.

    Feed every field with :meth:`add`, in decode order; one count per cell is kept.
    """

    def __init__(self, options: OverlayOptions | None = None) -> None:
        self._options = options or OverlayOptions()
        self._still = np.zeros((0, 0), np.int32)
        self._moving_frames = self._frames = self._last = 0
        self._windows: list[tuple[int, int, NDArray[np.int32]]] = []

    def add(self, field: MotionField, cells: FieldCells) -> None:
        """Count one field, given on the grid as well."""
        if self._still.size == 0:
            self._still = np.zeros(cells.past.shape, np.int32)
        self._last = max(self._last, field.frame)
        if field.is_key:
            return
        still = cells.still
        moving = cells.speed[cells.speed > 0]
        self._frames += 1
        if (
            np.mean(still) <= 1 - self._options.min_moving
            and len(moving)
            and np.median(moving) >= self._options.min_motion
        ):
            self._moving_frames += 1
            self._still += still
        if self._frames == self._options.window:
            self._windows.append((self._last + 1, self._moving_frames, self._still))
            self._still = np.zeros_like(self._still)
            self._moving_frames = self._frames = 0

    def overlays(self) -> Overlays:
        """Return what was found in the fields so far."""
        windows = [*self._windows, (self._last + 1, self._moving_frames, self._still)]
        if len(windows) > 1 and self._frames < self._options.window // 2:
            # A short rest says little: it joins the window before.
            (_, frames, still), (end, more_frames, more_still) = windows[-2:]
            windows[-2:] = [(end, frames + more_frames, still + more_still)]
        return Overlays(
            end=np.array([end for end, _, _ in windows], np.int64),
            cells=np.array([self._verdict(frames, still) for _, frames, still in windows]),
        )

    def _verdict(self, frames: int, still: NDArray[np.int32]) -> NDArray[np.bool_]:
        if self._options.min_still is None or frames < self._options.min_frames:
            return np.zeros(still.shape, np.bool_)
        return still >= self._options.min_still * frames
