"""The methods of the protocol: frames in, matches out, in stages that are timed apart."""

from __future__ import annotations

import time
from collections import deque
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

from mvmatch.baselines import (
    SiftOptions,
    extract_sift,
    match_features,
    track_dis,
    track_klt,
)
from mvmatch.baselines.images import require_opencv
from mvmatch.bench.front_ends import ENCODERS, PRESETS, SOURCES, Clip, encoded_stream
from mvmatch.bench.inspect_tool import inspect_fields, missing_inspect
from mvmatch.bench.matches import MAX_GAP, KeypointMatches, Matches, TrackMatches
from mvmatch.colmap_log import quiet_colmap
from mvmatch.config import RunOptions
from mvmatch.encode import EncodeOptions
from mvmatch.encode.status import encoder_status
from mvmatch.errors import DataError, MissingExtraError
from mvmatch.footage import FootageObserver
from mvmatch.learned import (
    LightGlueModel,
    SuperGlueModel,
    device_of_networks,
    read_rgb,
    require_torch,
)
from mvmatch.matching import match_video, open_source
from mvmatch.measure import StageClock
from mvmatch.pictures import bridge_match
from mvmatch.sources import ReadOptions, ReferenceStructure
from mvmatch.tracks import chain_fields

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator
    from pathlib import Path

    from mvmatch.learned import LearnedModel
    from mvmatch.types import MotionField

PREPROCESS, MATCH = "preprocess", "match"
"""Stages of a front end: what precedes matching (features, or reading vectors), and matching."""


class Timeline:
    """Stages with their cost and the moment at which each began."""

    def __init__(self) -> None:
        self._clock = StageClock()
        self._begins: list[float] = []

    @contextmanager
    def stage(self, name: str) -> Generator[None]:
        """Measure the body."""
        self._begins.append(time.monotonic())
        with self._clock.stage(name):
            yield

    @property
    def stages(self) -> list[dict[str, Any]]:
        """``name``, ``begin_s`` (monotonic clock of the system), ``wall_s`` and ``cpu_s``."""
        return [
            {"name": cost.name, "begin_s": begin, "wall_s": cost.wall_s, "cpu_s": cost.cpu_s}
            for begin, cost in zip(self._begins, self._clock.stages, strict=True)
        ]


class Method(Protocol):
    """A front end of the protocol."""

    def unavailable(self) -> str | None:
        """Return why it cannot run here; None if it can."""
        ...

    def prepare(self, clip: Clip) -> dict[str, Any] | None:
        """Make what it reads, and return what that cost; None if it reads the frames."""
        ...

    def run(self, clip: Clip, timeline: Timeline, threads: int) -> Matches:
        """Match, in the stages :data:`PREPROCESS` and :data:`MATCH`."""
        ...

    def reading(self, clip: Clip, threads: int) -> dict[str, float] | None:
        """Measure what of :data:`MATCH` is reading where both are one; ``wall_s``, ``cpu_s``."""
        ...

    @property
    def sources(self) -> tuple[str, ...]:
        """Modules that the result depends on."""
        ...


