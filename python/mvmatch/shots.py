"""Scene cuts and repeated pictures: where a video jumps, and where it only seems to go on.

A cut that the encoder codes as an inter frame leaves a few vectors between pictures of different
places. A picture shown twice, as conversions from 24 to 30 frames per second do, has a partner at
zero distance that tells a mapper nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.types import Tracks

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from mvmatch.cells import FieldCells
    from mvmatch.overlays import Overlays
    from mvmatch.types import MotionField

_NEAR = 5
"""Boundaries on each side that say what is usual."""


@dataclass(frozen=True, kw_only=True)
class ShotOptions:
    """What counts as a cut and as a repeated picture."""

    jump_share: float | None = 0.5
    """A video jumps where less than this share of the usual area is predicted across; None: cuts
    and jumps are not looked for. Measured: above 0.8 in continuous motion."""
    cut_share: float = 0.15
    """Below this share the jump is a cut, and tracks end. Measured: 0 to 0.14, once 0.22, between
    different scenes; 0.2 to 0.4 where a piece of one scene is missing, and there 95 to 99 % of
    the tracks across agree with one camera motion: they hold the model together."""
    repeat_share: float | None = 0.9
    """Share of the tracks that stand still at a picture shown again; None: repeated pictures are
    not looked for."""
    still: float = 0.25
    """px; a track stands still when it moves less. Vectors are multiples of 1/8 px."""
    max_repeats: int = 3
    """Times a picture is shown again at most: what stands still longer is a camera at rest."""


class CutFinder:
    """Measures how much of the picture is predicted across every boundary between two pictures.

    A boundary ``k`` lies before picture ``k``. Feed every field with :meth:`add`. The best field
    counts: around a flash of light the picture after it still refers to the one before. Boundaries
    at key frames have no vectors that could tell, and are never cuts: tracks end there anyway.
    """

    def __init__(self, options: ShotOptions | None = None) -> None:
        self._options = options or ShotOptions()
        self._crossing: dict[int, float] = {}
        self._key_frames: set[int] = set()

    def add(self, field: MotionField, cells: FieldCells) -> None:
        """Count one field, given on the grid as well."""
        if field.is_key:
            self._key_frames.add(field.frame)
            return
        # A cell that reaches back d frames crosses the boundaries frame - d + 1 to frame.
        for far, first, step in (
            (cells.past, field.frame, -1),
            (cells.future, field.frame + 1, 1),
        ):
            reach = np.bincount(far.reshape(-1))[1:]
            share = np.cumsum(reach[::-1])[::-1] / far.size
            for count, value in enumerate(share.tolist()):
                boundary = first + step * count
                self._crossing[boundary] = max(value, self._crossing.get(boundary, 0.0))
        self._crossing.setdefault(field.frame, 0.0)

    def cuts(self, overlays: Overlays | None = None) -> tuple[int, ...]:
        """Return the first pictures of new shots, rising.

        Parameters
        ----------
        overlays : Overlays, optional
            Static overlays, which go on through cuts and do not count.
        """
        return self._below(self._options.cut_share, overlays)

    def jumps(self, overlays: Overlays | None = None) -> tuple[int, ...]:
        """Return the pictures before which the video jumps but goes on in the same scene."""
        found = self._below(self._options.jump_share or 0.0, overlays)
        return tuple(sorted({*found} - {*self.cuts(overlays)}))

    def _below(self, least: float, overlays: Overlays | None) -> tuple[int, ...]:
        """Boundaries with less than a share of the usual area predicted across."""
        if self._options.jump_share is None:
            return ()
        known = np.array(sorted(set(self._crossing) - self._key_frames - {0}), np.int64)
        share = np.array([self._crossing[boundary] for boundary in known.tolist()])
        if overlays is not None:
            covered = np.array([overlays.at(boundary).mean() for boundary in known.tolist()])
            share = np.maximum(share - covered, 0.0) / np.maximum(1.0 - covered, 1e-6)
        found: list[int] = []
        for index, boundary in enumerate(known.tolist()):
            before, after = share[max(0, index - _NEAR) : index], share[index + 1 :][:_NEAR]
            near = np.concatenate([before, after])
            if share[index] >= least * near.max(initial=0.0):
                continue  # as nearly all are, told without sorting
            if share[index] < least * np.median(near):
                found.append(boundary)
        return tuple(found)


def find_repeats(tracks: Tracks, options: ShotOptions | None = None) -> tuple[int, ...]:
    """Find pictures that show the one before them again.

    Parameters
    ----------
    tracks : Tracks
        Without static overlays, which stand still at every picture.
    options : ShotOptions, optional
        What counts.

    Returns
    -------
    tuple of int
        Pictures, rising. Nearly all tracks stand still between each and the picture before, and
        most move before or after that: a camera at rest repeats nothing.
    """
    options = options or ShotOptions()
    if options.repeat_share is None or tracks.num_observations == 0:
        return ()
    still, count = np.zeros((2, tracks.num_frames + 1), np.int64)
    for part in tracks.parts():
        follows = (np.diff(part.track_index) == 0) & (np.diff(part.frame) == 1)
        moved = np.linalg.norm(np.diff(part.xy, axis=0)[follows], axis=1)
        frame = part.frame[1:][follows]
        count += np.bincount(frame, minlength=len(count))
        still += np.bincount(frame[moved < options.still], minlength=len(count))
    share = np.divide(still, count, out=np.full(len(count), np.nan), where=count > 0)
    repeated = share >= options.repeat_share
    moving = share < 0.5
    # A run of still boundaries counts between moving ones; the clip's ends may be missing.
    edges = np.flatnonzero(np.diff(np.concatenate(([False], repeated, [False]))))
    found: list[int] = []
    for first, end in edges.reshape(-1, 2).tolist():
        sides = [side for side in (first - 1, end) if 0 < side < tracks.num_frames]
        if end - first <= options.max_repeats and sides and all(moving[side] for side in sides):
            found.extend(range(first, end))
    return tuple(found)


def end_tracks(
    tracks: Tracks,
    *,
    cuts: Iterable[int] = (),
    drop: NDArray[np.bool_] | None = None,
    min_length: int = 2,
) -> Tracks:
    """End tracks at cuts and at observations that are taken out; what follows is a new track.

    Parameters
    ----------
    tracks : Tracks
        Any tracks.
    cuts : iterable of int
        First pictures of new shots.
    drop : (O,) bool, optional
        Observations that are removed.
    min_length : int
        Observations; shorter remains of a track are removed. Untouched tracks are kept.

    Returns
    -------
    Tracks
        A subset of the observations, in the same order.
    """
    shot = np.searchsorted(np.sort(np.fromiter(cuts, np.int64)), tracks.frame, side="right")
    dropped = np.zeros(len(shot), np.bool_) if drop is None else drop
    starts = np.ones(len(shot), np.bool_)
    starts[1:] = (
        (np.diff(tracks.track_index) != 0) | (np.diff(shot) != 0) | (dropped[1:] != dropped[:-1])
    )
    part = np.cumsum(starts) - 1
    length = np.bincount(part)
    whole = length == tracks.lengths[tracks.track_index[starts]]
    kept = (whole | (length >= min_length)) & ~dropped[starts]
    return Tracks(
        offsets=np.concatenate(([0], np.cumsum(length[kept]))).astype(np.int64),
        frame=tracks.frame[kept[part]],
        xy=tracks.xy[kept[part]],
    )
