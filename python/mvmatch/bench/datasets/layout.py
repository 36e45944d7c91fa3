"""What a layout is, and what the modules of single layouts share."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.bench.datasets.sequence import ImageFiles, Sequence
from mvmatch.camera import parse_camera
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Callable
    from collections.abc import Sequence as Many
    from pathlib import Path

    from numpy.typing import NDArray

    from mvmatch.bench.truth import Truth

GUIDE = "docs/reference/datasets.md"
"""Says how to get each data set."""


def folder_name(place: Path) -> str:
    """Name of a sequence that is named as its folder."""
    return place.resolve().name


@dataclass(frozen=True, kw_only=True)
class Layout:
    """One way in which files make a sequence."""

    title: str
    recognises: Callable[[Path], bool]
    """Whether a place has files of this layout, be it that others are missing."""
    load: Callable[[Path], Sequence]
    """Raises :class:`DataError` naming what is missing or does not fit."""
    files: Callable[[Path], list[Path]]
    """Files that the sequence is read from, as far as they are there."""
    name: Callable[[Path], str] = folder_name


def make_sequence(
    name: str,
    paths: Many[Path],
    camera: str | None,
    cam_from_world: NDArray[np.float64],
    *,
    truth: Truth | None = None,
) -> Sequence:
    """Make a sequence of picture files.

    Parameters
    ----------
    name : str
        Of the sequence.
    paths : sequence of Path
        In display order.
    camera : str or None
        As for :func:`mvmatch.camera.parse_camera`.
    cam_from_world : (F, 3, 4) float64
        NaN where not known.
    truth : Truth, optional
        Where points go.
    """
    frames = ImageFiles(tuple(paths))
    height, width = frames.read(0).shape[:2]
    chosen = parse_camera(camera, width, height, pictures=None if camera else paths[0])
    return Sequence(
        name=name, frames=frames, camera=chosen.camera, cam_from_world=cam_from_world, truth=truth
    )


def unknown_poses(count: int) -> NDArray[np.float64]:
    """(F, 3, 4) poses of frames without any."""
    return np.full((count, 3, 4), np.nan)


def read_numbers(path: Path, what: str) -> NDArray[np.float64]:
    """Read finite numbers from a text file, as many on each line; ``#`` begins a comment.

    Parameters
    ----------
    path : Path
        The file.
    what : str
        What belongs on a line, for messages.

    Returns
    -------
    (N, M) float64
        N > 0.

    Raises
    ------
    DataError
        The file is not there or holds something else.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)  # of an empty file
            numbers = np.loadtxt(path, dtype=np.float64, ndmin=2)
    except (OSError, ValueError, UserWarning) as error:
        raise DataError(f"{path} has no poses: {what} per line ({error}; {GUIDE})") from error
    if not np.isfinite(numbers).all():
        raise DataError(f"{path} holds numbers that are not finite: {what} per line")
    return numbers


def read_matrices(path: Path, count: int) -> NDArray[np.float64]:
    """Read (F, 3, 4) camera-to-world matrices, one row-major per line.

    Raises
    ------
    DataError
        They are not there, not as many as images, or no rotations.
    """
    poses = read_numbers(path, "one 3x4 matrix")
    if poses.shape != (count, 12):
        raise DataError(f"{path} holds {poses.shape} numbers for {count} images; 12 each")
    poses = poses.reshape(-1, 3, 4)
    check_rotations(poses[:, :, :3], path)
    return poses


def check_rotations(rotations: NDArray[np.float64], path: Path) -> None:
    """Refuse (F, 3, 3) matrices that are none, with the number of the first."""
    product = rotations @ rotations.transpose(0, 2, 1)
    proper = np.abs(product - np.eye(3)).max(axis=(1, 2)) < 1e-3
    proper &= np.linalg.det(rotations) > 0
    if not proper.all():
        raise DataError(f"{path}: pose {int(np.argmin(proper))} is no rotation and translation")


def inverted(world_from_cam: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``cam_from_world`` of (F, 3, 4) rigid transforms."""
    R = world_from_cam[:, :, :3].transpose(0, 2, 1)
    t = -np.einsum("nij,nj->ni", R, world_from_cam[:, :, 3])
    return np.concatenate([R, t[:, :, None]], axis=2)


def files_of(folder: Path, pictures: str) -> list[Path]:
    """Files in a folder and in that of its pictures."""
    found = [*folder.glob("*"), *(folder / pictures).glob("*")]
    return sorted(path for path in found if path.is_file())
