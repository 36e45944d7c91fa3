"""The ``transforms.json`` of nerfstudio and instant-ngp, whose origin is the image corner."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, cast

from mvmatch.camera.calibration import (
    Calibration,
    fisheye_model,
    number,
    opencv_model,
    picture_size,
)
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_INTRINSICS = (
    "fl_x", "fl_y", "cx", "cy", "w", "h", "k1", "k2", "k3", "k4", "p1", "p2",
    "camera_model", "camera_angle_x", "is_fisheye",
)  # fmt: skip
_PERSPECTIVE = frozenset({"PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"})


def read_nerfstudio(path: Path, fields: Mapping[str, Any]) -> Calibration | None:
    """Read the intrinsics of a ``transforms.json``; None when the fields are of something else.

    Raises
    ------
    DataError
        There are none or several, some are missing, or no COLMAP model has the distortion.
    """
    if not {"fl_x", "camera_angle_x", "frames"} & fields.keys():
        return None
    where = f"camera file {path}"
    own = _of_all_frames(fields, where)
    size = picture_size(own, (("w", "h"),), where)
    focal_x, focal_y = _focal(own, size, where)
    if size is None and not {"cx", "cy"} <= own.keys():
        raise DataError(f"{where}: needs w and h, or cx and cy")
    width, height = size or (0, 0)
    cx = number(own.get("cx", width / 2), f"{where}: cx")
    cy = number(own.get("cy", height / 2), f"{where}: cy")
    model, params = _model(own, [focal_x, focal_y, cx, cy], where)
    return Calibration(
        model=model, params=params, size=size, source=f"nerfstudio {path.name} ({model})"
    )


def _of_all_frames(fields: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the intrinsics that all frames share."""
    shared = {name: fields[name] for name in _INTRINSICS if name in fields}
    frames = fields.get("frames", [])
    if not isinstance(frames, list):
        raise DataError(f"{where}: frames must be a list")
    found: dict[str, Any] | None = None
    for frame in cast("list[Any]", frames):
        if not isinstance(frame, dict):
            raise DataError(f"{where}: a frame has no fields")
        named = cast("dict[str, Any]", frame)
        own = shared | {name: named[name] for name in _INTRINSICS if name in named}
        if found is not None and own != found:
            raise DataError(
                f"{where}: its frames have different intrinsics, a video has one camera. "
                "Keep the frames of one"
            )
        found = own
    return shared if found is None else found


def _focal(own: Mapping[str, Any], size: tuple[int, int] | None, where: str) -> tuple[float, float]:
    if "fl_x" in own:
        focal = number(own["fl_x"], f"{where}: fl_x")
        return focal, number(own.get("fl_y", focal), f"{where}: fl_y")
    if "camera_angle_x" not in own:
        raise DataError(f"{where}: has no focal length (fl_x or camera_angle_x)")
    if size is None:
        raise DataError(f"{where}: camera_angle_x needs the size w and h")
    angle = number(own["camera_angle_x"], f"{where}: camera_angle_x")
    if not 0 < angle < math.pi:
        raise DataError(f"{where}: camera_angle_x must be between 0 and pi, got {angle:g}")
    focal = 0.5 * size[0] / math.tan(0.5 * angle)
    return focal, focal


def _model(own: Mapping[str, Any], pinhole: list[float], where: str) -> tuple[str, list[float]]:
    k1, k2, k3, k4, p1, p2 = (
        number(own.get(name, 0.0), f"{where}: {name}") for name in _INTRINSICS[6:12]
    )
    name = str(own.get("camera_model", "OPENCV"))
    if name == "OPENCV_FISHEYE" or own.get("is_fisheye") is True:
        return fisheye_model(pinhole, [k1, k2, k3, k4], where)
    if name not in _PERSPECTIVE:
        raise DataError(
            f"{where}: camera_model {name[:40]!r} cannot be used; known are "
            f"{', '.join(sorted(_PERSPECTIVE))} and OPENCV_FISHEYE"
        )
    if k4:
        raise DataError(f"{where}: no COLMAP model has k4 of a camera that is no fisheye")
    return opencv_model(pinhole, [k1, k2, p1, p2, k3], where)
