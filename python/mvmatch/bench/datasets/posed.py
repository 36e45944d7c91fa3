"""Pictures with a camera and one 3x4 camera-to-world matrix per picture; rendered ones with truth.

``images/``, ``camera.txt`` (a COLMAP camera) or ``calib.txt`` (KITTI), ``poses.txt``, and
``scene.npz`` where the sequence was rendered. Lengths in m.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvmatch.baselines.images import list_images
from mvmatch.bench.datasets.layout import (
    GUIDE,
    Layout,
    files_of,
    inverted,
    make_sequence,
    read_matrices,
)
from mvmatch.bench.truth import RenderedTruth
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from pathlib import Path

    from mvmatch.bench.datasets.sequence import Sequence


def load(folder: Path) -> Sequence:
    """Read a sequence of this layout."""
    camera = next((name for name in ("camera.txt", "calib.txt") if (folder / name).is_file()), None)
    if camera is None:
        raise DataError(
            f"{folder} is no sequence: it has images/, but neither camera.txt nor calib.txt nor "
            f"transforms.json nor sparse/ ({GUIDE}). For pictures without poses give images/ itself"
        )
    paths = list_images(folder / "images")
    world_from_cam = read_matrices(folder / "poses.txt", len(paths))
    truth = None
    if (folder / "scene.npz").is_file():
        truth = RenderedTruth.load(folder / "scene.npz")
        if len(truth.world_from_cam) != len(paths):
            raise DataError(
                f"{folder}: scene.npz has {len(truth.world_from_cam)} frames, images/ {len(paths)}"
            )
    name = LAYOUT.name(folder)
    return make_sequence(name, paths, str(folder / camera), inverted(world_from_cam), truth=truth)


LAYOUT = Layout(
    title="posed pictures",
    recognises=lambda folder: (folder / "images").is_dir(),
    load=load,
    files=lambda folder: files_of(folder, "images"),
)
