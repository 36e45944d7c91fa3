"""Tracks put together piece by piece, in a table that need not fit into memory."""

from __future__ import annotations

import os
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.errors import DataError
from mvmatch.types import Tracks

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable

    from numpy.typing import DTypeLike, NDArray

IN_MEMORY = 1 << 22
"""Bytes of a column that are held in memory; larger ones are in a file."""


class Column:
    """An array that grows at its end, beyond :data:`IN_MEMORY` in a temporary file without a name.

    Pages of the file are the system's to take back, and the file is gone with the last array that
    looks into it.
    """

    def __init__(self, dtype: DTypeLike) -> None:
        self._dtype = np.dtype(dtype)
        self._file = tempfile.SpooledTemporaryFile(max_size=IN_MEMORY, dir=_folder())  # noqa: SIM115

    def add(self, values: NDArray[Any]) -> None:
        """Put values behind those that are there.

        Raises
        ------
        DataError
            There is no place for the file.
        """
        try:
            self._file.write(values.astype(self._dtype, copy=False).tobytes())
        except OSError as error:
            message = (
                f"there is no place for tracks in {_folder() or tempfile.gettempdir()} "
                f"({error.strerror}). Make room, or name another folder with TMPDIR"
            )
            raise DataError(message) from error

    def array(self) -> NDArray[Any]:
        """Return all values, (N,), read-only; nothing can be added then."""
        if self._file.tell() > IN_MEMORY:
            # The plain array keeps the map alive, and the map the file.
            return np.asarray(np.memmap(self._file, self._dtype, mode="r"))
        self._file.seek(0)
        return np.frombuffer(self._file.read(), self._dtype)

    def close(self) -> None:
        """Let go of the file; arrays keep it."""
        self._file.close()


@contextmanager
def columns(*dtypes: DTypeLike) -> Generator[tuple[Column, ...]]:
    """Give empty columns that are closed in the end."""
    opened = tuple(Column(dtype) for dtype in dtypes)
    try:
        yield opened
    finally:
        for column in opened:
            column.close()


class TrackBatches:
    """Tracks that come in batches."""

    def __init__(self, offsets: Column, frame: Column, xy: Column) -> None:
        self._offsets, self._frame, self._xy = offsets, frame, xy
        self._size = 0
        offsets.add(np.zeros(1, np.int64))

    def add(
        self, offsets: NDArray[np.int64], frame: NDArray[np.int32], xy: NDArray[np.float32]
    ) -> None:
        """Put the arrays of :class:`mvmatch.types.Tracks` behind those that are there."""
        self._offsets.add(offsets[1:] + self._size)
        self._frame.add(frame)
        self._xy.add(xy)
        self._size += len(frame)

    def tracks(self) -> Tracks:
        """Return all tracks; nothing can be added then."""
        return Tracks(
            offsets=self._offsets.array(),
            frame=self._frame.array(),
            xy=self._xy.array().reshape(-1, 2),
        )


@contextmanager
def track_batches() -> Generator[TrackBatches]:
    """Give a table that batches of tracks are put into."""
    with columns(np.int64, np.int32, np.float32) as opened:
        yield TrackBatches(*opened)


def joined(parts: Iterable[Tracks]) -> Tracks:
    """Return the tracks of all parts, in their order."""
    with track_batches() as batches:
        for part in parts:
            batches.add(part.offsets, part.frame, part.xy)
        return batches.tracks()


def _folder() -> str | None:
    """Return where large temporary files go: /tmp is memory on many systems, /var/tmp is not."""
    large = Path("/var/tmp")
    if "TMPDIR" not in os.environ and os.access(large, os.W_OK):
        return str(large)
    return None
