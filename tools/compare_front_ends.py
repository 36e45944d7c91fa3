"""Compare whole front ends, frames or stream in and COLMAP database out, each in its own process.

    python tools/compare_front_ends.py FRAMES --stream CLIP.ivf --camera CALIB [--max-frames N]

Wall and CPU seconds are those of the process with everything it starts, Python's start included;
NumPy's BLAS has one thread, for idle ones that wait for work count as CPU time.
All methods verify with the same RANSAC settings and write the same kind of database. The frames
are read from disk by the methods that need pixels; the motion vectors are read from the stream, and
what encoding it costs is measured in a line of its own. ``mvmatch-bridged`` also looks for gaps
between vectors and decodes the stream's pictures around them, as ``mvmatch run`` does.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

METHODS = ("mvmatch", "mvmatch-bridged", "encode-svt", "klt", "dis", "sift-sequential")


def run_mvmatch(arguments: argparse.Namespace, database: Path, *, bridged: bool) -> None:
    from mvmatch.camera import parse_camera
    from mvmatch.export.colmap import write_database
    from mvmatch.matching import match_video
    from mvmatch.sources import ReadOptions
    from mvmatch.tracks import TrackOptions

    options = TrackOptions.preset(arguments.preset)
    match = match_video(arguments.stream, options=options, read=ReadOptions(threads=1))
    camera = parse_camera(arguments.camera, match.info.width, match.info.height).camera
    if bridged:
        from mvmatch.config import RunOptions
        from mvmatch.pictures import bridge_match

        bridging = RunOptions.preset(arguments.preset).bridge
        match = bridge_match(match, arguments.stream, camera, options=bridging)
    names = [f"{frame:06d}.png" for frame in range(match.num_frames)]
    write_database(
        match.tracks, database, camera=camera, image_names=names, max_gap=options.max_gap
    )


def run_encoder(arguments: argparse.Namespace, database: Path) -> None:
    from mvmatch.encode import EncodeOptions, encode_video

    options = EncodeOptions(max_frames=arguments.max_frames, check=False)
    encode_video(arguments.frames, database.with_suffix(".ivf"), options=options)


def run_tracker(arguments: argparse.Namespace, database: Path, name: str) -> None:
    import cv2

    from mvmatch import baselines
    from mvmatch.baselines.images import list_images
    from mvmatch.camera import parse_camera
    from mvmatch.export.colmap import write_database

    cv2.setNumThreads(1)
    images = list_images(arguments.frames, arguments.max_frames)
    height, width = cv2.imread(str(images[0]), cv2.IMREAD_GRAYSCALE).shape
    tracks = {"klt": baselines.track_klt, "dis": baselines.track_dis}[name](images)
    camera = parse_camera(arguments.camera, width, height).camera
    write_database(tracks, database, camera=camera, image_names=[path.name for path in images])


def run_sift(arguments: argparse.Namespace, database: Path) -> None:
    import pycolmap

    from mvmatch.baselines import match_sift
    from mvmatch.baselines.images import list_images
    from mvmatch.camera import parse_camera

    pycolmap.logging.minloglevel = 3
    first = list_images(arguments.frames, arguments.max_frames)[0]
    size = pycolmap.Bitmap.read(first, as_rgb=False)
    camera = parse_camera(arguments.camera, size.width, size.height).camera
    match_sift(arguments.frames, database, camera=camera, max_frames=arguments.max_frames)


def run_method(arguments: argparse.Namespace) -> None:
    name, database = arguments.run, arguments.database
    if name.startswith("mvmatch"):
        run_mvmatch(arguments, database, bridged=name == "mvmatch-bridged")
    elif name == "encode-svt":
        run_encoder(arguments, database)
    elif name == "sift-sequential":
        run_sift(arguments, database)
    else:
        run_tracker(arguments, database, name)


def measure(name: str, database: Path) -> dict[str, float | int | str]:
    """Run one method in a process of its own."""
    started = time.perf_counter()
    command = [*sys.argv, "--run", name, "--database", str(database)]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    process = os.posix_spawn(sys.executable, [sys.executable, *command], environment)
    _, status, usage = os.wait4(process, 0)
    row: dict[str, float | int | str] = {
        "method": name,
        "wall_seconds": round(time.perf_counter() - started, 2),
        "cpu_seconds": round(usage.ru_utime + usage.ru_stime, 2),
        "peak_mb": usage.ru_maxrss // 1024,
    }
    if os.waitstatus_to_exitcode(status) != 0:
        sys.exit(f"{name} failed")
    if database.exists():
        row |= database_counts(database)
    return row


def database_counts(database: Path) -> dict[str, float | int]:
    import pycolmap

    with pycolmap.Database.open(database) as opened:
        pairs = opened.num_verified_image_pairs()
        return {
            "keypoints_per_image": round(opened.num_keypoints() / max(1, opened.num_images())),
            "pairs": pairs,
            "inliers_per_pair": round(opened.num_inlier_matches() / max(1, pairs)),
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("frames", type=Path, help="folder of frames")
    parser.add_argument("--stream", type=Path, required=True, help="the same frames as AV1")
    parser.add_argument("--camera", help="as for mvmatch run")
    parser.add_argument("--max-frames", type=int)
    parser.add_argument("--preset", default="default", help="of the tracks of mvmatch")
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--keep", type=Path, help="keep the databases in this folder")
    parser.add_argument("--json", type=Path, help="write the table here as well")
    parser.add_argument("--run", choices=METHODS, help=argparse.SUPPRESS)
    parser.add_argument("--database", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.run:
        run_method(arguments)
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        rows = []
        for name in arguments.methods.split(","):
            rows.append(measure(name, folder / f"{name}.db"))
            print_row(rows[-1], rows[0])
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


def print_row(row: dict[str, float | int | str], first: dict[str, float | int | str]) -> None:
    ratio = float(row["cpu_seconds"]) / max(0.01, float(first["cpu_seconds"]))
    counts = ""
    if "pairs" in row:
        counts = (
            f"  {row['keypoints_per_image']:6} keypoints/image {row['pairs']:5} pairs"
            f" {row['inliers_per_pair']:5} inliers/pair"
        )
    print(
        f"{row['method']:16} wall {row['wall_seconds']:7.2f} s  CPU {row['cpu_seconds']:7.2f} s"
        f"  x{ratio:6.2f}  {row['peak_mb']:5} MB{counts}",
        flush=True,
    )


if __name__ == "__main__":
    main()
