"""Features of single pictures and their matches, by pycolmap."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.colmap_log import quiet_colmap
from mvmatch.errors import UnsupportedError
from mvmatch.geometry.two_view import fit_pair

if TYPE_CHECKING:
    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.bridge.options import BridgeOptions


@dataclass(frozen=True, kw_only=True, eq=False)
class Features:
    """Features of one picture."""

    xy: NDArray[np.float32]
    """(K, 2) px of the picture, COLMAP origin."""
    keypoints: pycolmap.FeatureKeypoints
    descriptors: pycolmap.FeatureDescriptors


class DescriptorMatcher:
    """Extracts and matches on one thread, so that results repeat.

    Raises
    ------
    UnsupportedError
        The matcher does not work with the installed pycolmap.
    """

    def __init__(self, options: BridgeOptions, camera: pycolmap.Camera) -> None:
        import pycolmap

        self._options, self._camera = options, camera
        sift = options.matcher == "sift"
        extractors, matchers = pycolmap.FeatureExtractorType, pycolmap.FeatureMatcherType
        extraction = pycolmap.FeatureExtractionOptions(
            extractors.SIFT if sift else extractors.ALIKED_N16ROT
        )
        extraction.num_threads = 1
        extraction.use_gpu = False
        extraction.sift.max_num_features = options.max_num_features
        # Neighbouring pictures show things alike: no need to double them for the finest scale.
        extraction.sift.first_octave = 0
        matching = pycolmap.FeatureMatchingOptions(
            matchers.SIFT_BRUTEFORCE if sift else matchers.ALIKED_LIGHTGLUE
        )
        matching.num_threads = 1
        matching.use_gpu = False
        matching.sift.cpu_brute_force_matcher = True
        try:
            with quiet_colmap():
                self._extractor = pycolmap.FeatureExtractor.create(extraction, pycolmap.Device.cpu)
                self._matcher = pycolmap.FeatureMatcher.create(matching, pycolmap.Device.cpu)
        except RuntimeError as error:
            message = (
                f"pycolmap cannot match with {options.matcher} here: {error} "
                "Use sift, or install a pycolmap that has it"
            )
            raise UnsupportedError(message) from error

    def extract(self, luma: NDArray[np.uint8]) -> Features:
        """Features of a picture, (H, W) grey values."""
        keypoints, descriptors = self._extractor.extract_from_uint8_array(luma)
        xy = np.array([(each.x, each.y) for each in keypoints], np.float32).reshape(-1, 2)
        return Features(xy=xy, keypoints=keypoints, descriptors=descriptors)

    def match(self, first: Features, second: Features) -> NDArray[np.uint32]:
        """(M, 2) numbers of features that match and keep to a camera motion; none if few do."""
        matches = self._matcher.match(
            first.keypoints, first.descriptors, second.keypoints, second.descriptors
        )
        points = first.xy[matches[:, 0]], second.xy[matches[:, 1]]
        fit = fit_pair(*points, self._camera, self._camera, options=self._options.ransac)
        inliers = matches[fit.inliers]
        return inliers if len(inliers) >= self._options.min_inliers else inliers[:0]
