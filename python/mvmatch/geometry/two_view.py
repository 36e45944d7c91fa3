"""Two-view geometry of one image pair: fit E and H, choose, score.

This is the door from pixels to normalised camera coordinates. Every method that mvmatch compares is
fitted here with the same settings (`RansacOptions`), whatever front end made its matches.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from mvmatch.geometry.sampson import homography_error, sampson_error
from mvmatch.types import TwoViewScore

if TYPE_CHECKING:
    import pycolmap
    from numpy.typing import ArrayLike, NDArray

MIN_POINTS = 8
"""Fewer correspondences than this say nothing: five-point fits five of them exactly."""


@dataclass(frozen=True, kw_only=True)
class RansacOptions:
    """LO-RANSAC settings, the same for every method."""

    max_error: float = 4.0
    """Inlier bound on the Sampson distance in px (the paper)."""
    min_inlier_ratio: float = 0.25
    """Lower bound for the number of trials (the paper)."""
    max_num_trials: int = 10_000
    """(the paper)"""
    min_num_trials: int = 30
    """COLMAP's two-view default is 100; 30 changes no inlier ratio by more than 0.001 here."""
    confidence: float = 0.999
    """COLMAP's two-view default."""
    min_num_inliers: int = 15
    """Below it the fit counts as failed (COLMAP's default)."""
    seed: int = 0
    """Seed of the samples; the fit is single threaded and so reproducible."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PairGeometry:
    """Fitted models of one pair; a failed fit has ``E is None`` and no inliers."""

    E: NDArray[np.float64] | None
    """(3, 3) essential matrix, ``x1' E x0 = 0`` in normalised coordinates."""
    H: NDArray[np.float64] | None
    """(3, 3) homography in px, ``x1 ~ H x0``."""
    inliers: NDArray[np.bool_]
    """(N,) correspondences that agree with the chosen model."""
    homography_ratio: float
    """Share of the inliers of E that H explains as well; near 1 without parallax."""
    cam1_from_cam0: pycolmap.Rigid3d | None
    """Relative pose, unit translation; None when the fit failed."""
    score: TwoViewScore


def fit_pair(
    xy0: ArrayLike,
    xy1: ArrayLike,
    camera0: pycolmap.Camera,
    camera1: pycolmap.Camera,
    *,
    frames: tuple[int, int] = (0, 1),
    options: RansacOptions | None = None,
    max_sample: int | None = None,
) -> PairGeometry:
    """Fit an essential matrix and a homography to one image pair and score the better one.

    Parameters
    ----------
    xy0, xy1 : (N, 2) float
        Corresponding points in px, origin at the upper-left image corner.
    camera0, camera1 : pycolmap.Camera
        Cameras of the two views.
    frames : tuple of int
        Frame numbers for the score.
    options : RansacOptions
        Settings of LO-RANSAC.
    max_sample : int, optional
        Estimate on at most this many correspondences (drawn with the seed), then test all of them.
        None estimates on all.

    Returns
    -------
    PairGeometry
        With zero inliers when no model fits; that is a result, not an error.

    Raises
    ------
    ValueError
        The points are not two (N, 2) arrays.
    """
    options = options or RansacOptions()
    a, b = np.asarray(xy0, np.float64), np.asarray(xy1, np.float64)
    if a.ndim != 2 or a.shape[1] != 2 or a.shape != b.shape:
        raise ValueError(f"points must both be (N, 2), got {a.shape} and {b.shape}")
    if len(a) < max(MIN_POINTS, options.min_num_inliers):
        return _failed(len(a), frames)
    return _fit((a, b), (camera0, camera1), frames, options, max_sample)


