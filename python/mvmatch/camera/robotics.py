"""Calibrations of OpenCV, ROS and Kalibr, whose origin is the first pixel's centre."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, cast

from mvmatch.camera.calibration import (
    HALF_PIXEL,
    Calibration,
    fisheye_model,
    number,
    opencv_model,
    picture_size,
)
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

_MATRIX_NAMES = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "k")
_DISTORTION_NAMES = (
    "distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist_coeffs", "D", "d",
)  # fmt: skip
_SIZE_NAMES = (
    ("image_width", "image_height"),
    ("image_Width", "image_Height"),
    ("width", "height"),
)
_FISHEYE = frozenset({"equidistant", "fisheye", "equi"})
_PERSPECTIVE = frozenset({"", "plumb_bob", "rational_polynomial", "radtan", "none"})


def read_robotics(path: Path, fields: Mapping[str, Any]) -> Calibration | None:
    """Read the fields of an OpenCV, ROS or Kalibr file; None when they are of neither.

    Raises
    ------
    DataError
        Fields are missing or hold no numbers, or no COLMAP model has the distortion.
    """
    chains = {name: fields[name] for name in fields if re.fullmatch(r"cam\d+", name)}
    if len(chains) > 1:
        raise DataError(f"camera file {path} holds {len(chains)} cameras; keep one")
    if chains:
        (chain,) = chains.values()
        if not isinstance(chain, dict):
            raise DataError(f"camera file {path}: {next(iter(chains))} has no fields")
        return _kalibr(path, cast("dict[str, Any]", chain))
    if "intrinsics" in fields:
        return _kalibr(path, fields)
    matrix = next((fields[name] for name in _MATRIX_NAMES if name in fields), None)
    return None if matrix is None else _opencv(path, fields, matrix)


def _opencv(path: Path, fields: Mapping[str, Any], matrix: object) -> Calibration:
    where = f"camera file {path}"
    K = _numbers(matrix, f"{where}: camera matrix")
    if len(K) != 9:
        raise DataError(f"{where}: the camera matrix must have 3x3 numbers, got {len(K)}")
    if K[1] or K[3] or K[6] or K[7] or K[8] != 1.0:
        raise DataError(
            f"{where}: the camera matrix must be [fx 0 cx; 0 fy cy; 0 0 1], got {K}; "
            "COLMAP has no skew"
        )
    pinhole = [K[0], K[4], K[2] + HALF_PIXEL, K[5] + HALF_PIXEL]
    given = next((fields[name] for name in _DISTORTION_NAMES if name in fields), None)
    coefficients = [] if given is None else _numbers(given, f"{where}: distortion")
    # OpenCV's calibration sample says fisheye_model, ROS distortion_model.
    ros_name = str(fields.get("distortion_model", ""))
    kind = "fisheye" if fields.get("fisheye_model") in (1, True) else ros_name
    model, params = _distorted(pinhole, coefficients, kind, where)
    return Calibration(
        model=model,
        params=params,
        size=picture_size(fields, _SIZE_NAMES, where),
        source=f"{'ROS' if ros_name else 'OpenCV'} calibration {path.name} ({model})",
    )


def _kalibr(path: Path, fields: Mapping[str, Any]) -> Calibration:
    where = f"camera file {path}"
    kind = str(fields.get("camera_model", "pinhole"))
    if kind != "pinhole":
        raise DataError(f"{where}: no COLMAP model is made of Kalibr's {kind!r}; use pinhole")
    intrinsics = _numbers(fields.get("intrinsics"), f"{where}: intrinsics")
    if len(intrinsics) != 4:
        raise DataError(f"{where}: intrinsics must be fx, fy, cx, cy, got {intrinsics}")
    fx, fy, cx, cy = intrinsics
    model, params = _distorted(
        [fx, fy, cx + HALF_PIXEL, cy + HALF_PIXEL],
        _numbers(fields.get("distortion_coeffs", []), f"{where}: distortion_coeffs"),
        str(fields.get("distortion_model", "")),
        where,
    )
    resolution = _numbers(fields.get("resolution", []), f"{where}: resolution")
    if len(resolution) not in (0, 2):
        raise DataError(f"{where}: resolution must be width and height, got {resolution}")
    named = dict(zip(("width", "height"), resolution, strict=False))
    return Calibration(
        model=model,
        params=params,
        size=picture_size(named, _SIZE_NAMES, where),
        source=f"Kalibr calibration {path.name} ({model})",
    )


def _distorted(
    pinhole: Sequence[float], coefficients: Sequence[float], kind: str, where: str
) -> tuple[str, list[float]]:
    if kind in _FISHEYE:
        return fisheye_model(pinhole, coefficients, where)
    if kind in _PERSPECTIVE:
        return opencv_model(pinhole, coefficients, where)
    known = ", ".join(sorted(name for name in _FISHEYE | _PERSPECTIVE if name))
    raise DataError(f"{where}: unknown distortion model {kind[:40]!r}; known are {known}")


def _numbers(value: object, what: str) -> list[float]:
    """Return the numbers of a list, of rows of lists, or of a matrix with the field ``data``."""
    if isinstance(value, dict):
        value = cast("dict[str, Any]", value).get("data")
    if not isinstance(value, list):
        raise DataError(f"{what} must be a list of numbers or a matrix with data")
    found: list[float] = []
    for item in cast("list[Any]", value):
        row = cast("list[Any]", item) if isinstance(item, list) else [item]
        found += [number(entry, what) for entry in row]
    return found
