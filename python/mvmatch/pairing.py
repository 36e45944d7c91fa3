"""Frame pairs that share tracks, a few frames at a time: memory does not grow with the video."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.rows import observed

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from numpy.typing import NDArray

    from mvmatch.types import Tracks

FRAMES = 32
"""Frames whose matches with later ones are sorted together."""


def reach(tracks: Tracks, max_gap: int | None) -> int:
    """Largest distance in frames of a pair; see :meth:`mvmatch.types.Tracks.reach`."""
    largest = 0
    for part in tracks.parts():
        if max_gap is None:
            seen = part.lengths > 0
            first, second = part.offsets[:-1][seen], part.offsets[1:][seen] - 1
        else:
            first, second = _matched(part, np.arange(part.num_observations), max_gap)
        largest = max(largest, int((part.frame[second] - part.frame[first]).max(initial=0)))
        if largest == max_gap:
            break
    return largest


def frame_pairs(
    tracks: Tracks, max_gap: int | None, start: int, end: int
) -> Iterator[tuple[int, int, NDArray[np.uint32]]]:
    """Yield pairs with their matches; see :meth:`mvmatch.types.Tracks.pairs`."""
    gap = reach(tracks, None) if max_gap is None else max_gap
    end = min(end, tracks.num_frames)
    for frame in range(start, end, FRAMES):
        last = min(frame + FRAMES, end)
        part = tracks.during(frame, last + gap)
        yield from _parted(part, *_matched(part, np.flatnonzero(part.frame < last), gap))


def shared(tracks: Tracks, frame0: int, frame1: int) -> NDArray[np.uint32]:
    """(M, 2) keypoint numbers of the tracks seen in both of two frames, ordered by track."""
    first, second = (tracks.track_index[tracks.observations(frame)] for frame in (frame0, frame1))
    _, *numbers = np.intersect1d(first, second, assume_unique=True, return_indices=True)
    return np.stack(numbers, axis=1).astype(np.uint32)


def seen_in(tracks: Tracks, frames: Collection[int]) -> Tracks:
    """Return what is observed in some frames; see :meth:`mvmatch.types.Tracks.during`."""
    return observed(tracks, np.flatnonzero(np.isin(tracks.frame, list(frames))))[1]


def adjacency(tracks: Tracks, max_gap: int | None) -> NDArray[np.int64]:
    """Count the matches of pairs; see :meth:`mvmatch.types.Tracks.adjacency`."""
    counts = np.empty((0, 3), np.int64)
    for part in tracks.parts():
        first, second = _matched(part, np.arange(part.num_observations), max_gap)
        pairs = part.frame[first], part.frame[second], np.ones_like(first)
        counts = sum_by_pair(np.concatenate([counts, np.stack(pairs, axis=1, dtype=np.int64)]))
    return counts


def sum_by_pair(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Add up (N, 3) ``[frame, frame, count]`` rows: (P, 3), the earlier frame first, rising."""
    frames = np.sort(counts[:, :2], axis=1)
    side = int(frames.max(initial=0)) + 1
    pairs, place = np.unique(frames @ np.array([side, 1]), return_inverse=True)
    total = np.zeros(len(pairs), np.int64)
    np.add.at(total, place, counts[:, 2])
    return np.stack([pairs // side, pairs % side, total], axis=1)


def sum_by_frame(counts: NDArray[np.int64], num_frames: int) -> NDArray[np.int64]:
    """Add up (P, 3) ``[frame0, frame1, count]`` rows: (F,) counts of each frame with all others."""
    total = np.zeros(num_frames, np.int64)
    for column in (0, 1):
        np.add.at(total, counts[:, column], counts[:, 2])
    return total


def compact(frame: NDArray[np.int32], num_frames: int) -> NDArray[np.integer[Any]]:
    """Return frames in the smallest type: NumPy sorts 16-bit integers in linear time."""
    return frame.astype(np.uint16) if num_frames <= 1 << 16 else frame


def _matched(
    tracks: Tracks, first: NDArray[np.int64], max_gap: int | None
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(M,) observations of the earlier and of the later frame, for every pair on a track.

    ``first``: (K,) observations that the earlier ones are taken from.
    """
    firsts: list[NDArray[np.int64]] = [np.empty(0, np.int64)]
    seconds: list[NDArray[np.int64]] = [np.empty(0, np.int64)]
    # Observations that have another one `step` places later in the same track.
    end = tracks.offsets[1:][tracks.track_index[first]]
    for step in range(1, tracks.num_observations):
        has_next = first + step < end
        if max_gap is not None:
            # Frames rise along a track: once too far apart, the next step is farther still.
            last = tracks.num_observations - 1
            near = tracks.frame[np.minimum(first + step, last)] - tracks.frame[first] <= max_gap
            has_next &= near
        first, end = first[has_next], end[has_next]
        if len(first) == 0:
            break
        firsts.append(first)
        seconds.append(first + step)
    return np.concatenate(firsts), np.concatenate(seconds)


def _parted(
    tracks: Tracks, first: NDArray[np.int64], second: NDArray[np.int64]
) -> Iterator[tuple[int, int, NDArray[np.uint32]]]:
    """Sort (M,) pairs of observations by their frames, and part them there."""
    # Two stable passes over small integers: far cheaper than sorting the pairs themselves.
    order = np.argsort(first, kind="stable")
    for frames in (tracks.frame[second], tracks.frame[first]):
        order = order[np.argsort(compact(frames[order], tracks.num_frames), kind="stable")]
    first, second = first[order], second[order]
    matches = np.stack([tracks.keypoint_index[first], tracks.keypoint_index[second]], axis=1)
    frame0, frame1 = tracks.frame[first], tracks.frame[second]
    starts = np.flatnonzero((np.diff(frame0) != 0) | (np.diff(frame1) != 0)) + 1
    bounds = [0, *starts.tolist(), len(first)] if len(first) else []
    for start, end in pairwise(bounds):
        yield int(frame0[start]), int(frame1[start]), matches[start:end]
