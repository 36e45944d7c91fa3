"""``images/`` and ``transforms.json``, of NeRF and nerfstudio: poses of another reconstruction."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.baselines.images import list_images
from mvmatch.bench.datasets.layout import (
    Layout,
    check_rotations,
    files_of,
    inverted,
    make_sequence,
)
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from mvmatch.bench.datasets.sequence import Sequence


def load(folder: Path) -> Sequence:
    """Read a sequence of this layout: camera to world, x right, y up, z backward."""
    path = folder / "transforms.json"
    try:
        data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        names = {
            Path(frame["file_path"]).name: frame["transform_matrix"] for frame in data["frames"]
        }
        numbers = [float(data[key]) for key in ("fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2")]
        size = f"{int(data['w'])},{int(data['h'])}"
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(f"{path} holds no cameras ({error!r})") from error
    # It may list images that were left out of the folder, and the other way round.
    paths = [image for image in list_images(folder / "images") if image.name in names]
    if len(paths) < 2:
        raise DataError(f"{path} has poses for {len(paths)} of the images; two are needed")
    poses = np.array([names[image.name] for image in paths], np.float64)
    if poses.shape[1:] != (4, 4):
        raise DataError(f"{path}: a transform_matrix is not 4x4")
    poses[:, :, 1:3] *= -1
    # It is the matrix of a similarity of COLMAP's world: orthogonal up to rounding.
    left, _, right = np.linalg.svd(poses[:, :3, :3])
    poses[:, :3, :3] = left @ right
    check_rotations(poses[:, :3, :3], path)
    camera = f"OPENCV,{size},{','.join(map(repr, numbers))}"
    return make_sequence(LAYOUT.name(folder), paths, camera, inverted(poses[:, :3]))


LAYOUT = Layout(
    title="NeRF",
    recognises=lambda folder: (
        (folder / "images").is_dir() and (folder / "transforms.json").is_file()
    ),
    load=load,
    files=lambda folder: files_of(folder, "images"),
)
