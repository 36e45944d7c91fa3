"""Matches of features, grown into tracks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvmatch.types import Tracks

if TYPE_CHECKING:
    from numpy.typing import NDArray


class Links:
    """Tracks of features that were matched with each other, one feature per frame.

    Earlier matches count more: one that would put two features of a frame into a track is left out.

    Examples
    --------
    >>> import numpy as np
    >>> xy = np.array([[1.0, 2.0], [3.0, 4.0]], np.float32)
    >>> links = Links()
    >>> links.add((0, xy), (1, xy), np.array([[0, 1]], np.uint32))
    >>> links.add((1, xy), (2, xy), np.array([[1, 0], [0, 0]], np.uint32))
    >>> links.tracks().xy.tolist()
    [[1.0, 2.0], [3.0, 4.0], [1.0, 2.0]]
    """

    def __init__(self) -> None:
        # Of each track the feature in each frame; of each frame the track of each feature, or -1.
        self._tracks: dict[int, dict[int, int]] = {}
        self._track_of: dict[int, NDArray[np.int64]] = {}
        self._xy: dict[int, NDArray[np.float32]] = {}
        self._num_begun = 0

    def add(
        self,
        first: tuple[int, NDArray[np.float32]],
        second: tuple[int, NDArray[np.float32]],
        matches: NDArray[np.uint32],
    ) -> None:
        """Link the features of two frames.

        Parameters
        ----------
        first, second : tuple
            Frame, and (K, 2) positions of its features, px.
        matches : (M, 2) uint32
            Numbers of the features that match.
        """
        for frame, xy in (first, second):
            if frame not in self._xy:
                self._xy[frame] = np.array(xy, np.float32)
                self._track_of[frame] = np.full(len(xy), -1, np.int64)
        for index0, index1 in matches.tolist():
            track0 = self._track(first[0], index0)
            track1 = self._track(second[0], index1)
            if track0 != track1 and self._tracks[track0].keys().isdisjoint(self._tracks[track1]):
                self._join(track0, track1)

    def tracks(self) -> Tracks:
        """Return the tracks of at least two observations."""
        kept = [sorted(seen.items()) for seen in self._tracks.values() if len(seen) > 1]
        rows = np.array([row for seen in kept for row in seen], np.int64).reshape(-1, 2)
        offsets = np.cumsum([0, *map(len, kept)], dtype=np.int64)
        frames = np.array(sorted(self._xy), np.int64)
        positions = [np.empty((0, 2), np.float32), *(self._xy[frame] for frame in frames.tolist())]
        starts = np.cumsum([len(xy) for xy in positions])[:-1]
        row = starts[np.searchsorted(frames, rows[:, 0])] + rows[:, 1]
        xy = np.concatenate(positions)[row]
        return Tracks(offsets=offsets, frame=rows[:, 0].astype(np.int32), xy=xy)

    def _track(self, frame: int, index: int) -> int:
        track = int(self._track_of[frame][index])
        if track < 0:
            track = self._num_begun
            self._num_begun += 1
            self._track_of[frame][index] = track
            self._tracks[track] = {frame: index}
        return track

    def _join(self, track: int, other: int) -> None:
        moved = self._tracks.pop(other)
        self._tracks[track] |= moved
        for frame, index in moved.items():
            self._track_of[frame][index] = track
