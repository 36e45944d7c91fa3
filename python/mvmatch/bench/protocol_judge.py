"""Judge a method as the paper does: repeated estimations of every pair, and its model."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from statistics import fmean
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.bench.accuracy import AccuracyOptions
from mvmatch.bench.mapping import MAPPER
from mvmatch.geometry.point_error import distinct_points
from mvmatch.geometry.pose_error import relative_pose, relative_pose_error
from mvmatch.geometry.two_view import fit_pair
from mvmatch.sfm import reconstruct, write_model

if TYPE_CHECKING:
    from collections.abc import Sequence as Many
    from pathlib import Path

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.bench.datasets import Sequence
    from mvmatch.bench.matches import Matches
    from mvmatch.bench.protocol_methods import Timeline
    from mvmatch.bench.protocol_options import ProtocolOptions
    from mvmatch.geometry.two_view import PairGeometry

VERIFY, MAP, DENSIFY = "verify", "map", "densify"
"""Stages behind a front end."""

PAIR_COLUMNS = {
    "gap": "frames between the two of the pair",
    "frame0": "earlier frame of the pair",
    "seed": "of the estimation",
    "matches": "correspondences",
    "distinct": "of them further than 1 px from each other in the earlier frame",
    "inlier_ratio": "inliers of the estimation over correspondences; 0 where it failed",
    "sampson_px": "median Sampson distance of the inliers, px",
    "sampson_normalized": "its square in normalised coordinates, the paper's formula",
    "rotation_deg": "error of the relative rotation; none where the true poses are not known",
    "translation_deg": "error of the direction of translation; none without a baseline",
    "pose_deg": "the larger of the two; infinite without an estimate",
}
"""What a row of a pair and a seed holds. What does not exist is NaN."""


def judge_pairs(
    matches: Matches, sequence: Sequence, options: ProtocolOptions
) -> list[dict[str, Any]]:
    """Estimate every pair with every seed.

    Returns
    -------
    list of dict
        By gap, pair and seed; see :data:`PAIR_COLUMNS`.
    """
    pairs = [(frame, frame + gap) for gap in options.gaps for frame in range(len(sequence) - gap)]
    shortest = _shortest_baseline(sequence, pairs)
    first_seed = options.ransac.seed
    rows: list[dict[str, Any]] = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for frames in pairs:
            found = matches.between(*frames)
            points = found.xy0.astype(np.float64), found.xy1.astype(np.float64)
            pose = relative_pose(*(sequence.cam_from_world[frame] for frame in frames))
            head = {
                "gap": frames[1] - frames[0],
                "frame0": frames[0],
                "matches": len(found),
                "distinct": int(distinct_points(points[0]).sum()),
            }
            estimate = partial(_estimated, points, sequence.camera, options)
            seeds = range(first_seed, first_seed + options.repetitions)
            rows += [
                {**head, "seed": seed, **_judged(fitted, pose, shortest)}
                for seed, fitted in zip(seeds, pool.map(estimate, seeds), strict=True)
            ]
    return rows


def _estimated(
    points: tuple[NDArray[np.float64], NDArray[np.float64]],
    camera: pycolmap.Camera,
    options: ProtocolOptions,
    seed: int,
) -> PairGeometry:
    """Estimate the geometry of correspondences, (N, 2) px each, with one seed."""
    ransac = replace(options.ransac, seed=seed)
    return fit_pair(*points, camera, camera, options=ransac, max_sample=options.max_sample)


def _judged(fit: PairGeometry, pose: NDArray[np.float64], shortest: float) -> dict[str, float]:
    """Return the columns of one estimation, against the true relative pose (3, 4)."""
    # A failure only where there is something to fail at.
    rotation = translation = math.inf if np.isfinite(pose).all() else math.nan
    if fit.cam1_from_cam0 is not None:
        estimate = np.asarray(fit.cam1_from_cam0.matrix(), np.float64)
        rotation, translation = relative_pose_error(estimate, pose, min_baseline=shortest)
    elif not np.linalg.norm(pose[:, 3]) > shortest:
        translation = math.nan
    return {
        "inlier_ratio": fit.score.inlier_ratio,
        "sampson_px": fit.score.median_sampson_px,
        "sampson_normalized": fit.score.median_sampson_normalized,
        "rotation_deg": rotation,
        "translation_deg": translation,
        "pose_deg": float(np.fmax(rotation, translation)),
    }


def _shortest_baseline(sequence: Sequence, pairs: Many[tuple[int, int]]) -> float:
    """Return the baseline, in the unit of the truth, below which a pair has no direction."""
    centers = sequence.centers
    baselines = [float(np.linalg.norm(centers[j] - centers[i])) for i, j in pairs]
    rounding = 1e-9 * (1.0 + float(np.fmax.reduce(np.abs(centers), axis=None, initial=0.0)))
    longest = float(np.fmax.reduce(baselines, initial=0.0))  # fmax passes over NaN
    return max(rounding, AccuracyOptions.min_baseline * longest)


def verify_matches(
    matches: Matches,
    sequence: Sequence,
    database: Path,
    names: Many[str],
    *,
    timeline: Timeline,
    options: ProtocolOptions,
) -> dict[str, Any]:
    """Write a database with all matches and those that pass the two-view geometry.

    Returns
    -------
    dict
        ``keypoints`` of an image on average, and ``pairs``: rows ``[frame0, frame1, matches,
        inliers]``.
    """
    import pycolmap

    with timeline.stage(VERIFY):
        matches.write(
            database, sequence.camera, names, sample=None, verification=options.verification
        )
    found: dict[tuple[int, int], list[int]] = {}
    with pycolmap.Database.open(database) as opened:
        images = opened.read_all_images()
        tables = opened.read_num_matches(), opened.read_two_view_geometry_num_inliers()
        for column, (ids, counts) in enumerate(tables):
            for pair, count in zip(ids, counts, strict=True):
                first, second = sorted(pycolmap.pair_id_to_image_pair(pair))
                found.setdefault((first - 1, second - 1), [0, 0])[column] = int(count)
        keypoints = fmean(opened.num_keypoints_for_image(image.image_id) for image in images)
    return {
        "keypoints": keypoints,
        "pairs": [[*pair, *counts] for pair, counts in sorted(found.items())],
    }


def map_database(
    database: Path, matches: Matches, sequence: Sequence, timeline: Timeline
) -> dict[str, Any]:
    """Reconstruct from a verified database and write the model beside it, if there is one.

    Returns
    -------
    dict
        ``accepted``, ``registered`` of ``total``, ``reasons`` of a refusal, ``path`` (None without
        a model; one that the checks refuse has a path, so that no method is judged by them alone).
    """
    options = MAPPER if sequence.focal_known else replace(MAPPER, intrinsics="refine")
    with timeline.stage(MAP):
        model = reconstruct(database, database.parent / "work", options=options)
    path = None
    if model.reconstruction is not None:
        if model.accepted:
            with timeline.stage(DENSIFY):
                matches.densify(model.reconstruction, sample=None)
        path = str(write_model(model.reconstruction, database.parent / "sparse"))
    return {
        "accepted": model.accepted,
        "registered": model.registered,
        "total": len(sequence),
        "reasons": list(model.reasons),
        "path": path,
    }
