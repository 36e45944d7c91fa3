"""COLMAP database to model: attempt, check, try again, deliver only what holds."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import dataclasses
import math
import shutil
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from mvmatch.colmap_log import quiet_colmap
from mvmatch.errors import DataError
from mvmatch.sfm.attempts import Attempts
from mvmatch.sfm.breaks import hopeless
from mvmatch.sfm.complete import complete
from mvmatch.sfm.evidence import read_evidence
from mvmatch.sfm.files import check_database, foreign_models, write_models
from mvmatch.sfm.keyframes import select_keyframes
from mvmatch.sfm.localize import unmapped
from mvmatch.sfm.options import MapperOptions
from mvmatch.sfm.parts import ends, find_joints, is_sound, parted
from mvmatch.sfm.result import ReconstructionResult

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pycolmap

    from mvmatch.sfm.checks import ModelCheck
    from mvmatch.sfm.evidence import Evidence
    from mvmatch.sfm.keyframes import KeyframeSelection
    from mvmatch.sfm.localize import Unregistered
    from mvmatch.sfm.result import Attempt, Joint
    from mvmatch.types import StrPath

_BEYOND = "no model holds the part it is in together with this one"


def reconstruct(
    database: StrPath, out: StrPath, *, options: MapperOptions | None = None
) -> ReconstructionResult:
    """Reconstruct a model from a COLMAP database; no image is read.

    The mapper starts from the image pair with the strongest parallax. Its model is compared with
    the relative motion that image pairs measure on their own; one that contradicts them is
    rejected however many images it registered, and the mapper starts again elsewhere.

    Of a long video only key frames are mapped and checked (``options.keyframes``). All other images
    are then registered to their map, and everything is adjusted together: the cost is linear in the
    number of images.

    Where no model of the whole holds, it is parted where the best one is weakest, and the parts are
    mapped and checked for themselves.

    Parameters
    ----------
    database : path
        COLMAP database with two-view geometries; it is not changed.
    out : path
        Folder for models; the accepted one is written to ``out/0``, those of further parts to
        ``out/1`` and so on. Models that an earlier run left there are removed, also where no model
        holds now.
    options : MapperOptions, optional
        Mapper, intrinsics, acceptance.

    Returns
    -------
    ReconstructionResult
        ``accepted`` False with reasons when no model holds: that is a result, not an error.

    Raises
    ------
    DataError
        The file is not a COLMAP database, ``out`` holds models of another program, or cannot be
        written.
    FileNotFoundError
        There is no such database.
    """
    database, out = Path(database), Path(out)
    options = options or MapperOptions()
    check_database(database)
    foreign = foreign_models(out)
    if foreign:
        raise DataError(
            f"{foreign[0]} holds a model that mvmatch did not write: it would be replaced, or be "
            "taken for a part of the new one. Choose another folder"
        )
    with tempfile.TemporaryDirectory(prefix="mvmatch-sfm-") as folder, quiet_colmap():
        # A copy: even reading changes a database, and refined cameras are written into it.
        copy = Path(folder) / "database.db"
        shutil.copyfile(database, copy)
        keyframes = Path(folder) / "keyframes.db"
        selection = select_keyframes(copy, options.keyframes, mapped=keyframes)
        mapped = copy if selection is None else keyframes
        sequence = _Sequence(
            images=copy,
            mapped=mapped,
            selection=selection,
            evidence=read_evidence(mapped),
            options=options,
        )
        result, parts = sequence.reconstruct()
        paths = write_models([part.model for part in parts], out)
    path = paths[0] if paths else None
    return dataclasses.replace(result, path=path, further=tuple(paths[1:]))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Part:
    """The best model of some successive images."""

    evidence: Evidence
    model: pycolmap.Reconstruction
    check: ModelCheck
    unregistered: tuple[Unregistered, ...]
    """Images of the part without a pose."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sequence:
    """The images of a database, and what was tried with them."""

    images: Path
    """Working copy of the database."""
    mapped: Path
    """That of the images that are mapped: the key frames, where there are any."""
    selection: KeyframeSelection | None
    evidence: Evidence
    options: MapperOptions
    attempts: list[Attempt] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)

    @property
    def total(self) -> int:
        """Images of the database."""
        return self.evidence.num_images if self.selection is None else self.selection.num_images

    def reconstruct(self) -> tuple[ReconstructionResult, list[_Part]]:
        """Return what came of the sequence, and the parts to be delivered, the largest first."""
        reason = hopeless(self.evidence)
        if reason is not None:
            return self._result(None, reasons=(reason,)), []
        best, parts = self._map()
        if best is None:
            return self._result(None, reasons=("the mapper made no model",)), []
        if not parts:
            return self._result(best, reasons=best.check.reasons), []
        return self._result(parts[0], reasons=()), parts

    def _map(self) -> tuple[_Part | None, list[_Part]]:
        """Return the best model of the whole, and the parts that hold, the largest first."""
        whole = self._map_part(self.evidence)
        if whole is None:
            return None, []
        held = [whole] if whole.check.accepted else []
        unparted = [whole]
        while unparted:
            part = unparted.pop()
            sides, joints = self._sides(part)
            found = [self._map_part(part.evidence.within(ids)) for ids in sides]
            usable = [each for each in found if each is not None]
            if usable:
                self.joints.extend(joints)
            held += [each for each in usable if self._holds(each)]
            unparted += usable
        self.joints.sort(key=lambda joint: joint.before)
        return whole, sorted(held, key=lambda part: -part.check.registered)

    def _sides(self, part: _Part) -> tuple[list[list[int]], tuple[Joint, ...]]:
        """Images on either side of the joints of a refused part, or left out of an accepted one."""
        if part.check.accepted:
            joints = ends(part.model, part.evidence)
            known = frozenset(part.model.reg_image_ids())
        else:
            joints = find_joints(part.model, part.evidence, self._bounds(part.evidence).acceptance)
            known = frozenset[int]()
        sides = parted(part.evidence.image_ids, joints) if joints else []
        return [ids for ids in sides if self._fits(ids) and known.isdisjoint(ids)], joints

    def _fits(self, image_ids: Sequence[int]) -> bool:
        """Whether a part may become large enough."""
        share = len(image_ids) / self.evidence.num_images
        return share >= self.options.acceptance.min_part

    def _holds(self, part: _Part) -> bool:
        """Whether a part is to be delivered."""
        is_large = part.check.registered >= self.options.acceptance.min_part * self.total
        sound = is_large and part.check.accepted
        return sound and is_sound(part.model, part.check, part.evidence, self.options)

    def _bounds(self, evidence: Evidence) -> MapperOptions:
        """Return the options, with bounds that are closer for a part."""
        bounds = self.options.acceptance
        if evidence.num_images == self.evidence.num_images:
            return self.options
        joint = max(bounds.min_joint, bounds.min_part_joint)
        acceptance = dataclasses.replace(bounds, min_joint=joint)
        return dataclasses.replace(self.options, acceptance=acceptance)

    def _map_part(self, evidence: Evidence) -> _Part | None:
        """Map a part; of key frames complete it."""
        if hopeless(evidence) is not None:
            return None
        folder = self.mapped.parent
        attempts = Attempts(self.mapped, folder, self._bounds(evidence), evidence)
        model, check = attempts.best()
        self.attempts.extend(attempts.made)
        if model is None or check is None:
            return None
        if not check.accepted or self.selection is None:
            inside = frozenset(evidence.image_ids)
            left_out = [each for each in unmapped(model, self.mapped) if each.image_id in inside]
            return _Part(evidence=evidence, model=model, check=check, unregistered=tuple(left_out))
        selection = self.selection.around(evidence.image_ids)
        unregistered = complete(model, selection, self.options)
        check = attempts.checked(model, num_images=selection.num_images)
        return _Part(evidence=evidence, model=model, check=check, unregistered=unregistered)

    def _result(self, part: _Part | None, *, reasons: tuple[str, ...]) -> ReconstructionResult:
        """Describe the model of a part; it is not written yet."""
        check = None if part is None else part.check
        return ReconstructionResult(
            reconstruction=None if part is None else part.model,
            registered=0 if check is None else check.registered,
            total=self.total,
            num_keyframes=self.evidence.num_images,
            unregistered=() if part is None or reasons else self._unregistered(part),
            num_points=0 if check is None else check.num_points,
            mean_reprojection_error=math.nan if check is None else check.mean_reprojection_error,
            mean_track_length=0.0 if check is None else check.mean_track_length,
            accepted=not reasons,
            reasons=reasons,
            attempts=tuple(self.attempts),
            joints=() if reasons else tuple(self.joints),
            path=None,
        )

    def _unregistered(self, part: _Part) -> tuple[Unregistered, ...]:
        """Images that a model lacks: those of its part, and those beyond."""
        known = {each.image_id: each for each in part.unregistered}
        everything = unmapped(part.model, self.images, reason=_BEYOND)
        return tuple(known.get(each.image_id, each) for each in everything)
