"""More points for a finished model: further tracks are triangulated, poses and cameras stay.

A mapper on every track there is would be slow and no more accurate: poses need a few hundred good
points per image. What dense points are for (splatting, meshes) needs the poses only.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from mvmatch.sfm.database import ImageTracks
from mvmatch.sfm.localize import points_of_tracks

if TYPE_CHECKING:
    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.types import Tracks


@dataclass(frozen=True, kw_only=True)
class DensifyOptions:
    """Which triangulated tracks become points of the model."""

    max_error: float = 1.0
    """px; observations that are reprojected farther away do not belong to the point."""
    min_share: float = 0.8
    """Share of a track's observations that must belong to the point; fewer, and the track is taken
    for wrong (or on something that moves)."""
    min_angle: float = 1.0
    """Degrees; the widest angle between two rays of a point is at least this. COLMAP's bound is
    1.5: poses hang on its points, they do not on these, and what is far is there or not."""
    min_observations: int = 3
    """Observations of a point."""
    seed: int = 0
    """Of the samples that a triangulation draws."""


@dataclass(frozen=True, kw_only=True)
class DensifySummary:
    """What became of the tracks."""

    num_tracks: int
    """Tracks that had no point before."""
    num_added: int
    """Points made of them."""
    num_points: int
    """Points of the model afterwards."""


def densify(
    model: pycolmap.Reconstruction, tracks: Tracks, *, options: DensifyOptions | None = None
) -> DensifySummary:
    """Triangulate the tracks that have no point yet, with the poses and cameras of the model.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Gets the points; its poses, cameras and other points stay. The id of an image is its frame
        number plus one, its 2D points are the keypoints of the tracks, in their order.
    tracks : Tracks
        All tracks whose keypoints the model was made with, px.
    options : DensifyOptions, optional
        When a point is accepted.

    Returns
    -------
    DensifySummary

    Raises
    ------
    ValueError
        A registered image has not as many 2D points as its frame has keypoints.

    References
    ----------
    Robust multi-view triangulation as in COLMAP (Schönberger and Frahm 2016, section 4.3).
    """
    _require_keypoints_of(model, tracks)
    images = ImageTracks(
        image_ids=np.arange(1, tracks.num_frames + 1, dtype=np.int64),
        tracks=tracks,
        keypoint=tracks.keypoint_index,
    )
    return triangulate(model, images, options=options)


def triangulate(
    model: pycolmap.Reconstruction,
    images: ImageTracks,
    *,
    among: NDArray[np.bool_] | None = None,
    options: DensifyOptions | None = None,
) -> DensifySummary:
    """As :func:`densify`, with tracks that need not hold all keypoints.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Gets the points.
    images : ImageTracks
        Tracks through its images and others.
    among : (T,) bool, optional
        Tracks that may become points; all without.
    options : DensifyOptions, optional
        When a point is accepted.
    """
    import pycolmap

    options = options or DensifyOptions()
    tracks = images.tracks
    views = {
        frame: (model.image(image_id).cam_from_world(), model.image(image_id).camera)
        for frame, image_id in enumerate(images.image_ids.tolist())
        if model.exists_image(image_id) and model.image(image_id).has_pose
    }
    registered = np.zeros(len(images.image_ids), np.bool_)
    registered[list(views)] = True
    usable = registered[tracks.frame]
    num_usable = np.bincount(tracks.track_index[usable], minlength=len(tracks))
    candidates = (points_of_tracks(model, images) < 0) & (num_usable >= options.min_observations)
    if among is not None:
        candidates &= among
    estimation = _estimation(options)
    num_added = 0
    for track in np.flatnonzero(candidates).tolist():
        rows = np.arange(tracks.offsets[track], tracks.offsets[track + 1])
        rows = rows[usable[rows]]
        frames = tracks.frame[rows]
        poses, cameras = zip(*(views[frame] for frame in frames.tolist()), strict=True)
        xy = tracks.xy[rows].astype(np.float64)
        found = pycolmap.estimate_triangulation(xy, poses, cameras, estimation)
        if found is None:
            continue
        inliers = cast("NDArray[np.bool_]", found["inliers"])
        if inliers.sum() < max(options.min_observations, options.min_share * len(rows)):
            continue
        seen = zip(
            images.image_ids[frames][inliers].tolist(),
            images.keypoint[rows][inliers].tolist(),
            strict=True,
        )
        elements = [pycolmap.TrackElement(*element) for element in seen]
        model.add_point3D(found["xyz"], pycolmap.Track(elements))
        num_added += 1
    model.update_point_3d_errors()
    return DensifySummary(
        num_tracks=int(candidates.sum()),
        num_added=num_added,
        num_points=model.num_points3D(),
    )


def _require_keypoints_of(model: pycolmap.Reconstruction, tracks: Tracks) -> None:
    for image_id in model.reg_image_ids():
        frame = image_id - 1
        if frame >= tracks.num_frames:
            continue
        expected, found = len(tracks.observations(frame)), model.image(image_id).num_points2D()
        if found != expected:
            message = (
                f"image {image_id} has {found} 2D points but frame {frame} has {expected} "
                "keypoints; give the tracks that the model was made with"
            )
            raise ValueError(message)


def _estimation(options: DensifyOptions) -> pycolmap.EstimateTriangulationOptions:
    import pycolmap

    estimation = pycolmap.EstimateTriangulationOptions()
    estimation.residual_type = pycolmap.TriangulationResidualType.REPROJECTION_ERROR
    estimation.min_tri_angle = float(np.radians(options.min_angle))
    estimation.ransac.max_error = options.max_error
    estimation.ransac.random_seed = options.seed
    return estimation
