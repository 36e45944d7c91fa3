"""The points of a model against the true surface of a rendered sequence."""

# pycolmap carries incomplete types.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import bisect
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.bench.truth import RenderedTruth
from mvmatch.errors import DataError
from mvmatch.export.model import images_by_frame
from mvmatch.geometry.cloud import (
    CloudQuality,
    cloud_distance,
    cloud_quality,
    even_samples,
    share_within,
    surface_distance,
)
from mvmatch.geometry.trajectory import align_cameras

if TYPE_CHECKING:
    from collections.abc import Iterable

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.bench.datasets import Sequence

_CURVE = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)


@dataclass(frozen=True, kw_only=True)
class CloudOptions:
    """How a cloud is judged; lengths are shares of the median depth of what is seen."""

    thresholds: tuple[float, ...] = (0.002, 0.005, 0.01, 0.02, 0.05)
    """Of precision and recall."""
    spacing: float = 0.005
    """Side of the cubes with one sample of the surface each: half the middle threshold, as in the
    tool of Tanks and Temples."""
    views: int = 20
    """Most frames, evenly spread, from which the surface is sampled."""
    rays: int = 20_000
    """Per view, evenly over the picture at random."""
    min_views: int = 2
    """Views that must see a sample: what one picture shows has no depth."""
    seed: int = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class VisibleSurface:
    """What never moves, and even samples of what the pictures show of it; world, m."""

    triangles: NDArray[np.float64]
    """(T, 3, 3) all of it, seen or not."""
    samples: NDArray[np.float64]
    """(M, 3)"""
    median_depth: float


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedCloud:
    """Points in the frame of the truth with their distances, the best by their own account first.

    Points on moving objects count like all others: they have no place in a still world.
    """

    points: NDArray[np.float64]
    """(N, 3) m."""
    to_surface: NDArray[np.float64]
    """(N,) m."""
    surface: VisibleSurface
    options: CloudOptions

    def quality(self, num_points: int | None = None) -> CloudQuality:
        """Return the figures of the best points; of all without a number."""
        return cloud_quality(
            self.to_surface[:num_points],
            cloud_distance(self.surface.samples, self.points[:num_points]),
            thresholds=[t * self.surface.median_depth for t in self.options.thresholds],
            median_depth=self.surface.median_depth,
        )

    def recall(self, threshold: float, num_points: int | None = None) -> float:
        """Return the share of the surface within a threshold, m, of the best points."""
        near = cloud_distance(self.surface.samples, self.points[:num_points], at_most=threshold)
        return share_within(near, threshold)

    def curve(self, shares: Iterable[float] = _CURVE) -> tuple[CloudQuality, ...]:
        """Return the figures of the best shares of the points: what completeness costs."""
        return tuple(self.quality(round(share * len(self.points))) for share in shares)


def measure_cloud(
    reconstruction: pycolmap.Reconstruction,
    sequence: Sequence,
    *,
    options: CloudOptions | None = None,
) -> CloudQuality:
    """Compare the points of a model with the true surface.

    Parameters
    ----------
    reconstruction : pycolmap.Reconstruction
        Its images are named by frame numbers of the sequence.
    sequence : Sequence
        With a rendered truth.
    options : CloudOptions
        Thresholds and samples.

    Returns
    -------
    CloudQuality
        In m.

    Raises
    ------
    DataError
        As for :func:`judge_cloud` and :func:`visible_surface`.
    MissingExtraError
        The extra ``bench`` is not installed.
    """
    return judge_cloud(reconstruction, sequence, options=options).quality()


def judge_cloud(
    reconstruction: pycolmap.Reconstruction,
    sequence: Sequence,
    *,
    options: CloudOptions | None = None,
    surface: VisibleSurface | None = None,
) -> JudgedCloud:
    """Align a model with the truth and measure the distance of its points to the surface.

    Parameters
    ----------
    reconstruction, sequence, options
        As for :func:`measure_cloud`.
    surface : VisibleSurface, optional
        Of this sequence, if it is at hand: several models are judged with one.

    Raises
    ------
    DataError
        The sequence has no true surface, fewer than three images have a pose or stand still, or
        names carry no frame number of the sequence.
    """
    options = options or CloudOptions()
    surface = surface or visible_surface(sequence, options)
    images = images_by_frame(reconstruction)
    frames = np.array(list(images), np.int64)
    if len(frames) and frames.max() >= len(sequence):
        raise DataError(f"the model shows frame {frames.max()}, {sequence.name} has fewer")
    rotations = sequence.cam_from_world[frames, :, :3].transpose(0, 2, 1)
    true = np.concatenate([rotations, sequence.centers[frames][:, :, None]], axis=2)
    found = [image.cam_from_world().inverse().matrix() for image in images.values()]
    try:
        similarity = align_cameras(found, true, distance=surface.median_depth)
    except ValueError as error:
        raise DataError(f"the model cannot be laid over {sequence.name}: {error}") from error
    xyz, expected = points_by_quality(reconstruction)
    points = similarity.apply(xyz[np.argsort(expected, kind="stable")])
    return JudgedCloud(
        points=points,
        to_surface=surface_distance(points, surface.triangles),
        surface=surface,
        options=options,
    )


