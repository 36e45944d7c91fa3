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
    min_angle: float = 1.5
    """Degrees; the widest angle between two rays of a point is at least this (COLMAP's bound)."""
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
    import pycolmap

    options = options or DensifyOptions()
    registered = _registered(model, tracks)
    views = {
        frame: (model.image(frame + 1).cam_from_world(), model.image(frame + 1).camera)
        for frame in np.flatnonzero(registered).tolist()
    }
    usable = registered[tracks.frame]
    num_usable = np.bincount(tracks.track_index[usable], minlength=len(tracks))
    candidates = ~_has_point(model, tracks) & (num_usable >= options.min_observations)
    estimation = _estimation(options)
    xy, num_added = tracks.xy.astype(np.float64), 0
    for track in np.flatnonzero(candidates).tolist():
        rows = np.arange(tracks.offsets[track], tracks.offsets[track + 1])
        rows = rows[usable[rows]]
        frames = tracks.frame[rows].tolist()
        poses, cameras = zip(*(views[frame] for frame in frames), strict=True)
        found = pycolmap.estimate_triangulation(xy[rows], poses, cameras, estimation)
        if found is None:
            continue
        inliers = cast("NDArray[np.bool_]", found["inliers"])
        if inliers.sum() < max(options.min_observations, options.min_share * len(rows)):
            continue
        elements = [
            pycolmap.TrackElement(frame + 1, index)
            for frame, index, inlier in zip(
                frames, tracks.keypoint_index[rows].tolist(), inliers.tolist(), strict=True
            )
            if inlier
        ]
        model.add_point3D(found["xyz"], pycolmap.Track(elements))
        num_added += 1
    model.update_point_3d_errors()
    return DensifySummary(
        num_tracks=int(candidates.sum()),
        num_added=num_added,
        num_points=model.num_points3D(),
    )


def _registered(model: pycolmap.Reconstruction, tracks: Tracks) -> NDArray[np.bool_]:
    """(F,) frames of the tracks that have a pose in the model."""
    registered = np.zeros(tracks.num_frames, np.bool_)
    for image_id in model.reg_image_ids():
        frame = image_id - 1
        if frame >= len(registered):
            continue
        expected, found = len(tracks.observations(frame)), model.image(image_id).num_points2D()
        if found != expected:
            message = (
                f"image {image_id} has {found} 2D points but frame {frame} has {expected} "
                "keypoints; give the tracks that the model was made with"
            )
            raise ValueError(message)
        registered[frame] = True
    return registered


def _has_point(model: pycolmap.Reconstruction, tracks: Tracks) -> NDArray[np.bool_]:
    """(T,) tracks with an observation that belongs to a point of the model."""
    has_point = np.zeros(len(tracks), np.bool_)
    for image_id in model.reg_image_ids():
        numbers = model.image(image_id).get_observation_point2D_idxs()
        observed = tracks.observations(image_id - 1)[np.asarray(numbers, np.int64)]
        has_point[tracks.track_index[observed]] = True
    return has_point


def _estimation(options: DensifyOptions) -> pycolmap.EstimateTriangulationOptions:
    import pycolmap

    estimation = pycolmap.EstimateTriangulationOptions()
    estimation.residual_type = pycolmap.TriangulationResidualType.REPROJECTION_ERROR
    estimation.min_tri_angle = float(np.radians(options.min_angle))
    estimation.ransac.max_error = options.max_error
    estimation.ransac.random_seed = options.seed
    return estimation
