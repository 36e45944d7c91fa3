"""The methods of the benchmark of whole runs: from input to model, and from a draw of the points.

A run happens in a fresh process that is measured from outside, and leaves a folder. What it learns
besides is read from that folder later, so that nothing but the run is in the cost.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import dataclasses
import shutil
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from mvmatch import outputs, stages
from mvmatch.baselines import SiftOptions, match_sift
from mvmatch.bench.front_ends import ENCODERS, PRESETS
from mvmatch.bench.matches import Sample, drawn, sampled
from mvmatch.camera import parse_camera
from mvmatch.colmap_log import quiet_colmap
from mvmatch.config import RunOptions
from mvmatch.geometry.two_view import colmap_ransac
from mvmatch.measure import StageClock
from mvmatch.pipeline import reconstruct_video
from mvmatch.sfm import MapperOptions, reconstruct, write_model
from mvmatch.sfm.options import incremental_options
from mvmatch.state import State

if TYPE_CHECKING:
    from pathlib import Path

    import pycolmap

    from mvmatch.encode import EncodeOptions


@dataclass(frozen=True, kw_only=True)
class Input:
    """What a run gets."""

    path: Path
    """An AV1 video, or a folder of images."""
    size: tuple[int, int]
    """px."""
    camera: str | None
    """As for ``mvmatch run --camera``; None where intrinsics are unknown."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """What a run delivers."""

    reconstruction: pycolmap.Reconstruction | None
    accepted: bool
    registered: int
    reasons: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class VectorRun:
    """``mvmatch run`` on an AV1 video."""

    encode: EncodeOptions
    preset: str

    def run(self, given: Input, out: Path) -> dict[str, Any]:
        """Make a model as users do; the folder is that of ``mvmatch run``."""
        made = self._reconstruct(given, out)
        model = made.model
        return {
            "accepted": model.accepted,
            "registered": model.registered,
            "reasons": list(model.reasons),
            "model": None if model.path is None else str(model.path),
            "stages": made.data["stages"],
        }

    def resample(self, given: Input, out: Path, folder: Path, sample: Sample) -> Model:
        """Verify and map a share of the tracks that an earlier run has left in ``out``."""
        made = self._reconstruct(given, out)
        options, match = self._options, made.match
        if made.weights is not None and options.movers.exclude:
            right = made.weights >= options.movers.min_weight
            match = dataclasses.replace(match, tracks=match.tracks.select(right))
        state = State(
            source=given.path,
            options=options,
            camera=given.camera,
            has_to_encode=False,
            masks=False,
            undistort=False,
            progress=None,
        )
        state.match = dataclasses.replace(
            match, tracks=sampled(match.tracks, sample), further=sampled(match.further, sample)
        )
        stages.load_database(state, folder, stages.make_database(state, folder))
        stages.load_model(state, folder, stages.map_database(state, folder))
        model = state.model
        return Model(
            reconstruction=model.reconstruction,
            accepted=model.accepted,
            registered=model.registered,
            reasons=model.reasons,
        )

    @property
    def _options(self) -> RunOptions:
        return RunOptions.preset(self.preset)

    def _reconstruct(self, given: Input, out: Path) -> Any:
        return reconstruct_video(given.path, out, camera=given.camera, options=self._options)


@dataclass(frozen=True, kw_only=True)
class SiftRun:
    """SIFT of pycolmap, matched in sequence, and an incremental mapper, on all processors."""

    mapper: Literal["colmap", "video", "mvmatch"]
    """COLMAP's with its defaults; the same with bounds for small baselines and forward motion; or
    that of ``mvmatch run``, which checks what it makes."""
    sift: SiftOptions = dataclasses.field(default_factory=lambda: SiftOptions(num_threads=-1))

    def run(self, given: Input, out: Path) -> dict[str, Any]:
        """Make a model of images."""
        camera = None if given.camera is None else parse_camera(given.camera, *given.size).camera
        out.mkdir(parents=True)
        clock = StageClock()
        with quiet_colmap():
            with clock.stage("match"):
                match_sift(given.path, out / outputs.DATABASE, camera=camera, options=self.sift)
            with clock.stage("map"):
                model = self._map(given, out / outputs.DATABASE, out)
        path = None
        if model.accepted and model.reconstruction is not None:
            path = str(write_model(model.reconstruction, out / outputs.MODEL))
        return {
            "accepted": model.accepted,
            "registered": model.registered,
            "reasons": list(model.reasons),
            "model": path,
            "stages": [dataclasses.asdict(stage) for stage in clock.stages],
        }

    def resample(self, given: Input, out: Path, folder: Path, sample: Sample) -> Model:
        """Verify and map a share of the keypoints that an earlier run has left in ``out``."""
        database = folder / outputs.DATABASE
        shutil.copyfile(out / outputs.DATABASE, database)
        with quiet_colmap():
            self._drop(database, sample)
            return self._map(given, database, folder, num_threads=1)

    def _drop(self, path: Path, sample: Sample) -> None:
        """Take matches of dropped keypoints out of a database, and verify the others anew."""
        import pycolmap

        with pycolmap.Database.open(path) as database:
            kept = {
                image.image_id: drawn(
                    database.num_keypoints_for_image(image.image_id),
                    sample.share,
                    sample.seed,
                    image.image_id,
                )
                for image in database.read_all_images()
            }
            pairs, all_matches = database.read_all_matches()
            database.clear_matches()
            database.clear_two_view_geometries()
            for pair, matches in zip(pairs, all_matches, strict=True):
                first, second = pycolmap.pair_id_to_image_pair(pair)
                both = kept[first][matches[:, 0]] & kept[second][matches[:, 1]]
                database.write_matches(first, second, matches[both])
        verification = pycolmap.TwoViewGeometryOptions()
        verification.ransac = colmap_ransac(self.sift.ransac)
        threads = pycolmap.GeometricVerifierOptions()
        threads.num_threads = 1
        pycolmap.geometric_verification(path, threads, two_view_geometry_options=verification)

    def _map(self, given: Input, database: Path, folder: Path, *, num_threads: int = -1) -> Model:
        import pycolmap

        if self.mapper == "mvmatch":
            result = reconstruct(database, folder / "checked", options=MapperOptions())
            return Model(
                reconstruction=result.reconstruction,
                accepted=result.accepted,
                registered=result.registered,
                reasons=result.reasons,
            )
        work = folder / "models"
        work.mkdir()
        options = _colmap_options(self.mapper, refine=given.camera is None)
        # On several threads COLMAP is not repeatable: that is for what is timed alone.
        options.num_threads = options.mapper.num_threads = num_threads
        models = pycolmap.incremental_mapping(database, given.path, work, options)
        best = max(models.values(), key=lambda model: model.num_reg_images(), default=None)
        return Model(
            reconstruction=best,
            accepted=best is not None,
            registered=0 if best is None else best.num_reg_images(),
            reasons=() if best is not None else ("the mapper made no model",),
        )


def _colmap_options(
    mapper: Literal["colmap", "video"], *, refine: bool
) -> pycolmap.IncrementalPipelineOptions:
    """COLMAP's options with the intrinsics refined or held, without colours."""
    import pycolmap

    options = pycolmap.IncrementalPipelineOptions()
    if mapper == "video":
        options = incremental_options(MapperOptions(), None)
    options.random_seed = options.mapper.random_seed = options.triangulation.random_seed = 0
    options.extract_colors = False
    options.min_model_size = 2
    options.ba_refine_focal_length = options.ba_refine_extra_params = refine
    options.mapper.abs_pose_refine_focal_length = refine
    options.mapper.abs_pose_refine_extra_params = refine
    return options


