"""How far off a motion vector is expected to be, and how likely it is right.

A vector is fused with what the blocks around it say (:func:`mvmatch.filters.fuse_neighbors`), and
the same blocks tell how far to trust the result: vectors that agree with a smooth surrounding and
left no residual are right. One small model says how far; ``tools/fit_error_model.py`` fitted it to
rendered sequences with exact truth.
"""

from __future__ import annotations

import functools
import tomllib
from dataclasses import dataclass
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from mvmatch.types import MotionField

EVIDENCE = ("one", "residual", "spread", "residual_spread", "energy", "slope")
"""What the logarithm of the error is a linear function of; see :class:`ErrorModel`."""

MODEL_FILE = "error_model.toml"
"""In the package."""


@dataclass(frozen=True, kw_only=True)
class ErrorModel:
    """Distribution of the error of a fused vector: log-logistic, its median set by the evidence."""

    weights: tuple[float, ...]
    """Of 1; a = ln(residual + 0.1); b = ln(spread + 0.1); a b; ln(1 + energy); ln(slope + 0.003):
    distance from the fit of the neighbours and their own scatter about it, px; absolute coefficient
    levels per 16 px of the block; norm of the linear part of the motion."""
    scale: float
    """Of the logarithm of the error."""

    def confidence(self, error: ArrayLike, bound: float = 1.0) -> NDArray[np.float64]:
        """Probability that vectors are right.

        Parameters
        ----------
        error : (N,) float
            Median errors in px, as :func:`expected_error` gives them.
        bound : float
            px; what counts as right.

        Returns
        -------
        (N,) float64
            In [0, 1]; 0 for infinite errors.
        """
        ratio = np.asarray(error, np.float64) / bound
        return np.asarray(1.0 / (1.0 + ratio ** (1.0 / self.scale)), np.float64)


@functools.cache
def default_error_model() -> ErrorModel:
    """Return the model that is shipped."""
    text = resources.files("mvmatch").joinpath(MODEL_FILE).read_text(encoding="utf-8")
    data: dict[str, Any] = tomllib.loads(text)
    weights = tuple(float(data["weights"][name]) for name in EVIDENCE)
    return ErrorModel(weights=weights, scale=float(data["scale"]))


def expected_error(
    field: MotionField, *, num_neighbors: int = 12, model: ErrorModel | None = None
) -> NDArray[np.float32]:
    """Median error of every vector after fusion with its neighbours.

    Parameters
    ----------
    field : MotionField
        Vectors of one coded frame.
    num_neighbors : int
        Nearest blocks with the same reference that take part, 1 to 32.
    model : ErrorModel, optional
        The shipped one without.

    Returns
    -------
    ndarray
        (N,) float32, px at the block's centre; infinite where fewer than 4 neighbours exist.
    """
    from mvmatch._core import vector_errors

    model = model or default_error_model()
    return vector_errors(field, weights=model.weights, num_neighbors=num_neighbors)


def evidence(field: MotionField, *, num_neighbors: int = 12) -> NDArray[np.float64]:
    """Return what the model knows of every vector; for fitting it.

    Parameters
    ----------
    field : MotionField
        Vectors of one coded frame.
    num_neighbors : int
        As for :func:`expected_error`.

    Returns
    -------
    (N, 6) float64
        Columns by :data:`EVIDENCE`; infinite where fewer than 4 neighbours exist.
    """
    from mvmatch._core import fit_neighbors

    residual, spread, _, linear = fit_neighbors(field, num_neighbors=num_neighbors)
    a, b = np.log(residual + 0.1), np.log(spread + 0.1)
    area = field.block[:, 2] * field.block[:, 3]
    slope = np.linalg.norm(linear, axis=1)
    columns = [
        np.ones(len(field)), a, b, a * b,
        np.log1p(16 * field.residual / area), np.log(slope + 0.003),
    ]  # fmt: skip
    return np.stack(columns, axis=1).astype(np.float64)
