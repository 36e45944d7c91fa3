"""The stages of a run: what each makes of the state, what it hands on, what it depends on.

A stage *makes* files in a folder and plain facts, then *loads* them into the state; a later run
loads what an earlier one made. So whatever is not written is not handed on, and a run that goes on
from an interruption has the result of one that was never stopped. The order is in
:mod:`mvmatch.pipeline`.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch import outputs, products
from mvmatch.config import to_mapping
from mvmatch.encode import encode_video
from mvmatch.errors import DataError
from mvmatch.export.colmap import write_database
from mvmatch.export.masks import write_masks
from mvmatch.export.undistorted import write_undistorted
from mvmatch.geometry.movers import track_weights
from mvmatch.match import stage_progress
from mvmatch.matching import match_video
from mvmatch.pictures import bridge_match, loop_match, refine_match
from mvmatch.sfm import (
    DensifySummary,
    ReconstructionResult,
    densify,
    diagnose,
    reconstruct,
    status_of,
    write_models,
)
from mvmatch.types import Tracks
from mvmatch.work import identity

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from mvmatch.match import Match
    from mvmatch.products import Facts
    from mvmatch.sfm import MapperOptions
    from mvmatch.state import State

_WEIGHTS = "weights.npz"


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One step from the source to the model."""

    name: str
    """Of the folder in which its product is kept."""
    title: str
    """In reports."""
    needs: tuple[str, ...]
    """Names of the stages whose products it uses, directly: when one of them is made anew, so is
    this one."""
    depends: Callable[[State], Any]
    """What else its product depends on: plain values and option dataclasses."""
    make: Callable[[State, Path], Facts]
    """Writes files into an empty folder and returns plain facts. A file that bears the name of a
    result (:mod:`mvmatch.outputs`) is published in the place of an earlier stage's."""
    load: Callable[[State, Path, Facts], None]
    """Puts into the state what was made."""
    is_wanted: Callable[[State], bool] = lambda _: True
    """Whether it takes part in this run."""


def encode(state: State, folder: Path) -> Facts:
    """Encode the source into AV1 that is made for matching."""
    tell = stage_progress(state.progress, "encode")
    path = folder / outputs.VIDEO
    result = encode_video(state.source, path, options=state.options.encode, progress=tell)
    return products.encoding_facts(result)


def load_encoding(state: State, folder: Path, facts: Facts) -> None:
    """Take the encoded video."""
    state.encoding = products.read_encoding(folder, facts)


def encode_depends(state: State) -> Any:
    """Return the input, and how it is encoded if it is."""
    options = state.options.encode if state.has_to_encode else None
    return [identity(state.source), options]


def match(state: State, folder: Path) -> Facts:
    """Read motion vectors and chain them into tracks."""
    options = state.options
    found = match_video(
        state.video,
        options=options.track,
        footage=options.footage,
        read=options.read,
        progress=state.progress,
    )
    _require_tracks(state, found)
    return products.write_match(
        found,
        folder,
        tracks=outputs.TRACKS,
        image_names=state.first_names(found.num_frames),
        options=to_mapping(options.track),
    )


def load_match(state: State, folder: Path, facts: Facts) -> None:
    """Take the tracks, and what was found on the way."""
    state.match = products.read_match(folder, facts, tracks=outputs.TRACKS)


def match_depends(state: State) -> Any:
    """Return the options; any number of threads gives the same."""
    read = dataclasses.replace(state.options.read, threads=0)
    return [state.options.track, state.options.footage, read]


def refine(state: State, folder: Path) -> Facts:
    """Align tracks to the pictures: those of the source, which were not encoded.

    Where nobody asked for it, pictures that cannot be used leave the tracks as they are.
    """
    options, refined = state.options.refine, state.match
    try:
        refined = refine_match(
            refined, state.source, options=options, groups=state.refines, progress=state.progress
        )
    except DataError as error:
        if options.when == "always":
            raise
        refined = dataclasses.replace(refined, unrefined=str(error))
    facts = products.write_match_tracks(
        refined,
        folder / outputs.TRACKS,
        image_names=state.image_names,
        options=to_mapping(state.options.track),
    )
    return facts | {name: getattr(refined, name) for name in _REFINED}


_REFINED = ("is_refined", "is_further_refined", "unrefined")
"""Fields of a match that say what was aligned."""


