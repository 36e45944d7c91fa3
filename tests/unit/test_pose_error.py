from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mvmatch.geometry.pose_error import (
    direction_angle,
    pose_auc,
    relative_pose,
    relative_pose_error,
    rotation_angle,
)


def turn(degrees: float, axis: int = 2) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.roll(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), (axis + 1, axis + 1), (0, 1))


def pose(rotation: np.ndarray, translation: list[float]) -> np.ndarray:
    return np.column_stack([rotation, translation])


@pytest.mark.parametrize("degrees", [0.0, 1e-7, 0.5, 90.0, 179.999999])
def test_the_angle_of_a_rotation_is_exact_at_both_ends_of_its_range(degrees):
    assert rotation_angle(turn(degrees, axis=1)) == pytest.approx(degrees, rel=1e-7, abs=1e-12)


def test_a_point_moves_through_the_relative_pose_as_through_the_world():
    first, second = pose(turn(20), [1, 2, 3]), pose(turn(-50, axis=0), [0, -1, 4])
    between = relative_pose(first, second)

    world = np.array([0.3, -0.2, 5.0])
    in_first = first[:, :3] @ world + first[:, 3]
    expected = second[:, :3] @ world + second[:, 3]
    np.testing.assert_allclose(between[:, :3] @ in_first + between[:, 3], expected)


def test_the_length_of_a_translation_does_not_count_but_its_sign_does():
    truth = pose(np.eye(3), [0, 0, 2])

    assert relative_pose_error(pose(turn(3), [0, 0, 0.5]), truth) == pytest.approx((3, 0))
    assert relative_pose_error(pose(np.eye(3), [0, 0, -1]), truth) == pytest.approx((0, 180))
    assert relative_pose_error(pose(np.eye(3), [0, 0, 0]), truth) == pytest.approx((0, 180))


def test_a_camera_that_stays_has_no_direction_to_be_wrong_about():
    still = pose(np.eye(3), [0, 0, 1e-9])
    rotation, translation = relative_pose_error(pose(turn(1), [1, 0, 0]), still, min_baseline=1e-6)

    assert rotation == pytest.approx(1)
    assert np.isnan(translation)
    assert np.isnan(direction_angle([0, 0, 0], [1, 0, 0]))


def reference_auc(errors: list[float], threshold: float) -> float:
    """Integrate the polyline piece by piece, in exact arithmetic."""
    area, count = Fraction(0), len(errors)
    x, y = Fraction(0), Fraction(0)
    for rank, error in enumerate(sorted(errors), start=1):
        if error >= threshold:
            break
        next_x, next_y = Fraction(error), Fraction(rank, count)
        area += (next_x - x) * (y + next_y) / 2
        x, y = next_x, next_y
    area += (Fraction(threshold) - x) * y
    return float(area / Fraction(threshold))


@given(
    errors=st.lists(st.floats(0, 40) | st.just(float("inf")), min_size=1, max_size=30),
    threshold=st.sampled_from([5.0, 10.0, 20.0]),
)
def test_the_area_is_that_of_the_polyline_through_the_sorted_errors(errors, threshold):
    (found,) = pose_auc(errors, [threshold])
    assert found == pytest.approx(reference_auc(errors, threshold), abs=1e-12)


def test_perfect_poses_have_the_whole_area_and_failed_ones_none():
    assert pose_auc([0.0, 0.0]) == [1.0, 1.0, 1.0]
    assert pose_auc([np.inf, np.inf]) == [0.0, 0.0, 0.0]
    assert np.isnan(pose_auc([])).all()


def test_a_failed_estimate_must_not_be_hidden_in_a_nan():
    with pytest.raises(ValueError, match="infinite, not NaN"):
        pose_auc([1.0, np.nan])
