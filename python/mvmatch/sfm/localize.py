"""The images that were not mapped: each is registered to the points of a finished map.

The points that an image sees are those of its tracks. So a pose needs no search, costs the same
however long the video is, and no image waits for another.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.sfm.database import ImageTracks


@dataclass(frozen=True, kw_only=True)
class LocalizeOptions:
    """When an image that was not mapped gets a pose."""

    max_error: float = 4.0
    """px; points that are reprojected farther away say nothing about the pose, and the image does
    not observe them (COLMAP's bound of the mapper)."""
    min_inliers: int = 30
    """Points within it (COLMAP's bound)."""
    min_share: float = 0.25
    """Of the points that the tracks of the image lead to (COLMAP's bound)."""


@dataclass(frozen=True, kw_only=True)
class Unregistered:
    """An image without a pose."""

    image_id: int
    name: str
    reason: str


def localize(
    model: pycolmap.Reconstruction,
    database: Path,
    images: ImageTracks,
    *,
    options: LocalizeOptions | None = None,
    seed: int = 0,
) -> tuple[Unregistered, ...]:
    """Register the images of a database that a model does not hold; its points stay.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Gets the images that can be registered, with their keypoints as 2D points and the
        observations of points that are reprojected near enough.
    database : Path
        COLMAP database with the images and those of the model, under the same ids.
    images : ImageTracks
        Of this database.
    options : LocalizeOptions, optional
        When a pose is accepted.
    seed : int
        Of the samples that the poses are estimated from.

    Returns
    -------
    tuple of Unregistered
        Images that could not be registered, with the reason, by rising id.

    References
    ----------
    LO-RANSAC over P3P and robust refinement as in COLMAP (Schönberger and Frahm 2016, section 4.2).
    """
    import pycolmap

    registered = set(model.reg_image_ids())
    point_of = points_of_tracks(model, images)
    failed: list[Unregistered] = []
    with pycolmap.Database.open(database) as opened:
        records = {image.image_id: image for image in opened.read_all_images()}
        for frame, image_id in enumerate(images.image_ids.tolist()):
            if image_id in registered:
                continue
            record = records[image_id]
            seen = _seen(images, frame, point_of)
            pose = _pose(
                model, model.cameras[record.camera_id], seen, options or LocalizeOptions(), seed
            )
            if isinstance(pose, str):
                failed.append(Unregistered(image_id=image_id, name=record.name, reason=pose))
                continue
            keypoints = opened.read_keypoints(image_id)[:, :2].astype(np.float64)
            _add(model, record, opened.read_frame(record.frame_id), keypoints, pose[0])
            for keypoint, point_id in seen.observations(pose[1]):
                model.add_observation(point_id, pycolmap.TrackElement(image_id, keypoint))
    return tuple(failed)


def unmapped(
    model: pycolmap.Reconstruction,
    database: Path,
    *,
    reason: str = "the mapper found no pose that its matches agree with",
) -> tuple[Unregistered, ...]:
    """List the images of a database that a mapper left out."""
    import pycolmap

    registered = set(model.reg_image_ids())
    with pycolmap.Database.open(database) as opened:
        names = {image.image_id: image.name for image in opened.read_all_images()}
    return tuple(
        Unregistered(image_id=image_id, name=name, reason=reason)
        for image_id, name in sorted(names.items())
        if image_id not in registered
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Seen:
    """Points of the model that the tracks of one image lead to."""

    xy: NDArray[np.float64]
    """(N, 2) px."""
    keypoint: NDArray[np.uint32]
    point_id: NDArray[np.int64]

    def observations(self, mask: NDArray[np.bool_]) -> Iterable[tuple[int, int]]:
        return zip(self.keypoint[mask].tolist(), self.point_id[mask].tolist(), strict=True)


def points_of_tracks(model: pycolmap.Reconstruction, images: ImageTracks) -> NDArray[np.int64]:
    """(T,) id of the point that each track leads to, -1 without; of several the largest."""
    tracks = images.tracks
    point_of = np.full(len(tracks), -1, np.int64)
    for frame, image_id in enumerate(images.image_ids.tolist()):
        if not model.exists_image(image_id):
            continue
        image = model.image(image_id)
        numbers = image.get_observation_point2D_idxs()
        if not numbers:
            continue
        point_id = np.full(image.num_points2D(), -1, np.int64)
        point_id[numbers] = [image.point2D(number).point3D_id for number in numbers]
        observed = tracks.observations(frame)
        track = tracks.track_index[observed]
        point_of[track] = np.maximum(point_of[track], point_id[images.keypoint[observed]])
    return point_of


def _seen(images: ImageTracks, frame: int, point_of: NDArray[np.int64]) -> _Seen:
    observed = images.tracks.observations(frame)
    observed = observed[point_of[images.tracks.track_index[observed]] >= 0]
    point_id = point_of[images.tracks.track_index[observed]]
    point_id, once = np.unique(point_id, return_index=True)
    observed = observed[once]
    return _Seen(
        xy=images.tracks.xy[observed].astype(np.float64),
        keypoint=images.keypoint[observed],
        point_id=point_id,
    )


def _pose(
    model: pycolmap.Reconstruction,
    camera: pycolmap.Camera,
    seen: _Seen,
    options: LocalizeOptions,
    seed: int,
) -> tuple[pycolmap.Rigid3d, NDArray[np.bool_]] | str:
    """Pose and (N,) points within the bound, or the reason why there is none."""
    import pycolmap

    count = len(seen.point_id)
    if count < options.min_inliers:
        return f"its tracks lead to {count} points of the model, {options.min_inliers} are needed"
    xyz = np.array([model.point3D(point_id).xyz for point_id in seen.point_id.tolist()])
    estimation = pycolmap.AbsolutePoseEstimationOptions()
    estimation.ransac.max_error = options.max_error
    estimation.ransac.random_seed = seed
    found = pycolmap.estimate_and_refine_absolute_pose(seen.xy, xyz, camera, estimation)
    if found is None:
        return f"no pose explains the {count} points that its tracks lead to"
    pose = cast("pycolmap.Rigid3d", found["cam_from_world"])
    local = pose * xyz
    projected = np.asarray(camera.img_from_cam(local), np.float64)
    near = np.linalg.norm(projected - seen.xy, axis=1) <= options.max_error
    near &= local[:, 2] > 0
    num_near = int(near.sum())
    if num_near < max(options.min_inliers, options.min_share * count):
        return f"the best pose explains {num_near} of the {count} points that its tracks lead to"
    return pose, near


def _add(
    model: pycolmap.Reconstruction,
    record: pycolmap.Image,
    frame: pycolmap.Frame,
    keypoints: NDArray[np.float64],
    pose: pycolmap.Rigid3d,
) -> None:
    """Add a registered image to the model."""
    import pycolmap

    image = pycolmap.Image(
        name=record.name,
        keypoints=keypoints,
        camera_id=record.camera_id,
        image_id=record.image_id,
    )
    image.frame_id = frame.frame_id
    model.add_frame(frame)
    model.add_image(image)
    added = model.frame(frame.frame_id)
    added.set_cam_from_world(record.camera_id, pose)
    model.register_frame(frame.frame_id)
