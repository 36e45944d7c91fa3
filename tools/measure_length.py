"""Measure what a picture costs in videos of different lengths: AV1 in, verified database out.

    python tools/measure_length.py CLIP.ivf --camera CAMERA --lengths 50,500,5000 --plot length.png

The first pictures of one IVF file, each length in a process of its own with one thread: motion
vectors to tracks, these into a table and read from it, verified, into a database. CPU seconds
without Python's start and imports. Two peaks of memory: all that is resident, pages of files among
it, and what is anonymous (Linux; asked for every 5 ms), which the system cannot take back. A long
clip with motion: link a folder's pictures forwards and backwards again and again, and run
``mvmatch encode`` on it.
"""

# matplotlib types its figures only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import argparse
import importlib
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

IVF_HEADER, FRAME_HEADER = 32, 12
_IMPORTS = ("mvmatch.sources.av1", "numpy.ma", "numpy.random", "pyarrow.parquet", "pycolmap")
"""Imported where they are needed; not what is measured."""


def first_frames(clip: Path, count: int, out: Path) -> None:
    """Write the first temporal units of an IVF file."""
    with clip.open("rb") as source, out.open("wb") as target:
        target.write(source.read(IVF_HEADER))
        for _ in range(count):
            header = source.read(FRAME_HEADER)
            if len(header) < FRAME_HEADER:
                sys.exit(f"{clip} has fewer than {count} frames")
            target.write(header + source.read(int.from_bytes(header[:4], "little")))


def measure(clip: Path, camera: str) -> dict[str, float]:
    """Return length, CPU seconds and peak resident memory of one run in this process."""
    for needed_later in _IMPORTS:
        importlib.import_module(needed_later)

    from mvmatch.camera import parse_camera
    from mvmatch.export.colmap import write_database
    from mvmatch.matching import match_video
    from mvmatch.sources import ReadOptions
    from mvmatch.store import TracksTable, read_tracks, write_tracks

    started = time.process_time()
    match = match_video(clip, read=ReadOptions(threads=1))
    choice = parse_camera(camera, match.info.width, match.info.height)
    names = tuple(f"{frame:06d}.png" for frame in range(match.num_frames))
    table = TracksTable(tracks=match.tracks, info=match.info, image_names=names)
    del match
    write_tracks(table, clip.with_suffix(".parquet"), options={})
    table = read_tracks(clip.with_suffix(".parquet"))
    write_database(table.tracks, clip.with_suffix(".db"), camera=choice.camera, image_names=names)
    return {
        "pictures": len(names),
        "cpu_s": time.process_time() - started,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def run(command: list[str]) -> dict[str, float]:
    """Return what :func:`measure` says in another process, and its peak of anonymous memory."""
    anonymous = 0
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        status = Path(f"/proc/{process.pid}/status")
        while process.poll() is None:
            for line in status.read_text().splitlines() if status.exists() else ():
                if line.startswith("RssAnon:"):
                    anonymous = max(anonymous, int(line.split()[1]))
            time.sleep(0.005)
        printed, _ = process.communicate()
    if process.returncode:
        sys.exit(process.returncode)
    return json.loads(printed) | {"anonymous_mb": anonymous / 1024}


def plot(rows: list[dict[str, float]], path: Path) -> None:
    """Draw CPU per picture and peak memory over the length."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(7, 2.6), layout="constrained")
    lengths = [row["pictures"] for row in rows]
    times = [1000 * row["cpu_s"] / row["pictures"] for row in rows]
    left.plot(lengths, times, "o-", color="#0072b2")
    left.set(xscale="log", ylim=(0, 1.2 * max(times)), ylabel="CPU ms per picture")
    for name, color, label in (
        ("peak_mb", "#d55e00", "resident"),
        ("anonymous_mb", "#009e73", "anonymous"),
    ):
        right.plot(lengths, [row[name] for row in rows], "o-", color=color, label=label)
    right.set(ylim=(0, None), ylabel="peak memory, MB")
    right.legend()
    for axes in (left, right):
        axes.set_xlabel("pictures")
    figure.savefig(path, dpi=150)


def parser_of(description: str | None, *, lengths: str) -> argparse.ArgumentParser:
    """Return what tools that measure the first pictures of a clip are asked."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("clip", type=Path, help="IVF file")
    parser.add_argument("--camera", required=True, help="as of mvmatch run")
    parser.add_argument("--lengths", default=lengths)
    parser.add_argument("--plot", type=Path)
    return parser


def main() -> None:
    parser = parser_of(__doc__, lengths="50,150,500,1500,5000")
    parser.add_argument("--one", action="store_true", help="measure the whole clip in this process")
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(measure(arguments.clip, arguments.camera)))
        return
    rows: list[dict[str, float]] = []
    print(
        "| pictures | CPU s | ms per picture | resident MB | anonymous MB |\n|---|---|---|---|---|"
    )
    for length in map(int, arguments.lengths.split(",")):
        with tempfile.TemporaryDirectory() as folder:
            clip = Path(folder) / "clip.ivf"
            first_frames(arguments.clip, length, clip)
            command = [sys.executable, __file__, str(clip), "--camera", arguments.camera, "--one"]
            row = run(command)
        rows.append(row)
        milliseconds = 1000 * row["cpu_s"] / row["pictures"]
        cells = f"{row['pictures']:,}", f"{row['cpu_s']:.1f}", f"{milliseconds:.1f}"
        peaks = f"{row['peak_mb']:,.0f} | {row['anonymous_mb']:,.0f}"
        print(f"| {' | '.join(cells)} | {peaks} |", flush=True)
    if arguments.plot is not None:
        plot(rows, arguments.plot)


if __name__ == "__main__":
    main()
