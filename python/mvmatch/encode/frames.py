"""Pictures from a folder of images or from a video, as 8-bit 4:2:0 frames of one size."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import chain, islice
from typing import TYPE_CHECKING

from mvmatch.errors import DataError, UnsupportedError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from av import VideoFrame
    from av.container import InputContainer
    from av.video.stream import VideoStream

IMAGE_SUFFIXES = frozenset(
    {".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp"}
)
"""File name endings that count as images of a folder."""


@dataclass(kw_only=True)
class FrameSource:
    """Frames to encode; iterate once. Warnings fill up during iteration."""

    path: Path
    width: int
    height: int
    num_frames: int | None
    """None when a video does not say."""
    frame_rate: Fraction
    time_base: Fraction
    """Unit of ``VideoFrame.pts`` in s."""
    image_names: tuple[str, ...] | None = None
    warnings: list[str] = field(default_factory=list[str])

    def __iter__(self) -> Iterator[VideoFrame]:
        """Yield frames in yuv420p with strictly increasing ``pts``."""
        return _images(self) if self.image_names is not None else _video(self)


def open_frames(source: Path, *, frame_rate: float, max_frames: int | None) -> FrameSource:
    """Look at a folder of images or a video without reading it all.

    Parameters
    ----------
    source : folder (images in natural order: ``2.png`` before ``10.png``) or video file.
    frame_rate : frames per s given to a folder of images.
    max_frames : upper limit of frames, None for all.

    Raises
    ------
    FileNotFoundError : nothing at ``source``.
    DataError : fewer than two images, no readable picture, or an unreadable file.
    """
    if not source.exists():
        raise FileNotFoundError(f"{source}: there is no such file or folder")
    if max_frames is not None and max_frames < 2:
        raise ValueError("max_frames must be at least 2: one frame has no motion")
    if source.is_dir():
        return _open_folder(source, Fraction(frame_rate).limit_denominator(1001), max_frames)
    return _open_video(source, max_frames)


def natural_key(name: str) -> tuple[tuple[int, int | str], ...]:
    """Sorting key that orders the numbers in a name by value.

    >>> sorted(["10.png", "9.png", "a2.png"], key=natural_key)
    ['9.png', '10.png', 'a2.png']
    """
    parts = re.split(r"(\d+)", name.casefold())
    return tuple((0, int(part)) if part.isdigit() else (1, part) for part in parts if part)


def _open_folder(folder: Path, frame_rate: Fraction, max_frames: int | None) -> FrameSource:
    files = [file for file in folder.iterdir() if file.suffix.lower() in IMAGE_SUFFIXES]
    names = sorted((file.name for file in files if not file.name.startswith(".")), key=natural_key)
    if len(names) < 2:
        found = f"only one image ({names[0]})" if names else "no images"
        raise DataError(
            f"{folder}: {found}, but motion needs at least two. "
            f"Give a folder that holds the frames themselves ({', '.join(sorted(IMAGE_SUFFIXES))})."
        )
    names = names[:max_frames]
    first = _read_image(folder / names[0])
    return FrameSource(
        path=folder,
        width=first.width,
        height=first.height,
        num_frames=len(names),
        frame_rate=frame_rate,
        time_base=1 / frame_rate,
        image_names=tuple(names),
    )


def _open_video(path: Path, max_frames: int | None) -> FrameSource:
    import av
    from av.error import FFmpegError

    try:
        with av.open(str(path)) as container:
            if not container.streams.video or container.format.name == "tty":
                raise DataError(f"{path}: the file has no video stream. Give a video or images.")
            stream = container.streams.video[0]
            width, height = stream.codec_context.width, stream.codec_context.height
            frame_rate = stream.average_rate or stream.guessed_rate or Fraction(30)
            time_base = stream.time_base or 1 / frame_rate
            num_frames = stream.frames or None
            aspect = stream.sample_aspect_ratio
    except FFmpegError as error:
        raise DataError(
            f"{path}: FFmpeg cannot read this as a video ({_reason(error)}). "
            "Give a video file or a folder of images."
        ) from error
    if num_frames is not None and max_frames is not None:
        num_frames = min(num_frames, max_frames)
    elif max_frames is not None:
        num_frames = max_frames
    if width < 1 or height < 1:
        raise DataError(f"{path}: FFmpeg finds a video stream without a picture size in it.")
    warnings: list[str] = []
    if aspect and aspect != 1:
        warnings.append(
            f"{path}: pixels are shown {float(aspect):.3g} times as wide as high. Frames are "
            f"encoded as stored, so give a camera with fy = {float(aspect):.3g} fx"
        )
    return FrameSource(
        path=path,
        width=width,
        height=height,
        num_frames=num_frames,
        frame_rate=frame_rate,
        time_base=time_base,
        warnings=warnings,
    )


def _images(source: FrameSource) -> Iterator[VideoFrame]:
    assert source.image_names is not None
    names = source.image_names
    for index, name in enumerate(names):
        frame = _read_image(source.path / name)
        if (frame.width, frame.height) != (source.width, source.height):
            raise DataError(
                f"{source.path}: images of different sizes: {names[0]} is "
                f"{source.width}x{source.height} but {name} is {frame.width}x{frame.height}. "
                "All frames of a video need the same size; separate or resize them."
            )
        _note_rotation(source, frame, name)
        yield _convert(frame, pts=index, time_base=source.time_base)


def _read_image(path: Path) -> VideoFrame:
    import av
    from av.error import FFmpegError

    try:
        with av.open(str(path)) as container:
            for frame in container.decode(video=0):
                return frame
    except (FFmpegError, IndexError) as error:
        reason = _reason(error) if isinstance(error, FFmpegError) else "no picture in it"
        raise DataError(
            f"{path}: cannot be read as an image ({reason}). Remove or replace it."
        ) from error
    raise DataError(f"{path}: holds no picture. Remove or replace it.")


def _video(source: FrameSource) -> Iterator[VideoFrame]:
    import av

    with av.open(str(source.path)) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        step = _frame_duration(stream, source.time_base)
        broken: Counter[str] = Counter()
        frames = islice(_decoded(container, stream, broken), source.num_frames)
        # Both at once, so that an encoder is not started for one frame.
        start = list(islice(frames, 2))
        if len(start) < 2:
            raise DataError(_too_short(source, len(start), broken))
        last_pts, count = None, 0
        for count, frame in enumerate(chain(start, frames)):
            if (frame.width, frame.height) != (source.width, source.height):
                raise DataError(
                    f"{source.path}: the picture changes from {source.width}x{source.height} to "
                    f"{frame.width}x{frame.height} at frame {count}. Cut the video there."
                )
            _note_rotation(source, frame, f"frame {count}")
            pts = frame.pts
            if last_pts is None:
                pts = 0 if pts is None else pts
            elif pts is None or pts <= last_pts:
                pts = last_pts + step
            last_pts = pts
            yield _convert(frame, pts=pts, time_base=source.time_base)
    if broken:
        places = broken.total()
        source.warnings.append(
            f"{source.path}: damaged in {places} {'place' if places == 1 else 'places'} "
            f"({next(iter(broken))}): what could not be decoded is left out, "
            f"{count + 1} frames were encoded"
        )


def _decoded(
    container: InputContainer, stream: VideoStream, broken: Counter[str]
) -> Iterator[VideoFrame]:
    """Yield what can be decoded; count errors and go on with the next packet."""
    from av.error import FFmpegError

    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets)
        except StopIteration:
            return
        except FFmpegError as error:  # the container itself breaks off
            broken[_reason(error)] += 1
            return
        try:
            yield from packet.decode()
        except FFmpegError as error:
            broken[_reason(error)] += 1


def _too_short(source: FrameSource, count: int, broken: Counter[str]) -> str:
    found = "no frame" if count == 0 else "only one frame"
    if broken:
        return f"{source.path}: {found} can be decoded ({next(iter(broken))})."
    return f"{source.path}: has {found}, but motion needs at least two. Give a longer video."


def _frame_duration(stream: VideoStream, time_base: Fraction) -> int:
    rate = stream.average_rate or Fraction(30)
    return max(1, round(1 / (rate * time_base)))


def _note_rotation(source: FrameSource, frame: VideoFrame, where: str) -> None:
    if frame.rotation and not any("rotation" in warning for warning in source.warnings):
        source.warnings.append(
            f"{where} carries a rotation of {frame.rotation} degrees for display; "
            "frames are encoded as stored and the model refers to the stored orientation"
        )


def _convert(frame: VideoFrame, *, pts: int, time_base: Fraction) -> VideoFrame:
    from av.video.frame import PictureType

    try:
        converted = frame.reformat(format="yuv420p")
    except ValueError as error:
        raise UnsupportedError(
            f"pixel format {frame.format.name} cannot become 8-bit 4:2:0"
        ) from error
    # Decoded frames say "I", which libsvtav1 obeys: every frame would become a key frame.
    converted.pict_type = PictureType.NONE
    converted.pts = pts
    converted.time_base = time_base
    return converted


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)
