"""Figures of a point cloud against a surface: by hand, by brute force, by SciPy."""

import numpy as np
import pytest

from mvmatch.geometry.cloud import (
    DistanceSummary,
    ThresholdScore,
    cloud_distance,
    cloud_quality,
    even_samples,
    surface_distance,
)

pytest.importorskip("igl")
distance = pytest.importorskip("scipy.spatial.distance")

SQUARE = np.array([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]])
"""Side 1, in the plane z = 0."""


def to_segment(point, start, end):
    along = np.clip(np.dot(point - start, end - start) / np.dot(end - start, end - start), 0, 1)
    return np.linalg.norm(point - start - along * (end - start))


def to_triangle(point, corners):
    """Distance to the plane where the foot of the point lies inside, else to the nearest edge."""
    a, b, c = corners
    normal = np.cross(b - a, c - a)
    weights = np.linalg.solve(np.column_stack([b - a, c - a, normal]), point - a)
    if weights[0] >= 0 and weights[1] >= 0 and weights[0] + weights[1] <= 1:
        return abs(weights[2]) * np.linalg.norm(normal)
    return min(to_segment(point, *edge) for edge in ((a, b), (b, c), (c, a)))


def test_distances_to_a_square_are_those_of_plane_edge_and_corner():
    points = [[0.3, 0.6, 2.0], [0.5, -3.0, 4.0], [1.0, 1.0, 0.0], [4.0, 5.0, 12.0]]
    np.testing.assert_allclose(surface_distance(points, SQUARE), [2, 5, 0, 13], atol=1e-12)


def test_distances_to_a_surface_are_the_smallest_over_all_triangles():
    generator = np.random.default_rng(3)
    triangles, points = generator.normal(size=(30, 3, 3)), generator.normal(size=(50, 3)) * 2
    expected = [min(to_triangle(point, corners) for corners in triangles) for point in points]
    np.testing.assert_allclose(surface_distance(points, triangles), expected, atol=1e-10)


def test_distances_to_a_cloud_are_the_smallest_over_all_points():
    generator = np.random.default_rng(4)
    samples, points = generator.normal(size=(40, 3)), generator.normal(size=(60, 3))
    expected = distance.cdist(samples, points).min(axis=1)
    np.testing.assert_allclose(cloud_distance(samples, points), expected, atol=1e-12)
    near = cloud_distance(samples, points, at_most=0.5)
    np.testing.assert_allclose(near[expected <= 0.5], expected[expected <= 0.5], atol=1e-12)
    assert (near[expected > 0.5] > 0.5).all()
    assert 0 < (expected <= 0.5).sum() < 40


def test_the_hausdorff_distance_is_that_of_scipy_and_chamfer_the_mean_of_both_means():
    generator = np.random.default_rng(5)
    a, b = generator.normal(size=(70, 3)), generator.normal(size=(50, 3)) + 0.5
    quality = cloud_quality(
        cloud_distance(a, b), cloud_distance(b, a), thresholds=[], median_depth=2.0
    )

    both = distance.directed_hausdorff(a, b)[0], distance.directed_hausdorff(b, a)[0]
    assert quality.hausdorff == pytest.approx(max(both))
    between = distance.cdist(a, b)
    mean = (between.min(axis=1).mean() + between.min(axis=0).mean()) / 2
    assert quality.chamfer == pytest.approx(mean)
    assert quality.share(quality.chamfer) == pytest.approx(mean / 2)
    assert quality.hausdorff_95 < quality.hausdorff


def test_a_cloud_taken_from_a_surface_has_no_error_and_lifted_by_d_one_of_d():
    at = (np.arange(10) + 0.5) / 10
    samples = np.array([[x, y, 0.0] for x in at for y in at])

    for lift in (0.0, 0.03):
        cloud = samples + np.array([0, 0, lift])
        quality = cloud_quality(
            surface_distance(cloud, SQUARE),
            cloud_distance(samples, cloud),
            thresholds=[0.02, 0.04],
            median_depth=1.0,
        )
        for summary in (quality.accuracy, quality.completeness):
            assert summary.mean == pytest.approx(lift, abs=1e-12)
            assert summary.maximum == pytest.approx(lift, abs=1e-12)
        assert [score.f_score for score in quality.scores] == [lift < 0.02, 1]


def test_half_a_cloud_is_as_exact_and_half_as_complete():
    samples = np.column_stack([np.arange(10.0), np.zeros(10), np.zeros(10)])
    half = cloud_distance(samples, samples[:5])
    score = cloud_quality(np.zeros(5), half, thresholds=[0.5], median_depth=1.0).scores[0]
    assert (score.precision, score.recall) == (1.0, 0.5)
    assert score.f_score == pytest.approx(2 / 3)


def test_f_is_the_harmonic_mean_and_zero_where_nothing_fits():
    assert ThresholdScore(threshold=1, precision=0.5, recall=0.25).f_score == pytest.approx(1 / 3)
    assert ThresholdScore(threshold=1, precision=0, recall=0).f_score == 0


def test_without_a_point_everything_is_missing():
    quality = cloud_quality(
        surface_distance(np.zeros((0, 3)), SQUARE),
        cloud_distance([[0.0, 0, 0]], np.zeros((0, 3))),
        thresholds=[1e9],
        median_depth=1.0,
    )
    assert np.isinf([quality.chamfer, quality.hausdorff, quality.hausdorff_95]).all()
    assert (quality.scores[0].precision, quality.scores[0].recall) == (0, 0)


def test_points_that_are_not_finite_are_infinitely_wrong_and_cover_nothing():
    cloud = np.array([[0.5, 0.5, 1.0], [np.nan, 0, 0], [np.inf, 0, 0]])
    assert surface_distance(cloud, SQUARE).tolist() == [1, np.inf, np.inf]
    assert cloud_distance([[0.5, 0.5, 0.0]], cloud).tolist() == [1]
    assert np.isinf(cloud_distance([[0.5, 0.5, 0.0]], cloud[1:])).all()


def test_one_infinite_distance_leaves_the_median_as_it_is():
    summary = DistanceSummary.of([1.0, 2.0, 3.0, np.inf])
    assert summary.median == 2
    assert np.isinf([summary.mean, summary.p90, summary.maximum]).all()


def test_of_each_cube_the_first_point_is_kept():
    points = [[0.1, 0.1, 0.1], [0.9, 0.9, 0.9], [1.1, 0.1, 0.1], [-0.1, 0.1, 0.1], [1.2, 0, 0]]
    assert even_samples(points, 1.0).tolist() == [0, 2, 3]
    assert even_samples(np.zeros((0, 3)), 1.0).tolist() == []
