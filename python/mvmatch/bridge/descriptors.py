"""Features of single pictures and their matches, by pycolmap."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import ThreadpoolController

from mvmatch.colmap_log import quiet_colmap
from mvmatch.errors import UnsupportedError
from mvmatch.geometry.two_view import fit_pair

if TYPE_CHECKING:
    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.bridge.loops import LoopOptions
    from mvmatch.bridge.options import BridgeOptions


@dataclass(frozen=True, kw_only=True, eq=False)
class Features:
    """Features of one picture."""

    xy: NDArray[np.float32]
    """(K, 2) px of the picture, COLMAP origin."""
    keypoints: pycolmap.FeatureKeypoints
    descriptors: pycolmap.FeatureDescriptors

    @cached_property
    def directions(self) -> NDArray[np.float32]:
        """(K, D) descriptors of length 1."""
        import pycolmap

        is_sift = self.descriptors.type == pycolmap.FeatureExtractorType.SIFT
        data = self.descriptors.data if is_sift else self.descriptors.to_float().data
        values = np.asarray(data, np.float32)
        return values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1e-6)


class DescriptorMatcher:
    """Extracts and matches on one thread, so that results repeat.

    Raises
    ------
    UnsupportedError
        The matcher does not work with the installed pycolmap.
    """

    def __init__(self, options: BridgeOptions | LoopOptions, camera: pycolmap.Camera) -> None:
        self._options, self._camera = options, camera
        self._extractor, self._matcher = _engines(options.matcher, options.max_num_features)
        self._blas = ThreadpoolController()

    def extract(self, luma: NDArray[np.uint8]) -> Features:
        """Features of a picture, (H, W) grey values."""
        keypoints, descriptors = self._extractor.extract_from_uint8_array(luma)
        xy = np.array([(each.x, each.y) for each in keypoints], np.float32).reshape(-1, 2)
        return Features(xy=xy, keypoints=keypoints, descriptors=descriptors)

    def match(self, first: Features, second: Features) -> NDArray[np.uint32]:
        """(M, 2) numbers of features that match and keep to a camera motion; none if few do."""
        if self._matcher is None:
            with self._blas.limit(limits=1, user_api="blas"):
                matches = mutual_matches(first.directions, second.directions)
        else:
            matches = self._matcher.match(
                first.keypoints, first.descriptors, second.keypoints, second.descriptors
            )
        points = first.xy[matches[:, 0]], second.xy[matches[:, 1]]
        fit = fit_pair(*points, self._camera, self._camera, options=self._options.ransac)
        inliers = matches[fit.inliers]
        return inliers if len(inliers) >= self._options.min_inliers else inliers[:0]


def require_matcher(name: str) -> None:
    """Make sure that a matcher is there, before minutes are spent on what comes before it.

    Parameters
    ----------
    name : str
        ``sift``, ``aliked``, or ``none``, which is always there.

    Raises
    ------
    UnsupportedError
        The matcher does not work with the installed pycolmap.
    """
    if name != "none":
        _engines(name, 1)


def _engines(
    name: str, max_num_features: int
) -> tuple[pycolmap.FeatureExtractor, pycolmap.FeatureMatcher | None]:
    """Return what extracts and what matches; None: :func:`mutual_matches` does."""
    import pycolmap

    sift = name == "sift"
    extractors, matchers = pycolmap.FeatureExtractorType, pycolmap.FeatureMatcherType
    extraction = pycolmap.FeatureExtractionOptions(
        extractors.SIFT if sift else extractors.ALIKED_N16ROT
    )
    extraction.num_threads = 1
    extraction.use_gpu = False
    extraction.sift.max_num_features = max_num_features
    # Neighbouring pictures show things alike: no need to double them for the finest scale.
    extraction.sift.first_octave = 0
    matching = pycolmap.FeatureMatchingOptions(matchers.ALIKED_LIGHTGLUE)
    matching.num_threads = 1
    matching.use_gpu = False
    cpu = pycolmap.Device.cpu
    try:
        with quiet_colmap():
            extractor = pycolmap.FeatureExtractor.create(extraction, cpu)
            return extractor, None if sift else pycolmap.FeatureMatcher.create(matching, cpu)
    except RuntimeError as error:
        message = (
            f"pycolmap cannot match with {name} here: {error} "
            "Use sift, or install a pycolmap that has it"
        )
        raise UnsupportedError(message) from error


def mutual_matches(
    first: NDArray[np.float32],
    second: NDArray[np.float32],
    *,
    max_ratio: float = 0.8,
    max_distance: float = 0.7,
) -> NDArray[np.uint32]:
    """Match descriptors that are each other's nearest, and much nearer than any other.

    The rule and the bounds are COLMAP's (``SiftMatchingOptions``), whose own search takes ten times
    as long for one pair of pictures.

    Parameters
    ----------
    first, second : (K, D) float32
        Descriptors of length 1.
    max_ratio : float
        Of the distance to the nearest and that to the next, both ways.
    max_distance : float
        Radians.

    Returns
    -------
    (M, 2) uint32
        Numbers of the descriptors, in the order of the first.
    """
    if min(len(first), len(second)) < 2:
        return np.empty((0, 2), np.uint32)
    alike = first @ second.T
    there, is_clear = _nearest(alike, max_ratio, max_distance)
    here = np.flatnonzero(is_clear)
    there = there[here]
    back, is_clear_back = _nearest(np.ascontiguousarray(alike[:, there].T), max_ratio, max_distance)
    kept = is_clear_back & (back == here)
    return np.column_stack([here[kept], there[kept]]).astype(np.uint32)


def _nearest(
    alike: NDArray[np.float32], max_ratio: float, max_distance: float
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Column of the largest cosine of each row, and whether it stands out."""
    rows, nearest = np.arange(len(alike)), alike.argmax(axis=1)
    best = alike[rows, nearest]
    alike[rows, nearest] = -1.0
    next_best = alike.max(axis=1, initial=-1.0)
    alike[rows, nearest] = best
    distance, next_distance = (np.arccos(np.clip(each, -1.0, 1.0)) for each in (best, next_best))
    return nearest, (distance <= max_distance) & (distance < max_ratio * next_distance)
