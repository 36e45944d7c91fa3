"""Scores of an existing COLMAP database, whatever front end wrote it."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.errors import DataError
from mvmatch.geometry.two_view import RansacOptions, fit_pair

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mvmatch.types import StrPath, TwoViewScore


def score_database(
    path: StrPath,
    *,
    options: RansacOptions | None = None,
    max_gap: int | None = None,
) -> list[TwoViewScore]:
    """Fit and score every matched image pair of a COLMAP database, with the same settings for all.

    The stored matches are used, not the stored geometries. Frames are numbered in the order of the
    image names, because not every front end gives image ids in that order.

    Parameters
    ----------
    path : path
        A database with cameras, keypoints and matches.
    options : RansacOptions
        Settings of LO-RANSAC.
    max_gap : int, optional
        Skip pairs of frames further apart.

    Returns
    -------
    list of TwoViewScore
        One per pair with at least one match, sorted by frames; a failed fit has zero inliers.

    Raises
    ------
    DataError
        The file is not a COLMAP database.
    """
    import pycolmap

    path = Path(path)
    check_is_database(path)
    scores: list[TwoViewScore] = []
    with pycolmap.Database.open(path) as database:
        images = sorted(database.read_all_images(), key=lambda image: image.name)
        frame_of = {image.image_id: frame for frame, image in enumerate(images)}
        image_of = dict(enumerate(images))
        cameras = {camera.camera_id: camera for camera in database.read_all_cameras()}
        keypoints: dict[int, NDArray[np.float32]] = {
            image.image_id: np.asarray(database.read_keypoints(image.image_id), np.float32)[:, :2]
            for image in images
        }
        for pair_id, count in zip(*database.read_num_matches(), strict=True):
            ids = pycolmap.pair_id_to_image_pair(pair_id)
            frames = (frame_of[ids[0]], frame_of[ids[1]])
            low, high = min(frames), max(frames)
            if count == 0 or (max_gap is not None and high - low > max_gap):
                continue
            image0, image1 = image_of[low], image_of[high]
            matches = database.read_matches(image0.image_id, image1.image_id)
            fit = fit_pair(
                keypoints[image0.image_id][matches[:, 0]],
                keypoints[image1.image_id][matches[:, 1]],
                cameras[image0.camera_id],
                cameras[image1.camera_id],
                frames=(low, high),
                options=options,
            )
            scores.append(fit.score)
    return sorted(scores, key=lambda score: (score.frame0, score.frame1))


def check_is_database(path: Path) -> None:
    """Raise unless the file starts like the SQLite file that every COLMAP database is.

    Raises
    ------
    DataError
        It does not.
    FileNotFoundError
        There is no such file.
    """
    with path.open("rb") as file:
        magic = file.read(16)
    if magic != b"SQLite format 3\0":
        raise DataError(f"{path} is not a COLMAP database (not an SQLite file)")
