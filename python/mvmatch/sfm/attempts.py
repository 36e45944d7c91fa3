"""One part of a sequence, mapped again and again until a model holds."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import dataclasses
import logging
import math
import shutil
from typing import TYPE_CHECKING

from mvmatch.sfm.adjust import (
    adjust,
    adjust_known_camera,
    adjust_unknown_camera,
    fit_squares,
    focal_change,
    is_bogus,
)
from mvmatch.sfm.checks import check_model
from mvmatch.sfm.evidence import read_evidence
from mvmatch.sfm.focal import estimate_focal
from mvmatch.sfm.options import global_options, incremental_options
from mvmatch.sfm.result import Attempt

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    import pycolmap

    from mvmatch.sfm.checks import ModelCheck
    from mvmatch.sfm.evidence import Evidence, PairEvidence
    from mvmatch.sfm.options import MapperOptions

_logger = logging.getLogger(__name__)


class Attempts:
    """The attempts on the images of a database that the evidence is about.

    Parameters
    ----------
    database : Path
        Its cameras are changed: each part begins with those of its evidence.
    folder : Path
        For what the mappers write.
    options : MapperOptions
        Mapper, intrinsics, acceptance.
    evidence : Evidence
        Of the database, or of a part of its images.
    """

    def __init__(
        self, database: Path, folder: Path, options: MapperOptions, evidence: Evidence
    ) -> None:
        self._folder = folder
        self._options = options
        self._evidence = evidence
        self._refine = options.intrinsics == "refine" or (
            options.intrinsics == "auto" and not evidence.has_prior_focal_length
        )
        self._database = database
        self._names = _names(database, evidence.image_ids)
        self.made: list[Attempt] = []

    def best(self) -> tuple[pycolmap.Reconstruction | None, ModelCheck | None]:
        """Return the first accepted model, else that with the fewest and mildest objections."""
        best: tuple[pycolmap.Reconstruction, ModelCheck] | None = None
        self._store_cameras(self._evidence.cameras)
        if self._refine:
            self._guess_focal()
        for mapper, initial in self._plan():
            model = self._map(mapper, initial)
            if model is not None:
                model = self._adjusted(model, mapper, initial)
            check = None if model is None else self.checked(model)
            reasons = ("the mapper made no model",) if check is None else check.reasons
            images = None if initial is None else (initial.image0, initial.image1)
            self.made.append(
                Attempt(
                    mapper=mapper,
                    images=(self._evidence.image_ids[0], self._evidence.image_ids[-1]),
                    initial_images=images,
                    check=check,
                    reasons=reasons,
                )
            )
            _logger.info("%s mapper from %s: %s", mapper, images, reasons or "accepted")
            if model is None or check is None:
                continue
            if best is None or _rank(check) > _rank(best[1]):
                best = model, check
            if check.accepted and check.registered == check.total:
                break
        return (None, None) if best is None else best

    def _plan(self) -> Iterator[tuple[str, PairEvidence | None]]:
        """Yield mapper and initial pair of each attempt, in order."""
        first = self._options.mapper
        mappers = [first, "global" if first == "incremental" else "incremental"]
        for mapper in mappers if self._options.fallback else mappers[:1]:
            if mapper == "global":
                yield mapper, None
            else:
                for pair in self._evidence.strongest(self._options.max_attempts):
                    yield mapper, pair

    def _guess_focal(self) -> None:
        """Replace the prior focal length of the working database by one that fits."""
        import pycolmap

        with pycolmap.Database.open(self._database) as database:
            cameras = database.read_all_cameras()
        prior = max(camera.mean_focal_length() for camera in cameras)
        self._store_focal(cameras, estimate_focal(prior, self._evidence, self._map_with_focal))

    def _map_with_focal(
        self, focal: float, images: list[int], initial: PairEvidence
    ) -> pycolmap.Reconstruction | None:
        import pycolmap

        with pycolmap.Database.open(self._database) as database:
            cameras = database.read_all_cameras()
            names = [database.read_image(image_id).name for image_id in images]
        self._store_focal(cameras, focal)
        return self._map("incremental", initial, names)

    def _store_focal(self, cameras: list[pycolmap.Camera], focal: float) -> None:
        import pycolmap

        with pycolmap.Database.open(self._database) as database:
            for camera in cameras:
                params = camera.params
                params[list(camera.focal_length_idxs())] = focal
                camera.params = params.tolist()
                # Else COLMAP estimates a focal length from the initial pair alone.
                camera.has_prior_focal_length = True
                database.update_camera(camera)

    def _map(
        self, mapper: str, initial: PairEvidence | None, image_names: Sequence[str] = ()
    ) -> pycolmap.Reconstruction | None:
        import pycolmap

        out = self._folder / "models"
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir()
        names = list(image_names or self._names)
        try:
            if mapper == "global":
                everywhere = global_options(self._options)
                everywhere.image_names = names
                models = pycolmap.global_mapping(self._database, self._folder, out, everywhere)
            else:
                incremental = incremental_options(self._options, initial)
                incremental.image_names = names
                models = pycolmap.incremental_mapping(
                    self._database, self._folder, out, incremental
                )
        except (RuntimeError, ValueError) as error:
            _logger.warning("the %s mapper failed: %s", mapper, error)
            return None
        usable = [model for model in models.values() if model.num_reg_images() > 1]
        if not usable:
            return None
        return max(usable, key=lambda each: each.num_reg_images())

    def _adjusted(
        self, model: pycolmap.Reconstruction, mapper: str, initial: PairEvidence | None
    ) -> pycolmap.Reconstruction:
        """Return the model after the final adjustment, as the intrinsics demand."""
        if self._refine:
            return self._refined(model, mapper, initial)
        if self._options.intrinsics == "auto":
            return adjust_known_camera(model, self._options)
        adjust(model, self._options)
        return model

    def _refined(
        self, model: pycolmap.Reconstruction, mapper: str, initial: PairEvidence | None
    ) -> pycolmap.Reconstruction:
        """Refine the camera on the whole model and map again with it, until it stays."""
        import pycolmap

        for rounds_left in reversed(range(self._options.max_refinements)):
            refined = pycolmap.Reconstruction(model)
            fit_squares(refined, "focal length")
            if is_bogus(refined):
                adjust(model, self._options)
                return model
            change = focal_change(model, refined)
            model = refined
            if change < 0.01 or rounds_left == 0:
                break
            self._store_cameras(dict(refined.cameras))
            again = self._map(mapper, initial)
            if again is None or again.num_reg_images() < model.num_reg_images():
                break
            model = again
        return adjust_unknown_camera(model, self._options)

    def _store_cameras(self, cameras: Mapping[int, pycolmap.Camera]) -> None:
        import pycolmap

        with pycolmap.Database.open(self._database) as database:
            for camera in cameras.values():
                database.update_camera(camera)

    def checked(
        self, model: pycolmap.Reconstruction, *, num_images: int | None = None
    ) -> ModelCheck:
        """Check a model that holds the images of the evidence, or ``num_images`` with others."""
        evidence, cameras = self._evidence, dict(model.cameras)
        if cameras != evidence.cameras:
            # Pairs measured with the old camera contradict what the new one put right.
            evidence = read_evidence(self._database, cameras=cameras).within(evidence.image_ids)
        if num_images is not None:
            evidence = dataclasses.replace(evidence, num_images=num_images)
        return check_model(model, evidence, self._options.acceptance)


def _names(database: Path, image_ids: Sequence[int]) -> list[str]:
    """Names of the images; none where they are all that the database has."""
    import pycolmap

    with pycolmap.Database.open(database) as opened:
        if len(image_ids) == opened.num_images():
            return []
        return [opened.read_image(image_id).name for image_id in image_ids]


def _rank(check: ModelCheck) -> tuple[bool, float, int, float]:
    """Order accepted models by what they register, rejected ones by how much evidence they keep."""
    agreement = 0.0 if math.isnan(check.agreement) else check.agreement
    first = 1.0 if check.accepted else agreement
    return check.accepted, first, check.registered, -check.mean_reprojection_error
