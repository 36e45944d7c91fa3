"""COLMAP database to model: mapping that starts where the parallax is, and checks what it made."""

from mvmatch.sfm.checks import AcceptanceOptions, ModelCheck
from mvmatch.sfm.mapping import Attempt, ReconstructionResult, reconstruct
from mvmatch.sfm.options import MapperOptions

__all__ = [
    "AcceptanceOptions",
    "Attempt",
    "MapperOptions",
    "ModelCheck",
    "ReconstructionResult",
    "reconstruct",
]
