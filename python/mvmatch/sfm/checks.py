"""Is a model right? Registered is not: a wrong one can hold every image.

A forward-moving camera often leads the mapper into a model that registers everything at about 1 px,
with the path bent by 8 % of its length. What gives it away is that it contradicts the relative
motion which pairs of its own images measure.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.sfm.breaks import MIN_DISPLACEMENT

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pycolmap

    from mvmatch.sfm.evidence import Evidence, PairEvidence

MIN_ACROSS = 3
"""Pairs across a boundary between two images: fewer can be wrong themselves."""


@dataclass(frozen=True, kw_only=True)
class AcceptanceOptions:
    """Bounds that a model must keep."""

    min_registered: float = 0.8
    """Share of the images."""
    max_reprojection_error: float = 2.0
    """Mean, px."""
    max_rotation_error: float = 1.0
    """Degrees between a pair's rotation in the model and measured from the pair alone."""
    max_direction_error: float = 5.0
    """Degrees between the two directions of translation."""
    max_misfit: float = 2.0
    """A pair beyond those bounds is no contradiction if its matches lie at most this many times as
    far from the epipolar lines of the model as from its own: a plane, and little parallax, leave
    several motions open. Measured: 0.5 to 1.8 where the model is right, 4 and more where not."""
    min_agreement: float = 0.9
    """Share of the pairs with parallax that do not contradict the model."""
    min_parallax: float = 1.0
    """Degrees; pairs below it say little about the direction. Lowered where no pair reaches it."""
    min_joint: int = 20
    """Points seen on both sides of every cut through the sequence: fewer, and the two parts of the
    model may differ in scale."""
    min_ties: int = 10
    """Points seen in two images or more on either side of every cut that has them: fewer leave the
    scale to chains of points, as where vectors leave a gap that nothing bridges. Measured: 33 and
    more where a model is right, 0 to 3 at two to five cuts where it has two scales."""
    min_part: float = 0.2
    """Share of the images that a part must register to be delivered where no model holds all; each
    part has to keep the other bounds for itself, but for ``min_joint``."""
    min_part_joint: int = 100
    """As ``min_joint``, of a part. It is left where tracks are wrong, and has few image pairs to
    check it with: parts held together by 30 to 50 points were off by a tenth of their path and
    more, right ones had 570."""
    min_observations: float = 0.25
    """Share of the matched keypoints that belong to a point of the model."""


@dataclass(frozen=True, kw_only=True)
class Boundary:
    """Two neighbouring images, and the pairs with one image on either side.

    A model whose first images lie wrong agrees with nearly all pairs, but with none of those that
    reach from the wrong part to the right one, whatever their parallax. Measured: where a model is
    right no pair contradicts it at any boundary, or few where patterns repeat.
    """

    before: int
    after: int
    """Image ids."""
    across: int
    """Pairs with motion."""
    against: int
    """Those of them that contradict the model."""


@dataclass(frozen=True, kw_only=True)
class ModelCheck:
    """What was measured on a model, and what speaks against it."""

    registered: int
    total: int
    num_points: int
    mean_reprojection_error: float
    """px."""
    mean_track_length: float
    """Images per point."""
    observation_share: float
    """Observations in the model over keypoints with a verified match."""
    agreement: float
    """Share of the pairs with parallax whose motion the model confirms; NaN without any."""
    weakest_joint: int
    """Fewest points that hold the images before and after any one image together."""
    median_rotation_error: float
    """Degrees."""
    median_direction_error: float
    """Degrees."""
    reasons: tuple[str, ...]
    """Why the model is not accepted; empty when it is."""

    @property
    def accepted(self) -> bool:
        """Whether nothing speaks against the model."""
        return not self.reasons


