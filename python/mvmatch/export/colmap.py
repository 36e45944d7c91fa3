"""Tracks to a COLMAP database: the meeting point of every method mvmatch compares.

Coordinates are COLMAP's already, so nothing is converted. Image ids are frame numbers plus one.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.errors import DataError
from mvmatch.export.verification import VerificationOptions, verify_pairs, verify_tracks

if TYPE_CHECKING:
    from collections.abc import Collection, Generator, Iterator, Sequence

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.export.verification import VerifiedPair
    from mvmatch.geometry.two_view import PairGeometry
    from mvmatch.types import StrPath, Tracks, TwoViewScore

_NO_SPACE = "Is the disk full? Make room, or choose another place"

PLANAR_RATIO = 0.8
"""H explaining this share of E's inliers means no parallax (COLMAP's ``max_H_inlier_ratio``)."""


@dataclass(frozen=True, kw_only=True)
class DatabaseSummary:
    """What was written."""

    num_images: int
    num_keypoints: int
    num_pairs: int
    """Image pairs with at least one match."""
    num_estimated_pairs: int
    """Image pairs whose own geometry was estimated, with whatever result."""
    num_verified_pairs: int
    """Image pairs with inliers that the mapper reads, estimated or judged by their tracks."""
    num_matches: int
    num_inliers: int
    """Matches that agree with the geometry of their pair, or whose track was found right."""
    scores: tuple[TwoViewScore, ...]
    """One per estimated pair."""


def write_database(
    tracks: Tracks,
    path: StrPath,
    *,
    camera: pycolmap.Camera,
    image_names: Sequence[str],
    verification: VerificationOptions | None = None,
    max_gap: int | None = 10,
    further: Tracks | None = None,
    loops: Collection[tuple[int, int]] = (),
) -> DatabaseSummary:
    """Write tracks as keypoints, matches and two-view geometries of a new COLMAP database.

    Parameters
    ----------
    tracks : Tracks
        Observations in px, COLMAP origin.
    path : path
        The database; it appears under this name only when complete. An older one is replaced.
    camera : pycolmap.Camera
        The one camera of the video.
    image_names : sequence of str
        File name of every frame, index = frame number.
    verification : VerificationOptions
        How matches are checked.
    max_gap : int or None
        Frame pairs further apart get no matches of their own; None writes every pair of a track.
    further : Tracks, optional
        Tracks that are not matched. Their keypoints follow the others of each image, so a model
        made of the database has a place for them (:func:`mvmatch.sfm.densify`).
    loops : collection of (int, int), optional
        Frame pairs that are matched even if further apart than ``max_gap``, the earlier first;
        each is estimated (:func:`mvmatch.export.verification.verify_pairs`).

    Returns
    -------
    DatabaseSummary

    Raises
    ------
    DataError
        A track refers to a frame without a name, names repeat, or the path cannot be written.
    """
    path = Path(path)
    parts = [tracks] if further is None else [tracks, further]
    _check(parts, image_names)
    options = verification or VerificationOptions()
    with new_database(path) as database:
        write_images(database, camera, image_names)
        for frame, xy in _keypoints(parts, len(image_names)):
            database.write_keypoints(frame + 1, xy)
        writer = _PairWriter(database)
        for pair in verify_tracks(tracks, camera, options=options, max_gap=max_gap):
            writer.add(pair)
        if max_gap is not None:
            far = [pair for pair in loops if pair[1] - pair[0] > max_gap]
            for pair in verify_pairs(tracks, far, camera, options=options):
                writer.add(pair)
    return DatabaseSummary(
        num_images=len(image_names),
        num_keypoints=sum(part.num_observations for part in parts),
        num_pairs=writer.num_pairs,
        num_estimated_pairs=len(writer.scores),
        num_verified_pairs=writer.num_verified_pairs,
        num_matches=writer.num_matches,
        num_inliers=writer.num_inliers,
        scores=tuple(writer.scores),
    )


class _PairWriter:
    """Writes verified pairs, and counts."""

    def __init__(self, database: pycolmap.Database) -> None:
        self._database = database
        self.num_pairs = self.num_verified_pairs = self.num_matches = self.num_inliers = 0
        self.scores: list[TwoViewScore] = []

    def add(self, pair: VerifiedPair) -> None:
        ids = pair.frame0 + 1, pair.frame1 + 1
        self.num_pairs += 1
        self.num_matches += len(pair.matches)
        self._database.write_matches(*ids, pair.matches)
        if pair.fit is not None:
            self.scores.append(pair.fit.score)
        inliers = pair.matches[pair.inliers]
        if len(inliers):
            self._database.write_two_view_geometry(*ids, calibrated_geometry(inliers, pair.fit))
            self.num_verified_pairs += 1
            self.num_inliers += len(inliers)


def calibrated_geometry(
    matches: NDArray[np.uint32], fit: PairGeometry | None = None
) -> pycolmap.TwoViewGeometry:
    """Build the COLMAP record of inlier matches and, when the pair was fitted, its models.

    A pair that was not fitted has no E and no pose in its record.
    """
    import pycolmap

    geometry = pycolmap.TwoViewGeometry()
    geometry.inlier_matches = matches
    planar = fit is not None and fit.homography_ratio > PLANAR_RATIO
    kinds = pycolmap.TwoViewGeometryConfiguration
    geometry.config = kinds.PLANAR_OR_PANORAMIC if planar else kinds.CALIBRATED
    if fit is not None:
        geometry.E, geometry.H = fit.E, fit.H
        geometry.cam2_from_cam1 = fit.cam1_from_cam0
    return geometry


@contextlib.contextmanager
def new_database(path: Path) -> Generator[pycolmap.Database]:
    """Open a new database that appears under its name only when the block ends without error.

    Raises
    ------
    DataError
        The folder is missing or cannot be written, or the disk is full.
    """
    import pycolmap

    partial = path.with_name(f".{path.name}.partial")
    _remove(partial)
    try:
        with partial.open("xb"):
            pass
    except OSError as error:
        raise DataError(
            f"cannot write the database {path}: {error.strerror}; choose another folder"
        ) from error
    try:
        # No pycolmap.DatabaseTransaction: on a full disk its end would end the whole process.
        with pycolmap.Database.open(partial) as database:
            yield database
        if partial.with_name(f"{partial.name}-wal").exists():
            raise DataError(f"cannot write the database {path}: its end is missing. {_NO_SPACE}")
        partial.replace(path)
    except RuntimeError as error:
        if "SQLite error" not in str(error) and "database factory" not in str(error):
            raise
        raise DataError(f"cannot write the database {path} ({error}). {_NO_SPACE}") from error
    finally:
        _remove(partial)


def write_images(
    database: pycolmap.Database, camera: pycolmap.Camera, image_names: Sequence[str]
) -> None:
    """Write one camera, its trivial rig, and per name one image in one frame; ids are frame + 1."""
    import pycolmap

    camera_id = database.write_camera(camera)
    rig = pycolmap.Rig(rig_id=1)
    sensor = pycolmap.sensor_t(type=pycolmap.SensorType.CAMERA, id=camera_id)
    rig.add_ref_sensor(sensor)
    rig_id = database.write_rig(rig)
    for index, name in enumerate(image_names):
        image = pycolmap.Image(name=name, camera_id=camera_id, image_id=index + 1)
        database.write_image(image, use_image_id=True)
        frame = pycolmap.Frame(frame_id=index + 1, rig_id=rig_id)
        frame.add_data_id(pycolmap.data_t(sensor_id=sensor, id=index + 1))
        database.write_frame(frame, use_frame_id=True)


_FRAMES = 64
"""Frames whose keypoints are sought at once."""


def _keypoints(
    parts: Sequence[Tracks], num_frames: int
) -> Iterator[tuple[int, NDArray[np.float32]]]:
    """Yield every frame and its (K, 2) keypoints, px, those of the first part first."""
    for start in range(0, num_frames, _FRAMES):
        end = min(start + _FRAMES, num_frames)
        near = [part.during(start, end) for part in parts]
        for frame in range(start, end):
            yield frame, np.concatenate([part.keypoints(frame) for part in near])


def _check(parts: Sequence[Tracks], image_names: Sequence[str]) -> None:
    if len(set(image_names)) != len(image_names):
        raise DataError("image names repeat; COLMAP needs one name per frame")
    last = max(part.num_frames for part in parts) - 1
    if last >= len(image_names):
        raise DataError(
            f"tracks reach frame {last} but there are {len(image_names)} image names; "
            "give one name per frame"
        )


def _remove(path: Path) -> None:
    for suffix in ("", "-journal", "-wal", "-shm"):
        with contextlib.suppress(OSError):
            path.with_name(path.name + suffix).unlink()
