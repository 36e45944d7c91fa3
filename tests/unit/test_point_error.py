import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mvmatch.geometry.point_error import (
    cell_coverage,
    distinct_points,
    epipolar_direction,
    point_error,
    split_error,
)

pycolmap = pytest.importorskip("pycolmap")

SIDEWAYS = np.column_stack([np.eye(3), [1.0, 0.0, 0.0]])
FORWARD = np.column_stack([np.eye(3), [0.0, 0.0, -1.0]])


def camera(model: str = "PINHOLE", params: tuple[float, ...] = (100, 100, 50, 50)):
    return pycolmap.Camera(model=model, width=100, height=100, params=params)


def test_a_point_with_a_hidden_target_is_wrong_however_near_it_is():
    error = point_error([[3, 4], [0, 0]], [[0, 0], [0, 0]], [True, False])
    assert error.tolist() == [5.0, np.inf]


def test_a_camera_that_moves_sideways_has_horizontal_epipolar_lines():
    direction = epipolar_direction([[30, 40], [70, 20]], [[35, 40], [71, 20]], camera(), SIDEWAYS)
    along, across = split_error([[3, 4], [-2, 0]], direction)

    np.testing.assert_allclose(along, [3, 2])
    np.testing.assert_allclose(across, [4, 0], atol=1e-9)


def test_a_camera_that_moves_forward_has_epipolar_lines_through_the_centre():
    direction = epipolar_direction([[60, 70]], [[65, 80]], camera(), FORWARD)
    along, across = split_error([[1, 2]], direction)

    assert along == pytest.approx(np.sqrt(5))
    assert across == pytest.approx(0, abs=1e-9)


def test_under_distortion_the_direction_is_the_tangent_of_the_epipolar_curve():
    bent = camera("SIMPLE_RADIAL", (100, 50, 50, -0.2))
    ray = np.array([0.2, 0.3, 1.0])  # a point of view 0 at several depths traces the curve
    xy0 = bent.img_from_cam(ray[None])
    near, at, far = (
        bent.img_from_cam((ray * depth + SIDEWAYS[:, 3])[None])[0] for depth in (3.99, 4.0, 4.01)
    )
    found = epipolar_direction(xy0, at[None], bent, SIDEWAYS)[0]
    expected = (far - near) / np.linalg.norm(far - near)

    assert abs(found @ expected) == pytest.approx(1, abs=1e-9)
    assert abs(found[1]) > 0.01  # not the straight line of a pinhole camera


def test_without_a_baseline_there_is_no_epipolar_line():
    still = np.column_stack([np.eye(3), np.zeros(3)])
    assert np.isnan(epipolar_direction([[1, 2]], [[1, 2]], camera(), still)).all()


def test_coverage_counts_cells_once_and_nothing_outside():
    xy = [[0, 0], [7.9, 7.9], [8, 0], [-1, 3], [16, 3]]
    assert cell_coverage(xy, (16, 16)) == 2 / 4
    assert cell_coverage(np.empty((0, 2)), (16, 16)) == 0
    assert cell_coverage([[17, 1]], (18, 8)) == 1 / 3


def greedy(points: np.ndarray, distance: float) -> list[bool]:
    chosen: list[np.ndarray] = []
    marks: list[bool] = []
    for point in points:
        far = all(((point - other) ** 2).sum() > distance**2 for other in chosen)
        marks.append(far)
        if far:
            chosen.append(point)
    return marks


@given(arrays(np.float64, st.tuples(st.integers(0, 60), st.just(2)), elements=st.integers(-8, 8)))
def test_distinct_points_are_those_a_plain_loop_keeps(quarters):
    points = quarters / 4
    assert distinct_points(points, distance=1.0).tolist() == greedy(points, 1.0)


def test_copies_of_a_point_count_once():
    assert distinct_points([[5, 5]] * 191 + [[5, 6.01]]).sum() == 2
