"""Filters remove what they name and nothing else."""

from __future__ import annotations

import numpy as np

from mvmatch.filters import (
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
