"""Measures of point matches: distance to the truth, spread over the picture, duplicates.

Nothing here knows where the truth comes from. All coordinates are px, COLMAP's origin.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pycolmap
    from numpy.typing import ArrayLike, NDArray

_STEP = 1e-4
"""Normalised units; step along the epipolar line that finds its direction in the picture."""


def epipolar_direction(
    xy0: ArrayLike, target: ArrayLike, camera: pycolmap.Camera, cam1_from_cam0: ArrayLike
) -> NDArray[np.float64]:
    """Direction of the epipolar curve in view 1 at the true targets of points of view 0.

    With lens distortion the epipolar line is a curve; this is its tangent.

    Parameters
    ----------
    xy0, target : (N, 2) float
        Points of view 0 in px and where they truly are in view 1.
    camera : pycolmap.Camera
        Of both views.
    cam1_from_cam0 : (3, 4) float
        True relative pose.

    Returns
    -------
    (N, 2) float64
        Unit vectors, either sign; NaN without a baseline and where a target is not finite.
    """
    pose = np.asarray(cam1_from_cam0, np.float64)
    a, b = _normalized(xy0, camera), _normalized(target, camera)
    rays = np.column_stack([a, np.ones(len(a))]) @ pose[:, :3].T
    lines = np.cross(pose[:, 3], rays)  # E x0 with E = [t]x R
    along = np.column_stack([lines[:, 1], -lines[:, 0]])
    with np.errstate(divide="ignore", invalid="ignore"):
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
        step = _pixels(b + _STEP * along, camera) - _pixels(b - _STEP * along, camera)
        return step / np.linalg.norm(step, axis=1, keepdims=True)


def split_error(error: ArrayLike, direction: ArrayLike) -> tuple[NDArray[np.float64], ...]:
    """Split error vectors into the parts along and across a direction.

    Parameters
    ----------
    error : (N, 2) float
        px.
    direction : (N, 2) float
        Unit vectors.

    Returns
    -------
    tuple of (N,) float64
        Absolute lengths along and across, px.
    """
    e, d = np.asarray(error, np.float64), np.asarray(direction, np.float64)
    along = np.abs(e[:, 0] * d[:, 0] + e[:, 1] * d[:, 1])
    return along, np.abs(e[:, 0] * d[:, 1] - e[:, 1] * d[:, 0])


def point_error(xy: ArrayLike, target: ArrayLike, visible: ArrayLike) -> NDArray[np.float64]:
    """Distance of points to their true targets; a target that is not to be seen is never met.

    Parameters
    ----------
    xy, target : (N, 2) float
        px.
    visible : (N,) bool
        Whether the target lies inside the picture and nothing hides it.

    Returns
    -------
    (N,) float64
        px; infinite where not visible.
    """
    distance = np.linalg.norm(np.asarray(xy, np.float64) - np.asarray(target, np.float64), axis=1)
    return np.where(np.asarray(visible, np.bool_), distance, np.inf)


def cell_coverage(xy: ArrayLike, size: tuple[int, int], *, cell: int = 8) -> float:
    """Share of a picture's square cells that hold a point.

    Parameters
    ----------
    xy : (N, 2) float
        px; points outside the picture do not count.
    size : tuple of int
        Width and height in px.
    cell : int
        Side of the cells in px; incomplete ones at the right and lower edge count as cells.
    """
    width, height = size
    columns, lines = -(-width // cell), -(-height // cell)
    at = np.floor(np.asarray(xy, np.float64).reshape(-1, 2) / cell).astype(np.int64)
    inside = ((at >= 0) & (at < (columns, lines))).all(axis=1)
    at = at[inside]
    return len(np.unique(at[:, 1] * columns + at[:, 0])) / (columns * lines)


def distinct_points(xy: ArrayLike, *, distance: float = 1.0) -> NDArray[np.bool_]:
    """Mark points that are further than ``distance`` from every marked point before them.

    Parameters
    ----------
    xy : (N, 2) float
        px, finite.
    distance : float
        px.

    Returns
    -------
    (N,) bool
        A largest such set in the order of the points: no further point could be marked.
    """
    points = np.asarray(xy, np.float64).reshape(-1, 2)
    first, second = _close_pairs(points, distance)
    marked = np.zeros(len(points), np.bool_)
    undecided = np.ones(len(points), np.bool_)
    while undecided.any():
        # A point without an undecided point before it nearby is safe, and decides its neighbours.
        blocked = np.zeros(len(points), np.bool_)
        blocked[second[undecided[first]]] = True
        safe = undecided & ~blocked
        marked |= safe
        undecided &= ~safe
        undecided[second[safe[first]]] = False
    return marked


def _close_pairs(
    points: NDArray[np.float64], distance: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Index pairs ``first < second`` of points at most ``distance`` apart."""
    at = np.floor(points / distance).astype(np.int64)
    at -= at.min(axis=0, initial=0) - 1
    columns = int(at[:, 0].max(initial=0)) + 2
    key = at[:, 1] * columns + at[:, 0]
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    firsts: list[NDArray[np.int64]] = []
    seconds: list[NDArray[np.int64]] = []
    for step in (dy * columns + dx for dy in (-1, 0, 1) for dx in (-1, 0, 1)):
        start = _positions(ordered, key + step)
        count = _positions(ordered, key + step + 1) - start
        first = np.repeat(np.arange(len(points)), count)
        place = np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count)
        second = order[np.repeat(start, count) + place]
        near = first < second
        gap = points[first[near]] - points[second[near]]
        near[near] = np.einsum("ni,ni->n", gap, gap) <= distance**2
        firsts.append(first[near])
        seconds.append(second[near])
    return np.concatenate(firsts), np.concatenate(seconds)


def _positions(ordered: NDArray[np.int64], keys: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.asarray(np.searchsorted(ordered, keys), np.int64)


def _normalized(xy: ArrayLike, camera: pycolmap.Camera) -> NDArray[np.float64]:
    points = np.asarray(xy, np.float64).reshape(-1, 2)
    finite = np.isfinite(points).all(axis=1)
    result = np.full(points.shape, np.nan)
    if finite.any():
        result[finite] = camera.cam_from_img(points[finite])
    return result


def _pixels(points: NDArray[np.float64], camera: pycolmap.Camera) -> NDArray[np.float64]:
    finite = np.isfinite(points).all(axis=1)
    result = np.full(points.shape, np.nan)
    if finite.any():
        ahead = np.column_stack([points[finite], np.ones(int(finite.sum()))])
        result[finite] = camera.img_from_cam(ahead)
    return result
