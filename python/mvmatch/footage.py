"""What the footage itself does to tracks: cuts, repeated pictures, static overlays."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.batches import track_batches
from mvmatch.cells import field_cells
from mvmatch.overlays import OverlayFinder, OverlayOptions, Overlays
from mvmatch.rows import count_entering
from mvmatch.shots import CutFinder, ShotOptions, end_tracks, find_repeats

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence

    from mvmatch.types import MotionField, Tracks


MIN_OVERLAY_DENSITY = 0.1
"""Observations per area on overlays, over those of the whole picture. A far sky between houses can
stand still like an overlay, but carries hardly a point: 0.015 of the usual density in the demo,
where logos have 0.4 and more (docs/explanation/moving-objects.md)."""


_STILL_SHARE = 0.5
"""Share of the area. Measured: about 0.7 on a tripod with moving things in view, at most 0.05 in
nine of ten frames where a camera moves, a stop included."""


@dataclass(frozen=True, kw_only=True)
class FootageOptions:
    """What is looked for in the footage."""

    shots: ShotOptions = field(default_factory=ShotOptions)
    """Scene cuts and repeated pictures."""
    overlays: OverlayOptions = field(default_factory=OverlayOptions)
    """Logos, dashboards, letterboxes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Footage:
    """What was found."""

    cuts: tuple[int, ...]
    """First pictures of new shots, key frames left out."""
    jumps: tuple[int, ...]
    """Pictures before which a piece of the scene is missing; tracks go on where vectors do."""
    repeats: tuple[int, ...]
    """Pictures that show the one before them again."""
    overlays: Overlays
    """Where static overlays lie."""
    num_overlay_observations: int
    """Observations that lay on them, and are not in the tracks."""
    breaks: tuple[int, ...]
    """First pictures of parts that no track connects: cuts, key frames, damage."""
    still_area_share: float = 0.0
    """Share of the area that has a vector and does not move, at least, in nine of ten coded frames;
    key frames are left out."""

    @property
    def stands_still(self) -> bool:
        """Whether the camera does not move, even if tracks know nothing of zero vectors."""
        return self.still_area_share > _STILL_SHARE

    def warnings(self, num_observations: int) -> list[str]:
        """Say in whole sentences what it means for a model, whose tracks have so many points."""
        found: list[str] = []
        if self.cuts:
            found.append(
                f"Scene cuts before the pictures {_listed(self.cuts)}, {len(self.cuts)} in all: "
                "tracks end there, and each model holds one shot. "
                "Give a shot that has none as a video of its own."
            )
        torn = [frame for frame in self.breaks if frame not in self.cuts]
        if torn:
            found.append(
                f"No track goes on into the pictures {_ranges(torn)}, {len(torn)} in all, as at "
                "key frames and damage: each model holds one part between them."
            )
        if self.jumps:
            found.append(
                f"The video jumps before the pictures {_listed(self.jumps)}, {len(self.jumps)} in "
                "all: only few tracks hold what lies before and after together."
            )
        if self.repeats:
            found.append(
                f"Pictures that show the one before them again: {_listed(self.repeats)}, "
                f"{len(self.repeats)} in all. They add no baseline."
            )
        usual = self.overlays.mean_area_share * (num_observations + self.num_overlay_observations)
        if self.num_overlay_observations > MIN_OVERLAY_DENSITY * usual:
            found.append(
                f"Static overlays cover up to {self.overlays.area_share:.1%} of the picture: "
                f"{self.num_overlay_observations:,} observations on them were left out. "
                "--set footage.overlays.min_still=off keeps them."
            )
        return found

    def without(self, joined: Collection[int]) -> Footage:
        """Return the same without the cuts, breaks and jumps before some pictures."""
        left = {
            name: tuple(frame for frame in getattr(self, name) if frame not in joined)
            for name in ("cuts", "breaks", "jumps")
        }
        return dataclasses.replace(self, **left)

    def longest_shot(self, num_frames: int) -> int:
        """Pictures between two breaks, at most."""
        return max(end - start for start, end in pairwise([0, *self.breaks, num_frames]))

    def summary(self) -> dict[str, Any]:
        """Return plain numbers for reports (docs/reference/report-schema.md)."""
        return {
            "cuts": list(self.cuts),
            "breaks": list(self.breaks),
            "jumps": list(self.jumps),
            "repeats": list(self.repeats),
            "overlay_area_share": self.overlays.area_share,
            "num_overlay_observations": self.num_overlay_observations,
            "still_area_share": self.still_area_share,
        }


class FootageObserver:
    """Looks at motion fields as they pass, then at the tracks made from them."""

    def __init__(self, options: FootageOptions | None = None) -> None:
        self._options = options or FootageOptions()
        self._cuts = CutFinder(self._options.shots)
        self._overlays = OverlayFinder(self._options.overlays)
        self._still: list[float] = []

    def watch(self, fields: Iterable[MotionField]) -> Iterator[MotionField]:
        """Pass fields on, in decode order."""
        for motion in fields:
            cells = field_cells(motion)
            self._cuts.add(motion, cells)
            self._overlays.add(motion, cells)
            if not motion.is_key:
                self._still.append(float(cells.still.mean()))
            yield motion

    def clean(self, tracks: Tracks, *, min_length: int) -> tuple[Tracks, Footage]:
        """Take observations on overlays out of tracks, and end tracks at cuts.

        Parameters
        ----------
        tracks : Tracks
            Made from the fields that were watched.
        min_length : int
            Observations; shorter remains of a track are dropped.
        """
        overlays = self._overlays.overlays()
        cuts = self._cuts.cuts(overlays)
        cleaned, num_dropped = _cleaned(tracks, cuts, overlays, min_length)
        footage = Footage(
            cuts=cuts,
            jumps=self._cuts.jumps(overlays),
            repeats=find_repeats(cleaned, self._options.shots),
            overlays=overlays,
            num_overlay_observations=num_dropped,
            breaks=_breaks(cleaned),
            still_area_share=float(np.quantile(self._still, 0.1)) if self._still else 0.0,
        )
        return cleaned, footage


def _cleaned(
    tracks: Tracks, cuts: tuple[int, ...], overlays: Overlays, min_length: int
) -> tuple[Tracks, int]:
    """Return tracks that end at cuts and overlays, and how many observations lay on overlays."""
    if not cuts and not overlays.cells.any():
        return tracks, 0
    num_dropped = 0
    with track_batches() as batches:
        for part in tracks.parts():
            drop = overlays.contain(part.frame, part.xy)
            num_dropped += int(drop.sum())
            kept = end_tracks(part, cuts=cuts, drop=drop, min_length=min_length)
            batches.add(kept.offsets, kept.frame, kept.xy)
        return batches.tracks(), num_dropped


def _breaks(tracks: Tracks) -> tuple[int, ...]:
    """Return the pictures that no track enters from the one before, up to the last with tracks."""
    entering = count_entering(tracks, tracks.num_frames)
    return tuple(int(frame) for frame in np.flatnonzero(entering[1:] == 0) + 1)


def _ranges(frames: Sequence[int]) -> str:
    """Name the first five runs of frames."""
    starts = [frame for frame in frames if frame - 1 not in frames]
    ends = [frame for frame in frames if frame + 1 not in frames]
    runs = [f"{a}" if a == b else f"{a} to {b}" for a, b in zip(starts, ends, strict=True)]
    return ", ".join(runs[:5]) + (" …" if runs[5:] else "")


def _listed(frames: Sequence[int]) -> str:
    """Name the first five frames."""
    return ", ".join(str(frame) for frame in frames[:5]) + (" …" if frames[5:] else "")
