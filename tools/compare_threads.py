"""Time the parser with two threads against one: ``tools/compare_threads.py FILE.ivf ...``.

The packets of each file, which starts with a key frame, are repeated until there are ``--frames``:
a stream with several segments that can be read at once. ``count_vectors`` reads it with one thread
and with two in turn. The ratio is the median of the wall seconds pair by pair; "cores" is what two
threads got of the processors (CPU by wall seconds): below 2 other programs had the rest.
Build the example first: ``cargo build --release -p av1-motion --example count_vectors``.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from statistics import median

from measure_memory import repeat
from timing import COUNT_VECTORS, run


def compare(stream: Path, frames: int, runs: int) -> None:
    """One line of the table."""
    with tempfile.TemporaryDirectory() as folder:
        video = Path(folder) / "long.ivf"
        frames = repeat(stream, frames, video)
        commands = [[str(COUNT_VECTORS), str(video), "1", threads] for threads in ("1", "2")]
        pairs = [[run(command)[0] for command in commands] for _ in range(runs)]
    sides = [
        f"{median(t.wall for t in times):>7.3f} {median(t.cpu for t in times):>7.3f}"
        for times in zip(*pairs, strict=True)
    ]
    cores = median(two.cpu / two.wall for _, two in pairs)
    ratio = median(one.wall / two.wall for one, two in pairs)
    line = f"{stream.stem:<26} {frames:>6} {' '.join(sides)} {cores:>6.2f} {ratio:>6.2f}"
    print(line, flush=True)


def main() -> int:
    """Print the table; 1 when the example is not built."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("streams", type=Path, nargs="+")
    arguments.add_argument("--frames", type=int, default=400, help="at least that many")
    arguments.add_argument("--runs", type=int, default=9)
    options = arguments.parse_args()
    if not COUNT_VECTORS.is_file():
        print(f"compare_threads: needs {COUNT_VECTORS}", file=sys.stderr)
        return 1
    print(f"{'':<26} {'':>6} {'one thread':>15} {'two threads':>15}          wall")
    heads = " ".join([f"{'wall s':>7} {'CPU s':>7}"] * 2)
    print(f"{'stream':<26} {'frames':>6} {heads} {'cores':>6} {'ratio':>6}")
    for stream in options.streams:
        compare(stream, options.frames, options.runs)
    return 0


if __name__ == "__main__":
    sys.exit(main())
