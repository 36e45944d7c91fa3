"""The parts of a sequence that hold where no model holds the whole.

One weak joint is enough to bend everything after it. So a sequence whose model is refused is parted
where the model is weakest, and either side is mapped and checked for itself, from its own image
pairs; a side that is refused is parted again.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from bisect import bisect_right
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.sfm.adjust import fit_focal_length, focal_change
from mvmatch.sfm.breaks import MIN_PART, runs
from mvmatch.sfm.checks import (
    MIN_ACROSS,
    contradicted_boundary,
    registered_pairs,
    weakest_joint,
)
from mvmatch.sfm.result import Joint

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pycolmap

    from mvmatch.sfm.checks import AcceptanceOptions, ModelCheck
    from mvmatch.sfm.evidence import Evidence
    from mvmatch.sfm.options import MapperOptions


def find_joints(
    model: pycolmap.Reconstruction, evidence: Evidence, options: AcceptanceOptions
) -> tuple[Joint, ...]:
    """Find where a refused model is to be parted.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        The model that was refused.
    evidence : Evidence
        Of the images it was made of.
    options : AcceptanceOptions
        Bounds it did not keep.

    Returns
    -------
    tuple of Joint
        The ends of the longest stretch of registered images. Where that is everything: the cut that
        too few points bridge, or else the one where most of the image pairs across contradict the
        model. None where nothing speaks against one place more than against others.
    """
    return (
        ends(model, evidence)
        or _weakest(model, evidence, options)
        or _contradicted(model, evidence, options)
    )


def ends(model: pycolmap.Reconstruction, evidence: Evidence) -> tuple[Joint, ...]:
    """Find the ends of the longest stretch without `MIN_PART` unregistered images in a row."""
    ids = evidence.image_ids
    known = np.isin(ids, list(model.reg_image_ids()))
    for first, last in runs(~known):
        known[first : last + 1] = last - first + 1 < MIN_PART
    stretches = runs(known)
    if not stretches:
        return ()
    first, last = max(stretches, key=lambda stretch: stretch[1] - stretch[0])
    reason = "the mapper found no way across"
    return tuple(
        Joint(before=ids[place], after=ids[place + 1], reason=reason)
        for place in (first - 1, last)
        if 0 <= place < len(ids) - 1
    )


def is_sound(
    model: pycolmap.Reconstruction, check: ModelCheck, evidence: Evidence, options: MapperOptions
) -> bool:
    """Whether an accepted part is more than too short to be refused.

    A wrong camera bends a whole sequence, but a part of it so little that the matches of its pairs
    fit either way. So half of the pairs have to confirm a part by their angles as well, fewer than
    `MIN_ACROSS` pairs confirm nothing, and it may not ask for another focal length than the one
    given.
    """
    import pycolmap

    bounds = options.acceptance
    if len(registered_pairs(model, evidence)) < MIN_ACROSS:
        return False
    if not check.median_rotation_error <= bounds.max_rotation_error:
        return False
    if not check.median_direction_error <= bounds.max_direction_error:
        return False
    if not evidence.has_prior_focal_length:
        return True
    free = pycolmap.Reconstruction(model)
    insists = fit_focal_length(free) >= options.min_focal_error
    return not (insists and focal_change(model, free) > options.max_focal_change)


def parted(image_ids: Sequence[int], joints: Sequence[Joint]) -> list[list[int]]:
    """Part images at joints."""
    cuts = [0, *(bisect_right(image_ids, joint.before) for joint in joints), len(image_ids)]
    return [list(image_ids[start:end]) for start, end in pairwise(cuts)]


def _weakest(
    model: pycolmap.Reconstruction, evidence: Evidence, options: AcceptanceOptions
) -> tuple[Joint, ...]:
    """Find the cut that fewer points bridge than hold a model together."""
    ids = evidence.image_ids
    for views, least, seen in ((1, options.min_joint, ""), (2, options.min_ties, " seen twice")):
        points, image = weakest_joint(model, views=views)
        place = bisect_right(ids, image) - 1
        if points < least and 0 <= place < len(ids) - 1:
            reason = f"only {points} points of the model{seen} hold the two sides together"
            return (Joint(before=ids[place], after=ids[place + 1], reason=reason),)
    return ()


def _contradicted(
    model: pycolmap.Reconstruction, evidence: Evidence, options: AcceptanceOptions
) -> tuple[Joint, ...]:
    """Find the boundary that most of the pairs across speak against."""
    found = contradicted_boundary(model, evidence, options)
    if found is None:
        return ()
    reason = f"{found.against} of the {found.across} image pairs across contradict the model"
    return (Joint(before=found.before, after=found.after, reason=reason),)
