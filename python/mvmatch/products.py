"""What stages hand on, as files and plain facts, and back.

Nothing is pickled: a folder of results may come from anywhere.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch import errors
from mvmatch.encode import EncodeResult, EncodingCheck
from mvmatch.errors import BitstreamError, MvmatchError
from mvmatch.export.colmap import DatabaseSummary
from mvmatch.footage import Footage
from mvmatch.match import Match
from mvmatch.overlays import Overlays
from mvmatch.sfm import (
    Attempt,
    Diagnosis,
    Finding,
    Joint,
    ModelCheck,
    ReconstructionResult,
    Unregistered,
    write_model,
)
from mvmatch.sources import ReferenceStructure, Skipped
from mvmatch.store import (
    TracksTable,
    columns_of_frames,
    frames_of_columns,
    read_tracks,
    write_tracks,
)
from mvmatch.types import Tracks, TwoViewScore, VideoInfo

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

Facts = dict[str, Any]
"""A JSON object."""

_COUNTS = "counts.npz"
_OWN = ("section", "byte_offset", "frame")


def encoding_facts(encoding: EncodeResult) -> Facts:
    """Return the facts of an encoding; the video is a file of its own."""
    return dataclasses.asdict(encoding) | {"path": encoding.path.name}


def read_encoding(folder: Path, facts: Facts) -> EncodeResult:
    """Return the encoding that :func:`encoding_facts` was given, its video in ``folder``."""
    check: EncodingCheck | None = None
    if facts["check"] is not None:
        shares = {int(key): share for key, share in facts["check"]["distance_share"].items()}
        keys = tuple(facts["check"]["key_frames"])
        check = EncodingCheck(**facts["check"] | {"distance_share": shares, "key_frames": keys})
    names = facts["image_names"]
    changed: Facts = {
        "path": folder / facts["path"],
        "image_names": None if names is None else tuple(names),
        "check": check,
        "warnings": tuple(facts["warnings"]),
    }
    return EncodeResult(**facts | changed)


def write_match(
    match: Match,
    folder: Path,
    *,
    tracks: str,
    image_names: Sequence[str],
    options: Mapping[str, Any],
) -> Facts:
    """Write a match into a folder: its tracks as the table of that name, counts beside it."""
    facts = write_match_tracks(match, folder / tracks, image_names=image_names, options=options)
    overlays = match.footage.overlays
    np.savez_compressed(
        folder / _COUNTS,
        allow_pickle=False,
        overlay_end=overlays.end,
        overlay_cells=overlays.cells,
        **match.structure.to_arrays(),
    )
    footage = {
        item.name: getattr(match.footage, item.name)
        for item in dataclasses.fields(Footage)
        if item.name != "overlays"
    }
    return facts | {
        "frames": columns_of_frames(match.frames),
        "footage": footage,
        "damage": None if match.damage is None else _error_facts(match.damage),
        "skipped": [dataclasses.asdict(part) for part in match.skipped],
    }


def read_match(folder: Path, facts: Facts, *, tracks: str) -> Match:
    """Return the match that :func:`write_match` was given."""
    with np.load(folder / _COUNTS, allow_pickle=False) as counts:
        arrays = dict(counts)
    overlays = Overlays(end=arrays["overlay_end"], cells=arrays["overlay_cells"])
    footage: Facts = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in facts["footage"].items()
    }
    damage = facts["damage"]
    own, further, info = read_match_tracks(folder / tracks, facts)
    return Match(
        tracks=own,
        further=further,
        info=info,
        frames=frames_of_columns(facts["frames"]),
        structure=ReferenceStructure.from_arrays(arrays),
        footage=Footage(**footage, overlays=overlays),
        damage=None if damage is None else _error(damage),
        skipped=tuple(Skipped(**part) for part in facts["skipped"]),
    )


def write_match_tracks(
    match: Match, path: Path, *, image_names: Sequence[str], options: Mapping[str, Any]
) -> Facts:
    """Write all tracks of a match as one table."""
    table = TracksTable(tracks=match.all_tracks, info=match.info, image_names=tuple(image_names))
    write_tracks(table, path, options=options)
    return {"num_tracks": len(match.tracks)}


def read_match_tracks(path: Path, facts: Facts) -> tuple[Tracks, Tracks, VideoInfo]:
    """Return the tracks, the further ones and the video of what was written."""
    table = read_tracks(path)
    first = np.arange(len(table.tracks)) < facts["num_tracks"]
    return table.tracks.select(first), table.tracks.select(~first), table.info


def read_summary(facts: Facts) -> DatabaseSummary:
    """Return the summary whose fields the facts are."""
    changed: Facts = {"scores": tuple(TwoViewScore(**score) for score in facts["scores"])}
    return DatabaseSummary(**facts | changed)


_WRITTEN = frozenset({"reconstruction", "path", "further", "attempts", "unregistered", "joints"})
"""Fields of a result that are no plain facts."""


def write_result(result: ReconstructionResult, folder: Path) -> Facts:
    """Write what the mapper made into a folder, a rejected model as well."""
    facts = {
        item.name: getattr(result, item.name)
        for item in dataclasses.fields(result)
        if item.name not in _WRITTEN
    }
    path = result.path
    if path is None and result.reconstruction is not None:
        path = write_model(result.reconstruction, folder / "rejected")
    return facts | {
        "attempts": [dataclasses.asdict(attempt) for attempt in result.attempts],
        "unregistered": [dataclasses.asdict(each) for each in result.unregistered],
        "joints": [dataclasses.asdict(joint) for joint in result.joints],
        "further": [further.relative_to(folder).as_posix() for further in result.further],
        "model": None if path is None else path.relative_to(folder).as_posix(),
    }


def read_result(folder: Path, facts: Facts) -> ReconstructionResult:
    """Return what :func:`write_result` was given."""
    import pycolmap

    facts = dict(facts)
    model = facts.pop("model")
    path = None if model is None else folder / model
    changed: Facts = {
        "reasons": tuple(facts["reasons"]),
        "attempts": tuple(_attempt(attempt) for attempt in facts["attempts"]),
        "unregistered": tuple(Unregistered(**each) for each in facts["unregistered"]),
        "joints": tuple(Joint(**each) for each in facts["joints"]),
        "further": tuple(folder / name for name in facts["further"]),
        "reconstruction": None if path is None else pycolmap.Reconstruction(path),
        "path": path if facts["accepted"] else None,
    }
    return ReconstructionResult(**facts | changed)


def with_models(result: ReconstructionResult, folder: Path) -> ReconstructionResult:
    """Return a result with the models of a folder in the place of its own."""
    import pycolmap

    there = moved(result, folder)
    assert there.path is not None
    return dataclasses.replace(there, reconstruction=pycolmap.Reconstruction(there.path))


def moved(result: ReconstructionResult, folder: Path) -> ReconstructionResult:
    """Return an accepted result whose models are in another folder now."""
    assert result.path is not None
    return dataclasses.replace(
        result,
        path=folder / result.path.name,
        further=tuple(folder / further.name for further in result.further),
    )


def read_diagnosis(facts: Facts) -> Diagnosis:
    """Return the diagnosis whose fields the facts are."""
    changed: Facts = {
        "findings": tuple(
            Finding(**finding | {"frames": tuple((a, b) for a, b in finding["frames"])})
            for finding in facts["findings"]
        )
    }
    return Diagnosis(**facts | changed)


def _attempt(facts: Facts) -> Attempt:
    check, images = facts["check"], facts["initial_images"]
    if check is not None:
        check = ModelCheck(**check | {"reasons": tuple(check["reasons"])})
    changed: Facts = {
        "check": check,
        "images": tuple(facts["images"]),
        "initial_images": None if images is None else tuple(images),
        "reasons": tuple(facts["reasons"]),
    }
    return Attempt(**facts | changed)


def _error_facts(error: MvmatchError) -> Facts:
    places = {name: getattr(error, name) for name in _OWN if isinstance(error, BitstreamError)}
    return {"kind": type(error).__name__, "message": str(error), **places}


def _error(facts: Facts) -> MvmatchError:
    if facts["kind"] == BitstreamError.__name__:
        return BitstreamError(facts["message"], **{name: facts[name] for name in _OWN})
    kind = getattr(errors, facts["kind"], None)
    if isinstance(kind, type) and issubclass(kind, MvmatchError):
        return kind(facts["message"])
    return MvmatchError(facts["message"])
