"""AV1 through our own parser: IVF, Section 5 and Annex B natively, other containers demuxed."""

from __future__ import annotations

import contextlib
import dataclasses
import os
from typing import TYPE_CHECKING, cast

import numpy as np

from mvmatch import _core
from mvmatch.errors import BitstreamError, DataError, MvmatchError
from mvmatch.sources.base import unsupported_codec
from mvmatch.sources.frames import FrameFacts, FrameLog
from mvmatch.sources.matroska import missing_bytes
from mvmatch.sources.options import ReadOptions, Skipped
from mvmatch.types import MotionField, VideoInfo

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from fractions import Fraction
    from pathlib import Path
    from types import TracebackType

    from av import CodecContext, VideoStream
    from av.container import InputContainer

    Unit = tuple[float | None, bytes, int]
    """Presentation time in s, the bytes of one temporal unit, where they start in the file."""

_SHARED_COLUMNS = (
    "block",
    "mv",
    "ref_frame",
    "flags",
    "segment_id",
    "qindex",
    "residual",
    "warp",
)
_FINE_CLOCK = 1000.0
"""Hz; an IVF file that counts so fine has frames at any distance, and says no rate."""


class Av1Source:
    """Motion fields of one AV1 stream; see :class:`~mvmatch.sources.base.MotionSource`.

    Parameters
    ----------
    path : Path
        The file, for messages.
    units : iterator of (pts in s or None, bytes, byte offset)
        Temporal units in decode order.
    close : callable
        Releases the container.
    options : ReadOptions, optional
        What the stream may cost, what happens where it is damaged, and which layers are read.
    num_frames, frame_rate
        What the container says, None when it does not.
    """

    def __init__(
        self,
        path: Path,
        units: Iterator[Unit],
        *,
        close: Callable[[], None],
        options: ReadOptions | None = None,
        num_frames: int | None = None,
        frame_rate: float | None = None,
    ) -> None:
        self._path = path
        self._units = units
        self._close = close
        options = options or ReadOptions()
        self._resumes = options.errors == "resume"
        self._skipped: list[Skipped] = []
        self._parser = _core.Av1Parser(
            limits=options.limits,
            operating_point=options.operating_point,
            threads=options.threads or os.cpu_count() or 1,
        )
        self._frames = FrameLog()
        self._num_units = 0
        self._times: dict[int, float | None] = {}
        self._is_ended = False
        self._failure: MvmatchError | None = None
        try:
            first = self._next_coded()
        except BaseException:
            close()
            raise
        if first is None:
            close()
            message = f"{path}: the file ends before its first AV1 frame"
            if self._skipped:
                message = f"{path} has no frame that can be read. {self._skipped[0]}"
            raise BitstreamError(message)
        self._first: tuple[_core.CodedFrame, float | None] | None = first
        width, height = _output_size(first[0], options.operating_point)
        self._info = VideoInfo(
            width=width,
            height=height,
            num_frames=num_frames,
            frame_rate=frame_rate,
            codec="av1",
        )

    @property
    def info(self) -> VideoInfo:
        """What is known about the video before it is read."""
        return self._info

    @property
    def frames(self) -> Sequence[FrameFacts]:
        """Header facts of the frames read so far."""
        return self._frames

    @property
    def skipped(self) -> Sequence[Skipped]:
        """What could not be read so far, one item for each run of errors."""
        return self._skipped

    def __enter__(self) -> Av1Source:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._close()

    def __iter__(self) -> Iterator[MotionField]:
        """Yield the field of every coded frame; damage raises after them, or is skipped."""
        for coded, pts in self.coded_frames():
            if not coded.show_existing_frame:
                yield _field(coded, pts, size=(self._info.width, self._info.height))

    def coded_frames(self) -> Iterator[tuple[_core.CodedFrame, float | None]]:
        """Yield every coded frame, and every order to show one again, with its time in s."""
        while True:
            timed, self._first = self._first or self._next_coded(), None
            if timed is None:
                return
            coded, pts = timed
            self._frames.append(_facts(coded, pts))
            yield coded, pts

    def _next_coded(self) -> tuple[_core.CodedFrame, float | None] | None:
        """Return the next frame that can be read, and its time, or None at the end."""
        while True:
            try:
                coded = self._advance()
            except BitstreamError as error:
                if not self._resumes:
                    raise _located(error, self._path, frame=len(self._frames)) from error
                self._skip(error)
            except MvmatchError as error:
                raise _located(error, self._path, frame=len(self._frames)) from error
            else:
                return None if coded is None else (coded, self._time(coded.unit_index))

    def _advance(self) -> _core.CodedFrame | None:
        while (coded := self._parser.next_frame()) is None:
            if self._is_ended:
                failure, self._failure = self._failure, None
                if failure is not None:
                    raise failure
                return None
            unit = self._next_unit()
            if unit is None:
                self._is_ended = True
                self._parser.finish()
                continue
            self._times[self._num_units], data, offset = unit
            self._num_units += 1
            self._parser.push(data, offset)
        return coded

    def _next_unit(self) -> Unit | None:
        """Return the next unit; a container that fails ends, and says so after its last frame."""
        try:
            return next(self._units, None)
        except MvmatchError as error:
            self._failure = error
            return None

    def _time(self, unit_index: int) -> float | None:
        """Return the time of a unit; those before it are not asked for again."""
        for earlier in [index for index in self._times if index < unit_index]:
            del self._times[earlier]
        return self._times[unit_index]

    def _skip(self, error: BitstreamError) -> None:
        """Keep what an error says; errors in a row are one item, so that the list stays short."""
        if self._skipped and self._skipped[-1].after_frame == len(self._frames):
            last = self._skipped[-1]
            self._skipped[-1] = dataclasses.replace(last, num_errors=last.num_errors + 1)
            return
        self._skipped.append(
            Skipped(
                after_frame=len(self._frames),
                num_errors=1,
                byte_offset=error.byte_offset,
                section=error.section,
                reason=str(error),
            )
        )


