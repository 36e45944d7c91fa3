"""From a video to a model: the only place that knows the order of the stages."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch import outputs
from mvmatch.camera import parse_camera
from mvmatch.config import RunOptions, to_mapping
from mvmatch.encode import EncodeResult, encode_video
from mvmatch.errors import DataError, NotAv1Error
from mvmatch.export.colmap import write_database
from mvmatch.export.masks import write_masks
from mvmatch.geometry.movers import track_weights
from mvmatch.matching import (
    Match,
    Progress,
    match_video,
    open_source,
    refine_match,
    stage_progress,
)
from mvmatch.measure import StageClock, peak_rss_mb
from mvmatch.opencv import require_opencv
from mvmatch.sfm import densify, reconstruct, write_model
from mvmatch.store import TracksTable, write_tracks
from mvmatch.types import Tracks

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mvmatch.camera import CameraChoice
    from mvmatch.export.colmap import DatabaseSummary
    from mvmatch.sfm import DensifyOptions, DensifySummary, MapperOptions, ReconstructionResult
    from mvmatch.tracks import TrackOptions


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
    data: dict[str, Any]
    """The report (docs/reference/report-schema.md)."""


def reconstruct_video(
    source: Path,
    out: Path,
    *,
    camera: str | None = None,
    options: RunOptions | None = None,
    reencode: bool = False,
    masks: bool = False,
    progress: Progress | None = None,
) -> Run:
    """Turn a video or a folder of frames into tracks, a COLMAP database, a model and a report.

    Parameters
    ----------
    source : Path
        An AV1 video, any other video FFmpeg decodes, or a folder of at least two images.
    out : Path
        Folder for the results. It is filled when everything is complete: on an error nothing is
        left there. An older run in it is replaced.
    camera : str, optional
        See :func:`mvmatch.camera.parse_camera`; a prior without.
    options : RunOptions, optional
        Options of all stages.
    reencode : bool
        Encode AV1 input anew instead of using it as it is.
    masks : bool
        Write a mask per picture: moving objects and static overlays black.
    progress : Progress, optional
        Told about all stages.

    Returns
    -------
    Run
        With ``model.accepted`` False when the mapper found no model that holds: then ``out`` has
        everything but ``sparse/``.

    Raises
    ------
    MvmatchError
        As :func:`match_video`; also an encoder that is missing, and ``out`` that cannot be written.
    """
    options = options or RunOptions()
    source, out = Path(source), Path(out)
    if options.refine.enabled:
        require_opencv("refinement", extra="refine")  # now rather than after the encoding
    clock = StageClock()
    with outputs.staging(out) as staging:
        with clock.stage("encode"):
            video, encoding = _encoded(source, staging, options, reencode, progress)
        if encoding is None:
            clock.stages.clear()
        with clock.stage("match"):
            match = match_video(
                video,
                options=options.track,
                footage=options.footage,
                read=options.read,
                progress=progress,
            )
        _require_tracks(video, match, options.track)
        if options.refine.enabled:
            pictures = video if encoding is None else source
            with clock.stage("refine"):
                match = refine_match(match, pictures, options=options.refine, progress=progress)
        choice = parse_camera(camera, match.info.width, match.info.height)
        names = _image_names(match.num_frames, encoding)
        with clock.stage("find movers"):
            weights = None
            if masks or options.movers.exclude:
                weights = track_weights(match.tracks, choice.camera, options=options.movers)
        at_rest = _at_rest(match.tracks, weights, options)
        table = TracksTable(tracks=match.all_tracks, info=match.info, image_names=names)
        database = staging / outputs.DATABASE
        _tell(progress, "verify")
        with clock.stage("verify and write database"):
            summary = write_database(
                at_rest,
                database,
                camera=choice.camera,
                image_names=names,
                verification=options.verification,
                max_gap=options.track.max_gap,
                further=match.further,
            )
        write_tracks(table, staging / outputs.TRACKS, options=to_mapping(options.track))
        if masks and weights is not None:
            with clock.stage("write masks"):
                write_masks(
                    match.tracks,
                    weights < options.movers.min_weight,
                    staging / outputs.MASKS,
                    size=(match.info.width, match.info.height),
                    image_names=names,
                    overlays=match.footage.overlays,
                )
        _tell(progress, "map")
        with clock.stage("map"):
            mapper = _one_shot(options.mapper, match)
            model = reconstruct(database, staging / outputs.MODEL, options=mapper)
        dense = None
        if len(match.further):
            _tell(progress, "densify")
            with clock.stage("densify"):
                dense = _densified(model, at_rest, match.further, options.densify)
        run = Run(
            out=out,
            match=match,
            database=summary,
            model=model,
            dense=dense,
            camera=choice,
            encoding=encoding,
            weights=weights,
            data={},
        )
        run.data.update(_report_data(run, source, options, clock))
        _write_report(staging, run.data)
        outputs.publish(staging, out)
    return run if model.path is None else _moved(run, out / outputs.MODEL / model.path.name)


def _densified(
    model: ReconstructionResult, tracks: Tracks, further: Tracks, options: DensifyOptions
) -> DensifySummary | None:
    """Add the further tracks to an accepted model, and write it again."""
    if model.path is None or model.reconstruction is None:
        return None
    summary = densify(model.reconstruction, Tracks.concatenate(tracks, further), options=options)
    write_model(model.reconstruction, model.path.parent)
    return summary


def _one_shot(options: MapperOptions, match: Match) -> MapperOptions:
    """Ask of the model that it holds the longest shot: across cuts nothing links the images."""
    share = match.footage.longest_shot(match.num_frames) / match.num_frames
    acceptance = options.acceptance
    acceptance = dataclasses.replace(
        acceptance,
        min_registered=share * acceptance.min_registered,
        min_observations=share * acceptance.min_observations,
    )
    return dataclasses.replace(options, acceptance=acceptance)


def _at_rest(tracks: Tracks, weights: NDArray[np.float64] | None, options: RunOptions) -> Tracks:
    """Tracks that go into the database."""
    if weights is None or not options.movers.exclude:
        return tracks
    return tracks.select(weights >= options.movers.min_weight)


def _moved(run: Run, path: Path) -> Run:
    return dataclasses.replace(run, model=dataclasses.replace(run.model, path=path))


def _require_tracks(video: Path, match: Match, options: TrackOptions) -> None:
    if len(match.tracks):
        return
    if match.damage is not None:
        raise match.damage
    keys = sum(frame.frame_type == "KEY" for frame in match.frames if not frame.is_repeat)
    reason = f": {keys} key frames in {match.num_frames} cut all tracks" if keys > 1 else ""
    message = (
        f"{video} gives no track of {options.min_length} frames{reason}. "
        f"Encode it anew for matching: mvmatch run {video} --re-encode"
    )
    raise DataError(message)


def _encoded(
    source: Path,
    staging: Path,
    options: RunOptions,
    reencode: bool,  # noqa: FBT001
    progress: Progress | None,
) -> tuple[Path, EncodeResult | None]:
    """Return a video with usable motion: the source itself if it is AV1, else its encoding."""
    if not source.exists():
        message = f"there is no file or folder {source}"
        raise FileNotFoundError(message)
    if not source.is_dir() and not reencode:
        try:
            with open_source(source, options.read):
                return source, None
        except NotAv1Error:
            pass  # any video that FFmpeg decodes can be encoded

    tell = stage_progress(progress, "encode")
    result = encode_video(source, staging / outputs.VIDEO, options=options.encode, progress=tell)
    return result.path, result


def _image_names(num_frames: int, encoding: EncodeResult | None) -> tuple[str, ...]:
    if encoding is not None and encoding.image_names is not None:
        return encoding.image_names[:num_frames]
    return frame_names(num_frames)


def frame_names(num_frames: int) -> tuple[str, ...]:
    """Names of a video's frames in a COLMAP model; they sort in frame order."""
    return tuple(f"frame_{frame:06d}.png" for frame in range(num_frames))


