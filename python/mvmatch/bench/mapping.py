"""From matches to a model, judged by the true trajectory."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.export.model import images_by_frame
from mvmatch.geometry.point_error import distinct_points
from mvmatch.geometry.trajectory import relative_trajectory_error, trajectory_error
from mvmatch.measure import StageClock
from mvmatch.sfm import MapperOptions, reconstruct

if TYPE_CHECKING:
    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.bench.datasets import Sequence
    from mvmatch.bench.front_ends import Clip
    from mvmatch.bench.matches import Matches, Sample

MAPPER = MapperOptions(intrinsics="fixed")
"""The camera is the true one, for every method."""

_ERRORS: tuple[str, ...] = ("ate", "ate_percent", "rpe", "rpe_deg")


def map_matches(
    matches: Matches, sequence: Sequence, clip: Clip, sample: Sample | None
) -> dict[str, Any]:
    """Verify, reconstruct and compare with the truth.

    Returns
    -------
    dict
        ``draw``, ``accepted``, ``registered`` images of ``total``, ``points``, of them
        ``distinct_points`` (in no image within 1 px of an earlier one), ``track_length``,
        ``reprojection_px``, ``ate_percent`` of the path (infinite without a model), ``ate``,
        ``rpe`` (units of the truth, over one frame), ``rpe_deg``, and the CPU seconds
        ``verify_cpu_s``, ``map_cpu_s`` and ``densify_cpu_s``.
    """
    clock = StageClock()
    names = [path.name for path in sorted(clip.images.iterdir())]
    with tempfile.TemporaryDirectory(dir=clip.scratch) as folder:
        database = Path(folder) / "database.db"
        with clock.stage("verify"):
            matches.write(database, clip.camera, names, sample=sample)
        with clock.stage("map"):
            model = reconstruct(database, Path(folder) / "sparse", options=MAPPER)
        with clock.stage("densify"):
            if model.reconstruction is not None and model.accepted:
                matches.densify(model.reconstruction, sample=sample)
    row: dict[str, Any] = {
        "draw": -1 if sample is None else sample.seed,
        "accepted": model.accepted,
        "reasons": list(model.reasons),
        "registered": model.registered,
        "total": len(sequence),
        **count_points(model.reconstruction),
        "track_length": model.mean_track_length,
        "reprojection_px": model.mean_reprojection_error,
        "verify_cpu_s": clock.stages[0].cpu_s,
        "map_cpu_s": clock.stages[1].cpu_s,
        "densify_cpu_s": clock.stages[2].cpu_s,
    }
    return row | pose_errors(model.reconstruction if model.accepted else None, sequence)


def count_points(model: pycolmap.Reconstruction | None) -> dict[str, int]:
    """Count points, and those that are in no image within 1 px of an earlier one."""
    if model is None:
        return {"points": 0, "distinct_points": 0}
    repeated: set[int] = set()
    for image_id in model.reg_image_ids():
        observations = [
            (point.point3D_id, point.xy)
            for point in model.image(image_id).points2D
            if point.has_point3D()
        ]
        observations.sort(key=lambda observation: observation[0])
        distinct = distinct_points([xy for _, xy in observations])
        repeated.update(
            number for (number, _), marked in zip(observations, distinct, strict=True) if not marked
        )
    total = model.num_points3D()
    return {"points": total, "distinct_points": total - len(repeated)}


def pose_errors(model: pycolmap.Reconstruction | None, sequence: Sequence) -> dict[str, float]:
    """Return ``ate``, ``ate_percent``, ``rpe`` and ``rpe_deg``.

    Over the frames whose true pose is known. NaN where these are fewer than three; otherwise
    infinite without a model, or with one that has fewer than three of them.
    """
    if sequence.posed.sum() < 3:
        return dict.fromkeys(_ERRORS, math.nan)
    failed: dict[str, float] = dict.fromkeys(_ERRORS, math.inf)
    if model is None or model.num_reg_images() < 3:
        return failed
    frames, poses = _poses(model)
    known = sequence.posed[frames]
    frames, poses = frames[known], poses[known]
    if len(frames) < 3:
        return failed
    R = sequence.cam_from_world[frames, :, :3].transpose(0, 2, 1)
    truth = np.concatenate([R, sequence.centers[frames][:, :, None]], axis=2)
    ate = trajectory_error(poses[:, :, 3], truth[:, :, 3])
    rpe = relative_trajectory_error(poses, truth)
    return {
        "ate": ate.rmse,
        "ate_percent": ate.percent_of_path,
        "rpe": rpe.translation_rmse,
        "rpe_deg": rpe.rotation_rmse,
    }


def _poses(model: pycolmap.Reconstruction) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Frame numbers (N,) and camera-to-world poses (N, 3, 4) of the registered images, in order."""
    images = images_by_frame(model)
    poses = [image.cam_from_world().inverse().matrix() for image in images.values()]
    return np.array(list(images), np.int64), np.array(poses, np.float64)
