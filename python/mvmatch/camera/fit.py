"""From the pictures a calibration was made for to those of the video."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.camera.calibration import Calibration, CameraChoice, make_camera
from mvmatch.errors import DataError

if TYPE_CHECKING:
    import pycolmap

_TURNABLE = frozenset(
    {
        "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "SIMPLE_RADIAL_FISHEYE",
        "RADIAL_FISHEYE", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV",
    }
)  # fmt: skip
_TANGENTIAL = frozenset({"OPENCV", "FULL_OPENCV"})
_WIDE = math.radians(80.0)
"""Angle off the axis at which an error counts 33 times (1 / cos²) in the plane; 75 degrees still
gave models as exact as without a fisheye (docs/explanation/cameras.md)."""


def fit_camera(
    calibration: Calibration, width: int, height: int, *, rotation: int = 0
) -> CameraChoice:
    """Make the camera of a calibration fit a video.

    Parameters
    ----------
    calibration : Calibration
        Of pictures of this size, or of another resolution of the same shape.
    width, height : int
        Of the video as it is stored, px.
    rotation : int
        Degrees, counter-clockwise, by which players turn the stored pictures.

    Raises
    ------
    DataError
        It describes pictures of another shape, or a camera that mvmatch cannot use.
    """
    source = calibration.source
    camera = make_camera(
        calibration.model, calibration.size or (width, height), calibration.params, source
    )
    if camera.is_spherical():
        raise DataError(
            f"{source}: mvmatch cannot use a spherical camera ({calibration.model}). "
            "Cut perspective views out of the video"
        )
    warnings: list[str] = []
    upright = _same_shape(camera, width, height)
    if rotation % 180 and not upright and _same_shape(camera, height, width):
        camera = _turned(camera, -rotation, source)
        warnings.append(
            f"The camera ({source}) is for upright pictures, the video is stored lying on its "
            "side: the camera was turned to the pictures as they are stored."
        )
    warnings += _scaled(camera, width, height, source)
    if calibration.size is None:
        _check_principal_point(camera, source)
    warnings += _wide_angle(camera, source)
    return CameraChoice(camera=camera, source=source, is_prior=False, warnings=tuple(warnings))


def _same_shape(camera: pycolmap.Camera, width: int, height: int) -> bool:
    return abs(camera.width * height - camera.height * width) <= max(width, height)


def _scaled(camera: pycolmap.Camera, width: int, height: int, source: str) -> list[str]:
    """Scale a camera in place to the size of the video; say so."""
    given = f"{camera.width}x{camera.height}"
    if (camera.width, camera.height) == (width, height):
        return []
    if not _same_shape(camera, width, height):
        turned = ""
        if _same_shape(camera, height, width):
            turned = " lying on its side (what players turn upright is stored so)"
        raise DataError(
            f"{source}: the camera is for {given} images, the video is {width}x{height}: another "
            f"shape{turned}; give the camera of this video as it is stored"
        )
    camera.rescale(width, height)
    return [
        f"The camera ({source}) is for {given} pictures and was scaled to {width}x{height}. That "
        "is right if the video shows the whole picture made smaller, wrong if it is a crop."
    ]


def _turned(camera: pycolmap.Camera, angle: int, source: str) -> pycolmap.Camera:
    """Return the camera of pictures turned by a right angle, counter-clockwise in degrees."""
    name = camera.model_name
    if name not in _TURNABLE:
        raise DataError(f"{source}: a {name} camera cannot be turned; calibrate pictures as stored")
    counter_clockwise = angle % 360 == 90
    x, y = camera.principal_point_x, camera.principal_point_y
    params = camera.params
    # Counter-clockwise, the left edge becomes the lower one: (x, y) goes to (y, width - x).
    turned = (y, camera.width - x) if counter_clockwise else (camera.height - y, x)
    params[list(camera.principal_point_idxs())] = turned
    focal = list(camera.focal_length_idxs())
    params[focal] = params[focal[::-1]]
    if name in _TANGENTIAL:
        p1, p2 = params[6:8]  # (p2, p1) is a vector in the picture, and turns as one
        params[6:8] = (-p2, p1) if counter_clockwise else (p2, -p1)
    return make_camera(name, (camera.height, camera.width), params.tolist(), source)


def _check_principal_point(camera: pycolmap.Camera, source: str) -> None:
    inside_x = 0 < camera.principal_point_x < camera.width
    inside_y = 0 < camera.principal_point_y < camera.height
    if not (inside_x and inside_y):
        raise DataError(
            f"the principal point in {source} lies outside the {camera.width}x{camera.height} "
            "video; the calibration belongs to images of another size"
        )


def _wide_angle(camera: pycolmap.Camera, source: str) -> list[str]:
    """Warn of a fisheye that sees further than a plane can show."""
    if not camera.is_perspective_fisheye():
        return []
    x, y = np.meshgrid(np.linspace(0, camera.width, 33), np.linspace(0, camera.height, 33))
    rays = np.asarray(camera.cam_ray_from_img(np.column_stack([x.ravel(), y.ravel()])), np.float64)
    angle = np.arccos(np.clip(rays[:, 2], -1.0, 1.0))
    # Where a distortion cannot be inverted the ray is not finite: as bad as behind the camera.
    wide = np.nan_to_num(angle, nan=math.pi) > _WIDE
    if not wide.any():
        return []
    return [
        f"The camera ({source}) is a fisheye: {wide.mean():.0%} of the picture is more than "
        f"{math.degrees(_WIDE):.0f} degrees off the axis. Matches are verified in a plane, which "
        "cannot hold what is 90 degrees off. Crop the video, or undistort it to a pinhole camera."
    ]
