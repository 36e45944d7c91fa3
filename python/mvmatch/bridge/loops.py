"""Places that the camera comes back to, and tracks of descriptor matches that tie them together.

Motion vectors lead from a picture to those around it. Where the camera sees a place again much
later, nothing in them says so, and the path has drifted by then. So a few pairs of key frames that
look alike are matched by descriptors, and their neighbours with them: points that two pictures of
each end see tie the ends together.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations, islice, product
from typing import TYPE_CHECKING, Literal

import numpy as np

from mvmatch.bridge.descriptors import DescriptorMatcher
from mvmatch.bridge.links import Links
from mvmatch.bridge.retrieval import retrieve, similarities
from mvmatch.geometry.two_view import RansacOptions

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.bridge.descriptors import Features
    from mvmatch.types import Tracks

Pair = tuple[int, int]
"""The earlier one first."""

MIN_SEEN = 2
"""Pictures of each end that see a point; one alone cannot tell how far away it is."""


@dataclass(frozen=True, kw_only=True)
class LoopOptions:
    """Options of :func:`mvmatch.bridge.close_loops`."""

    matcher: Literal["sift", "aliked", "none"] = "none"
    """Descriptor matcher of pycolmap; ``aliked`` (with LightGlue) needs a pycolmap built with ONNX.
    ``none`` looks for no loops."""
    min_apart: int = 50
    """Frames between two pictures that may be of the same place; tracks connect nearer ones, and
    the mapper takes pairs more than 32 apart for loops (:class:`mvmatch.sfm.KeyframeOptions`)."""
    max_pairs: int = 100
    """Pairs of key frames that are tried: those most alike."""
    max_per_picture: int = 2
    """Pairs with any one key frame among them."""
    max_num_features: int = 1000
    """Per picture."""
    max_image_size: int = 3200
    """px; pictures whose longer side has more are made smaller for SIFT by a whole factor."""
    min_inliers: int = 30
    """Matches of a pair that keep to its essential matrix, and points that two pictures of each end
    of a loop see. Fewer can be chance, and the mapper registers no image on fewer."""
    ransac: RansacOptions = field(default_factory=RansacOptions)
    """Of the essential matrix that matches of a pair have to keep."""

    def __post_init__(self) -> None:
        for name in (
            "min_apart",
            "max_pairs",
            "max_per_picture",
            "max_num_features",
            "max_image_size",
            "min_inliers",
        ):
            if getattr(self, name) < 1:
                message = f"{name} is {getattr(self, name)}; it must be at least 1"
                raise ValueError(message)


@dataclass(frozen=True, kw_only=True, eq=False)
class Loops:
    """Tracks of descriptor matches between pictures far apart in time."""

    tracks: Tracks
    """px; each is seen in two pictures of both ends of a loop."""
    pairs: tuple[Pair, ...]
    """Pictures that the tracks tie together, within the ends and across: they are matched however
    far apart they are. Rising."""
    closed: tuple[Pair, ...]
    """The pictures of the same place that were found. Rising."""


def close_loops(
    pictures: Iterable[NDArray[np.uint8]],
    keyframes: NDArray[np.int64],
    camera: pycolmap.Camera,
    *,
    options: LoopOptions,
) -> Loops:
    """Find pictures of the same place far apart in time, and match them by descriptors.

    Parameters
    ----------
    pictures : iterable
        From the first one on, (H, W) uint8 grey values in display order; read once, up to the last
        key frame.
    keyframes : (K,) int64
        Frames that are looked at, rising; neighbours among them should see much in common.
    camera : pycolmap.Camera
        For the essential matrix that matches have to keep.
    options : LoopOptions
        How many pairs are tried, and what is a loop.

    Returns
    -------
    Loops
        The same for the same input; empty where nothing is seen again.

    Raises
    ------
    UnsupportedError
        The matcher does not work with the installed pycolmap.
    """
    matcher = DescriptorMatcher(options, camera)
    features = _features(pictures, keyframes, matcher)
    frames = np.array(sorted(features), np.int64)
    ordered = [features[frame] for frame in frames.tolist()]
    candidates = retrieve(
        similarities([each.directions for each in ordered]),
        frames,
        min_apart=options.min_apart,
        max_pairs=options.max_pairs,
        max_per_picture=options.max_per_picture,
    )
    found = _matched(candidates, ordered, matcher)
    ends = {pair: _ends(pair, len(frames)) for pair, matches in found.items() if len(matches)}
    pairs = _pairs_of(ends.values())
    found |= _matched([pair for pair in pairs if pair not in found], ordered, matcher)
    links = Links()
    for pair in pairs:
        first, second = ((int(frames[place]), ordered[place].xy) for place in pair)
        links.add(first, second, found[pair])
    tracks, closed = _that_close(links.tracks(), frames, ends, options.min_inliers)
    tied = _named(_pairs_of(ends[pair] for pair in closed), frames)
    return Loops(
        tracks=tracks,
        pairs=tuple(pair for pair in tied if len(tracks.between(*pair))),
        closed=_named(closed, frames),
    )


def _features(
    pictures: Iterable[NDArray[np.uint8]],
    keyframes: NDArray[np.int64],
    matcher: DescriptorMatcher,
) -> dict[int, Features]:
    wanted = set(keyframes.tolist())
    read = enumerate(islice(pictures, max(wanted, default=-1) + 1))
    lumas = (luma for frame, luma in read if frame in wanted)
    return dict(zip(sorted(wanted), matcher.extract(lumas), strict=False))


def _matched(
    pairs: Sequence[Pair], features: Sequence[Features], matcher: DescriptorMatcher
) -> dict[Pair, NDArray[np.uint32]]:
    """Match pairs of key frames, given by position."""
    chosen = [(features[first], features[second]) for first, second in pairs]
    return dict(zip(pairs, matcher.match(chosen), strict=True))


def _ends(pair: Pair, count: int) -> tuple[range, range]:
    """Positions of both key frames with their neighbours."""
    first, second = (range(max(0, place - 1), min(place + 2, count)) for place in pair)
    return first, second


def _pairs_of(ends: Iterable[tuple[range, range]]) -> list[Pair]:
    """Pairs within each end, then across: what is near is matched most surely, and counts first."""
    both = list(ends)
    near = {pair for sides in both for side in sides for pair in combinations(side, 2)}
    across = {pair for first, second in both for pair in product(first, second)}
    return [*sorted(near), *sorted(pair for pair in across - near if pair[0] < pair[1])]


def _that_close(
    tracks: Tracks,
    frames: NDArray[np.int64],
    ends: dict[Pair, tuple[range, range]],
    min_tracks: int,
) -> tuple[Tracks, list[Pair]]:
    """Return the loops that enough tracks close, and these tracks."""
    closed: list[Pair] = []
    keep = np.zeros(len(tracks), np.bool_)
    for pair, sides in ends.items():
        first, second = (_counts(tracks, frames[side.start : side.stop]) for side in sides)
        ties = (first >= MIN_SEEN) & (second >= MIN_SEEN)
        if np.count_nonzero(ties) >= min_tracks:
            closed.append(pair)
            keep |= ties
    return tracks.select(keep), sorted(closed)


def _counts(tracks: Tracks, frames: NDArray[np.int64]) -> NDArray[np.int64]:
    """(T,) how many of some frames see each track."""
    seen = np.concatenate([tracks.observations(frame) for frame in frames.tolist()])
    return np.bincount(tracks.track_index[seen], minlength=len(tracks))


def _named(pairs: Sequence[Pair], frames: NDArray[np.int64]) -> tuple[Pair, ...]:
    """Return frames for positions."""
    return tuple(sorted((int(frames[first]), int(frames[second])) for first, second in pairs))
