"""Which tracks move by themselves: consistency with the motion of the camera.

In a pair of frames, a point at rest lies on one side of the epipolar line: on the half line that
begins where the point would be at infinity and leads, as the point comes nearer, to the epipole.
The distance to it sees both what moves across epipolar lines and what moves along them the wrong
way (points behind the camera). What moves along them the right way looks like a nearer point and is
not found: with two views nothing tells it apart.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.geometry.two_view import PairGeometry, RansacOptions, fit_pair
from mvmatch.rows import during

if TYPE_CHECKING:
    from collections.abc import Iterator

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.types import Tracks

    _Floats = NDArray[np.float64]

_MAD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""

_PAIRS = 32
"""Frame pairs whose tracks are sought at once."""


@dataclass(frozen=True, kw_only=True)
class MoverOptions:
    """What counts as a moving object."""

    exclude: bool = True
    """Keep the tracks of moving objects out of the database."""
    min_weight: float = 0.5
    """Tracks of less weight are on moving objects."""
    gaps: tuple[int, ...] = (2, 5)
    """Frames between the pictures of the pairs: the short one reaches every track of three frames,
    the long one sees slow movers."""
    cell: int = 32
    """px; side of the cells that give one match each to the estimation of the camera motion, so
    that area counts: encoders spend many small blocks on what moves."""
    max_error: float = 1.5
    """px; inlier bound of the camera motion. Wider, movers take part in it."""
    max_sample: int = 300
    """Matches of a pair that the camera motion is estimated on."""
    min_distance: float = 1.5
    """px; what is nearer to where a point at rest can be is at rest."""
    noise_factor: float = 3.0
    """The same, in standard deviations of the pair's noise, taken from its median."""
    neighborhood: int = 48
    """px; side of the square in which neighbours must agree, in multiples of 3."""
    min_support: float = 0.4
    """Share of the tracks around that must be inconsistent as well: a single one is an error of
    the track, not an object."""
    max_stretch: float = 0.005
    """A camera that moves by less than this share of the distance to the scene only turns."""

    def __post_init__(self) -> None:
        if not self.gaps or min(self.gaps) < 1:
            message = f"gaps are {self.gaps}; they must be at least one number of frames above 0"
            raise ValueError(message)
        if self.neighborhood < 3:
            message = f"neighborhood is {self.neighborhood}; it must be at least 3"
            raise ValueError(message)


def track_weights(
    tracks: Tracks, camera: pycolmap.Camera, *, options: MoverOptions | None = None
) -> NDArray[np.float64]:
    """Judge every track by the camera motion of several frame pairs.

    Parameters
    ----------
    tracks : Tracks
        Observations in px, without static overlays.
    camera : pycolmap.Camera
        The camera of all frames; a focal length that is off by some per cent does not matter.
    options : MoverOptions, optional
        Pairs and bounds.

    Returns
    -------
    (T,) float64
        Share of the tested pairs in which the track keeps to the motion of the camera: 1 for a
        point at rest, 0 for a moving object; 1 for a track that no pair tests.
    """
    options = options or MoverOptions()
    tested = np.zeros(len(tracks), np.int64)
    moved = np.zeros(len(tracks), np.int64)
    for gap in options.gaps:
        for frame, track, xy0, xy1 in _matches(tracks, gap):
            pair = _Pair(xy0=xy0, xy1=xy1, even=_even(xy0, options), camera=camera)
            distance = _distance_from_rest(pair, (frame, frame + gap), options)
            if distance is None:
                continue
            noise = options.noise_factor * _MAD * float(np.median(distance[pair.even]))
            moves = distance > max(options.min_distance, noise)
            tested[track] += 1
            moved[track] += moves & (_support(xy0, moves, options) >= options.min_support)
    return 1.0 - moved / np.maximum(tested, 1)


def half_line_distance(
    xy0: _Floats, xy1: _Floats, camera: pycolmap.Camera, cam1_from_cam0: _Floats
) -> _Floats:
    """Distance of points to where points at rest ahead of the camera can be.

    Parameters
    ----------
    xy0, xy1 : (N, 2) float
        Corresponding points in px.
    camera : pycolmap.Camera
        Of both views.
    cam1_from_cam0 : (3, 4) float
        Rotation, and translation at any scale; with a translation of zero, the distance to the
        point at infinity.

    Returns
    -------
    (N,) float64
        px, at the mean focal length; infinite for points that turn out of sight.
    """
    R, t = cam1_from_cam0[:, :3], cam1_from_cam0[:, 3]
    rays = np.column_stack([_normalized(camera, xy0), np.ones(len(xy0))]) @ R.T
    ahead = rays[:, 2] > 1e-6
    infinity = rays[:, :2] / np.where(ahead, rays[:, 2], 1.0)[:, None]
    offset = _normalized(camera, xy1) - infinity
    # With inverse depth s >= 0 the point lies at (rays + s t); this is where it starts to go.
    direction = t[:2] - infinity * t[2]
    length = np.linalg.norm(direction, axis=1)
    direction /= np.maximum(length, 1e-12)[:, None]
    along = np.maximum(np.sum(offset * direction, axis=1), 0.0)
    distance = np.linalg.norm(offset - along[:, None] * direction, axis=1)
    return np.where(ahead, camera.mean_focal_length() * distance, np.inf)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pair:
    """Matches of a frame pair."""

    xy0: _Floats
    """(N, 2) px."""
    xy1: _Floats
    """(N, 2) px."""
    even: NDArray[np.int64]
    """Some of the matches, spread evenly: they stand for the area of the picture."""
    camera: pycolmap.Camera

    def half_line_distance(self, rotation: _Floats, translation: _Floats) -> _Floats:
        pose = np.column_stack([rotation, translation])
        return half_line_distance(self.xy0, self.xy1, self.camera, pose)


