"""Encoders of an ffmpeg executable: libaom on the CPU, and the encoders of graphics cards."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from itertools import chain
from typing import IO, TYPE_CHECKING, Literal

from mvmatch.errors import DataError, UnsupportedError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from av import VideoFrame

    from mvmatch.encode.frames import FrameSource
    from mvmatch.encode.options import EncodeOptions

ExecutableEncoder = Literal["libaom", "nvenc", "qsv", "vaapi"]

FFMPEG_NAMES: dict[ExecutableEncoder, str] = {
    "libaom": "libaom-av1",
    "nvenc": "av1_nvenc",
    "qsv": "av1_qsv",
    "vaapi": "av1_vaapi",
}
"""Names of the encoders inside FFmpeg."""

EXTRA_HINT = "pip install 'mvmatch[encoders]'"

_LIST_SECONDS = 20
_PROBE_SECONDS = 20
_PROBE_SIZE = (320, 256)
_PROBE_FRAMES = 3


@dataclass(frozen=True, kw_only=True)
class EncoderArguments:
    """Arguments of one ffmpeg encoder around the raw input."""

    before_input: tuple[str, ...]
    after_input: tuple[str, ...]

    def __str__(self) -> str:
        return " ".join((*self.before_input, *self.after_input))


def encoder_arguments(
    name: ExecutableEncoder,
    *,
    quality: int | None = None,
    speed: int | None = None,
    usage: Literal["realtime", "good"] = "realtime",
) -> EncoderArguments:
    """Return settings for matching: one key frame, past references only, constant quality.

    References
    ----------
    libaom and NVENC follow Zouein et al., section III ("cpu-used 6", "preset 1").
    """
    codec = ("-c:v", FFMPEG_NAMES[name])
    one_key_frame = ("-g", "9999")
    if name == "libaom":
        quality, speed = _default(quality, 30), _default(speed, 6)
        return EncoderArguments(
            before_input=(),
            after_input=(
                *codec, "-usage", usage, "-cpu-used", str(speed), "-lag-in-frames", "0",
                "-crf", str(quality), "-b:v", "0", "-row-mt", "1", *one_key_frame,
            ),
        )  # fmt: skip
    if name == "nvenc":
        quality, speed = _default(quality, 120), _default(speed, 1)
        return EncoderArguments(
            before_input=(),
            after_input=(
                *codec, "-preset", f"p{speed}", "-tune", "hq", "-rc", "constqp",
                "-qp", str(quality), "-bf", "0", "-b_ref_mode", "0", *one_key_frame,
            ),
        )  # fmt: skip
    if name == "qsv":
        return EncoderArguments(
            before_input=(),
            after_input=(
                "-pix_fmt", "nv12", *codec, "-global_quality", str(_default(quality, 120)),
                "-bf", "0", "-look_ahead_depth", "0", *one_key_frame,
            ),
        )  # fmt: skip
    return EncoderArguments(
        before_input=("-vaapi_device", "/dev/dri/renderD128"),
        after_input=(
            "-vf", "format=nv12,hwupload", *codec, "-rc_mode", "CQP",
            "-global_quality", str(_default(quality, 128)), "-bf", "0", *one_key_frame,
        ),
    )  # fmt: skip


def ffmpeg_executables() -> list[str]:
    """Return the ffmpeg of this system and the one of the package imageio-ffmpeg, as available."""
    found: list[str] = []
    system = shutil.which("ffmpeg")
    if system:
        found.append(system)
    try:
        import imageio_ffmpeg  # pyright: ignore[reportMissingTypeStubs]

        found.append(str(imageio_ffmpeg.get_ffmpeg_exe()))
    except (ImportError, RuntimeError):
        pass
    return list(dict.fromkeys(found))


def find_executable(name: ExecutableEncoder) -> str | None:
    """Return the first ffmpeg executable that was built with an encoder, None without one."""
    for executable in ffmpeg_executables():
        if FFMPEG_NAMES[name] in _listed_encoders(executable):
            return executable
    return None


def _listed_encoders(executable: str) -> frozenset[str]:
    try:
        listing = subprocess.run(
            [executable, "-hide_banner", "-encoders"],
            capture_output=True, text=True, errors="replace", timeout=_LIST_SECONDS,
            stdin=subprocess.DEVNULL, check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return frozenset()
    words = (line.split() for line in listing.stdout.splitlines())
    return frozenset(word[1] for word in words if len(word) > 1)


def probe(executable: str, name: ExecutableEncoder) -> str | None:
    """Encode three small grey frames; return None when that works, else the reason."""
    width, height = _PROBE_SIZE
    grey = bytes([128]) * (width * height * 3 // 2 * _PROBE_FRAMES)
    command = _command(executable, encoder_arguments(name), width, height, "30")
    try:
        done = subprocess.run(
            [*command, "-f", "null", "-"],
            input=grey, capture_output=True, timeout=_PROBE_SECONDS, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"a test encode did not finish within {_PROBE_SECONDS} s"
    except OSError as error:
        return f"{executable} does not start ({error.strerror})"
    if done.returncode == 0:
        return None
    return first_reason(done.stderr.decode(errors="replace")) or f"exit code {done.returncode}"


def first_reason(stderr: str) -> str:
    r"""Return the first line of ffmpeg's error output without its component tag.

    >>> first_reason("[av1_nvenc @ 0x55] Cannot load libcuda.so.1\nError while opening encoder")
    'Cannot load libcuda.so.1'
    """
    for line in stderr.splitlines():
        text = line.split("] ", 1)[-1].strip() if line.startswith("[") else line.strip()
        if text:
            return text
    return ""


def encode_to_ivf(
    frames: FrameSource,
    out: Path,
    *,
    options: EncodeOptions,
    name: ExecutableEncoder,
    executable: str,
    progress: Callable[[int, int | None], None] | None,
) -> list[int]:
    """Pipe raw frames through ffmpeg into an IVF file.

    Returns
    -------
    Presentation time of each frame in units of ``frames.time_base``.

    Raises
    ------
    UnsupportedError : the encoder refuses; the message holds its first complaint.
    """
    arguments = encoder_arguments(
        name, quality=options.quality, speed=options.speed, usage=options.usage
    )
    rate = f"{frames.frame_rate.numerator}/{frames.frame_rate.denominator}"
    shown = iter(frames)
    first = next(shown)
    command = _command(
        executable, arguments, frames.width, frames.height, rate, is_full_range=_is_full(first)
    )
    times: list[int] = []
    with tempfile.TemporaryFile() as stderr:
        process = subprocess.Popen(
            [*command, "-f", "ivf", "-y", str(out)],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=stderr,
        )  # fmt: skip
        assert process.stdin is not None
        try:
            for frame in chain([first], shown):
                _write_planes(frame, process.stdin)
                times.append(frame.pts or 0)
                if progress is not None:
                    progress(len(times), frames.num_frames)
        except BrokenPipeError:
            pass  # ffmpeg ended early; its error output below says why
        except BaseException:
            process.kill()
            raise
        finally:
            # What is still buffered cannot be written to a process that has ended.
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
            process.wait()
        stderr.seek(0)
        reason = first_reason(stderr.read().decode(errors="replace"))
    code = process.returncode
    if code != 0:
        raise UnsupportedError(
            f"encoder {name} ({executable}) failed: {reason or f'exit code {code}'}. "
            "`mvmatch encoders` lists what works here."
        )
    if not times or not out.exists():
        raise DataError(f"{frames.path}: encoder {name} wrote nothing")
    return times


def _command(
    executable: str,
    arguments: EncoderArguments,
    width: int,
    height: int,
    rate: str,
    *,
    is_full_range: bool = False,
) -> list[str]:
    # Raw frames do not say it themselves, and players take what says nothing for 16 to 235.
    values = ("-color_range", "pc") if is_full_range else ()
    return [
        executable, "-hide_banner", "-loglevel", "error", *arguments.before_input,
        "-f", "rawvideo", "-pix_fmt", "yuv420p", "-s", f"{width}x{height}", "-r", rate,
        *values, "-i", "pipe:0", *arguments.after_input,
    ]  # fmt: skip


def _is_full(frame: VideoFrame) -> bool:
    """Whether a frame uses all 256 values, as images do and most video does not."""
    from av.video.reformatter import ColorRange

    return frame.color_range == ColorRange.JPEG


def _write_planes(frame: VideoFrame, pipe: IO[bytes]) -> None:
    for rows in _plane_rows(frame):
        pipe.write(rows)


def _plane_rows(frame: VideoFrame) -> Iterator[bytes]:
    """Yield the planes without the padding at the end of their lines."""
    for plane in frame.planes:
        data, stride = memoryview(plane), plane.line_size
        if stride == plane.width:
            yield bytes(data[: stride * plane.height])
        else:
            yield b"".join(
                data[row * stride : row * stride + plane.width] for row in range(plane.height)
            )


def _default(value: int | None, fallback: int) -> int:
    return fallback if value is None else value
