"""The verbs of single stages."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mvmatch.cli.console import Outcome, Ticker
from mvmatch.cli.settings import (
    ExistingFile,
    ExistingPath,
    Json,
    Refine,
    Settings,
    with_encoder,
    with_refinement,
)
from mvmatch.encode import EncoderName
from mvmatch.errors import MvmatchError

if TYPE_CHECKING:
    from mvmatch.types import VideoInfo


def probe(
    clip: ExistingFile, /, *, settings: Settings | None = None, json: Json = False
) -> Outcome:
    """Say how a video is coded and whether its vectors can be matched.

    Parameters
    ----------
    clip
        An AV1 video, or a motion table.
    """
    from mvmatch.match import skipped_warnings
    from mvmatch.matching import open_source
    from mvmatch.sources import ReferenceStructure, UntilDamage

    structure = ReferenceStructure()
    read = (settings or Settings()).options().read
    with Ticker() as tell, open_source(clip, read) as source:
        reading = UntilDamage(source, structure, lambda d, t: tell("read", d, t))
        for _ in reading:
            pass
        frames, info, skipped = source.frames, source.info, list(source.skipped)
    facts = structure.summary(frames)
    warnings = skipped_warnings(skipped) + structure.warnings(frames)
    encode = f"mvmatch encode {clip} {clip.stem}-matching.ivf"
    return Outcome(
        table=_frame_gaps(facts),
        figures=_probe_figures(info, facts),
        next=encode if warnings else f"mvmatch run {clip} -o out",
        data={
            "info": dataclasses.asdict(info),
            "reference_structure": facts,
            "skipped": [dataclasses.asdict(part) for part in skipped],
        },
        warnings=warnings,
        failure=reading.damage,
        partial=_kept(reading.damage, len(frames)),
    )


def encode(
    source: ExistingPath,
    clip: Path,
    /,
    *,
    encoder: EncoderName | None = None,
    settings: Settings | None = None,
    json: Json = False,
) -> Outcome:
    """Encode a folder of frames or any video into AV1 that is made for matching.

    Parameters
    ----------
    source
        A folder of at least two images of one size, or a video FFmpeg decodes.
    clip
        The AV1 file to write: .ivf, .mp4, .mkv or .webm.
    encoder
        svt (always there), libaom, nvenc, qsv or vaapi; see `mvmatch encoders`.
    """
    from mvmatch.encode import encode_video

    options = with_encoder((settings or Settings()).options(), encoder).encode
    with Ticker() as tell:
        result = encode_video(
            source, clip, options=options, progress=lambda d, t: tell("encode", d, t)
        )
    share = "" if result.check is None else f", {result.check.previous_share:.0%} of the vectors"
    share += " refer to the previous frame" if share else ""
    return Outcome(
        made=[clip],
        figures={
            "frames": f"{result.num_frames} of {result.width}x{result.height} px",
            "size": f"{result.num_bytes / 1000:,.0f} kB{share}",
            "cost": f"{result.seconds:.1f} s, {result.cpu_seconds:.1f} CPU s ({result.encoder})",
        },
        next=f"mvmatch run {clip} -o out",
        data={"encoding": result},
        warnings=list(result.warnings),
    )


def extract(
    clip: ExistingFile,
    table: Path,
    /,
    *,
    settings: Settings | None = None,
    json: Json = False,
) -> Outcome:
    """Write a video's motion vectors to a Parquet table.

    Parameters
    ----------
    clip
        An AV1 video.
    table
        The Parquet file to write.
    """
    from mvmatch.match import skipped_warnings
    from mvmatch.sources import ReferenceStructure, UntilDamage, open_video
    from mvmatch.store import write_motion

    structure = ReferenceStructure()
    read = (settings or Settings()).options().read
    video = open_video(
        clip,
        errors=read.errors,
        limits=read.limits,
        operating_point=read.operating_point,
        threads=read.threads,
    )
    with Ticker() as tell, video as source:
        reading = UntilDamage(source, structure, lambda d, t: tell("read", d, t))
        rows = write_motion(reading, table, info=source.info, frames=lambda: source.frames)
        frames = len(source.frames)
    return Outcome(
        made=[table],
        figures={"vectors": f"{rows:,} in {frames} frames"},
        next=f"mvmatch track {table} tracks.parquet",
        data={
            "num_vectors": rows,
            "num_frames": frames,
            "skipped": [dataclasses.asdict(part) for part in source.skipped],
        },
        warnings=skipped_warnings(source.skipped) + structure.warnings(source.frames),
        failure=reading.damage,
        partial=_kept(reading.damage, frames),
    )


def track(
    clip: ExistingFile,
    table: Path,
    /,
    *,
    refine: Refine = None,
    settings: Settings | None = None,
    json: Json = False,
) -> Outcome:
    """Chain motion vectors into tracks and write them to a Parquet table.

    Parameters
    ----------
    clip
        An AV1 video, or a motion table that `mvmatch extract` wrote.
    table
        The Parquet file to write.
    """
    from mvmatch.matching import match_video
    from mvmatch.pictures import refine_match
    from mvmatch.state import frame_names
    from mvmatch.store import TracksTable, write_tracks

    chosen = with_refinement((settings or Settings()).options(), refine)
    options = chosen.track
    with Ticker() as tell:
        match = match_video(
            clip, options=options, footage=chosen.footage, read=chosen.read, progress=tell
        )
        if chosen.refine.when == "always":
            match = refine_match(match, clip, options=chosen.refine, progress=tell)
        names = frame_names(match.num_frames)
        tracks = match.all_tracks
        stored = TracksTable(tracks=tracks, info=match.info, image_names=names)
        write_tracks(stored, table, options=dataclasses.asdict(options))
    per_image = len(tracks.frame) / max(match.num_frames, 1)
    return Outcome(
        made=[table],
        figures={
            "tracks": f"{len(tracks):,}, {len(tracks.frame) / max(len(tracks), 1):.1f} frames long",
            "keypoints": f"{per_image:,.0f} per image in {match.num_frames} images",
        },
        next=f"mvmatch export {table} database.db",
        data={
            "num_tracks": len(tracks),
            "num_observations": len(tracks.frame),
            "num_frames": match.num_frames,
            "skipped": [dataclasses.asdict(part) for part in match.skipped],
        },
        warnings=[text for text in match.warnings if not text.startswith("The stream broke off")],
        failure=match.damage,
        partial=_kept(match.damage, len(match.frames)),
    )


def encoders(*, json: Json = False) -> Outcome:
    """List the encoders and why those that are missing are missing."""
    from mvmatch.encode import available_encoders

    with Ticker() as tell:
        tell("trying encoders", 0, None)
        found = available_encoders()
    lines = [f"{s.name:<8}{'yes' if s.available else 'no':<5}{s.reason}" for s in found]
    usable = [status.name for status in found if status.available]
    return Outcome(
        table="\n".join(lines),
        next=f"mvmatch encode FRAMES clip.ivf --encoder {usable[0]}" if usable else None,
        data={"encoders": [dataclasses.asdict(status) for status in found]},
    )


def _kept(damage: MvmatchError | None, num_frames: int) -> str | None:
    if damage is None:
        return None
    return f"the {num_frames} frames before the damage were read, and only they are in the result"


def _probe_figures(info: VideoInfo, facts: dict[str, Any]) -> dict[str, str]:
    keys = facts["key_frames"]
    rate = f", {info.frame_rate:.3g} frames per s" if info.frame_rate else ""
    return {
        "video": f"{info.codec}, {info.width}x{info.height} px{rate}",
        "frames": f"{facts['shown_frames']} shown, {facts['hidden_frames']} hidden, "
        f"{len(keys)} key frame{'s' if len(keys) != 1 else ''}",
        "vectors": f"{facts['num_vectors']:,}, {facts['median_vectors_per_frame']:,.0f} per frame, "
        f"covering {_percent(facts['inter_area_share'])} of the pictures",
        "previous": f"{_percent(facts['share_to_previous'])} of their area refers to the previous "
        "picture",
    }


def _frame_gaps(facts: dict[str, Any]) -> str | None:
    shares: dict[str, float] = facts["area_share_per_distance"]
    if not shares:
        return None
    rows = [
        f"{distance:>8}  {facts['vectors_per_distance'][distance]:>9,}  {share:>7.1%}"
        for distance, share in shares.items()
    ]
    return "\n".join(["distance    vectors     area", *rows])


def _percent(share: float | None) -> str:
    return "none" if share is None else f"{share:.0%}"
