"""What every format is read into, and the COLMAP camera made of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mvmatch.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import pycolmap

HALF_PIXEL = 0.5
"""From an origin at the first pixel's centre to one at the image corner, px."""

_OPENCV_COUNTS = (0, 4, 5, 8, 12, 14)
"""Numbers of coefficients that OpenCV's distortion may have."""


@dataclass(frozen=True, kw_only=True)
class CameraChoice:
    """A camera and where it came from."""

    camera: pycolmap.Camera
    source: str
    """One phrase for the report, such as ``"KITTI calibration calib.txt"``."""
    is_prior: bool
    """True when the focal length is a guess: the mapper refines it after a first model."""
    warnings: tuple[str, ...] = ()
    """What was done to the camera, or what it is not good for, in sentences."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """A camera as a file or a text gives it."""

    model: str
    """Name of the COLMAP model."""
    params: Sequence[float]
    """In COLMAP's order; px from the upper-left image corner."""
    size: tuple[int, int] | None
    """Width and height in px of the pictures it was made for; None where nothing says it."""
    source: str


def make_camera(
    model: str, size: tuple[int, int], params: Sequence[float], where: str
) -> pycolmap.Camera:
    """Build a COLMAP camera; ``where`` begins the message of errors.

    Raises
    ------
    DataError
        A size or a focal length is not positive, or a parameter is not finite.
    """
    import pycolmap

    width, height = size
    if width <= 0 or height <= 0:
        raise DataError(f"{where}: image size must be positive, got {width}x{height}")
    camera = pycolmap.Camera.create_from_model_name(1, model, 1.0, width, height)
    camera.params = list(params)
    camera.has_prior_focal_length = True
    finite = all(math.isfinite(value) for value in params)
    if not finite or any(params[index] <= 0 for index in camera.focal_length_idxs()):
        raise DataError(
            f"{where}: parameters must be finite and focal lengths positive: {list(params)}"
        )
    return camera


def opencv_model(
    pinhole: Sequence[float], coefficients: Sequence[float], where: str
) -> tuple[str, list[float]]:
    """Name the COLMAP model of OpenCV's distortion, and give its parameters.

    Parameters
    ----------
    pinhole : (4,) fx, fy, cx, cy in px.
    coefficients : k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, tx, ty]]]].
    where : begins the message of errors.
    """
    if len(coefficients) not in _OPENCV_COUNTS:
        raise DataError(
            f"{where}: distortion has {len(coefficients)} coefficients; OpenCV's has "
            f"{', '.join(map(str, _OPENCV_COUNTS[:-1]))} or {_OPENCV_COUNTS[-1]}"
        )
    if any(coefficients[8:]):
        raise DataError(
            f"{where}: no COLMAP model has OpenCV's thin prism and tilt (coefficients 9 to 14). "
            "Calibrate without them"
        )
    if not any(coefficients):
        return "PINHOLE", [*pinhole]
    if not any(coefficients[4:]):
        return "OPENCV", [*pinhole, *coefficients[:4]]
    padded = [*coefficients[:8], *[0.0] * (8 - len(coefficients))]
    return "FULL_OPENCV", [*pinhole, *padded]


def fisheye_model(
    pinhole: Sequence[float], coefficients: Sequence[float], where: str
) -> tuple[str, list[float]]:
    """Do the same for OpenCV's fisheye distortion: k1, k2, k3, k4, or nothing for zeros."""
    if len(coefficients) not in (0, 4):
        raise DataError(
            f"{where}: fisheye distortion has 4 coefficients, got {len(coefficients)}. "
            "Is the distortion model the right one?"
        )
    return "OPENCV_FISHEYE", [*pinhole, *(coefficients or [0.0] * 4)]


def number(value: Any, what: str) -> float:
    """Return a finite number; YAML gives some as text (``1e-05``).

    Raises
    ------
    DataError
        ``what`` is no finite number.
    """
    try:
        found = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        found = math.nan
    if not math.isfinite(found):
        raise DataError(f"{what} must be a finite number, got {str(value)[:40]!r}")
    return found


def picture_size(
    fields: Mapping[Any, Any], names: Sequence[tuple[str, str]], where: str
) -> tuple[int, int] | None:
    """Return width and height under the first pair of names that is there.

    Raises
    ------
    DataError
        Only one of them is there, or they are no positive whole numbers.
    """
    for pair in names:
        there = [name for name in pair if name in fields]
        if len(there) == 1:
            raise DataError(f"{where}: has {there[0]}, but not the other of {' and '.join(pair)}")
        if there:
            width, height = (number(fields[name], f"{where}: {name}") for name in pair)
            return whole_size(width, height, where)
    return None


def whole_size(width: float, height: float, where: str) -> tuple[int, int]:
    """Return a size as whole numbers, or refuse it."""
    if width < 1 or height < 1 or width % 1 or height % 1:
        raise DataError(
            f"{where}: image size must be positive whole numbers of px, got {width:g}x{height:g}"
        )
    return int(width), int(height)