def _fit(
    points: tuple[NDArray[np.float64], NDArray[np.float64]],
    cameras: tuple[pycolmap.Camera, pycolmap.Camera],
    frames: tuple[int, int],
    options: RansacOptions,
    max_sample: int | None,
) -> PairGeometry:
    import pycolmap

    size = len(points[0])
    chosen = _sample(size, max_sample, options.seed, frames)
    sample0, sample1 = points[0][chosen], points[1][chosen]
    ransac = colmap_ransac(options)
    essential = pycolmap.estimate_essential_matrix(sample0, sample1, *cameras, ransac)
    planar = pycolmap.estimate_homography_matrix(sample0, sample1, ransac)
    E = None if essential is None else np.asarray(essential["E"], np.float64)
    H = None if planar is None else np.asarray(planar["H"], np.float64)

    focal = 0.5 * (cameras[0].mean_focal_length() + cameras[1].mean_focal_length())
    squared_e = focal**2 * _essential_error(points, cameras, E)
    squared_h = np.full(size, np.inf) if H is None else homography_error(*points, H)
    inliers_e = squared_e <= options.max_error**2
    inliers_h = squared_h <= options.max_error**2
    model = _choose(inliers_e, inliers_h, squared_e, squared_h)
    inliers, squared = (inliers_e, squared_e) if model == "E" else (inliers_h, squared_h)
    num_inliers = int(inliers.sum())
    if num_inliers < options.min_num_inliers:
        return _failed(size, frames)
    median_squared = float(np.median(squared[inliers]))
    score = TwoViewScore(
        frame0=frames[0],
        frame1=frames[1],
        model=model,
        num_correspondences=size,
        num_inliers=num_inliers,
        inlier_ratio=num_inliers / size,
        median_sampson_px=math.sqrt(median_squared),
        median_sampson_normalized=median_squared / focal**2,
    )
    return PairGeometry(
        E=E,
        H=H,
        inliers=inliers,
        homography_ratio=float(inliers_h.sum()) / max(1, int(inliers_e.sum())),
        cam1_from_cam0=None if essential is None else essential["cam2_from_cam1"],
        score=score,
    )


def _essential_error(
    points: tuple[NDArray[np.float64], NDArray[np.float64]],
    cameras: tuple[pycolmap.Camera, pycolmap.Camera],
    E: NDArray[np.float64] | None,
) -> NDArray[np.float64]:
    """Return the squared normalised Sampson error, infinite where it is not defined."""
    if E is None:
        return np.full(len(points[0]), np.inf)
    normalized0 = np.asarray(cameras[0].cam_from_img(points[0]), np.float64)
    normalized1 = np.asarray(cameras[1].cam_from_img(points[1]), np.float64)
    return np.nan_to_num(sampson_error(normalized0, normalized1, E), nan=np.inf)


def _choose(
    inliers_e: NDArray[np.bool_],
    inliers_h: NDArray[np.bool_],
    squared_e: NDArray[np.float64],
    squared_h: NDArray[np.float64],
) -> Literal["E", "H"]:
    """Take the larger inlier set; of equal ones that with the lower median residual."""
    num_e, num_h = int(inliers_e.sum()), int(inliers_h.sum())
    if num_e != num_h or num_e == 0:
        return "E" if num_e >= num_h else "H"
    return "E" if np.median(squared_e[inliers_e]) <= np.median(squared_h[inliers_h]) else "H"


def _sample(
    size: int, max_sample: int | None, seed: int, frames: tuple[int, int]
) -> slice | NDArray[np.int64]:
    if max_sample is None or size <= max_sample:
        return slice(None)
    generator = np.random.default_rng([seed, frames[0] & 0xFFFFFFFF, frames[1] & 0xFFFFFFFF])
    return np.sort(generator.permutation(size)[:max_sample])


def colmap_ransac(options: RansacOptions) -> pycolmap.RANSACOptions:
    """Return the settings as COLMAP takes them: single threaded and seeded."""
    import pycolmap

    ransac = pycolmap.RANSACOptions()
    ransac.max_error = options.max_error
    ransac.min_inlier_ratio = options.min_inlier_ratio
    ransac.max_num_trials = options.max_num_trials
    ransac.min_num_trials = options.min_num_trials
    ransac.confidence = options.confidence
    ransac.random_seed = options.seed
    ransac.num_threads = 1
    return ransac


def _failed(size: int, frames: tuple[int, int]) -> PairGeometry:
    score = TwoViewScore(
        frame0=frames[0],
        frame1=frames[1],
        model=None,
        num_correspondences=size,
        num_inliers=0,
        inlier_ratio=0.0,
        median_sampson_px=math.nan,
        median_sampson_normalized=math.nan,
    )
    return PairGeometry(
        E=None,
        H=None,
        inliers=np.zeros(size, bool),
        homography_ratio=0.0,
        cam1_from_cam0=None,
        score=score,
    )
