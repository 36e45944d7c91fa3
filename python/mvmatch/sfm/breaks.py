"""Where in a sequence nothing moves, the camera only turns, or one plane is all there is."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.sfm.evidence import MIN_STRETCH

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from mvmatch.sfm.evidence import Evidence, PairEvidence
    from mvmatch.types import Tracks

Part = tuple[int, int]
"""First and last picture."""

STILL = 0.25
"""px; median motion of the tracks between two pictures in which nothing moves."""

MAX_DRIFT = 1.0
"""px; median motion of the tracks through a whole part in which nothing moves."""

MIN_PART = 5
"""Pictures; what stands still or turns for a shorter time is bridged by matches across."""

MAX_MOVING = 0.1
"""Share of the image pairs whose matches no rotation explains, where the camera only turns: single
pairs are wrong."""

MIN_DISPLACEMENT = 1.0
"""px; a camera whose matches move less at every gap stands still."""

FLAT_SHARE = 0.95
"""Share of a pair's matches that one homography explains."""

MIN_FLAT_MOTION = 16.0
"""px; matches that move less fit a homography whatever the scene: its bound is 4 px."""


def parts_at_rest(tracks: Tracks, num_frames: int) -> list[Part]:
    """Find parts in which the tracks, px, stay where they are."""
    step = np.full(num_frames, np.inf)
    for frame in range(1, num_frames):
        step[frame] = _median_motion(tracks, frame - 1, frame)
    parts: list[Part] = []
    for first, last in runs(step < STILL):
        if last - first + 2 < MIN_PART:
            continue
        drift = _median_motion(tracks, first - 1, last)
        if not MAX_DRIFT < drift < np.inf:
            parts.append((first - 1, last))
    return parts


def parts_where(
    evidence: Evidence, num_frames: int, holds: Callable[[PairEvidence], bool]
) -> list[Part]:
    """Find parts in which most of the image pairs across each boundary have a property."""
    found = runs(boundaries_where(evidence, num_frames, holds))
    return [(first - 1, last) for first, last in found if last - first + 2 >= MIN_PART]


def boundaries_where(
    evidence: Evidence, num_frames: int, holds: Callable[[PairEvidence], bool]
) -> NDArray[np.bool_]:
    """(F,) whether most of the image pairs across the boundary before each frame have a property.

    Pairs far apart reach over many boundaries, and see more motion: so they have more votes.
    """
    votes = np.zeros(num_frames + 1, np.int64)
    for pair in evidence.pairs:
        vote = 1 if holds(pair) else -1
        # Images are frames plus one: the pair reaches over the boundaries image0 to image1 - 1.
        votes[pair.image0] += vote
        votes[pair.image1] -= vote
    return np.cumsum(votes)[:num_frames] > 0


def is_turn(pair: PairEvidence) -> bool:
    """Whether a rotation explains the matches of a pair, and there is one."""
    return is_rotation(pair) and pair.displacement >= MAX_DRIFT


def is_rotation(pair: PairEvidence) -> bool:
    """Whether a rotation, or none at all, explains the matches of a pair."""
    return pair.homography_ratio > FLAT_SHARE and pair.stretch < MIN_STRETCH


def is_plane(pair: PairEvidence) -> bool:
    """Whether a plane that the camera moves along explains the matches of a pair."""
    flat = pair.homography_ratio > FLAT_SHARE
    return flat and pair.stretch >= MIN_STRETCH and pair.displacement >= MIN_FLAT_MOTION


def hopeless(evidence: Evidence) -> str | None:
    """Say why no model can come of this database, if none can."""
    if not evidence.pairs:
        return "no image pair has enough verified matches"
    if max(pair.displacement for pair in evidence.pairs) < MIN_DISPLACEMENT:
        return (
            "the camera does not move: half of the matches of every image pair stay within "
            f"{MIN_DISPLACEMENT:g} px"
        )
    if _only_turns(evidence):
        return "the camera only turns: a rotation explains the matches of the image pairs"
    return None


def _only_turns(evidence: Evidence) -> bool:
    """Whether nearly all pairs fit a rotation, and nowhere in the sequence most of them do not."""

    def moves(pair: PairEvidence) -> bool:
        return not is_rotation(pair)

    few = sum(map(moves, evidence.pairs)) <= MAX_MOVING * len(evidence.pairs)
    last = max(pair.image1 for pair in evidence.pairs)
    return few and not boundaries_where(evidence, last, moves).any()


def runs(mask: NDArray[np.bool_]) -> list[Part]:
    """First and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False]))))
    return [(first, end - 1) for first, end in edges.reshape(-1, 2).tolist()]


def named_parts(parts: Sequence[Part]) -> str:
    """Name the first five parts."""
    named = [str(a) if a == b else f"{a} to {b}" for a, b in parts[:5]]
    return ", ".join(named) + (" …" if parts[5:] else "")


def named_frames(frames: Sequence[int]) -> str:
    """Name the first five frames."""
    return named_parts([(frame, frame) for frame in frames])


def _median_motion(tracks: Tracks, frame0: int, frame1: int) -> float:
    """Median motion in px between two frames; infinite without matches."""
    pair = tracks.between(frame0, frame1)
    if not len(pair):
        return math.inf
    return float(np.median(np.linalg.norm(pair.xy1 - pair.xy0, axis=1)))
