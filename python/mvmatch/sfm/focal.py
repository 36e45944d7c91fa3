"""A first focal length for a camera nobody described.

A prior can be off by a factor of two, and from there refinement may settle anywhere. So a thinned
part of the sequence is mapped and refined again and again, from a short and from a long focal
length, until it stays; the one whose model fits better is where mapping of the whole starts.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import dataclasses
import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mvmatch.sfm.adjust import fit_squares

if TYPE_CHECKING:
    from collections.abc import Callable

    import pycolmap

    from mvmatch.sfm.evidence import Evidence, PairEvidence

FACTORS = (0.5, 1.0)
"""First focal lengths over the prior one: a wide and a normal lens."""

MAX_ROUNDS = 6
"""Of mapping and refining; one adjustment follows the narrow valley only part of the way."""

MAX_FACTOR = 4.0
"""Focal lengths further from the prior are not believed."""

MAX_IMAGES = 16
"""Images of the thinned sequence."""

MAX_STEP = 4
"""Matches span ten frames: every fourth image still has two neighbours."""

MAX_PAIRS = 3
"""Initial pairs tried with one focal length: with a wrong one the mapper may refuse the first."""

_MIN_SHARE = 0.7
"""A model with fewer observations than this share of the largest is no candidate."""

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class _Candidate:
    focal: float
    """px, refined."""
    registered: int
    num_observations: int
    cost: float
    """Half the squared error per observation, px^2."""


def estimate_focal(
    prior: float,
    evidence: Evidence,
    map_images: Callable[[float, list[int], PairEvidence], pycolmap.Reconstruction | None],
) -> float:
    """Return the focal length, refined on a small model, that explains the matches best.

    Parameters
    ----------
    prior : float
        Focal length in px that the candidates are multiples of.
    evidence : Evidence
        Image pairs of the database.
    map_images : callable
        Maps the given images with a focal length from an initial pair, intrinsics fixed.

    Returns
    -------
    float
        px; the prior where nothing could be mapped.
    """
    images, initial = thinned(evidence)

    def mapped(focal: float) -> pycolmap.Reconstruction | None:
        models = (map_images(focal, images, pair) for pair in initial)
        return next((model for model in models if model is not None), None)

    candidates: list[_Candidate] = []
    for factor in FACTORS:
        candidate = _settle(factor * prior, mapped)
        if candidate is not None and 1 / MAX_FACTOR <= candidate.focal / prior <= MAX_FACTOR:
            candidates.append(candidate)
    return _best(candidates, prior)


def _settle(
    focal: float,
    map_images: Callable[[float], pycolmap.Reconstruction | None],
) -> _Candidate | None:
    """Map and refine until the focal length changes by less than a hundredth."""
    candidate: _Candidate | None = None
    for _ in range(MAX_ROUNDS):
        model = map_images(focal)
        if model is None or model.num_points3D() == 0:
            break
        cost = fit_squares(model, "focal length")
        num_observations = model.compute_num_observations()
        before, focal = focal, next(iter(model.cameras.values())).mean_focal_length()
        _logger.info("focal length %.0f -> %.0f px, cost %.1f", before, focal, cost)
        candidate = _Candidate(
            focal=focal,
            registered=model.num_reg_images(),
            num_observations=num_observations,
            cost=cost / num_observations,
        )
        if abs(focal / before - 1.0) < 0.01:
            break
    return candidate


def thinned(evidence: Evidence) -> tuple[list[int], list[PairEvidence]]:
    """Choose evenly spaced images around the strongest pair, and the strongest pairs of these."""
    strongest = evidence.strongest(1)
    if not strongest:
        return [], []
    middle = (strongest[0].image0 + strongest[0].image1) // 2
    ids = sorted({image for pair in evidence.pairs for image in (pair.image0, pair.image1)})
    images, inside = ids, list(evidence.pairs)
    # Not every distance between images was measured: the largest step that has pairs is taken.
    for step in range(max(1, min(MAX_STEP, len(ids) // MAX_IMAGES)), 0, -1):
        images = _around(middle, ids[::step])
        inside = [pair for pair in evidence.pairs if {pair.image0, pair.image1} <= set(images)]
        if inside:
            break
    return images, dataclasses.replace(evidence, pairs=tuple(inside)).strongest(MAX_PAIRS)


def _around(middle: int, ids: list[int]) -> list[int]:
    """Return at most `MAX_IMAGES` successive ids, those around the one nearest to ``middle``."""
    nearest = min(range(len(ids)), key=lambda index: abs(ids[index] - middle))
    first = max(0, min(nearest - MAX_IMAGES // 2, len(ids) - MAX_IMAGES))
    return ids[first : first + MAX_IMAGES]


def _best(candidates: list[_Candidate], prior: float) -> float:
    if not candidates:
        return prior
    most = max(candidate.registered for candidate in candidates)
    complete = [candidate for candidate in candidates if candidate.registered == most]
    largest = max(candidate.num_observations for candidate in complete)
    dense = [each for each in complete if each.num_observations >= _MIN_SHARE * largest]
    return min(dense, key=lambda candidate: candidate.cost).focal
