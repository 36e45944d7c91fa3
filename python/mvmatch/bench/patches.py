"""Pieces of a sequence's first picture that move by themselves over all of its pictures.

Stands in for moving objects where a sequence has none: natural texture, exact truth, and motion
that has nothing to do with the camera's.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.baselines.images import require_opencv
from mvmatch.bench.truth import Targets, Truth, inside
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import ArrayLike, NDArray

    from mvmatch.bench.datasets import Frames


@dataclass(frozen=True, kw_only=True)
class Patch:
    """An ellipse of picture that moves in a straight line and grows."""

    source: tuple[float, float]
    """Centre in the first picture, whence its texture comes, in units of width and height."""
    radius: tuple[float, float]
    """Half axes at first, in units of the height."""
    start: tuple[float, float]
    """Centre in frame 0, in units of width and height."""
    step: tuple[float, float]
    """Motion per frame, in units of the height."""
    growth: float = 1.0
    """Factor of the size per frame."""

    def frame_from_source(self, frame: int, size: tuple[int, int]) -> NDArray[np.float64]:
        """(2, 3) similarity from the first picture to a frame, px."""
        scale = self.growth**frame
        wide = np.asarray(size, np.float64)
        source = np.asarray(self.source) * wide
        center = np.asarray(self.start) * wide + frame * size[1] * np.asarray(self.step)
        return np.column_stack([scale * np.eye(2), center - scale * source])

    def covers(
        self, frame: int, xy: NDArray[np.float64], size: tuple[int, int]
    ) -> NDArray[np.bool_]:
        """(N,) whether (N, 2) points of a frame, px, lie on it."""
        moved = self.frame_from_source(frame, size)
        local = (xy - moved[:, 2]) / moved[0, 0] - np.asarray(self.source) * np.asarray(size)
        axes = np.asarray(self.radius) * size[1]
        with np.errstate(invalid="ignore"):
            return np.sum((local / axes) ** 2, axis=1) <= 1.0


PATCHES = (
    Patch(source=(0.3, 0.7), radius=(0.16, 0.10), start=(0.15, 0.60), step=(0.012, 0.0)),
    Patch(source=(0.7, 0.6), radius=(0.07, 0.14), start=(0.85, 0.55), step=(-0.008, 0.003)),
    Patch(source=(0.5, 0.6), radius=(0.06, 0.05), start=(0.55, 0.80), step=(0.0, -0.010)),
)
"""A wide one, a tall one and a small one, 4 to 7 px per frame at a height of 540 px; they cover
5 % of a picture of 16:9."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PatchedFrames:
    """Pictures with patches over them, later ones on top."""

    base: Frames
    patches: tuple[Patch, ...]
    size: tuple[int, int]
    """Width and height, px."""

    def __len__(self) -> int:
        return len(self.base)

    def read(self, index: int) -> NDArray[np.uint8]:
        """Return one picture, (H, W, 3) blue green red."""
        cv2 = require_opencv()
        image, first = self.base.read(index), self.base.read(0)
        columns, rows = np.meshgrid(np.arange(self.size[0]) + 0.5, np.arange(self.size[1]) + 0.5)
        centers = np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64)
        for patch in self.patches:
            matrix = patch.frame_from_source(index, self.size)
            # OpenCV's origin is the first pixel's centre.
            matrix[:, 2] += matrix[:, :2] @ [0.5, 0.5] - 0.5
            flags = cv2.INTER_CUBIC
            warped = cv2.warpAffine(
                first, matrix, self.size, flags=flags, borderMode=cv2.BORDER_REFLECT
            )
            covered = patch.covers(index, centers, self.size).reshape(rows.shape)
            image = np.where(covered[:, :, None], warped, image)
        return np.asarray(image, np.uint8)

    def write(self, index: int, path: Path) -> Path:
        """Write one picture as PNG."""
        return write_png(self.read(index), path)


@dataclass(frozen=True, kw_only=True, eq=False)
class PatchedTruth:
    """Truth with patches: what lies on one moves with it, what lies under one is hidden."""

    base: Truth
    patches: tuple[Patch, ...]
    size: tuple[int, int]
    """Width and height, px."""

    def patch_at(self, frame: int, xy: NDArray[np.float64]) -> NDArray[np.int64]:
        """(N,) topmost patch at (N, 2) points, px; -1 for none."""
        top = np.full(len(xy), -1, np.int64)
        for index, patch in enumerate(self.patches):
            top[patch.covers(frame, xy, self.size)] = index
        return top

    def targets(self, frame0: int, frame1: int, xy: ArrayLike) -> Targets:
        """Follow (N, 2) points, px, from one frame into another."""
        points = np.asarray(xy, np.float64).reshape(-1, 2)
        found = self.base.targets(frame0, frame1, points)
        owner = self.patch_at(frame0, points)
        target = np.array(found.xy)
        for index, patch in enumerate(self.patches):
            before = patch.frame_from_source(frame0, self.size)
            after = patch.frame_from_source(frame1, self.size)
            local = (points[owner == index] - before[:, 2]) / before[0, 0]
            target[owner == index] = after[0, 0] * local + after[:, 2]
        visible = np.where(owner < 0, found.visible, inside(target, self.size))
        visible &= self.patch_at(frame1, target) == owner
        return Targets(xy=target, visible=visible, moving=found.moving | (owner >= 0))


def write_png(image: NDArray[np.uint8], path: Path) -> Path:
    """Write a picture, (H, W, 3) blue green red, as PNG; returns its path, suffix set.

    Raises
    ------
    DataError
        It cannot be written.
    """
    target = path.with_suffix(".png")
    if not require_opencv().imwrite(str(target), image):
        raise DataError(f"cannot write {target}")
    return target
