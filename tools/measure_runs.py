"""Measure whole runs of videos of different lengths: AV1 in, checked model out.

    python tools/measure_runs.py CLIP.ivf --camera CAMERA --poses poses.txt --plot runs.png

The first pictures of one IVF file, each length in a fresh ``mvmatch run``: elapsed and CPU seconds,
Python's start and the report among them, and the peak of resident memory. With poses (KITTI style:
a 3x4 camera-to-world matrix per line) also the trajectory error; where there are more pictures than
poses, the video runs through them forwards and backwards again and again.
"""

# matplotlib and pycolmap are typed only in part.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from measure_length import first_frames, parser_of
from mvmatch.geometry.trajectory import trajectory_error

if TYPE_CHECKING:
    from collections.abc import Sequence


def run(clip: Path, camera: str, poses: Path | None, out: Path) -> dict[str, float]:
    """Return what a run of a clip cost and made."""
    import pycolmap

    command = [sys.executable, "-m", "mvmatch", "run", str(clip), "--camera", camera]
    started = time.monotonic()
    process = subprocess.Popen([*command, "-o", str(out), "--json"], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.monotonic() - started
    if status:
        sys.exit(os.waitstatus_to_exitcode(status))
    model = json.loads((out / "report.json").read_text())["model"]
    row = {
        "pictures": model["total"],
        "key_frames": model["num_keyframes"],
        "registered": model["registered"],
        "wall_s": wall,
        "cpu_s": usage.ru_utime + usage.ru_stime,
        "peak_mb": usage.ru_maxrss / 1024,
        "ate_percent": float("nan"),
    }
    if poses is not None:
        reconstruction = pycolmap.Reconstruction(out / "sparse" / "0")
        row["ate_percent"] = path_error(reconstruction, poses)
    return row


def path_error(model: object, poses: Path) -> float:
    """Trajectory error in per cent of the path."""
    centers = np.loadtxt(poses).reshape(-1, 3, 4)[:, :, 3]
    there_and_back = np.concatenate([centers, centers[-2:0:-1]])
    image_ids = sorted(model.reg_image_ids())  # pyright: ignore[reportAttributeAccessIssue]
    found = [model.image(i).projection_center() for i in image_ids]  # pyright: ignore[reportAttributeAccessIssue]
    frames = (np.array(image_ids) - 1) % len(there_and_back)
    return trajectory_error(found, there_and_back[frames]).percent_of_path


def plot(rows: Sequence[dict[str, float]], path: Path) -> None:
    """Draw elapsed time and peak memory over the length."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(7, 2.6), layout="constrained")
    for panel, name, scale, label in (
        (axes[0], "wall_s", 1 / 60, "elapsed, minutes"),
        (axes[1], "peak_mb", 1 / 1000, "peak memory, GB"),
    ):
        lengths = [row["pictures"] for row in rows]
        panel.plot(lengths, [scale * row[name] for row in rows], "o-", color="#0072b2")
        panel.set(xlim=(0, None), ylim=(0, None), xlabel="pictures", ylabel=label)
    figure.savefig(path, dpi=150)


def main() -> None:
    parser = parser_of(__doc__, lengths="250,500,1000,2000,3000")
    parser.add_argument("--poses", type=Path)
    arguments = parser.parse_args()
    rows: list[dict[str, float]] = []
    print(
        "| pictures | key frames | registered | wall s | CPU s | CPU ms per picture | peak MB "
        "| ATE % |\n|---|---|---|---|---|---|---|---|"
    )
    for length in map(int, arguments.lengths.split(",")):
        with tempfile.TemporaryDirectory() as folder:
            clip = Path(folder) / "clip.ivf"
            first_frames(arguments.clip, length, clip)
            row = run(clip, arguments.camera, arguments.poses, Path(folder) / "out")
        rows.append(row)
        counts = (f"{row[name]:,}" for name in ("pictures", "key_frames", "registered"))
        costs = f"{row['wall_s']:.1f}", f"{row['cpu_s']:.1f}"
        milliseconds = 1000 * row["cpu_s"] / row["pictures"]
        rest = f"{milliseconds:.0f}", f"{row['peak_mb']:,.0f}", f"{row['ate_percent']:.4f}"
        print(f"| {' | '.join([*counts, *costs, *rest])} |", flush=True)
    if arguments.plot is not None:
        plot(rows, arguments.plot)


if __name__ == "__main__":
    main()
