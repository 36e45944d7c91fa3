"""First-order (Sampson) distance of correspondences to an epipolar geometry or a homography."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


def sampson_error(points0: ArrayLike, points1: ArrayLike, E: ArrayLike) -> NDArray[np.float64]:
    """Squared Sampson error of correspondences under an essential matrix.

    First-order approximation of the squared distance to the nearest pair with ``x1' E x0 = 0``.

    Parameters
    ----------
    points0, points1 : (N, 2) float
        Normalised camera coordinates ``K^-1 x``, dimensionless. Pixels with a fundamental matrix
        in place of E give squared pixels.
    E : (3, 3) float
        Maps view-0 points to view-1 epipolar lines; any scale.

    Returns
    -------
    (N,) float64
        Dimensionless. For pixels: square root times focal length. NaN at both epipoles.

    Raises
    ------
    ValueError
        Shapes differ from the above.

    References
    ----------
    Zouein et al., section II-C; Hartley and Zisserman, 2nd ed., section 11.4.3.

    Examples
    --------
    >>> E = [[0, 0, 0], [0, 0, -1], [0, 1, 0]]  # camera moves along x: points keep their row
    >>> sampson_error([[0.1, 0.2]] * 2, [[0.3, 0.20], [0.3, 0.22]], E).round(6)
    array([0.    , 0.0002])
    """
    x0, x1 = _homogeneous_pair(points0, points1)
    matrix = _matrix(E)
    lines1 = x0 @ matrix.T
    lines0 = x1 @ matrix
    residual = np.einsum("ni,ni->n", x1, lines1)
    gradient = lines1[:, 0] ** 2 + lines1[:, 1] ** 2 + lines0[:, 0] ** 2 + lines0[:, 1] ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        return residual**2 / gradient


def homography_error(points0: ArrayLike, points1: ArrayLike, H: ArrayLike) -> NDArray[np.float64]:
    """Squared forward transfer error ``|x1 - H(x0)|^2`` of correspondences under a homography.

    Parameters
    ----------
    points0, points1 : (N, 2) float
        Any one unit, usually px.
    H : (3, 3) float
        Maps view-0 points to view-1 points; any scale.

    Returns
    -------
    (N,) float64
        Square of the unit of the points; infinite for points that H sends to infinity.

    Raises
    ------
    ValueError
        Shapes differ from the above.

    Examples
    --------
    >>> homography_error([[1, 2]], [[4, 6]], [[1, 0, 0], [0, 1, 0], [0, 0, 1]])
    array([25.])
    """
    x0, x1 = _homogeneous_pair(points0, points1)
    mapped = x0 @ _matrix(H).T
    with np.errstate(divide="ignore", invalid="ignore"):
        difference = mapped[:, :2] / mapped[:, 2:] - x1[:, :2]
    squared = np.einsum("ni,ni->n", difference, difference)
    return np.where(np.isnan(squared), np.inf, squared)


def _homogeneous_pair(
    points0: ArrayLike, points1: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    a, b = np.asarray(points0, np.float64), np.asarray(points1, np.float64)
    if a.ndim != 2 or a.shape[1] != 2 or a.shape != b.shape:
        raise ValueError(f"points must both be (N, 2), got {a.shape} and {b.shape}")
    one = np.ones((len(a), 1))
    return np.hstack([a, one]), np.hstack([b, one])


def _matrix(matrix: ArrayLike) -> NDArray[np.float64]:
    result = np.asarray(matrix, np.float64)
    if result.shape != (3, 3):
        raise ValueError(f"matrix must be (3, 3), got {result.shape}")
    return result