def _distance_from_rest(
    pair: _Pair, frames: tuple[int, int], options: MoverOptions
) -> _Floats | None:
    """(N,) px; None where the camera motion is unknown."""
    fit = fit_pair(
        pair.xy0[pair.even],
        pair.xy1[pair.even],
        pair.camera,
        pair.camera,
        frames=frames,
        options=RansacOptions(max_error=options.max_error),
        max_sample=options.max_sample,
    )
    moving = None
    if fit.cam1_from_cam0 is not None:
        pose = np.asarray(fit.cam1_from_cam0.matrix(), np.float64)
        moving = pair.half_line_distance(pose[:, :3], pose[:, 3])
    turning = _distance_from_infinity(pair, fit, options)
    if turning is None or moving is None:
        return moving if turning is None else turning
    flow = np.linalg.norm(pair.xy1 - pair.xy0, axis=1)
    if np.median(flow[pair.even]) < options.max_error / 5:
        return turning  # the camera stands
    # A camera that turns may move as well, before a distant background: near things are at rest if
    # they are many and one translation explains them.
    off = pair.even[turning[pair.even] > options.max_error]
    many = len(off) > 0.1 * len(pair.even)
    return moving if many and np.mean(moving[off] <= options.max_error) > 0.9 else turning


def _distance_from_infinity(
    pair: _Pair, fit: PairGeometry, options: MoverOptions
) -> _Floats | None:
    """(N,) px from a mere rotation; None where a rotation does not explain most of the picture."""
    if fit.H is None:
        return None
    K = np.asarray(pair.camera.calibration_matrix(), np.float64)
    left, singular, right = np.linalg.svd(np.linalg.inv(K) @ fit.H @ K)
    if not singular[0] < (1.0 + options.max_stretch) * singular[2]:
        return None
    rotation = left @ right
    rotation *= np.sign(np.linalg.det(rotation))
    distance = pair.half_line_distance(rotation, np.zeros(3))
    return distance if np.mean(distance[pair.even] <= options.max_error) > 0.5 else None


def _even(xy: _Floats, options: MoverOptions) -> NDArray[np.int64]:
    """One match per cell."""
    cell = np.floor(xy / options.cell).astype(np.int64)
    return np.unique(cell, axis=0, return_index=True)[1].astype(np.int64)


def _support(xy: _Floats, moves: NDArray[np.bool_], options: MoverOptions) -> _Floats:
    """(N,) share of the tracks around each that move; two more that do not are added."""
    column, row = np.maximum(xy // (options.neighborhood / 3), 0).astype(np.int64).T + 1
    width, height = int(column.max()) + 2, int(row.max()) + 2
    cell = row * width + column
    around = np.array([dy * width + dx for dy in (-1, 0, 1) for dx in (-1, 0, 1)])
    count, moving = (
        np.bincount(cell, weights=weights, minlength=width * height)[cell[:, None] + around]
        for weights in (None, moves)
    )
    return moving.sum(axis=1) / (count.sum(axis=1) + 2.0)


def _matches(tracks: Tracks, gap: int) -> Iterator[tuple[int, NDArray[np.int64], _Floats, _Floats]]:
    """Yield the first frame of each pair, and its matches as :func:`_matched` does."""
    # Pairs of a long gap overlap: every second or third of them tests the same tracks.
    frames = range(0, tracks.num_frames - gap, max(1, gap // 2))
    for at in range(0, len(frames), _PAIRS):
        some = frames[at : at + _PAIRS]
        numbers, near = during(tracks, some[0], some[-1] + gap + 1)
        for frame in some:
            track, xy0, xy1 = _matched(near, frame, frame + gap)
            yield frame, numbers[track], xy0, xy1


def _matched(
    tracks: Tracks, frame0: int, frame1: int
) -> tuple[NDArray[np.int64], _Floats, _Floats]:
    """(N,) tracks seen in both frames and their points there, (N, 2) px."""
    first, second = tracks.observations(frame0), tracks.observations(frame1)
    track, in_first, in_second = np.intersect1d(
        tracks.track_index[first],
        tracks.track_index[second],
        assume_unique=True,
        return_indices=True,
    )
    xy0, xy1 = tracks.xy[first[in_first]], tracks.xy[second[in_second]]
    return track, xy0.astype(np.float64), xy1.astype(np.float64)


def _normalized(camera: pycolmap.Camera, xy: _Floats) -> _Floats:
    return np.asarray(camera.cam_from_img(xy), np.float64).reshape(-1, 2)
