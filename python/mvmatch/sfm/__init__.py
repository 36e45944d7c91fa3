"""COLMAP database to model: mapping that starts where the parallax is, and checks what it made."""

from mvmatch.sfm.checks import AcceptanceOptions, ModelCheck
from mvmatch.sfm.densify import DensifyOptions, DensifySummary, densify
from mvmatch.sfm.diagnosis import diagnose
from mvmatch.sfm.files import foreign_models, write_model, write_models
from mvmatch.sfm.findings import Diagnosis, Finding, status_of
from mvmatch.sfm.keyframes import KeyframeOptions, choose_keyframes
from mvmatch.sfm.localize import LocalizeOptions, Unregistered
from mvmatch.sfm.mapping import reconstruct
from mvmatch.sfm.options import MapperOptions
from mvmatch.sfm.result import Attempt, Joint, ReconstructionResult

__all__ = [
    "AcceptanceOptions",
    "Attempt",
    "DensifyOptions",
    "DensifySummary",
    "Diagnosis",
    "Finding",
    "Joint",
    "KeyframeOptions",
    "LocalizeOptions",
    "MapperOptions",
    "ModelCheck",
    "ReconstructionResult",
    "Unregistered",
    "choose_keyframes",
    "densify",
    "diagnose",
    "foreign_models",
    "reconstruct",
    "status_of",
    "write_model",
    "write_models",
]
