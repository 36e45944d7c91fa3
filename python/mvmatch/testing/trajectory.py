"""How far a reconstructed camera path is from the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


@dataclass(frozen=True, kw_only=True)
class TrajectoryError:
    """Absolute trajectory error (ATE) after the best similarity transform."""

    num_frames: int
    rmse: float
    """Root mean square distance of the camera centres, in units of the truth."""
    path_length: float
    """Length of the true path over the compared frames, in units of the truth."""

    @property
    def percent(self) -> float:
        """Error as a percentage of the path."""
        return 100.0 * self.rmse / self.path_length if self.path_length > 0 else float("nan")


def trajectory_error(estimated: ArrayLike, truth: ArrayLike) -> TrajectoryError:
    """Compare camera centres after aligning rotation, translation and scale.

    Parameters
    ----------
    estimated, truth : (F, 3) camera centres of the same frames, any units.

    Raises
    ------
    ValueError : different shapes, or fewer than three frames.

    References
    ----------
    Umeyama, "Least-squares estimation of transformation parameters between two point patterns",
    1991, equations 39 to 43.

    >>> truth = [[0, 0, 0], [1, 0, 0], [2, 1, 0], [3, 1, 1]]
    >>> round(trajectory_error([[5 + 2 * x, 2 * y, 2 * z] for x, y, z in truth], truth).rmse, 9)
    0.0
    """
    source, target = np.asarray(estimated, np.float64), np.asarray(truth, np.float64)
    if source.shape != target.shape or source.ndim != 2 or source.shape[1] != 3:
        raise ValueError(f"shapes {source.shape} and {target.shape}: both must be (F, 3)")
    if len(source) < 3:
        raise ValueError("a similarity transform needs at least three frames")
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    centred, wanted = source - source_mean, target - target_mean
    left, singular, right = np.linalg.svd(wanted.T @ centred)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right)) or 1.0])
    rotation = (left * sign) @ right
    spread = float((centred**2).sum())
    scale = float((singular * sign).sum()) / spread if spread > 0 else 0.0
    residual = wanted - scale * centred @ rotation.T
    return TrajectoryError(
        num_frames=len(source),
        rmse=float(np.sqrt((residual**2).sum(axis=1).mean())),
        path_length=float(np.linalg.norm(np.diff(target, axis=0), axis=1).sum()),
    )
