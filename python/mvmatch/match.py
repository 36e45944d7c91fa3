"""What matching a video gives: its tracks, and what was found on the way."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

from mvmatch.types import Tracks

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from mvmatch.errors import MvmatchError
    from mvmatch.footage import Footage
    from mvmatch.sources import FrameFacts, ReferenceStructure, Skipped
    from mvmatch.types import VideoInfo


TrackGroup = Literal["tracks", "further"]
"""A field of :class:`Match`."""


class Progress(Protocol):
    """Told how far a stage is; ``total`` is None where nobody knows."""

    def __call__(self, stage: str, done: int, total: int | None) -> None:
        """Take note."""
        ...


def stage_progress(
    progress: Progress | None, stage: str
) -> Callable[[int, int | None], None] | None:
    """Return the progress of one stage."""
    return None if progress is None else functools.partial(progress, stage)


@dataclass(frozen=True, kw_only=True, eq=False)
class Match:
    """Tracks of a video and how the video was coded."""

    tracks: Tracks
    """What is matched and mapped."""
    further: Tracks
    """Tracks of ``TrackOptions.fill``, which only make a model denser; none without."""
    info: VideoInfo
    """Facts of the video; ``num_frames`` is the number of pictures that were really there."""
    frames: Sequence[FrameFacts]
    """Header facts in decode order."""
    structure: ReferenceStructure
    """Counts of vectors per reference distance and frame pair."""
    footage: Footage
    """Cuts, repeated pictures and static overlays; the tracks heed them."""
    damage: MvmatchError | None
    """Why the stream broke off; the tracks cover the frames before."""
    skipped: tuple[Skipped, ...] = ()
    """What could not be read of a stream that was read on after damage."""
    is_refined: bool = False
    """Whether ``tracks`` are aligned to the pictures (:func:`mvmatch.pictures.refine_match`)."""
    is_further_refined: bool = False
    """Whether ``further`` are."""
    unrefined: str | None = None
    """Why those are not that were to be aligned by themselves."""
    gaps: tuple[int, ...] = ()
    """Pictures after which the scene jumps or so few tracks went on that descriptors were asked
    (:mod:`mvmatch.bridge`); the tracks found are among ``tracks``."""
    bridged: tuple[int, ...] = ()
    """Those of them that descriptors bridged."""
    loops: tuple[tuple[int, int], ...] = ()
    """Pairs of pictures, the earlier first, that are matched however far apart they are: the same
    place seen again (:func:`mvmatch.bridge.close_loops`)."""
    unreadable: str | None = None
    """Why descriptors could not be asked everywhere: what is wrong with the first picture that
    cannot be decoded, or has another size."""

    @property
    def all_tracks(self) -> Tracks:
        """The tracks and the further ones behind them."""
        return Tracks.concatenate(self.tracks, self.further)

    @property
    def num_frames(self) -> int:
        """Pictures, display index 0 to ``num_frames - 1``."""
        return self.info.num_frames or 0

    @property
    def warnings(self) -> list[str]:
        """What makes matching hard, and damage, in sentences."""
        found = self.structure.warnings(self.frames) + self.footage.warnings(len(self.tracks.frame))
        if self.damage is not None:
            found.insert(0, f"The stream broke off after {len(self.frames)} frames: {self.damage}")
        if self.unrefined is not None:
            found.append(f"Tracks are not aligned to the pictures (--refine): {self.unrefined}")
        if self.bridged:
            found.append(
                f"Motion vectors leave {len(self.gaps)} gaps between pictures; {len(self.bridged)} "
                "of them were bridged by matching descriptors, which takes longer."
            )
        if self.unreadable is not None:
            left = [gap for gap in self.gaps if gap not in self.bridged]
            found.append(
                f"Motion vectors leave {len(left)} gaps between pictures that were not bridged by "
                f"descriptors: not all pictures could be read. {self.unreadable}"
            )
        return [*skipped_warnings(self.skipped), *found]


def skipped_warnings(skipped: Sequence[Skipped]) -> list[str]:
    """Say what was left out of a stream: the first five places, and how many more there are."""
    shown = [f"A part of the stream was skipped. {part}" for part in skipped[:5]]
    if len(skipped) > 5:
        shown.append(f"{len(skipped) - 5} more parts of the stream were skipped.")
    return shown
