"""Tracks out of a COLMAP database, and a smaller database of some of its images.

Mapping reads nothing but a database. What it says about whole tracks, which key frames are chosen
by and further images are registered with, is put together here from the matches of image pairs.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.errors import DataError
from mvmatch.types import Tracks

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import pycolmap
    from numpy.typing import NDArray

MIN_MATCHES = 15
"""COLMAP's mappers pass over pairs with fewer."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ImageTracks:
    """The verified matches of a database, joined to tracks."""

    image_ids: NDArray[np.int64]
    """(F,) rising; the frame number of an observation is a position in it."""
    tracks: Tracks
    """Of at least two observations, px."""
    keypoint: NDArray[np.uint32]
    """(O,) number of each observation among the keypoints of its image."""


@dataclass(frozen=True, kw_only=True)
class DatabaseFacts:
    """What a database tells without its matches being read."""

    num_images: int
    pairs: NDArray[np.int64]
    """(P, 2) positions, in the order of their ids, of the images of every verified pair, rising."""
    has_rigs: bool
    """Whether images share frames, as those of several cameras on one rig do."""
    size: tuple[int, int]
    """Width and height of the largest picture, px; zero without a camera."""


def read_facts(path: Path) -> DatabaseFacts:
    """Look at the images, cameras and pairs of a COLMAP database."""
    import pycolmap

    with pycolmap.Database.open(path) as database:
        image_ids = sorted(image.image_id for image in database.read_all_images())
        cameras = database.read_all_cameras()
        pairs = _verified_pairs(database, image_ids)
        has_rigs = database.num_frames() != len(image_ids)
    return DatabaseFacts(
        num_images=len(image_ids),
        has_rigs=has_rigs,
        pairs=np.array(sorted(pairs), np.int64).reshape(-1, 2),
        size=(
            max((camera.width for camera in cameras), default=0),
            max((camera.height for camera in cameras), default=0),
        ),
    )


def read_image_tracks(path: Path) -> ImageTracks:
    """Join the verified matches of a database to tracks.

    Images come in the order of their ids. A keypoint continues the track of the keypoint it matches
    in the nearest earlier image; one that would bring a track into an image twice stays outside.

    Parameters
    ----------
    path : Path
        COLMAP database with two-view geometries.

    Returns
    -------
    ImageTracks
        The cost is linear in the number of matches; one pair at a time is in memory.

    Raises
    ------
    DataError
        A match refers to a keypoint that is not there.
    """
    import pycolmap

    with pycolmap.Database.open(path) as database:
        image_ids = sorted(image.image_id for image in database.read_all_images())
        xy = [database.read_keypoints(image_id)[:, :2] for image_id in image_ids]
        joiner = _Joiner([len(points) for points in xy])
        for earlier, later in _verified_pairs(database, image_ids):
            ids = image_ids[earlier], image_ids[later]
            matches = database.read_two_view_geometry(*ids).inlier_matches.astype(np.int64)
            if (matches.max(axis=0) >= [len(xy[earlier]), len(xy[later])]).any():
                message = (
                    f"{path}: images {ids[0]} and {ids[1]} have matches of keypoints they do not "
                    "have; match them anew"
                )
                raise DataError(message)
            joiner.join(earlier, later, matches)
    observations = joiner.observations()
    everything = np.concatenate([np.empty((0, 2), np.float32), *xy])
    return ImageTracks(
        image_ids=np.array(image_ids, np.int64),
        tracks=Tracks(
            offsets=np.concatenate(([0], np.cumsum(observations.lengths))).astype(np.int64),
            frame=observations.frame,
            xy=everything[observations.place],
        ),
        keypoint=observations.keypoint,
    )


