"""How a stream is read: what it may cost, where it is damaged, and which of its layers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

Errors = Literal["raise", "resume"]


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a stream may ask for; more is a :class:`~mvmatch.errors.LimitError`.

    The defaults let every real video through and keep a hostile file from exhausting the machine;
    docs/reliability.md says what they amount to. A service that reads strangers' files should also
    set ``max_frames`` or ``max_samples``.
    """

    max_frame_area: int = 35_651_584
    """Luma samples of one frame: the largest picture of AV1 level 6.x (8192x4352). The most memory
    that a file can take grows with it (docs/reliability.md)."""
    max_tiles: int = 4096
    """Tiles of one frame."""
    max_unit_bytes: int = 256 << 20
    """Bytes of one unit (packet, temporal unit) of an IVF, OBU or Annex B file."""
    max_frames: int | None = None
    """Frames of the stream, hidden ones included; None for no bound."""
    max_unit_samples: int = 32 * 35_651_584
    """Luma samples of all frames of one unit; a frame header counts as 4096 at least."""
    max_samples: int | None = None
    """Luma samples of all frames of the stream, counted likewise; None for no bound."""


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """How a stream is read."""

    errors: Errors = "raise"
    """At damage: ``"raise"`` after the frames before it, or ``"resume"`` at the first frame that
    depends on nothing that was lost."""
    limits: Limits = field(default_factory=Limits)
    """What the stream may cost."""
    operating_point: int = 0
    """Which of a scalable stream's operating points to read: 0 usually has all layers, others leave
    temporal or spatial layers out."""
    threads: int = 0
    """Threads of the AV1 parser; 0 for one per processor. Any number gives the same. Streams with
    several key frames, with pyramids of frames or with tiles gain, others do not."""


@dataclass(frozen=True, kw_only=True)
class Skipped:
    """A run of frames that could not be read, in a stream that was read on."""

    after_frame: int
    """Frames (coded and repeated ones, as in ``MotionSource.frames``) that were read before it."""
    num_errors: int
    """Errors in a row: frames that were damaged or that depend on a lost one, as far as they show
    in the stream."""
    byte_offset: int | None
    """Where the first error lies in the file; None where the container does not tell."""
    section: str | None
    """The rule of the AV1 specification that the first error breaks."""
    reason: str
    """The first error in words."""

    def __str__(self) -> str:
        """Return the facts as a sentence."""
        more = f" and {self.num_errors - 1} that follow from it" if self.num_errors > 1 else ""
        return f"After {self.after_frame} frames, one error{more}: {self.reason}"
