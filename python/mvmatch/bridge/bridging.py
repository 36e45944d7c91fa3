"""Gaps between pictures, and tracks of descriptor matches across them.

An encoder codes anew what it does not find again: after a long pause, a jump or a fast turn there
are no vectors, and tracks end. Where almost all end, a few pictures on both sides are decoded and
matched by descriptors.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.bridge.descriptors import DescriptorMatcher
from mvmatch.geometry.two_view import fit_pair
from mvmatch.types import Tracks

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.bridge.descriptors import Features
    from mvmatch.bridge.options import BridgeOptions


@dataclass(frozen=True, kw_only=True, eq=False)
class Bridge:
    """Tracks of descriptor matches around the gaps of a video."""

    tracks: Tracks
    """px; they are matched and mapped as all others."""
    gaps: tuple[int, ...]
    """Frames after which too few tracks went on."""
    bridged: tuple[int, ...]
    """Those of them that enough tracks of matches cross now."""


def find_gaps(tracks: Tracks, num_frames: int, *, min_tracks: int) -> tuple[int, ...]:
    """Find the pictures after which fewer than ``min_tracks`` tracks go on.

    Parameters
    ----------
    tracks : Tracks
        Of a video.
    num_frames : int
        Its pictures.
    min_tracks : int
        Tracks with an observation at or before a picture and another one after it.

    Returns
    -------
    tuple of int
        Display indices, rising; the last picture has none after it and is no gap.
    """
    return tuple(np.flatnonzero(_crossings(tracks, num_frames) < min_tracks).tolist())


def bridge_tracks(
    pictures: Iterable[NDArray[np.uint8]],
    tracks: Tracks,
    camera: pycolmap.Camera,
    *,
    num_frames: int,
    options: BridgeOptions,
) -> Bridge:
    """Match pictures by descriptors where too few tracks go on.

    Parameters
    ----------
    pictures : iterable of (H, W) uint8
        Grey values in display order; read up to the last picture around a gap, or not at all.
    tracks : Tracks
        Of its motion vectors.
    camera : pycolmap.Camera
        For the essential matrix that matches have to keep.
    num_frames : int
        Pictures with tracks; later ones are not looked at.
    options : BridgeOptions
        What is a gap, and how far around it pictures are matched.

    Returns
    -------
    Bridge
        Without tracks where there is no gap.

    Raises
    ------
    UnsupportedError
        The matcher does not work with the installed pycolmap.
    """
    if options.matcher == "none":
        return Bridge(tracks=Tracks.from_lists(), gaps=(), bridged=())
    gaps = find_gaps(tracks, num_frames, min_tracks=options.min_tracks)
    if not gaps:
        return Bridge(tracks=Tracks.from_lists(), gaps=(), bridged=())
    matcher = DescriptorMatcher(options)
    around = {
        frame
        for gap in gaps
        for frame in range(max(0, gap + 1 - options.reach), gap + 1 + options.reach)
    }
    links = _Links()
    earlier: dict[int, Features] = {}
    for frame, luma in enumerate(islice(pictures, min(num_frames, max(around) + 1))):
        if frame not in around:
            continue
        features = matcher.extract(luma)
        for other in _partners(frame, gaps, options.reach):
            matches = matcher.match(earlier[other], features)
            points = earlier[other].xy[matches[:, 0]], features.xy[matches[:, 1]]
            fit = fit_pair(*points, camera, camera, frames=(other, frame), options=options.ransac)
            if np.count_nonzero(fit.inliers) >= options.min_inliers:
                links.add(other, matches[fit.inliers])
        links.close(frame, features.xy)
        earlier[frame] = features
        earlier = {key: value for key, value in earlier.items() if key > frame - 2 * options.reach}
    found = links.tracks()
    crossing = _crossings(found, num_frames)
    bridged = tuple(gap for gap in gaps if crossing[gap] >= options.min_inliers)
    return Bridge(tracks=found, gaps=gaps, bridged=bridged)


def _crossings(tracks: Tracks, num_frames: int) -> NDArray[np.int64]:
    """(F - 1,) tracks with observations on both sides of the step from each picture to the next."""
    change = np.zeros(num_frames + 1, np.int64)
    np.add.at(change, tracks.frame[tracks.offsets[:-1]], 1)
    np.add.at(change, tracks.frame[tracks.offsets[1:] - 1], -1)
    return np.cumsum(change)[: max(0, num_frames - 1)]


def _partners(frame: int, gaps: Sequence[int], reach: int) -> list[int]:
    """Earlier pictures that lie around one gap together with this one, the nearest first."""
    near = [gap for gap in gaps if gap + 1 - reach <= frame <= gap + reach]
    first = max(0, min((gap + 1 - reach for gap in near), default=frame))
    return list(range(frame - 1, first - 1, -1))


class _Links:
    """Matches that grow into tracks, picture by picture."""

    def __init__(self) -> None:
        self._points: list[list[tuple[int, float, float]]] = []
        self._track_of: dict[tuple[int, int], int] = {}
        self._pending: list[tuple[int, int, int]] = []
        self._xy: dict[int, NDArray[np.float32]] = {}

    def add(self, other: int, matches: NDArray[np.uint32]) -> None:
        """Take note of features of an earlier picture found again; the first note counts most."""
        self._pending += [(other, int(first), int(second)) for first, second in matches.tolist()]

    def close(self, frame: int, xy: NDArray[np.float32]) -> None:
        """Extend tracks by the features of a picture, or start them, each feature once."""
        self._xy[frame] = xy
        taken: set[int] = set()
        for other, first, second in self._pending:
            if (frame, second) in self._track_of:
                continue
            track = self._track_of.get((other, first))
            if track is None:
                track = len(self._points)
                self._points.append([(other, *self._xy[other][first].tolist())])
                self._track_of[other, first] = track
            if track in taken:
                continue
            taken.add(track)
            self._points[track].append((frame, *xy[second].tolist()))
            self._track_of[frame, second] = track
        self._pending.clear()

    def tracks(self) -> Tracks:
        return Tracks.from_lists(*(points for points in self._points if len(points) > 1))
