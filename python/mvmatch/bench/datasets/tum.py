"""TUM RGB-D: ``rgb.txt`` (time and file of each picture) and ``groundtruth.txt``.

A line of the latter is ``time tx ty tz qx qy qz qw``, camera to world, m and s, about 100 per s
from a motion capture system, so its times are not those of the pictures: poses between two are
interpolated, positions along a line and rotations along a great circle.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.bench.datasets.layout import (
    GUIDE,
    Layout,
    folder_name,
    inverted,
    make_sequence,
    read_numbers,
    unknown_poses,
)
from mvmatch.camera.calibration import HALF_PIXEL, opencv_model
from mvmatch.errors import DataError, MissingExtraError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from mvmatch.bench.datasets.sequence import Sequence

MAX_DIFFERENCE = 0.02
"""s from a picture to the poses around it, as in TUM's own tools; otherwise it has no pose."""

_INTRINSICS = {
    "1": ((517.3, 516.5, 318.6, 255.3), (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
    "2": ((520.9, 521.0, 325.1, 249.7), (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)),
    "3": ((535.4, 539.2, 320.1, 247.6), ()),
}
"""Of freiburg1 to 3, 640x480 px: fx, fy, cx, cy from the first pixel's centre; k1, k2, p1, p2, k3
of OpenCV. As published with the data set; the pictures of freiburg3 are undistorted."""


def load(folder: Path) -> Sequence:
    """Read one sequence."""
    for name, missing in (("rgb.txt", "times"), ("groundtruth.txt", "poses")):
        if not (folder / name).is_file():
            raise DataError(
                f"{folder} has no {name}, the {missing} of the pictures: unpack the whole .tgz of "
                f"TUM RGB-D ({GUIDE}). For pictures without poses give rgb/ itself"
            )
    times, paths = _pictures(folder)
    cam_from_world = _poses_at(times, folder / "groundtruth.txt")
    return make_sequence(LAYOUT.name(folder), paths, _camera(folder), cam_from_world)


def _pictures(folder: Path) -> tuple[NDArray[np.float64], list[Path]]:
    """Read times in s and files of the pictures, in order of time."""
    path = folder / "rgb.txt"
    rows: list[tuple[float, Path]] = []
    for number, line in enumerate(path.read_text("utf-8", "replace").splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            time, name = line.split()
            rows.append((float(time), folder / name))
        except ValueError as error:
            raise DataError(f"{path}, line {number}: a time and a file belong there") from error
    missing = [picture for _, picture in rows if not picture.is_file()]
    if len(rows) < 2 or missing:
        raise DataError(
            f"{path} lists {len(rows)} pictures, of which {len(missing)} are not there"
            f"{f', such as {missing[0].name}' if missing else ''}. Unpack the .tgz anew ({GUIDE})"
        )
    rows.sort()
    return np.array([time for time, _ in rows]), [picture for _, picture in rows]


def _poses_at(times: NDArray[np.float64], path: Path) -> NDArray[np.float64]:
    """(F, 3, 4) ``cam_from_world`` at times in s; NaN where no poses are near."""
    try:
        from scipy.spatial.transform import Rotation, Slerp
    except ImportError as error:
        raise MissingExtraError("TUM RGB-D needs SciPy: pip install 'mvmatch[bench]'") from error
    rows = read_numbers(path, "time tx ty tz qx qy qz qw")
    if rows.shape[1] != 8:
        raise DataError(f"{path} has {rows.shape[1]} numbers on a line: time tx ty tz qx qy qz qw")
    rows = rows[np.unique(rows[:, 0], return_index=True)[1]]
    stamps, centers, quaternions = rows[:, 0], rows[:, 1:4], rows[:, 4:]
    if len(rows) < 2 or (np.abs(np.linalg.norm(quaternions, axis=1) - 1) > 0.01).any():
        raise DataError(f"{path} needs two poses or more, each with a unit quaternion qx qy qz qw")
    # The same one twice where a time is met exactly.
    before = np.searchsorted(stamps, times, "right") - 1
    after = np.searchsorted(stamps, times, "left")
    last = len(stamps) - 1
    known = (before >= 0) & (after <= last)
    known &= times - stamps[np.maximum(before, 0)] <= MAX_DIFFERENCE
    known &= stamps[np.minimum(after, last)] - times <= MAX_DIFFERENCE
    if not known.any():
        raise DataError(
            f"{path} has no pose within {MAX_DIFFERENCE} s of any picture of rgb.txt: do both "
            "belong to one sequence?"
        )
    turned: Any = Slerp(stamps, Rotation.from_quat(quaternions))(times[known])
    moved = [np.interp(times[known], stamps, centers[:, axis]) for axis in range(3)]
    poses = unknown_poses(len(times))
    poses[known] = np.concatenate([turned.as_matrix(), np.array(moved).T[:, :, None]], axis=2)
    return inverted(poses)


def _camera(folder: Path) -> str:
    if (folder / "camera.txt").is_file():
        return str(folder / "camera.txt")
    found = re.search(r"freiburg([123])", folder_name(folder))
    if found is None:
        raise DataError(
            f"{folder} does not say by its name which camera took it: name it as the archive does "
            "(rgbd_dataset_freiburg1_xyz), or put a COLMAP camera into camera.txt"
        )
    pinhole, distortion = _INTRINSICS[found.group(1)]
    origin = np.array([0, 0, HALF_PIXEL, HALF_PIXEL])
    model, params = opencv_model((origin + pinhole).tolist(), distortion, str(folder))
    return ",".join([model, "640", "480", *map(repr, params)])


def _files(folder: Path) -> list[Path]:
    found = [folder / name for name in ("rgb.txt", "groundtruth.txt", "camera.txt")]
    return sorted(path for path in [*found, *(folder / "rgb").glob("*")] if path.is_file())


LAYOUT = Layout(
    title="TUM RGB-D",
    recognises=lambda folder: any(
        (folder / name).is_file() for name in ("rgb.txt", "groundtruth.txt")
    ),
    load=load,
    files=_files,
)
