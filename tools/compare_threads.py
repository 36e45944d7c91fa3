"""Time the parser with two threads against one: ``tools/compare_threads.py FILE.ivf ...``.

The packets of each file, which starts with a key frame, are repeated until there are ``--frames``:
a stream with several segments that can be read at once. ``count_vectors`` reads it with one thread
and with two in turn. The ratio is the median of the wall seconds pair by pair. It means something
while other programs leave two processors alone: "others" is how many they kept busy meanwhile (nan
where there is no /proc/stat).
Build the example first: ``cargo build --release -p av1-motion --example count_vectors``.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
from pathlib import Path
from statistics import median

from measure_memory import repeat
from timing import COUNT_VECTORS, Times, run

STATISTICS = Path("/proc/stat")


def busy() -> float:
    """Seconds that all processors have worked so far, for whomever."""
    if not STATISTICS.exists():
        return math.nan
    ticks = [int(word) for word in STATISTICS.read_text(encoding="ascii").split()[1:9]]
    idle = ticks[3] + ticks[4]  # idle, waiting for a disk
    return (sum(ticks) - idle) / os.sysconf("SC_CLK_TCK")


def pair(commands: list[list[str]]) -> tuple[list[Times], float]:
    """Run the commands in turn; return their times and how many processors others kept busy."""
    before = busy()
    times = [run(command)[0] for command in commands]
    others = busy() - before - sum(one.cpu for one in times)
    return times, others / sum(one.wall for one in times)


def compare(stream: Path, frames: int, runs: int) -> None:
    """Print one line of the table."""
    with tempfile.TemporaryDirectory() as folder:
        video = Path(folder) / "long.ivf"
        frames = repeat(stream, frames, video)
        commands = [[str(COUNT_VECTORS), str(video), "1", threads] for threads in ("1", "2")]
        pairs, others = zip(*(pair(commands) for _ in range(runs)), strict=True)
    sides = [
        f"{median(t.wall for t in times):>7.3f} {median(t.cpu for t in times):>7.3f}"
        for times in zip(*pairs, strict=True)
    ]
    ratio = median(one.wall / two.wall for one, two in pairs)
    line = f"{stream.stem:<26} {frames:>6} {' '.join(sides)} {median(others):>6.2f} {ratio:>6.2f}"
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
    print(f"{'stream':<26} {'frames':>6} {heads} {'others':>6} {'ratio':>6}")
    for stream in options.streams:
        compare(stream, options.frames, options.runs)
    return 0


if __name__ == "__main__":
    sys.exit(main())