def check_model(
    model: pycolmap.Reconstruction, evidence: Evidence, options: AcceptanceOptions
) -> ModelCheck:
    """Compare a model with the evidence of its image pairs.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Result of a mapper.
    evidence : Evidence
        Of the database it was made from.
    options : AcceptanceOptions
        Bounds.

    Returns
    -------
    ModelCheck
        With a sentence for every bound that is not kept.
    """
    pairs = registered_pairs(model, evidence)
    every = relative_motion_errors(model, pairs)
    holds = confirmed(every, options)
    far = _with_parallax(pairs, options.min_parallax)
    errors, kept = every[far], holds[far]
    agreement = float(kept.mean()) if len(kept) else float("nan")
    registered = model.num_reg_images()
    error = float(model.compute_mean_reprojection_error())
    share = model.compute_num_observations() / max(1, evidence.num_observations)
    reasons: list[str] = []
    if registered < options.min_registered * evidence.num_images:
        reasons.append(f"only {registered} of {evidence.num_images} images are registered")
    if not error <= options.max_reprojection_error:
        reasons.append(
            f"the mean reprojection error is {error:.2f} px, "
            f"above {options.max_reprojection_error:g} px"
        )
    if share < options.min_observations:
        reasons.append(f"only {share:.0%} of the matched keypoints belong to a point of the model")
    joint, after = weakest_joint(model)
    if joint < options.min_joint:
        reasons.append(f"only {joint} points hold the model together after image {after}")
    ties, after = weakest_joint(model, views=2)
    if ties < options.min_ties:
        reasons.append(f"only {ties} points are seen twice before and after image {after}")
    if not agreement >= options.min_agreement:
        reasons.append(_disagreement(agreement, len(kept)))
    broken = _boundary(evidence.image_ids, pairs, holds)
    if broken is not None:
        reasons.append(
            f"the model contradicts {broken.against} of {broken.across} image pairs across the "
            f"step from image {broken.before} to {broken.after}"
        )
    return ModelCheck(
        registered=registered,
        total=evidence.num_images,
        num_points=model.num_points3D(),
        mean_reprojection_error=error,
        mean_track_length=float(model.compute_mean_track_length()),
        observation_share=share,
        agreement=agreement,
        weakest_joint=joint,
        median_rotation_error=float(np.median(errors[:, 0])) if len(errors) else float("nan"),
        median_direction_error=float(np.median(errors[:, 1])) if len(errors) else float("nan"),
        reasons=tuple(reasons),
    )


def contradicted_boundary(
    model: pycolmap.Reconstruction, evidence: Evidence, options: AcceptanceOptions
) -> Boundary | None:
    """Find the boundary that most of the pairs across speak against, by as many as possible.

    Pairs with parallax are asked first: they see a path that bends little by little.

    Returns
    -------
    Boundary or None
        In the middle of its like; None where the pairs across speak for the model everywhere.
        Boundaries with fewer than `MIN_ACROSS` pairs say nothing.
    """
    pairs = registered_pairs(model, evidence)
    holds = confirmed(relative_motion_errors(model, pairs), options)
    far = np.flatnonzero(_with_parallax(pairs, options.min_parallax))
    return _boundary(evidence.image_ids, [pairs[i] for i in far], holds[far]) or _boundary(
        evidence.image_ids, pairs, holds
    )