def load_refined(state: State, folder: Path, facts: Facts) -> None:
    """Take the aligned tracks."""
    tracks, further, _ = products.read_match_tracks(folder / outputs.TRACKS, facts)
    told = {name: facts[name] for name in _REFINED}
    state.match = dataclasses.replace(state.match, tracks=tracks, further=further, **told)


def bridge(state: State, folder: Path) -> Facts:
    """Match pictures by descriptors where vectors leave a gap."""
    bridged = bridge_match(
        state.match,
        state.source,
        state.choice.camera,
        options=state.options.bridge,
        progress=state.progress,
    )
    facts = products.write_match_tracks(
        bridged,
        folder / outputs.TRACKS,
        image_names=state.image_names,
        options=to_mapping(state.options.track),
    )
    names = ("gaps", "bridged", "unreadable")
    return facts | {name: getattr(bridged, name) for name in names}


def load_bridge(state: State, folder: Path, facts: Facts) -> None:
    """Take the tracks with those that bridge gaps."""
    tracks, _, _ = products.read_match_tracks(folder / outputs.TRACKS, facts)
    state.match = dataclasses.replace(
        state.match,
        tracks=tracks,
        footage=state.match.footage.without({gap + 1 for gap in facts["bridged"]}),
        gaps=tuple(facts["gaps"]),
        bridged=tuple(facts["bridged"]),
        unreadable=facts["unreadable"],
    )


def bridge_depends(state: State) -> Any:
    """Return the camera and the options."""
    return [*_camera(state), state.options.bridge]


def find_loops(state: State, folder: Path) -> Facts:
    """Match pictures of the same place far apart in time."""
    looped = loop_match(
        state.match,
        state.source,
        state.choice.camera,
        options=state.options.loops,
        progress=state.progress,
    )
    facts = products.write_match_tracks(
        looped,
        folder / outputs.TRACKS,
        image_names=state.image_names,
        options=to_mapping(state.options.track),
    )
    return facts | {"loops": looped.loops}


def load_loops(state: State, folder: Path, facts: Facts) -> None:
    """Take the tracks with those that close loops."""
    tracks, _, _ = products.read_match_tracks(folder / outputs.TRACKS, facts)
    loops = tuple((first, second) for first, second in facts["loops"])
    state.match = dataclasses.replace(state.match, tracks=tracks, loops=loops)


def loops_depend(state: State) -> Any:
    """Return the camera and the options, if loops are looked for."""
    return [*_camera(state), state.options.loops] if state.asks_for_loops else None


def find_movers(state: State, folder: Path) -> Facts:
    """Weigh each track by how well it agrees with the motion of the camera."""
    weights = track_weights(state.match.tracks, state.choice.camera, options=state.options.movers)
    np.savez_compressed(folder / _WEIGHTS, allow_pickle=False, weights=weights)
    return {}


def load_weights(state: State, folder: Path, facts: Facts) -> None:  # noqa: ARG001
    """Take the weights."""
    with np.load(folder / _WEIGHTS, allow_pickle=False) as stored:
        state.weights = stored["weights"]


def movers_depend(state: State) -> Any:
    """Return the camera and the options."""
    return [*_camera(state), state.options.movers]


def _camera(state: State) -> list[Any]:
    camera = state.choice.camera
    params = [float(value) for value in camera.params]
    return [camera.model.name, params, state.choice.is_prior]


def make_database(state: State, folder: Path) -> Facts:
    """Verify the matches that tracks give, and write the COLMAP database."""
    state.tell("verify")
    summary = write_database(
        state.tracks,
        folder / outputs.DATABASE,
        camera=state.choice.camera,
        image_names=state.image_names,
        verification=state.options.verification,
        max_gap=state.max_gap,
        further=state.match.further,
        loops=state.match.loops,
    )
    return dataclasses.asdict(summary)


def load_database(state: State, folder: Path, facts: Facts) -> None:
    """Take the database."""
    state.database = folder / outputs.DATABASE
    state.summary = products.read_summary(facts)


def make_masks(state: State, folder: Path) -> Facts:
    """Write a mask per picture: moving objects and static overlays black."""
    assert state.weights is not None
    write_masks(
        state.match.tracks,
        state.weights < state.options.movers.min_weight,
        folder / outputs.MASKS,
        size=(state.match.info.width, state.match.info.height),
        image_names=state.image_names,
        overlays=state.match.footage.overlays,
    )
    return {}


