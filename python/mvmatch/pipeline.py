"""From a video to tracks, and from a video to a model: the only place that knows the order."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from mvmatch import outputs
from mvmatch.camera import parse_camera
from mvmatch.config import RunOptions, to_mapping
from mvmatch.encode import EncodeResult, encode_video
from mvmatch.errors import DataError, MvmatchError, NotAv1Error
from mvmatch.export.colmap import write_database
from mvmatch.export.masks import write_masks
from mvmatch.footage import Footage, FootageObserver, FootageOptions
from mvmatch.geometry.movers import track_weights
from mvmatch.measure import StageClock, peak_rss_mb
from mvmatch.opencv import require_opencv
from mvmatch.refine import RefineOptions, gray_pictures, refine_tracks
from mvmatch.sfm import reconstruct
from mvmatch.sources import (
    FrameFacts,
    MotionSource,
    ReadOptions,
    ReferenceStructure,
    Skipped,
    UntilDamage,
    open_video,
)
from mvmatch.store import StoredMotion, TracksTable, is_table, write_tracks
from mvmatch.tracks import TrackOptions, build_tracks
from mvmatch.types import Tracks, VideoInfo

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from mvmatch.camera import CameraChoice
    from mvmatch.export.colmap import DatabaseSummary
    from mvmatch.sfm import MapperOptions, ReconstructionResult


class Progress(Protocol):
    """Told how far a stage is; ``total`` is None where nobody knows."""

    def __call__(self, stage: str, done: int, total: int | None) -> None:
        """Take note."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Match:
    """Tracks of a video and how the video was coded."""

    tracks: Tracks
    info: VideoInfo
    """Facts of the video; ``num_frames`` is the number of pictures that were really there."""
    frames: tuple[FrameFacts, ...]
    """Header facts in decode order."""
    structure: ReferenceStructure
    """Counts of vectors per reference distance and frame pair."""
    footage: Footage
    """Cuts, repeated pictures and static overlays; the tracks heed them."""
    damage: MvmatchError | None
    """Why the stream broke off; the tracks cover the frames before."""
    skipped: tuple[Skipped, ...] = ()
    """What could not be read of a stream that was read on after damage."""

    @property
    def num_frames(self) -> int:
        """Pictures, display index 0 to ``num_frames - 1``."""
        return self.info.num_frames or 0

    @property
    def warnings(self) -> list[str]:
        """What makes matching hard, and damage, in sentences."""
        found = self.structure.warnings(self.frames) + self.footage.warnings()
        if self.damage is not None:
            found.insert(0, f"The stream broke off after {len(self.frames)} frames: {self.damage}")
        return [*skipped_warnings(self.skipped), *found]


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """What :func:`reconstruct_video` made."""

    out: Path
    match: Match
    database: DatabaseSummary
    model: ReconstructionResult
    camera: CameraChoice
    encoding: EncodeResult | None
    weights: NDArray[np.float64] | None
    """(T,) weight of each track of ``match``, low on moving objects; None: not computed."""
    data: dict[str, Any]
    """The report (docs/reference/report-schema.md)."""


def match_video(
    video: Path,
    *,
    options: TrackOptions | None = None,
    footage: FootageOptions | None = None,
    read: ReadOptions | None = None,
    progress: Progress | None = None,
) -> Match:
    """Read a video's motion vectors and chain them into tracks.

    Parameters
    ----------
    video : Path
        An AV1 video, or a motion table that ``mvmatch extract`` wrote.
    options : TrackOptions, optional
        How vectors become tracks; the default preset without.
    footage : FootageOptions, optional
        What counts as a cut, a repeated picture and a static overlay.
    read : ReadOptions, optional
        What the stream may cost, what happens where it is damaged, and which layers of a scalable
        stream are read; see :func:`mvmatch.sources.open_video`.
    progress : Progress, optional
        Told after each frame.

    Returns
    -------
    Match
        Tracks in px. When the stream is damaged after its second picture, those of the pictures
        before, with the damage named.

    Raises
    ------
    FileNotFoundError
        There is no such file.
    DataError
        The file is not a video, has no motion vectors (one frame, key frames only) or does not have
        the operating point.
    UnsupportedError
        The video is not AV1, or uses a tool that is not handled.
    BitstreamError
        It is damaged before there are two pictures.
    """
    options = options or TrackOptions.preset("default")
    structure, observer = ReferenceStructure(), FootageObserver(footage)
    with open_source(video, read) as source:
        reading = UntilDamage(source, structure, _stage(progress, "match"))
        tracks = build_tracks(observer.watch(reading), options=options)
        frames, info, skipped = tuple(source.frames), source.info, tuple(source.skipped)
    num_frames = 1 + max((f.display_index for f in frames if f.is_shown), default=-1)
    if reading.damage is not None:
        if num_frames < 2:
            raise reading.damage
        tracks = _first_frames(tracks, num_frames)
    _require_motion(video, frames, structure, num_frames)
    tracks, found = observer.clean(tracks, min_length=options.min_length)
    return Match(
        tracks=tracks,
        info=dataclasses.replace(info, num_frames=num_frames),
        frames=frames,
        structure=structure,
        footage=found,
        damage=reading.damage,
        skipped=skipped,
    )


