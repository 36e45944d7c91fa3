"""Trajectories: alignment by a similarity and the absolute trajectory error (ATE)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Similarity:
    """``target = scale * rotation @ source + translation``."""

    scale: float
    rotation: NDArray[np.float64]
    """(3, 3), determinant +1."""
    translation: NDArray[np.float64]
    """(3,) in units of the target."""

    def apply(self, points: ArrayLike) -> NDArray[np.float64]:
        """Map (N, 3) points of the source frame into the target frame."""
        return self.scale * np.asarray(points, np.float64) @ self.rotation.T + self.translation


@dataclass(frozen=True, kw_only=True)
class TrajectoryError:
    """Absolute trajectory error after Sim(3) alignment."""

    rmse: float
    """Root mean square distance of camera centres, in units of the reference (usually m)."""
    median: float
    maximum: float
    path_length: float
    """Length of the reference path through the compared frames."""
    percent_of_path: float
    """``100 * rmse / path_length``; infinite for a reference that does not move."""
    num_frames: int


def align_similarity(source: ArrayLike, target: ArrayLike) -> Similarity:
    """Least-squares similarity from one set of points to another.

    Parameters
    ----------
    source, target : (N, 3) float
        Corresponding points, N >= 3 and not all equal.

    Returns
    -------
    Similarity
        Maps source to target.

    Raises
    ------
    ValueError
        Shapes differ, fewer than three points, or all source points coincide.

    References
    ----------
    Umeyama, "Least-squares estimation of transformation parameters between two point patterns",
    PAMI 1991.
    """
    a, b = np.asarray(source, np.float64), np.asarray(target, np.float64)
    if a.ndim != 2 or a.shape[1] != 3 or a.shape != b.shape or len(a) < 3:
        raise ValueError(f"need two (N, 3) arrays with N >= 3, got {a.shape} and {b.shape}")
    mean_a, mean_b = a.mean(axis=0), b.mean(axis=0)
    centred_a, centred_b = a - mean_a, b - mean_b
    variance = float((centred_a**2).sum()) / len(a)
    if variance == 0.0:
        raise ValueError("all source points coincide: a similarity is not defined")
    left, singular, right = np.linalg.svd(centred_b.T @ centred_a / len(a))
    signs = np.ones(3)
    signs[2] = np.sign(np.linalg.det(left) * np.linalg.det(right))
    rotation = left @ np.diag(signs) @ right
    scale = float((singular * signs).sum()) / variance
    return Similarity(
        scale=scale, rotation=rotation, translation=mean_b - scale * rotation @ mean_a
    )


def align_cameras(
    world_from_cam: ArrayLike, reference: ArrayLike, *, distance: float
) -> Similarity:
    """Similarity from one set of cameras to another by their centres and by where they look.

    Centres on a straight line leave open how the scene is turned about it. So each camera counts
    with its centre and the points at a distance along its three axes.

    Parameters
    ----------
    world_from_cam, reference : (N, 3, 4) float
        Rotation and camera centre of the same frames in the same order; N >= 3.
    distance : float
        Along the axes, in units of the reference: how far the scene typically is.

    Returns
    -------
    Similarity
        Maps the first to the second; its scale is that of the centres alone.

    Raises
    ------
    ValueError
        As for :func:`align_similarity`.
    """
    found, true = np.asarray(world_from_cam, np.float64), np.asarray(reference, np.float64)
    if found.ndim != 3 or found.shape[1:] != (3, 4) or found.shape != true.shape:
        raise ValueError(f"need two (N, 3, 4) arrays, got {found.shape} and {true.shape}")
    scale = align_similarity(found[:, :, 3], true[:, :, 3]).scale
    if not scale > 0:
        raise ValueError("all target points coincide: a scale is not defined")
    turned = align_similarity(
        _points_of_cameras(found, distance / scale), _points_of_cameras(true, distance)
    )
    offset = true[:, :, 3] - scale * found[:, :, 3] @ turned.rotation.T
    return Similarity(scale=scale, rotation=turned.rotation, translation=offset.mean(axis=0))


def _points_of_cameras(cameras: NDArray[np.float64], distance: float) -> NDArray[np.float64]:
    """(4 N, 3) centres, and points at a distance along the axes of (N, 3, 4) cameras."""
    centers = cameras[:, :, 3]
    along = centers[:, None] + distance * cameras[:, :, :3].transpose(0, 2, 1)
    return np.concatenate([centers, along.reshape(-1, 3)])


def trajectory_error(centers: ArrayLike, reference: ArrayLike) -> TrajectoryError:
    """Absolute trajectory error of camera centres after the best similarity.

    Parameters
    ----------
    centers, reference : (N, 3) float
        Camera centres of the same frames in the same order; N >= 3.

    Returns
    -------
    TrajectoryError
        In units of the reference.

    Raises
    ------
    ValueError
        As for :func:`align_similarity`.
    """
    target = np.asarray(reference, np.float64)
    aligned = align_similarity(centers, target).apply(centers)
    distance = np.linalg.norm(aligned - target, axis=1)
    path_length = float(np.linalg.norm(np.diff(target, axis=0), axis=1).sum())
    rmse = float(np.sqrt((distance**2).mean()))
    return TrajectoryError(
        rmse=rmse,
        median=float(np.median(distance)),
        maximum=float(distance.max()),
        path_length=path_length,
        percent_of_path=100.0 * rmse / path_length if path_length > 0 else np.inf,
        num_frames=len(target),
    )


@dataclass(frozen=True, kw_only=True)
class RelativeTrajectoryError:
    """Relative pose error (RPE) over a fixed number of frames, after Sim(3) alignment."""

    translation_rmse: float
    """Units of the reference."""
    rotation_rmse: float
    """Degrees."""
    delta: int
    """Frames between the two poses of each pair."""
    num_pairs: int


def relative_trajectory_error(
    world_from_cam: ArrayLike, reference: ArrayLike, *, delta: int = 1
) -> RelativeTrajectoryError:
    """Compare the motion over ``delta`` frames of two trajectories: drift without its history.

    Parameters
    ----------
    world_from_cam, reference : (N, 3, 4) float
        Rotation and camera centre of the same frames in the same order; N >= 3. The first is
        aligned to the second by the best similarity of the centres.
    delta : int
        Frames between the poses of a pair; every pair counts, overlapping ones too.

    Returns
    -------
    RelativeTrajectoryError

    Raises
    ------
    ValueError
        As for :func:`align_similarity`, or no two frames are ``delta`` apart.

    References
    ----------
    Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012, section IV-B.
    """
    from mvmatch.geometry.pose_error import rotation_angle

    found, true = np.asarray(world_from_cam, np.float64), np.asarray(reference, np.float64)
    if found.ndim != 3 or found.shape[1:] != (3, 4) or found.shape != true.shape:
        raise ValueError(f"need two (N, 3, 4) arrays, got {found.shape} and {true.shape}")
    if not 0 < delta < len(true):
        raise ValueError(f"no two of {len(true)} frames are {delta} apart")
    similarity = align_similarity(found[:, :, 3], true[:, :, 3])
    rotations = similarity.rotation @ found[:, :, :3]
    moved = _steps(rotations, similarity.apply(found[:, :, 3]), delta)
    wanted = _steps(true[:, :, :3], true[:, :, 3], delta)
    # (Q_i^-1 Q_j)^-1 (P_i^-1 P_j): its translation is that difference, rotated.
    distance = np.linalg.norm(moved[1] - wanted[1], axis=1)
    pairs = zip(wanted[0], moved[0], strict=True)
    angle = np.array([rotation_angle(a.T @ b) for a, b in pairs])
    return RelativeTrajectoryError(
        translation_rmse=float(np.sqrt((distance**2).mean())),
        rotation_rmse=float(np.sqrt((angle**2).mean())),
        delta=delta,
        num_pairs=len(distance),
    )


def _steps(
    rotations: NDArray[np.float64], centers: NDArray[np.float64], delta: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation and translation of ``cam_i_from_cam_j``, ``j = i + delta``."""
    back = rotations[:-delta].transpose(0, 2, 1)
    steps = centers[delta:] - centers[:-delta]
    return back @ rotations[delta:], np.einsum("nij,nj->ni", back, steps)
