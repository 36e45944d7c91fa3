"""Point matches of a whole sequence, whatever made them, and their resampling."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from mvmatch.export.colmap import (
    calibrated_geometry,
    new_database,
    write_database,
    write_images,
)
from mvmatch.export.verification import VerificationOptions
from mvmatch.geometry.two_view import fit_pair
from mvmatch.sfm import densify
from mvmatch.types import Correspondences, Tracks

if TYPE_CHECKING:
    from collections.abc import Sequence as Many
    from pathlib import Path

    import pycolmap
    from numpy.typing import NDArray


MAX_GAP = 10
"""Frames; pairs further apart are not matched, for any method."""

VERIFICATION = VerificationOptions(mode="sampled", max_sample=1000)
"""Of every method's matches before mapping."""


class Matches(Protocol):
    """Matches of any two frames of a sequence."""

    def between(self, frame0: int, frame1: int) -> Correspondences:
        """Points seen in both frames."""
        ...

    def kept(self, frame0: int, frame1: int, *, share: float, seed: int) -> NDArray[np.bool_]:
        """Mark the correspondences of ``between`` that survive when a share of the points is kept.

        One seed is one draw: what is dropped is dropped in every pair.
        """
        ...

    def lengths(self) -> NDArray[np.int64] | None:
        """Observations of each track; None for matches that were never joined to tracks."""
        ...

    def write(
        self,
        path: Path,
        camera: pycolmap.Camera,
        names: Many[str],
        *,
        sample: Sample | None,
        verification: VerificationOptions = VERIFICATION,
    ) -> None:
        """Write a COLMAP database with the same verification for every method."""
        ...

    def densify(self, model: pycolmap.Reconstruction, *, sample: Sample | None) -> None:
        """Add the points that a method leaves to the time after mapping, if it does."""
        ...


@dataclass(frozen=True, kw_only=True)
class Sample:
    """One draw of a resampling."""

    share: float
    """Of the points (keypoints or whole tracks) that are kept."""
    seed: int


@dataclass(frozen=True, eq=False)
class TrackMatches:
    """Matches of tracks; whole tracks are dropped."""

    tracks: Tracks
    further: Tracks | None = None
    """Tracks that only make a model denser."""

    def between(self, frame0: int, frame1: int) -> Correspondences:
        """Points of tracks seen in both frames, ordered by track."""
        return self.tracks.between(frame0, frame1)

    def kept(self, frame0: int, frame1: int, *, share: float, seed: int) -> NDArray[np.bool_]:
        """Mark the correspondences whose track is kept."""
        index = self.tracks.track_index
        first, second = (index[self.tracks.observations(frame)] for frame in (frame0, frame1))
        common = np.intersect1d(first, second, assume_unique=True)
        return drawn(len(self.tracks), share, seed)[common]

    def lengths(self) -> NDArray[np.int64]:
        """Observations of each track."""
        return self.tracks.lengths

    def write(
        self,
        path: Path,
        camera: pycolmap.Camera,
        names: Many[str],
        *,
        sample: Sample | None,
        verification: VerificationOptions = VERIFICATION,
    ) -> None:
        """Write a COLMAP database."""
        write_database(
            sampled(self.tracks, sample), path, camera=camera, image_names=names,
            verification=verification, max_gap=MAX_GAP,
            further=None if self.further is None else sampled(self.further, sample),
        )  # fmt: skip

    def densify(self, model: pycolmap.Reconstruction, *, sample: Sample | None) -> None:
        """Triangulate the further tracks with the poses of the model."""
        if self.further is not None:
            parts = (sampled(tracks, sample) for tracks in (self.tracks, self.further))
            densify(model, Tracks.concatenate(*parts))


