"""Read vectors and references from the JSON of libaom's ``inspect``.

    inspect FILE.ivf -mv -r [-x] | python tools/inspect_json.py [--no-gc]

A dense picture of 4x4 px cells for each coded frame, as NumPy arrays. With ``-x`` a cell may be
followed by ``[n]``: n more cells of the row are the same. Written to be fast: the garbage collector
of Python looks through millions of short lists in vain, and ``--no-gc`` turns it off.
"""

from __future__ import annotations

import argparse
import gc
import json
import sys
import time
from itertools import chain
from typing import IO, TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    Rows = list[list[list[int]]]


def frames(stream: IO[bytes]) -> Iterator[dict[str, Any]]:
    """Parse one frame after the other: each ends with a line ``},``."""
    lines: list[bytes] = []
    for line in stream:
        if line == b"},\n":
            yield json.loads(b"".join([*lines, b"}"]))
            lines = []
        elif line != b"[\n":
            lines.append(line)


def cells(rows: Rows, width: int) -> NDArray[np.int16]:
    """(H, W, width) values of all cells, the runs of ``-x`` unrolled if there are any."""
    items = list(chain.from_iterable(rows))
    values = np.fromiter(chain.from_iterable(items), np.int16)
    if len(values) != width * len(items):
        values = _unroll(values, np.fromiter(map(len, items), np.int64, len(items)), width)
    return values.reshape(len(rows), -1, width)


def _unroll(values: NDArray[np.int16], lengths: NDArray[np.int64], width: int) -> NDArray[np.int16]:
    """(N, width) cells; an item of length 1 repeats the cell before it that often."""
    starts = lengths.cumsum() - lengths
    is_cell = lengths == width
    distinct = values[starts[is_cell, None] + np.arange(width)]
    counts = np.ones(len(distinct), np.int64)
    counts[is_cell.cumsum()[~is_cell] - 1] += values[starts[~is_cell]]
    return distinct.repeat(counts, axis=0)


def motion(stream: IO[bytes]) -> Iterator[tuple[NDArray[np.int16], NDArray[np.int16]]]:
    """Vectors (H, W, 4) ``[dx0, dy0, dx1, dy1]`` in 1/8 px, references (H, W, 2) of each frame.

    References: -1 none, 0 intra, 1 to 7 LAST to ALTREF.
    """
    for frame in frames(stream):
        yield cells(frame["motionVectors"], 4), cells(frame["referenceFrame"], 2)


def main() -> None:
    """Print what was read and the CPU seconds of Python's start, as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--no-gc", action="store_true")
    if parser.parse_args().no_gc:
        gc.disable()
    start = time.process_time()
    fields = list(motion(sys.stdin.buffer))
    print(json.dumps({"frames": len(fields), "start": start}))


if __name__ == "__main__":
    main()
