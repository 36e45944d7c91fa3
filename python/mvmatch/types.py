"""The four nouns of mvmatch: motion fields, correspondences, tracks, scores.

All coordinates are pixels in COLMAP's convention: the origin is the upper-left image corner and
the centre of the first pixel lies at (0.5, 0.5). Order is ``[x, y]``. A frame number is a display
index.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from os import PathLike

    import numpy as np
    from numpy.typing import NDArray


StrPath: TypeAlias = "str | PathLike[str]"
"""A file or folder, as every public function takes it."""


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

    def select(self, keep: NDArray[np.bool_]) -> MotionField:
        """Field with the rows where the (N,) mask holds."""
        names = ("block", "mv", "ref_frame", "flags", "segment_id", "qindex", "residual", "warp")
        return replace(self, **{name: getattr(self, name)[keep] for name in names})


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracks:
    """Points followed through several frames, in compressed sparse rows.

    Observations of track ``t`` are ``offsets[t]:offsets[t + 1]``. Every observation is a keypoint
    of its frame; keypoints of a frame are numbered in the order of the observations, so the numbers
    stay the same for every pair of frames.

    Arrays of long videos lie in a temporary file and are read-only; :meth:`parts` and
    :meth:`during` go through them without holding them.

    Raises
    ------
    ValueError
        If the arrays do not have the shapes below, or if the frames of a track do not strictly
        increase.

    Examples
    --------
    >>> tracks = Tracks.from_lists([(0, 2.0, 2.0), (1, 6.0, 2.0)], [(1, 9.0, 9.0), (2, 8.0, 9.0)])
    >>> len(tracks), tracks.keypoints(1).tolist()
    (2, [[6.0, 2.0], [9.0, 9.0]])
    >>> [(i, j, matches.tolist()) for i, j, matches in tracks.pairs()]
    [(0, 1, [[0, 0]]), (1, 2, [[1, 0]])]
    """

    offsets: NDArray[np.int64]
    """(T + 1,) start of each track in the observations, the total number of them at the end."""
    frame: NDArray[np.int32]
    """(O,) display index of each observation, at least 0, strictly increasing in a track."""
    xy: NDArray[np.float32]
    """(O, 2) position of each observation in px."""

    def __post_init__(self) -> None:

        from mvmatch.rows import falls, rises_in_tracks

        starts, count = self.offsets, len(self.frame)
        if starts.ndim != 1 or len(starts) == 0 or starts[0] != 0 or starts[-1] != count:
            message = f"offsets must rise from 0 to the number of observations, {count}"
            raise ValueError(message)
        if self.frame.ndim != 1 or self.xy.shape != (count, 2):
            message = (
                f"frame and xy must be (O,) and (O, 2), not {self.frame.shape}, {self.xy.shape}"
            )
            raise ValueError(message)
        if falls(starts):
            message = "offsets must not fall"
            raise ValueError(message)
        if self.frame.min(initial=0) < 0 or not rises_in_tracks(starts, self.frame):
            message = "frames must be display indices that strictly increase in each track"
            raise ValueError(message)

    @classmethod
    def from_lists(cls, *tracks: Sequence[tuple[int, float, float]]) -> Tracks:
        """Tracks from lists of ``(frame, x, y)``, frames rising, px."""
        import numpy as np

        lengths = [len(track) for track in tracks]
        rows = np.array([row for track in tracks for row in track], np.float64).reshape(-1, 3)
        return cls(
            offsets=np.concatenate(([0], np.cumsum(lengths, dtype=np.int64))).astype(np.int64),
            frame=rows[:, 0].astype(np.int32),
            xy=rows[:, 1:].astype(np.float32),
        )

    @classmethod
    def concatenate(cls, *parts: Tracks) -> Tracks:
        """Tracks of all parts, in their order; the first part's keypoints keep their numbers."""
        from mvmatch.batches import joined

        filled = [part for part in parts if len(part)]
        if len(filled) == 1:
            return filled[0]
        return joined(piece for part in filled for piece in part.parts())

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def parts(self, num_observations: int = 1 << 17) -> Iterator[Tracks]:
        """Yield all tracks in their order, about so many observations at a time."""
        import numpy as np

        first = 0
        while first < len(self):
            start = int(self.offsets[first])
            fits = np.searchsorted(self.offsets, start + num_observations, side="right")
            end = max(int(fits) - 1, first + 1)
            rows = slice(start, self.offsets[end])
            offsets = self.offsets[first : end + 1] - start
            yield Tracks(offsets=offsets, frame=self.frame[rows], xy=self.xy[rows])
            first = end

    def during(self, start: int, end: int) -> Tracks:
        """Return what is observed in frames ``start`` to ``end - 1``; keypoints keep their numbers.

        Tracks that are not observed there are left out, so they are numbered anew.
        """
        from mvmatch.rows import during

        return during(self, start, end)[1]

    @cached_property
    def block_frames(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """(B,) smallest and largest frame of every :data:`mvmatch.rows.BLOCK` observations."""
        from mvmatch.rows import block_frames

        return block_frames(self.frame)

    def reach(self, max_gap: int | None = None) -> int:
        """Largest distance in frames between two observations of a track, up to ``max_gap``."""
        from mvmatch.pairing import reach

        return reach(self, max_gap)

    @property
    def num_observations(self) -> int:
        """Observations of all tracks."""
        return len(self.frame)

    @property
    def lengths(self) -> NDArray[np.int64]:
        """(T,) observations of each track."""
        import numpy as np

        return np.diff(self.offsets)

    @cached_property
    def track_index(self) -> NDArray[np.int64]:
        """(O,) track of each observation."""
        import numpy as np

        return np.repeat(np.arange(len(self), dtype=np.int64), self.lengths)

    @cached_property
    def _by_frame(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(O,) observations sorted by frame, and (F + 1,) start of each frame in them."""
        import numpy as np

        from mvmatch.pairing import compact
        from mvmatch.rows import count_keypoints

        order = np.argsort(compact(self.frame, self.num_frames), kind="stable")
        counts = count_keypoints(self, self.num_frames)
        return order, np.concatenate(([0], np.cumsum(counts))).astype(np.int64)

    @cached_property
    def num_frames(self) -> int:
        """One more than the largest frame with an observation; 0 without tracks."""
        return int(self.frame.max(initial=-1)) + 1

    def observations(self, frame: int) -> NDArray[np.int64]:
        """(K,) observations in one frame; entry k is the frame's keypoint k."""
        order, starts = self._by_frame
        if not 0 <= frame < self.num_frames:
            return order[:0]
        return order[starts[frame] : starts[frame + 1]]

    def keypoints(self, frame: int) -> NDArray[np.float32]:
        """(K, 2) keypoints of one frame in px, in the order of their numbers."""
        return self.xy[self.observations(frame)]

    @cached_property
    def keypoint_index(self) -> NDArray[np.uint32]:
        """(O,) number of each observation among the keypoints of its frame."""
        import numpy as np

        order, starts = self._by_frame
        index = np.empty(len(order), np.uint32)
        index[order] = np.arange(len(order)) - starts[self.frame[order]]
        return index

    def between(self, frame0: int, frame1: int) -> Correspondences:
        """Points seen in both of two frames, ordered by track; ``xy0`` lies in ``frame0``."""
        from mvmatch.pairing import shared

        matches = shared(self, frame0, frame1)
        return Correspondences(
            frame0=frame0,
            frame1=frame1,
            xy0=self.keypoints(frame0)[matches[:, 0]],
            xy1=self.keypoints(frame1)[matches[:, 1]],
        )

    def pairs(
        self, max_gap: int | None = None, *, start: int = 0, end: int | None = None
    ) -> Iterator[tuple[int, int, NDArray[np.uint32]]]:
        """Frame pairs that share tracks, with their matches.

        Parameters
        ----------
        max_gap : int, optional
            Largest distance in frames between the two; without it every pair on a track counts.
        start, end : int, optional
            Frames that the earlier ones of the pairs are taken from, ``end`` left out; by default
            all.

        Yields
        ------
        tuple
            ``(frame0, frame1, matches)``: ``frame0 < frame1``, pairs in rising order, ``matches``
            (M, 2) uint32 keypoint numbers in the two frames, ordered by track.
        """
        from mvmatch.pairing import frame_pairs

        return frame_pairs(self, max_gap, start, self.num_frames if end is None else end)

    def adjacency(self, max_gap: int | None = None) -> NDArray[np.int64]:
        """Count the matches of every frame pair; ``max_gap`` as for :meth:`pairs`.

        Returns
        -------
        ndarray
            (P, 3) int64 ``[frame0, frame1, matches]``, ``frame0 < frame1``, pairs in rising order.
        """
        from mvmatch.pairing import adjacency

        return adjacency(self, max_gap)

    def select(self, keep: NDArray[np.bool_]) -> Tracks:
        """Tracks where the (T,) mask holds; keypoints are numbered anew."""
        from mvmatch.batches import joined
        from mvmatch.rows import selected

        return joined(selected(self, keep))
