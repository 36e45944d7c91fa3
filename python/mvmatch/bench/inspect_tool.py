"""The paper's own extractor: libaom's ``inspect`` and its JSON, as motion fields.

The JSON is an array with an object for each coded frame, in coded order; a layer is a list of
rows of 4x4 px cells. A cell of ``motionVectors`` is ``[dx0, dy0, dx1, dy1]`` in 1/8 px, one of
``referenceFrame`` two names (-1 none, 0 intra, 1 to 7 LAST to ALTREF), one of ``blockSize`` a
number (AV1 specification, section 6.10.4). With ``-x`` an item ``[n]`` of a row repeats the cell
before it n times.

It names references but not the pictures they stand for, nor when frames are shown: that is taken
from the headers as :mod:`mvmatch.sources` reads them. Its rows lack the columns that the paper does
not use (flags, segments, residual, quantiser of blocks, warp).
"""

from __future__ import annotations

import contextlib
import json
import shutil
import subprocess
import tempfile
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from mvmatch.errors import DataError
from mvmatch.types import MotionField

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from mvmatch.sources import FrameFacts
    from mvmatch.types import VideoInfo

PROGRAM = "inspect"
LAYERS = ("-mv", "-r", "-bs", "-x")
CELL = 4
"""Px."""

_WIDTHS = {"motionVectors": 4, "referenceFrame": 2}
_BLOCK_SIZES = np.array(
    [
        (4, 4), (4, 8), (8, 4), (8, 8), (8, 16), (16, 8), (16, 16), (16, 32), (32, 16), (32, 32),
        (32, 64), (64, 32), (64, 64), (64, 128), (128, 64), (128, 128), (4, 16), (16, 4), (8, 32),
        (32, 8), (16, 64), (64, 16),
    ],
    np.int32,
)  # fmt: skip
"""Width and height in px by number."""


def missing_inspect() -> str | None:
    """Return why the program cannot be used; None if it can."""
    if shutil.which(PROGRAM) is not None:
        return None
    return (
        f"{PROGRAM} is not on the PATH. It is an example of libaom: build that with "
        "-DCONFIG_INSPECTION=1 and put examples/inspect there"
    )


def inspect_fields(
    stream: Path, facts: Sequence[FrameFacts], info: VideoInfo
) -> Iterator[MotionField]:
    """Run ``inspect`` on a stream and yield what it prints; a frame is held at a time.

    Parameters
    ----------
    stream : Path
        IVF.
    facts : sequence of FrameFacts
        Headers of the same stream; orders to show a frame again are passed over.
    info : VideoInfo
        Of the same stream.

    Yields
    ------
    MotionField
        In decode order, rows from the upper left block on.

    Raises
    ------
    DataError
        The program is missing or fails, or what it prints is not its JSON or is of other frames.
    """
    reason = missing_inspect()
    if reason is not None:
        raise DataError(reason)
    coded = [each for each in facts if not each.is_repeat]
    number = 0
    with tempfile.TemporaryFile() as said, _running(stream, said) as process:
        assert process.stdout is not None
        try:
            for frame in frames_of(process.stdout):
                yield _field(frame, coded[number], info)
                number += 1
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise DataError(
                f"{PROGRAM} printed something else than was expected at frame {number} of {stream} "
                f"({type(error).__name__}: {error}). Is it libaom's, and the stream complete?"
            ) from error
        if process.wait() or number < len(coded):
            said.seek(0)
            words = said.read().decode(errors="replace").strip() or "it did not say why"
            raise DataError(
                f"{PROGRAM} ended with code {process.returncode} after {number} of {len(coded)} "
                f"frames of {stream}: {words}"
            )


def frames_of(output: IO[bytes]) -> Iterator[dict[str, Any]]:
    """Yield the frames of the JSON; a line ``},`` ends each.

    Raises
    ------
    ValueError
        It is not JSON.
    """
    text = bytearray()
    for line in output:
        text += line
        if line.rstrip() in {b"},", b"}"}:
            yield json.loads(text.strip(b"[,\n "))
            text.clear()


def dense(rows: list[list[Any]], width: int) -> NDArray[np.int16]:
    """(H, W, width) values of a layer; runs are unrolled.

    Raises
    ------
    ValueError
        Rows differ in length.
    """
    if all(len(row) == len(rows[0]) for row in rows) and len(rows[0][-1]) == width:
        with contextlib.suppress(ValueError):  # a run somewhere: the shape is not regular
            return np.array(rows, np.int16)
    return np.array([_unrolled(row) for row in rows], np.int16)


def _unrolled(row: list[Any]) -> list[Any]:
    """Put the cells that ``-x`` leaves out into a row."""
    cells: list[Any] = []
    for item in row:
        match item:
            case [count]:
                cells.extend([cells[-1]] * count)
            case _:
                cells.append(item)
    return cells


@contextlib.contextmanager
def _running(stream: Path, said: IO[bytes]) -> Generator[subprocess.Popen[bytes]]:
    """Start the program; it ends with the body."""
    command = [PROGRAM, str(stream), *LAYERS]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=said) as process:
        try:
            yield process
        finally:
            process.kill()


def _field(frame: dict[str, Any], header: FrameFacts, info: VideoInfo) -> MotionField:
    """One row per block and reference, blocks row by row."""
    sizes = _BLOCK_SIZES[np.array([_unrolled(row) for row in frame["blockSize"]], np.int16)]
    vectors, references = (dense(frame[name], width) for name, width in _WIDTHS.items())
    corners = np.moveaxis(np.indices(sizes.shape[:2], np.int32), 0, -1)[..., ::-1] * CELL
    first = np.all(corners % sizes == 0, axis=-1)  # every block lies at a multiple of its size
    blocks = np.concatenate([corners[first], sizes[first]], axis=1)
    named = references[first].ravel()
    block, mv = np.repeat(blocks, 2, axis=0), vectors[first].reshape(-1, 2)
    pictures = np.array([-1, *(header.ref_display_index or (-1,) * 7)], np.int32)
    ref_frame = pictures[np.maximum(named, 0)]
    kept = (ref_frame >= 0) & (ref_frame != header.display_index)
    count = int(kept.sum())
    return MotionField(
        frame=header.display_index,
        decode_index=header.decode_index,
        pts=header.pts,
        width=info.width,
        height=info.height,
        is_key=header.frame_type in {"KEY", "INTRA_ONLY"},
        is_shown=header.is_shown,
        block=block[kept],
        mv=mv[kept].astype(np.float32) / np.float32(8),
        ref_frame=ref_frame[kept],
        flags=np.zeros(count, np.uint16),
        segment_id=np.zeros(count, np.uint8),
        qindex=np.full(count, header.base_q_idx, np.uint8),
        residual=np.zeros(count, np.float32),
        warp=np.full((count, 6), np.nan),
    )
