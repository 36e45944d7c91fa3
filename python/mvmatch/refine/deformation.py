"""How the neighbourhood of points deforms between two frames, from the motion of other points."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvmatch.refine.patches import opencv

if TYPE_CHECKING:
    from numpy.typing import NDArray

_RADIUS = 48.0
"""px; neighbours farther away say nothing."""
_STIFFNESS = 8.0
"""px; distance of one neighbour that weighs as much as the assumption that nothing deforms."""
_OTHER_SURFACE, _OTHER_SLOPE = 1.0, 0.05
"""px and px per px of distance; neighbours that move more differently weigh less than half."""
_OUTLIER = 0.5
"""px; the same for what they leave unexplained."""
_ROUNDS = 2
_KDTREE = {"algorithm": 4, "leaf_max_size": 10}
"""FLANN_INDEX_KDTREE_SINGLE of OpenCV's FLANN: exact and repeatable."""


def local_deformation(
    xy0: NDArray[np.float64], xy1: NDArray[np.float64], num_neighbors: int
) -> NDArray[np.float64]:
    """Fit the affine motion around every point to that of its nearest neighbours.

    Weighted least squares: neighbours on another surface move differently and weigh little
    (Cauchy weights), and where there are few the identity is assumed.

    Parameters
    ----------
    xy0, xy1 : (N, 2) px, the points in two frames.
    num_neighbors : int
        Nearest others in the first frame.

    Returns
    -------
    ndarray
        (N, 2, 2) derivative of positions in the second frame by those in the first.
    """
    identity = np.eye(2)
    if len(xy0) <= num_neighbors:
        return np.tile(identity, (len(xy0), 1, 1))
    index = opencv().flann.Index(xy0.astype(np.float32), _KDTREE)
    nearest, _ = index.knnSearch(xy0.astype(np.float32), num_neighbors + 1, params={"checks": -1})
    # A point is its own nearest neighbour (or another one in the same place is).
    neighbors = nearest[:, 1:]
    motion = xy1 - xy0
    apart = xy0[neighbors] - xy0[:, None]
    differs = motion[neighbors] - motion[:, None]
    distance = np.linalg.norm(apart, axis=2)
    near = distance <= _RADIUS
    scale = _OTHER_SURFACE + _OTHER_SLOPE * distance
    weight = near / (1 + (np.linalg.norm(differs, axis=2) / scale) ** 2)
    slope = np.zeros((len(xy0), 2, 2))
    for _ in range(_ROUNDS):
        weighted = apart * weight[:, :, None]
        normal = weighted.transpose(0, 2, 1) @ apart + identity * _STIFFNESS**2
        slope = np.linalg.solve(normal, weighted.transpose(0, 2, 1) @ differs).transpose(0, 2, 1)
        rest = differs - apart @ slope.transpose(0, 2, 1)
        weight = near / (1 + (np.linalg.norm(rest, axis=2) / _OUTLIER) ** 2)
    return identity + slope
