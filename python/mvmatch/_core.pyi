"""The Rust part of mvmatch: it converts and computes, and decides nothing.

Errors raised here are the classes of :mod:`mvmatch.errors`.
"""

from collections.abc import Sequence
from typing import Any, Literal, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from mvmatch.sources.options import Limits
from mvmatch.types import MotionField

__all__ = [
    "Av1Parser",
    "CodedFrame",
    "ContainerReader",
    "TrackLinker",
    "default_limits",
    "fit_neighbors",
    "vector_errors",
]

_TrackArrays: TypeAlias = tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]]

def default_limits() -> dict[str, int | None]:
    """Return the limits that hold when none are given, by name."""

@final
class ContainerReader:
    """Temporal units of an IVF file, a Section 5 OBU stream or an Annex B stream.

    Raises ``BitstreamError`` where the container is damaged, ``OSError`` where it cannot be read.
    """

    def __new__(cls, path: str, *, limits: Limits | None = None) -> ContainerReader: ...
    def next_unit(self) -> tuple[int | None, bytes, int] | None:
        """Return (pts in units of the time base, bytes, their offset), or None at the end."""

    @property
    def kind(self) -> str:
        """``"ivf"``, ``"obu"`` or ``"annexb"``."""

    @property
    def time_base(self) -> tuple[int, int] | None:
        """Seconds per tick as (numerator, denominator); None when the container has none."""

    @property
    def size(self) -> tuple[int, int] | None:
        """(width, height) in px as the container states it; None when it does not."""

@final
class Av1Parser:
    """Parses temporal units into coded frames, one at a time; the GIL is released meanwhile.

    Signals are looked at every 50 ms: Ctrl-C ends a frame, which is lost then. Raises ``DataError``
    at a sequence header without the chosen operating point.
    """

    def __new__(
        cls, *, limits: Limits | None = None, operating_point: int = 0, threads: int = 1
    ) -> Av1Parser: ...
    def push(self, unit: bytes, byte_offset: int = 0) -> None:
        """Queue one temporal unit that starts at this byte of the file."""

    def next_frame(self) -> CodedFrame | None:
        """Return the next frame; None when another unit is needed, after `finish` at the end."""

    def finish(self) -> None:
        """Check that the last frame is complete; to be called after the last unit.

        With several threads frames are still to come then.
        """

@final
class CodedFrame:
    """One frame header and, unless it only shows an earlier frame, the blocks it codes."""

    @property
    def decode_index(self) -> int: ...
    @property
    def display_index(self) -> int: ...
    @property
    def order_hint(self) -> int: ...
    @property
    def frame_type(self) -> str: ...
    @property
    def show_frame(self) -> bool: ...
    @property
    def showable_frame(self) -> bool: ...
    @property
    def show_existing_frame(self) -> bool: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def upscaled_width(self) -> int: ...
    @property
    def base_q_idx(self) -> int: ...
    @property
    def ref_decode_index(self) -> NDArray[np.int64]: ...
    @property
    def ref_display_index(self) -> NDArray[np.int64]: ...
    @property
    def temporal_id(self) -> int: ...
    @property
    def spatial_id(self) -> int: ...
    @property
    def unit_index(self) -> int: ...
    @property
    def is_output(self) -> bool: ...
    def motion(self, size: tuple[int, int] | None = None) -> dict[str, NDArray[Any]]:
        """One row per block and reference: the columns of ``MotionField``.

        In px of a picture of ``size`` (width, height), by default of the frame itself.
        """

    def blocks(self) -> dict[str, NDArray[Any]]:
        """One row per coded block, in the specification's units: ``mv`` is [row, col] in 1/8 px."""

    def coefficient_stats(self) -> NDArray[np.uint64]:
        """(3, 5) counts over the transform blocks of Y, U, V."""

    def header(self) -> dict[str, Any]:
        """Return the header's syntax elements."""

@final
class TrackLinker:
    """Collects motion fields in decode order, then chains them (see `mvmatch.tracks`)."""

    def __new__(
        cls,
        *,
        keep_zero: bool,
        error_weights: Sequence[float] | None,
        max_error: float | None,
        max_drift: float | None,
        num_neighbors: int,
        carry: Literal["translate", "fuse"],
        follow: Literal["nearest", "all"],
        epsilon: float | None,
        tau: float,
        cell: int | None,
        extend: bool,
        min_length: int,
        fill: tuple[int, float | None, float | None] | None,
        window: int | None,
    ) -> TrackLinker: ...
    def push(self, columns: MotionField) -> None: ...
    def take(self) -> tuple[_TrackArrays, _TrackArrays]:
        """Tracks that have ended since the last time, and further ones likewise.

        Each are offsets (T + 1,), frame (O,) and xy (O, 2) px. There are some after each window.
        """

    def finish(self) -> tuple[_TrackArrays, _TrackArrays]:
        """Chain the rest: all tracks that were not taken, and further ones likewise.

        The linker cannot be used again.
        """

def fit_neighbors(
    columns: MotionField, *, num_neighbors: int = 12
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Residual (N,) px, spread (N,) px, vector (N, 2) px, linear (N, 4) px per px of local fits."""

def vector_errors(
    columns: MotionField, *, weights: Sequence[float], num_neighbors: int = 12
) -> NDArray[np.float32]:
    """Median error (N,) px of every vector fused with its neighbours."""
