"""Tracks that come in batches, put into one table."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvmatch.types import Tracks

if TYPE_CHECKING:
    from numpy.typing import NDArray


class TrackBatches:
    """Grows the arrays of tracks in place, so that no batch is held twice."""

    def __init__(self) -> None:
        self._offsets = np.zeros(1, np.int64)
        self._frame = np.empty(0, np.int32)
        self._xy = np.empty((0, 2), np.float32)

    def add(
        self, offsets: NDArray[np.int64], frame: NDArray[np.int32], xy: NDArray[np.float32]
    ) -> None:
        """Put the arrays of :class:`mvmatch.types.Tracks` behind those that are there."""
        size, num_tracks = len(self._frame), len(self._offsets)
        # Nobody else has seen the arrays.
        self._offsets.resize(num_tracks + len(offsets) - 1, refcheck=False)
        self._frame.resize(size + len(frame), refcheck=False)
        self._xy.resize((size + len(frame), 2), refcheck=False)
        self._offsets[num_tracks:] = offsets[1:] + size
        self._frame[size:] = frame
        self._xy[size:] = xy

    def tracks(self) -> Tracks:
        """Return all tracks; nothing can be added then."""
        return Tracks(offsets=self._offsets, frame=self._frame, xy=self._xy)
