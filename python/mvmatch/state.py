"""What the stages of a run hand on to each other."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from mvmatch.bridge import find_gaps
from mvmatch.camera import CameraChoice, parse_camera
from mvmatch.opencv import has_opencv
from mvmatch.sfm import Diagnosis
from mvmatch.store import is_table

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from mvmatch.config import RunOptions
    from mvmatch.encode import EncodeResult
    from mvmatch.export.colmap import DatabaseSummary
    from mvmatch.match import Match, Progress, TrackGroup
    from mvmatch.sfm import DensifySummary, ReconstructionResult
    from mvmatch.types import Tracks


@dataclass(kw_only=True, eq=False)
class State:
    """What a run was asked for, and what its stages have handed on so far."""

    source: Path
    options: RunOptions
    camera: str | None
    has_to_encode: bool
    """Whether the source has no motion vectors of its own that are to be used."""
    masks: bool
    undistort: bool
    progress: Progress | None
    encoding: EncodeResult | None = None
    match: Match = field(init=False)
    weights: NDArray[np.float64] | None = None
    """(T,) weight of each track of ``match``, low on moving objects; None: not computed."""
    mask_folder: Path | None = None
    """Masks of all pictures; None: not asked for."""
    database: Path = field(init=False)
    summary: DatabaseSummary = field(init=False)
    model: ReconstructionResult = field(init=False)
    dense: DensifySummary | None = None
    diagnosis: Diagnosis = field(default_factory=Diagnosis)

    @property
    def video(self) -> Path:
        """What motion vectors are read from."""
        return self.source if self.encoding is None else self.encoding.path

    @cached_property
    def choice(self) -> CameraChoice:
        """The camera."""
        info = self.match.info
        return parse_camera(self.camera, info.width, info.height, pictures=self.source)

    @property
    def refines(self) -> tuple[TrackGroup, ...]:
        """Which tracks are to be aligned to the pictures; by itself where it pays and can be done.

        It pays where nobody knows the camera, and for tracks that only make the model denser, if
        there can be one: a camera at rest has none.
        """
        when, match = self.options.refine.when, self.match
        wanted: tuple[tuple[TrackGroup, bool], ...] = (
            ("tracks", when == "always" or self.choice.is_prior),
            ("further", len(match.further) > 0 and not match.footage.stands_still),
        )
        is_fit = match.damage is None and not match.skipped
        is_fit &= max(match.info.width, match.info.height) >= self.options.refine.min_size
        is_fit &= not is_table(self.source) and has_opencv()
        if when == "never" or (when == "auto" and not is_fit):
            return ()
        return tuple(group for group, is_wanted in wanted if is_wanted)

    @property
    def has_gaps(self) -> bool:
        """Whether descriptors are to be asked: there are gaps, and pictures to look at."""
        options, match = self.options.bridge, self.match
        if options.matcher == "none" or match.skipped or is_table(self.source):
            return False
        gaps = find_gaps(
            match.tracks,
            match.num_frames,
            min_tracks=options.min_tracks,
            min_ties=options.min_ties,
            jumps=match.footage.jumps,
        )
        return bool(gaps)

    @property
    def asks_for_loops(self) -> bool:
        """Whether descriptors are to look for loops."""
        return self.options.loops.matcher != "none"

    @property
    def image_names(self) -> tuple[str, ...]:
        """Name of the image of every frame."""
        return self.first_names(self.match.num_frames)

    def first_names(self, num_frames: int) -> tuple[str, ...]:
        """Return the names of the first images."""
        if self.encoding is not None and self.encoding.image_names is not None:
            return self.encoding.image_names[:num_frames]
        return frame_names(num_frames)

    @property
    def tracks(self) -> Tracks:
        """Tracks that go into the database."""
        if self.weights is None or not self.options.movers.exclude:
            return self.match.tracks
        return self.match.tracks.select(self.weights >= self.options.movers.min_weight)

    @property
    def max_gap(self) -> int | None:
        """Largest distance of matched frames; where gaps were bridged, it spans the widest."""
        max_gap = self.options.track.max_gap
        if max_gap is None or not self.match.bridged:
            return max_gap
        bridge = self.options.bridge
        return max(max_gap, bridge.window, 2 * bridge.far_reach - 1)

    def tell(self, stage: str) -> None:
        """Say that a stage begins that does not say how far it is."""
        if self.progress is not None:
            self.progress(stage, 0, None)


def frame_names(num_frames: int) -> tuple[str, ...]:
    """Names of a video's frames in a COLMAP model; they sort in frame order."""
    return tuple(f"frame_{frame:06d}.png" for frame in range(num_frames))
