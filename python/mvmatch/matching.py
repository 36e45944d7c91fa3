"""From a video to tracks: motion fields read, chained and cleaned, without a picture."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.batches import joined
from mvmatch.errors import DataError
from mvmatch.footage import FootageObserver, FootageOptions
from mvmatch.match import Match, stage_progress
from mvmatch.sources import (
    FrameFacts,
    MotionSource,
    ReadOptions,
    ReferenceStructure,
    UntilDamage,
    open_video,
)
from mvmatch.store import StoredMotion, is_table
from mvmatch.tracks import TrackOptions, chain_fields
from mvmatch.types import Tracks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvmatch.match import Progress
    from mvmatch.types import StrPath


def match_video(
    video: StrPath,
    *,
    options: TrackOptions | None = None,
    footage: FootageOptions | None = None,
    read: ReadOptions | None = None,
    progress: Progress | None = None,
) -> Match:
    """Read a video's motion vectors and chain them into tracks.

    Parameters
    ----------
    video : path
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
    video = Path(video)
    options = options or TrackOptions.preset("default")
    structure, observer = ReferenceStructure(), FootageObserver(footage)
    with open_source(video, read) as source:
        reading = UntilDamage(source, structure, stage_progress(progress, "match"))
        tracks, further = chain_fields(observer.watch(reading), options=options)
        frames, info, skipped = source.frames, source.info, tuple(source.skipped)
    num_frames = 1 + max((f.display_index for f in frames if f.is_shown), default=-1)
    if reading.damage is not None:
        if num_frames < 2:
            raise reading.damage
        tracks, further = (_first_frames(each, num_frames) for each in (tracks, further))
    _require_motion(video, frames, structure, num_frames)
    tracks, found = observer.clean(tracks, min_length=options.min_length)
    further, _ = observer.clean(further, min_length=options.min_length)
    return Match(
        tracks=tracks,
        further=further,
        info=dataclasses.replace(info, num_frames=num_frames),
        frames=frames,
        structure=structure,
        footage=found,
        damage=reading.damage,
        skipped=skipped,
    )


def open_source(path: StrPath, options: ReadOptions | None = None) -> MotionSource:
    """Open a video or a stored motion table; see :func:`mvmatch.sources.open_video`."""
    path = Path(path)
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


def _first_frames(tracks: Tracks, num_frames: int) -> Tracks:
    """Drop observations of pictures that the stream announced but never showed."""
    return joined(_shown(part, num_frames) for part in tracks.parts())


def _shown(tracks: Tracks, num_frames: int) -> Tracks:
    keep = tracks.frame < num_frames
    length = np.add.reduceat(keep, tracks.offsets[:-1])
    # Frames increase in a track, so what is cut is its end; a single point is no track.
    keep &= np.repeat(length > 1, tracks.lengths)
    length = length[length > 1]
    return Tracks(
        offsets=np.concatenate([[0], np.cumsum(length)]).astype(np.int64),
        frame=tracks.frame[keep],
        xy=tracks.xy[keep],
    )
