"""Which matches of tracks are right: few pairs are estimated, tracks carry the verdict to the rest.

A track that keeps to the camera's motion over ten frames also does in between. So a few pairs per
frame get an essential matrix, near ones and far ones, and every match of these is tested. A test
covers the steps of a track from one frame to the other; what the farthest tests say about a step is
its verdict, and the matches of all other pairs are judged by their steps.
(docs/decisions/0009-tracks-carry-the-verdict.md)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from mvmatch.geometry.two_view import RansacOptions, fit_pair
from mvmatch.pairing import seen_in, shared

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.geometry.two_view import PairGeometry
    from mvmatch.types import Tracks

    Pair = tuple[int, int, NDArray[np.uint32]]

MIN_SEEN = 0.5
"""A pair that shares fewer than this share of its matches with the estimated ones is estimated."""

_FRAMES = 64
"""Frames whose pairs are judged together, at least: bounds the memory."""


@dataclass(frozen=True, kw_only=True)
class VerificationOptions:
    """How matches become the two-view geometries that the mapper reads."""

    mode: Literal["all", "sampled", "tracks", "trust"] = "tracks"
    """``all`` estimates every pair on every match; ``sampled`` every pair on ``max_sample``, and
    tests every match; ``tracks`` does so for the pairs that ``gaps`` names, and their verdict goes
    along the tracks to the other pairs; ``trust`` passes every match on untested."""
    max_sample: int = 200
    """Matches per pair that an estimation sees in modes ``sampled`` and ``tracks``."""
    gaps: tuple[int, ...] = (2, 5, 10)
    """Frames, rising; mode ``tracks`` estimates, for every frame, the pairs nearest to these gaps,
    and to the doubles of the last one where matches reach that far. Short ones reach short tracks;
    long ones see drift and moving objects, and have the parallax that mapping starts from."""
    ransac: RansacOptions = field(default_factory=RansacOptions)

    def __post_init__(self) -> None:
        if not self.gaps or self.gaps[0] < 1 or np.any(np.diff(self.gaps) <= 0):
            message = f"gaps is {self.gaps}; it must rise from at least 1"
            raise ValueError(message)


@dataclass(frozen=True, kw_only=True, eq=False)
class VerifiedPair:
    """The matches of one frame pair and what was found about them."""

    frame0: int
    frame1: int
    matches: NDArray[np.uint32]
    """(M, 2) keypoint numbers."""
    inliers: NDArray[np.bool_]
    """(M,) matches that are taken for right; none where the pair failed."""
    fit: PairGeometry | None
    """The pair's own estimation; None when it was judged without one."""


def verify_tracks(
    tracks: Tracks,
    camera: pycolmap.Camera,
    *,
    options: VerificationOptions | None = None,
    max_gap: int | None = None,
) -> Iterator[VerifiedPair]:
    """Judge the matches of all frame pairs that share tracks.

    Parameters
    ----------
    tracks : Tracks
        Observations in px, COLMAP origin.
    camera : pycolmap.Camera
        The one camera of the video.
    options : VerificationOptions, optional
        What is estimated.
    max_gap : int, optional
        Pairs further apart are left out.

    Yields
    ------
    VerifiedPair
        In rising order of the frames.
    """
    options = options or VerificationOptions()
    reach = tracks.reach(max_gap)
    if options.mode == "tracks":
        yield from _by_tracks(tracks, camera, options, reach)
        return
    for start in range(0, tracks.num_frames, _FRAMES):
        near = tracks.during(start, start + _FRAMES + reach)
        for pair in near.pairs(reach, start=start, end=start + _FRAMES):
            fit = None
            inliers = np.ones(len(pair[2]), np.bool_)
            if options.mode != "trust":
                fit = _estimate(near, pair, camera, options)
                inliers = fit.inliers
            yield _verified(pair, inliers, fit)


def verify_pairs(
    tracks: Tracks,
    frames: Collection[tuple[int, int]],
    camera: pycolmap.Camera,
    *,
    options: VerificationOptions | None = None,
) -> Iterator[VerifiedPair]:
    """Judge the matches of single frame pairs, each by a geometry of its own.

    Parameters
    ----------
    tracks : Tracks
        Observations in px, COLMAP origin.
    frames : collection of (int, int)
        Pairs, the earlier frame first; those that share no track are left out.
    camera : pycolmap.Camera
        The one camera of the video.
    options : VerificationOptions, optional
        Of the estimation; mode ``trust`` estimates nothing.

    Yields
    ------
    VerifiedPair
        In rising order of the frames.
    """
    options = options or VerificationOptions()
    near = seen_in(tracks, {frame for pair in frames for frame in pair})
    for frame0, frame1 in sorted(frames):
        pair = frame0, frame1, shared(near, frame0, frame1)
        if len(pair[2]) == 0:
            continue
        if options.mode == "trust":
            yield _verified(pair, np.ones(len(pair[2]), np.bool_), None)
        else:
            fit = _estimate(near, pair, camera, options)
            yield _verified(pair, fit.inliers, fit)


