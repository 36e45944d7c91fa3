"""The methods that are compared: frames in, matches out, with what they cost.

All receive the same frames and camera. What is slow and does not change with the code that chains
tracks (encoded streams, the SIFT database) is made once and kept with its cost.
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from mvmatch.baselines import SiftOptions, match_sift, track_dis, track_klt
from mvmatch.baselines.images import require_opencv
from mvmatch.bench.digests import code_digest
from mvmatch.bench.matches import MAX_GAP, KeypointMatches, Matches, TrackMatches
from mvmatch.bridge import BridgeOptions
from mvmatch.colmap_log import quiet_colmap
from mvmatch.config import RunOptions
from mvmatch.encode import EncodeOptions, encode_video
from mvmatch.matching import match_video
from mvmatch.measure import StageClock
from mvmatch.pictures import bridge_match, refine_match
from mvmatch.sources import ReadOptions
from mvmatch.tracks import TrackOptions

if TYPE_CHECKING:
    from pathlib import Path

    import pycolmap

    from mvmatch.match import TrackGroup


@dataclass(frozen=True, kw_only=True)
class Clip:
    """What every method gets."""

    images: Path
    """Folder of numbered frames."""
    num_frames: int
    camera: pycolmap.Camera
    scratch: Path
    """Folder for streams and databases of this sequence."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FrontEndResult:
    """Matches and their cost."""

    matches: Matches
    cost: dict[str, float]
    """CPU seconds by stage."""
    details: dict[str, Any]
    """Settings and sizes worth keeping."""


class FrontEnd(Protocol):
    """A method: frames in, matches out."""

    def __call__(self, clip: Clip) -> FrontEndResult:
        """Run on one clip."""
        ...


@dataclass(frozen=True, kw_only=True)
class Vectors:
    """Motion vectors of an AV1 encoder, chained to tracks; aligned to the frames if asked to."""

    encode: EncodeOptions
    track: TrackOptions
    refines: tuple[TrackGroup, ...] = ()
    """Which tracks are aligned to the frames."""
    bridge: BridgeOptions = field(default_factory=BridgeOptions)

    def __call__(self, clip: Clip) -> FrontEndResult:
        """Encode the frames unless it was done, and chain their vectors."""
        stream, encoding = encoded_stream(clip, self.encode)
        clock = StageClock()
        with clock.stage("match"):
            match = match_video(stream, options=self.track, read=ReadOptions(threads=1))
        if self.refines:
            require_opencv().setNumThreads(1)
            with clock.stage("refine"):
                match = refine_match(match, clip.images, groups=self.refines)
        with clock.stage("bridge"):
            match = bridge_match(match, clip.images, clip.camera, options=self.bridge)
        cost = {stage.name: stage.cpu_s for stage in clock.stages}
        return FrontEndResult(
            matches=TrackMatches(match.tracks, match.further if len(match.further) else None),
            cost={"encode": encoding["cpu_seconds"], **cost},
            details={**encoding, "track": dataclasses.asdict(self.track)},
        )


