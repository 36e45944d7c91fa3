"""Learned features and matchers to compare with: networks of others, with the user's weights.

They read pixels, so they are a door: the networks put the origin at the first pixel's centre,
mvmatch at the image corner. PyTorch and kornia are imported where they are used, and nothing is
downloaded.
"""

from mvmatch.learned.images import read_rgb
from mvmatch.learned.lightglue import LightGlueModel
from mvmatch.learned.networks import (
    LearnedFeatures,
    LearnedMatcher,
    LearnedModel,
    device_of_networks,
    require_torch,
)
from mvmatch.learned.superglue import SuperGlueModel

__all__ = [
    "LearnedFeatures",
    "LearnedMatcher",
    "LearnedModel",
    "LightGlueModel",
    "SuperGlueModel",
    "device_of_networks",
    "read_rgb",
    "require_torch",
]
