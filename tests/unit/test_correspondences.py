"""Motion fields as correspondences."""

from __future__ import annotations

from mvmatch.correspondences import adjacency, from_motion
from mvmatch.testing.fields import field_from_rows


def test_a_block_center_is_paired_with_where_its_vector_leads():
    (pair,) = from_motion(field_from_rows(5, [([8, 8, 8, 16], (2.5, -1.125), 4)]))
    assert (pair.frame0, pair.frame1) == (5, 4)
    assert pair.xy0.tolist() == [[12.0, 16.0]]
    assert pair.xy1.tolist() == [[14.5, 14.875]]


def test_a_compound_block_gives_one_pair_per_reference_in_rising_order():
    block = [8, 8, 8, 8]
    pairs = from_motion(field_from_rows(5, [(block, (-1.0, 0.0), 6), (block, (1.0, 0.0), 4)]))
    assert [(pair.frame1, pair.xy1[0, 0]) for pair in pairs] == [(4, 13.0), (6, 11.0)]


def test_pairs_with_an_end_outside_the_picture_are_left_out():
    rows = [
        ([56, 0, 8, 8], (4.0, 0.0), 0),  # leads to x = 64, the first px outside
        ([64, 0, 8, 8], (-32.0, 0.0), 0),  # overhanging block, centre outside
        ([0, 0, 8, 8], (0.0, -4.0), 0),  # leads to y = 0, just inside
    ]
    (pair,) = from_motion(field_from_rows(1, rows))
    assert pair.xy1.tolist() == [[4.0, 0.0]]


def test_zero_vectors_count_unless_they_are_switched_off():
    field = field_from_rows(1, [([0, 0, 8, 8], (0.0, 0.0), 0)])
    assert len(from_motion(field)) == 1
    assert from_motion(field, keep_zero=False) == []


def test_adjacency_counts_both_directions_of_a_pair_together():
    forward = from_motion(field_from_rows(2, [([0, 0, 8, 8], (1.0, 0.0), 1)]))
    backward = from_motion(field_from_rows(1, [([0, 0, 8, 8], (1.0, 0.0), 2)]))
    assert adjacency([*forward, *backward]).tolist() == [[1, 2, 2]]
