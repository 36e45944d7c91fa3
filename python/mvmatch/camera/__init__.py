"""Cameras from what users have: text, calibration files, metadata of pictures.

This is a door: OpenCV, ROS, Kalibr and KITTI put the origin at the first pixel's centre, COLMAP,
nerfstudio and everything in mvmatch at the upper-left image corner. So principal points of the
former move by half a pixel here.
"""

from mvmatch.camera.calibration import CameraChoice
from mvmatch.camera.parse import PRIOR_FOCAL_FACTOR, PRIOR_MODEL, parse_camera

__all__ = ["PRIOR_FOCAL_FACTOR", "PRIOR_MODEL", "CameraChoice", "parse_camera"]
