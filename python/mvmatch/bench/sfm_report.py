"""The tables of the benchmark of whole runs: Markdown for people, JSON with everything."""

from __future__ import annotations

import dataclasses
import json
import math
from statistics import median
from typing import TYPE_CHECKING, Any

from mvmatch.bench.report import machine, markdown
from mvmatch.outputs import provenance
from mvmatch.report.plain import plain

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from collections.abc import Sequence as Many
    from pathlib import Path

    from mvmatch.bench.sfm import SfmOptions
    from mvmatch.bench.store import Result

TABLES, SUMMARY = "sfm.md", "sfm.json"

WRONG_PERCENT, RIGHT_PERCENT = 1.0, 0.1
"""A model is wrong with an ATE above the first, in % of the path, where SIFT's is below the second:
where the footage is not to blame."""

NEAR = 0.01
"""Share of the median depth within which a point of a cloud counts as right."""

_VERDICTS = ("accepted", "refused", "wrong")


def write_sfm_tables(
    results: Many[Result], clouds: Many[Result], options: SfmOptions
) -> list[Path]:
    """Write ``sfm.md`` and ``sfm.json`` into the folder of a benchmark."""
    paths = [options.out / name for name in (TABLES, SUMMARY)]
    paths[0].write_text(sfm_tables(results, clouds), encoding="utf-8")
    document = {
        **provenance(),
        "machine": machine(),
        "options": dataclasses.asdict(options),
        "cells": results,
        "clouds": clouds,
    }
    paths[1].write_text(json.dumps(plain(document), indent=1), encoding="utf-8")
    return paths


def sfm_tables(results: Many[Result], clouds: Many[Result] = ()) -> str:
    """Return all tables as Markdown.

    Parameters
    ----------
    results : sequence
        Of :func:`mvmatch.bench.sfm.run_sfm`.
    clouds : sequence
        Of :func:`mvmatch.bench.sfm_clouds.compare_clouds`.
    """
    compared = {(each["sequence"], each["intrinsics"]): each for each in clouds}
    groups = list(groups_of(results))
    parts: list[str] = []
    for intrinsics in dict.fromkeys(result["intrinsics"] for result in results):
        chosen = [group for group in groups if group[0]["intrinsics"] == intrinsics]
        parts += [f"## All sequences, intrinsics {intrinsics}", _overview(chosen)]
    for group in groups:
        first, reference = group[0], reference_of(group)
        parts.append(f"## {first['sequence']}, intrinsics {first['intrinsics']}")
        pictures = max(result["total"] for result in group)
        against = "SIFT made no model" if reference is None else f"SIFT: {reference['method']}"
        parts.append(f"{pictures} pictures. {against}.")
        done = [result for result in group if result["error"] is None]
        if done:
            parts += [_models_table(done, reference), _costs_table(done, reference)]
        parts += _clouds(done, compared.get((first["sequence"], first["intrinsics"])))
        failed = [result for result in group if result["error"] is not None]
        if failed:
            lines = [f"- {result['method']} failed: {result['error']}" for result in failed]
            parts.append("\n".join(lines))
    return "\n\n".join(parts) + "\n"


def groups_of(results: Many[Result]) -> Iterator[list[Result]]:
    """Yield the results of each sequence and intrinsics, in order."""
    groups: dict[tuple[str, str], list[Result]] = {}
    for result in results:
        groups.setdefault((result["sequence"], result["intrinsics"]), []).append(result)
    yield from groups.values()


def reference_of(group: Many[Result]) -> Result | None:
    """Return SIFT under the settings that do best on a sequence: most images, then least ATE."""
    made = [each for each in group if each["method"].startswith("sift") and _delivers(each)]
    return min(
        made,
        key=lambda each: (-each["run"]["registered"], each["model"]["ate_percent"]),
        default=None,
    )


def verdict(result: Result, reference: Result | None) -> str:
    """Return ``accepted``, ``refused``, ``wrong`` (delivered as good, but is not) or ``failed``."""
    if result["error"] is not None:
        return "failed"
    return _verdict({**result["run"], **result["model"]}, reference)


