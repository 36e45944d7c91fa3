"""What pictures and videos say of their own camera: a focal length, and which way is up."""

# PyAV types its containers only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mvmatch.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

EXIF_SUFFIXES = frozenset({".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp"})
"""File name endings of images that can carry EXIF."""

_FULL_FRAME_DIAGONAL = 43.27
"""mm; what a 35 mm equivalent refers to, 36x24 mm, rounded as COLMAP does."""
_VIDEO_KEYS = (
    "com.apple.quicktime.camera.focal_length.35mm_equivalent",
    "com.android.camera.focal_length.35mm_equivalent",
    "focal_length_35mm",
)
_MAX_FOCAL_CHANGE = 0.01
"""Relative difference of focal lengths that is rounding."""


@dataclass(frozen=True, kw_only=True)
class RecordedFocal:
    """A focal length that was recorded with the pictures."""

    factor: float
    """Focal length over the diagonal of the picture."""
    source: str

    def of_size(self, width: int, height: int) -> float:
        """Return px for pictures of a size in px."""
        return self.factor * math.hypot(width, height)


def recorded_focal(pictures: Path) -> RecordedFocal | None:
    """Look for a focal length in a folder of images, an image or a video.

    Raises
    ------
    DataError
        The images of the folder have different focal lengths: there is no one camera.
    """
    if pictures.is_dir():
        return _of_folder(pictures)
    if pictures.suffix.lower() in EXIF_SUFFIXES:
        return _of_image(pictures)
    return _of_video(pictures)


def recorded_rotation(video: Path) -> int:
    """Degrees, counter-clockwise, by which players turn a video's pictures; 0 where none is."""
    import av
    from av.error import FFmpegError

    if not video.is_file():
        return 0
    try:
        with av.open(str(video)) as container:
            for frame in container.decode(video=0):
                return frame.rotation
    except (FFmpegError, IndexError):
        pass  # whoever reads the pictures says what is wrong with them
    return 0


def _of_folder(folder: Path) -> RecordedFocal | None:
    files = [file for file in folder.iterdir() if file.suffix.lower() in EXIF_SUFFIXES]
    files = sorted(file for file in files if not file.name.startswith("."))
    if not files:
        return None
    first, last = _of_image(files[0]), _of_image(files[-1])
    if first is None or last is None:
        return None
    if abs(last.factor / first.factor - 1.0) > _MAX_FOCAL_CHANGE:
        raise DataError(
            f"{folder}: by their EXIF data {files[0].name} and {files[-1].name} have different "
            "focal lengths: the camera zoomed. One focal length cannot describe it"
        )
    return first


def _of_image(image: Path) -> RecordedFocal | None:
    import pycolmap

    bitmap = pycolmap.Bitmap.read(image, as_rgb=False)
    focal = None if bitmap is None else bitmap.exif_focal_length()
    if bitmap is None or focal is None or not (math.isfinite(focal) and focal > 0):
        return None
    return RecordedFocal(
        factor=focal / math.hypot(bitmap.width, bitmap.height), source=f"EXIF of {image.name}"
    )


def _of_video(video: Path) -> RecordedFocal | None:
    import av
    from av.error import FFmpegError

    try:
        with av.open(str(video)) as container:
            streams = container.streams.video
            facts = {**container.metadata, **(streams[0].metadata if streams else {})}
    except FFmpegError:
        return None
    millimetres = _equivalent(facts)
    if millimetres is None:
        return None
    return RecordedFocal(
        factor=millimetres / _FULL_FRAME_DIAGONAL,
        source=f"metadata of {video.name}, {millimetres:g} mm of 35 mm film",
    )


def _equivalent(facts: Mapping[str, str]) -> float | None:
    """Return the 35 mm equivalent in mm."""
    for key in _VIDEO_KEYS:
        try:
            value = float(facts[key])
        except (KeyError, ValueError):
            continue
        if math.isfinite(value) and value > 0:
            return value
    return None
