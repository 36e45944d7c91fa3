"""From a video to tracks: motion fields read, chained, cleaned, and aligned if asked."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.batches import joined
from mvmatch.bridge import BridgeOptions, LoopOptions, bridge_tracks, close_loops
from mvmatch.errors import DataError
from mvmatch.footage import FootageObserver, FootageOptions
from mvmatch.match import Match
from mvmatch.refine import RefineOptions, gray_pictures, refine_groups
from mvmatch.sfm import choose_keyframes
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
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.match import Progress, TrackGroup


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


def refine_match(
    match: Match,
    pictures: Path,
    *,
    options: RefineOptions | None = None,
    groups: Sequence[TrackGroup] = ("tracks", "further"),
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
        See :func:`mvmatch.refine.refine_groups`; ``when`` is not looked at.
    groups : sequence of {"tracks", "further"}
        Which of the match's tracks are aligned. Neither has a part in what becomes of the others.
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
    _require_pictures(match, pictures, "refined")
    decoded = _pictures(match, pictures, stage_progress(progress, "refine"))
    refined = refine_groups([getattr(match, group) for group in groups], decoded, options=options)
    for group, tracks in zip(groups, refined, strict=True):
        if len(getattr(match, group)) and not len(tracks):
            message = f"no track fits the pictures of {pictures}. Are they those of the video?"
            raise DataError(message)
    return dataclasses.replace(
        match,
        **dict(zip(groups, refined, strict=True)),
        is_refined=match.is_refined or "tracks" in groups,
        is_further_refined=match.is_further_refined or "further" in groups,
    )


def bridge_match(
    match: Match,
    pictures: Path,
    camera: pycolmap.Camera,
    *,
    options: BridgeOptions,
    progress: Progress | None = None,
) -> Match:
    """Match pictures by descriptors where motion vectors leave a gap between them.

    Parameters
    ----------
    match : Match
        Of :func:`match_video`.
    pictures : Path
        The video, or the video or folder of images it was encoded from.
    camera : pycolmap.Camera
        Of the pictures.
    options : BridgeOptions
        See :func:`mvmatch.bridge.bridge_tracks`.
    progress : Progress, optional
        Told after each picture.

    Returns
    -------
    Match
        With more tracks, and without the cuts, breaks and jumps that were bridged. Gaps at and
        after a picture that cannot be decoded, or has another size, stay: ``unreadable`` says why.

    Raises
    ------
    UnsupportedError
        The matcher does not work with the installed pycolmap.
    FileNotFoundError
        There are no such pictures.
    """
    faults: list[str] = []

    def readable() -> Iterator[NDArray[np.uint8]]:
        try:
            yield from _pictures(match, pictures, stage_progress(progress, "bridge"))
        except DataError as error:
            faults.append(str(error))

    bridge = bridge_tracks(
        readable,
        match.tracks,
        camera,
        num_frames=match.num_frames,
        options=options,
        jumps=match.footage.jumps,
    )
    return dataclasses.replace(
        match,
        tracks=Tracks.concatenate(match.tracks, bridge.tracks),
        footage=match.footage.without({gap + 1 for gap in bridge.bridged}),
        gaps=bridge.gaps,
        bridged=bridge.bridged,
        unreadable=faults[0] if faults and bridge.gaps != bridge.bridged else None,
    )


def loop_match(
    match: Match,
    pictures: Path,
    camera: pycolmap.Camera,
    *,
    options: LoopOptions,
    progress: Progress | None = None,
) -> Match:
    """Match key frames far apart in time by descriptors where they show the same place.

    Parameters
    ----------
    match : Match
        Of :func:`match_video`.
    pictures : Path
        The video, or the video or folder of images it was encoded from.
    camera : pycolmap.Camera
        Of the pictures.
    options : LoopOptions
        See :func:`mvmatch.bridge.close_loops`.
    progress : Progress, optional
        Told after each picture.

    Returns
    -------
    Match
        With more tracks, and with the pairs that they tie together.

    Raises
    ------
    UnsupportedError
        The matcher does not work with the installed pycolmap.
    DataError
        The pictures cannot be decoded, or have another size than the video; or parts of the stream
        were skipped, so that nobody knows which picture is which.
    """
    _require_pictures(match, pictures, "looked through for loops")
    diagonal = float(np.hypot(match.info.width, match.info.height))
    loops = close_loops(
        _pictures(match, pictures, stage_progress(progress, "loops")),
        choose_keyframes(match.tracks, diagonal=diagonal),
        camera,
        options=options,
    )
    tracks = Tracks.concatenate(match.tracks, loops.tracks)
    return dataclasses.replace(match, tracks=tracks, loops=loops.pairs)


def _require_pictures(match: Match, pictures: Path, what: str) -> None:
    if is_table(pictures):
        message = f"{pictures} holds no pictures: it cannot be {what}. Give the video itself"
        raise DataError(message)
    if match.skipped:
        message = f"a damaged stream that was read on cannot be {what}. Do without"
        raise DataError(message)


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


def stage_progress(
    progress: Progress | None, stage: str
) -> Callable[[int, int | None], None] | None:
    """Return the progress of one stage."""
    return None if progress is None else functools.partial(progress, stage)
