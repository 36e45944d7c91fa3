"""Cameras from what users have: a COLMAP string or file, a KITTI calib file, a focal length.

This is a door: KITTI puts the origin at the first pixel's centre, everything else in mvmatch (and
COLMAP) at the upper-left image corner, so KITTI principal points move by half a pixel here.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mvmatch.errors import DataError

if TYPE_CHECKING:
    import pycolmap

PRIOR_FOCAL_FACTOR = 1.2
"""Prior focal length over the longer image side (COLMAP's default, 45 degrees field of view)."""

PRIOR_MODEL = "SIMPLE_RADIAL"
"""Model of a camera nobody described: one focal length, one radial distortion."""

_MAX_CAMERA_FILE_BYTES = 1 << 20
_HELP = (
    "use a COLMAP camera (PINHOLE,fx,fy,cx,cy), a cameras.txt or camera.txt, a KITTI calib.txt, "
    "or a focal length in px"
)


@dataclass(frozen=True, kw_only=True)
class CameraChoice:
    """A camera and where it came from."""

    camera: pycolmap.Camera
    source: str
    """One phrase for the report, such as ``"KITTI calibration calib.txt"``."""
    is_prior: bool
    """True when the focal length is a guess: the mapper refines it after a first model."""


def parse_camera(text: str | None, width: int, height: int) -> CameraChoice:
    """Turn the value of ``--camera`` into a camera of the video's size.

    Parameters
    ----------
    text : str or None
        A COLMAP camera string (``"PINHOLE,fx,fy,cx,cy"``, ``"PINHOLE 1241 376 fx fy cx cy"``), the
        path of a COLMAP camera file or of a KITTI calibration file, or a focal length in px.
        None gives a prior of ``1.2 * max(width, height)``.
    width, height : int
        Size of the video in px.

    Returns
    -------
    CameraChoice
        Principal point in px from the upper-left image corner.

    Raises
    ------
    DataError
        The text is none of these, or describes images of another shape.
    """
    if width <= 0 or height <= 0:
        raise ValueError(f"image size must be positive, got {width}x{height}")
    if text is None or not text.strip():
        return _prior(width, height)
    text = text.strip()
    if _is_number(text):
        return _from_focal(float(text), width, height)
    if _looks_like_camera(text):
        return _from_tokens(_tokens(text), width, height, source="camera given as text")
    path = Path(text)
    if not path.is_file():
        raise DataError(f"camera {text!r} is neither a camera nor an existing file; {_HELP}")
    return _from_file(path, width, height)


def _prior(width: int, height: int) -> CameraChoice:
    focal = PRIOR_FOCAL_FACTOR * max(width, height)
    params = [focal, width / 2, height / 2, 0.0]
    camera = _make(PRIOR_MODEL, width, height, params, "the default camera")
    camera.has_prior_focal_length = False
    source = f"prior: focal length {focal:g} px = {PRIOR_FOCAL_FACTOR:g} x the longer side"
    return CameraChoice(camera=camera, source=source, is_prior=True)


def _from_focal(focal: float, width: int, height: int) -> CameraChoice:
    if not 0 < focal < float("inf"):
        raise DataError(f"focal length must be a positive number of px, got {focal:g}")
    params = [focal, width / 2, height / 2]
    camera = _make("SIMPLE_PINHOLE", width, height, params, "the focal length")
    return CameraChoice(
        camera=camera, source=f"focal length {focal:g} px given as number", is_prior=False
    )


def _from_file(path: Path, width: int, height: int) -> CameraChoice:
    if path.stat().st_size > _MAX_CAMERA_FILE_BYTES:
        raise DataError(f"camera file {path} is larger than 1 MiB, so it is not one; {_HELP}")
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise DataError(f"camera file {path} is not text; {_HELP}") from error
    lines = [line.strip() for line in text.splitlines()]
    lines = [line for line in lines if line and not line.startswith("#")]
    cameras = [line for line in lines if _looks_like_camera(line)]
    if len(cameras) > 1:
        raise DataError(f"camera file {path} holds {len(cameras)} cameras; keep one")
    if cameras:
        return _from_tokens(_tokens(cameras[0]), width, height, source=f"COLMAP camera {path.name}")
    kitti = _kitti_row(lines)
    if kitti is not None:
        fx, _, cx, _, _, fy, cy = kitti[:7]
        camera = _make(
            "PINHOLE", width, height, [fx, fy, cx + 0.5, cy + 0.5], f"the calibration in {path}"
        )
        _check_principal_point(camera, path)
        return CameraChoice(camera=camera, source=f"KITTI calibration {path.name}", is_prior=False)
    if len(lines) == 1 and _is_number(lines[0]):
        return _from_focal(float(lines[0]), width, height)
    raise DataError(f"camera file {path} holds no camera that mvmatch can read; {_HELP}")


def _kitti_row(lines: list[str]) -> list[float] | None:
    """Return the left camera's 3x4 projection: the row named P0, else P2, else the first row."""
    rows: dict[str, list[float]] = {}
    for line in lines:
        name, _, values = line.rpartition(":")
        numbers = values.split()
        if len(numbers) == 12 and all(_is_number(number) for number in numbers):
            rows.setdefault(name.strip() or "first", [float(number) for number in numbers])
    for name in ("P0", "P_rect_00", "P2", "P_rect_02", "first"):
        if name in rows:
            row = rows[name]
            return row if row[0] > 0 and row[5] > 0 else None
    return None


def _check_principal_point(camera: pycolmap.Camera, path: Path) -> None:
    inside_x = 0 < camera.principal_point_x < camera.width
    inside_y = 0 < camera.principal_point_y < camera.height
    if not (inside_x and inside_y):
        raise DataError(
            f"the principal point in {path} lies outside the {camera.width}x{camera.height} video; "
            "the calibration belongs to images of another size"
        )


def _from_tokens(tokens: list[str], width: int, height: int, *, source: str) -> CameraChoice:
    import pycolmap

    if tokens[0].isdigit():  # the camera id of a cameras.txt line
        tokens = tokens[1:]
    name = tokens[0].upper()
    try:
        values = [float(token) for token in tokens[1:]]
    except ValueError as error:
        raise DataError(f"camera parameters must be numbers: {' '.join(tokens)!r}") from error
    expected = len(pycolmap.Camera.create_from_model_name(1, name, 1.0, width, height).params)
    if len(values) == expected:
        camera = _make(name, width, height, values, source)
    elif len(values) == expected + 2:
        given_width, given_height = int(values[0]), int(values[1])
        camera = _make(name, given_width, given_height, values[2:], source)
        _fit_to_size(camera, width, height)
    else:
        info = pycolmap.Camera.create_from_model_name(1, name, 1.0, width, height).params_info
        raise DataError(
            f"{name} takes {expected} parameters ({info}), with width and height before them or "
            f"without; got {len(values)} numbers"
        )
    return CameraChoice(camera=camera, source=f"{source} ({name})", is_prior=False)


def _fit_to_size(camera: pycolmap.Camera, width: int, height: int) -> None:
    if (camera.width, camera.height) == (width, height):
        return
    same_shape = abs(camera.width * height - camera.height * width) <= max(width, height)
    if not same_shape:
        raise DataError(
            f"the camera is for {camera.width}x{camera.height} images, the video is "
            f"{width}x{height}: another shape; give the camera of this video"
        )
    camera.rescale(width, height)


def _make(name: str, width: int, height: int, params: list[float], source: str) -> pycolmap.Camera:
    import pycolmap

    if width <= 0 or height <= 0:
        raise DataError(f"{source}: image size must be positive, got {width}x{height}")
    camera = pycolmap.Camera.create_from_model_name(1, name, 1.0, width, height)
    camera.params = params
    camera.has_prior_focal_length = True
    focals = [params[index] for index in camera.focal_length_idxs()]
    finite = all(abs(value) < float("inf") for value in params)
    if not finite or any(focal <= 0 for focal in focals):
        raise DataError(f"{source}: parameters must be finite and focal lengths positive: {params}")
    return camera


def _tokens(text: str) -> list[str]:
    return [token for token in re.split(r"[,\s]+", text) if token]


def _looks_like_camera(text: str) -> bool:
    import pycolmap

    tokens = _tokens(text)
    if len(tokens) > 1 and tokens[0].isdigit():
        tokens = tokens[1:]
    known = pycolmap.CameraModelId.__members__
    return len(tokens) > 1 and tokens[0].upper() in known and tokens[0].upper() != "INVALID"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
