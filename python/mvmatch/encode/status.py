"""Which encoders work here, and why the others do not."""

from __future__ import annotations

from dataclasses import dataclass

from mvmatch.encode import executable as ffmpeg
from mvmatch.encode import svt
from mvmatch.encode.options import ENCODER_NAMES, EncoderName
from mvmatch.errors import UnsupportedError


@dataclass(frozen=True, kw_only=True)
class EncoderStatus:
    """One line of ``mvmatch encoders``."""

    name: EncoderName
    available: bool
    reason: str
    """Why it is not available; for an available one what it is."""
    executable: str | None
    """ffmpeg that would run it; None for the encoder inside PyAV or when there is none."""


def available_encoders() -> list[EncoderStatus]:
    """Try every known encoder with a few small frames.

    Returns
    -------
    One status per name of ``ENCODER_NAMES``, in that order; hardware is probed by encoding.
    """
    return [encoder_status(name) for name in ENCODER_NAMES]


def encoder_status(name: EncoderName) -> EncoderStatus:
    """Try one encoder with a few small frames."""
    if name == "svt":
        available = svt.is_available()
        reason = "SVT-AV1 inside PyAV" if available else "this PyAV was built without libsvtav1"
        return EncoderStatus(name=name, available=available, reason=reason, executable=None)
    executables = ffmpeg.ffmpeg_executables()
    if not executables:
        reason = f"no ffmpeg executable on this system; install one or: {ffmpeg.EXTRA_HINT}"
        return EncoderStatus(name=name, available=False, reason=reason, executable=None)
    executable = ffmpeg.find_executable(name)
    if executable is None:
        reason = (
            f"{executables[0]} has no {ffmpeg.FFMPEG_NAMES[name]}; an ffmpeg that has it: "
            f"{ffmpeg.EXTRA_HINT}"
        )
        return EncoderStatus(name=name, available=False, reason=reason, executable=None)
    failure = ffmpeg.probe(executable, name)
    if failure is not None:
        return EncoderStatus(name=name, available=False, reason=failure, executable=executable)
    return EncoderStatus(
        name=name,
        available=True,
        reason=f"{ffmpeg.FFMPEG_NAMES[name]} of ffmpeg",
        executable=executable,
    )


def require_encoder(name: EncoderName) -> EncoderStatus:
    """Return the status of an encoder that works.

    Raises
    ------
    UnsupportedError : it does not; the message lists the ones that do.
    """
    status = encoder_status(name)
    if status.available:
        return status
    working = [other.name for other in available_encoders() if other.available]
    listed = ", ".join(working) if working else "none"
    raise UnsupportedError(
        f"encoder {name} is not available: {status.reason}. Available here: {listed}."
    )
