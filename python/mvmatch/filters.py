"""Filters: pure functions on motion fields and tracks.

Each takes a motion field or tracks and returns the same type. :func:`mvmatch.tracks.build_tracks`
applies the same rules while it chains; these are for use on their own.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.confidence import expected_error
from mvmatch.types import MotionField, Tracks

if TYPE_CHECKING:
    from numpy.typing import NDArray


PATCH = 64
"""px; side of the squares over which :func:`budget` spreads the tracks."""


def drop_zero(field: MotionField) -> MotionField:
    """Remove zero vectors (the paper's rule; a zero vector of an inter block is real motion)."""
    return field.select(np.any(field.mv != 0, axis=1))


def fuse_neighbors(field: MotionField, *, num_neighbors: int = 12) -> MotionField:
    """Replace every vector by the mean of itself and what the blocks around it say at its centre.

    A local affine motion is fitted robustly to the nearest blocks with the same reference, the
    block itself left out, and corrected by what the fits of these blocks miss in common, since
    motion is curved. Vectors with fewer than 4 neighbours stay.

    Parameters
    ----------
    field : MotionField
        Vectors of one coded frame.
    num_neighbors : int
        Blocks that take part, 1 to 32.

    Returns
    -------
    MotionField
        With other vectors, no longer multiples of 1/8 px.
    """
    from mvmatch._core import fit_neighbors

    predicted = fit_neighbors(field, num_neighbors=num_neighbors)[2]
    return replace(field, mv=((field.mv + predicted) / 2).astype(np.float32))


def drop_uncertain(
    field: MotionField, *, max_error: float = 0.2, num_neighbors: int = 12
) -> MotionField:
    """Remove vectors whose expected error, fused with their neighbours, is above ``max_error`` px.

    See :func:`mvmatch.confidence.expected_error`.
    """
    return field.select(expected_error(field, num_neighbors=num_neighbors) <= max_error)


def min_length(tracks: Tracks, length: int) -> Tracks:
    """Remove tracks with fewer than ``length`` observations."""
    return tracks.select(tracks.lengths >= length)


def cosine_consistency(
    tracks: Tracks, *, epsilon: float = 0.1, tau: float = 0.0, min_length: int = 3
) -> Tracks:
    """End tracks where their direction turns.

    Walking from the last frame back, a track ends before the first step whose cosine to the step
    before it is less than ``1 - epsilon``; the observations further back are removed.

    Parameters
    ----------
    tracks : Tracks
        Any tracks.
    epsilon : float
        Tolerance of the cosine.
    tau : float
        px; steps shorter than this are not tested.
    min_length : int
        Observations; what is left shorter is removed.

    Returns
    -------
    Tracks
        A subset of the observations.

    References
    ----------
    Zouein et al. 2025, section II-B.
    """
    xy = tracks.xy.astype(np.float64)
    step = np.diff(xy, axis=0, append=xy[-1:])
    size = np.linalg.norm(step, axis=1)
    # Observation k turns when step k and the later step k + 1 (both inside one track) disagree.
    turns = np.zeros(len(xy), np.bool_)
    if len(xy) > 2:
        inside = tracks.track_index[:-2] == tracks.track_index[2:]
        dot = np.sum(step[:-2] * step[1:-1], axis=1)
        product = size[:-2] * size[1:-1]
        shortest = np.minimum(size[:-2], size[1:-1])
        tested = inside & (shortest >= tau) & (shortest > 0)
        turns[:-2] = tested & (dot < (1 - epsilon) * product)
    keep = _from_last(tracks, turns)
    return _select_observations(tracks, keep, min_length)


def thin(tracks: Tracks, *, cell: int = 8) -> Tracks:
    """Keep at most one track per frame and square cell of ``cell`` px: the longest.

    Longer tracks choose first, earlier numbers on a tie; a track with any observation in a cell
    that is taken is removed as a whole.
    """
    columns = int(np.floor(tracks.xy[:, 0].max(initial=0) / cell)) + 1
    lines = int(np.floor(tracks.xy[:, 1].max(initial=0) / cell)) + 1
    at = np.floor(tracks.xy / cell).astype(np.int64)
    keys = (tracks.frame.astype(np.int64) * lines + at[:, 1]) * columns + at[:, 0]
    taken: set[int] = set()
    keep = np.zeros(len(tracks), np.bool_)
    for track in np.argsort(-tracks.lengths, kind="stable").tolist():
        own = keys[tracks.offsets[track] : tracks.offsets[track + 1]].tolist()
        if taken.isdisjoint(own):
            taken.update(own)
            keep[track] = True
    return tracks.select(keep)


def budget(tracks: Tracks, *, max_keypoints: int, size: tuple[int, int]) -> Tracks:
    """Keep at most ``max_keypoints`` observations per frame, spread over the picture.

    Tracks are kept or removed as a whole. The picture is divided into squares of :data:`PATCH` px.
    Tracks are ranked in each patch they pass, the longest first; those with the best mean rank are
    kept first, so every patch gives its best track before any gives its second, and what empty
    patches do not need goes to the others. Length times the way travelled was measured, and
    leads to trajectories that are no better.

    Parameters
    ----------
    tracks : Tracks
        Any tracks.
    max_keypoints : int
        Observations per frame, at least 1; no frame has more.
    size : (int, int)
        Width and height of the picture, px.

    Returns
    -------
    Tracks
        A subset of the tracks, in their order.
    """
    return tracks.select(within_budget(tracks, max_keypoints=max_keypoints, size=size))


def within_budget(
    tracks: Tracks, *, max_keypoints: int, size: tuple[int, int]
) -> NDArray[np.bool_]:
    """(T,) tracks that :func:`budget` keeps."""
    columns, lines = (-(-side // PATCH) for side in size)
    column, line = np.floor_divide(tracks.xy, PATCH).astype(np.int64).T
    patch = np.clip(line, 0, lines - 1) * columns + np.clip(column, 0, columns - 1)
    frame = tracks.frame.astype(np.int64)
    rank = _ranks(frame * (columns * lines) + patch, -tracks.lengths[tracks.track_index])
    rank = np.bincount(tracks.track_index, rank, minlength=len(tracks)) / tracks.lengths
    return _first_that_fit(tracks, rank, max_keypoints)


def _first_that_fit(
    tracks: Tracks, rank: NDArray[np.float64], max_keypoints: int
) -> NDArray[np.bool_]:
    """(T,) what is kept when tracks come in the order of rank and each needs room in its frames.

    The same as one after the other, but in a few rounds over all: a track is kept once it would fit
    even if all before it did.
    """
    keep = np.zeros(len(tracks), np.bool_)
    room = np.full(tracks.num_frames, max_keypoints, np.int64)
    place = np.empty(len(tracks), np.int64)
    place[np.argsort(rank, kind="stable")] = np.arange(len(tracks))
    rows = np.arange(tracks.num_observations)
    while len(rows):
        frame, track = tracks.frame[rows], tracks.track_index[rows]
        late = np.bincount(track, _ranks(frame, place[track]) >= room[frame], len(tracks)) > 0
        fits = ~late[track]
        keep[track[fits]] = True
        room -= np.bincount(frame[fits], minlength=len(room))
        blocked = np.bincount(track, room[frame] == 0, len(tracks)) > 0
        rows = rows[~fits & ~blocked[track]]
    return keep


def _ranks(group: NDArray[np.integer[Any]], key: NDArray[Any]) -> NDArray[np.int64]:
    """(N,) position of each entry in its group, by rising key; earlier entries first on a tie."""
    order = np.lexsort((key, group))
    ordered = group[order]
    starts = np.flatnonzero(np.diff(ordered, prepend=-1))
    ranks = np.empty(len(order), np.int64)
    lengths = np.diff(starts, append=len(order))
    ranks[order] = np.arange(len(order)) - np.repeat(starts, lengths)
    return ranks


def _from_last(tracks: Tracks, stop: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(O,) observations after the last ``stop`` of their track."""
    order = np.where(stop, np.arange(len(stop)), -1)
    last = np.full(len(tracks), -1, np.int64)
    np.maximum.at(last, tracks.track_index, order)
    return np.arange(len(stop)) > last[tracks.track_index]


def _select_observations(tracks: Tracks, keep: NDArray[np.bool_], length: int) -> Tracks:
    counts = np.bincount(tracks.track_index[keep], minlength=len(tracks))
    kept = Tracks(
        offsets=np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
        frame=tracks.frame[keep],
        xy=tracks.xy[keep],
    )
    return min_length(kept, max(length, 1))