def refine_match(
    match: Match,
    pictures: Path,
    *,
    options: RefineOptions | None = None,
    progress: Progress | None = None,
) -> Match:
    """Align the tracks of a video to its pictures.

    Parameters
    ----------
    match : Match
        Of :func:`match_video`.
    pictures : Path
        The video, or the video or folder of images it was encoded from.
    options : RefineOptions, optional
        See :func:`mvmatch.refine.refine_tracks`; ``enabled`` is not looked at.
    progress : Progress, optional
        Told after each picture.

    Returns
    -------
    Match
        With other tracks.

    Raises
    ------
    MissingExtraError
        OpenCV is not installed.
    DataError
        The pictures cannot be decoded, have another size than the video, or show something else;
        or parts of the stream were skipped, so that nobody knows which picture is which.
    """
    if is_table(pictures):
        message = f"{pictures} holds no pictures to refine with. Give the video itself"
        raise DataError(message)
    if match.skipped:
        message = "tracks of a damaged stream that was read on cannot be refined. Do without"
        raise DataError(message)
    decoded = _pictures(match, pictures, _stage(progress, "refine"))
    tracks = refine_tracks(match.tracks, decoded, options=options)
    if len(match.tracks) and not len(tracks):
        message = f"no track fits the pictures of {pictures}. Are they those of the video?"
        raise DataError(message)
    return dataclasses.replace(match, tracks=tracks)


def _pictures(
    match: Match, source: Path, tell: Callable[[int, int | None], None] | None
) -> Iterator[NDArray[np.uint8]]:
    """Yield the pictures of a video in grey, of the size that its tracks are in."""
    size = (match.info.width, match.info.height)
    for number, picture in enumerate(gray_pictures(source, max_frames=match.num_frames), 1):
        if picture.shape[::-1] != size:
            message = "{} has pictures of {}x{} px, its tracks are in {}x{} px".format(
                source, *picture.shape[::-1], *size
            )
            raise DataError(message)
        yield picture
        if tell is not None:
            tell(number, match.num_frames)


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
        table = TracksTable(tracks=match.tracks, info=match.info, image_names=names)
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
        run = Run(
            out=out,
            match=match,
            database=summary,
            model=model,
            camera=choice,
            encoding=encoding,
            weights=weights,
            data={},
        )
        run.data.update(_report_data(run, source, options, clock))
        _write_report(staging, run.data)
        outputs.publish(staging, out)
    return run if model.path is None else _moved(run, out / outputs.MODEL / model.path.name)


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


def open_source(path: Path, options: ReadOptions | None = None) -> MotionSource:
    """Open a video or a stored motion table; see :func:`mvmatch.sources.open_video`."""
    options = options or ReadOptions()
    if is_table(path):
        return StoredMotion(path)
    return open_video(
        path,
        errors=options.errors,
        limits=options.limits,
        operating_point=options.operating_point,
        threads=options.threads,
    )


def skipped_warnings(skipped: Sequence[Skipped]) -> list[str]:
    """Say what was left out of a stream: the first five places, and how many more there are."""
    shown = [f"A part of the stream was skipped. {part}" for part in skipped[:5]]
    if len(skipped) > 5:
        shown.append(f"{len(skipped) - 5} more parts of the stream were skipped.")
    return shown


def _require_motion(
    video: Path, frames: Sequence[FrameFacts], structure: ReferenceStructure, num_frames: int
) -> None:
    if num_frames < 2:
        message = f"{video} shows only one picture; motion needs at least two. Give a longer video"
        raise DataError(message)
    if structure.num_vectors:
        return
    if all(frame.frame_type == "KEY" for frame in frames if not frame.is_repeat):
        reason = f"every one of its {num_frames} frames is a key frame"
    else:
        reason = "none of its blocks is predicted from another picture"
    message = (
        f"{video} holds no motion vectors: {reason}. "
        f"Encode it anew for matching: mvmatch run {video} --re-encode, or mvmatch encode"
    )
    raise DataError(message)


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

    tell = _stage(progress, "encode")
    result = encode_video(source, staging / outputs.VIDEO, options=options.encode, progress=tell)
    return result.path, result


def _image_names(num_frames: int, encoding: EncodeResult | None) -> tuple[str, ...]:
    if encoding is not None and encoding.image_names is not None:
        return encoding.image_names[:num_frames]
    return frame_names(num_frames)


def frame_names(num_frames: int) -> tuple[str, ...]:
    """Names of a video's frames in a COLMAP model; they sort in frame order."""
    return tuple(f"frame_{frame:06d}.png" for frame in range(num_frames))


def _first_frames(tracks: Tracks, num_frames: int) -> Tracks:
    """Drop observations of pictures that the stream announced but never showed."""
    keep = tracks.frame < num_frames
    length = np.add.reduceat(keep, tracks.offsets[:-1]) if len(tracks) else np.zeros(0, np.int64)
    # Frames increase in a track, so what is cut is its end; a single point is no track.
    keep &= np.repeat(length > 1, np.diff(tracks.offsets))
    length = length[length > 1]
    return Tracks(
        offsets=np.concatenate([[0], np.cumsum(length)]).astype(np.int64),
        frame=tracks.frame[keep],
        xy=tracks.xy[keep],
    )


def _stage(progress: Progress | None, stage: str) -> Callable[[int, int | None], None] | None:
    """Return the progress of one stage."""
    return None if progress is None else functools.partial(progress, stage)


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
        "model": outputs.describe_model(model, options.mapper),
        "damage": (
            None
            if match.damage is None
            else {"message": str(match.damage), "frames_read": len(match.frames)}
        ),
        "skipped": [dataclasses.asdict(part) for part in match.skipped],
        "warnings": warnings,
    }
