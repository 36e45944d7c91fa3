"""Observations of tracks aligned to anchor patches of the same tracks."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.refine.deformation import local_deformation
from mvmatch.refine.options import RefineOptions
from mvmatch.refine.patches import (
    Alignment,
    align_patches,
    cut_patches,
    deform_patches,
    opencv,
    split,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from mvmatch.types import Tracks

_ANCHOR_HALF = 15
"""px; half the side of a stored patch: room for windows that shrink to anchor_scale's inverse."""


_AT_ONCE = 1 << 14
"""Patches that lie side by side in one image: OpenCV takes no more than 32,766 points in a call,
and what is deformed and compared takes some 4 kB for each."""


def refine_tracks(
    tracks: Tracks,
    pictures: Iterable[NDArray[np.uint8]],
    *,
    options: RefineOptions | None = None,
) -> Tracks:
    """Align tracks to the pictures they were seen in.

    Parameters
    ----------
    tracks, pictures, options
        As for :func:`refine_groups`.

    Returns
    -------
    Tracks
        In the same order; those shorter than two observations are gone.

    Raises
    ------
    MissingExtraError, ValueError
        As :func:`refine_groups` does.
    """
    (refined,) = refine_groups((tracks,), pictures, options=options)
    return refined


def refine_groups(
    groups: Sequence[Tracks],
    pictures: Iterable[NDArray[np.uint8]],
    *,
    options: RefineOptions | None = None,
) -> list[Tracks]:
    """Align groups of tracks that know nothing of each other, in one pass over the pictures.

    A track's first observation is its first anchor: a patch around it is kept. In each later frame
    the patch, deformed as the neighbouring tracks tell, is aligned near the codec's position. An
    aligned observation becomes the next anchor when the last one is old or looks too different, so
    errors add up once per anchor, not once per frame.

    Parameters
    ----------
    groups : sequence of Tracks
        From the codec's vectors, px.
    pictures : iterable of (H, W) uint8 arrays
        Grey values, in display order from display index 0. Read once, one kept at a time; what else
        is kept is one patch of about 1 kB per living track. Where they end early, observations
        count as not aligned.
    options : RefineOptions, optional
        Settings; ``when`` is not looked at.

    Returns
    -------
    list of Tracks
        One per group, in the same order; tracks shorter than two observations are gone.

    Raises
    ------
    MissingExtraError
        OpenCV is not installed.
    ValueError
        A picture is not (H, W) uint8.
    """
    opencv()
    options = options or RefineOptions()
    refinements = [_Refinement(tracks, options) for tracks in groups]
    num_frames = max((tracks.num_frames for tracks in groups), default=0)
    for frame, picture in zip(range(num_frames), pictures, strict=False):
        if picture.ndim != 2 or picture.dtype != np.uint8:
            message = f"a picture must be (H, W) uint8, not {picture.shape} {picture.dtype}"
            raise ValueError(message)
        for refinement in refinements:
            refinement.add(frame, picture)
    return [refinement.result() for refinement in refinements]


@dataclass(kw_only=True, eq=False)
class _Living:
    """Tracks that are being followed: one row each, in rising order of their numbers."""

    track: NDArray[np.int64]
    """(L,) number of the track."""
    observation: NDArray[np.int64]
    """(L,) its last observation."""
    xy: NDArray[np.float64]
    """(L, 2) px, where that is."""
    correction: NDArray[np.float64]
    """(L, 2) px, from the codec's position to it."""
    anchor_frame: NDArray[np.int32]
    """(L,) where the patch is from."""
    patch: NDArray[np.uint8]
    """(L, P, P) grey values of the anchor."""
    offset: NDArray[np.float64]
    """(L, 2) px, the point in the patch, from its central pixel's centre."""
    deformation: NDArray[np.float64]
    """(L, 2, 2) of the patch since then: derivative of positions now by those in the anchor."""

    def select(self, keep: NDArray[np.bool_]) -> _Living:
        return _Living(**{name: values[keep] for name, values in vars(self).items()})

    def joined(self, other: _Living) -> _Living:
        order = np.argsort(np.concatenate([self.track, other.track]))
        mine, others = vars(self), vars(other)
        return _Living(**{name: np.concatenate([mine[name], others[name]])[order] for name in mine})


