"""SIFT with sequential matching through pycolmap: the method to beat."""

# pyright: reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from mvmatch.baselines.images import list_images
from mvmatch.geometry.two_view import RansacOptions, colmap_ransac

if TYPE_CHECKING:
    from pathlib import Path

    import pycolmap


@dataclass(frozen=True, kw_only=True)
class SiftOptions:
    """Settings of extraction and matching; COLMAP's defaults where they are its defaults."""

    max_num_features: int = 8192
    """Per image (COLMAP's default)."""
    overlap: int = 10
    """Images that each image is matched with (COLMAP's default)."""
    quadratic_overlap: bool = True
    """Match with the images 1, 2, 4, 8 ... away as well (COLMAP's default)."""
    num_threads: int = 1
    """Of extraction and matching; 1 makes CPU time comparable and the result repeatable, -1 takes
    one per processor."""
    ransac: RansacOptions = field(default_factory=RansacOptions)
    """Verification, with the settings of every other method."""


def match_sift(
    folder: Path,
    database: Path,
    *,
    camera: pycolmap.Camera | None,
    max_frames: int | None = None,
    options: SiftOptions | None = None,
) -> None:
    """Extract SIFT features of a folder's images, match neighbours, verify, write a database.

    Parameters
    ----------
    folder : Path
        Frames whose names sort in display order.
    database : Path
        New COLMAP database; an existing one is replaced.
    camera : pycolmap.Camera or None
        The one camera; None for COLMAP's prior, 1.2 times the longer side as focal length.
    max_frames : int, optional
        Use only the first frames.
    options : SiftOptions
        Settings.

    Raises
    ------
    DataError
        The folder holds fewer than two images.
    """
    import pycolmap

    options = options or SiftOptions()
    names = [path.name for path in list_images(folder, max_frames)]
    database.unlink(missing_ok=True)
    reader = pycolmap.ImageReaderOptions()
    if camera is not None:
        reader.camera_model = camera.model_name
        reader.camera_params = camera.params_to_string()
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.num_threads = options.num_threads
    extraction.use_gpu = False
    extraction.sift.max_num_features = options.max_num_features
    pycolmap.extract_features(
        database,
        folder,
        image_names=names,
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=reader,
        extraction_options=extraction,
        device=pycolmap.Device.cpu,
    )
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap = options.overlap
    pairing.quadratic_overlap = options.quadratic_overlap
    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads = options.num_threads
    matching.use_gpu = False
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac = colmap_ransac(options.ransac)
    pycolmap.match_sequential(
        database,
        matching_options=matching,
        pairing_options=pairing,
        verification_options=verification,
        device=pycolmap.Device.cpu,
    )