def open_elementary(path: Path, *, options: ReadOptions | None = None) -> Av1Source:
    """Open an IVF file, a Section 5 OBU stream or an Annex B stream.

    Raises
    ------
    DataError
        The file is none of them.
    NotAv1Error
        It is an IVF file of another codec.
    BitstreamError
        It is damaged before the first frame is complete.
    """
    with path.open("rb") as file:
        head = file.read(32)
    if head.startswith(b"DKIF") and len(head) >= 12 and head[8:12] != b"AV01":
        raise unsupported_codec(path, head[8:12].decode("ascii", "replace").strip("\0 "))
    try:
        reader = _core.ContainerReader(str(path), limits=(options or ReadOptions()).limits)
    except MvmatchError as error:
        raise _located(error, path) from error
    time_base = reader.time_base
    frame_rate = time_base[1] / time_base[0] if time_base and time_base[0] else None
    if frame_rate is not None and frame_rate >= _FINE_CLOCK:
        frame_rate = None

    def units() -> Iterator[Unit]:
        while (unit := reader.next_unit()) is not None:
            pts, data, offset = unit
            seconds = None
            if pts is not None and time_base is not None and time_base[1]:
                seconds = pts * time_base[0] / time_base[1]
            yield seconds, data, offset

    return Av1Source(path, units(), close=_nothing, options=options, frame_rate=frame_rate)


def open_demuxed(path: Path, *, options: ReadOptions | None = None) -> Av1Source:
    """Open MP4, MKV, WebM or whatever else FFmpeg demuxes; packets only, nothing is decoded.

    Raises
    ------
    DataError
        FFmpeg does not recognise the file, or there is no video in it.
    NotAv1Error
        The video is of another codec.
    BitstreamError
        It is damaged before the first frame is complete.
    """
    import av
    from av.error import FFmpegError

    try:
        container = av.open(str(path), metadata_errors="replace")
    except (FFmpegError, OSError) as error:
        message = (
            f"{path} is not a video that can be read ({_reason(error)}). "
            "Give AV1 as IVF, OBU, MP4, MKV or WebM, any other video FFmpeg reads, "
            "or a folder of frames"
        )
        raise DataError(message) from error
    with contextlib.ExitStack() as cleanup:
        cleanup.callback(container.close)
        if not container.streams.video:
            message = f"{path} holds no video stream"
            raise DataError(message)
        stream = container.streams.video[0]
        # PyAV gives None where FFmpeg knows no decoder, whatever its types say.
        context = cast("CodecContext | None", stream.codec_context)
        if context is None:
            message = f"{path} holds video of a codec that its container does not name"
            raise DataError(message)
        codec = context.codec.canonical_name
        if codec != "av1":
            raise unsupported_codec(path, codec)
        rate: Fraction | None = stream.average_rate
        source = Av1Source(
            path,
            _packets(path, container, stream),
            close=container.close,
            options=options,
            num_frames=stream.frames or None,
            frame_rate=float(rate) if rate else None,
        )
        cleanup.pop_all()
    return source


