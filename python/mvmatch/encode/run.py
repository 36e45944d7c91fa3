"""Encode for matching: pick the encoder, run it, check the result, put it in place."""

# PyAV types its packets and streams only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import os
import time
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from mvmatch.encode import executable as ffmpeg
from mvmatch.encode import svt
from mvmatch.encode.check import EncodingCheck, EncodingChecker
from mvmatch.encode.frames import open_frames
from mvmatch.encode.options import EncodeOptions, EncodeResult
from mvmatch.encode.status import require_encoder
from mvmatch.errors import DataError, MvmatchError

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence

    from mvmatch.encode.frames import FrameSource
    from mvmatch.types import StrPath

OUTPUT_SUFFIXES = (".ivf", ".mkv", ".mp4", ".webm")
"""Containers that can be written, by file name ending."""


def encode_video(
    source: StrPath,
    out: StrPath,
    *,
    options: EncodeOptions | None = None,
    progress: Callable[[int, int | None], None] | None = None,
) -> EncodeResult:
    """Encode a folder of images or a video into AV1 that is made for matching.

    8-bit 4:2:0 at the size of the source, odd sizes included. One key frame, references in the
    past only. ``out`` appears when it is complete, or not at all.

    Parameters
    ----------
    source : folder of at least two images of one size (natural order), or a video FFmpeg decodes.
    out : file to write; the ending chooses the container (``.ivf``, ``.mkv``, ``.mp4``, ``.webm``).
    options : encoder and its settings.
    progress : called after each frame with (frames done, frames in all or None).

    Returns
    -------
    Facts about the result; ``warnings`` says what will hurt matching.

    Raises
    ------
    FileNotFoundError : nothing at ``source``.
    DataError : unusable source (mixed sizes, one image, no video) or ``out`` cannot be written.
    UnsupportedError : the encoder is not available; the message lists those that are.
    """
    options = options or EncodeOptions()
    source, out = Path(source), Path(out)
    if out.suffix.lower() not in OUTPUT_SUFFIXES:
        raise DataError(
            f"{out}: cannot write a {out.suffix or 'nameless'} file. "
            f"Choose one of {', '.join(OUTPUT_SUFFIXES)}."
        )
    wall, cpu = time.perf_counter(), _cpu_seconds()
    frames = open_frames(source, frame_rate=options.frame_rate, max_frames=options.max_frames)
    status = require_encoder(options.encoder)
    with _scratch_beside(out) as scratch:
        raw, final = scratch / "encoded.ivf", scratch / f"final{out.suffix.lower()}"
        if options.encoder == "svt":
            settings = " ".join(f"{k}={v}" for k, v in svt.svt_settings(options).items())
            times = svt.encode_to_ivf(frames, raw, options=options, progress=progress)
        else:
            assert status.executable is not None
            name = options.encoder
            settings = str(
                ffmpeg.encoder_arguments(
                    name, quality=options.quality, speed=options.speed, usage=options.usage
                )
            )
            times = ffmpeg.encode_to_ivf(
                frames, raw,
                options=options, name=name, executable=status.executable, progress=progress,
            )  # fmt: skip
        num_bytes = _copy_packets(raw, final, frames, times)
        check, doubts = _check(raw) if options.check else (None, ())
        final.replace(out)
    return EncodeResult(
        path=out,
        encoder=options.encoder,
        settings=settings,
        num_frames=len(times),
        width=frames.width,
        height=frames.height,
        image_names=frames.image_names,
        num_bytes=num_bytes,
        seconds=time.perf_counter() - wall,
        cpu_seconds=_cpu_seconds() - cpu,
        check=check,
        warnings=(*frames.warnings, *doubts),
    )


def _copy_packets(raw: Path, final: Path, frames: FrameSource, times: Sequence[int]) -> int:
    """Copy packets into the wanted container with the source's times; return their bytes."""
    import av

    num_bytes = 0
    with av.open(str(raw)) as reader, av.open(str(final), "w") as writer:
        stream = reader.streams.video[0]
        copy = writer.add_stream_from_template(stream, opaque=True)
        if _coincide(frames, times):  # a variable rate: IVF would count in frame durations
            copy.time_base = frames.time_base
        packets = (packet for packet in reader.demux(stream) if packet.size)
        for index, packet in enumerate(packets):
            num_bytes += packet.size
            if index < len(times):
                packet.pts = packet.dts = times[index]
                packet.time_base = frames.time_base
            packet.stream = copy
            writer.mux(packet)
    return num_bytes


def _coincide(frames: FrameSource, times: Sequence[int]) -> bool:
    """Whether two times are the same one when they are counted in frame durations."""
    durations = [round(time * frames.time_base * frames.frame_rate) for time in times]
    return len(set(durations)) < len(durations)


def _check(raw: Path) -> tuple[EncodingCheck | None, tuple[str, ...]]:
    """Read an IVF file with mvmatch's parser; a failure is only a warning."""
    from mvmatch import _core

    checker = EncodingChecker()
    try:
        parser, reader = _core.Av1Parser(), _core.ContainerReader(str(raw))
        while (unit := reader.next_unit()) is not None:
            parser.push(unit[1])
            while (frame := parser.next_frame()) is not None:
                checker.push(frame)
    except MvmatchError as error:
        return None, (f"the result could not be checked: {error}",)
    check = checker.result()
    return check, check.warnings()


@contextmanager
def _scratch_beside(out: Path) -> Generator[Path]:
    """Give a temporary folder next to ``out``, so that the final rename is atomic."""
    if out.is_dir():
        raise DataError(f"{out}: is a folder. Give the name of a file to write.")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        scratch = TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent)
    except OSError as error:
        raise DataError(
            f"{out}: cannot write here ({error.strerror}). Choose another place."
        ) from error
    with scratch as folder:
        yield Path(folder)


def _cpu_seconds() -> float:
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system
