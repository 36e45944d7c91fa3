"""From the rows of all cells to one value with its spread per method, sequence and gap."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.bench.accuracy import COLUMNS
from mvmatch.bench.datasets import Half, half_of
from mvmatch.geometry.pose_error import pose_auc

if TYPE_CHECKING:
    from collections.abc import Sequence as Many

    from numpy.typing import NDArray

THRESHOLDS = (1.0, 5.0, 10.0, 20.0)
"""Degrees, of the pose AUC. Literature has 5, 10 and 20; on neighbouring frames of clean footage
they saturate, so that only 1 tells methods apart."""

AUC = tuple(f"auc_{threshold:g}" for threshold in THRESHOLDS)
_MEDIANS = ("median_px", "along_px", "across_px", "sampson_px", "rotation_deg", "pose_deg")
_NO_MEASURES = ("gap", "frame0", "draw")


@dataclass(frozen=True, kw_only=True)
class Value:
    """A measure of all points, and how much it changes when points are dropped."""

    value: float
    spread: float
    """Standard deviation over the draws; NaN with fewer than two."""


Measures = dict[str, Value]
"""By the names of ``COLUMNS`` and :data:`AUC`."""


@dataclass(frozen=True, kw_only=True)
class Summary:
    """Measures of one method at one gap, on one sequence or on the average of several."""

    half: Half
    sequences: tuple[str, ...]
    """One name, or the sequences that the average is over."""
    method: str
    gap: int
    measures: Measures


def summarise(results: Many[dict[str, Any]]) -> list[Summary]:
    """Summarise every cell by gap.

    Over the pairs of a gap, shares and counts are averaged, medians and angles of single pairs give
    their median, and pose errors the area under their recall curve. Pairs without a correspondence
    have no share and drop out of the average of shares; they count in coverage (as 0) and in the
    AUC (as failures). Pairs whose true poses are not known have no pose error.
    """
    return [
        Summary(
            half=half_of(result["sequence"]),
            sequences=(result["sequence"],),
            method=result["method"],
            gap=gap,
            measures={name: _value(column) for name, column in by_draw(rows).items()},
        )
        for result in results
        if result["error"] is None
        for gap, rows in _grouped(result["rows"], "gap").items()
    ]


def average(results: Many[dict[str, Any]], half: Half) -> list[Summary]:
    """Average the sequences of a half on which every method has a result.

    The spread is that of the average: draws are averaged over sequences first.
    """
    names = comparable(results, half)
    columns: dict[tuple[str, int], list[dict[str, NDArray[np.float64]]]] = {}
    for result in results:
        if result["sequence"] in names:
            for gap, rows in _grouped(result["rows"], "gap").items():
                columns.setdefault((result["method"], gap), []).append(by_draw(rows))
    return [
        Summary(
            half=half,
            sequences=names,
            method=method,
            gap=gap,
            measures={
                name: _value(_mean(np.array([column[name] for column in found])))
                for name in found[0]
            },
        )
        for (method, gap), found in columns.items()
    ]


def comparable(results: Many[dict[str, Any]], half: Half) -> tuple[str, ...]:
    """Return the sequences of a half, as they are, on which every method has a result."""
    methods = {result["method"] for result in results}
    done: dict[str, set[str]] = {}
    for result in results:
        name = result["sequence"]
        if result["error"] is None and half_of(name) == half and "+" not in name:
            done.setdefault(name, set()).add(result["method"])
    return tuple(name for name, found in done.items() if found == methods)


def by_draw(rows: Many[dict[str, Any]]) -> dict[str, NDArray[np.float64]]:
    """Reduce the pairs of one gap.

    Returns
    -------
    dict
        (1 + draws,) float64 per measure: all points first, then each draw. NaN where no pair has
        the measure.
    """
    draws = _grouped(rows, "draw")
    reduced: dict[str, NDArray[np.float64]] = {}
    for name in COLUMNS:
        if name not in _NO_MEASURES:
            columns = [[row.get(name, math.nan) for row in group] for group in draws.values()]
            values = np.array(columns, np.float64)
            reduced[name] = _median(values.T) if name in _MEDIANS else _mean(values.T)
    poses = [[row["pose_deg"] for row in group] for group in draws.values()]
    known = [[error for error in errors if not math.isnan(error)] for errors in poses]
    areas = [pose_auc(errors, THRESHOLDS) for errors in known]
    return reduced | dict(zip(AUC, np.array(areas).T, strict=True))


def _grouped(rows: Many[dict[str, Any]], key: str) -> dict[int, list[dict[str, Any]]]:
    groups: dict[int, list[dict[str, Any]]] = {}
    for row in sorted(rows, key=lambda row: row[key]):
        groups.setdefault(row[key], []).append(row)
    return groups


def _value(draws: NDArray[np.float64]) -> Value:
    known = draws[1:][np.isfinite(draws[1:])]
    spread = float(known.std(ddof=1)) if len(known) > 1 else math.nan
    return Value(value=float(draws[0]), spread=spread)


def _mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over the first axis without NaN; NaN where there is nothing else."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nanmean(values, axis=0)


def _median(values: NDArray[np.float64]) -> NDArray[np.float64]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nanmedian(values, axis=0)
