"""What pairs of images say about the motion, before any model exists.

Two views with parallax know their relative rotation and direction far better than a mapper that
went astray. So these measurements choose where mapping starts, and judge what comes out of it.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from mvmatch.geometry.sampson import homography_error, sampson_error
from mvmatch.geometry.two_view import fit_pair

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    import pycolmap
    from numpy.typing import NDArray

_Item = TypeVar("_Item")

MIN_INLIERS = 50
"""Pairs with fewer are not evidence."""

MAX_PARALLAX = 60.0
"""Degrees; pairs with more are not evidence: descriptors do not recognise a thing from so far
aside, and matches that agree on such a motion come from a pattern that repeats."""

MAX_PAIRS = 500
"""Pairs measured; of more a selection spread over the sequence is taken."""

MAX_REFITTED_PAIRS = 150
"""As `MAX_PAIRS`, where every pair has to be fitted."""

MIN_STRETCH = 0.005
"""A camera that moves by less than this share of the distance to the scene only turns."""

_MAX_SAMPLE = 256


@dataclass(frozen=True, kw_only=True, eq=False)
class PairEvidence:
    """Relative motion of one image pair, measured from its own matches alone."""

    image0: int
    image1: int
    """Image ids of the database."""
    num_inliers: int
    rotation: NDArray[np.float64]
    """(3, 3) ``cam1_from_cam0``."""
    direction: NDArray[np.float64]
    """(3,) translation of ``cam1_from_cam0``, unit length."""
    parallax: float
    """Median angle in degrees between the two rays of a match, rotation removed."""
    displacement: float
    """Median displacement of the matches in px."""
    homography_ratio: float
    """Share of the inliers that a homography explains as well."""
    stretch: float
    """How far that homography is from a rotation: largest over smallest singular value, minus 1;
    about the share of the distance to the scene that the camera moved."""
    normalized: tuple[NDArray[np.float64], NDArray[np.float64]]
    """(M, 2) each: some of the matches in both images, lens removed, in focal lengths from the
    principal point."""

    def misfit(self, rotation: NDArray[np.float64], direction: NDArray[np.float64]) -> float:
        """Median squared Sampson error of the matches under a motion, in squared focal lengths."""
        error = sampson_error(*self.normalized, _cross(direction) @ rotation)
        return float(np.median(np.nan_to_num(error, nan=np.inf)))

    @property
    def strength(self) -> float:
        """How well the pair fixes its geometry: parallax in degrees times the root of the count."""
        return float(min(self.parallax, 10.0) * np.sqrt(self.num_inliers))


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """All measured pairs of a database."""

    num_images: int
    pairs: tuple[PairEvidence, ...]
    matched: Mapping[int, int]
    """Keypoints that have a verified match, by image id, rising."""
    cameras: Mapping[int, pycolmap.Camera]
    """What the motion was measured with: another camera measures another one."""

    @property
    def image_ids(self) -> list[int]:
        """Of the images, rising."""
        return list(self.matched)

    @property
    def num_observations(self) -> int:
        """Keypoints that have a verified match."""
        return sum(self.matched.values())

    def within(self, image_ids: Sequence[int]) -> Evidence:
        """Return what is known of some of the images alone."""
        inside = frozenset(image_ids)
        return Evidence(
            num_images=len(inside),
            pairs=tuple(pair for pair in self.pairs if {pair.image0, pair.image1} <= inside),
            matched={image: count for image, count in self.matched.items() if image in inside},
            cameras=self.cameras,
        )

    @property
    def has_prior_focal_length(self) -> bool:
        """Whether the cameras are known rather than guessed."""
        return all(camera.has_prior_focal_length for camera in self.cameras.values())

    def strongest(self, count: int) -> list[PairEvidence]:
        """Return the strongest pairs, spread over the images.

        The first is the strongest of all; each next one starts at least an eighth of the images
        away from those before.
        """
        apart = max(2.0, self.num_images / 8)
        chosen: list[PairEvidence] = []
        for pair in sorted(self.pairs, key=_by_strength):
            middle = pair.image0 + pair.image1
            if all(abs(middle - (c.image0 + c.image1)) >= 2 * apart for c in chosen):
                chosen.append(pair)
                if len(chosen) == count:
                    break
        return chosen


def read_evidence(
    database_path: Path,
    *,
    cameras: Mapping[int, pycolmap.Camera] | None = None,
    max_pairs: int = MAX_PAIRS,
) -> Evidence:
    """Measure the relative motion of a database's verified image pairs.

    Parameters
    ----------
    database_path : Path
        COLMAP database with two-view geometries.
    cameras : Mapping, optional
        Cameras by id that replace those the geometries were written with: pairs are fitted anew.
    max_pairs : int
        Pairs measured; of more a selection is taken. Those that have to be fitted are
        `MAX_REFITTED_PAIRS` at most.

    Returns
    -------
    Evidence
        Pairs with at least `MIN_INLIERS` inliers and at most `MAX_PARALLAX`, sorted by image ids.
        Where some geometries have a pose, those without are no evidence: their matches were judged
        by tracks that the others measure as well. Where none has, all are fitted.
    """
    import pycolmap

    with pycolmap.Database.open(database_path) as database:
        images = {image.image_id: image for image in database.read_all_images()}
        known = {camera.camera_id: camera for camera in database.read_all_cameras()}
        pair_ids, geometries = database.read_two_view_geometries()
        keypoints = {
            image_id: np.asarray(database.read_keypoints(image_id), np.float64)[:, :2]
            for image_id in images
        }
    matched = {image_id: np.zeros(len(xy), bool) for image_id, xy in keypoints.items()}
    usable: list[tuple[tuple[int, int], pycolmap.TwoViewGeometry]] = []
    for pair_id, geometry in zip(pair_ids, geometries, strict=True):
        ids = pycolmap.pair_id_to_image_pair(pair_id)
        inliers = geometry.inlier_matches
        matched[ids[0]][inliers[:, 0]] = True
        matched[ids[1]][inliers[:, 1]] = True
        if len(inliers) >= MIN_INLIERS:
            usable.append((ids, geometry))
    usable.sort(key=lambda item: item[0])
    posed = [item for item in usable if item[1].cam2_from_cam1 is not None]
    usable = posed or usable
    refit = cameras is not None
    measured = dict(cameras) if refit else known
    pairs: list[PairEvidence] = []
    for ids, geometry in _selection(usable, MAX_REFITTED_PAIRS if refit else max_pairs):
        views = [measured[images[image_id].camera_id] for image_id in ids]
        inliers = geometry.inlier_matches
        points = [keypoints[ids[side]][inliers[:, side]] for side in (0, 1)]
        pair = _measure(ids, points, views, None if refit else geometry)
        if pair is not None and pair.parallax <= MAX_PARALLAX:
            pairs.append(pair)
    return Evidence(
        num_images=len(images),
        pairs=tuple(pairs),
        matched={image_id: int(matched[image_id].sum()) for image_id in sorted(matched)},
        cameras=measured,
    )


def _measure(
    ids: tuple[int, int],
    points: Sequence[NDArray[np.float64]],
    cameras: Sequence[pycolmap.Camera],
    geometry: pycolmap.TwoViewGeometry | None,
) -> PairEvidence | None:
    """Return the pair's motion, taken from the record or fitted where the record has none."""
    if geometry is not None and geometry.cam2_from_cam1 is not None and geometry.H is not None:
        pose, homography = geometry.cam2_from_cam1, geometry.H
    else:
        fit = fit_pair(points[0], points[1], cameras[0], cameras[1], max_sample=_MAX_SAMPLE)
        pose, homography = fit.cam1_from_cam0, fit.H
    if pose is None:
        return None
    rotation = np.asarray(pose.rotation.matrix(), np.float64)
    direction = np.asarray(pose.translation, np.float64)
    length = float(np.linalg.norm(direction))
    normalized = [
        np.asarray(camera.cam_from_img(xy), np.float64)
        for xy, camera in zip(points, cameras, strict=True)
    ]
    rays0, rays1 = (_rays(xy) for xy in normalized)
    cosine = np.einsum("ni,ni->n", rays0 @ rotation.T, rays1)
    angles = np.degrees(np.arccos(np.clip(cosine[np.isfinite(cosine)], -1.0, 1.0)))
    sample = np.linspace(0, len(points[0]) - 1, min(_MAX_SAMPLE, len(points[0]))).astype(int)
    return PairEvidence(
        image0=ids[0],
        image1=ids[1],
        num_inliers=len(points[0]),
        rotation=rotation,
        direction=direction / length if length > 0 else direction,
        parallax=float(np.median(angles)) if len(angles) else 0.0,
        displacement=float(np.median(np.linalg.norm(points[1] - points[0], axis=1))),
        homography_ratio=_homography_ratio(points, homography),
        stretch=_stretch(homography, cameras),
        normalized=(normalized[0][sample], normalized[1][sample]),
    )


