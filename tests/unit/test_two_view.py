import numpy as np
import pytest

from mvmatch.geometry.two_view import RansacOptions, fit_pair

pycolmap = pytest.importorskip("pycolmap")

FOCAL = 500.0


def camera():
    return pycolmap.Camera(model="PINHOLE", width=640, height=480, params=[FOCAL, FOCAL, 320, 240])


def two_views(translation, *, depth=(4.0, 12.0), angle=0.02, count=400, seed=1):
    """Points seen by a camera at the origin and by one turned about y and moved; px."""
    generator = np.random.default_rng(seed)
    xy0 = generator.uniform([20, 20], [620, 460], (count, 2))
    z = generator.uniform(*depth, count)
    points = np.c_[(xy0 - [320, 240]) / FOCAL * z[:, None], z]
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    seen = points @ rotation.T + translation
    return xy0, seen[:, :2] / seen[:, 2:] * FOCAL + [320, 240], rotation


def test_exact_points_of_a_moving_camera_all_agree_with_an_essential_matrix():
    xy0, xy1, rotation = two_views([0.5, 0.0, 0.1])

    fit = fit_pair(xy0, xy1, camera(), camera(), frames=(3, 7))
    assert (fit.score.frame0, fit.score.frame1, fit.score.model) == (3, 7, "E")
    assert fit.score.inlier_ratio == 1.0
    assert fit.score.median_sampson_px < 1e-3
    np.testing.assert_allclose(fit.cam1_from_cam0.rotation.matrix(), rotation, atol=1e-5)


def test_outliers_are_found_even_when_only_a_sample_is_used_for_the_fit():
    xy0, xy1, _ = two_views([0.5, 0.0, 0.1], count=1000)
    wrong = np.arange(1000) % 5 == 0
    xy1[wrong, 1] += 40

    fit = fit_pair(xy0, xy1, camera(), camera(), max_sample=200)
    np.testing.assert_array_equal(fit.inliers, ~wrong)
    assert fit.score.num_correspondences == 1000


def test_a_turning_camera_is_explained_by_a_homography_alone():
    xy0, xy1, _ = two_views([0.0, 0.0, 0.0], angle=0.1)

    fit = fit_pair(xy0, xy1, camera(), camera())
    assert fit.homography_ratio > 0.99


def test_pixel_and_normalised_errors_differ_by_the_focal_length():
    xy0, xy1, _ = two_views([0.5, 0.0, 0.1])
    xy1 = xy1 + np.random.default_rng(0).normal(scale=0.5, size=xy1.shape)

    score = fit_pair(xy0, xy1, camera(), camera()).score
    assert score.median_sampson_px == pytest.approx(
        FOCAL * np.sqrt(score.median_sampson_normalized)
    )
    assert 0.1 < score.median_sampson_px < 0.5


def test_the_same_seed_gives_the_same_fit():
    xy0, xy1, _ = two_views([0.2, 0.0, 0.4])
    xy1 = xy1 + np.random.default_rng(0).normal(scale=1.0, size=xy1.shape)

    first, second = (
        fit_pair(xy0, xy1, camera(), camera(), options=RansacOptions(seed=5), max_sample=100)
        for _ in range(2)
    )
    np.testing.assert_array_equal(first.E, second.E)


def test_random_points_and_too_few_points_fail_without_an_exception():
    generator = np.random.default_rng(2)
    nothing = fit_pair(np.zeros((0, 2)), np.zeros((0, 2)), camera(), camera())
    few = fit_pair(*generator.uniform(0, 400, (2, 9, 2)), camera(), camera())
    same = fit_pair(np.ones((30, 2)), np.ones((30, 2)), camera(), camera())

    for fit in (nothing, few):
        assert fit.score.model is None
        assert fit.score.num_inliers == 0
        assert np.isnan(fit.score.median_sampson_px)
    assert 0 <= same.score.inlier_ratio <= 1


def test_points_of_different_number_are_refused():
    with pytest.raises(ValueError, match="points"):
        fit_pair(np.zeros((4, 2)), np.zeros((5, 2)), camera(), camera())
