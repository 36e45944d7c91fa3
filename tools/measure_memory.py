"""Measure the peak memory of reading long videos: a clip is repeated to several lengths.

    python tools/measure_memory.py CLIP.ivf --frames 1000 10000 100000

CLIP.ivf starts with a key frame. The long files are made in a temporary folder, one at a time. The
Rust parser is measured if it was built: cargo build --release -p av1-motion --example count_vectors
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

from timing import COUNT_VECTORS

HEADER_BYTES = 32

ITERATE = "import sys, mvmatch\nfor field in mvmatch.open_video(sys.argv[1]): pass"


def repeat(clip: Path, frames: int, target: Path) -> int:
    """Write the packets of an IVF file again and again; return how many there are then."""
    stream = clip.read_bytes()
    at, packets = HEADER_BYTES, 0
    while at < len(stream):
        at += 12 + int.from_bytes(stream[at : at + 4], "little")
        packets += 1
    rounds = -(-frames // packets)
    with target.open("wb") as file:
        file.write(stream[:HEADER_BYTES])
        for _ in range(rounds):
            file.write(stream[HEADER_BYTES:])
    return rounds * packets


def measure(command: list[str]) -> tuple[float, float]:
    """Run a command; return its peak resident memory in MB and its CPU time in s."""
    silent = os.open(os.devnull, os.O_WRONLY)
    actions = [(os.POSIX_SPAWN_DUP2, silent, stream) for stream in (1, 2)]
    process = os.posix_spawn(command[0], command, os.environ, file_actions=actions)
    _, status, usage = os.wait4(process, 0)
    os.close(silent)
    if status:
        sys.exit(f"{' '.join(command)} failed")
    unit = 1e6 if sys.platform == "darwin" else 1e3  # ru_maxrss: bytes on macOS, else kB
    return usage.ru_maxrss / unit, usage.ru_utime + usage.ru_stime


def commands(video: Path, folder: Path, only: list[str] | None) -> dict[str, list[str]]:
    """Return what is measured, by name."""
    python = [sys.executable, "-m", "mvmatch"]
    found = {
        "iterate": [sys.executable, "-c", ITERATE, str(video)],
        "probe": [*python, "probe", str(video), "--json"],
        "extract": [*python, "extract", str(video), str(folder / "motion.parquet"), "--json"],
    }
    if COUNT_VECTORS.exists():
        found = {"count_vectors": [str(COUNT_VECTORS), str(video)], **found}
    return {name: words for name, words in found.items() if only is None or name in only}


def main() -> None:
    """Print one row for each consumer and length."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clip", type=Path)
    parser.add_argument("--frames", type=int, nargs="+", default=[1000, 10000])
    parser.add_argument("--only", nargs="+", help="count_vectors, iterate, probe, extract")
    arguments = parser.parse_args()
    print("| reader | frames | file MB | peak MB | CPU s |\n|---|---|---|---|---|")
    for wanted in arguments.frames:
        with tempfile.TemporaryDirectory() as name:
            video = Path(name) / "long.ivf"
            frames = repeat(arguments.clip, wanted, video)
            megabytes = video.stat().st_size / 1e6
            for reader, command in commands(video, Path(name), arguments.only).items():
                peak, seconds = measure(command)
                row = f"{reader} | {frames:,} | {megabytes:,.0f} | {peak:.0f} | {seconds:.0f}"
                print(f"| {row} |", flush=True)


if __name__ == "__main__":
    main()
