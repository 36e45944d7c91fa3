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
