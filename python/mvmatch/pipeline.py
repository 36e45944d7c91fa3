"""From a video to a model: the only place that knows the order of the stages."""

from __future__ import annotations

import dataclasses
import functools
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch import outputs, products, stages
from mvmatch.bridge import require_matcher
from mvmatch.camera import parse_camera
from mvmatch.config import RunOptions, to_mapping
from mvmatch.encode.frames import open_frames
from mvmatch.errors import DataError, NotAv1Error
from mvmatch.matching import open_source
from mvmatch.measure import StageCost, peak_rss_mb
from mvmatch.opencv import require_opencv
from mvmatch.pairing import sum_by_frame
from mvmatch.rows import count_keypoints
from mvmatch.stages import Stage
from mvmatch.state import State
from mvmatch.store import is_table
from mvmatch.work import digest, open_work

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from mvmatch.camera import CameraChoice
    from mvmatch.encode import EncodeResult
    from mvmatch.export.colmap import DatabaseSummary
    from mvmatch.match import Match, Progress
    from mvmatch.sfm import DensifySummary, Diagnosis, ReconstructionResult
    from mvmatch.types import StrPath
    from mvmatch.work import Product, Work

STAGES = (
    Stage(
        name="encode",
        title="encode",
        needs=(),
        depends=stages.encode_depends,
        make=stages.encode,
        load=stages.load_encoding,
        is_wanted=lambda state: state.has_to_encode,
    ),
    Stage(
        name="match",
        title="match",
        needs=("encode",),
        depends=stages.match_depends,
        make=stages.match,
        load=stages.load_match,
    ),
    Stage(
        name="refine",
        title="refine",
        needs=("match",),
        depends=lambda state: [state.options.refine, state.refines] if state.refines else None,
        make=stages.refine,
        load=stages.load_refined,
        is_wanted=lambda state: bool(state.refines),
    ),
    Stage(
        name="bridge",
        title="bridge gaps",
        needs=("refine",),
        depends=stages.bridge_depends,
        make=stages.bridge,
        load=stages.load_bridge,
        is_wanted=lambda state: state.has_gaps,
    ),
    Stage(
        name="loops",
        title="close loops",
        needs=("bridge",),
        depends=stages.loops_depend,
        make=stages.find_loops,
        load=stages.load_loops,
        is_wanted=lambda state: state.asks_for_loops,
    ),
    Stage(
        name="movers",
        title="find movers",
        needs=("loops",),
        depends=stages.movers_depend,
        make=stages.find_movers,
        load=stages.load_weights,
        is_wanted=lambda state: state.masks or state.options.movers.exclude,
    ),
    Stage(
        name="database",
        title="verify and write database",
        needs=("movers",),
        depends=lambda state: state.options.verification,
        make=stages.make_database,
        load=stages.load_database,
    ),
    Stage(
        name="masks",
        title="write masks",
        needs=("movers",),
        depends=lambda _: None,
        make=stages.make_masks,
        load=stages.load_masks,
        is_wanted=lambda state: state.masks,
    ),
    Stage(
        name="map",
        title="map",
        needs=("database",),
        depends=lambda state: state.options.mapper,
        make=stages.map_database,
        load=stages.load_model,
    ),
    Stage(
        name="densify",
        title="densify",
        needs=("map",),
        depends=lambda state: state.options.densify,
        make=stages.make_denser,
        load=stages.load_denser,
        is_wanted=lambda state: state.model.accepted and len(state.match.further) > 0,
    ),
    Stage(
        name="undistort",
        title="undistort",
        needs=("densify", "masks"),
        depends=lambda state: state.masks,
        make=stages.undistort,
        load=stages.load_nothing,
        is_wanted=lambda state: state.undistort and state.model.accepted,
    ),
    Stage(
        name="diagnose",
        title="diagnose",
        needs=("densify",),
        depends=lambda _: None,
        make=stages.find_faults,
        load=stages.load_faults,
        is_wanted=stages.is_incomplete,
    ),
)
"""In the order in which they run. A stage sees what those before it have handed on."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """What :func:`reconstruct_video` made."""

    out: Path
    match: Match
    database: DatabaseSummary
    model: ReconstructionResult
    dense: DensifySummary | None
    """What became of the further tracks; None without any, and without a model."""
    camera: CameraChoice
    encoding: EncodeResult | None
    weights: NDArray[np.float64] | None
    """(T,) weight of each track of ``match``, low on moving objects; None: not computed."""
    diagnosis: Diagnosis
    """How much of a model there is, and what stands in the way of the rest."""
    reused: tuple[str, ...]
    """Titles of the stages that an earlier run into ``out`` had made."""
    data: dict[str, Any]
    """The report (docs/reference/report-schema.md)."""


def reconstruct_video(  # noqa: PLR0913
    source: StrPath,
    out: StrPath,
    *,
    camera: StrPath | None = None,
    options: RunOptions | None = None,
    reencode: bool = False,
    masks: bool = False,
    undistort: bool = False,
    fresh: bool = False,
    progress: Progress | None = None,
) -> Run:
    """Turn a video or a folder of frames into tracks, a COLMAP database, a model and a report.

    Parameters
    ----------
    source : path
        An AV1 video, any other video FFmpeg decodes, or a folder of at least two images.
    out : path
        Folder for the results, which appear when all are complete, in the place of older ones.
        Stages that an earlier run into it has finished, interrupted or not, are not repeated while
        the input and the options they depend on stay the same (kept in ``out/.work``).
    camera : str or path, optional
        See :func:`mvmatch.camera.parse_camera`; a prior without.
    options : RunOptions, optional
        Options of all stages.
    reencode : bool
        Encode AV1 input anew instead of using it as it is.
    masks : bool
        Write a mask per picture: moving objects and static overlays black.
    undistort : bool
        Write ``out/undistorted``: ``images`` without distortion, ``sparse/0`` with the pinhole
        cameras they have, and ``masks`` where asked for (:mod:`mvmatch.export.undistorted`);
        nothing where no model holds.
    fresh : bool
        Use nothing that an earlier run has made.
    progress : Progress, optional
        Told about all stages.

    Returns
    -------
    Run
        With ``model.accepted`` False when no model holds: then ``out`` has all but ``sparse/``, and
        ``diagnosis`` says why.

    Raises
    ------
    MvmatchError
        As :func:`match_video`; also an encoder that is missing, and ``out`` that cannot be written.
    """
    source, out = Path(source), Path(out)
    options = options or RunOptions()
    if options.refine.when == "always":
        require_opencv("refinement", extra="refine")  # now rather than after the encoding
    require_matcher(options.loops.matcher)
    if undistort and is_table(source):
        message = f"{source} holds no pictures to undistort. Give the video itself"
        raise DataError(message)
    outputs.require_ours(out)
    state = State(
        source=source,
        options=options,
        camera=None if camera is None else os.fspath(camera),
        has_to_encode=_has_to_encode(source, options, reencode=reencode),
        masks=masks,
        undistort=undistort,
        progress=progress,
    )
    _check_camera(state)
    return _run(state, out, fresh=fresh)


def _run(state: State, out: Path, *, fresh: bool) -> Run:
    """Run the stages, and publish what they made when all is there."""
    with open_work(out) as work:
        if fresh:
            work.forget()
        made, reused = _run_stages(state, work)
        run = _finished(state, out, made, reused)
        with work.scratch() as folder:
            _write_report(folder, run.data)
            outputs.publish([*(product.folder for product in made.values()), folder], out)
        work.forget(keep=made)
    return run


def _has_to_encode(source: Path, options: RunOptions, *, reencode: bool) -> bool:
    """Whether the source is anything but AV1 that is used as it is."""
    if not source.exists():
        message = f"there is no file or folder {source}"
        raise FileNotFoundError(message)
    if source.is_dir() or reencode:
        return True
    try:
        with open_source(source, options.read):
            return False
    except NotAv1Error:
        return True  # any video that FFmpeg decodes can be encoded


def _check_camera(state: State) -> None:
    """Look at the camera that was given before minutes are spent on the video."""
    if state.camera is None:
        return
    if state.has_to_encode:
        frames = open_frames(state.source, frame_rate=30.0, max_frames=None)
        size = frames.width, frames.height
    else:
        with open_source(state.source, state.options.read) as opened:
            size = opened.info.width, opened.info.height
    parse_camera(state.camera, *size, pictures=state.source)


def _run_stages(state: State, work: Work) -> tuple[dict[str, Product], tuple[str, ...]]:
    """Run the stages, or take what is there of them; name those that were taken."""
    keys: dict[str, str] = {}
    made: dict[str, Product] = {}
    reused: list[str] = []
    for stage in STAGES:
        needed = [keys[name] for name in stage.needs]
        keys[stage.name] = key = digest(stage.name, stage.depends(state), needed)
        if not stage.is_wanted(state):
            continue
        product = work.find(stage.name, key)
        if product is None:
            fill = functools.partial(stage.make, state)
            product = work.make(stage.name, key, stage.title, fill)
        else:
            reused.append(stage.title)
        stage.load(state, product.folder, product.facts)
        made[stage.name] = product
    return made, tuple(reused)


def _finished(state: State, out: Path, made: Mapping[str, Product], reused: tuple[str, ...]) -> Run:
    """Return what the stages made, as it will be in ``out``, with its report."""
    model, encoding = state.model, state.encoding
    if model.path is not None:
        model = products.moved(model, out / outputs.MODEL)
    if encoding is not None:
        encoding = dataclasses.replace(encoding, path=out / encoding.path.name)
    run = Run(
        out=out,
        match=state.match,
        database=state.summary,
        model=model,
        dense=state.dense,
        camera=state.choice,
        encoding=encoding,
        weights=state.weights,
        diagnosis=state.diagnosis,
        reused=reused,
        data={},
    )
    run.data.update(_report_data(run, state, [product.cost for product in made.values()]))
    return run


def _write_report(folder: Path, data: dict[str, Any]) -> None:
    from mvmatch.report import write_report

    write_report(folder, data)


def _describe_movers(weights: NDArray[np.float64], options: RunOptions) -> dict[str, Any]:
    return {
        "num_tracks": int(np.sum(weights < options.movers.min_weight)),
        "excluded": options.movers.exclude,
    }


def _report_data(run: Run, state: State, costs: Sequence[StageCost]) -> dict[str, Any]:
    match, model, tracks, options = run.match, run.model, state.tracks, state.options
    after = outputs.with_loops(tracks.adjacency(state.max_gap), tracks, match.loops)
    warnings = [
        *(run.encoding.warnings if run.encoding else ()),
        *match.warnings,
        *outputs.camera_warnings(run.camera, model, is_refined=match.is_refined),
        *outputs.dense_warnings(match, options.refine),
    ]
    return {
        **outputs.provenance(),
        "input": outputs.describe_input(state.source, match.info, run.encoding),
        "camera": outputs.describe_camera(run.camera, model),
        "options": to_mapping(options),
        "reference_structure": match.structure.summary(match.frames),
        "stages": [
            dataclasses.asdict(cost) | {"reused": cost.name in run.reused} for cost in costs
        ],
        "peak_rss_mb": peak_rss_mb(),
        "matches": {
            "is_refined": match.is_refined,
            "is_further_refined": match.is_further_refined,
            "num_tracks": len(tracks),
            "num_further_tracks": len(match.further),
            "num_observations": len(tracks.frame),
            "mean_track_length": tracks.num_observations / max(len(tracks), 1),
            "max_track_length": max((int(p.lengths.max()) for p in tracks.parts()), default=0),
            "keypoints_per_image": count_keypoints(tracks, match.num_frames).tolist(),
            "matches_per_image": sum_by_frame(after, match.num_frames).tolist(),
            "num_pairs": run.database.num_pairs,
            "num_estimated_pairs": run.database.num_estimated_pairs,
            "num_verified_pairs": run.database.num_verified_pairs,
            "num_matches": run.database.num_matches,
            "num_inliers": run.database.num_inliers,
        },
        "footage": match.footage.summary(),
        "gaps": {"after": list(match.gaps), "bridged": list(match.bridged)},
        "loops": [list(pair) for pair in match.loops] if options.loops.matcher != "none" else None,
        "movers": None if run.weights is None else _describe_movers(run.weights, options),
        "adjacency_before": match.structure.adjacency(match.num_frames).tolist(),
        "adjacency_after": after.tolist(),
        "scores": [dataclasses.asdict(score) for score in run.database.scores],
        "model": outputs.describe_model(model, options.mapper, run.dense, run.diagnosis),
        "damage": (
            None
            if match.damage is None
            else {"message": str(match.damage), "frames_read": len(match.frames)}
        ),
        "skipped": [dataclasses.asdict(part) for part in match.skipped],
        "warnings": warnings,
    }
