"""SVT-AV1 inside PyAV: the encoder that is always there."""

# PyAV types its packets and streams only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import logging
import os
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from mvmatch.encode.watch import StalledError, watched
from mvmatch.errors import MvmatchError

if TYPE_CHECKING:
    from collections.abc import Callable, Generator

    from mvmatch.encode.frames import FrameSource
    from mvmatch.encode.options import EncodeOptions

FFMPEG_NAME = "libsvtav1"

FLAT_PAST_REFERENCES = "pred-struct=1:rtc=1:hierarchical-levels=0"
"""Low delay without a hierarchy: nearly all vectors point to the previous frame. Without
``hierarchical-levels=0`` it is only about half of them."""

DETAIL_IN_FLAT_AREAS = "enable-variance-boost=1:variance-boost-strength=3"
"""Finer quantisers where the picture has little contrast: the vectors there follow the content
instead of the cheapest code. Measured in docs/explanation/encoding.md."""

PATIENCE = 120.0
"""s without a further frame, after which SVT is taken to have stopped."""

_TRIES = 3
_THREADS = Path("/proc/self/task")

_logger = logging.getLogger(__name__)


def is_available() -> bool:
    """Whether this PyAV was built with SVT-AV1."""
    import av

    return FFMPEG_NAME in av.codecs_available


def svt_settings(options: EncodeOptions) -> dict[str, str]:
    """Return FFmpeg's options for SVT-AV1, made for matching."""
    return {
        "preset": str(8 if options.speed is None else options.speed),
        "crf": str(30 if options.quality is None else options.quality),
        "g": "9999",
        "svtav1-params": f"{FLAT_PAST_REFERENCES}:{DETAIL_IN_FLAT_AREAS}",
    }


def encode_to_ivf(
    frames: FrameSource,
    out: Path,
    *,
    options: EncodeOptions,
    progress: Callable[[int, int | None], None] | None,
) -> list[int]:
    """Encode into an IVF file.

    Once in some thousand runs on a busy machine, all of SVT's threads wait for each other and none
    comes back (4.1.0, low delay). So it is watched, and started anew.

    Returns
    -------
    Presentation time of each frame in units of ``frames.time_base``.

    Raises
    ------
    MvmatchError
        It stopped again and again.
    """
    for _ in range(_TRIES):
        try:
            return watched(
                lambda tell: encode_once(frames, out, options, tell), progress, patience=PATIENCE
            )
        except StalledError:
            _logger.warning("SVT-AV1 stopped working; %s is encoded anew", frames.path)
            out.unlink(missing_ok=True)  # what was left behind must not write into the new file
    message = (
        f"{frames.path}: SVT-AV1 stopped working {_TRIES} times, each time for {PATIENCE:.0f} s. "
        "Try another encoder (mvmatch encoders lists them)"
    )
    raise MvmatchError(message)


def encode_once(
    frames: FrameSource,
    out: Path,
    options: EncodeOptions,
    tell: Callable[[int, int | None], None],
) -> list[int]:
    """Encode on this thread, for as long as it takes."""
    import av

    times: list[int] = []
    with _quiet(), av.open(str(out), "w", format="ivf") as container:
        stream = container.add_stream(FFMPEG_NAME, rate=frames.frame_rate)
        stream.width, stream.height, stream.pix_fmt = frames.width, frames.height, "yuv420p"
        stream.options = {**svt_settings(options)}
        for frame in frames:
            if not times:
                # Images use all 256 values, most video does not: players have to know.
                stream.codec_context.color_range = frame.color_range
                with ordinary_scheduling():
                    container.start_encoding()
            times.append(frame.pts or 0)
            # The real times come back when the packets are copied: SVT wants a steady clock.
            frame.pts, frame.time_base = len(times) - 1, 1 / frames.frame_rate
            container.mux(stream.encode(frame))
            tell(len(times), frames.num_frames)
        container.mux(stream.encode(None))
    return times


@contextmanager
def ordinary_scheduling() -> Generator[None]:
    """Undo what SVT does for the super-user on Linux when it starts.

    It puts its threads and the one that calls it under SCHED_FIFO at the highest priority, for as
    long as the process lives, and so all that this process starts later: nothing else on the
    machine would run.
    """
    if not (hasattr(os, "sched_getscheduler") and _THREADS.is_dir()):
        yield
        return
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    before = set(_THREADS.iterdir())
    try:
        yield
    finally:
        started = {int(thread.name) for thread in set(_THREADS.iterdir()) - before}
        for thread in (0, *started):
            with suppress(ProcessLookupError):
                if os.sched_getscheduler(thread) != policy:
                    os.sched_setscheduler(thread, policy, parameters)


@contextmanager
def _quiet() -> Generator[None]:
    """Let SVT print errors only, unless the user asked for more: it writes to stderr itself."""
    if "SVT_LOG" in os.environ:
        yield
        return
    os.environ["SVT_LOG"] = "1"
    try:
        yield
    finally:
        del os.environ["SVT_LOG"]
