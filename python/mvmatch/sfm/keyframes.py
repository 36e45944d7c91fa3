"""Key frames: the few frames of a long video that are mapped; the others are registered to the map.

Successive frames of a video differ by pixels. Mapping all of them costs more than linear time and
says little more about the scene than every third to tenth does. Which ones is decided by the tracks
alone, before anything is mapped.
"""

# pyright: reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from mvmatch.filters import within_budget
from mvmatch.pairing import shared
from mvmatch.sfm.database import (
    MIN_MATCHES,
    ImageTracks,
    read_facts,
    read_image_tracks,
    write_subset,
)
from mvmatch.types import Tracks

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray


MIN_KEYFRAMES = 3
"""A camera that gives fewer stands still, which the image pairs of all frames tell best."""


@dataclass(frozen=True, kw_only=True)
class KeyframeOptions:
    """Which frames of a long video are mapped."""

    mode: Literal["auto", "all"] = "auto"
    """``all`` maps every image. ``auto`` maps key frames where there are more than ``max_images``
    images of one moving camera: hardly any verified pair is farther apart than ``max_reach``, no
    rig."""
    max_images: int = 60
    """So many images are mapped all."""
    max_reach: int = 32
    """Images. Pairs farther apart close loops; their images are key frames."""
    max_looped: float = 0.5
    """Share of the images that such pairs may have: more, and it is no video matched along time."""
    min_displacement: float = 0.05
    """Share of the picture's diagonal; a key frame follows where the median track has moved so far
    since the last one."""
    min_share: float = 0.4
    """Share of the last key frame's tracks that its successor still sees, if any frame does."""
    max_gap: int = 10
    """Frames between key frames while the camera moves: as far as matches reach."""
    still: float = 0.5
    """px; where the median track has moved less since the last key frame, nothing moves."""
    max_keypoints: int | None = 1000
    """Matched keypoints of a key frame (:func:`mvmatch.filters.budget`)."""
    max_observations: int | None = 2000
    """Observed points of an image in the finished model, likewise: more cost memory and time, and
    move poses no more than chance does."""
    max_total: int | None = 5_000_000
    """Observations that ``max_observations`` may come to over all images; where a video is too long
    for that, each image has fewer. The last adjustment takes 0.7 KB of memory for each."""
    window: int = 10
    """Key frames from one to the other of a matched pair, at most."""


def choose_keyframes(
    tracks: Tracks, *, diagonal: float, options: KeyframeOptions | None = None
) -> NDArray[np.int64]:
    """Choose key frames by what the tracks do since the last one.

    The next key frame is the first that moved far enough, or the last that shares enough tracks.
    Neither a camera at rest nor a repeated picture adds any, unless the tracks run out.

    Parameters
    ----------
    tracks : Tracks
        Observations in px.
    diagonal : float
        Of the picture, px.
    options : KeyframeOptions, optional
        Bounds.

    Returns
    -------
    (K,) int64
        Frames, rising: the first that has observations and, unless nothing moved since the last
        key frame, the last. Frames without observations are never among them.
    """
    options = options or KeyframeOptions()
    frames = np.flatnonzero(np.bincount(tracks.frame)).tolist()
    last = len(frames) - 1
    chosen, place = [0] if frames else [], 1
    while place <= last:
        keyframe = frames[chosen[-1]]
        share, displacement = _since(tracks, keyframe, frames[place])
        lost = share < options.min_share
        far = displacement >= options.min_displacement * diagonal
        if displacement > options.still:
            far |= place == last or frames[place] - keyframe >= options.max_gap
        if lost:  # the frame before still saw enough tracks, unless it is the key frame itself
            place = max(place - 1, chosen[-1] + 1)
        if lost or far:
            chosen.append(place)
        place += 1
    return np.array(frames, np.int64)[chosen]


def _since(tracks: Tracks, keyframe: int, frame: int) -> tuple[float, float]:
    """Share of a key frame's tracks that a later frame sees, and how far their median came, px."""
    seen = tracks.between(keyframe, frame)
    if len(seen) == 0:
        return 0.0, 0.0
    way = np.linalg.norm(seen.xy1 - seen.xy0, axis=1)
    return len(seen) / len(tracks.observations(keyframe)), float(np.median(way))


