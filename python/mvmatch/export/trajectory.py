"""Camera paths of COLMAP models in the formats of TUM and KITTI.

Both hold poses camera-to-world in the units and axes of the model (x right, y down, z forward).
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.errors import DataError
from mvmatch.export.files import write_file
from mvmatch.export.model import images_by_frame

if TYPE_CHECKING:
    import pycolmap
    from numpy.typing import ArrayLike, NDArray

    from mvmatch.types import StrPath

_MAX_NAMED = 8
"""Missing frames that an error names one by one."""


def write_tum(
    model: pycolmap.Reconstruction, path: StrPath, *, times: ArrayLike | None = None
) -> None:
    """Write one line ``timestamp tx ty tz qx qy qz qw`` per image that has a pose.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Its image names carry frame numbers.
    path : path
        The text file.
    times : (F,) float, optional
        Time of every frame of the video in s, index = frame number. Without it the frame number
        is the timestamp.

    Raises
    ------
    DataError
        Names without frame numbers, times that do not increase or do not reach the last frame, or
        the file cannot be written.
    """
    path = Path(path)
    images = images_by_frame(model)
    frames = np.array(list(images), np.int64)
    stamps = frames.astype(np.float64)
    if times is not None:
        known = np.asarray(times, np.float64)
        if frames[-1] >= len(known):
            raise DataError(
                f"there are times of {len(known)} frames but the model has frame {frames[-1]}. "
                "Give one time per frame of the video, those without a pose included"
            )
        stamps = known[frames]
    if not np.isfinite(stamps).all() or (np.diff(stamps) <= 0).any():
        raise DataError("the times of the frames do not increase. Give times in s, in frame order")
    poses = [image.cam_from_world().inverse() for image in images.values()]
    rows = [
        [stamp, *pose.translation, *pose.rotation.quat]
        for stamp, pose in zip(stamps, poses, strict=True)
    ]
    write_file(path, _text(rows, "%.9f" + 7 * " %.17g"))


def write_kitti(model: pycolmap.Reconstruction, path: StrPath) -> range:
    """Write the 3x4 matrix camera-to-world of every frame, row by row, one line per frame.

    The format has no frame numbers: line k is the k-th frame from the first that has a pose.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Its image names carry frame numbers, and no frame between the first and the last is missing.
    path : path
        The text file.

    Returns
    -------
    range
        Frame numbers of the lines.

    Raises
    ------
    DataError
        Frames without a pose, names without frame numbers, or the file cannot be written.
    """
    path = Path(path)
    images = images_by_frame(model)
    frames = range(min(images), max(images) + 1)
    missing = len(frames) - len(images)
    if missing:
        holes = (frame for frame in frames if frame not in images)
        named = ", ".join(str(frame) for frame, _ in zip(holes, range(_MAX_NAMED), strict=False))
        more = f" and {missing - _MAX_NAMED} more" if missing > _MAX_NAMED else ""
        raise DataError(
            f"KITTI's format needs a pose for every frame, but {missing} of {len(frames)} have "
            f"none: {named}{more}. Use TUM's format (--to tum), which has timestamps"
        )
    rows = [image.cam_from_world().inverse().matrix().ravel() for image in images.values()]
    write_file(path, _text(rows, "%.17g"))
    return frames


def frame_times(source: StrPath) -> NDArray[np.float64]:
    """Read the times of the frames of a video, from its container or from a text file.

    Parameters
    ----------
    source : path
        A video, or a text file with one time in s per line (``#`` begins a comment).

    Returns
    -------
    (F,) float64
        s, index = frame number.

    Raises
    ------
    DataError
        Neither, or a video whose container has no times.
    """
    source = Path(source)
    with source.open("rb") as file:
        is_text = b"\0" not in file.read(4096)
    if is_text:
        return _read_times(source)
    times = _container_times(source)
    if not times:
        raise DataError(
            f"{source} carries no times of its frames. Give a text file with one time in s per "
            "frame, or --fps"
        )
    return np.array(times, np.float64)


def _read_times(path: Path) -> NDArray[np.float64]:
    lines = [
        line.partition("#")[0].strip() for line in path.read_text("utf-8", "replace").split("\n")
    ]
    try:
        times = np.array([float(line) for line in lines if line], np.float64)
    except ValueError as error:
        raise DataError(
            f"{path} is not a list of times ({error}). Give one time in s per line, or a video"
        ) from error
    if not len(times):
        raise DataError(f"{path} holds no times. Give one time in s per line, or a video")
    return times


def _container_times(path: Path) -> list[float]:
    """Read when a video's frames are shown, from its packets; no frame is decoded."""
    import av
    from av.error import FFmpegError
    from av.format import Flags

    try:
        with av.open(str(path)) as container:
            # FFmpeg invents 25 frames per s for bare streams.
            if container.format.flags & Flags.no_timestamps.value:
                return []
            if not container.streams.video:
                raise DataError(f"{path} has no video stream. Give a video or a list of times")
            stream = container.streams.video[0]
            unit = stream.time_base
            stamps = [packet.pts for packet in container.demux(stream) if packet.size]
    except FFmpegError as error:
        raise DataError(
            f"{path} cannot be read as a video ({error.strerror}). Give a video or a list of times"
        ) from error
    if unit is None or None in stamps:
        return []
    return [float(stamp * unit) for stamp in sorted(s for s in stamps if s is not None)]


def _text(rows: ArrayLike, form: str) -> str:
    text = StringIO()
    np.savetxt(text, np.asarray(rows, np.float64), fmt=form)
    return text.getvalue()
