"""Motion vectors of AV1 video as correspondences, tracks and COLMAP models."""
