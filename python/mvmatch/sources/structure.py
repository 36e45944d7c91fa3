"""How a stream refers to its past: what decides whether its vectors can be chained."""

from __future__ import annotations

from array import array
from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.pairing import sum_by_pair

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from mvmatch.sources.frames import FrameFacts
    from mvmatch.types import MotionField


class ReferenceStructure:
    """Counts over a whole stream: rows and area per reference distance, key frames, hidden frames.

    Feed every field with :meth:`add`; a *distance* is ``frame - ref_frame`` in display order, so 1
    is the previous picture and a negative one lies in the future.
    """

    def __init__(self) -> None:
        self._rows: Counter[int] = Counter()
        self._area: Counter[int] = Counter()
        self._inter_area = 0.0
        self._inter_picture_area = 0.0
        # Flat, so that an hour of video stays small: (frame, vectors), (frame, reference, vectors).
        self._per_frame = array("q")
        self._pairs = array("q")

    def add(self, field: MotionField) -> None:
        """Count one field."""
        self._per_frame.extend((field.frame, len(field)))
        if field.is_key:
            return
        area = _area_inside(field)
        distances, index = np.unique(field.frame - field.ref_frame, return_inverse=True)
        num_rows, areas = np.bincount(index), np.bincount(index, weights=area)
        for distance, rows, size in zip(distances.tolist(), num_rows, areas, strict=True):
            self._rows[distance] += int(rows)
            self._area[distance] += int(size)
            self._pairs.extend((field.frame, field.frame - distance, int(rows)))
        self._inter_area += float(area[_first_rows(field)].sum())
        self._inter_picture_area += float(field.width * field.height)

    @property
    def share_to_previous(self) -> float:
        """Share of the vectors' area that refers to the previous picture; NaN without vectors."""
        total = sum(self._area.values())
        return self._area[1] / total if total else float("nan")

    @property
    def inter_area_share(self) -> float:
        """Share of the inter frames' area that has a vector; NaN without inter frames."""
        if not self._inter_picture_area:
            return float("nan")
        return self._inter_area / self._inter_picture_area

    @property
    def num_vectors(self) -> int:
        """Vectors counted so far."""
        return sum(self._rows.values())

    @property
    def vectors_per_frame(self) -> dict[int, int]:
        """Vectors per display index."""
        return dict(sorted(zip(self._per_frame[::2], self._per_frame[1::2], strict=True)))

    def adjacency(self, num_frames: int) -> NDArray[np.int64]:
        """(P, 3) ``[frame0, frame1, vectors]`` of the first frames, before any tracking.

        As :meth:`mvmatch.types.Tracks.adjacency`; both directions of a pair count together.
        """
        pairs = np.array(self._pairs, np.int64).reshape(-1, 3)
        return sum_by_pair(pairs[pairs[:, :2].max(axis=1, initial=0) < num_frames])

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return all counts as arrays, to be stored."""
        distances = sorted(self._rows)
        counts = [(each, self._rows[each], self._area[each]) for each in distances]
        return {
            "per_distance": np.array(counts, np.int64).reshape(-1, 3),
            "per_frame": np.array(self._per_frame, np.int64).reshape(-1, 2),
            "per_pair": np.array(self._pairs, np.int64).reshape(-1, 3),
            "inter_area": np.array([self._inter_area, self._inter_picture_area]),
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> ReferenceStructure:
        """Return the counts that :meth:`to_arrays` gave."""
        structure = cls()
        for distance, rows, area in arrays["per_distance"].tolist():
            structure._rows[distance], structure._area[distance] = rows, area
        structure._per_frame.extend(arrays["per_frame"].ravel().tolist())
        structure._pairs.extend(arrays["per_pair"].ravel().tolist())
        structure._inter_area, structure._inter_picture_area = arrays["inter_area"].tolist()
        return structure

    def summary(self, frames: Sequence[FrameFacts]) -> dict[str, Any]:
        """Return the counts as plain numbers for reports (docs/reference/report-schema.md)."""
        counts, keys = _count(frames)
        total_area = sum(self._area.values())
        return {
            "coded_frames": counts["coded"],
            "shown_frames": counts["shown"],
            "hidden_frames": counts["hidden"],
            "repeated_frames": counts["repeated"],
            "key_frames": keys,
            "intra_frames": counts["intra"],
            "num_vectors": self.num_vectors,
            "vectors_per_distance": {str(d): self._rows[d] for d in sorted(self._rows)},
            "area_share_per_distance": {
                str(d): self._area[d] / total_area for d in sorted(self._area) if total_area
            },
            "share_to_previous": _finite(self.share_to_previous),
            "inter_area_share": _finite(self.inter_area_share),
            "median_vectors_per_frame": (
                float(np.median(list(self.vectors_per_frame.values()))) if self._per_frame else 0.0
            ),
        }

    def warnings(self, frames: Sequence[FrameFacts]) -> list[str]:
        """Say in whole sentences what will make matching hard."""
        found: list[str] = []
        counts, keys = _count(frames)
        if counts["coded"] > 1 and len(keys) == counts["coded"]:
            found.append(
                "Every frame is a key frame: there are no motion vectors at all. "
                "Re-encode the video for matching (mvmatch encode)."
            )
        elif len(keys) > 1:
            spacing = counts["coded"] / len(keys)
            tail = " Tracks cannot reach three frames." if spacing < 3 else ""
            found.append(
                f"{len(keys)} key frames, one in {spacing:.1f} frames: every one cuts all tracks."
                f"{tail} Re-encoding for matching (mvmatch encode) removes them."
            )
        if self.num_vectors and self.share_to_previous < 0.5:
            found.append(
                f"Only {self.share_to_previous:.0%} of the vectors' area refers to the previous "
                "picture: neighbouring frames share few tracks."
            )
        if self.num_vectors and self.inter_area_share < 0.25:
            found.append(
                f"Only {self.inter_area_share:.0%} of the pictures' area has a vector: "
                "the encoder found little motion it could use."
            )
        return found


def _count(frames: Sequence[FrameFacts]) -> tuple[Counter[str], list[int]]:
    """Count kinds of frames in one pass; return the display indices of key frames too."""
    counts: Counter[str] = Counter()
    keys: list[int] = []
    for frame in frames:
        counts["shown"] += frame.is_shown
        if frame.is_repeat:
            counts["repeated"] += 1
            continue
        counts["coded"] += 1
        counts["hidden"] += not frame.is_shown
        counts["intra"] += frame.frame_type in {"KEY", "INTRA_ONLY"}
        if frame.frame_type == "KEY":
            keys.append(frame.display_index)
    return counts, keys


def _first_rows(field: MotionField) -> NDArray[np.int64]:
    """(B,) first row of every block; a compound block has one row per reference.

    Blocks are told apart by their upper-left corners: ``np.unique`` of whole rows takes ten times
    as long.
    """
    corner = field.block[:, 1].astype(np.int64) * field.width + field.block[:, 0]
    order = np.argsort(corner, kind="stable")
    return order[np.diff(corner[order], prepend=-1) != 0]


def _area_inside(field: MotionField) -> NDArray[np.int64]:
    """Area in px² of each block inside the picture."""
    block = field.block.astype(np.int64)
    right = np.minimum(block[:, 0] + block[:, 2], field.width)
    below = np.minimum(block[:, 1] + block[:, 3], field.height)
    return np.maximum(right - block[:, 0], 0) * np.maximum(below - block[:, 1], 0)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