def visible_surface(sequence: Sequence, options: CloudOptions | None = None) -> VisibleSurface:
    """Sample what the pictures show of the still world, by rays through their pixels.

    Raises
    ------
    DataError
        The sequence has no rendered truth, or shows nothing that never moves.
    """
    options = options or CloudOptions()
    truth = sequence.truth
    if not isinstance(truth, RenderedTruth):
        raise DataError(f"{sequence.name} has no true surface: it needs a scene.npz")
    generator = np.random.default_rng(options.seed)
    last = len(sequence) - 1
    views = np.unique(np.linspace(0, last, min(options.views, last + 1)).round().astype(np.int64))
    found: list[NDArray[np.float64]] = []
    depths: list[NDArray[np.float64]] = []
    for view in views.tolist():
        xy = generator.uniform((0, 0), truth.size, (options.rays, 2))
        points, depth, still = truth.surface(view, xy)
        found.append(points[still])
        depths.append(depth[still])
    depth = np.concatenate(depths)
    if not len(depth):
        raise DataError(f"{sequence.name} shows nothing that never moves")
    median_depth = float(np.median(depth))
    samples = np.concatenate(found)
    samples = samples[even_samples(samples, options.spacing * median_depth)]
    num_views = sum(truth.sees(view, samples).astype(np.int64) for view in views.tolist())
    return VisibleSurface(
        triangles=truth.still_triangles(),
        samples=samples[num_views >= options.min_views],
        median_depth=median_depth,
    )


def at_equal_completeness(
    cloud: JudgedCloud, other: JudgedCloud, threshold: float | None = None
) -> tuple[CloudQuality, CloudQuality]:
    """Judge two clouds of one surface where they cover as much of it.

    The one that covers more gives up its worst points, by its own account
    (:func:`points_by_quality`), until the rest just covers as much as the other.

    Parameters
    ----------
    cloud, other : JudgedCloud
        With one surface.
    threshold : float, optional
        m; completeness is the recall at it. Without one it is the mean distance of the surface to
        the nearest point, which is the half of the Chamfer distance that it then leaves equal.

    Returns
    -------
    tuple of CloudQuality
        Of both in the order given; the one that covers less whole.
    """
    wanted = min(_cover(cloud, threshold), _cover(other, threshold))
    return _reaching(cloud, threshold, wanted), _reaching(other, threshold, wanted)


def _cover(cloud: JudgedCloud, threshold: float | None, num_points: int | None = None) -> float:
    """Return how much of the surface the best points cover, more being better."""
    if threshold is not None:
        return cloud.recall(threshold, num_points)
    return -float(cloud_distance(cloud.surface.samples, cloud.points[:num_points]).mean())


def _reaching(cloud: JudgedCloud, threshold: float | None, wanted: float) -> CloudQuality:
    """Judge the fewest best points that cover at least the wanted."""
    total = len(cloud.points)
    if _cover(cloud, threshold) <= wanted:
        return cloud.quality()
    # Cover never falls as points are added, so that bisection finds the first that reaches it.
    return cloud.quality(
        bisect.bisect_left(range(total), wanted, key=lambda size: _cover(cloud, threshold, size))
    )


def points_by_quality(
    reconstruction: pycolmap.Reconstruction,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points of a model and the error each is expected to have, from the model alone.

    The covariance of a point, its cameras taken as exact: rays from many and different directions
    make it small. The noise of an observation is the point's own reprojection error, drawn to that
    of the model as far as few observations say little. As a share of the distance, like thresholds
    of a cloud: what is far is not wrong for being far.

    Returns
    -------
    tuple
        Positions (N, 3) in units of the model, and expected errors (N,) as shares of the distance
        to the nearest camera that sees the point; infinite where all rays run alike.
    """
    numbers = np.array(sorted(reconstruction.points3D), np.int64)
    points = [reconstruction.points3D[number] for number in numbers.tolist()]
    xyz = np.array([point.xyz for point in points], np.float64).reshape(-1, 3)
    error = np.array([point.error for point in points], np.float64)
    information = np.zeros((len(numbers), 3, 3))
    num_rays = np.zeros(len(numbers), np.int64)
    nearest = np.full(len(numbers), np.inf)
    for number in reconstruction.reg_image_ids():
        image = reconstruction.image(number)
        seen = [point.point3D_id for point in image.points2D if point.has_point3D()]
        rows = np.searchsorted(numbers, np.unique(np.array(seen, np.int64)))
        ray = xyz[rows] - image.projection_center()
        squared = np.maximum((ray**2).sum(axis=1), np.finfo(np.float64).tiny)[:, None, None]
        across = np.eye(3) - ray[:, :, None] * ray[:, None, :] / squared
        focal = reconstruction.camera(image.camera_id).mean_focal_length()
        information[rows] += focal**2 * across / squared
        num_rays[rows] += 1
        nearest[rows] = np.minimum(nearest[rows], squared[:, 0, 0])
    freedom = np.maximum(2 * num_rays - 3, 1)
    usual = float(np.mean(error**2)) if len(error) else 0.0
    variance = (usual + freedom * error**2) / (1 + freedom)
    eigenvalues = np.maximum(np.linalg.eigvalsh(information), 0.0)
    with np.errstate(divide="ignore"):
        return xyz, np.sqrt(variance * (1 / eigenvalues).sum(axis=1) / nearest)
