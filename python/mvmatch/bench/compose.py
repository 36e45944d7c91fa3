"""What recorded sequences lack, composed from their frames with the truth carried along.

A composed frame is a frame of the base seen through a homography, with a static overlay on top.
Nothing is stored: pictures are made when they are read.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.baselines.images import require_opencv
from mvmatch.bench.datasets import Frames, Sequence
from mvmatch.bench.patches import PATCHES, PatchedFrames, PatchedTruth, write_png
from mvmatch.bench.truth import StillTruth, Targets, Truth, inside
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import pycolmap
    from numpy.typing import ArrayLike, NDArray

_CENTER = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
"""px of COLMAP's origin from OpenCV's."""

SHUTTER = 0.5
"""Frames that a picture of `shake` is exposed for."""

BLUR_STEPS = 8
"""Moments that such a picture is the mean of."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Composition:
    """How frames come from those of a base."""

    base_frame: NDArray[np.int64]
    """(F,) frame of the base that each frame shows."""
    base_from_composed: NDArray[np.float64]
    """(F, 3, 3) homographies, px."""
    size: tuple[int, int]
    """Width and height, px."""
    overlay: NDArray[np.uint8] | None = None
    """(H, W, 4) blue green red and opacity, 0 or 255; the same on every frame."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ComposedFrames:
    """Pictures of a composition."""

    base: Frames
    how: Composition

    def __len__(self) -> int:
        return len(self.how.base_frame)

    def read(self, index: int) -> NDArray[np.uint8]:
        """Return one picture, (H, W, 3) blue green red."""
        cv2 = require_opencv()
        image = self.base.read(int(self.how.base_frame[index]))
        matrix = np.linalg.inv(_CENTER) @ self.how.base_from_composed[index] @ _CENTER
        if not np.allclose(matrix, np.eye(3), atol=1e-12):
            flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
            border = cv2.BORDER_REPLICATE
            image = cv2.warpPerspective(
                image, matrix, self.how.size, flags=flags, borderMode=border
            )
        if self.how.overlay is not None:
            covered = self.how.overlay[:, :, 3:] > 0
            image = np.where(covered, self.how.overlay[:, :, :3], image)
        return np.asarray(image, np.uint8)

    def write(self, index: int, path: Path) -> Path:
        """Write one picture as PNG."""
        return write_png(self.read(index), path)


@dataclass(frozen=True, kw_only=True, eq=False)
class BlurredFrames:
    """Pictures that are the mean of those at several moments."""

    steps: tuple[ComposedFrames, ...]

    def __len__(self) -> int:
        return len(self.steps[0])

    def read(self, index: int) -> NDArray[np.uint8]:
        """Return one picture, (H, W, 3) blue green red."""
        light = np.mean([step.read(index) for step in self.steps], axis=0)
        return np.asarray(np.rint(light), np.uint8)

    def write(self, index: int, path: Path) -> Path:
        """Write one picture as PNG."""
        return write_png(self.read(index), path)


@dataclass(frozen=True, kw_only=True, eq=False)
class ComposedTruth:
    """Truth of a composition: through the base and back. Nothing under the overlay is visible.

    A point on the overlay belongs to no place of the scene: whatever it is matched with is wrong.
    """

    base: Truth
    how: Composition

    def targets(self, frame0: int, frame1: int, xy: ArrayLike) -> Targets:
        """Follow (N, 2) points, px, from one frame into another."""
        points = np.asarray(xy, np.float64).reshape(-1, 2)
        start = _mapped(self.how.base_from_composed[frame0], points)
        frames = int(self.how.base_frame[frame0]), int(self.how.base_frame[frame1])
        found = self.base.targets(*frames, start)
        target = _mapped(np.linalg.inv(self.how.base_from_composed[frame1]), found.xy)
        visible = found.visible & inside(target, self.how.size)
        visible &= ~self._covered(points) & ~self._covered(target)
        return Targets(xy=target, visible=visible, moving=found.moving)

    def _covered(self, xy: NDArray[np.float64]) -> NDArray[np.bool_]:
        if self.how.overlay is None:
            return np.zeros(len(xy), np.bool_)
        limit = np.asarray(self.how.size) - 1
        pixel = np.clip(np.nan_to_num(np.floor(xy), nan=0.0), 0, limit).astype(np.int64)
        return self.how.overlay[pixel[:, 1], pixel[:, 0], 3] > 0


def repeats(base: Sequence) -> Sequence:
    """Show every fourth frame twice, as a conversion from 24 to 30 frames per second does."""
    return _composed(base, "repeats", _indexed(base, np.arange(len(base) * 5 // 4) * 4 // 5))


def cut(base: Sequence) -> Sequence:
    """Jump from the first third of the frames to the last third."""
    third = max(2, len(base) // 3)
    frames = np.concatenate([np.arange(third), np.arange(len(base) - third, len(base))])
    return _composed(base, "cut", _indexed(base, frames))


def overlay(base: Sequence) -> Sequence:
    """Cover the pictures with a logo, a letterbox and a dashboard that do not move."""
    how = _indexed(base, np.arange(len(base)))
    painted = Composition(
        base_frame=how.base_frame,
        base_from_composed=how.base_from_composed,
        size=how.size,
        overlay=paint_overlay(base.size),
    )
    return _composed(base, "overlay", painted)


def full_hd(base: Sequence) -> Sequence:
    """Enlarge to a height of 1080 px (cubic): the size of ordinary video, not its detail."""
    import pycolmap

    width, height = base.size
    size = (round(width * 1080 / height), 1080)
    scale = np.diag([width / size[0], height / size[1], 1.0])
    how = Composition(
        base_frame=np.arange(len(base)),
        base_from_composed=np.broadcast_to(scale, (len(base), 3, 3)),
        size=size,
    )
    camera = pycolmap.Camera(base.camera.todict())
    camera.rescale(*size)
    return _composed(base, "1080p", how, camera=camera)


def pan(base: Sequence) -> Sequence:
    """Turn a camera of two thirds the width and height over the first picture, without parallax.

    Raises
    ------
    DataError
        The lens of the base has distortion: its pictures are no homographies of each other.
    """
    inner = _inner(base, 2 / 3)
    phase = 2 * np.pi * np.arange(len(base)) / 60
    rotations = np.array(
        [
            _turn(0.8 * inner.swing[0] * math.sin(p), 0.4 * inner.swing[1] * math.sin(2 * p))
            for p in phase
        ]
    )
    how = inner.seen(np.zeros(len(base), np.int64), rotations)
    poses = np.concatenate([rotations, np.zeros((len(base), 3, 1))], axis=2)
    truth = StillTruth(base.size)
    return _composed(base, "pan", how, camera=inner.camera, poses=poses, truth=truth)


def shake(base: Sequence) -> Sequence:
    """Shake a camera of three quarters the width and height, and blur by half a frame's turning.

    Raises
    ------
    DataError
        As for :func:`pan`.
    """
    inner = _inner(base, 3 / 4)
    frames = np.arange(len(base))

    def turned(time: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([_turn(*(inner.swing * _unrest(moment))) for moment in time])

    exposed = (np.arange(BLUR_STEPS) + 0.5) / BLUR_STEPS - 0.5
    moments = [inner.seen(frames, turned(frames + SHUTTER * offset)) for offset in exposed]
    rotations = turned(frames.astype(np.float64))
    how = inner.seen(frames, rotations)
    shaken = _composed(
        base, "shake", how, camera=inner.camera, poses=rotations @ base.cam_from_world
    )
    steps = tuple(ComposedFrames(base=base.frames, how=moment) for moment in moments)
    return replace(shaken, frames=BlurredFrames(steps=steps))


def movers(base: Sequence) -> Sequence:
    """Let three pieces of the first picture move over all pictures."""
    frames = PatchedFrames(base=base.frames, patches=PATCHES, size=base.size)
    truth = base.truth
    if truth is not None:
        truth = PatchedTruth(base=truth, patches=PATCHES, size=base.size)
    return replace(base, name=f"{base.name}+movers", frames=frames, truth=truth)


COMPOSITIONS: dict[str, Callable[[Sequence], Sequence]] = {
    "repeats": repeats,
    "cut": cut,
    "overlay": overlay,
    "1080p": full_hd,
    "pan": pan,
    "shake": shake,
    "movers": movers,
}
"""By the name that follows the plus sign."""


def paint_overlay(size: tuple[int, int]) -> NDArray[np.uint8]:
    """Paint letterbox, logo and dashboard.

    Returns
    -------
    (H, W, 4) uint8
        Blue green red and opacity, 0 or 255. The logo and the dashboard have texture, so that
        nothing but their standing still gives them away.
    """
    width, height = size
    picture = np.zeros((height, width, 4), np.uint8)
    bar = max(2, height // 14)
    picture[:bar, :, 3] = picture[-bar:, :, 3] = 255
    generator = np.random.default_rng(0)
    side = max(8, height // 8)
    logo = np.kron(generator.integers(0, 2, (4, 4)) * 190 + 40, np.ones((side // 4, side // 4)))
    top, left = bar + side // 2, width - side - side // 2
    area = picture[top : top + len(logo), left : left + len(logo)]
    area[:, :, :3], area[:, :, 3] = logo[:, :, None], 255
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.arange(height))
    dashboard = (y >= height - bar - (1 - x**4) * height / 6) & (y < height - bar)
    grain = np.kron(generator.integers(30, 90, (height // 4 + 1, width // 4 + 1)), np.ones((4, 4)))
    picture[dashboard, :3] = grain[:height, :width][dashboard][:, None]
    picture[dashboard, 3] = 255
    return picture


def _composed(
    base: Sequence,
    name: str,
    how: Composition,
    *,
    camera: pycolmap.Camera | None = None,
    poses: NDArray[np.float64] | None = None,
    truth: Truth | None = None,
) -> Sequence:
    truth = base.truth if truth is None else truth
    return Sequence(
        name=f"{base.name}+{name}",
        frames=ComposedFrames(base=base.frames, how=how),
        camera=base.camera if camera is None else camera,
        cam_from_world=base.cam_from_world[how.base_frame] if poses is None else poses,
        truth=None if truth is None else ComposedTruth(base=truth, how=how),
    )


def _indexed(base: Sequence, frames: NDArray[np.int64]) -> Composition:
    identity = np.broadcast_to(np.eye(3), (len(frames), 3, 3))
    return Composition(base_frame=frames, base_from_composed=identity, size=base.size)


def _mapped(matrix: NDArray[np.float64], xy: NDArray[np.float64]) -> NDArray[np.float64]:
    mapped = np.column_stack([xy, np.ones(len(xy))]) @ matrix.T
    return mapped[:, :2] / mapped[:, 2:]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Inner:
    """A camera without distortion that sees a part of what another one sees, and turns."""

    camera: pycolmap.Camera
    swing: NDArray[np.float64]
    """(2,) radians to the right and down that it turns until the other picture ends."""
    K: NDArray[np.float64]
    """(3, 3) of the other camera."""

    def seen(self, base_frame: NDArray[np.int64], rotations: NDArray[np.float64]) -> Composition:
        """Frames of the other camera after (F, 3, 3) turns."""
        back = rotations.transpose(0, 2, 1) @ np.linalg.inv(self.camera.calibration_matrix())
        return Composition(
            base_frame=base_frame,
            base_from_composed=self.K @ back,
            size=(self.camera.width, self.camera.height),
        )


def _inner(base: Sequence, share: float) -> _Inner:
    """Return a camera of a share of the width and height of a base without distortion."""
    import pycolmap

    if base.camera.model_name not in {"PINHOLE", "SIMPLE_PINHOLE"}:
        raise DataError(
            f"{base.name} has a {base.camera.model_name} camera; it has to turn, and that needs "
            "one without distortion"
        )
    K = base.camera.calibration_matrix()
    size = np.array([int(share * side / 2 + 1e-9) * 2 for side in base.size])
    focal = K[[0, 1], [0, 1]]
    camera = pycolmap.Camera(
        model="PINHOLE", width=size[0], height=size[1], params=[*focal, *(size / 2)]
    )
    camera.has_prior_focal_length = base.camera.has_prior_focal_length
    swing = np.arctan(np.array(base.size) / 2 / focal) - np.arctan(size / 2 / focal)
    return _Inner(camera=camera, swing=swing, K=K)


def _unrest(time: float) -> NDArray[np.float64]:
    """(2,) hand shake to the right and down, -0.8 to 0.8: slow, quick and trembling, in frames."""
    periods, share = np.array([23.0, 8.3, 3.4]), np.array([0.5, 0.2, 0.1])
    phases = np.array([[0.0, 1.3, 2.9], [2.1, 0.4, 5.0]])
    return (np.sin(2 * np.pi * time / periods + phases) * share).sum(axis=1)


def _turn(yaw: float, pitch: float) -> NDArray[np.float64]:
    """(3, 3) camera from still: right by ``yaw``, down by ``pitch``, radians."""
    a, b, c, d = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    return np.array([[1, 0, 0], [0, c, -d], [0, d, c]]) @ np.array(
        [[a, 0, -b], [0, 1, 0], [b, 0, a]]
    )
