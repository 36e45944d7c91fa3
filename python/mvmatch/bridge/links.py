"""Matches of features, grown into tracks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvmatch.types import Tracks

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Feature = tuple[int, int]
"""Frame, and number of the feature in it."""


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
        self._tracks: dict[int, dict[int, tuple[float, float]]] = {}
        self._track_of: dict[Feature, int] = {}
        self._features: dict[int, list[Feature]] = {}

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
        (frame0, xy0), (frame1, xy1) = first, second
        for index0, index1 in matches.tolist():
            track0 = self._track(frame0, index0, xy0)
            track1 = self._track(frame1, index1, xy1)
            if track0 != track1 and self._tracks[track0].keys().isdisjoint(self._tracks[track1]):
                self._join(track0, track1)

    def tracks(self) -> Tracks:
        """Return the tracks of at least two observations."""
        ordered = (sorted(points.items()) for points in self._tracks.values() if len(points) > 1)
        return Tracks.from_lists(*([(frame, *xy) for frame, xy in points] for points in ordered))

    def _track(self, frame: int, index: int, xy: NDArray[np.float32]) -> int:
        feature = (frame, index)
        track = self._track_of.get(feature)
        if track is None:
            track = len(self._track_of)
            self._track_of[feature] = track
            self._features[track] = [feature]
            x, y = xy[index].tolist()
            self._tracks[track] = {frame: (x, y)}
        return track

    def _join(self, track: int, other: int) -> None:
        self._tracks[track] |= self._tracks.pop(other)
        moved = self._features.pop(other)
        self._features[track] += moved
        self._track_of |= dict.fromkeys(moved, track)
