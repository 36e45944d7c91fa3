"""Time the parser against a full decoder: ``tools/compare_parsers.py FILE.ivf ...``.

Runs ``count_vectors`` (the parser's example, one thread) and ``dav1d --threads 1`` in turn on the
same files, each in a process of its own, and prints medians of wall and CPU seconds, frames per
CPU second and the median of the ratios pair by pair. Build the example first:
``cargo build --release -p av1-motion --example count_vectors``.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path
from statistics import median

from timing import COUNT_VECTORS, run


def compare(stream: Path, parser: list[str], decoder: list[str], runs: int) -> None:
    """One line of the table."""
    ours, theirs, output = [], [], ""
    for number in range(runs + 1):
        times, output = run([*parser, str(stream)])
        reference, _ = run([*decoder, "-i", str(stream)])
        if number > 0:  # the first pair warms the caches
            ours.append(times)
            theirs.append(reference)
    frames = int(output.split()[0])
    ratio = median(t.cpu / o.cpu for o, t in zip(ours, theirs, strict=True))
    wall, cpu = (median(times[i] for times in ours) for i in (0, 1))
    wall_decoder, cpu_decoder = (median(times[i] for times in theirs) for i in (0, 1))
    print(
        f"{stream.name:<26} {frames:>6} {wall:>7.3f} {cpu:>7.3f} {frames / cpu:>7.0f}"
        f" {wall_decoder:>8.3f} {cpu_decoder:>8.3f} {frames / cpu_decoder:>8.0f} {ratio:>7.2f}",
        flush=True,
    )


def main() -> int:
    """Print the table; 1 when something to run is missing."""
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("streams", type=Path, nargs="+")
    arguments.add_argument("--runs", type=int, default=9)
    arguments.add_argument("--parser", type=Path, default=COUNT_VECTORS)
    options = arguments.parse_args()
    decoder = shutil.which("dav1d")
    if decoder is None or not options.parser.is_file():
        missing = "dav1d on the PATH" if decoder is None else str(options.parser)
        print(f"compare_parsers: needs {missing}", file=sys.stderr)
        return 1
    print(f"{'':<26} {'':>6} {'parser':>23} {'dav1d --threads 1':>26}   CPU")
    heads = f"{'wall s':>7} {'CPU s':>7} {'frame/s':>7} {'wall s':>8} {'CPU s':>8} {'frame/s':>8}"
    print(f"{'stream':<26} {'frames':>6} {heads}   ratio")
    command = [decoder, "--threads", "1", "--muxer", "null", "-q", "-o", "/dev/null"]
    for stream in options.streams:
        compare(stream, [str(options.parser)], command, options.runs)
    return 0


if __name__ == "__main__":
    sys.exit(main())
