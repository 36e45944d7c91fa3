"""Test kit: synthetic scenes with exact truth, and the contract of a motion source.

Importable by authors of motion sources; everything here is NumPy, seeded and free of assets.
"""

from __future__ import annotations

from mvmatch.testing.contract import check_source
from mvmatch.testing.drive import synthetic_drive
from mvmatch.testing.exact import exact_motion_field, exact_motion_fields, exact_paths
from mvmatch.testing.scene import Rectangle, SyntheticScene

__all__ = [
    "Rectangle",
    "SyntheticScene",
    "check_source",
    "exact_motion_field",
    "exact_motion_fields",
    "exact_paths",
    "synthetic_drive",
]
