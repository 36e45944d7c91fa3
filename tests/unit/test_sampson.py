import numpy as np
import pytest

from mvmatch.geometry.sampson import homography_error, sampson_error

SIDEWAYS = np.array([[0, 0, 0], [0, 0, -1], [0, 1, 0]])


def test_points_that_keep_their_row_have_no_error_under_sideways_motion():
    error = sampson_error([[0.1, 0.2], [0.5, -0.3]], [[0.4, 0.2], [0.1, -0.3]], SIDEWAYS)

    np.testing.assert_array_equal(error, [0, 0])


def test_the_error_does_not_depend_on_the_scale_of_the_matrix():
    points0, points1 = [[0.1, 0.2]], [[0.4, 0.25]]

    a, b = (sampson_error(points0, points1, scale * SIDEWAYS) for scale in (1.0, -7.0))
    np.testing.assert_allclose(a, b)


def test_a_vertical_error_is_shared_by_both_views():
    (error,) = sampson_error([[0.0, 0.0]], [[0.5, 0.2]], SIDEWAYS)

    assert error == pytest.approx(0.2**2 / 2)


def test_the_error_agrees_with_colmap():
    pycolmap = pytest.importorskip("pycolmap")
    generator = np.random.default_rng(3)
    points0, points1 = generator.normal(size=(2, 50, 2))
    E = generator.normal(size=(3, 3))

    expected = pycolmap.compute_squared_sampson_error(points0, points1, E)
    np.testing.assert_allclose(sampson_error(points0, points1, E), expected, rtol=1e-9)


def test_a_point_at_both_epipoles_has_no_error_to_speak_of():
    forward = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0]])

    assert np.isnan(sampson_error([[0, 0]], [[0, 0]], forward)).all()


def test_a_homography_that_maps_a_point_to_infinity_has_infinite_error():
    H = [[1, 0, 0], [0, 1, 0], [1, 0, 0]]

    assert np.isinf(homography_error([[0, 1]], [[5, 5]], H)).all()


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"\(N, 2\)"):
        sampson_error([[0, 0, 1]], [[0, 0, 1]], SIDEWAYS)
    with pytest.raises(ValueError, match=r"\(3, 3\)"):
        sampson_error([[0, 0]], [[0, 0]], SIDEWAYS[:2])
