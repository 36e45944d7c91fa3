"""What an encoding run takes and what it gives back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

if TYPE_CHECKING:
    from pathlib import Path

    from mvmatch.encode.check import EncodingCheck

EncoderName = Literal["svt", "libaom", "nvenc", "qsv", "vaapi"]
"""Encoders mvmatch knows how to set up for matching."""

ENCODER_NAMES: tuple[EncoderName, ...] = get_args(EncoderName)


@dataclass(frozen=True, kw_only=True)
class EncodeOptions:
    """Options of :func:`mvmatch.encode.encode_video`; None means the encoder's own default."""

    encoder: EncoderName = "svt"
    """``svt`` is always there (inside PyAV); the others need an ffmpeg executable."""
    quality: int | None = None
    """Constant quality on the encoder's own scale, lower is better: svt and libaom CRF 30 (0-63),
    nvenc QP 120, qsv 120, vaapi 128 (0-255)."""
    speed: int | None = None
    """svt preset 8 (0-13), libaom cpu-used 6 (0-11), nvenc preset 1 (1-7); higher is faster,
    for nvenc slower. SVT preset 8 is the default because its vectors have 1/8 px steps and are the
    more exact ones; preset 10 stops at 1/4 px but costs half and covers more of the picture."""
    usage: Literal["realtime", "good"] = "realtime"
    """libaom only. ``good`` searches wider and more exactly and costs several times as much; both
    without lag, so that references lie in the past."""
    frame_rate: float = 30.0
    """Frames per s written for a folder of images; a video keeps its own times."""
    max_frames: int | None = None
    """Encode only the first frames."""
    check: bool = True
    """Read the result with mvmatch's parser and warn when it does not suit matching."""


@dataclass(frozen=True, kw_only=True)
class EncodeResult:
    """What :func:`mvmatch.encode.encode_video` made."""

    path: Path
    encoder: EncoderName
    settings: str
    """The settings given to the encoder, for the report."""
    num_frames: int
    width: int
    """px."""
    height: int
    """px."""
    image_names: tuple[str, ...] | None
    """File names in frame order when the source was a folder of images, else None."""
    num_bytes: int
    """Size of the coded frames, without the container."""
    seconds: float
    """Wall time in s, reading the source and checking included."""
    cpu_seconds: float
    """CPU time in s of this process and its encoder."""
    check: EncodingCheck | None
    """Reference structure found in the result; None when the check was off."""
    warnings: tuple[str, ...]
