"""Measure what mapping costs in videos of different lengths: verified database in, model out.

    python tools/measure_mapping.py DATABASE.db --poses poses.txt

One thread; CPU seconds without Python's start. With poses (KITTI style: a 3x4 camera-to-world
matrix per line) also the trajectory error; where there are more images than poses, the video runs
through them forwards and backwards again and again.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

import argparse
import json
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from mvmatch.geometry.trajectory import trajectory_error
from mvmatch.sfm import MapperOptions, reconstruct


def path_error(model: object, poses: Path) -> float:
    """Trajectory error in per cent of the path."""
    centers = np.loadtxt(poses).reshape(-1, 3, 4)[:, :, 3]
    there_and_back = np.concatenate([centers, centers[-2:0:-1]])
    image_ids = sorted(model.reg_image_ids())  # pyright: ignore[reportAttributeAccessIssue]
    found = [model.image(i).projection_center() for i in image_ids]  # pyright: ignore[reportAttributeAccessIssue]
    frames = (np.array(image_ids) - 1) % len(there_and_back)
    return trajectory_error(found, there_and_back[frames]).percent_of_path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("database", type=Path)
    parser.add_argument("--poses", type=Path)
    arguments = parser.parse_args()
    started = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        options = MapperOptions(intrinsics="fixed")
        result = reconstruct(arguments.database, Path(folder), options=options)
    row = {
        "images": result.total,
        "keyframes": result.num_keyframes,
        "registered": result.registered,
        "points": result.num_points,
        "cpu_s": round(time.process_time() - started, 1),
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
    }
    if arguments.poses is not None and result.reconstruction is not None:
        row["ate_percent"] = round(path_error(result.reconstruction, arguments.poses), 4)
    print(json.dumps(row))


if __name__ == "__main__":
    main()