def _tell(progress: Progress | None, stage: str) -> None:
    if progress is not None:
        progress(stage, 0, None)


def _write_report(folder: Path, data: dict[str, Any]) -> None:
    from mvmatch.report import write_report

    write_report(folder, data)


def _describe_movers(weights: NDArray[np.float64], options: RunOptions) -> dict[str, Any]:
    return {
        "num_tracks": int(np.sum(weights < options.movers.min_weight)),
        "excluded": options.movers.exclude,
    }


def _report_data(run: Run, source: Path, options: RunOptions, clock: StageClock) -> dict[str, Any]:
    match, model = run.match, run.model
    tracks = _at_rest(match.tracks, run.weights, options)
    after = tracks.adjacency(match.num_frames, max_gap=options.track.max_gap)
    lengths = np.diff(tracks.offsets)
    warnings = [
        *(run.encoding.warnings if run.encoding else ()),
        *match.warnings,
        *outputs.camera_warnings(run.camera, model),
    ]
    return {
        **outputs.provenance(),
        "input": outputs.describe_input(source, match.info, run.encoding),
        "camera": outputs.describe_camera(run.camera, model),
        "options": to_mapping(options),
        "reference_structure": match.structure.summary(match.frames),
        "stages": [dataclasses.asdict(stage) for stage in clock.stages],
        "peak_rss_mb": peak_rss_mb(),
        "matches": {
            "num_tracks": len(tracks),
            "num_further_tracks": len(match.further),
            "num_observations": len(tracks.frame),
            "mean_track_length": float(lengths.mean()) if len(lengths) else 0.0,
            "max_track_length": int(lengths.max()) if len(lengths) else 0,
            "keypoints_per_image": np.bincount(tracks.frame, minlength=match.num_frames).tolist(),
            "matches_per_image": after.sum(axis=1).tolist(),
            "num_pairs": run.database.num_pairs,
            "num_estimated_pairs": run.database.num_estimated_pairs,
            "num_verified_pairs": run.database.num_verified_pairs,
            "num_matches": run.database.num_matches,
            "num_inliers": run.database.num_inliers,
        },
        "footage": match.footage.summary(),
        "movers": None if run.weights is None else _describe_movers(run.weights, options),
        "adjacency_before": match.structure.adjacency(match.num_frames).tolist(),
        "adjacency_after": after.tolist(),
        "scores": [dataclasses.asdict(score) for score in run.database.scores],
        "model": outputs.describe_model(model, options.mapper, run.dense),
        "damage": (
            None
            if match.damage is None
            else {"message": str(match.damage), "frames_read": len(match.frames)}
        ),
        "skipped": [dataclasses.asdict(part) for part in match.skipped],
        "warnings": warnings,
    }