def _verified(pair: Pair, inliers: NDArray[np.bool_], fit: PairGeometry | None) -> VerifiedPair:
    frame0, frame1, matches = pair
    return VerifiedPair(frame0=frame0, frame1=frame1, matches=matches, inliers=inliers, fit=fit)


def _by_tracks(
    tracks: Tracks, camera: pycolmap.Camera, options: VerificationOptions, reach: int
) -> Iterator[VerifiedPair]:
    """Judge the pairs of so many frames at a time.

    A verdict depends on the estimated pairs that overlap with it, up to ``reach`` frames away, and
    whether these are estimated on others as far away again.
    """
    judge = _Judge(camera, options, _extended(options.gaps, reach))
    pairs: list[Pair] = []
    num_frames = max(_FRAMES, reach)
    paired = 0
    for start in range(0, tracks.num_frames, num_frames):
        end = start + num_frames
        near = tracks.during(start - reach, end + 3 * reach)
        pairs = [pair for pair in pairs if pair[0] >= start - reach]
        pairs += near.pairs(reach, start=paired, end=end + 2 * reach)
        paired = end + 2 * reach
        judge.estimate(near, pairs, end=end + reach)
        yield from judge.verdicts(near, [pair for pair in pairs if start <= pair[0] < end])
        judge.forget(end - reach)


class _Judge:
    """Estimates a few pairs, keeps what was found as long as it counts, and judges the others."""

    def __init__(
        self, camera: pycolmap.Camera, options: VerificationOptions, gaps: NDArray[np.int64]
    ) -> None:
        self._camera, self._options, self._gaps = camera, options, gaps
        self._fits: dict[tuple[int, int], PairGeometry] = {}
        self._decided = 0
        self._wrong = np.zeros(0, np.int64)

    def estimate(self, near: Tracks, pairs: Sequence[Pair], *, end: int) -> None:
        """Estimate what is missing of the pairs that start before the frame ``end``."""
        verdicts = StepVerdicts(near.num_observations, len(self._gaps))
        chosen = nearest_pairs(pairs, self._gaps)
        self._add(verdicts, near, chosen)
        # Where tracks have holes, a pair may share hardly a step with those estimated.
        unseen = _sums(~verdicts.seen())
        names = {pair[:2] for pair in chosen}
        others = [pair for pair in pairs if pair[:2] not in names and pair[0] < end]
        self._add(verdicts, near, [pair for pair in others if self._is_due(near, pair, unseen)])
        self._decided = end
        self._wrong = _sums(~verdicts.right())

    def verdicts(self, near: Tracks, pairs: Iterable[Pair]) -> Iterator[VerifiedPair]:
        """Judge pairs after they and those around them were estimated or passed over."""
        for pair in pairs:
            fit = self._fits.get(pair[:2])
            if fit is None:
                inliers = _clear(self._wrong, *_observations(near, pair))
                enough = np.count_nonzero(inliers) >= self._options.ransac.min_num_inliers
            else:
                inliers, enough = fit.inliers, _is_believed(fit, self._options)
            if not enough:
                inliers = np.zeros(len(pair[2]), np.bool_)
            yield _verified(pair, inliers, fit)

    def forget(self, frame: int) -> None:
        """Drop the estimates of pairs that start before a frame."""
        self._fits = {name: fit for name, fit in self._fits.items() if name[0] >= frame}

    def _is_due(self, near: Tracks, pair: Pair, unseen: NDArray[np.int64]) -> bool:
        if pair[0] < self._decided:
            return pair[:2] in self._fits
        return bool(_clear(unseen, *_observations(near, pair)).mean() < MIN_SEEN)

    def _add(self, verdicts: StepVerdicts, near: Tracks, pairs: Iterable[Pair]) -> None:
        """Take note of estimated pairs; estimate those that are not yet."""
        for pair in pairs:
            fit = self._fits.get(pair[:2])
            if fit is None:
                fit = self._fits[pair[:2]] = _estimate(near, pair, self._camera, self._options)
            level = int(np.argmin(np.abs(self._gaps - (pair[1] - pair[0]))))
            inliers = fit.inliers if _is_believed(fit, self._options) else None
            verdicts.add(*_observations(near, pair), level=level, inliers=inliers)


