"""COLMAP database to model: attempt, check, try again, deliver only what holds."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import dataclasses
import errno
import logging
import math
import os
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mvmatch.colmap_log import quiet_colmap
from mvmatch.errors import DataError
from mvmatch.sfm.adjust import adjust, adjust_known_camera, focal_change
from mvmatch.sfm.breaks import hopeless
from mvmatch.sfm.checks import ModelCheck, check_model
from mvmatch.sfm.complete import complete
from mvmatch.sfm.evidence import Evidence, PairEvidence, read_evidence
from mvmatch.sfm.focal import estimate_focal
from mvmatch.sfm.keyframes import select_keyframes
from mvmatch.sfm.localize import Unregistered, unmapped
from mvmatch.sfm.options import MapperOptions, global_options, incremental_options

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import pycolmap

    from mvmatch.sfm.keyframes import KeyframeSelection

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """One run of a mapper."""

    mapper: str
    initial_images: tuple[int, int] | None
    """Image ids mapping started from; None where the mapper chose."""
    check: ModelCheck | None
    """None when the mapper made no model."""
    reasons: tuple[str, ...]
    """Why the attempt was rejected; empty for the accepted one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ReconstructionResult:
    """The model, or the best that was rejected, and how it came about."""

    reconstruction: pycolmap.Reconstruction | None
    registered: int
    total: int
    """Images of the database."""
    num_keyframes: int
    """Images that were mapped; the others were registered to their map."""
    unregistered: tuple[Unregistered, ...]
    """Images that the accepted model lacks, and why; empty without one."""
    num_points: int
    mean_reprojection_error: float
    """px; NaN without a model."""
    mean_track_length: float
    accepted: bool
    """Whether the model passed all checks; only then it is written."""
    reasons: tuple[str, ...]
    """Why there is no accepted model; empty when there is."""
    attempts: tuple[Attempt, ...]
    path: Path | None
    """Folder of the written model (cameras, rigs, frames, images, points3D)."""


def reconstruct(
    database: Path, out: Path, *, options: MapperOptions | None = None
) -> ReconstructionResult:
    """Reconstruct a model from a COLMAP database; no image is read.

    The mapper starts from the image pair with the strongest parallax. Its model is compared with
    the relative motion that image pairs measure on their own; one that contradicts them is
    rejected however many images it registered, and the mapper starts again elsewhere.

    Of a long video only key frames are mapped and checked (``options.keyframes``). All other images
    are then registered to their map, and everything is adjusted together: the cost is linear in the
    number of images.

    Parameters
    ----------
    database : Path
        COLMAP database with two-view geometries; it is not changed.
    out : Path
        Folder for models; the accepted one is written to ``out/0``. Nothing is written without.
    options : MapperOptions, optional
        Mapper, intrinsics, acceptance.

    Returns
    -------
    ReconstructionResult
        ``accepted`` False with reasons when no model holds: that is a result, not an error.

    Raises
    ------
    DataError
        The file is not a COLMAP database, or ``out`` cannot be written.
    FileNotFoundError
        There is no such database.
    """
    options = options or MapperOptions()
    _check_database(database)
    with tempfile.TemporaryDirectory(prefix="mvmatch-sfm-") as folder, quiet_colmap():
        # A copy: even reading changes a database, and refined cameras are written into it.
        copy = Path(folder) / "database.db"
        shutil.copyfile(database, copy)
        selection = select_keyframes(copy, options.keyframes)
        mapped = copy if selection is None else Path(folder) / "keyframes.db"
        if selection is not None:
            selection.write_database(copy, mapped)
        evidence = read_evidence(mapped)
        reason = hopeless(evidence)
        if reason is not None:
            return _result(None, None, evidence, selection, reasons=(reason,))
        run = _Run(mapped, Path(folder), options, evidence)
        model, check = run.best()
        if model is None or check is None:
            reasons = ("the mapper made no model",)
            return _result(None, None, evidence, selection, attempts=run.attempts, reasons=reasons)
        unregistered = unmapped(model, mapped)
        if check.accepted and selection is not None:
            unregistered = complete(model, copy, selection, options)
            check = run.checked(model, num_images=selection.num_images)
        result = _result(
            model, check, evidence, selection, attempts=run.attempts, reasons=check.reasons
        )
        if not result.accepted:
            return result
        return dataclasses.replace(result, unregistered=unregistered, path=write_model(model, out))


