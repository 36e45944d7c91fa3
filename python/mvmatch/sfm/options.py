"""Options of mapping, and how they become COLMAP's."""

# pyright: reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from mvmatch.sfm.checks import AcceptanceOptions
from mvmatch.sfm.keyframes import KeyframeOptions
from mvmatch.sfm.localize import LocalizeOptions

if TYPE_CHECKING:
    import pycolmap

    from mvmatch.sfm.evidence import PairEvidence


@dataclass(frozen=True, kw_only=True)
class MapperOptions:
    """How a database becomes a model."""

    mapper: Literal["incremental", "global"] = "incremental"
    """COLMAP's mapper to use first; the other one follows when no attempt is accepted."""
    intrinsics: Literal["auto", "fixed", "refine"] = "auto"
    """``fixed`` keeps the camera to the letter. ``refine`` maps with it fixed, refines the focal
    length on the whole model, and maps again; distortion follows where it is needed. ``auto``
    refines a camera that is only a prior, and corrects the focal length of a given one if the model
    contradicts it."""
    min_focal_error: float = 0.02
    """px; root mean square of the errors that a corrected focal length must take away (``auto``).
    Measured: 0.035 and more where the calibration is wrong, at most 0.025 where it is exact."""
    focal_tolerance: float = 0.01
    """Relative change of a given focal length below which it is kept (``auto``): calibrations are
    that exact, and errors of tracks, which lean the same way in all frames, ask for as much."""
    max_focal_change: float = 0.05
    """Relative change of a given focal length above which the change is not believed."""
    min_distortion_gain: float = 0.03
    """Share of the squared errors that refined distortion must take away. Measured: 0.18 and more
    where the lens distorts, at most 0.007 where it does not."""
    max_attempts: int = 4
    """Attempts of the first mapper, each from another initial pair."""
    max_refinements: int = 3
    """Rounds of mapping and refining the camera, at most."""
    loss_scale: float = 1.0
    """Scale of the Cauchy loss of the last bundle adjustment, in units of the median reprojection
    error that the mapper leaves; 0 leaves the loss out."""
    fallback: bool = True
    """Try the other mapper when every attempt of the first was rejected."""
    seed: int = 0
    """Of every random choice; the mappers run on one thread so that results repeat."""
    keyframes: KeyframeOptions = field(default_factory=KeyframeOptions)
    """Which images of a long video are mapped."""
    localize: LocalizeOptions = field(default_factory=LocalizeOptions)
    """When one of the others gets a pose."""
    acceptance: AcceptanceOptions = field(default_factory=AcceptanceOptions)
    """What a model must keep."""


def incremental_options(
    options: MapperOptions, initial: PairEvidence | None
) -> pycolmap.IncrementalPipelineOptions:
    """COLMAP's options for video: small baselines, forward motion, intrinsics fixed.

    Parameters
    ----------
    options : MapperOptions
        The seed is taken from it.
    initial : PairEvidence or None
        The pair to start from; None lets COLMAP choose.
    """
    import pycolmap

    pipeline = pycolmap.IncrementalPipelineOptions()
    pipeline.multiple_models = False
    pipeline.extract_colors = False
    pipeline.num_threads = 1
    pipeline.random_seed = options.seed
    pipeline.min_model_size = 2
    # A given pair that fails once fails again; the default repeats it 200 times.
    pipeline.init_num_trials = 2
    # All is adjusted anew at each half more images or points instead of each tenth, and each image
    # with its neighbours once instead of twice: the same models for two thirds of the time.
    pipeline.ba_global_frames_ratio = 1.5
    pipeline.ba_global_points_ratio = 1.5
    pipeline.ba_local_max_refinements = 1
    pipeline.ba_refine_focal_length = False
    pipeline.ba_refine_principal_point = False
    pipeline.ba_refine_extra_params = False
    mapper = pipeline.mapper
    mapper.random_seed = options.seed
    mapper.num_threads = 1
    mapper.abs_pose_refine_focal_length = False
    mapper.abs_pose_refine_extra_params = False
    # Driving forward is the normal case of video, and 16 degrees between frames are not.
    mapper.init_max_forward_motion = 1.0
    mapper.init_min_tri_angle = 2.0
    mapper.ba_global_ignore_redundant_points3D = True
    mapper.ba_local_min_tri_angle = 2.0
    pipeline.triangulation.random_seed = options.seed
    if initial is not None:
        pipeline.init_image_id1 = initial.image0
        pipeline.init_image_id2 = initial.image1
        # The pair was chosen as the best there is: its own angle is the bound.
        mapper.init_min_tri_angle = min(2.0, 0.5 * initial.parallax)
    return pipeline


def global_options(options: MapperOptions) -> pycolmap.GlobalPipelineOptions:
    """COLMAP's options of the global mapper, intrinsics fixed."""
    import pycolmap

    pipeline = pycolmap.GlobalPipelineOptions()
    pipeline.multiple_models = False
    pipeline.num_threads = 1
    pipeline.random_seed = options.seed
    mapper = pipeline.mapper
    mapper.num_threads = 1
    mapper.random_seed = options.seed
    mapper.rotation_averaging.random_seed = options.seed
    mapper.global_positioning.random_seed = options.seed
    mapper.global_positioning.use_gpu = False
    mapper.retriangulation.random_seed = options.seed
    adjustment = mapper.bundle_adjustment
    adjustment.refine_focal_length = False
    adjustment.refine_extra_params = False
    adjustment.refine_principal_point = False
    adjustment.ceres.use_gpu = False
    adjustment.ceres.solver_options.num_threads = 1
    return pipeline
