"""Features of single pictures and their matches, by pycolmap."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import dataclasses
import errno
import os
import tempfile
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import ThreadpoolController

from mvmatch.colmap_log import quiet_colmap
from mvmatch.errors import UnsupportedError
from mvmatch.geometry.two_view import fit_pair

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.bridge.loops import LoopOptions
    from mvmatch.bridge.options import BridgeOptions


BATCH = 8
"""Pictures whose features are extracted together."""

MAX_SIDE = 1 << 16
"""px; COLMAP would make larger pictures smaller."""

MAX_WORKERS = 4
"""Pairs of pictures that are matched at a time, at most."""

ROWS = 256
"""Descriptors that are compared with all others together: their cosines stay in the cache."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Features:
    """Features of one picture."""

    xy: NDArray[np.float32]
    """(K, 2) px of the picture, COLMAP origin."""
    keypoints: pycolmap.FeatureKeypoints | None
    """For a network; None where there is none."""
    descriptors: pycolmap.FeatureDescriptors
    chosen: NDArray[np.int64]
    """(C,) numbers of those that are matched; with a network all are."""

    def only(self, chosen: NDArray[np.int64]) -> Features:
        """Choose which of them are matched."""
        return dataclasses.replace(self, chosen=chosen)

    @cached_property
    def directions(self) -> NDArray[np.float32]:
        """(C, D) descriptors of length 1 of the chosen ones."""
        import pycolmap

        is_sift = self.descriptors.type == pycolmap.FeatureExtractorType.SIFT
        data = self.descriptors.data if is_sift else self.descriptors.to_float().data
        values = np.asarray(data[self.chosen], np.float32)
        return values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1e-6)