def encoded_stream(clip: Clip, options: EncodeOptions) -> tuple[Path, dict[str, Any]]:
    """Encode the frames of a clip unless it was done.

    Returns
    -------
    tuple
        The stream, and its ``settings``, ``num_bytes``, ``seconds`` and ``cpu_seconds``.
    """
    name = f"{options.encoder}-{options.usage}"
    if options.quality is not None:
        name = f"{name}-q{options.quality}"
    # The sidecar says that the stream is complete.
    stream, sidecar = clip.scratch / f"{name}.ivf", clip.scratch / f"{name}.json"
    if not sidecar.is_file():
        made = encode_video(clip.images, stream, options=dataclasses.replace(options, check=False))
        facts = {
            "settings": made.settings,
            "num_bytes": made.num_bytes,
            "seconds": made.seconds,
            "cpu_seconds": made.cpu_seconds,
        }
        sidecar.write_text(json.dumps(facts), encoding="utf-8")
    return stream, json.loads(sidecar.read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Tracker:
    """An OpenCV tracker of :mod:`mvmatch.baselines`."""

    name: str
    """``klt`` or ``dis``."""

    def __call__(self, clip: Clip) -> FrontEndResult:
        """Track on one thread."""
        require_opencv().setNumThreads(1)
        track = {"klt": track_klt, "dis": track_dis}[self.name]
        clock = StageClock()
        with clock.stage("match"):
            tracks = track(sorted(clip.images.iterdir()))
        cost = {"match": clock.stages[0].cpu_s}
        return FrontEndResult(matches=TrackMatches(tracks), cost=cost, details={})


def sift_sequential(clip: Clip) -> FrontEndResult:
    """Match SIFT features of frames up to ``MAX_GAP`` apart (pycolmap, one thread).

    Every one of those pairs is matched: more than COLMAP's default, which leaves gaps out. The CPU
    time includes COLMAP's own verification, which cannot be left out; its matches are taken as they
    are before it.
    """
    options = SiftOptions(overlap=MAX_GAP, quadratic_overlap=False)
    database = clip.scratch / f"sift-{code_digest(('baselines',))[:8]}.db"
    sidecar = database.with_suffix(".json")
    if not sidecar.is_file():
        clock = StageClock()
        with quiet_colmap(), clock.stage("match"):
            match_sift(clip.images, database, camera=clip.camera, options=options)
        sidecar.write_text(json.dumps({"match": clock.stages[0].cpu_s}), encoding="utf-8")
    return FrontEndResult(
        matches=KeypointMatches.from_database(database),
        cost=json.loads(sidecar.read_text(encoding="utf-8")),
        details={"max_num_features": options.max_num_features},
    )


def _preset(encode: EncodeOptions, name: str) -> Vectors:
    """Return a preset as ``mvmatch run`` follows it with a camera."""
    options = RunOptions.preset(name)
    refines: tuple[TrackGroup, ...] = () if options.track.fill is None else ("further",)
    return Vectors(encode=encode, track=options.track, refines=refines, bridge=options.bridge)


ENCODERS = {
    "svt": EncodeOptions(encoder="svt"),
    "libaom-rt": EncodeOptions(encoder="libaom", usage="realtime"),
    "libaom-good": EncodeOptions(encoder="libaom", usage="good"),
}
PRESETS = ("default", "paper", "dense", "fast")

ABLATIONS: dict[str, dict[str, Any]] = {
    "no-error-bound": {"max_error": None},
    "no-drift-bound": {"max_drift": None},
    "no-error-model": {"max_error": None, "max_drift": None},
    "translate": {"carry": "translate"},
    "no-extend": {"extend": False},
    "cosine": {"epsilon": 0.1},
    "no-zero": {"keep_zero": False},
    "nearest": {"follow": "nearest"},
    "8-neighbors": {"num_neighbors": 8},
    "24-neighbors": {"num_neighbors": 24},
    "no-cells": {"cell": None},
    "cells-16": {"cell": 16},
}
"""One part of preset ``default`` off or changed: name to fields of ``TrackOptions``."""

FRONT_ENDS: dict[str, FrontEnd] = {
    **{
        f"{encoder}-{preset}": _preset(options, preset)
        for encoder, options in ENCODERS.items()
        for preset in PRESETS
    },
    **{
        f"{encoder}-default-{name}": Vectors(encode=options, track=TrackOptions(**changes))
        for encoder, options in ENCODERS.items()
        for name, changes in ABLATIONS.items()
    },
    "svt-refined": Vectors(encode=ENCODERS["svt"], track=TrackOptions(), refines=("tracks",)),
    "klt": Tracker("klt"),
    "dis": Tracker("dis"),
    "sift": sift_sequential,
}
"""By name; a further method is one line."""

SOURCES: dict[str, tuple[str, ...]] = {
    "vectors": (
        "_core",
        "bridge",
        "batches",
        "cells",
        "confidence",
        "correspondences",
        "encode",
        "error_model",
        "filters",
        "footage",
        "overlays",
        "match",
        "matching",
        "pictures",
        "rows",
        "shots",
        "sources",
        "tracks",
    ),
    "refined": ("opencv", "refine"),
    "baselines": ("baselines", "opencv"),
}
"""Modules whose code a result depends on, beside those that judge it."""


def sources_of(name: str) -> tuple[str, ...]:
    """Return the modules that the result of a front end depends on."""
    front_end = FRONT_ENDS[name]
    if not isinstance(front_end, Vectors):
        return SOURCES["baselines"]
    return SOURCES["vectors"] + (SOURCES["refined"] if front_end.refines else ())
