"""How much of a model there is, and what stands in the way of the rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from mvmatch.errors import MvmatchError
    from mvmatch.sfm.breaks import Part
    from mvmatch.sfm.result import ReconstructionResult

Status = Literal["complete", "partial", "failed"]
Code = Literal[
    "damage",
    "scene-cut",
    "key-frame",
    "few-tracks",
    "joint",
    "static",
    "rotation",
    "planar",
    "focal-length",
    "repeats",
    "other-model",
    "unregistered",
    "unexplained",
]


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that stands in the way of a whole model."""

    code: Code
    frames: tuple[Part, ...]
    """Where: first and last picture (display index) of each part; empty: everywhere."""
    sentence: str
    """What is the matter."""
    advice: str
    """What to try."""


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """How much of a model there is, and what stands in the way of the rest."""

    status: Status = "complete"
    """``complete``: all pictures of an undamaged video are registered in an accepted model;
    ``partial``: some are, maybe others in models of further parts; ``failed``: no model was
    accepted."""
    findings: tuple[Finding, ...] = ()
    """Gravest first; none of a complete model."""


def status_of(result: ReconstructionResult, damage: MvmatchError | None = None) -> Status:
    """Return how much of a model there is."""
    if not result.accepted:
        return "failed"
    return "complete" if damage is None and result.registered == result.total else "partial"
