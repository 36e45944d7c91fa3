"""What a delivered model is worth: its figures, and what becomes of it when points are dropped."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import dataclasses
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mvmatch.bench.cloud import measure_cloud
from mvmatch.bench.mapping import count_points, pose_errors
from mvmatch.bench.store import stored, write_json
from mvmatch.colmap_log import quiet_colmap
from mvmatch.errors import DataError
from mvmatch.measure import StageClock

if TYPE_CHECKING:
    import pycolmap

    from mvmatch.bench.datasets import Sequence
    from mvmatch.bench.matches import Sample
    from mvmatch.bench.sfm_methods import Input, SiftRun, VectorRun

BA_ITERATIONS = 10
"""Of the bundle adjustment that is timed, at most: some models leave no step to take."""


def judge_model(path: Path | None, sequence: Sequence, *, cloud: bool = True) -> dict[str, Any]:
    """Measure a model; None is a refusal.

    Returns
    -------
    dict
        ``points``, ``distinct_points``, ``ate`` ... as of :mod:`mvmatch.bench.mapping`,
        ``observations``, ``track_length``, ``reprojection_px``, ``focal_error_percent`` (NaN
        without a model or where the true one is not known), ``ba_cpu_s``: CPU seconds of an
        iteration of one more bundle adjustment, and ``cloud``: distances of the points to the true
        surfaces, None where these are not known or ``cloud`` is not asked for.
    """
    import pycolmap

    model = None if path is None else pycolmap.Reconstruction(path)
    figures: dict[str, Any] = {**count_points(model), **pose_errors(model, sequence)}
    if model is None:
        unknown = dict.fromkeys(("reprojection_px", "focal_error_percent", "ba_cpu_s"), math.nan)
        return {**figures, **unknown, "observations": 0, "track_length": 0.0, "cloud": None}
    focal = next(iter(model.cameras.values())).mean_focal_length()
    true = sequence.camera.mean_focal_length() if sequence.focal_known else math.nan
    return {
        **figures,
        "observations": model.compute_num_observations(),
        "track_length": model.compute_mean_track_length(),
        "reprojection_px": model.compute_mean_reprojection_error(),
        "focal_error_percent": 100 * abs(focal / true - 1),
        "cloud": _cloud(model, sequence) if cloud else None,
        "ba_cpu_s": _adjustment_seconds(model),  # last: it changes the model
    }


@dataclass(frozen=True, kw_only=True)
class Draws:
    """Models of shares of the points of a run, one file each: they take long together."""

    method: VectorRun | SiftRun
    given: Input
    out: Path
    """Of the run."""
    sequence: Sequence
    store: Path
    """Folder of what is judged already."""
    key: str
    """Digest of everything a draw depends on, but for its number."""

    def judged(self, sample: Sample) -> dict[str, Any]:
        """Map anew from a share of the points, and compare with the true trajectory.

        Returns
        -------
        dict
            ``draw``, ``accepted``, ``registered``, ``ate_percent`` (infinite unless accepted),
            ``reasons``; of the file where there is one.
        """
        path = self.store / f"{sample.seed}.json"
        row = stored(path, self.key)
        if row is None:
            row = {"key": self.key, "error": None, **self._judge(sample)}
            write_json(path, row)
        return {name: value for name, value in row.items() if name not in {"key", "error"}}

    def _judge(self, sample: Sample) -> dict[str, Any]:
        with tempfile.TemporaryDirectory(dir=self.out.parent) as folder:
            model = self.method.resample(self.given, self.out, Path(folder), sample)
        delivered = model.reconstruction if model.accepted else None
        return {
            "draw": sample.seed,
            "accepted": model.accepted,
            "registered": model.registered,
            "ate_percent": pose_errors(delivered, self.sequence)["ate_percent"],
            "reasons": list(model.reasons),
        }


def _cloud(model: pycolmap.Reconstruction, sequence: Sequence) -> dict[str, Any] | None:
    """Return the figures of :mod:`mvmatch.bench.cloud`, m; None where there is no surface."""
    if sequence.truth is None:
        return None
    try:
        quality = measure_cloud(model, sequence)
    except DataError:  # composed sequences have none either, and a camera that stands no scale
        return None
    scores = [dataclasses.asdict(score) | {"f_score": score.f_score} for score in quality.scores]
    derived = {"chamfer": quality.chamfer, "hausdorff_95": quality.hausdorff_95, "scores": scores}
    return dataclasses.asdict(quality) | derived


def _adjustment_seconds(model: pycolmap.Reconstruction) -> float:
    """CPU seconds of an iteration of bundle adjustment on one thread, intrinsics held.

    Zero for a model without observations: COLMAP delivers such a one where all its points are bad.
    """
    import pycolmap

    adjustment = pycolmap.BundleAdjustmentOptions()
    adjustment.print_summary = False
    adjustment.refine_focal_length = adjustment.refine_extra_params = False
    ceres = adjustment.ceres
    ceres.use_gpu = False
    solver = ceres.solver_options
    solver.num_threads = 1
    solver.max_num_iterations = BA_ITERATIONS
    # Not ended by convergence: many iterations make a mean.
    solver.function_tolerance = solver.gradient_tolerance = solver.parameter_tolerance = 0.0
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.reg_image_ids():
        config.add_image(image_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    clock = StageClock()
    with quiet_colmap():
        adjuster = pycolmap.create_default_ceres_bundle_adjuster(adjustment, config, model)
        with clock.stage("solve"):
            summary = adjuster.solve()
    if not isinstance(summary, pycolmap.CeresBundleAdjustmentSummary):
        return 0.0  # no observations: the solver was not asked
    steps = summary.ceres_summary.num_successful_steps
    steps += summary.ceres_summary.num_unsuccessful_steps
    return clock.stages[0].cpu_s / max(1, steps)