def confirmed(
    errors: np.ndarray[tuple[int, int], np.dtype[np.float64]], options: AcceptanceOptions
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """(P,) whether :func:`relative_motion_errors` of a pair are within the bounds."""
    rotation, direction, misfit = errors.T
    near = (rotation <= options.max_rotation_error) & (direction <= options.max_direction_error)
    return near | (misfit <= options.max_misfit)


def relative_motion_errors(
    model: pycolmap.Reconstruction, pairs: Sequence[PairEvidence]
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Angles between the relative motion of pairs in the model and in the evidence.

    Returns
    -------
    (P, 3) float64
        Rotation and direction of translation, degrees, and how many times as far the matches lie
        from the epipolar lines of the model as from the pair's own (median Sampson errors).
    """
    rows: list[tuple[float, float, float]] = []
    for pair in pairs:
        first, second = (model.image(i).cam_from_world() for i in (pair.image0, pair.image1))
        pose = second * first.inverse()
        rotation = np.asarray(pose.rotation.matrix(), np.float64)
        translation = np.asarray(pose.translation, np.float64)
        own = max(pair.misfit(pair.rotation, pair.direction), np.finfo(np.float64).tiny)
        rows.append(
            (
                _angle(0.5 * (np.trace(rotation @ pair.rotation.T) - 1.0)),
                _angle(_cosine(translation, pair)),
                float(np.sqrt(pair.misfit(rotation, translation) / own)),
            )
        )
    return np.array(rows, np.float64).reshape(-1, 3)


def weakest_joint(model: pycolmap.Reconstruction, *, views: int = 1) -> tuple[int, int]:
    """Find the cut through the sequence that the fewest points bridge.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Any model.
    views : int
        Images on either side that have to see a point; cuts with fewer images on a side are none.

    Returns
    -------
    points, image : int
        The number of points, and the image id before the cut. All points where there is no such
        cut; zero points for an empty model.
    """
    ids = np.array(sorted(model.reg_image_ids()), np.int64)
    if len(ids) < 2 * views:
        return (0, 0) if len(ids) < 2 else (model.num_points3D(), int(ids[0]))
    change = np.zeros(len(ids) + 1, np.int64)
    for point in model.points3D.values():
        images = {element.image_id for element in point.track.elements}
        if len(images) >= 2 * views:
            seen = np.sort(np.searchsorted(ids, list(images)))
            change[seen[views - 1]] += 1
            change[seen[-views]] -= 1
    bridged = np.cumsum(change)[views - 1 : len(ids) - views]
    cut = int(np.argmin(bridged))
    return int(bridged[cut]), int(ids[views - 1 + cut])


def registered_pairs(model: pycolmap.Reconstruction, evidence: Evidence) -> list[PairEvidence]:
    """Return the pairs of images that a model holds."""
    known = frozenset(model.reg_image_ids())
    return [pair for pair in evidence.pairs if {pair.image0, pair.image1} <= known]


def _boundary(
    ids: Sequence[int],
    pairs: Sequence[PairEvidence],
    holds: np.ndarray[tuple[int], np.dtype[np.bool_]],
) -> Boundary | None:
    place = {image_id: number for number, image_id in enumerate(ids)}
    change = np.zeros((2, len(ids)), np.int64)
    for pair, agrees in zip(pairs, holds, strict=True):
        if pair.displacement < MIN_DISPLACEMENT:
            continue  # at rest any motion fits, and none
        for image_id, step in ((pair.image0, 1), (pair.image1, -1)):
            change[:, place[image_id]] += step, step * int(not agrees)
    across, against = np.cumsum(change, axis=1)[:, :-1]
    lead = np.where(across >= MIN_ACROSS, 2 * against - across, 0)
    if lead.max(initial=0) == 0:
        return None
    best = np.flatnonzero(lead == lead.max())
    middle = int(best[len(best) // 2])
    return Boundary(
        before=ids[middle],
        after=ids[middle + 1],
        across=int(across[middle]),
        against=int(against[middle]),
    )


def _with_parallax(
    pairs: Sequence[PairEvidence], min_parallax: float
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Mark the pairs with enough parallax; where those are few, the better half."""
    parallax = np.array([pair.parallax for pair in pairs], np.float64)
    enough = parallax >= min_parallax
    if enough.sum() < min(10, len(pairs)):
        enough[:] = False
        enough[np.argsort(-parallax, kind="stable")[: max(1, len(pairs) // 2)]] = True
    return enough


def _cosine(translation: np.ndarray[tuple[int], np.dtype[np.float64]], pair: PairEvidence) -> float:
    length = float(np.linalg.norm(translation))
    return float(translation @ pair.direction) / length if length > 0 else -1.0


def _angle(cosine: float) -> float:
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _disagreement(agreement: float, count: int) -> str:
    if count == 0:
        return "no image pair has enough parallax to check the model against"
    return (
        f"the model contradicts the relative motion of {1 - agreement:.0%} of {count} image pairs"
    )