class DescriptorMatcher:
    """Extracts and matches, each picture and each pair on one thread, so that results repeat.

    Raises
    ------
    UnsupportedError
        The matcher does not work with the installed pycolmap.
    """

    def __init__(self, options: BridgeOptions | LoopOptions, camera: pycolmap.Camera) -> None:
        self._options, self._camera = options, camera
        self._network = None
        self._extraction = _extraction(options.matcher, options.max_num_features)
        if options.matcher != "sift":
            self._network = _network(options.matcher, self._extraction)
        self._blas = ThreadpoolController()

    def extract(self, pictures: Iterable[NDArray[np.uint8]]) -> Iterator[Features]:
        """Yield the features of each picture, (H, W) grey values.

        SIFT takes :data:`BATCH` of them at a time, and the next ones while these are matched.
        """
        if self._network is not None:
            yield from (_extract(luma, self._network[0]) for luma in pictures)
            return
        remaining = iter(pictures)
        # Around the thread: two that set and restore COLMAP's level would cross.
        with quiet_colmap(), ThreadPoolExecutor(1) as pool:
            ahead: Future[list[Features]] | None = None
            while batch := list(islice(remaining, BATCH)):
                following = pool.submit(self._extract_sift, batch)
                yield from ahead.result() if ahead else ()
                ahead = following
            yield from ahead.result() if ahead else ()

    def _extract_sift(self, pictures: Sequence[NDArray[np.uint8]]) -> list[Features]:
        """Extract on all processors; features of a picture do not depend on their number."""
        bound = self._options.max_image_size
        times = [min(-(-max(luma.shape) // bound), *luma.shape) for luma in pictures]
        small = [_shrunk(luma, each) for luma, each in zip(pictures, times, strict=True)]
        found = _sift(small, self._extraction)
        return [
            Features(
                xy=np.asarray(xy * each, np.float32),
                keypoints=None,
                descriptors=descriptors,
                chosen=np.arange(len(xy)),
            )
            for each, (xy, descriptors) in zip(times, found, strict=True)
        ]

    def match(self, pairs: Sequence[tuple[Features, Features]]) -> list[NDArray[np.uint32]]:
        """Match pairs of pictures.

        Returns
        -------
        list of (M, 2) uint32
            Numbers of features that match and keep to a camera motion; none if few do.
        """
        # What matches with a network has threads of its own.
        workers = 1 if self._network is not None else min(MAX_WORKERS, os.cpu_count() or 1)
        one_each = self._blas.limit(limits=1, user_api="blas")
        with one_each, ThreadPoolExecutor(workers) as pool:
            return list(pool.map(self._match, *zip(*pairs, strict=True))) if pairs else []

    def _match(self, first: Features, second: Features) -> NDArray[np.uint32]:
        if self._network is None:
            alike = mutual_matches(first.directions, second.directions)
            matches = np.column_stack([first.chosen[alike[:, 0]], second.chosen[alike[:, 1]]])
        else:
            assert first.keypoints is not None
            assert second.keypoints is not None
            matches = self._network[1].match(
                first.keypoints, first.descriptors, second.keypoints, second.descriptors
            )
        points = first.xy[matches[:, 0]], second.xy[matches[:, 1]]
        fit = fit_pair(*points, self._camera, self._camera, options=self._options.ransac)
        inliers = matches[fit.inliers].astype(np.uint32)
        return inliers if len(inliers) >= self._options.min_inliers else inliers[:0]


def require_matcher(name: str) -> None:
    """Make sure that a matcher is there, before minutes are spent on what comes before it.

    Parameters
    ----------
    name : str
        ``sift``, ``aliked``, or ``none``; the first and the last are always there.

    Raises
    ------
    UnsupportedError
        The matcher does not work with the installed pycolmap.
    """
    if name not in {"none", "sift"}:
        _network(name, _extraction(name, 1))


def _extraction(name: str, max_num_features: int) -> pycolmap.FeatureExtractionOptions:
    import pycolmap

    extractors = pycolmap.FeatureExtractorType
    extraction = pycolmap.FeatureExtractionOptions(
        extractors.SIFT if name == "sift" else extractors.ALIKED_N16ROT
    )
    extraction.use_gpu = False
    extraction.max_image_size = MAX_SIDE
    extraction.sift.max_num_features = max_num_features
    # Neighbouring pictures show things alike: no need to double them for the finest scale.
    extraction.sift.first_octave = 0
    # Second orientations of a place rarely match, and take a tenth of the time.
    extraction.sift.max_num_orientations = 1
    return extraction


def _network(
    name: str, extraction: pycolmap.FeatureExtractionOptions
) -> tuple[pycolmap.FeatureExtractor, pycolmap.FeatureMatcher]:
    """Return what extracts and what matches."""
    import pycolmap

    extraction.num_threads = 1
    matching = pycolmap.FeatureMatchingOptions(pycolmap.FeatureMatcherType.ALIKED_LIGHTGLUE)
    matching.num_threads = 1
    matching.use_gpu = False
    cpu = pycolmap.Device.cpu
    try:
        with quiet_colmap():
            extractor = pycolmap.FeatureExtractor.create(extraction, cpu)
            return extractor, pycolmap.FeatureMatcher.create(matching, cpu)
    except RuntimeError as error:
        message = (
            f"pycolmap cannot match with {name} here: {error} "
            "Use sift, or install a pycolmap that has it"
        )
        raise UnsupportedError(message) from error


def _extract(luma: NDArray[np.uint8], extractor: pycolmap.FeatureExtractor) -> Features:
    keypoints, descriptors = extractor.extract_from_uint8_array(luma)
    xy = np.array([(each.x, each.y) for each in keypoints], np.float32).reshape(-1, 2)
    every = np.arange(len(xy))
    return Features(xy=xy, keypoints=keypoints, descriptors=descriptors, chosen=every)


def _sift(
    pictures: Sequence[NDArray[np.uint8]], extraction: pycolmap.FeatureExtractionOptions
) -> list[tuple[NDArray[np.float32], pycolmap.FeatureDescriptors]]:
    """Return (K, 2) positions and descriptors of the features of each picture.

    pycolmap uses all processors for files alone: from arrays it extracts one after the other.
    """
    import pycolmap

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for index, luma in enumerate(pictures):
            # Not compressed: that takes as long as extracting.
            if not pycolmap.Bitmap.from_array(luma).write(folder / f"{index:03d}.bmp"):
                raise OSError(errno.EIO, "A picture could not be written", name)
        database = folder / "features.db"
        pycolmap.extract_features(
            database,
            folder,
            camera_mode=pycolmap.CameraMode.PER_IMAGE,
            extraction_options=extraction,
            device=pycolmap.Device.cpu,
        )
        with pycolmap.Database.open(database) as found:
            images = sorted(found.read_all_images(), key=lambda each: each.name)
            return [
                (
                    found.read_keypoints(image.image_id)[:, :2],
                    found.read_descriptors(image.image_id),
                )
                for image in images
            ]


def _shrunk(luma: NDArray[np.uint8], times: int) -> NDArray[np.uint8]:
    """Return the means of so many by so many px; what is left over at the ends is cut off."""
    if times == 1:
        return luma
    height, width = (side // times for side in luma.shape)
    whole = luma[: height * times, : width * times]
    steps = range(times)
    total = sum(whole[y::times, x::times].astype(np.uint32) for y in steps for x in steps)
    return np.asarray((total + times**2 // 2) // times**2, np.uint8)


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
    there, is_clear = _nearest(first, second, max_ratio, max_distance)
    here = np.flatnonzero(is_clear)
    there = there[here]
    back, is_clear_back = _nearest(second[there], first, max_ratio, max_distance)
    kept = is_clear_back & (back == here)
    return np.column_stack([here[kept], there[kept]]).astype(np.uint32)


def _nearest(
    descriptors: NDArray[np.float32],
    others: NDArray[np.float32],
    max_ratio: float,
    max_distance: float,
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return which other each descriptor is most similar to, and whether that one stands out."""
    nearest = np.empty(len(descriptors), np.int64)
    cosines = np.empty((2, len(descriptors)), np.float32)
    table = np.empty((ROWS, len(others)), np.float32)
    for start in range(0, len(descriptors), ROWS):
        rows = slice(start, start + ROWS)
        every = np.arange(len(descriptors[rows]))
        alike = np.matmul(descriptors[rows], others.T, out=table[: len(every)])
        nearest[rows] = best = alike.argmax(axis=1)
        cosines[0, rows] = alike[every, best]
        alike[every, best] = -1.0
        cosines[1, rows] = alike.max(axis=1, initial=-1.0)
    distance, next_distance = np.arccos(np.clip(cosines, -1.0, 1.0))
    return nearest, (distance <= max_distance) & (distance < max_ratio * next_distance)
