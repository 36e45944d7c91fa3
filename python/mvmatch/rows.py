"""Rows of tracks, some at a time: what is held does not grow with the video."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvmatch.types import Tracks

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

BLOCK = 1 << 14
"""Rows that are looked at together."""


def falls(offsets: NDArray[np.int64]) -> bool:
    """Whether (N,) offsets fall anywhere."""
    return any(bool(np.any(np.diff(offsets[piece]) < 0)) for piece in _pieces(len(offsets)))


def rises_in_tracks(offsets: NDArray[np.int64], frame: NDArray[np.int32]) -> bool:
    """Whether (O,) frames strictly increase between the (T + 1,) offsets, which do not fall."""
    for piece in _pieces(len(frame)):
        rises = frame[piece][1:] > frame[piece][:-1]
        begun = np.searchsorted(offsets, (piece.start, piece.stop - 1), side="right")
        rises[offsets[slice(*begun)] - piece.start - 1] = True
        if not rises.all():
            return False
    return True


def _pieces(count: int) -> Iterator[slice]:
    """Yield pieces of so many rows, each with the first row of the next one."""
    for start in range(0, count - 1, BLOCK):
        yield slice(start, min(start + BLOCK + 1, count))


def block_frames(frame: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """(B,) smallest and largest frame of every :data:`BLOCK` observations."""
    starts = np.arange(0, len(frame), BLOCK)
    if len(starts) == 0:
        return frame, frame
    return np.minimum.reduceat(frame, starts), np.maximum.reduceat(frame, starts)


def during(tracks: Tracks, start: int, end: int) -> tuple[NDArray[np.int64], Tracks]:
    """Return (N,) tracks observed in frames ``start`` to ``end - 1``, and what is observed there.

    See :meth:`mvmatch.types.Tracks.during`.
    """
    first, last = tracks.block_frames
    found = [np.empty(0, np.int64)]
    for block in np.flatnonzero((first < end) & (last >= start)) * BLOCK:
        frame = tracks.frame[block : block + BLOCK]
        found.append(np.flatnonzero((frame >= start) & (frame < end)) + block)
    return observed(tracks, np.concatenate(found))


def observed(tracks: Tracks, rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], Tracks]:
    """Return the (N,) tracks of some observations, rising, and the tracks of those alone."""
    track = np.searchsorted(tracks.offsets, rows, side="right") - 1
    starts = np.flatnonzero(np.diff(track, prepend=-1))
    offsets = np.append(starts, len(rows)).astype(np.int64)
    return track[starts], Tracks(offsets=offsets, frame=tracks.frame[rows], xy=tracks.xy[rows])


def count_ties(
    tracks: Tracks, num_frames: int, *, reach: int, ends: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """(F - 1,) tracks that tie each frame to the next one: seen twice up to it and twice after it.

    All four observations lie within ``reach`` frames of the step between the two. One up to it
    is enough where nothing goes on into the first of these frames, or one after it out of the
    last: ``ends`` is a (F - 1,) mask of frames that nothing goes on from.
    """
    is_first = np.concatenate(([True], ends))
    is_last = np.concatenate((ends, [True]))
    change = np.zeros(num_frames + 1, np.int64)
    for part in tracks.parts():
        frame, track = part.frame.astype(np.int64), part.track_index
        goes_on = np.flatnonzero(track[1:] == track[:-1])
        last, first = frame[goes_on], frame[goes_on + 1]
        padded = np.concatenate(([-1], track, [-1]))
        has_before = padded[goes_on] == track[goes_on]
        has_after = padded[goes_on + 3] == track[goes_on]
        before = np.where(has_before, np.roll(frame, 1)[goes_on], last)
        after = np.where(has_after, np.roll(frame, -2)[goes_on], first)
        # The step from each frame k to the next with last <= k < first, before > k - reach and
        # after <= k + reach.
        start = np.maximum(last, after - reach)
        stop = np.minimum(first, before + reach)
        ties = (has_before | is_first[last]) & (has_after | is_last[first]) & (start < stop)
        change += np.bincount(start[ties], minlength=len(change))
        change -= np.bincount(stop[ties], minlength=len(change))
    return np.cumsum(change)[: num_frames - 1]


def selected(tracks: Tracks, keep: NDArray[np.bool_]) -> Iterator[Tracks]:
    """Yield the tracks where the (T,) mask holds, in parts."""
    first = 0
    for part in tracks.parts():
        kept = keep[first : first + len(part)]
        first += len(part)
        observed = np.repeat(kept, part.lengths)
        yield Tracks(
            offsets=np.concatenate(([0], np.cumsum(part.lengths[kept]))).astype(np.int64),
            frame=part.frame[observed],
            xy=part.xy[observed],
        )


def count_keypoints(tracks: Tracks, num_frames: int) -> NDArray[np.int64]:
    """(F,) keypoints of each frame; there are none in later frames."""
    count = np.zeros(num_frames, np.int64)
    for part in tracks.parts():
        count += np.bincount(part.frame, minlength=num_frames)
    return count


def count_entering(tracks: Tracks, num_frames: int) -> NDArray[np.int64]:
    """(F,) tracks seen both before each frame and in it or later; none is in later frames."""
    change = np.zeros(num_frames + 1, np.int64)
    for part in tracks.parts():
        first, last = part.frame[part.offsets[:-1]], part.frame[part.offsets[1:] - 1]
        change += np.bincount(first + 1, minlength=len(change))
        change -= np.bincount(last + 1, minlength=len(change))
    return np.cumsum(change)[:num_frames]
