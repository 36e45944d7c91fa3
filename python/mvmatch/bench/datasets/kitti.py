"""KITTI odometry: ``sequences/NN`` with ``image_0`` or ``image_2``, ``poses/NN.txt`` beside it.

Poses are those of the left grey camera (``image_0``) in m, in the world of its first frame; the
left colour camera (``image_2``) stands beside it by what ``calib.txt`` says. Pictures are
rectified. Sequences 11 to 21 have no public poses.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvmatch.baselines.images import list_images
from mvmatch.bench.datasets.layout import (
    GUIDE,
    Layout,
    folder_name,
    inverted,
    make_sequence,
    read_matrices,
    unknown_poses,
)
from mvmatch.camera.calibration import HALF_PIXEL
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from mvmatch.bench.datasets.sequence import Sequence

_CAMERAS = (0, 2)
"""Left grey, left colour; the first that is there is taken."""

_UNPUBLISHED = frozenset(f"{number:02d}" for number in range(11, 22))


def load(folder: Path) -> Sequence:
    """Read one sequence."""
    number = next((each for each in _CAMERAS if (folder / f"image_{each}").is_dir()), None)
    if number is None:
        raise DataError(
            f"{folder} has neither image_0/ (data_odometry_gray.zip) nor image_2/ "
            f"(data_odometry_color.zip of KITTI odometry; {GUIDE})"
        )
    paths = list_images(folder / f"image_{number}")
    P = _projection(folder / "calib.txt", number)
    cx, cy = P[:2, 2] + HALF_PIXEL
    camera = f"PINHOLE,{float(P[0, 0])},{float(P[1, 1])},{float(cx)},{float(cy)}"
    poses = _poses_file(folder)
    if poses.is_file():
        cam_from_world = inverted(read_matrices(poses, len(paths)))
        # P = K [I | t] of a point in the left grey camera.
        cam_from_world[:, :, 3] += np.linalg.solve(P[:, :3], P[:, 3])
    elif folder_name(folder) in _UNPUBLISHED:
        cam_from_world = unknown_poses(len(paths))
    else:
        raise DataError(
            f"{poses} is missing: unpack data_odometry_poses.zip of KITTI odometry there ({GUIDE})"
        )
    return make_sequence(LAYOUT.name(folder), paths, camera, cam_from_world)


def _projection(path: Path, number: int) -> NDArray[np.float64]:
    """(3, 4) projection of a camera, px from the first pixel's centre."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(
            f"{path} cannot be read ({error}): unpack data_odometry_calib.zip of KITTI odometry "
            f"there ({GUIDE})"
        ) from error
    name = f"P{number}:"
    row = next((line.removeprefix(name) for line in lines if line.startswith(name)), "")
    try:
        P = np.array(row.split(), np.float64).reshape(3, 4)
    except ValueError as error:
        raise DataError(f"{path} has no projection {name} of 12 numbers. Unpack it anew") from error
    if not (np.isfinite(P).all() and P[0, 0] > 0 and P[1, 1] > 0 and P[2, 2] == 1):
        raise DataError(f"{path}: {name} is no projection in px. Unpack it anew")
    return P


def _poses_file(folder: Path) -> Path:
    place = folder.resolve()
    return place.parent.parent / "poses" / f"{place.name}.txt"


def _recognises(folder: Path) -> bool:
    known = all((folder / name).is_file() for name in ("calib.txt", "times.txt"))
    return known or any((folder / f"image_{number}").is_dir() for number in _CAMERAS)


def _files(folder: Path) -> list[Path]:
    found = [folder / "calib.txt", _poses_file(folder)]
    for number in _CAMERAS:
        found += (folder / f"image_{number}").glob("*")
    return sorted(path for path in found if path.is_file())


LAYOUT = Layout(
    title="KITTI odometry",
    recognises=_recognises,
    load=load,
    files=_files,
    name=lambda folder: f"kitti-{folder_name(folder)}",
)