class _Refinement:
    """Goes through the pictures with the tracks that live in them."""

    def __init__(self, tracks: Tracks, options: RefineOptions) -> None:
        self._tracks, self._options = tracks, options
        self._codec = tracks.xy.astype(np.float64)
        self._refined = tracks.xy.copy()
        self._keep = np.full(tracks.num_observations, options.unaligned == "keep")
        self._living = self._anchored(0, np.zeros((1, 1), np.uint8), np.empty(0, np.int64))

    def add(self, frame: int, picture: NDArray[np.uint8]) -> None:
        """Align the observations of one frame and start the tracks that begin in it."""
        observation = self._tracks.observations(frame)
        track = self._tracks.track_index[observation]
        last = self._tracks.offsets[self._living.track + 1] - 1
        self._living = self._living.select(self._living.observation < last)
        row = np.searchsorted(self._living.track, track)
        known = np.isin(track, self._living.track, assume_unique=True)
        if known.any():
            self._align(frame, picture, observation[known], row[known])
        first = observation[observation == self._tracks.offsets[track]]
        self._keep[first] = True
        self._living = self._living.joined(self._anchored(frame, picture, first))

    def _align(
        self,
        frame: int,
        picture: NDArray[np.uint8],
        observation: NDArray[np.int64],
        row: NDArray[np.int64],
    ) -> None:
        living, options = self._living, self._options
        guess = self._codec[observation] + living.correction[row]
        # Over a gap in a track the patch is taken to stay as it was.
        follows = self._tracks.frame[living.observation[row]] == frame - 1
        steps = local_deformation(living.xy[row[follows]], guess[follows], options.num_neighbors)
        living.deformation[row[follows]] = steps @ living.deformation[row[follows]]

        found = np.empty(len(row), np.bool_)
        xy = guess.copy()
        for start in range(0, len(row), _AT_ONCE):
            part = slice(start, start + _AT_ONCE)
            alignment = self._find(picture, row[part], guess[part])
            found[part] = alignment.found
            xy[part][alignment.found] = alignment.xy[alignment.found]
        self._refined[observation] = xy
        self._keep[observation] |= found
        living.observation[row], living.xy[row] = observation, xy
        living.correction[row] = xy - self._codec[observation]
        self._renew(frame, picture, row)
        if options.unaligned == "end":
            lost = np.zeros(len(living.track), np.bool_)
            lost[row[~found]] = True
            self._living = living.select(~lost)

    def _find(
        self, picture: NDArray[np.uint8], row: NDArray[np.int64], guess: NDArray[np.float64]
    ) -> Alignment:
        living, options = self._living, self._options
        half = options.window // 2 + math.ceil(options.max_move) + 2
        patches = deform_patches(
            living.patch[row], living.offset[row], living.deformation[row], half
        )
        return align_patches(patches, picture, guess, options)

    def _renew(self, frame: int, picture: NDArray[np.uint8], row: NDArray[np.int64]) -> None:
        """Take new anchors from this picture where the old ones are old or look different."""
        living, options = self._living, self._options
        scale = np.sqrt(np.abs(np.linalg.det(living.deformation[row])))
        due = frame - living.anchor_frame[row] >= options.anchor_age
        due |= np.maximum(scale, 1 / np.maximum(scale, 1e-9)) > options.anchor_scale
        row = row[due]
        pixel, living.offset[row] = split(living.xy[row])
        living.patch[row] = cut_patches(picture, pixel, _ANCHOR_HALF)
        living.deformation[row] = np.eye(2)
        living.anchor_frame[row] = frame

    def _anchored(
        self, frame: int, picture: NDArray[np.uint8], observation: NDArray[np.int64]
    ) -> _Living:
        """Return tracks that start in a frame, at the codec's position."""
        xy = self._codec[observation]
        pixel, offset = split(xy)
        return _Living(
            track=self._tracks.track_index[observation],
            observation=observation,
            xy=xy,
            correction=np.zeros_like(xy),
            anchor_frame=np.full(len(xy), frame, np.int32),
            patch=cut_patches(picture, pixel, _ANCHOR_HALF),
            offset=offset,
            deformation=np.tile(np.eye(2), (len(xy), 1, 1)),
        )

    def result(self) -> Tracks:
        """Return the tracks as far as they were aligned."""
        tracks, keep = self._tracks, self._keep
        length = np.bincount(tracks.track_index[keep], minlength=len(tracks))
        keep &= np.repeat(length > 1, tracks.lengths)
        length = length[length > 1]
        return dataclasses.replace(
            tracks,
            offsets=np.concatenate(([0], np.cumsum(length))).astype(np.int64),
            frame=tracks.frame[keep],
            xy=self._refined[keep],
        )
