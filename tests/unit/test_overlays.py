import numpy as np

from mvmatch.cells import field_cells
from mvmatch.overlays import OverlayFinder, OverlayOptions
from mvmatch.testing.fields import field_from_rows

BLOCKS = [[x, y, 8, 8] for y in range(0, 32, 8) for x in range(0, 64, 8)]
LOGO = [48, 8, 8, 8]


def found(pictures, **options):
    """Overlays of fields whose vectors are given per picture as a function of the block."""
    finder = OverlayFinder(OverlayOptions(**options))
    for frame, vector in enumerate(pictures):
        rows = [] if frame == 0 else [(b, vector(b), frame - 1) for b in BLOCKS if vector(b)]
        field = field_from_rows(frame, rows)
        finder.add(field, field_cells(field))
    return finder.overlays()


def logo(block):
    return (0.0, 0.0) if block == LOGO else (3.0, 1.0)


def everything(_):
    return (3.0, 1.0)


def test_what_stands_still_while_the_picture_moves_is_an_overlay():
    overlays = found([logo] * 20)
    expected = np.zeros((4, 8), bool)
    expected[1, 6] = True
    np.testing.assert_array_equal(overlays.at(7), expected)
    inside = overlays.contain([7, 7, 19], [[50.0, 9.0], [47.9, 9.0], [55.9, 15.9]])
    assert inside.tolist() == [True, False, True]
    assert overlays.area_share == 1 / 32


def test_a_static_camera_keeps_everything():
    overlays = found([lambda b: (4.0, 0.0) if b[0] < 16 else (0.0, 0.0)] * 20)
    assert overlays.area_share == 0.0


def test_slow_true_motion_is_no_overlay():
    far = [48, 8, 8, 8]
    overlays = found([lambda b: (0.125, 0.0) if b == far else (3.0, 1.0)] * 20)
    assert overlays.area_share == 0.0


def test_a_part_that_is_intra_coded_is_no_overlay():
    assert found([lambda b: None if b == LOGO else (3.0, 1.0)] * 20).area_share == 0.0


def test_a_far_point_that_stands_still_only_while_the_camera_does_not_turn_is_no_overlay():
    straight = [logo] * 10
    turning = [everything] * 10
    assert found(straight + turning).area_share == 0.0


def test_a_picture_that_hardly_moves_tells_nothing():
    slow = [lambda b: (0.0, 0.0) if b == LOGO else (0.5, 0.0)] * 20
    assert found(slow).area_share == 0.0


def test_a_few_frames_give_no_verdict():
    assert found([logo] * 7).area_share == 0.0


def test_an_overlay_may_come_and_go():
    overlays = found([logo] * 21 + [everything] * 20, window=20)
    assert overlays.at(5)[1, 6]
    assert not overlays.at(30)[1, 6]


def test_a_short_rest_joins_the_window_before():
    assert found([logo] * 26, window=20).at(25)[1, 6]


def test_overlays_can_be_switched_off():
    assert found([logo] * 20, min_still=None).area_share == 0.0


def test_without_fields_nothing_is_found():
    overlays = OverlayFinder().overlays()
    assert overlays.area_share == 0.0
    assert overlays.contain([], []).tolist() == []
