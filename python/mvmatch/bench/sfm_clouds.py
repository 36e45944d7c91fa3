"""Clouds of delivered models against SIFT's where both cover as much of the true surface."""

# pycolmap carries incomplete types.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mvmatch.bench.apart import run_apart
from mvmatch.bench.cloud import JudgedCloud, at_equal_completeness, judge_cloud, visible_surface
from mvmatch.bench.digests import code_digest
from mvmatch.bench.run import CELLS, open_sequence
from mvmatch.bench.sfm_report import NEAR, groups_of, reference_of
from mvmatch.bench.store import Result, fill_cells

if TYPE_CHECKING:
    from collections.abc import Callable
    from collections.abc import Sequence as Many
    from pathlib import Path

    from mvmatch.bench.sfm import SfmCell
    from mvmatch.geometry.cloud import CloudQuality

_JUDGES = ("bench/cloud.py", "bench/sfm_clouds.py", "bench/truth.py", "geometry/cloud.py")


@dataclass(frozen=True, kw_only=True)
class CloudsCell:
    """The clouds of one (sequence, intrinsics) to be compared."""

    first: SfmCell
    """Any of the sequence and intrinsics."""
    reference: Result
    """SIFT's."""
    others: tuple[Result, ...]

    @property
    def name(self) -> str:
        """What progress is told under."""
        return f"{self.first.sequence} clouds {self.first.intrinsics}"

    @property
    def path(self) -> Path:
        """File of the result."""
        first = self.first
        return first.options.out / CELLS / first.sequence / f"clouds-{first.intrinsics}.json"

    @property
    def key(self) -> str:
        """Digest of everything the result depends on."""
        keys = [result["key"] for result in (self.reference, *self.others)]
        return hashlib.sha256(json.dumps([*keys, code_digest(_JUDGES)]).encode()).hexdigest()


def compare_clouds(
    cells: Many[SfmCell],
    results: Many[Result],
    *,
    tell: Callable[[CloudsCell, str], None] | None = None,
) -> list[Result]:
    """Judge clouds and SIFT's at equal completeness.

    It is the recall at a hundredth of the median depth, and the mean distance of the surface.

    Parameters
    ----------
    cells, results
        Of :func:`mvmatch.bench.sfm.run_sfm`, as many of both.
    tell : callable, optional
        As for :func:`mvmatch.bench.sfm.run_sfm`.

    Returns
    -------
    list of dict
        One per (sequence, intrinsics) with a true surface and a model of SIFT: ``sequence``,
        ``intrinsics``, ``key``, ``error``, ``reference`` (name of the method), and ``rows`` with
        ``method``, ``equal`` (``recall`` or ``mean distance``), ``own`` and ``sift``, each
        ``num_points``, ``recall`` (at the threshold), ``accuracy``, ``completeness`` and
        ``chamfer`` (means, m).
    """
    firsts = {(cell.sequence, cell.intrinsics): cell for cell in reversed(cells)}
    wanted: list[CloudsCell] = []
    for group in groups_of(results):
        reference = reference_of(group)
        seen = [each for each in group if each["error"] is None and each["model"]["cloud"]]
        if reference is None or reference not in seen:
            continue
        first = firsts[reference["sequence"], reference["intrinsics"]]
        others = tuple(each for each in seen if not each["method"].startswith("sift"))
        wanted.append(CloudsCell(first=first, reference=reference, others=others))
    return fill_cells(wanted, _compute, tell)


def _compute(cell: CloudsCell) -> Result:
    apart = run_apart(_compare, cell, timeout_s=cell.first.options.timeout_s)
    first = cell.first
    return {
        "sequence": first.sequence, "intrinsics": first.intrinsics, "key": cell.key,
        "error": apart.error, "reference": cell.reference["method"], **({"rows": []} | apart.value),
    }  # fmt: skip


def _compare(cell: CloudsCell) -> dict[str, Any]:
    import pycolmap

    first = cell.first
    sequence = open_sequence(first.folder, first.sequence, first.options.max_frames)
    surface = visible_surface(sequence)
    threshold = NEAR * surface.median_depth

    def judged(result: Result) -> JudgedCloud:
        model = pycolmap.Reconstruction(result["run"]["model"])
        return judge_cloud(model, sequence, surface=surface)

    sift = judged(cell.reference)
    rows: list[dict[str, Any]] = []
    for result in cell.others:
        cloud = judged(result)
        for measure, bound in (("recall", threshold), ("mean distance", None)):
            pair = at_equal_completeness(cloud, sift, bound)
            own, of_sift = (_figures(quality, threshold) for quality in pair)
            rows.append({"method": result["method"], "equal": measure, "own": own, "sift": of_sift})
    return {"rows": rows}


def _figures(quality: CloudQuality, threshold: float) -> dict[str, float]:
    score = min(quality.scores, key=lambda each: abs(each.threshold - threshold))
    return {
        "num_points": quality.num_points,
        "recall": score.recall,
        "accuracy": quality.accuracy.mean,
        "completeness": quality.completeness.mean,
        "chamfer": quality.chamfer,
    }
