"""Quality of a point cloud against a true surface: accuracy, completeness, and what joins both.

Accuracy is the distance of each point to the surface, completeness the distance of each sample of
the surface to the nearest point. At a threshold their shares are precision and recall, and F is the
harmonic mean of these.

References
----------
Schöps et al., "A multi-view stereo benchmark with high-resolution images and multi-camera videos"
(ETH3D), CVPR 2017: accuracy, completeness and F1 at a tolerance, evenly over space.
Knapitsch et al., "Tanks and Temples: benchmarking large-scale scene reconstruction", ACM ToG 2017:
precision, recall and F-score at a threshold, on samples made even by a grid of cubes. Both thin
the cloud as well; here each of its points counts.
"""

# libigl and SciPy carry incomplete types.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportMissingImports=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.errors import MissingExtraError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, kw_only=True)
class DistanceSummary:
    """Many distances in a few figures; all infinite where there is none.

    Percentiles are distances that occur: the smallest that so many percent do not exceed.
    """

    mean: float
    median: float
    p90: float
    p95: float
    maximum: float

    @classmethod
    def of(cls, distances: ArrayLike) -> DistanceSummary:
        """Summarise (N,) distances."""
        values = np.asarray(distances, np.float64)
        if not len(values):
            values = np.array([np.inf])
        # Without interpolation: between a finite and an infinite distance there is nothing.
        median, p90, p95 = np.percentile(values, [50, 90, 95], method="inverted_cdf")
        return cls(
            mean=float(values.mean()),
            median=float(median),
            p90=float(p90),
            p95=float(p95),
            maximum=float(values.max()),
        )


@dataclass(frozen=True, kw_only=True)
class ThresholdScore:
    """How much of a cloud and of a surface lie within a distance of each other."""

    threshold: float
    """Units of the surface, usually m."""
    precision: float
    """Share of the points that are at most so far from the surface (ETH3D: accuracy)."""
    recall: float
    """Share of the samples that have a point so near (ETH3D: completeness)."""

    @property
    def f_score(self) -> float:
        """Harmonic mean of precision and recall (ETH3D: F1)."""
        total = self.precision + self.recall
        return 2 * self.precision * self.recall / total if total > 0 else 0.0


@dataclass(frozen=True, kw_only=True)
class CloudQuality:
    """A point cloud against a surface; distances in units of the surface, usually m."""

    num_points: int
    num_samples: int
    """Of the surface."""
    median_depth: float
    """Of the surface as the cameras see it: the scale that distances are compared with."""
    accuracy: DistanceSummary
    """From the points to the surface."""
    completeness: DistanceSummary
    """From samples of the surface to the nearest point."""
    scores: tuple[ThresholdScore, ...]

    @property
    def chamfer(self) -> float:
        """Mean of the mean distances of both directions."""
        return (self.accuracy.mean + self.completeness.mean) / 2

    @property
    def hausdorff(self) -> float:
        """Largest distance of both directions."""
        return max(self.accuracy.maximum, self.completeness.maximum)

    @property
    def hausdorff_95(self) -> float:
        """The larger 95th percentile of both directions: without the last outliers."""
        return max(self.accuracy.p95, self.completeness.p95)

    def share(self, distance: float) -> float:
        """Return a distance as a share of the median depth."""
        return distance / self.median_depth


def cloud_quality(
    to_surface: ArrayLike,
    to_cloud: ArrayLike,
    *,
    thresholds: Sequence[float],
    median_depth: float,
) -> CloudQuality:
    """Make figures of the distances of both directions.

    Parameters
    ----------
    to_surface : (N,) float
        Of each point to the surface (:func:`surface_distance`).
    to_cloud : (M,) float
        Of each sample of the surface to the nearest point (:func:`cloud_distance`).
    thresholds : sequence of float
        Of precision and recall, units of the distances.
    median_depth : float
        Same unit.
    """
    points = np.asarray(to_surface, np.float64)
    samples = np.asarray(to_cloud, np.float64)
    return CloudQuality(
        num_points=len(points),
        num_samples=len(samples),
        median_depth=median_depth,
        accuracy=DistanceSummary.of(points),
        completeness=DistanceSummary.of(samples),
        scores=tuple(
            ThresholdScore(
                threshold=threshold,
                precision=share_within(points, threshold),
                recall=share_within(samples, threshold),
            )
            for threshold in thresholds
        ),
    )