class _Run:
    """The attempts on one database."""

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
        self.attempts: list[Attempt] = []

    def best(self) -> tuple[pycolmap.Reconstruction | None, ModelCheck | None]:
        """Return the first accepted model, else that with the fewest and mildest objections."""
        best: tuple[pycolmap.Reconstruction, ModelCheck] | None = None
        if self._refine:
            self._guess_focal()
        for mapper, initial in self._plan():
            model = self._map(mapper, initial)
            if model is not None:
                model = self._adjusted(model, mapper, initial)
            check = None if model is None else self.checked(model)
            reasons = ("the mapper made no model",) if check is None else check.reasons
            images = None if initial is None else (initial.image0, initial.image1)
            self.attempts.append(
                Attempt(mapper=mapper, initial_images=images, check=check, reasons=reasons)
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
        try:
            if mapper == "global":
                models = pycolmap.global_mapping(
                    self._database, self._folder, out, global_options(self._options)
                )
            else:
                incremental = incremental_options(self._options, initial)
                incremental.image_names = list(image_names)
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
            adjust(refined, self._options, refine="focal length")
            if any(camera.has_bogus_params(0.1, 10.0, 1.0) for camera in refined.cameras.values()):
                break
            change = focal_change(model, refined)
            model = refined
            if change < 0.01 or rounds_left == 0:
                break
            self._store_cameras(refined)
            again = self._map(mapper, initial)
            if again is None or again.num_reg_images() < model.num_reg_images():
                break
            model = again
        final = pycolmap.Reconstruction(model)
        adjust(final, self._options, refine="intrinsics")
        bogus = any(camera.has_bogus_params(0.1, 10.0, 1.0) for camera in final.cameras.values())
        return model if bogus else final

    def _store_cameras(self, model: pycolmap.Reconstruction) -> None:
        import pycolmap

        with pycolmap.Database.open(self._database) as database:
            for camera in model.cameras.values():
                database.update_camera(camera)

    def checked(
        self, model: pycolmap.Reconstruction, *, num_images: int | None = None
    ) -> ModelCheck:
        """Check a model that holds the images of the database, or ``num_images`` with others."""
        evidence, cameras = self._evidence, dict(model.cameras)
        if cameras != evidence.cameras:
            # Pairs measured with the old camera contradict what the new one put right.
            evidence = read_evidence(self._database, cameras=cameras)
        if num_images is not None:
            evidence = dataclasses.replace(evidence, num_images=num_images)
        return check_model(model, evidence, self._options.acceptance)


def _rank(check: ModelCheck) -> tuple[bool, float, int, float]:
    """Order accepted models by what they register, rejected ones by how much evidence they keep."""
    agreement = 0.0 if math.isnan(check.agreement) else check.agreement
    first = 1.0 if check.accepted else agreement
    return check.accepted, first, check.registered, -check.mean_reprojection_error


def _result(
    model: pycolmap.Reconstruction | None,
    check: ModelCheck | None,
    evidence: Evidence,
    selection: KeyframeSelection | None,
    *,
    attempts: Sequence[Attempt] = (),
    reasons: tuple[str, ...],
) -> ReconstructionResult:
    return ReconstructionResult(
        reconstruction=model,
        registered=0 if check is None else check.registered,
        total=evidence.num_images if selection is None else selection.num_images,
        num_keyframes=evidence.num_images,
        unregistered=(),
        num_points=0 if check is None else check.num_points,
        mean_reprojection_error=math.nan if check is None else check.mean_reprojection_error,
        mean_track_length=0.0 if check is None else check.mean_track_length,
        accepted=not reasons,
        reasons=reasons,
        attempts=tuple(attempts),
        path=None,
    )


def write_model(model: pycolmap.Reconstruction, out: Path) -> Path:
    """Write the model to ``out/0``, complete or not at all; an older one there is replaced.

    Raises
    ------
    DataError
        The folder cannot be written.
    """
    path, partial = out / "0", out / ".0.partial"
    try:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        model.write_binary(partial)
        if not _is_whole(partial, model):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        shutil.rmtree(path, ignore_errors=True)
        partial.replace(path)
    except OSError as error:
        raise DataError(
            f"cannot write the model {path}: {error.strerror}; choose another folder"
        ) from error
    return path


def _is_whole(folder: Path, model: pycolmap.Reconstruction) -> bool:
    """Whether a model was written to its end: on a full disk COLMAP stops without a word."""
    import pycolmap

    try:
        written = pycolmap.Reconstruction(folder)
    except (RuntimeError, ValueError):
        return False
    return (
        written.num_reg_images() == model.num_reg_images()
        and written.num_points3D() == model.num_points3D()
        and written.compute_num_observations() == model.compute_num_observations()
    )


def _check_database(path: Path) -> None:
    with path.open("rb") as file:
        magic = file.read(16)
    if magic != b"SQLite format 3\0":
        raise DataError(f"{path} is not a COLMAP database (not an SQLite file)")
