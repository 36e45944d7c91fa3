"""SIFT with sequential matching through pycolmap: the method to beat."""

# pyright: reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

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
    pairing: Literal["sequential", "exhaustive"] = "sequential"
    """``exhaustive`` matches every image with every other; ``overlap`` says nothing then."""
    overlap: int = 10
    """Images that each image is matched with (COLMAP's default)."""
    quadratic_overlap: bool = True
    """Match with the images 1, 2, 4, 8 ... away as well (COLMAP's default)."""
    num_threads: int = 1
    """Of extraction and matching; 1 makes CPU time comparable and the result repeatable, -1 takes
    one per processor."""
    verify: bool = True
    """Let COLMAP verify what it matches; without it the database holds matches alone."""
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
    options = options or SiftOptions()
    extract_sift(folder, database, camera=camera, max_frames=max_frames, options=options)
    match_features(database, options=options)


def extract_sift(
    folder: Path,
    database: Path,
    *,
    camera: pycolmap.Camera | None,
    max_frames: int | None = None,
    options: SiftOptions,
) -> None:
    """Do the first half of :func:`match_sift`: features in a new database."""
    import pycolmap

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


def match_features(database: Path, *, options: SiftOptions) -> None:
    """Do the second half of :func:`match_sift`: match the features of a database."""
    import pycolmap

    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads = options.num_threads
    matching.use_gpu = False
    matching.skip_geometric_verification = not options.verify
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac = colmap_ransac(options.ransac)
    if options.pairing == "exhaustive":
        pycolmap.match_exhaustive(
            database,
            matching_options=matching,
            verification_options=verification,
            device=pycolmap.Device.cpu,
        )
        return
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap = options.overlap
    pairing.quadratic_overlap = options.quadratic_overlap
    pycolmap.match_sequential(
        database,
        matching_options=matching,
        pairing_options=pairing,
        verification_options=verification,
        device=pycolmap.Device.cpu,
    )