def _estimate(
    tracks: Tracks, pair: Pair, camera: pycolmap.Camera, options: VerificationOptions
) -> PairGeometry:
    first, second = _observations(tracks, pair)
    return fit_pair(
        tracks.xy[first],
        tracks.xy[second],
        camera,
        camera,
        frames=pair[:2],
        options=options.ransac,
        max_sample=None if options.mode == "all" else options.max_sample,
    )


def _is_believed(fit: PairGeometry, options: VerificationOptions) -> bool:
    """Whether so many matches follow the geometry that RANSAC's trials were enough to find it."""
    return fit.score.inlier_ratio >= options.ransac.min_inlier_ratio


def nearest_pairs(pairs: Iterable[Pair], gaps: NDArray[np.int64]) -> list[Pair]:
    """Choose, for every first frame, the pairs whose gaps come nearest to the given ones."""
    of_frame: dict[int, list[Pair]] = {}
    for pair in pairs:
        of_frame.setdefault(pair[0], []).append(pair)
    chosen: list[Pair] = []
    for frame, candidates in of_frame.items():
        distance = np.array([pair[1] - frame for pair in candidates])
        best = np.unique(np.argmin(np.abs(distance - gaps[:, None]), axis=1))
        chosen += [candidates[index] for index in best]
    return chosen


class StepVerdicts:
    """What estimated pairs say about the steps of tracks from one observation to the next.

    A step has the number of the observation it starts from. A match of an estimated pair covers the
    steps between its two observations. It says that they are right, or that one of them is wrong
    without telling which: so a step is wrong when no match that covers it is right. Far pairs
    outvote near ones, in which a moving object or slow drift goes unnoticed.

    Parameters
    ----------
    num_observations : int
        Of all tracks.
    num_levels : int
        Ranks of gaps.

    Examples
    --------
    Two tracks of three observations, the second one wrong over two steps:

    >>> verdicts = StepVerdicts(6, 1)
    >>> first, second = np.array([0, 3]), np.array([2, 5])
    >>> verdicts.add(first, second, level=0, inliers=np.array([True, False]))
    >>> verdicts.right().tolist()
    [True, True, False, False, False, False]
    """

    def __init__(self, num_observations: int, num_levels: int) -> None:
        self._seen = np.zeros(num_observations, np.int32)
        self._tested = np.zeros((num_levels, num_observations), np.int32)
        self._passed = np.zeros((num_levels, num_observations), np.int32)

    def add(
        self,
        first: NDArray[np.int64],
        second: NDArray[np.int64],
        *,
        level: int,
        inliers: NDArray[np.bool_] | None,
    ) -> None:
        """Take note of an estimated pair.

        Parameters
        ----------
        first, second : (M,) int
            Observations of its matches in the earlier and in the later frame.
        level : int
            Rank of the pair's gap; a higher one outvotes lower ones.
        inliers : (M,) bool or None
            Matches that agree with the pair's geometry; None if there is none to be believed: that
            says nothing about single matches.
        """
        _cover(self._seen, first, second)
        if inliers is not None:
            _cover(self._tested[level], first, second)
            _cover(self._passed[level], first[inliers], second[inliers])

    def seen(self) -> NDArray[np.bool_]:
        """Mark the steps that some estimated pair covers, with whatever result."""
        return np.cumsum(self._seen) > 0

    def right(self) -> NDArray[np.bool_]:
        """Mark the steps that are right; one that nobody tested is not."""
        right = np.zeros(len(self._seen), np.bool_)
        for tested, passed in zip(self._tested, self._passed, strict=True):
            right = np.where(np.cumsum(tested) > 0, np.cumsum(passed) > 0, right)
        return right


def _cover(change: NDArray[np.int32], first: NDArray[np.int64], second: NDArray[np.int64]) -> None:
    """Count one more cover of the steps from ``first`` to ``second``, kept as differences."""
    change[first] += 1
    change[second] -= 1


def _observations(tracks: Tracks, pair: Pair) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(M,) observations of a pair's matches in its two frames."""
    frame0, frame1, matches = pair
    first, second = tracks.observations(frame0), tracks.observations(frame1)
    return first[matches[:, 0]], second[matches[:, 1]]


def _sums(marks: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(O + 1,) number of marks before each observation."""
    return np.concatenate(([0], np.cumsum(marks))).astype(np.int64)


def _clear(
    sums: NDArray[np.int64], first: NDArray[np.int64], second: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Tell where no step from ``first`` to ``second`` is marked."""
    return sums[second] == sums[first]


def _extended(gaps: Sequence[int], largest: int) -> NDArray[np.int64]:
    """Return the gaps, and doubles of the last one up to the largest gap there is."""
    found = list(gaps)
    while found[-1] * 2 <= largest:
        found.append(found[-1] * 2)
    return np.array(found, np.int64)