def share_within(distances: ArrayLike, threshold: float) -> float:
    """Return the share of (N,) distances that are at most a threshold; 0 where there is none."""
    values = np.asarray(distances, np.float64)
    return float((values <= threshold).mean()) if len(values) else 0.0


def surface_distance(points: ArrayLike, triangles: ArrayLike) -> NDArray[np.float64]:
    """Distance of points to the nearest place of a surface, exact up to rounding.

    Parameters
    ----------
    points : (N, 3) float
    triangles : (T, 3, 3) float
        Corners, same frame and unit; T >= 1.

    Returns
    -------
    (N,) float64
        Infinite for points that are not finite.

    Raises
    ------
    MissingExtraError
        libigl is not installed.
    """
    try:
        from igl import AABB
    except ImportError as error:
        raise MissingExtraError(
            "distances to a surface need libigl: pip install 'mvmatch[bench]'"
        ) from error
    xyz = np.asarray(points, np.float64).reshape(-1, 3)
    corners = np.ascontiguousarray(triangles, np.float64).reshape(-1, 3)
    faces = np.arange(len(corners), dtype=np.int64).reshape(-1, 3)
    finite = np.isfinite(xyz).all(axis=1)
    distance = np.full(len(xyz), np.inf)
    if finite.any():
        tree = AABB()
        tree.init(corners, faces)
        squared = tree.squared_distance(corners, faces, np.ascontiguousarray(xyz[finite]))[0]
        distance[finite] = np.sqrt(np.atleast_1d(squared))
    return distance


def cloud_distance(
    samples: ArrayLike, points: ArrayLike, *, at_most: float = np.inf
) -> NDArray[np.float64]:
    """Distance of samples of a surface to the nearest point of a cloud.

    Parameters
    ----------
    samples : (M, 3) float
    points : (N, 3) float
        Same frame and unit; those that are not finite do not count.
    at_most : float
        What is further need not be found, which is quicker.

    Returns
    -------
    (M,) float64
        Infinite without a point; the distance or infinite where it is more than ``at_most``.

    Raises
    ------
    MissingExtraError
        SciPy is not installed.
    """
    try:
        from scipy.spatial import KDTree
    except ImportError as error:
        raise MissingExtraError(
            "distances to a point cloud need SciPy: pip install 'mvmatch[bench]'"
        ) from error
    wanted = np.asarray(samples, np.float64).reshape(-1, 3)
    xyz = np.asarray(points, np.float64).reshape(-1, 3)
    xyz = xyz[np.isfinite(xyz).all(axis=1)]
    if not len(xyz):
        return np.full(len(wanted), np.inf)
    # SciPy looks for less than its bound, not for as much.
    found = KDTree(xyz).query(wanted, distance_upper_bound=1.001 * at_most)[0]
    return np.asarray(found, np.float64)


def even_samples(points: ArrayLike, side: float) -> NDArray[np.int64]:
    """Choose the first point in each cube of a grid, so that dense places count no more.

    Parameters
    ----------
    points : (N, 3) float
        Finite.
    side : float
        Of the cubes, unit of the points.

    Returns
    -------
    (M,) int64
        Indices, ascending.
    """
    xyz = np.asarray(points, np.float64).reshape(-1, 3)
    cubes = np.floor(xyz / side).astype(np.int64)
    _, first = np.unique(cubes, axis=0, return_index=True)
    return np.sort(first)
