"""A sequence: frames of one camera, its poses as far as known, and the split in halves."""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from mvmatch.baselines.images import require_opencv
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from pathlib import Path

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.bench.truth import Truth

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
    """Frames of one camera with its true poses, where they are known."""

    name: str
    """Base sequence, and after a plus sign what was composed from it."""
    frames: Frames
    camera: pycolmap.Camera
    cam_from_world: NDArray[np.float64]
    """(F, 3, 4) true poses; m, or the unit of the reference. NaN for a frame without one."""
    truth: Truth | None
    """Where points truly go; None where that is not known."""

    def __len__(self) -> int:
        return len(self.cam_from_world)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.camera.width, self.camera.height

    @property
    def focal_known(self) -> bool:
        """Whether the camera is more than a guess."""
        return self.camera.has_prior_focal_length

    @property
    def half(self) -> Half:
        """Half of the split (:data:`SPLIT_RULE`)."""
        return half_of(self.name)

    @property
    def posed(self) -> NDArray[np.bool_]:
        """(F,) frames whose pose is known."""
        return np.asarray(np.isfinite(self.cam_from_world).all(axis=(1, 2)))

    @property
    def centers(self) -> NDArray[np.float64]:
        """(F, 3) camera centres in the world; NaN for a frame without a pose."""
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


def write_frames(sequence: Sequence, folder: Path) -> list[Path]:
    """Write the frames of a sequence as numbered images of one folder, for methods that read files.

    Returns
    -------
    list of Path
        In display order, which is the order of their names.
    """
    folder.mkdir(parents=True, exist_ok=True)
    return [sequence.frames.write(index, folder / f"{index:06d}") for index in range(len(sequence))]
