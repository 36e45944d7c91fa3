"""Time mvmatch against libaom's ``inspect`` with its JSON read in Python: vectors into NumPy.

    python tools/compare_inspect.py FILE.ivf ...

Whole processes in turn, one thread each. On one side a loop over ``mvmatch.open_video(FILE,
threads=1)`` that keeps blocks, vectors and references. On the other ``inspect`` and
tools/inspect_json.py. "paper": what its rules ask for (vectors, references, the block sizes that
give the centres, skip flags: ``-mv -r -bs -s``) through a file and ijson. "least": ``-mv -r``, only
where each vector points, the same way. "fast": through a pipe and json.loads without Python's
garbage collector. "runs": as "fast" with ``-x``, which writes equal cells once. CPU seconds are
those of all processes of a side; "read" is without what Python takes to start and import (both
sides leave without taking Python down). The last line of a file is the two programs without Python.

Before a file is timed, the vectors of all inter blocks are compared. ``inspect`` is an example of
libaom (CONFIG_INSPECTION=1) and has to be on the PATH, ijson among Python's packages. Build the
parser's example first: ``cargo build --release -p av1-motion --example count_vectors``.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import inspect_json
import mvmatch
from timing import COUNT_VECTORS, Times, pipe, run

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

READ = """
import json, os, sys, time
import numpy, mvmatch, mvmatch.sources.av1
start = time.process_time()
with mvmatch.open_video(sys.argv[1], threads=1) as video:
    fields = [(field.block, field.mv, field.ref_frame) for field in video]
print(json.dumps({"frames": len(fields), "start": start}), flush=True)
os._exit(0)
"""
LEAST = ["-mv", "-r"]
RUNS = [*LEAST, "-x"]
VARIANTS = {"paper": [*LEAST, "-bs", "-s"], "least": LEAST, "fast": LEAST, "runs": RUNS}
CONSUMER = [sys.executable, inspect_json.__file__]

Row = tuple[float, float, float]
"""Wall, CPU and CPU seconds without Python's start."""


def row(result: tuple[Times, str]) -> Row:
    times, output = result
    start = json.loads(output)["start"] if output.startswith("{") else 0.0
    return times.wall, times.cpu, times.cpu - start


def compare(name: str, sides: list[Callable[[], tuple[Times, str]]], runs: int) -> None:
    """Print one line: medians of both sides, and of the ratios pair by pair."""
    pairs = np.array([[row(side()) for side in sides] for _ in range(runs)])
    ours, theirs = np.median(pairs, axis=0)
    ratios = np.median(pairs[:, 1] / pairs[:, 0], axis=0)
    cells = [f"{value:>7.3f}" for value in (*ours, *theirs)] + [
        f"{value:>6.1f}" for value in ratios
    ]
    print(f"{name:<42}", *cells, flush=True)


def inspect(path: Path, variant: str) -> tuple[Times, str]:
    """Time ``inspect`` with Python behind it."""
    command = ["inspect", str(path), *VARIANTS[variant]]
    if variant in {"fast", "runs"}:
        return pipe(command, [*CONSUMER, "-", "--fast"])
    with tempfile.NamedTemporaryFile(suffix=".json") as file:
        (first, _), (second, output) = (
            run(command, stdout=file),
            run([*CONSUMER, file.name]),
        )
    return Times(first.wall + second.wall, first.cpu + second.cpu), output


def compare_all(path: Path, runs: int, only: str | None) -> None:
    """Print the lines of one file."""
    read = partial(run, [sys.executable, "-c", READ, str(path)])
    for variant in VARIANTS:
        if only in {None, variant}:
            compare(f"{path.stem:<26} {variant}", [read, partial(inspect, path, variant)], runs)
    programs = [[str(COUNT_VECTORS), str(path)], ["inspect", str(path), *LEAST]]
    silent = [partial(run, command, stdout=subprocess.DEVNULL) for command in programs]
    compare(f"{path.stem:<26} no Python", silent, runs)


def disagreement(path: Path, layers: list[str]) -> str | None:
    """Compare the vectors and references of all inter blocks; say where they first differ."""
    command = ["inspect", str(path), *layers]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process,
        mvmatch.open_video(path, threads=1) as video,
    ):
        assert process.stdout is not None
        frames = inspect_json.motion(inspect_json.frames_of(process.stdout))
        for field, (mv, names) in zip(video, frames, strict=True):
            ours, references = rasterize(field, *names.shape[:2])
            is_inter = names > 0
            if not np.array_equal(is_inter, references >= 0):
                return f"frame {field.frame}: inter blocks differ"
            if not np.array_equal(ours[is_inter], mv.reshape(*names.shape, 2)[is_inter]):
                return f"frame {field.frame}: vectors differ"
            pairs = np.unique(np.stack([names[is_inter], references[is_inter]]), axis=1)
            if len(np.unique(pairs[0])) != pairs.shape[1]:
                return f"frame {field.frame}: a reference's name stands for two frames"
    return None


def rasterize(
    field: mvmatch.MotionField, rows: int, columns: int
) -> tuple[NDArray[np.int16], NDArray[np.int32]]:
    """(H, W, 2, 2) vectors in 1/8 px and (H, W, 2) reference frames, -1 where there is none."""
    mv = np.zeros((rows, columns, 2, 2), np.int16)
    references = np.full((rows, columns, 2), -1, np.int32)
    units = np.rint(field.mv * 8).astype(np.int16)
    for (x, y, w, h), vector, reference in zip(
        field.block // 4, units, field.ref_frame, strict=True
    ):
        area = np.s_[y : y + h, x : x + w]
        second = int(references[y, x, 0] >= 0)
        mv[area][:, :, second] = vector
        references[area][:, :, second] = reference
    return mv, references


def main() -> int:
    """Print the table; 1 when something to run is missing or the two sides disagree."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("streams", type=Path, nargs="+")
    arguments.add_argument("--runs", type=int, default=5)
    arguments.add_argument("--only", choices=VARIANTS, help="one variant instead of all")
    options = arguments.parse_args()
    if shutil.which("inspect") is None or not COUNT_VECTORS.is_file():
        missing = COUNT_VECTORS if shutil.which("inspect") else "libaom's inspect on the PATH"
        print(f"compare_inspect: needs {missing}", file=sys.stderr)
        return 1
    sides = f"{'mvmatch':>23} {'inspect and Python':>23} {'ratio':>20}"
    heads = " ".join([f"{'wall s':>7} {'CPU s':>7} {'read s':>7}"] * 2)
    print(f"{'':<42} {sides}\n{'stream':<42} {heads} {'wall':>6} {'CPU':>6} {'read':>6}")
    for path in options.streams:
        difference = disagreement(path, LEAST) or disagreement(path, RUNS)
        if difference:
            print(f"compare_inspect: {path}: {difference}", file=sys.stderr)
            return 1
        compare_all(path, options.runs, options.only)
    return 0


if __name__ == "__main__":
    sys.exit(main())