@dataclass(frozen=True, kw_only=True)
class VectorMethod:
    """Motion vectors of an AV1 encoder, chained to tracks while the stream is read."""

    encode: EncodeOptions
    preset: str

    def unavailable(self) -> str | None:
        """Try the encoder."""
        status = encoder_status(self.encode.encoder)
        return None if status.available else f"encoder {status.name}: {status.reason}"

    def prepare(self, clip: Clip) -> dict[str, Any]:
        """Encode the frames unless it was done."""
        return encoded_stream(clip, self.encode)[1]

    def run(self, clip: Clip, timeline: Timeline, threads: int) -> Matches:
        """Chain the vectors of the stream."""
        options = RunOptions.preset(self.preset)
        stream, _ = encoded_stream(clip, self.encode)
        with timeline.stage(MATCH):
            match = match_video(stream, options=options.track, read=ReadOptions(threads=threads))
            match = bridge_match(match, clip.images, clip.camera, options=options.bridge)
        return TrackMatches(match.tracks, match.further if len(match.further) else None)

    def reading(self, clip: Clip, threads: int) -> dict[str, float]:
        """Read the vectors of the stream and do nothing with them."""
        stream, _ = encoded_stream(clip, self.encode)
        clock = StageClock()
        with clock.stage(PREPROCESS), open_source(stream, ReadOptions(threads=threads)) as source:
            deque(source, maxlen=0)
        return {"wall_s": clock.stages[0].wall_s, "cpu_s": clock.stages[0].cpu_s}

    @property
    def sources(self) -> tuple[str, ...]:
        """Modules that the result depends on."""
        return SOURCES["vectors"]

    def linked(self, clip: Clip, threads: int) -> list[list[int]]:
        """Count the vectors that lead from frame to frame, without tracks.

        Returns
        -------
        list of list of int
            ``[frame0, frame1, count]``, ``frame0 < frame1``.
        """
        stream, _ = encoded_stream(clip, self.encode)
        structure = ReferenceStructure()
        with open_source(stream, ReadOptions(threads=threads)) as source:
            for field in source:
                structure.add(field)
        return structure.adjacency(1 + max(each.display_index for each in source.frames)).tolist()


@dataclass(frozen=True, kw_only=True)
class InspectMethod(VectorMethod):
    """The same vectors as libaom's ``inspect`` prints them: the paper's extractor, and its cost."""

    def unavailable(self) -> str | None:
        """Look for the program, and try the encoder."""
        return missing_inspect() or super().unavailable()

    def run(self, clip: Clip, timeline: Timeline, threads: int) -> Matches:
        """Chain the vectors that the program prints; headers are read before, by mvmatch."""
        options = RunOptions.preset(self.preset).track
        fields, observer = self._printed(clip, threads), FootageObserver()
        with timeline.stage(MATCH):
            tracks, _ = chain_fields(observer.watch(fields), options=options)
            tracks, _ = observer.clean(tracks, min_length=options.min_length)
        return TrackMatches(tracks)

    def reading(self, clip: Clip, threads: int) -> dict[str, float]:
        """Read what the program prints and do nothing with it."""
        fields, clock = self._printed(clip, threads), StageClock()
        with clock.stage(PREPROCESS):
            deque(fields, maxlen=0)
        return {"wall_s": clock.stages[0].wall_s, "cpu_s": clock.stages[0].cpu_s}

    @property
    def sources(self) -> tuple[str, ...]:
        """Modules that the result depends on."""
        return *super().sources, "bench/inspect_tool.py"

    def _printed(self, clip: Clip, threads: int) -> Iterator[MotionField]:
        """Read the headers; the program starts with the first field that is asked for."""
        stream, _ = encoded_stream(clip, self.encode)
        with open_source(stream, ReadOptions(threads=threads)) as source:
            deque(source, maxlen=0)
        return inspect_fields(stream, source.frames, source.info)


@dataclass(frozen=True, kw_only=True)
class SiftMethod:
    """SIFT of pycolmap; its matches are taken before verification, which all methods share."""

    options: SiftOptions

    def unavailable(self) -> None:
        """Run everywhere: it comes with pycolmap."""

    def prepare(self, clip: Clip) -> None:
        """Prepare nothing: it reads the frames."""

    def run(self, clip: Clip, timeline: Timeline, threads: int) -> Matches:
        """Extract features and match them."""
        options = replace(self.options, num_threads=threads)
        database = _scratch_database(clip, options.pairing)
        with quiet_colmap():
            with timeline.stage(PREPROCESS):
                extract_sift(clip.images, database, camera=clip.camera, options=options)
            with timeline.stage(MATCH):
                match_features(database, options=options)
        every = options.pairing == "exhaustive"
        return KeypointMatches.from_database(database, max_gap=None if every else MAX_GAP)

    def reading(self, clip: Clip, threads: int) -> None:
        """Measure nothing: extraction is a stage of its own."""

    @property
    def sources(self) -> tuple[str, ...]:
        """Modules that the result depends on."""
        return SOURCES["baselines"]


