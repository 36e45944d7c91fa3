"""Does a coded stream suit matching? Read with mvmatch's own parser, while packets pass by."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.types import MotionFlags

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from mvmatch._core import CodedFrame

MIN_PREVIOUS_SHARE = 0.9
"""Stock encoders reach 0.96 (libaom realtime) to 1.0 (SVT, flat) when set up for matching."""


@dataclass(frozen=True, kw_only=True)
class EncodingCheck:
    """Reference structure of a coded stream."""

    num_frames: int
    """Coded frames, hidden ones included."""
    num_hidden: int
    """Coded frames that are not displayed themselves."""
    key_frames: tuple[int, ...]
    """Display indices of frames without any reference (key and intra-only)."""
    distance_share: Mapping[int, float]
    """Share of the area covered by vectors, per ``frame - ref_frame``; negative: future."""
    covered: float
    """Share of the picture area of inter frames that has a vector."""

    @property
    def previous_share(self) -> float:
        """Share of the covered area whose vectors point to the previous frame."""
        return self.distance_share.get(1, 0.0)

    def warnings(self) -> tuple[str, ...]:
        """One sentence for each thing that will hurt matching."""
        found: list[str] = []
        if self.num_frames and len(self.key_frames) == self.num_frames:
            found.append("every frame is a key frame: there are no motion vectors to match with")
            return tuple(found)
        if len(self.key_frames) > 1:
            listed = ", ".join(str(frame) for frame in self.key_frames[1:6])
            more = ", ..." if len(self.key_frames) > 6 else ""
            found.append(f"tracks are cut at the key frames {listed}{more}")
        if any(distance < 0 for distance in self.distance_share):
            found.append("some vectors point to future frames")
        if self.distance_share and self.previous_share < MIN_PREVIOUS_SHARE:
            found.append(
                f"only {self.previous_share:.0%} of the vectors' area points to the previous frame "
                f"(expected at least {MIN_PREVIOUS_SHARE:.0%})"
            )
        return tuple(found)


@dataclass(kw_only=True)
class EncodingChecker:
    """Accumulates an :class:`EncodingCheck` from coded frames."""

    num_frames: int = 0
    num_hidden: int = 0
    key_frames: list[int] = field(default_factory=list[int])
    area_by_distance: dict[int, float] = field(default_factory=dict[int, float])
    inter_area: float = 0.0

    def push(self, frame: CodedFrame) -> None:
        """Count one ``_core.CodedFrame``."""
        if frame.show_existing_frame:
            return
        self.num_frames += 1
        self.num_hidden += not frame.show_frame
        if frame.frame_type in ("KEY", "INTRA_ONLY"):
            self.key_frames.append(int(frame.display_index))
            return
        self.inter_area += float(frame.upscaled_width) * float(frame.height)
        self.push_motion(int(frame.display_index), frame.motion())

    def push_motion(self, display_index: int, motion: Mapping[str, NDArray[Any]]) -> None:
        """Count the rows of one inter frame: columns as in :class:`mvmatch.types.MotionField`."""
        area = motion["block"][:, 2].astype(np.float64) * motion["block"][:, 3]
        area[(motion["flags"] & MotionFlags.COMPOUND) != 0] /= 2  # one row for each reference
        distances, inverse = np.unique(display_index - motion["ref_frame"], return_inverse=True)
        sums = np.bincount(inverse.ravel(), weights=area, minlength=len(distances))
        for distance, covered in zip(distances.tolist(), sums.tolist(), strict=True):
            self.area_by_distance[distance] = self.area_by_distance.get(distance, 0.0) + covered

    def result(self) -> EncodingCheck:
        """Freeze what was counted."""
        total = sum(self.area_by_distance.values())
        shares = {
            distance: area / total for distance, area in sorted(self.area_by_distance.items())
        }
        return EncodingCheck(
            num_frames=self.num_frames,
            num_hidden=self.num_hidden,
            key_frames=tuple(self.key_frames),
            distance_share=shares,
            covered=min(1.0, total / self.inter_area) if self.inter_area else 0.0,
        )
