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
from mvmatch.bridge.links import Links
from mvmatch.rows import count_entering, count_ties
from mvmatch.types import Tracks

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Sequence

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.bridge.descriptors import Features
    from mvmatch.bridge.options import BridgeOptions


HELD = 5
"""Pictures on each side of a step between pictures in which tracks that hold them together are seen
twice."""
MIN_FOUND = 200
"""Features of a picture that the near ones before it show; with fewer there is a break before it,
and it is matched with far ones by all of its features."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Bridge:
    """Tracks of descriptor matches around the gaps of a video."""

    tracks: Tracks
    """px; they are matched and mapped as all others."""
    gaps: tuple[int, ...]
    """Frames after which the scene jumps or too few tracks went on."""
    bridged: tuple[int, ...]
    """Those of them that enough tracks of matches cross now."""


def find_gaps(
    tracks: Tracks, num_frames: int, *, min_tracks: int, min_ties: int, jumps: Collection[int] = ()
) -> tuple[int, ...]:
    """Find the pictures after which the scene jumps, or too few tracks go on or go on briefly.

    Parameters
    ----------
    tracks : Tracks
        Of a video.
    num_frames : int
        Its pictures.
    min_tracks : int
        Tracks with an observation at or before a picture and another one after it.
    min_ties : int
        Tracks that, between such gaps, are seen twice in the :data:`HELD` pictures on either side:
        a chain of tracks that end as soon as they are points bends, or breaks.
    jumps : collection of int, optional
        Pictures before which a piece of the scene is missing (:class:`mvmatch.footage.Footage`):
        many of the tracks into them are wrong.

    Returns
    -------
    tuple of int
        Display indices, rising; the last picture has none after it and is no gap.
    """
    is_gap = count_entering(tracks, num_frames)[1:] < min_tracks
    is_gap[[jump - 1 for jump in jumps if 0 < jump < num_frames]] = True
    is_gap |= count_ties(tracks, num_frames, reach=HELD, ends=is_gap) < min_ties
    return tuple(np.flatnonzero(is_gap).tolist())


def bridge_tracks(
    pictures: Callable[[], Iterable[NDArray[np.uint8]]],
    tracks: Tracks,
    camera: pycolmap.Camera,
    *,
    num_frames: int,
    options: BridgeOptions,
    jumps: Collection[int] = (),
) -> Bridge:
    """Match pictures by descriptors where too few tracks go on.

    Parameters
    ----------
    pictures : callable
        Gives the pictures from the first one on, (H, W) uint8 grey values in display order; they
        are read up to the last one around a gap, again where a gap stays, or not at all.
    tracks : Tracks
        Of its motion vectors.
    camera : pycolmap.Camera
        For the essential matrix that matches have to keep.
    num_frames : int
        Pictures with tracks; later ones are not looked at.
    options : BridgeOptions
        What is a gap, and how far around it pictures are matched.
    jumps : collection of int, optional
        See :func:`find_gaps`.

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
    gaps = find_gaps(
        tracks,
        num_frames,
        min_tracks=options.min_tracks,
        min_ties=options.min_ties,
        jumps=jumps,
    )
    if not gaps:
        return Bridge(tracks=Tracks.from_lists(), gaps=(), bridged=())
    matcher, links = DescriptorMatcher(options, camera), Links()

    def still_open() -> tuple[int, ...]:
        crossing = count_entering(links.tracks(), num_frames)[1:]
        return tuple(gap for gap in gaps if crossing[gap] < options.min_inliers)

    left = gaps
    for reach in (options.reach, options.far_reach):
        if left:
            stretches = _stretches(left, reach, options.window)
            within = islice(pictures(), num_frames)
            windows = max(options.window, 2 * reach), options.near
            _match_around(stretches, windows, within, matcher, links)
            left = still_open()
    bridged = tuple(gap for gap in gaps if gap not in left)
    return Bridge(tracks=links.tracks(), gaps=gaps, bridged=bridged)


def _match_around(
    stretches: Sequence[range],
    windows: tuple[int, int],
    pictures: Iterable[NDArray[np.uint8]],
    matcher: DescriptorMatcher,
    links: Links,
) -> None:
    """Match the pictures of each stretch with those so far back, and by all features so far.

    Across a break time says little about what two pictures share: those up to a window behind one
    are matched with all up to a window before it.
    """
    window, whole = windows
    stretch_of = {frame: stretch for stretch in stretches for frame in stretch}
    read = enumerate(islice(pictures, stretches[-1].stop))
    lumas = (luma for frame, luma in read if frame in stretch_of)
    earlier: dict[int, _Picture] = {}
    broken = -window
    for frame, features in zip(sorted(stretch_of), matcher.extract(lumas), strict=False):
        picture = _Picture(frame, features)
        oldest = (broken if frame < broken + window else frame) - window
        earlier = {other: earlier[other] for other in earlier if other >= oldest}
        # The nearest first.
        others = [earlier[other] for other in reversed(earlier) if other in stretch_of[frame]]
        near = [other for other in others if other.frame >= frame - whole]
        pairs = [(other.features, features) for other in near]
        _link(picture, near, matcher.match(pairs), links)
        if picture.num_found < MIN_FOUND:
            broken = frame
        far, telling = others[len(near) :], picture.telling()
        _link(picture, far, matcher.match([(other.telling(), telling) for other in far]), links)
        earlier[frame] = picture


class _Picture:
    """Features of a picture, and which of them other pictures show."""

    def __init__(self, frame: int, features: Features) -> None:
        self.frame = frame
        self.features = features
        self._is_found = np.zeros(len(features.xy), np.bool_)

    @property
    def num_found(self) -> int:
        """Features that other pictures show."""
        return int(np.count_nonzero(self._is_found))

    def find(self, numbers: NDArray[np.uint32]) -> None:
        """Note features that another picture shows."""
        self._is_found[numbers] = True

    def telling(self) -> Features:
        """Return what to match with far pictures: what near ones show, or all if that is little."""
        found = np.flatnonzero(self._is_found)
        return self.features.only(found) if len(found) >= MIN_FOUND else self.features


def _link(
    picture: _Picture,
    others: Sequence[_Picture],
    found: Sequence[NDArray[np.uint32]],
    links: Links,
) -> None:
    """Take the matches of earlier pictures with one."""
    for other, matches in zip(others, found, strict=True):
        links.add((other.frame, other.features.xy), (picture.frame, picture.features.xy), matches)
        other.find(matches[:, 0])
        picture.find(matches[:, 1])


def _stretches(gaps: Sequence[int], reach: int, window: int) -> list[range]:
    """Pictures around gaps; several gaps that a window spans are seen from as far as it."""
    groups: list[list[int]] = []
    for gap in gaps:
        if not groups or gap - groups[-1][-1] > window:
            groups.append([])
        groups[-1].append(gap)
    stretches: list[range] = []
    for group in groups:
        around = reach if len(group) == 1 else max(reach, window)
        first, stop = max(0, group[0] + 1 - around), group[-1] + 1 + around
        if stretches and first <= stretches[-1].stop:
            first = stretches.pop().start
        stretches.append(range(first, stop))
    return stretches
