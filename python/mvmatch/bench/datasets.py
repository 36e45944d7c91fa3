"""Sequences with known camera poses, and exact point truth where they were rendered.

Three layouts are recognised by their files; a further sequence drops in without code:

======== ============================================ ===============================
rendered ``images/ camera.txt poses.txt scene.npz``   poses and exact point truth
KITTI    ``images/ calib.txt poses.txt``              poses, m
NeRF     ``images/ transforms.json``                  poses of another reconstruction
======== ============================================ ===============================

``poses.txt`` has one 3x4 camera-to-world matrix per line, row-major. Frames are the images in the
order of their names.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from mvmatch.baselines.images import list_images, require_opencv
from mvmatch.bench.truth import RenderedTruth, Truth
from mvmatch.camera import parse_camera
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Sequence as Many

    import pycolmap
    from numpy.typing import NDArray

Half = Literal["tuning", "reporting"]

SPLIT_RULE = (
    "a sequence belongs to the reporting half if the first byte of the SHA-256 of its name is odd, "
    "else to the tuning half; a composed sequence belongs where its base does"
)


class Frames(Protocol):
    """Pictures of a sequence."""

    def __len__(self) -> int: ...

    def read(self, index: int) -> NDArray[np.uint8]:
        """Return one picture, (H, W, 3) blue green red."""
        ...

    def write(self, index: int, path: Path) -> Path:
        """Write one picture without loss under ``path`` plus a suffix; return the whole path."""
        ...


@dataclass(frozen=True)
class ImageFiles:
    """Pictures as files."""

    paths: tuple[Path, ...]

    def __len__(self) -> int:
        return len(self.paths)

    def read(self, index: int) -> NDArray[np.uint8]:
        """Return one picture, (H, W, 3) blue green red."""
        image = require_opencv().imread(str(self.paths[index]), 1)
        if image is None:
            raise DataError(f"{self.paths[index]} is not an image that OpenCV can read")
        return np.asarray(image, np.uint8)

    def write(self, index: int, path: Path) -> Path:
        """Copy one file."""
        target = path.with_suffix(self.paths[index].suffix)
        shutil.copyfile(self.paths[index], target)
        return target


@dataclass(frozen=True, kw_only=True, eq=False)
class Sequence:
    """Frames of one camera with its true poses."""

    name: str
    """Base sequence, and after a plus sign what was composed from it."""
    frames: Frames
    camera: pycolmap.Camera
    cam_from_world: NDArray[np.float64]
    """(F, 3, 4) true poses; m, or the unit of the reference."""
    truth: Truth | None
    """Where points truly go; None where only poses are known."""

    def __len__(self) -> int:
        return len(self.cam_from_world)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.camera.width, self.camera.height

    @property
    def half(self) -> Half:
        """Half of the split (:data:`SPLIT_RULE`)."""
        return half_of(self.name)

    @property
    def centers(self) -> NDArray[np.float64]:
        """(F, 3) camera centres in the world."""
        R, t = self.cam_from_world[:, :, :3], self.cam_from_world[:, :, 3]
        return -np.einsum("nji,nj->ni", R, t)

    def first(self, num_frames: int | None) -> Sequence:
        """Return the sequence of the first frames; all of them for None."""
        return replace(self, cam_from_world=self.cam_from_world[:num_frames])


def half_of(name: str) -> Half:
    """Return the half that a sequence belongs to, by :data:`SPLIT_RULE`.

    >>> half_of("street_turn"), half_of("street_drive"), half_of("street_drive+pan")
    ('tuning', 'reporting', 'reporting')
    """
    digest = hashlib.sha256(name.partition("+")[0].encode()).digest()
    return "reporting" if digest[0] % 2 else "tuning"


def find_sequences(folders: Many[Path]) -> dict[str, Path]:
    """Find sequences: each folder is one itself, or holds some.

    Parameters
    ----------
    folders : sequence of Path
        Folders inside them without an ``images`` folder are passed over.

    Returns
    -------
    dict
        Name to folder, sorted by name.

    Raises
    ------
    DataError
        A folder holds no sequence, or two sequences have one name.
    """
    found: dict[str, Path] = {}
    for folder in folders:
        if not folder.is_dir():
            raise DataError(f"there is no folder {folder}; give one that holds sequences")
        inner = [folder] if (folder / "images").is_dir() else sorted(folder.iterdir())
        inner = [path for path in inner if (path / "images").is_dir()]
        if not inner:
            raise DataError(f"{folder} holds no sequence: a sequence is a folder with images/")
        for path in inner:
            name = path.resolve().name
            if name in found:
                raise DataError(f"two sequences are named {name}: {found[name]} and {path}")
            found[name] = path
    return dict(sorted(found.items()))


def load_sequence(folder: Path) -> Sequence:
    """Read one sequence in any of the known layouts.

    Raises
    ------
    DataError
        The folder has none of the layouts, or its files do not fit together; the message says
        which file and what was expected.
    """
    if not (folder / "images").is_dir():
        raise DataError(f"{folder} is no sequence: it has no folder images/")
    if (folder / "transforms.json").is_file():
        return _load_nerf(folder)
    camera = next((name for name in ("camera.txt", "calib.txt") if (folder / name).is_file()), None)
    if camera is None:
        raise DataError(
            f"{folder} is no sequence: it has neither camera.txt nor calib.txt nor transforms.json"
        )
    paths = tuple(list_images(folder / "images"))
    world_from_cam = _read_poses(folder / "poses.txt", len(paths))
    truth = None
    if (folder / "scene.npz").is_file():
        truth = RenderedTruth.load(folder / "scene.npz")
        if len(truth.world_from_cam) != len(paths):
            raise DataError(
                f"{folder}: scene.npz has {len(truth.world_from_cam)} frames, images/ {len(paths)}"
            )
    return _sequence(folder, paths, str(folder / camera), world_from_cam, truth)


def write_frames(sequence: Sequence, folder: Path) -> list[Path]:
    """Write the frames of a sequence as numbered images of one folder, for methods that read files.

    Returns
    -------
    list of Path
        In display order, which is the order of their names.
    """
    folder.mkdir(parents=True, exist_ok=True)
    return [sequence.frames.write(index, folder / f"{index:06d}") for index in range(len(sequence))]


def _sequence(
    folder: Path,
    paths: tuple[Path, ...],
    camera: str,
    world_from_cam: NDArray[np.float64],
    truth: Truth | None,
) -> Sequence:
    frames = ImageFiles(paths)
    height, width = frames.read(0).shape[:2]
    return Sequence(
        name=folder.resolve().name,
        frames=frames,
        camera=parse_camera(camera, width, height).camera,
        cam_from_world=_inverted(world_from_cam),
        truth=truth,
    )


def _read_poses(path: Path, count: int) -> NDArray[np.float64]:
    """(F, 3, 4) camera to world."""
    try:
        poses = np.loadtxt(path, dtype=np.float64, ndmin=2)
    except (OSError, ValueError) as error:
        raise DataError(f"{path} has no poses: one 3x4 matrix per line ({error})") from error
    if poses.shape != (count, 12):
        raise DataError(f"{path} holds {poses.shape} numbers for {count} images; 12 each")
    poses = poses.reshape(-1, 3, 4)
    _check_rotations(poses[:, :, :3], path)
    return poses


def _check_rotations(rotations: NDArray[np.float64], path: Path) -> None:
    product = rotations @ rotations.transpose(0, 2, 1)
    proper = np.abs(product - np.eye(3)).max(axis=(1, 2)) < 1e-3
    proper &= np.linalg.det(rotations) > 0
    if not proper.all():
        raise DataError(f"{path}: pose {int(np.argmin(proper))} is no rotation and translation")


def _load_nerf(folder: Path) -> Sequence:
    """Read ``transforms.json``: camera to world, x right, y up, z backward."""
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
    paths = tuple(image for image in list_images(folder / "images") if image.name in names)
    if len(paths) < 2:
        raise DataError(f"{path} has poses for {len(paths)} of the images; two are needed")
    poses = np.array([names[image.name] for image in paths], np.float64)
    if poses.shape[1:] != (4, 4):
        raise DataError(f"{path}: a transform_matrix is not 4x4")
    poses[:, :, 1:3] *= -1
    # It is the matrix of a similarity of COLMAP's world: orthogonal up to rounding.
    left, _, right = np.linalg.svd(poses[:, :3, :3])
    poses[:, :3, :3] = left @ right
    _check_rotations(poses[:, :3, :3], path)
    camera = f"OPENCV,{size},{','.join(map(repr, numbers))}"
    return _sequence(folder, paths, camera, poses[:, :3], None)


def _inverted(world_from_cam: NDArray[np.float64]) -> NDArray[np.float64]:
    R = world_from_cam[:, :, :3].transpose(0, 2, 1)
    t = -np.einsum("nij,nj->ni", R, world_from_cam[:, :, 3])
    return np.concatenate([R, t[:, :, None]], axis=2)
