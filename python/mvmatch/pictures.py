"""What pictures add to the tracks of a video: alignment, bridged gaps, closed loops."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.bridge import BridgeOptions, LoopOptions, bridge_tracks, close_loops
from mvmatch.errors import DataError
from mvmatch.match import stage_progress
from mvmatch.refine import RefineOptions, gray_pictures, refine_groups
from mvmatch.sfm import choose_keyframes
from mvmatch.store import is_table
from mvmatch.types import Tracks

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.match import Match, Progress, TrackGroup
    from mvmatch.types import StrPath


def refine_match(
    match: Match,
    pictures: StrPath,
    *,
    options: RefineOptions | None = None,
    groups: Sequence[TrackGroup] = ("tracks", "further"),
    progress: Progress | None = None,
) -> Match:
    """Align the tracks of a video to its pictures.

    Parameters
    ----------
    match : Match
        Of :func:`mvmatch.matching.match_video`.
    pictures : path
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
    pictures = Path(pictures)
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
    pictures: StrPath,
    camera: pycolmap.Camera,
    *,
    options: BridgeOptions,
    progress: Progress | None = None,
) -> Match:
    """Match pictures by descriptors where motion vectors leave a gap between them.

    Parameters
    ----------
    match : Match
        Of :func:`mvmatch.matching.match_video`.
    pictures : path
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
    pictures = Path(pictures)
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
    pictures: StrPath,
    camera: pycolmap.Camera,
    *,
    options: LoopOptions,
    progress: Progress | None = None,
) -> Match:
    """Match key frames far apart in time by descriptors where they show the same place.

    Parameters
    ----------
    match : Match
        Of :func:`mvmatch.matching.match_video`.
    pictures : path
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
    pictures = Path(pictures)
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