def _packets(path: Path, container: InputContainer, stream: VideoStream) -> Iterator[Unit]:
    """Yield the packets of a demuxed stream; the first one is preceded by the codec's set-up."""
    from av.error import FFmpegError

    missing, count = _configuration_obus(stream.codec_context.extradata), 0
    try:
        for packet in container.demux(stream):
            if not packet.size:
                continue
            if packet.is_corrupt:
                message = f"packet {count} of the container is cut off or damaged"
                raise BitstreamError(message)
            count += 1
            pts = packet.pts
            seconds = None if pts is None else float(pts * packet.time_base)
            yield seconds, missing + bytes(packet), packet.pos or 0
            missing = b""
    except FFmpegError as error:
        message = f"the container is damaged: {_reason(error)}"
        raise BitstreamError(message) from error
    if lost := missing_bytes(path):
        message = f"the file ends after {count} frames, {lost} bytes before the end it announces"
        raise BitstreamError(message)
    if count < stream.frames:
        message = f"the file ends after {count} of {stream.frames} frames"
        raise BitstreamError(message)


def _located(error: MvmatchError, path: Path, *, frame: int | None = None) -> MvmatchError:
    """Return the same error with the file's name in front."""
    message = f"{path}: {error}"
    if isinstance(error, BitstreamError):
        return BitstreamError(
            message, section=error.section, byte_offset=error.byte_offset, frame=frame
        )
    return type(error)(message)


def _configuration_obus(extradata: bytes | None) -> bytes:
    """Return the OBUs of a container's AV1 configuration record.

    ``av1C`` (MP4, Matroska) is four bytes and then OBUs; the first byte is 0x81 (marker and
    version). Raw demuxers hand over bare OBUs. A stream whose packets repeat the sequence header
    is not harmed by seeing it once more.
    """
    if not extradata:
        return b""
    return extradata[4:] if extradata[0] == 0x81 else extradata


def _output_size(first: _core.CodedFrame, operating_point: int) -> tuple[int, int]:
    """Return (width, height) in px of the pictures that a player shows.

    Frames of one stream can have several sizes (spatial layers, or an encoder that saves bits);
    players bring them to that of the first one shown, which of several layers is the largest.
    """
    header = first.header()
    spatial_layers = header["operating_point_idc"][operating_point] >> 8
    if spatial_layers.bit_count() > 1:
        return header["max_frame_width"], header["max_frame_height"]
    return first.upscaled_width, first.height


def _facts(coded: _core.CodedFrame, pts: float | None) -> FrameFacts:
    intra = coded.frame_type in {"KEY", "INTRA_ONLY"}
    references = np.asarray(coded.ref_display_index)
    return FrameFacts(
        decode_index=coded.decode_index,
        display_index=coded.display_index,
        frame_type=coded.frame_type,
        is_shown=coded.is_output,
        is_repeat=coded.show_existing_frame,
        width=coded.upscaled_width,
        height=coded.height,
        base_q_idx=coded.base_q_idx,
        pts=pts if coded.is_output else None,
        ref_display_index=() if intra else tuple(int(index) for index in references),
    )


def _field(coded: _core.CodedFrame, pts: float | None, *, size: tuple[int, int]) -> MotionField:
    columns = coded.motion(size)
    return MotionField(
        frame=coded.display_index,
        decode_index=coded.decode_index,
        pts=pts if coded.is_output else None,
        width=size[0],
        height=size[1],
        is_key=coded.frame_type in {"KEY", "INTRA_ONLY"},
        is_shown=coded.is_output,
        **{name: columns[name] for name in _SHARED_COLUMNS},
    )


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)


def _nothing() -> None:
    """Native readers hold no resource."""
