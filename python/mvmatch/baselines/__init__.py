"""Other front ends to compare with: what one would use instead of motion vectors.

They read pixels, so they are a door: OpenCV puts the origin at the first pixel's centre, mvmatch at
the image corner.
"""

from mvmatch.baselines.flow import DisOptions, track_dis
from mvmatch.baselines.klt import KltOptions, track_klt
from mvmatch.baselines.sift import SiftOptions, extract_sift, match_features, match_sift

__all__ = [
    "DisOptions",
    "KltOptions",
    "SiftOptions",
    "extract_sift",
    "match_features",
    "match_sift",
    "track_dis",
    "track_klt",
]
