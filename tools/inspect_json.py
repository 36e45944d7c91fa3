"""From the JSON of libaom's ``inspect`` to NumPy: one way that streams it, one that is fast.

    inspect FILE.ivf -mv -r -bs -s > clip.json && python tools/inspect_json.py clip.json
    inspect FILE.ivf -mv -r -x | python tools/inspect_json.py - --fast

The JSON is an array with an object for each frame; a layer is a list of rows of 4x4 px cells. A
cell of ``motionVectors`` is ``[dx0, dy0, dx1, dy1]`` in 1/8 px, one of ``referenceFrame`` two names
(-1 none, 0 intra, 1 to 7 LAST to ALTREF); one of ``blockSize`` and ``skip`` is a number. With
``-x`` an item ``[n]`` of a row repeats the cell before it n times.

Without ``--fast`` the frames come from ijson, which holds one at a time; with it from json.loads,
with Python's garbage collector off: it would look through millions of short lists in vain.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import sys
import time
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from mvmatch.bench.inspect_tool import dense, frames_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

WIDTHS = {"motionVectors": 4, "referenceFrame": 2}
FLAT = ("blockSize", "skip")


def streamed(source: IO[bytes]) -> Iterator[dict[str, Any]]:
    """Frames, one at a time, through ijson."""
    import ijson

    # The last item is null.
    yield from filter(None, ijson.items(source, "item"))


def motion(frames: Iterator[dict[str, Any]]) -> Iterator[list[NDArray[np.int16]]]:
    """Vectors (H, W, 4) and references (H, W, 2) of each frame, (H, W) of other layers."""
    for frame in frames:
        flat = [np.array(frame[layer], np.int16) for layer in FLAT if layer in frame]
        yield [dense(frame[layer], width) for layer, width in WIDTHS.items()] + flat


def main() -> None:
    """Print how many frames there were, and the CPU seconds of Python's start, as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source", help="a file, or - for standard input")
    parser.add_argument("--fast", action="store_true")
    options = parser.parse_args()
    if options.fast:
        gc.disable()
    else:
        import ijson  # noqa: F401 - its import belongs to the start
    start = time.process_time()
    read = frames_of if options.fast else streamed
    with sys.stdin.buffer if options.source == "-" else open(options.source, "rb") as source:  # noqa: PTH123
        fields = list(motion(read(source)))
    print(json.dumps({"frames": len(fields), "start": start}), flush=True)
    os._exit(0)  # what Python does to end is not what is timed


if __name__ == "__main__":
    main()
