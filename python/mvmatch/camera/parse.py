"""The one door: whatever ``--camera`` was given becomes a camera of the video's size."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from mvmatch.camera.calibration import Calibration, CameraChoice, make_camera
from mvmatch.camera.fit import fit_camera
from mvmatch.camera.metadata import EXIF_SUFFIXES, recorded_focal, recorded_rotation
from mvmatch.camera.text import is_number, looks_like_colmap, read_colmap, read_lines
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from mvmatch.camera.metadata import RecordedFocal
    from mvmatch.types import StrPath

PRIOR_FOCAL_FACTOR = 1.2
"""Prior focal length over the longer image side (COLMAP's default, 45 degrees field of view)."""

PRIOR_MODEL = "SIMPLE_RADIAL"
"""Model of a camera nobody described: one focal length, one radial distortion."""

_MAX_TEXT_BYTES = 1 << 17
_MAX_JSON_BYTES = 1 << 26
"""A ``transforms.json`` holds a pose per frame."""
_HELP = (
    "use a COLMAP camera (PINHOLE,fx,fy,cx,cy), a cameras.txt or camera.txt, a KITTI calib.txt, "
    "a calibration of OpenCV, ROS or Kalibr (YAML), a transforms.json of nerfstudio, a picture or "
    "video that recorded its focal length, or a focal length in px"
)
_VIDEO_SUFFIXES = frozenset({".avi", ".m4v", ".mkv", ".mov", ".mp4", ".webm"})


def parse_camera(
    text: StrPath | None, width: int, height: int, *, pictures: StrPath | None = None
) -> CameraChoice:
    """Turn the value of ``--camera`` into a camera of the video's size.

    Parameters
    ----------
    text : str, path or None
        A COLMAP camera string (``"PINHOLE,fx,fy,cx,cy"``, ``"PINHOLE 1241 376 fx fy cx cy"``), the
        path of a COLMAP camera file, of a KITTI calibration, of a calibration by OpenCV
        (``cv2.FileStorage``), ROS (``camera_info``) or Kalibr, or of a ``transforms.json`` of
        nerfstudio, or a focal length in px. The path of an image, a folder of images or a video
        gives the focal length that it recorded, as a prior.
        None gives a prior: what ``pictures`` recorded, else ``1.2 * max(width, height)``.
    width, height : int
        Size of the video in px, as it is stored.
    pictures : path, optional
        The video or the folder of images itself: where to look for a focal length if ``text`` is
        None, and for the rotation with which a video is shown if a calibration is upright.

    Returns
    -------
    CameraChoice
        Principal point in px from the upper-left image corner. A calibration made at another
        resolution of the same shape is scaled, which ``warnings`` says.

    Raises
    ------
    DataError
        The text is none of these, describes images of another shape, or a camera that no COLMAP
        model describes.
    """
    text = None if text is None else os.fspath(text)
    pictures = None if pictures is None else Path(pictures)
    if width <= 0 or height <= 0:
        raise ValueError(f"image size must be positive, got {width}x{height}")
    if text is None or not text.strip():
        focal = None if pictures is None else recorded_focal(pictures)
        return _prior(focal, width, height)
    text = text.strip()
    if is_number(text):
        return _from_focal(float(text), width, height)
    if looks_like_colmap(text):
        calibration = read_colmap(text, source="camera given as text")
        return _fitted(calibration, width, height, pictures)
    path = Path(text)
    if not path.exists():
        raise DataError(f"camera {text!r} is neither a camera nor an existing file; {_HELP}")
    if path.is_dir() or path.suffix.lower() in EXIF_SUFFIXES | _VIDEO_SUFFIXES:
        focal = recorded_focal(path)
        if focal is None:
            raise DataError(f"{path} has recorded no focal length; {_HELP}")
        return _prior(focal, width, height)
    return _from_file(path, width, height, pictures)


def _prior(recorded: RecordedFocal | None, width: int, height: int) -> CameraChoice:
    if recorded is None:
        focal = PRIOR_FOCAL_FACTOR * max(width, height)
        reason = f"{PRIOR_FOCAL_FACTOR:g} x the longer side"
    else:
        focal = recorded.of_size(width, height)
        reason = recorded.source
    params = [focal, width / 2, height / 2, 0.0]
    camera = make_camera(PRIOR_MODEL, (width, height), params, "the default camera")
    camera.has_prior_focal_length = False
    source = f"prior: focal length {focal:g} px = {reason}"
    return CameraChoice(camera=camera, source=source, is_prior=True)


def _from_focal(focal: float, width: int, height: int) -> CameraChoice:
    if not 0 < focal < float("inf"):
        raise DataError(f"focal length must be a positive number of px, got {focal:g}")
    params = [focal, width / 2, height / 2]
    camera = make_camera("SIMPLE_PINHOLE", (width, height), params, "the focal length")
    return CameraChoice(
        camera=camera, source=f"focal length {focal:g} px given as number", is_prior=False
    )


def _from_file(path: Path, width: int, height: int, pictures: Path | None) -> CameraChoice:
    text = _read(path)
    calibration = _structured(path, text) or read_lines(path, text)
    if calibration is not None:
        return _fitted(calibration, width, height, pictures)
    if is_number(text.strip()):
        return _from_focal(float(text), width, height)
    raise DataError(f"camera file {path} holds no camera that mvmatch can read; {_HELP}")


def _read(path: Path) -> str:
    most = _MAX_JSON_BYTES if path.suffix.lower() == ".json" else _MAX_TEXT_BYTES
    if path.stat().st_size > most:
        raise DataError(
            f"camera file {path} is larger than {most >> 10} KiB, so it is not one; {_HELP}"
        )
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise DataError(f"camera file {path} is not text; {_HELP}") from error


def _structured(path: Path, text: str) -> Calibration | None:
    from mvmatch.camera.nerfstudio import read_nerfstudio
    from mvmatch.camera.robotics import read_robotics
    from mvmatch.camera.structured import read_mapping

    fields = read_mapping(path, text)
    if fields is None:
        return None
    return read_nerfstudio(path, fields) or read_robotics(path, fields)


def _fitted(
    calibration: Calibration, width: int, height: int, pictures: Path | None
) -> CameraChoice:
    rotation = 0
    # Asked only where it can matter: it takes the first picture of the video.
    if pictures is not None and calibration.size not in (None, (width, height)):
        rotation = recorded_rotation(pictures)
    return fit_camera(calibration, width, height, rotation=rotation)
