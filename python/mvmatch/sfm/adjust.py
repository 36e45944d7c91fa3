"""Final bundle adjustment with a robust loss, and what becomes of the camera in it.

Points carried over many frames have heavy-tailed errors, which a Cauchy loss weighs down; its scale
is chosen in docs/decisions/0014-tight-bounds-tight-loss.md. The camera is refined here, on the
whole model, and never before: refining it from the first pair on collapses such databases to two
images.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    import pycolmap

    from mvmatch.sfm.options import MapperOptions

_logger = logging.getLogger(__name__)

MIN_ERROR = 0.01
"""px; no loss is tighter, however exact the points are."""

ROBUST_TOLERANCE = 1e-4
"""Relative change of the cost at which the robust adjustment ends. Measured: a third of the rounds
that 1e-6 takes, and the same path."""

FIT_RADIUS = 1e6
"""Trust region that fits begin with. A drive straight ahead hardly tells a longer focal length from
a longer way: from COLMAP's 1e4 the first step along that valley is so short that it passes for the
end of it."""

FOCAL_RATIOS = (0.3, 10.0)
"""Focal lengths over the longer side of the picture that lenses have: 118 degrees to 6 of view.
Too few points in too few images ask for any, mostly for shorter ones."""

SETTLED = 0.003
"""Relative change of a focal length at which fits of it are over."""

MAX_FITS = 6
"""Of focal length and distortion together."""


def adjust(model: pycolmap.Reconstruction, options: MapperOptions) -> None:
    """Adjust poses and points in place, with a robust loss and the intrinsics held."""
    import pycolmap

    _solve(model, _robust(_loss_scale(model, options)))
    # COLMAP's residual of a point behind the camera is zero: nothing in the solver keeps it out.
    pycolmap.ObservationManager(model).filter_observations_with_negative_depth()
    model.update_point_3d_errors()


def fit_squares(
    model: pycolmap.Reconstruction, refine: Literal["nothing", "focal length", "intrinsics"]
) -> float:
    """Adjust poses, points and what is asked of the camera in place, by plain least squares.

    A camera is always fitted without a robust loss: near points move fast, have the larger errors,
    and are the ones that know the focal length.

    Returns
    -------
    float
        Final cost: half the sum of the squared residuals, px^2.
    """
    adjustment = _adjustment()
    adjustment.ceres.solver_options.initial_trust_region_radius = FIT_RADIUS
    adjustment.refine_focal_length = refine != "nothing"
    adjustment.refine_extra_params = refine == "intrinsics"
    return _solve(model, adjustment)


def adjust_known_camera(
    model: pycolmap.Reconstruction, options: MapperOptions
) -> pycolmap.Reconstruction:
    """Adjust a model whose camera was given, and correct the focal length if the model insists.

    A calibration is kept to the letter unless another focal length takes away errors of
    ``options.min_focal_error``: smaller gains also come from errors of the tracks, which lean the
    same way in all frames. Changes below ``options.focal_tolerance`` are not worth it, changes
    above ``options.max_focal_change`` are not believed.

    Returns
    -------
    pycolmap.Reconstruction
        The adjusted model; the given one is changed as well.
    """
    import pycolmap

    free = pycolmap.Reconstruction(model)
    for camera in free.cameras.values():
        _tie_focal_lengths(camera)
    error = fit_focal_length(free)
    change = focal_change(model, free)
    _logger.info(
        "a focal length changed by %.2f %% takes away errors of %.3f px", 100 * change, error
    )
    insists = error >= options.min_focal_error
    if not insists or not options.focal_tolerance < change <= options.max_focal_change:
        adjust(model, options)
        return model
    for key, camera in free.cameras.items():
        _untie_focal_lengths(camera, model.cameras[key])
    adjust(free, options)
    return free


def adjust_unknown_camera(
    model: pycolmap.Reconstruction, options: MapperOptions
) -> pycolmap.Reconstruction:
    """Return the model adjusted with the focal length that fits, and distortion if it is needed.

    A drive straight ahead hardly tells distortion from a shorter focal length, and small errors
    that lean the same way in all frames then bend the camera. So distortion stays as it is unless
    refining it takes away a share of ``options.min_distortion_gain`` of the squared errors. A
    focal length that no lens has is not believed: the model keeps the one it was mapped with.
    """
    import pycolmap

    chosen = pycolmap.Reconstruction(model)
    cost = fit_squares(chosen, "focal length")
    if is_bogus(chosen):
        adjust(model, options)
        return model
    bent = pycolmap.Reconstruction(chosen)
    gain = 1.0 - fit_intrinsics(bent) / max(cost, np.finfo(float).tiny)
    _logger.info("refined distortion takes away %.2f %% of the squared errors", 100 * gain)
    if gain >= options.min_distortion_gain and not is_bogus(bent):
        chosen = bent
    adjust(chosen, options)
    return chosen


def is_bogus(model: pycolmap.Reconstruction) -> bool:
    """Return whether a camera has a focal length or a distortion that no lens has."""
    bounds = *FOCAL_RATIOS, 1.0
    return any(camera.has_bogus_params(*bounds) for camera in model.cameras.values())


def fit_focal_length(model: pycolmap.Reconstruction) -> float:
    """Fit the focal length in place, with poses and points, by plain least squares.

    Returns
    -------
    float
        px; root mean square of the errors that another focal length takes away.
    """
    cost = fit_squares(model, "nothing")
    saved = max(0.0, cost - fit_squares(model, "focal length"))
    return math.sqrt(2.0 * saved / max(1, model.compute_num_observations()))


def fit_intrinsics(model: pycolmap.Reconstruction) -> float:
    """Fit focal length and distortion in place until the focal length stays; see `fit_squares`.

    The way from a camera without distortion is long and narrow: one fit may end half-way.
    """
    import pycolmap

    cost = 0.0
    for _ in range(MAX_FITS):
        before = pycolmap.Reconstruction(model)
        cost = fit_squares(model, "intrinsics")
        change = focal_change(before, model)
        _logger.info("focal length and distortion refined: changed by %.2f %%", 100 * change)
        if change < SETTLED:
            break
    return cost


def focal_change(before: pycolmap.Reconstruction, after: pycolmap.Reconstruction) -> float:
    """Return the largest relative change of a focal length between two states of a model."""
    return max(
        abs(camera.mean_focal_length() / before.cameras[key].mean_focal_length() - 1.0)
        for key, camera in after.cameras.items()
    )


def _tie_focal_lengths(camera: pycolmap.Camera) -> None:
    """Make one focal length of two equal ones: alone, the vertical one drifts."""
    import pycolmap

    if camera.model_name == "PINHOLE" and camera.focal_length_x == camera.focal_length_y:
        focal, _, x, y = camera.params
        camera.model = pycolmap.CameraModelId.SIMPLE_PINHOLE
        camera.params = [focal, x, y]


def _untie_focal_lengths(camera: pycolmap.Camera, given: pycolmap.Camera) -> None:
    if camera.model_name != given.model_name:
        focal, x, y = camera.params
        camera.model = given.model
        camera.params = [focal, focal, x, y]


def _loss_scale(model: pycolmap.Reconstruction, options: MapperOptions) -> float:
    """Scale of the loss, px: how exact tracks are differs by footage, encoder and method."""
    model.update_point_3d_errors()
    errors = [point.error for point in model.points3D.values()]
    return options.loss_scale * max(float(np.median(errors)) if errors else 0.0, MIN_ERROR)


def _solve(model: pycolmap.Reconstruction, adjustment: pycolmap.BundleAdjustmentOptions) -> float:
    """Adjust all registered images, the gauge held by two of them, and return the final cost.

    ``pycolmap.bundle_adjustment`` would do, but it turns COLMAP's logging back on.
    """
    import pycolmap

    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.reg_image_ids():
        config.add_image(image_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(adjustment, config, model)
    summary = adjuster.solve()
    if not isinstance(summary, pycolmap.CeresBundleAdjustmentSummary):
        return 0.0  # nothing to adjust: the solver was not asked
    return float(summary.ceres_summary.final_cost)


def _robust(loss_scale: float) -> pycolmap.BundleAdjustmentOptions:
    """Of poses and points; ``loss_scale`` in px, 0 for plain least squares."""
    import pycolmap

    adjustment = _adjustment()
    if loss_scale > 0:
        adjustment.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
        adjustment.ceres.loss_function_scale = loss_scale
    adjustment.ceres.solver_options.function_tolerance = ROBUST_TOLERANCE
    return adjustment


def _adjustment() -> pycolmap.BundleAdjustmentOptions:
    import pycolmap

    adjustment = pycolmap.BundleAdjustmentOptions()
    adjustment.print_summary = False
    adjustment.refine_focal_length = False
    adjustment.refine_principal_point = False
    adjustment.refine_extra_params = False
    ceres = adjustment.ceres
    ceres.use_gpu = False
    # Images of a video share points with their neighbours only: factors stay sparse at any length.
    ceres.max_num_images_direct_sparse_cpu_solver = 1_000_000
    ceres.solver_options.num_threads = 1
    ceres.solver_options.max_num_iterations = 50
    ceres.solver_options.function_tolerance = 1e-6
    return adjustment
