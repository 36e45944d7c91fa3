"""Points followed forward from frame to frame, collected as tracks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvmatch.types import Tracks

if TYPE_CHECKING:
    from numpy.typing import NDArray

COLMAP_FROM_OPENCV = 0.5
"""px, added to both coordinates."""


class TrackCollector:
    """Tracks that grow one frame at a time; coordinates in OpenCV's origin until the end."""

    def __init__(self) -> None:
        self._next = 0
        self._ids: NDArray[np.int64] = np.empty(0, np.int64)
        self.xy: NDArray[np.float32] = np.empty((0, 2), np.float32)
        """(N, 2) points alive in the last frame, px."""
        self._rows: list[tuple[NDArray[np.int64], int, NDArray[np.float32]]] = []

    def move(self, frame: int, xy: NDArray[np.float32], alive: NDArray[np.bool_]) -> None:
        """Carry the living points into a frame; the others end."""
        self._ids, self.xy = self._ids[alive], xy[alive]
        self._rows.append((self._ids, frame, self.xy))

    def start(self, frame: int, xy: NDArray[np.float32]) -> None:
        """Start new tracks in a frame."""
        ids = np.arange(self._next, self._next + len(xy), dtype=np.int64)
        self._next += len(xy)
        self._ids, self.xy = np.concatenate([self._ids, ids]), np.concatenate([self.xy, xy])
        self._rows.append((ids, frame, xy))

    def tracks(self, min_length: int) -> Tracks:
        """Return tracks of at least ``min_length`` observations in mvmatch's origin."""
        ids = np.concatenate([row[0] for row in self._rows])
        frame = np.concatenate([np.full(len(row[0]), row[1], np.int32) for row in self._rows])
        xy = np.concatenate([row[2] for row in self._rows]) + np.float32(COLMAP_FROM_OPENCV)
        kept = np.bincount(ids, minlength=self._next)[ids] >= min_length
        ids, frame, xy = ids[kept], frame[kept], xy[kept]
        order = np.lexsort((frame, ids))
        _, lengths = np.unique(ids, return_counts=True)
        return Tracks(
            offsets=np.concatenate(([0], np.cumsum(lengths))).astype(np.int64),
            frame=frame[order],
            xy=xy[order].astype(np.float32),
        )


def free_cells(
    taken: NDArray[np.float32], candidates: NDArray[np.float32], cell: int
) -> NDArray[np.bool_]:
    """Mark the candidates, one per square cell, whose cell holds no taken point."""
    keys = [(xy // cell).astype(np.int64) @ np.array([1 << 20, 1]) for xy in (taken, candidates)]
    _, first = np.unique(keys[1], return_index=True)
    free = np.zeros(len(candidates), bool)
    free[first] = True
    return free & ~np.isin(keys[1], keys[0])
