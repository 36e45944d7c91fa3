"""What came of mapping: a model or none, and every attempt at it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    import pycolmap

    from mvmatch.sfm.checks import ModelCheck
    from mvmatch.sfm.localize import Unregistered


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """One run of a mapper."""

    mapper: str
    images: tuple[int, int]
    """First and last image id of the part that was mapped; mostly the whole."""
    initial_images: tuple[int, int] | None
    """Image ids mapping started from; None where the mapper chose."""
    check: ModelCheck | None
    """None when the mapper made no model."""
    reasons: tuple[str, ...]
    """Why the attempt was rejected; empty for the accepted one."""


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A place in the sequence that no model holds across."""

    before: int
    after: int
    """Ids of two images that were mapped, one on either side."""
    reason: str


@dataclass(frozen=True, kw_only=True, eq=False)
class ReconstructionResult:
    """The model, or the best that was rejected, and how it came about."""

    reconstruction: pycolmap.Reconstruction | None
    registered: int
    total: int
    """Images of the database."""
    num_keyframes: int
    """Images that were mapped; the others were registered to their map."""
    unregistered: tuple[Unregistered, ...]
    """Images that the accepted model lacks, and why; empty without one."""
    num_points: int
    mean_reprojection_error: float
    """px; NaN without a model."""
    mean_track_length: float
    accepted: bool
    """Whether the model passed all checks; only then it is written."""
    reasons: tuple[str, ...]
    """Why there is no accepted model; empty when there is."""
    attempts: tuple[Attempt, ...]
    joints: tuple[Joint, ...] = ()
    """Where models of the whole were refused, so that parts were mapped; rising."""
    path: Path | None
    """Folder of the written model (cameras, rigs, frames, images, points3D)."""
    further: tuple[Path, ...] = ()
    """Folders of the models of other parts that hold, the largest first."""

    @classmethod
    def refused(cls, total: int, reason: str) -> ReconstructionResult:
        """Return the result of a sequence of so many images that is not even tried."""
        return cls(
            reconstruction=None,
            registered=0,
            total=total,
            num_keyframes=0,
            unregistered=(),
            num_points=0,
            mean_reprojection_error=math.nan,
            mean_track_length=0.0,
            accepted=False,
            reasons=(reason,),
            attempts=(),
            path=None,
        )
