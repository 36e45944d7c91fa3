"""The four nouns of mvmatch: motion fields, correspondences, tracks, scores.

All coordinates are pixels in COLMAP's convention: the origin is the upper-left image corner and
the centre of the first pixel lies at (0.5, 0.5). Order is ``[x, y]``. A frame number is a display
index.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class MotionFlags(enum.IntFlag):
    """How the encoder coded the block a vector belongs to (bits of ``MotionField.flags``)."""

    SKIP = 1
    """No residual was coded: the prediction was good enough."""
    COMPOUND = 2
    """The block averages two references; it has one row for each."""
    OVERLAPPED = 4
    """Overlapped block motion compensation (OBMC)."""
    WARPED = 8
    """A local affine model was used; ``warp`` holds it."""
    GLOBAL = 16
    """The vector comes from the frame's global motion model."""
    INTERINTRA = 32
    """Inter prediction blended with intra prediction."""


@dataclass(frozen=True, kw_only=True)
class VideoInfo:
    """What a container and the first sequence header say about a video."""

    width: int
    """Width in px of the shown picture."""
    height: int
    """Height in px of the shown picture."""
    num_frames: int | None
    """Number of shown frames, when the container knows it."""
    frame_rate: float | None
    """Frames per second, when the container knows it."""
    codec: str
    """Short codec name, ``"av1"``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionField:
    """All vectors of one coded frame; one row per block and reference.

    ``xy_in_reference = xy_in_current + mv``. Intra blocks have no row; a row with ``mv == (0, 0)``
    is a real zero vector.
    """

    frame: int
    """Display index of the frame the blocks belong to."""
    decode_index: int
    """Position in decode order; references always have smaller ones."""
    pts: float | None
    """Presentation time in s, from the container."""
    width: int
    """Frame width in px."""
    height: int
    """Frame height in px."""
    is_key: bool
    """Whether the frame is intra coded throughout (key or intra-only)."""
    is_shown: bool
    """Whether the coded frame itself is displayed; False for hidden references."""
    block: NDArray[np.int32]
    """(N, 4) ``[x, y, w, h]`` px; may overhang the right and lower picture edge."""
    mv: NDArray[np.float32]
    """(N, 2) ``[dx, dy]`` px, multiples of 1/8."""
    ref_frame: NDArray[np.int32]
    """(N,) display index of the reference; never equal to ``frame``."""
    flags: NDArray[np.uint16]
    """(N,) bits of :class:`MotionFlags`."""
    segment_id: NDArray[np.uint8]
    """(N,) segment, 0 when segmentation is off."""
    qindex: NDArray[np.uint8]
    """(N,) quantiser index of the block."""
    residual: NDArray[np.float32]
    """(N,) sum of absolute quantised luma coefficient levels: the residual-energy proxy."""
    warp: NDArray[np.float64]
    """(N, 6) affine model ``[a, b, c, d, e, f]``, NaN without one:
    ``xy_in_reference = [a x + b y + c, d x + e y + f]`` in px."""

    @property
    def centers(self) -> NDArray[np.float32]:
        """(N, 2) block centres in px."""
        import numpy as np

        block = self.block.astype(np.float32)
        centers = block[:, :2] + block[:, 2:] / np.float32(2)
        return centers.astype(np.float32, copy=False)

    def __len__(self) -> int:
        return len(self.block)


@dataclass(frozen=True, kw_only=True, eq=False)
class Correspondences:
    """Paired points of one image pair."""

    frame0: int
    frame1: int
    xy0: NDArray[np.float32]
    """(N, 2) px in ``frame0``."""
    xy1: NDArray[np.float32]
    """(N, 2) px in ``frame1``."""

    def __len__(self) -> int:
        return len(self.xy0)


@dataclass(frozen=True, kw_only=True)
class TwoViewScore:
    """Two-view geometry of one image pair; a failed fit is a row with zero inliers."""

    frame0: int
    frame1: int
    model: Literal["E", "H"] | None
    num_correspondences: int
    num_inliers: int
    inlier_ratio: float
    median_sampson_px: float
    """Median Sampson distance of the inliers in px; NaN without inliers."""
    median_sampson_normalized: float
    """Median squared Sampson error of the inliers in normalised camera units (the paper's)."""