@dataclass(frozen=True, kw_only=True, eq=False)
class KeypointMatches:
    """Keypoints of every frame and the matches of frame pairs; keypoints are dropped."""

    keypoints: tuple[NDArray[np.float32], ...]
    """(K, 2) px, one array per frame."""
    matches: dict[tuple[int, int], NDArray[np.uint32]]
    """(M, 2) keypoint numbers per pair of frames, the earlier frame first."""

    @classmethod
    def from_database(cls, path: Path, *, max_gap: int | None = MAX_GAP) -> KeypointMatches:
        """Read the matches of a COLMAP database as they were before verification.

        Parameters
        ----------
        path : Path
            The database.
        max_gap : int or None
            Pairs of frames further apart are left out; None takes all.
        """
        import pycolmap

        with pycolmap.Database.open(path) as database:
            images = sorted(database.read_all_images(), key=lambda image: image.name)
            frame_of = {image.image_id: frame for frame, image in enumerate(images)}
            keypoints = tuple(
                np.asarray(database.read_keypoints(image.image_id), np.float32)[:, :2]
                for image in images
            )
            matches: dict[tuple[int, int], NDArray[np.uint32]] = {}
            for pair_id, count in zip(*database.read_num_matches(), strict=True):
                ids = pycolmap.pair_id_to_image_pair(pair_id)
                gap = abs(frame_of[ids[0]] - frame_of[ids[1]])
                if count and (max_gap is None or gap <= max_gap):
                    first, second = sorted(ids, key=frame_of.__getitem__)
                    found = np.asarray(database.read_matches(first, second), np.uint32)
                    matches[frame_of[first], frame_of[second]] = found
        return cls(keypoints=keypoints, matches=matches)

    def between(self, frame0: int, frame1: int) -> Correspondences:
        """Keypoints matched between two frames."""
        pairs = self._pairs(frame0, frame1)
        return Correspondences(
            frame0=frame0,
            frame1=frame1,
            xy0=self.keypoints[frame0][pairs[:, 0]],
            xy1=self.keypoints[frame1][pairs[:, 1]],
        )

    def kept(self, frame0: int, frame1: int, *, share: float, seed: int) -> NDArray[np.bool_]:
        """Mark the correspondences both of whose keypoints are kept."""
        pairs = self._pairs(frame0, frame1)
        first, second = (self._drawn(frame, share, seed) for frame in (frame0, frame1))
        return first[pairs[:, 0]] & second[pairs[:, 1]]

    def lengths(self) -> None:
        """Return None: these matches were never joined to tracks."""
        return

    def write(
        self,
        path: Path,
        camera: pycolmap.Camera,
        names: Many[str],
        *,
        sample: Sample | None,
        verification: VerificationOptions = VERIFICATION,
    ) -> None:
        """Write a COLMAP database."""
        with new_database(path) as database:
            write_images(database, camera, names)
            for frame, xy in enumerate(self.keypoints):
                # Dropped keypoints keep their number and lose their matches.
                database.write_keypoints(frame + 1, np.ascontiguousarray(xy))
            for (frame0, frame1), pairs in sorted(self.matches.items()):
                kept = slice(None)
                if sample is not None:
                    kept = self.kept(frame0, frame1, share=sample.share, seed=sample.seed)
                _write_pair(
                    database, (frame0, frame1), pairs[kept], self.keypoints,
                    camera=camera, options=verification,
                )  # fmt: skip

    def densify(self, model: pycolmap.Reconstruction, *, sample: Sample | None) -> None:
        """Add nothing: every keypoint was mapped."""

    def _pairs(self, frame0: int, frame1: int) -> NDArray[np.uint32]:
        return self.matches.get((frame0, frame1), np.empty((0, 2), np.uint32))

    def _drawn(self, frame: int, share: float, seed: int) -> NDArray[np.bool_]:
        return drawn(len(self.keypoints[frame]), share, seed, frame)


def sampled(tracks: Tracks, sample: Sample | None) -> Tracks:
    """Return the tracks that a draw keeps; all of them without one."""
    if sample is None:
        return tracks
    return tracks.select(drawn(len(tracks), sample.share, sample.seed))


def drawn(count: int, share: float, *seeds: int) -> NDArray[np.bool_]:
    """Mark a share of ``count`` things, exactly as many as it comes to."""
    marks = np.zeros(count, np.bool_)
    order = np.random.default_rng(seeds).permutation(count)
    marks[order[: round(share * count)]] = True
    return marks


def _write_pair(
    database: pycolmap.Database,
    frames: tuple[int, int],
    matches: NDArray[np.uint32],
    keypoints: Many[NDArray[np.float32]],
    *,
    camera: pycolmap.Camera,
    options: VerificationOptions,
) -> None:
    """Write and verify the matches of one pair, as ``write_database`` does for tracks."""
    if len(matches) == 0:
        return
    ids = frames[0] + 1, frames[1] + 1
    database.write_matches(*ids, matches)
    xy0, xy1 = (keypoints[frames[i]][matches[:, i]] for i in range(2))
    fit = fit_pair(
        xy0, xy1, camera, camera,
        frames=frames, options=options.ransac,
        max_sample=None if options.mode == "all" else options.max_sample,
    )  # fmt: skip
    if fit.score.model is not None:
        geometry = calibrated_geometry(matches[fit.inliers], fit)
        database.write_two_view_geometry(*ids, geometry)