def _homography_ratio(
    points: Sequence[NDArray[np.float64]], H: NDArray[np.float64] | None
) -> float:
    return 0.0 if H is None else float((homography_error(points[0], points[1], H) <= 16.0).mean())


def _stretch(H: NDArray[np.float64] | None, cameras: Sequence[pycolmap.Camera]) -> float:
    if H is None:
        return np.inf
    K0, K1 = (np.asarray(camera.calibration_matrix(), np.float64) for camera in cameras)
    singular = np.linalg.svd(np.linalg.inv(K1) @ H @ K0, compute_uv=False)
    return float(singular[0] / singular[2] - 1.0) if singular[2] > 0 else np.inf


def _cross(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) matrix of the cross product with a vector."""
    return np.cross(np.eye(3), vector)


def _rays(normalized: NDArray[np.float64]) -> NDArray[np.float64]:
    rays = np.hstack([normalized, np.ones((len(normalized), 1))])
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _selection(items: Sequence[_Item], count: int) -> Sequence[_Item]:
    """Take ``count`` items at random, one from each of as many equal parts.

    At equal distances they would all have the same gap: every frame has as many pairs as the next.
    """
    if len(items) <= count:
        return items
    bounds = np.linspace(0, len(items), count + 1).astype(int)
    return [items[index] for index in np.random.default_rng(0).integers(bounds[:-1], bounds[1:])]


def _by_strength(pair: PairEvidence) -> tuple[float, int, int]:
    return -pair.strength, pair.image0, pair.image1