def count_draws(result: Result, reference: Result | None) -> dict[str, int]:
    """Count the verdicts on the resamplings of a result."""
    found = [_verdict(draw, reference) for draw in result["draws"]]
    return {name: found.count(name) for name in _VERDICTS}


def _verdict(row: Mapping[str, Any], reference: Result | None) -> str:
    if not row["accepted"]:
        return "refused"
    known_right = reference is not None and reference["model"]["ate_percent"] < RIGHT_PERCENT
    return "wrong" if known_right and row["ate_percent"] > WRONG_PERCENT else "accepted"


def _delivers(result: Result) -> bool:
    return result["error"] is None and result["run"]["accepted"]


def _overview(groups: Many[Many[Result]]) -> str:
    """One row per method: verdicts, and medians of its ratios to SIFT."""
    found: dict[str, list[tuple[Result, Result | None]]] = {}
    for group in groups:
        reference = reference_of(group)
        for result in group:
            found.setdefault(result["method"], []).append((result, reference))
    rows: list[list[str]] = []
    for method, pairs in found.items():
        verdicts = [verdict(*pair) for pair in pairs]
        draws = [count_draws(*pair) for pair in pairs]
        whole = sum(
            _delivers(each) and each["run"]["registered"] == each["total"] for each, _ in pairs
        )
        compared = [(each, sift) for each, sift in pairs if sift is not None and _delivers(each)]
        ratios = [(_ratios(each, sift), _worse(each, sift)) for each, sift in compared]
        rows.append([
            method, *(str(verdicts.count(name)) for name in (*_VERDICTS, "failed")), str(whole),
            " / ".join(str(sum(each[name] for each in draws)) for name in _VERDICTS),
            _number(_median(worse for _, worse in ratios), 2),
            *(_number(_median(cost[k] for cost, _ in ratios), 1) for k in range(4)),
        ])  # fmt: skip
    titles = ["method", *_VERDICTS, "failed", "all pictures", "draws: accepted / refused / wrong"]
    return markdown([*titles, "ATE / SIFT's", *_RATIOS], rows)


_RATIOS = ("SIFT's wall / it", "SIFT's CPU / it", "wall, encoded too", "CPU, encoded too")


def _models_table(results: Many[Result], reference: Result | None) -> str:
    rows: list[list[str]] = []
    for result in results:
        run, model = result["run"], result["model"]
        counts = count_draws(result, reference)
        rows.append([
            result["method"], verdict(result, reference),
            f"{run['registered']} of {result['total']}",
            _number(model["ate_percent"], 3), _number(model["rpe"], 4),
            _number(model["rpe_deg"], 4), _number(model["focal_error_percent"], 2),
            f"{model['points']:,}", f"{model['distinct_points']:,}",
            f"{model['observations']:,}", _number(model["track_length"], 1),
            _number(model["reprojection_px"], 2),
            " / ".join(str(counts[name]) for name in _VERDICTS) if result["draws"] else "",
        ])  # fmt: skip
    titles = ["method", "model", "registered", "ATE %", "RPE", "RPE deg", "focal error %"]
    titles += ["points", "distinct", "observations", "track length", "reprojection px"]
    return markdown([*titles, "draws: accepted / refused / wrong"], rows)


def _costs_table(results: Many[Result], reference: Result | None) -> str:
    rows: list[list[str]] = []
    for result in results:
        run, model, total = result["run"], result["model"], result["total"]
        encoding = result["encoding"]
        encoded = ["", ""]
        if encoding is not None:
            encoded = [_number(encoding[name], 1) for name in ("seconds", "cpu_seconds")]
        ratios = ["", "", "", ""]
        if reference is not None:
            ratios = [_number(ratio, 1) for ratio in _ratios(result, reference)]
        mapping = sum(stage["cpu_s"] for stage in run["stages"] if stage["name"] == "map")
        per_observation = 1e6 * model["ba_cpu_s"] / max(1, model["observations"])
        peak = math.nan if run["peak_rss_mb"] is None else run["peak_rss_mb"]
        rows.append([
            result["method"], _number(run["wall_s"], 1), _number(run["cpu_s"], 1),
            *encoded, *ratios,
            _number(1000 * run["wall_s"] / total, 0), _number(1000 * run["cpu_s"] / total, 0),
            _number(mapping, 1), _number(1000 * model["ba_cpu_s"], 1), _number(per_observation, 1),
            _number(peak, 0),
        ])  # fmt: skip
    titles = ["method", "wall s", "CPU s", "encode wall s", "encode CPU s", *_RATIOS]
    titles += ["wall ms / picture", "CPU ms / picture", "map CPU s", "BA CPU ms / iteration"]
    return markdown([*titles, "BA µs / iteration, observation", "peak MB"], rows)