METHODS: dict[str, VectorRun | SiftRun] = {
    **{
        f"{encoder}-{preset}": VectorRun(encode=options, preset=preset)
        for encoder, options in ENCODERS.items()
        for preset in PRESETS
    },
    "sift": SiftRun(mapper="colmap"),
    "sift-video": SiftRun(mapper="video"),
    "sift-checked": SiftRun(mapper="mvmatch"),
}
"""By name; a further method is one line."""

_RUN = (
    "bench/sfm_methods.py", "camera", "export/colmap.py", "export/verification.py", "geometry",
    "sfm", "types.py",
)  # fmt: skip
_OF_VECTORS = (
    "_core", "bridge", "batches", "cells", "confidence", "config.py", "correspondences", "encode",
    "error_model", "filters", "footage", "match.py", "matching", "outputs", "overlays", "pairing",
    "pictures", "pipeline", "products", "refine", "report", "shots", "sources", "stages", "state",
    "store", "tracks", "work",
)  # fmt: skip
_OF_SIFT = ("baselines", "bench/sfm_methods.py", "camera", "geometry/two_view.py", "sfm/options.py")


def sources_of(name: str) -> tuple[str, ...]:
    """Return the modules that a run of a method depends on."""
    method = METHODS[name]
    if isinstance(method, VectorRun):
        return _RUN + _OF_VECTORS
    return _OF_SIFT + (_RUN if method.mapper == "mvmatch" else ())