@dataclass(frozen=True)
class TrackerMethod:
    """An OpenCV tracker of :mod:`mvmatch.baselines`; it reads the frames while it tracks."""

    name: str
    """``klt`` or ``dis``."""

    def unavailable(self) -> str | None:
        """Look for OpenCV."""
        try:
            require_opencv()
        except MissingExtraError as error:
            return str(error)
        return None

    def prepare(self, clip: Clip) -> None:
        """Prepare nothing: it reads the frames."""

    def run(self, clip: Clip, timeline: Timeline, threads: int) -> Matches:
        """Track."""
        require_opencv().setNumThreads(threads)
        track = {"klt": track_klt, "dis": track_dis}[self.name]
        with timeline.stage(MATCH):
            return TrackMatches(track(sorted(clip.images.iterdir())))

    def reading(self, clip: Clip, threads: int) -> None:
        """Measure nothing: frames are read while it tracks."""

    @property
    def sources(self) -> tuple[str, ...]:
        """Modules that the result depends on."""
        return SOURCES["baselines"]


@dataclass(frozen=True)
class LearnedMethod:
    """A learned matcher; like SIFT it matches every pair up to :data:`MAX_GAP` frames apart.

    Frames are taken in their own size, as by every method. Loading the networks is no stage.
    """

    model: LearnedModel

    def unavailable(self) -> str | None:
        """Look for packages and weights."""
        try:
            self.model.require()
        except (MissingExtraError, DataError) as error:
            return str(error)
        return None

    def prepare(self, clip: Clip) -> None:
        """Prepare nothing: it reads the frames."""

    def run(self, clip: Clip, timeline: Timeline, threads: int) -> Matches:
        """Extract features and match them."""
        require_torch().set_num_threads(threads)
        matcher = self.model.load()
        with timeline.stage(PREPROCESS):
            frames = read_rgb(sorted(clip.images.iterdir()))
            features = [matcher.extract(frame) for frame in frames]
        with timeline.stage(MATCH):
            matches = {
                (frame0, frame1): matcher.match(features[frame0], features[frame1])
                for frame0 in range(len(features))
                for frame1 in range(frame0 + 1, min(frame0 + MAX_GAP + 1, len(features)))
            }
        return KeypointMatches(keypoints=tuple(each.xy for each in features), matches=matches)

    def reading(self, clip: Clip, threads: int) -> None:
        """Measure nothing: extraction is a stage of its own."""

    @property
    def sources(self) -> tuple[str, ...]:
        """Modules that the result depends on."""
        return "learned", "opencv"


def _scratch_database(clip: Clip, name: str) -> Path:
    return clip.scratch / f"protocol-{name}.db"


_HARDWARE = {
    name: EncodeOptions(encoder=name)  # pyright: ignore[reportArgumentType]
    for name in ("nvenc", "qsv", "vaapi")
}

METHODS: dict[str, Method] = {
    **{
        f"{encoder}-{preset}": VectorMethod(encode=options, preset=preset)
        for encoder, options in {**ENCODERS, **_HARDWARE}.items()
        for preset in PRESETS
    },
    "inspect-paper": InspectMethod(encode=ENCODERS["libaom-rt"], preset="paper"),
    "sift": SiftMethod(options=SiftOptions(overlap=MAX_GAP, quadratic_overlap=False, verify=False)),
    "sift-exhaustive": SiftMethod(options=SiftOptions(pairing="exhaustive", verify=False)),
    "klt": TrackerMethod("klt"),
    "dis": TrackerMethod("dis"),
    "disk-lightglue": LearnedMethod(LightGlueModel(features="disk")),
    "aliked-lightglue": LearnedMethod(LightGlueModel(features="aliked")),
    "superpoint-superglue": LearnedMethod(SuperGlueModel()),
}
"""By name; a further method is one line."""


def described(name: str) -> dict[str, Any]:
    """Return the settings of a method as plain values, for keys and reports."""
    method = METHODS[name]
    settings = asdict(method)  # pyright: ignore[reportArgumentType]
    if isinstance(method, VectorMethod):
        settings["options"] = asdict(RunOptions.preset(method.preset).track)
    if isinstance(method, LearnedMethod) and method.unavailable() is None:
        settings["device"] = device_of_networks()
    return settings