def load_masks(state: State, folder: Path, facts: Facts) -> None:  # noqa: ARG001
    """Take the masks."""
    state.mask_folder = folder / outputs.MASKS


def load_nothing(state: State, folder: Path, facts: Facts) -> None:
    """Take nothing: the files alone are the product."""


def map_database(state: State, folder: Path) -> Facts:
    """Reconstruct a model from the database."""
    state.tell("map")
    footage = state.match.footage
    if footage.stands_still and not state.options.track.keep_zero:
        # Tracks without zero vectors are those of the movers alone, and make a model of them.
        share = f"{footage.still_area_share:.0%} of the picture"
        reason = f"the camera does not move: {share} stays where it is in nine of ten frames"
        result = ReconstructionResult.refused(state.match.num_frames, reason)
    else:
        mapper = one_shot(state.options.mapper, state.match)
        result = reconstruct(state.database, folder / outputs.MODEL, options=mapper)
    return products.write_result(result, folder)


def load_model(state: State, folder: Path, facts: Facts) -> None:
    """Take the model, or why there is none."""
    state.model = products.read_result(folder, facts)


def make_denser(state: State, folder: Path) -> Facts:
    """Triangulate the further tracks, and write the models with them."""
    import pycolmap

    state.tell("densify")
    assert state.model.reconstruction is not None
    tracks = Tracks.concatenate(state.tracks, state.match.further)
    further = [pycolmap.Reconstruction(path) for path in state.model.further]
    models = [state.model.reconstruction, *further]
    summaries = [densify(model, tracks, options=state.options.densify) for model in models]
    write_models(models, folder / outputs.MODEL)
    return dataclasses.asdict(summaries[0])


def load_denser(state: State, folder: Path, facts: Facts) -> None:
    """Take the denser models; what the mapper said of its own stays."""
    state.dense = DensifySummary(**facts)
    state.model = products.with_models(state.model, folder / outputs.MODEL)


def undistort(state: State, folder: Path) -> Facts:
    """Write pictures of the source and masks without distortion, and the model that they fit."""
    assert state.model.reconstruction is not None
    missing = len(state.match.skipped) or write_undistorted(
        state.model.reconstruction,
        state.source,
        folder / outputs.UNDISTORTED,
        masks=state.mask_folder,
        progress=stage_progress(state.progress, "undistort"),
    )
    if missing:
        message = f"{state.source} is damaged: nobody knows which of its pictures is which image"
        raise DataError(f"{message}. Do without --undistort")
    return {}


def find_faults(state: State, folder: Path) -> Facts:  # noqa: ARG001
    """Find out why there is no model, or only a part of one."""
    match = state.match
    keys = match.structure.summary(match.frames)["key_frames"]
    diagnosis = diagnose(
        state.model,
        state.database,
        tracks=state.tracks,
        footage=match.footage,
        key_frames=keys,
        damage=match.damage,
        skipped=match.skipped,
    )
    return dataclasses.asdict(diagnosis)


def load_faults(state: State, folder: Path, facts: Facts) -> None:  # noqa: ARG001
    """Take the diagnosis."""
    state.diagnosis = products.read_diagnosis(facts)


def is_incomplete(state: State) -> bool:
    """Whether there is something to find out."""
    return status_of(state.model, state.match.damage) != "complete"


def one_shot(options: MapperOptions, match: Match) -> MapperOptions:
    """Ask of the model that it holds the longest shot: across cuts nothing links the images."""
    share = match.footage.longest_shot(match.num_frames) / match.num_frames
    acceptance = options.acceptance
    acceptance = dataclasses.replace(
        acceptance,
        min_registered=share * acceptance.min_registered,
        min_observations=share * acceptance.min_observations,
    )
    return dataclasses.replace(options, acceptance=acceptance)


def _require_tracks(state: State, match: Match) -> None:
    if len(match.tracks):
        return
    if match.damage is not None:
        raise match.damage
    keys = sum(frame.frame_type == "KEY" for frame in match.frames if not frame.is_repeat)
    reason = f": {keys} key frames in {match.num_frames} cut all tracks" if keys > 1 else ""
    message = (
        f"{state.source} gives no track of {state.options.track.min_length} frames{reason}. "
        + ("" if state.encoding else f"Encode it anew: mvmatch run {state.source} --re-encode")
    ).rstrip()
    raise DataError(message)
