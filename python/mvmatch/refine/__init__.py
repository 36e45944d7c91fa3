"""Tracks aligned to the pictures, to a fraction of a pixel (docs/explanation/refinement.md)."""

from mvmatch.refine.options import RefineOptions
from mvmatch.refine.pictures import gray_pictures
from mvmatch.refine.refinement import refine_groups, refine_tracks

__all__ = ["RefineOptions", "gray_pictures", "refine_groups", "refine_tracks"]
