import numpy as np

from mvmatch.cells import field_cells
from mvmatch.testing.fields import field_from_rows


def test_a_block_fills_the_cells_it_touches_and_the_rest_is_intra():
    cells = field_cells(field_from_rows(3, [([8, 8, 16, 8], (3.0, 4.0), 2)]))
    expected = np.zeros((4, 8))
    expected[1, 1:3] = 5.0
    np.testing.assert_array_equal(cells.speed, expected)
    np.testing.assert_array_equal(cells.past, expected > 0)
    np.testing.assert_array_equal(cells.covered, expected > 0)


def test_speed_is_per_frame_of_distance_to_the_reference():
    cells = field_cells(field_from_rows(4, [([0, 0, 8, 8], (6.0, 0.0), 1)]))
    assert cells.speed[0, 0] == 2.0
    assert cells.past[0, 0] == 3


def test_a_compound_block_reaches_both_ways_and_is_still_only_if_both_vectors_are_zero():
    rows = [([0, 0, 8, 8], (0.0, 0.0), 3), ([0, 0, 8, 8], (1.0, 0.0), 8)]
    cells = field_cells(field_from_rows(4, rows))
    assert (cells.past[0, 0], cells.future[0, 0]) == (1, 4)
    assert not cells.still[0, 0]


def test_blocks_may_overhang_the_picture():
    cells = field_cells(field_from_rows(1, [([56, 24, 16, 16], (1.0, 0.0), 0)]))
    assert cells.covered.sum() == 1


def test_a_key_frame_has_no_covered_cell():
    assert not field_cells(field_from_rows(0, [])).covered.any()