def _clouds(done: Many[Result], compared: Result | None) -> list[str]:
    """Return the tables of clouds: as they are, and at equal completeness."""
    with_cloud = [result for result in done if result["model"]["cloud"] is not None]
    tables = [_clouds_table(with_cloud)] if with_cloud else []
    if compared is None:
        return tables
    if compared["error"] is not None:
        return [*tables, f"Clouds were not compared: {compared['error']}"]
    return [*tables, _equal_table(compared)] if compared["rows"] else tables


def _clouds_table(results: Many[Result]) -> str:
    """Distances to the true surface, m, and the shares within a hundredth of the median depth."""
    rows: list[list[str]] = []
    for result in results:
        cloud = result["model"]["cloud"]
        near = [score for score in cloud["scores"] if score["threshold"] <= _near(cloud)]
        shares = [100 * near[-1][name] for name in ("precision", "recall", "f_score")]
        accuracy, completeness = cloud["accuracy"], cloud["completeness"]
        rows.append([
            result["method"], _number(accuracy["median"], 4), _number(accuracy["p90"], 3),
            _number(completeness["median"], 3), _number(completeness["p90"], 3),
            _number(cloud["chamfer"], 3), *(_number(share, 1) for share in shares),
        ])  # fmt: skip
    titles = ["method", "accuracy m, median", "p90", "completeness m, median", "p90", "Chamfer m"]
    return markdown([*titles, "precision %", "recall %", "F %"], rows)


def _equal_table(compared: Result) -> str:
    """Own and SIFT's figures of the best points of either that cover as much."""
    names = ("accuracy", "completeness", "chamfer")
    rows: list[list[str]] = []
    for row in compared["rows"]:
        own, sift = row["own"], row["sift"]
        rows.append([
            row["method"], row["equal"],
            *(f"{each['num_points']:,}" for each in (own, sift)),
            *(_number(100 * each["recall"], 1) for each in (own, sift)),
            *(_number(each[name], 4) for name in names for each in (own, sift)),
        ])  # fmt: skip
    titles = ["at equal completeness", "equal is", "points", "SIFT's points"]
    titles += ["recall %", "SIFT's", "accuracy m, mean", "SIFT's"]
    titles += ["completeness m, mean", "SIFT's", "Chamfer m", "SIFT's"]
    return markdown(titles, rows)


def _near(cloud: Mapping[str, Any]) -> float:
    """Distance, m, within which a point counts as right; rounding of the product admitted."""
    return 1.000001 * NEAR * cloud["median_depth"]


def _ratios(result: Result, reference: Result) -> list[float]:
    """How many times the cost of a result SIFT's is: wall, CPU, both with the encoding counted."""
    encoding = result["encoding"] or {"seconds": 0.0, "cpu_seconds": 0.0}
    run, sift = result["run"], reference["run"]
    return [
        sift["wall_s"] / run["wall_s"],
        sift["cpu_s"] / run["cpu_s"],
        sift["wall_s"] / (run["wall_s"] + encoding["seconds"]),
        sift["cpu_s"] / (run["cpu_s"] + encoding["cpu_seconds"]),
    ]


def _worse(result: Result, reference: Result) -> float:
    """ATE over SIFT's; NaN where the reference does not move."""
    own, sift = result["model"]["ate_percent"], reference["model"]["ate_percent"]
    return own / sift if math.isfinite(sift) and sift > 0 else math.nan


def _median(values: Iterator[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return median(known) if known else math.nan


def _number(value: float, decimals: int) -> str:
    if math.isnan(value):
        return ""
    return "∞" if math.isinf(value) else f"{value:,.{decimals}f}"