def write_subset(
    source: Path,
    path: Path,
    *,
    image_ids: Sequence[int],
    matches: Sequence[tuple[int, int, NDArray[np.uint32]]],
) -> None:
    """Write a database of some images of another, under the same ids, with other matches.

    Parameters
    ----------
    source : Path
        COLMAP database; its cameras, rigs, frames and keypoints are taken over.
    path : Path
        The new database.
    image_ids : sequence of int
        Images to take.
    matches : sequence of (int, int, ndarray)
        Two image ids and (M, 2) uint32 keypoint numbers, taken for verified.
    """
    import pycolmap

    chosen = set(image_ids)
    with (
        pycolmap.Database.open(source) as old,
        pycolmap.Database.open(path) as new,
        pycolmap.DatabaseTransaction(new),
    ):
        for camera in old.read_all_cameras():
            new.write_camera(camera, use_camera_id=True)
        for rig in old.read_all_rigs():
            new.write_rig(rig, use_rig_id=True)
        images = {image.image_id: image for image in old.read_all_images()}
        frames = {images[image_id].frame_id for image_id in chosen}
        for image_id in sorted(chosen):
            image = pycolmap.Image(
                name=images[image_id].name,
                camera_id=images[image_id].camera_id,
                image_id=image_id,
            )
            new.write_image(image, use_image_id=True)
            new.write_keypoints(image_id, old.read_keypoints(image_id))
        for frame in old.read_all_frames():
            if frame.frame_id in frames:
                new.write_frame(frame, use_frame_id=True)
        for image0, image1, pairs in matches:
            geometry = pycolmap.TwoViewGeometry()
            geometry.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
            geometry.inlier_matches = pairs
            new.write_matches(image0, image1, pairs)
            new.write_two_view_geometry(image0, image1, geometry)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Observations:
    """Keypoints that belong to tracks, by track and frame."""

    lengths: NDArray[np.int64]
    """(T,) observations of each track."""
    frame: NDArray[np.int32]
    keypoint: NDArray[np.uint32]
    place: NDArray[np.int64]
    """(O,) position among the keypoints of all images."""


class _Joiner:
    """Gives the keypoints of successive images the label of their track, pair by pair."""

    def __init__(self, counts: Sequence[int]) -> None:
        self._starts = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
        self._label = np.full(int(self._starts[-1]), -1, np.int64)
        self._last_frame = np.full(len(self._label), -1, np.int64)  # of each label
        self._num_labels = 0

    def join(self, earlier: int, later: int, matches: NDArray[np.int64]) -> None:
        """Carry labels over (M, 2) matches; pairs come sorted by the later frame."""
        first, second = (matches + self._starts[[earlier, later]]).T
        free = self._label[second] < 0
        first, second = first[free], second[free]
        first = self._labelled(first, earlier)
        fresh = self._last_frame[first] < later
        first, second = first[fresh], second[fresh]
        # One keypoint per label and one label per keypoint, the first match of each.
        for column in (first, second):
            once = np.sort(np.unique(column, return_index=True)[1])
            first, second = first[once], second[once]
        self._label[second] = first
        self._last_frame[first] = later

    def _labelled(self, keypoints: NDArray[np.int64], frame: int) -> NDArray[np.int64]:
        """Return the labels of keypoints, new ones where they had none."""
        new = np.unique(keypoints[self._label[keypoints] < 0])
        self._label[new] = np.arange(self._num_labels, self._num_labels + len(new))
        self._last_frame[self._label[new]] = frame
        self._num_labels += len(new)
        return self._label[keypoints]

    def observations(self) -> _Observations:
        """Return what was joined; labels that no second keypoint carries are left out."""
        counts = np.bincount(self._label[self._label >= 0], minlength=self._num_labels)
        place = np.flatnonzero(self._label >= 0)
        place = place[counts[self._label[place]] >= 2]
        # Places rise with the frame: a stable sort by label leaves each track in order.
        place = place[np.argsort(self._label[place], kind="stable")]
        frame = np.searchsorted(self._starts, place, side="right") - 1
        return _Observations(
            lengths=counts[counts >= 2],
            frame=frame.astype(np.int32),
            keypoint=(place - self._starts[frame]).astype(np.uint32),
            place=place,
        )


def _verified_pairs(database: pycolmap.Database, image_ids: Sequence[int]) -> list[tuple[int, int]]:
    """Positions of the images of every verified pair: by the later one, the nearest first."""
    import pycolmap

    position = {image_id: index for index, image_id in enumerate(image_ids)}
    pairs: list[tuple[int, int]] = []
    for pair_id, count in zip(*database.read_two_view_geometry_num_inliers(), strict=True):
        if count >= MIN_MATCHES:
            first, second = (position[i] for i in pycolmap.pair_id_to_image_pair(pair_id))
            pairs.append((min(first, second), max(first, second)))
    return sorted(pairs, key=lambda pair: (pair[1], -pair[0]))