@dataclass(frozen=True, kw_only=True, eq=False)
class KeyframeSelection:
    """The key frames of a database, or of some of its successive images."""

    database: Path
    """Of all images. Their tracks are read when they are needed: mapping has no room for them."""
    all_ids: NDArray[np.int64]
    """(F,) of the images, key frames and others, rising."""
    frames: NDArray[np.int64]
    """(K,) positions of the key frames among the images, rising."""
    loops: NDArray[np.int64]
    """(L, 2) positions of the key frames of pairs that close loops."""
    size: tuple[int, int]
    """Width and height of the picture, px."""
    options: KeyframeOptions

    @property
    def num_images(self) -> int:
        """Key frames and others."""
        return len(self.all_ids)

    @property
    def image_ids(self) -> list[int]:
        """Of the key frames, rising."""
        return self.all_ids[self.frames].tolist()

    def around(self, image_ids: Sequence[int]) -> KeyframeSelection:
        """Return some successive key frames, with the images from the first to the last of them.

        Before the first key frame and after the last there is no boundary.
        """
        places = self.frames[np.isin(self.image_ids, image_ids)]
        start = 0 if image_ids[0] == self.image_ids[0] else int(places[0])
        end = self.num_images if image_ids[-1] == self.image_ids[-1] else int(places[-1]) + 1
        chosen = (self.frames >= start) & (self.frames < end)
        inside = ((self.loops >= start) & (self.loops < end)).all(axis=1)
        return replace(
            self,
            all_ids=self.all_ids[start:end],
            frames=self.frames[chosen] - start,
            loops=self.loops[inside] - start,
        )

    def read_images(self) -> ImageTracks:
        """Read the tracks of the images."""
        images = read_image_tracks(self.database)
        start = images.image_ids.tolist().index(int(self.all_ids[0]))
        end = start + self.num_images
        if self.num_images == len(images.image_ids):
            return images
        tracks = images.tracks
        inside = (tracks.frame >= start) & (tracks.frame < end)
        return ImageTracks(
            image_ids=self.all_ids,
            tracks=_observed(tracks, inside, tracks.frame - np.int32(start)),
            keypoint=images.keypoint[inside],
        )

    def write_database(self, images: ImageTracks, path: Path) -> None:
        """Write a database of the key frames, matched along the tracks that the budget admits."""
        tracks, keypoint = self._between_keyframes(images)
        ids = self.image_ids
        matches = [
            (
                ids[first],
                ids[second],
                np.stack(
                    [
                        keypoint[tracks.observations(first)[pairs[:, 0]]],
                        keypoint[tracks.observations(second)[pairs[:, 1]]],
                    ],
                    axis=1,
                ),
            )
            for first, second, pairs in self._pairs(tracks)
            if len(pairs) >= MIN_MATCHES
        ]
        write_subset(self.database, path, image_ids=ids, matches=matches)

    def _pairs(self, tracks: Tracks) -> Iterator[tuple[int, int, NDArray[np.uint32]]]:
        """Key frames, numbered through, that are matched: those near each other, and loops."""
        yield from tracks.pairs(self.options.window)
        for first, second in np.searchsorted(self.frames, self.loops).tolist():
            if second - first > self.options.window:
                yield first, second, shared(tracks, first, second)

    def within_model(self, tracks: Tracks) -> NDArray[np.bool_]:
        """(T,) tracks that have a place in the finished model; those that close loops always do."""
        bounds: list[int] = []
        if self.options.max_observations is not None:
            bounds.append(self.options.max_observations)
        if self.options.max_total is not None:
            bounds.append(max(1, self.options.max_total // self.num_images))
        if not bounds:
            return np.ones(len(tracks), np.bool_)
        keep = within_budget(tracks, max_keypoints=min(bounds), size=self.size)
        return keep | closes_loop(tracks, self.options)

    def _between_keyframes(self, images: ImageTracks) -> tuple[Tracks, NDArray[np.uint32]]:
        """Tracks over key frames, numbered through, and the keypoint of each observation."""
        tracks = images.tracks
        number = np.full(self.num_images, -1, np.int32)
        number[self.frames] = np.arange(len(self.frames))
        observed = number[tracks.frame] >= 0
        # A point of the model needs three views.
        lengths = np.bincount(tracks.track_index[observed], minlength=len(tracks))
        observed &= lengths[tracks.track_index] >= 3
        between = _observed(tracks, observed, number[tracks.frame])
        keypoint = images.keypoint[observed]
        if self.options.max_keypoints is None:
            return between, keypoint
        keep = within_budget(between, max_keypoints=self.options.max_keypoints, size=self.size)
        keep |= closes_loop(tracks, self.options)[np.unique(tracks.track_index[observed])]
        return between.select(keep), keypoint[keep[between.track_index]]


def select_keyframes(
    path: Path, options: KeyframeOptions, *, mapped: Path | None = None
) -> KeyframeSelection | None:
    """Choose the key frames of a database, and write their database to ``mapped``.

    Returns
    -------
    KeyframeSelection or None
        None where every image is to be mapped; then nothing is written.
    """
    if options.mode == "all":
        return None
    facts = read_facts(path)
    loops = facts.pairs[facts.pairs[:, 1] - facts.pairs[:, 0] > options.max_reach]
    is_video = len(np.unique(loops)) <= options.max_looped * facts.num_images
    if facts.num_images <= options.max_images or facts.has_rigs or not is_video:
        return None
    images = read_image_tracks(path)
    diagonal = float(np.hypot(*facts.size))
    # What closes loops is seen in few pictures, and would say that tracks end soon.
    tracks = images.tracks.select(~closes_loop(images.tracks, options))
    frames = choose_keyframes(tracks, diagonal=diagonal, options=options)
    if len(frames) < MIN_KEYFRAMES:
        return None
    selection = KeyframeSelection(
        database=path,
        all_ids=images.image_ids,
        frames=np.union1d(frames, loops),
        loops=loops,
        size=facts.size,
        options=options,
    )
    if mapped is not None:
        selection.write_database(images, mapped)
    return selection


def closes_loop(tracks: Tracks, options: KeyframeOptions) -> NDArray[np.bool_]:
    """(T,) tracks that end, and are seen again so much later that nothing else leads there."""
    step = np.diff(tracks.frame)
    far = (step > options.max_reach) & (np.diff(tracks.track_index) == 0)
    closes = np.zeros(len(tracks), np.bool_)
    closes[tracks.track_index[1:][far]] = True
    return closes


def _observed(tracks: Tracks, observed: NDArray[np.bool_], frame: NDArray[np.int32]) -> Tracks:
    """Tracks of the marked observations, with other frame numbers; empty ones are left out."""
    lengths = np.bincount(tracks.track_index[observed], minlength=len(tracks))
    return Tracks(
        offsets=np.concatenate(([0], np.cumsum(lengths[lengths > 0]))).astype(np.int64),
        frame=frame[observed],
        xy=tracks.xy[observed],
    )
