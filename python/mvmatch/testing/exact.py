"""Exact motion fields and point paths of a synthetic scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvmatch.types import MotionField

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from mvmatch.testing.scene import SyntheticScene


def exact_motion_field(
    scene: SyntheticScene,
    frame: int,
    *,
    ref_frame: int | None = None,
    block_size: int = 16,
    quantize: bool = True,
) -> MotionField:
    """Make the motion field that a perfect encoder with square blocks would write.

    Parameters
    ----------
    frame : frame number; 0 is a key frame without vectors.
    ref_frame : frame all vectors point to, the previous one by default.
    block_size : side of the blocks, px. Blocks overhang the picture as in AV1.
    quantize : round vectors to 1/8 px as in a bitstream, else keep them exact.

    Returns
    -------
    One row per block whose centre is visible in both frames; the others are intra.
    """
    ref_frame = frame - 1 if ref_frame is None else ref_frame
    x, y = np.meshgrid(
        np.arange(0, scene.width, block_size), np.arange(0, scene.height, block_size)
    )
    corner = np.column_stack([x.ravel(), y.ravel()])
    center = corner + block_size / 2
    kept = (center < (scene.width, scene.height)).all(axis=1)
    corner, center = corner[kept], center[kept]
    if frame == 0:
        corner, center = corner[:0], center[:0]
    target, visible = scene.transfer(frame, max(ref_frame, 0), center)
    mv = (target - center)[visible]
    if quantize:
        mv = np.rint(mv * 8) / 8
    size = np.full((int(visible.sum()), 2), block_size)
    return _field(scene, frame, ref_frame, np.hstack([corner[visible], size]), mv)


def _field(
    scene: SyntheticScene,
    frame: int,
    ref_frame: int,
    block: NDArray[np.int64],
    mv: NDArray[np.float64],
) -> MotionField:
    count = len(block)
    return MotionField(
        frame=frame,
        decode_index=frame,
        pts=frame / 10.0,
        width=scene.width,
        height=scene.height,
        is_key=frame == 0,
        is_shown=True,
        block=block.astype(np.int32),
        mv=mv.astype(np.float32),
        ref_frame=np.full(count, ref_frame, np.int32),
        flags=np.zeros(count, np.uint16),
        segment_id=np.zeros(count, np.uint8),
        qindex=np.full(count, 100, np.uint8),
        residual=np.zeros(count, np.float32),
        warp=np.full((count, 6), np.nan),
    )


def exact_motion_fields(scene: SyntheticScene, *, block_size: int = 16) -> Iterator[MotionField]:
    """Yield the exact field of every frame, each pointing to the previous frame."""
    for frame in range(scene.num_frames):
        yield exact_motion_field(scene, frame, block_size=block_size)


def exact_paths(scene: SyntheticScene, frame: int, xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Follow points of one frame through the whole clip.

    Parameters
    ----------
    frame : frame number the points are given in.
    xy : (N, 2) px.

    Returns
    -------
    (F, N, 2) px: where each point lies in each frame, NaN where it is hidden or outside.
    """
    paths = np.empty((scene.num_frames, len(xy), 2))
    for other in range(scene.num_frames):
        target, visible = scene.transfer(frame, other, xy)
        paths[other] = np.where(visible[:, None], target, np.nan)
    return paths
