"""Filters remove what they name and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from mvmatch.filters import (
    budget,
    cosine_consistency,
    drop_uncertain,
    drop_zero,
    fuse_neighbors,
    min_length,
    thin,
)
from mvmatch.testing.fields import field_from_rows
from mvmatch.types import Tracks


def test_cosine_filter_keeps_a_straight_track_and_cuts_a_reversal():
    straight = [(0, 2.0, 2.0), (1, 6.0, 2.0), (2, 10.0, 2.0)]  # (frame, x, y) in px
    reversal = [(0, 2.0, 9.0), (1, 6.0, 9.0), (2, 2.0, 9.0)]

    kept = cosine_consistency(Tracks.from_lists(straight, reversal), epsilon=0.1, min_length=3)
    assert len(kept) == 1
    np.testing.assert_array_equal(kept.xy[:, 0], [2.0, 6.0, 10.0])


def test_cosine_filter_keeps_what_lies_after_the_turn():
    turning = [(0, 9.0, 9.0), (1, 9.0, 0.0), (2, 5.0, 0.0), (3, 1.0, 0.0)]
    kept = cosine_consistency(Tracks.from_lists(turning), epsilon=0.1, min_length=3)
    assert kept.frame.tolist() == [1, 2, 3]


def test_cosine_filter_leaves_short_steps_and_standing_points_alone():
    trembling = [(0, 2.0, 2.0), (1, 2.5, 2.0), (2, 2.0, 2.0)]
    standing = [(0, 5.0, 2.0), (1, 5.0, 2.0), (2, 7.0, 2.0)]
    tracks = Tracks.from_lists(trembling, standing)
    assert len(cosine_consistency(tracks, tau=1.0)) == 2
    assert len(cosine_consistency(tracks)) == 1


def test_dropping_zeros_keeps_the_columns_together():
    field = field_from_rows(1, [([0, 0, 8, 8], (0.0, 0.0), 0), ([8, 0, 8, 8], (0.0, 1.0), 0)])
    kept = drop_zero(field)
    assert (kept.block.tolist(), kept.warp.shape) == ([[8, 0, 8, 8]], (1, 6))


def test_a_vector_without_enough_neighbours_is_left_alone_and_not_trusted():
    lonely = field_from_rows(1, [([0, 0, 8, 8], (1.0, 0.0), 0), ([8, 0, 8, 8], (2.0, 0.0), 0)])
    np.testing.assert_array_equal(fuse_neighbors(lonely).mv, lonely.mv)
    assert len(drop_uncertain(lonely)) == 0


def test_a_wrong_vector_is_drawn_to_its_neighbours_and_dropped():
    blocks = [[8 * column, 8 * line, 8, 8] for line in range(4) for column in range(8)]
    rows = [(block, (2.0, 1.0), 0) for block in blocks]
    rows[12] = (blocks[12], (6.0, 1.0), 0)
    field = field_from_rows(1, rows)
    np.testing.assert_allclose(fuse_neighbors(field).mv[12], [4.0, 1.0], atol=0.01)
    kept = drop_uncertain(field)
    assert len(kept) >= 24
    assert blocks[12] not in kept.block.tolist()


def test_short_tracks_are_removed_by_number_of_observations():
    tracks = Tracks.from_lists([(0, 1.0, 1.0), (9, 1.0, 1.0)], [(0, 2.0, 2.0)])
    assert min_length(tracks, 2).frame.tolist() == [0, 9]


def test_thinning_keeps_the_longest_track_of_a_cell():
    short = [(0, 1.0, 1.0), (1, 1.0, 1.0)]
    long = [(0, 3.0, 3.0), (1, 9.0, 3.0), (2, 9.0, 9.0)]
    elsewhere = [(0, 30.0, 3.0), (1, 30.0, 3.0)]
    kept = thin(Tracks.from_lists(short, long, elsewhere), cell=8)
    assert kept.lengths.tolist() == [3, 2]
    assert kept.xy[0].tolist() == [3.0, 3.0]


def random_tracks(count: int, *, seed: int = 0) -> Tracks:
    """Tracks of 3 to 12 of 20 frames in a picture of 640x320 px, most of them on its left."""
    generator = np.random.default_rng(seed)
    lists: list[list[tuple[int, float, float]]] = []
    for _ in range(count):
        start, length = generator.integers(0, 9), generator.integers(3, 13)
        x, y = 320 * generator.random() ** 3, 320 * generator.random()
        x += 320 * (generator.random() < 0.1)
        lists.append([(int(start + k), x, y) for k in range(length)])
    return Tracks.from_lists(*lists)


@pytest.mark.parametrize("max_keypoints", [1, 37, 200])
def test_a_budget_is_never_exceeded_in_any_frame_and_is_used(max_keypoints):
    tracks = random_tracks(3000)
    counts = np.bincount(budget(tracks, max_keypoints=max_keypoints, size=(640, 320)).frame)
    assert counts.max() <= max_keypoints
    assert counts.max() == max_keypoints


def test_a_budget_that_is_large_enough_removes_nothing():
    tracks = random_tracks(300)
    most = int(np.bincount(tracks.frame).max())
    assert len(budget(tracks, max_keypoints=most, size=(640, 320))) == len(tracks)


def test_a_budget_leaves_points_in_every_patch_that_had_some():
    tracks = random_tracks(3000)
    kept = budget(tracks, max_keypoints=150, size=(640, 320))
    patches = [
        {tuple(p) for p in np.floor(t.keypoints(10) / 64).astype(int).tolist()}
        for t in (tracks, kept)
    ]
    assert len(patches[1]) >= 0.9 * len(patches[0])
    share = [np.mean(t.keypoints(10)[:, 0] > 320) for t in (tracks, kept)]
    assert share[1] > 2 * share[0]


def test_a_budget_keeps_the_longest_track_of_a_patch():
    short = [(f, 10.0, 10.0) for f in range(3)]
    long = [(f, 12.0, 12.0) for f in range(9)]
    kept = budget(Tracks.from_lists(short, long), max_keypoints=1, size=(64, 64))
    assert kept.lengths.tolist() == [9]


def test_a_budget_takes_what_fits_one_after_the_other():
    tracks = random_tracks(400, seed=3)
    kept = budget(tracks, max_keypoints=40, size=(640, 320))
    room = 40 - np.bincount(kept.frame, minlength=tracks.num_frames)
    chosen = {tuple(xy) for xy in kept.xy.tolist()}
    for track in range(len(tracks)):
        rows = slice(tracks.offsets[track], tracks.offsets[track + 1])
        taken = tuple(tracks.xy[rows][0].tolist()) in chosen
        assert taken or room[tracks.frame[rows]].min() == 0, "it would have fitted"
