"""Errors of relative poses, and the area under their recall curve (AUC).

Poses are ``cam_from_world`` as COLMAP writes them: a world point x lies at ``R x + t`` in the
camera.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray


def relative_pose(cam0_from_world: ArrayLike, cam1_from_world: ArrayLike) -> NDArray[np.float64]:
    """Return ``cam1_from_cam0``.

    Parameters
    ----------
    cam0_from_world, cam1_from_world : (3, 4) float
        Rotation and translation.

    Returns
    -------
    (3, 4) float64
        In the unit of the given translations.
    """
    a, b = np.asarray(cam0_from_world, np.float64), np.asarray(cam1_from_world, np.float64)
    rotation = b[:, :3] @ a[:, :3].T
    return np.column_stack([rotation, b[:, 3] - rotation @ a[:, 3]])


def rotation_angle(rotation: ArrayLike) -> float:
    """Angle of a (3, 3) rotation in degrees, 0 to 180.

    Stable at both ends of the range, where the arc cosine of the trace alone loses half the digits.

    Examples
    --------
    >>> rotation_angle([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    90.0
    """
    R = np.asarray(rotation, np.float64)
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return float(np.degrees(np.arctan2(np.linalg.norm(axis), np.trace(R) - 1.0)))


def direction_angle(a: ArrayLike, b: ArrayLike) -> float:
    """Angle between two (3,) directions in degrees, 0 to 180; NaN if one has no length."""
    u, v = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if not (np.linalg.norm(u) > 0 and np.linalg.norm(v) > 0):
        return float("nan")
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v)))


def relative_pose_error(
    estimate: ArrayLike, truth: ArrayLike, *, min_baseline: float = 0.0
) -> tuple[float, float]:
    """Compare an estimated relative pose with the true one.

    The translation is compared as a direction, because one camera knows no scale, and with its
    sign: points in front of both cameras decide it. (The evaluation of SuperGlue forgives a
    reversed sign; forward motion must not.)

    Parameters
    ----------
    estimate, truth : (3, 4) float
        ``cam1_from_cam0``.
    min_baseline : float
        Unit of the truth; a true translation that is not longer has no direction to compare with.

    Returns
    -------
    tuple of float
        Rotation error and translation error in degrees; the latter is NaN without a baseline and
        180 for an estimate without translation where there is one.
    """
    a, b = np.asarray(estimate, np.float64), np.asarray(truth, np.float64)
    rotation = rotation_angle(a[:, :3] @ b[:, :3].T)
    if not np.linalg.norm(b[:, 3]) > min_baseline:
        return rotation, float("nan")
    direction = direction_angle(a[:, 3], b[:, 3])
    return rotation, 180.0 if np.isnan(direction) else direction


def pose_auc(errors: ArrayLike, thresholds: Sequence[float] = (5.0, 10.0, 20.0)) -> list[float]:
    """Area under the recall curve of pose errors up to each threshold, as a share.

    Recall rises linearly between the sorted errors, from (0, 0) on, and stays level from the last
    error below the threshold up to the threshold; the area is the trapezoid rule's.

    Parameters
    ----------
    errors : (N,) float
        Degrees, one per image pair: the larger of rotation and translation error; infinite where
        there was no estimate.
    thresholds : sequence of float
        Degrees.

    Returns
    -------
    list of float
        0 to 1, one per threshold; NaN for no errors at all.

    Raises
    ------
    ValueError
        An error is NaN or negative.

    References
    ----------
    Sarlin et al., "SuperGlue", CVPR 2020, section 5.2; hloc and glue-factory define it likewise.

    Examples
    --------
    >>> pose_auc([0.0, 5.0, 100.0], [10.0])  # up to 1/3 at 0, on to 2/3 at 5, level up to 10
    [0.5833333333333333]
    """
    found = np.sort(np.asarray(errors, np.float64))
    if len(found) == 0:
        return [float("nan")] * len(thresholds)
    if np.isnan(found).any() or found[0] < 0:
        raise ValueError("pose errors must be 0 or more; a failed estimate is infinite, not NaN")
    error = np.concatenate([[0.0], found])
    recall = np.arange(len(error)) / len(found)
    areas: list[float] = []
    for threshold in thresholds:
        last = int(np.searchsorted(error, threshold))
        x = np.concatenate([error[:last], [threshold]])
        y = np.concatenate([recall[:last], [recall[last - 1]]])
        areas.append(float(np.trapezoid(y, x)) / threshold)
    return areas
