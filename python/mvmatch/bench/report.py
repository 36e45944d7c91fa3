"""The tables of a run: Markdown for people, JSON and Parquet with every row."""

# pyarrow carries no types.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import dataclasses
import json
import math
import os
import platform
from importlib import metadata
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.bench.accuracy import COLUMNS
from mvmatch.bench.datasets import SPLIT_RULE, Half, half_of
from mvmatch.bench.summary import Summary, Value, average, comparable, summarise
from mvmatch.outputs import provenance
from mvmatch.report.plain import plain

if TYPE_CHECKING:
    from collections.abc import Sequence as Many
    from pathlib import Path

    from mvmatch.bench.run import RunOptions

TABLES, SUMMARY, ROWS = "accuracy.md", "accuracy.json", "accuracy.parquet"

_SHOWN = {
    "matches": ("matches", 1, 0),
    "distinct": ("distinct", 1, 0),
    "coverage": ("cover %", 100, 1),
    "right_coverage": ("right cover %", 100, 1),
    "within_1px": ("< 1 px %", 100, 1),
    "within_3px": ("< 3 px %", 100, 1),
    "verified_within_1px": ("verified < 1 px %", 100, 1),
    "median_px": ("median px", 1, 2),
    "along_px": ("along px", 1, 2),
    "across_px": ("across px", 1, 2),
    "auc_1": ("AUC@1", 100, 1),
    "auc_5": ("AUC@5", 100, 1),
    "auc_10": ("AUC@10", 100, 1),
    "auc_20": ("AUC@20", 100, 1),
}
"""Measure to title, factor and decimals."""
_BRIEF = ("distinct", "right_coverage", "within_1px", "within_3px", "median_px", "auc_1", "auc_5")
_LIBRARIES = ("opencv-python-headless", "embreex", "imageio-ffmpeg", "torch", "kornia")


def write_tables(results: Many[dict[str, Any]], options: RunOptions) -> list[Path]:
    """Write the tables of a run into its folder.

    Returns
    -------
    list of Path
        Markdown, JSON, Parquet.
    """
    paths = [options.out / name for name in (TABLES, SUMMARY, ROWS)]
    paths[0].write_text(tables(results), encoding="utf-8")
    document = {
        **provenance(),
        "machine": machine(),
        "split": SPLIT_RULE,
        "columns": COLUMNS,
        "options": dataclasses.asdict(options),
        "summary": [dataclasses.asdict(summary) for summary in summarise(results)],
        "cells": [
            {name: value for name, value in result.items() if name != "rows"} for result in results
        ],
    }
    paths[1].write_text(json.dumps(plain(document), indent=1), encoding="utf-8")
    _write_rows(results, paths[2])
    return paths


def machine() -> dict[str, Any]:
    """Return what ran, besides the versions in :func:`mvmatch.outputs.provenance`."""
    return {
        "machine": platform.machine(),
        "processors": os.cpu_count(),
        "versions": {name: _version(name) for name in _LIBRARIES},
    }


def tables(results: Many[dict[str, Any]]) -> str:
    """Return all tables as Markdown."""
    parts = [f"The split: {SPLIT_RULE}."]
    for half in ("reporting", "tuning"):
        averaged = average(results, half)
        if averaged:
            parts += [f"## Average of the {half} half", caption(results, half)]
            parts.append(_measures_table(averaged, tuple(_SHOWN)))
    for sequence, found in _by_sequence(summarise(results)).items():
        half = half_of(sequence)
        parts += [f"## {sequence}", f"Of the {half} half. {caption(results, half)}"]
        parts.append(_measures_table(found, _BRIEF))
    parts += ["## Cost and tracks", _cost_table(results)]
    if any(result["models"] for result in results):
        parts += ["## Models", _models_table(results)]
    failed = [result for result in results if result["error"] is not None]
    if failed:
        lines = [f"- {each['sequence']}, {each['method']}: {each['error']}" for each in failed]
        parts += ["## What failed", "\n".join(lines)]
    return "\n\n".join(parts) + "\n"


def caption(results: Many[dict[str, Any]], half: Half) -> str:
    """Say which sequences a table rests on, and which the other half is."""
    other: Half = "tuning" if half == "reporting" else "reporting"
    names = {side: comparable(results, side) for side in (half, other)}
    text = "; ".join(f"{side}: {', '.join(names[side]) or 'none'}" for side in (half, other))
    plain_names = {result["sequence"] for result in results if "+" not in result["sequence"]}
    missing = sorted(plain_names.difference(*names.values()))
    left_out = ""
    if missing:
        left_out = f" Left out of averages, as not every method has a result: {', '.join(missing)}."
    return f"Sequences, {text}.{left_out}"


def _measures_table(summaries: Many[Summary], names: tuple[str, ...]) -> str:
    names = tuple(
        name
        for name in names
        if not all(math.isnan(each.measures[name].value) for each in summaries)
    )
    rows = [
        [str(each.gap), each.method, *(_text(each.measures[name], name) for name in names)]
        for each in sorted(summaries, key=lambda each: each.gap)
    ]
    return markdown(["gap", "method", *(_SHOWN[name][0] for name in names)], rows)


def _text(value: Value, name: str) -> str:
    _, factor, decimals = _SHOWN[name]
    if math.isnan(value.value):
        return ""
    if math.isinf(value.value):
        return "∞"
    text = f"{factor * value.value:,.{decimals}f}"
    known = math.isfinite(value.spread) and name not in {"matches", "distinct"}
    return f"{text} ± {factor * value.spread:.{decimals}f}" if known else text


_OPTIONAL = ("encode", "refine")
"""Stages that not every method has."""


def _cost_table(results: Many[dict[str, Any]]) -> str:
    rows: list[list[str]] = []
    for result in results:
        if result["error"] is not None:
            continue
        counts = np.array(result["track_lengths"] or [], np.int64)
        lengths = np.repeat(np.arange(len(counts)), counts)
        size = result["details"].get("num_bytes")
        tracks = ["", "", ""]
        if len(lengths):
            median, long = np.median(lengths), (lengths >= 10).mean()
            tracks = [f"{len(lengths):,}", f"{median:.0f}", f"{100 * long:.0f}"]
        cost = result["cost"]
        encode, refine = (f"{cost[stage]:.1f}" if stage in cost else "" for stage in _OPTIONAL)
        kilobytes = f"{size / 1000:.0f}" if size else ""
        names = [result["sequence"], result["method"]]
        rows.append([*names, kilobytes, encode, f"{cost['match']:.1f}", refine, *tracks])
    titles = ["sequence", "method", "kB", "encode CPU s", "match CPU s", "refine CPU s"]
    return markdown([*titles, "tracks", "median length", "≥ 10 frames %"], rows)


def _models_table(results: Many[dict[str, Any]]) -> str:
    rows: list[list[str]] = []
    for result in results:
        models = sorted(result["models"], key=lambda model: model["draw"])
        if not models:
            continue
        full, draws = models[0], [model for model in models if model["draw"] >= 0]
        ates = np.array([model["ate_percent"] for model in draws], np.float64)
        known = ates[np.isfinite(ates)]
        spread = f"{known.mean():.3f} ± {known.std(ddof=1):.3f}" if len(known) > 1 else ""
        rows.append([
            result["sequence"], result["method"], f"{full['registered']} of {full['total']}",
            f"{full['ate_percent']:.3f}", spread, f"{len(known)} of {len(ates)}",
            f"{full['rpe']:.4f}", f"{full['rpe_deg']:.4f}", f"{full['reprojection_px']:.2f}",
            f"{full['points']:,}", f"{full['distinct_points']:,}", f"{full['track_length']:.1f}",
            f"{full['verify_cpu_s']:.1f}", f"{full['map_cpu_s']:.1f}",
        ])  # fmt: skip
    titles = ["sequence", "method", "registered", "ATE %", "ATE % of the draws", "accepted draws"]
    more = ["RPE", "RPE deg", "reprojection px", "points", "distinct", "track length"]
    more += ["verify CPU s", "mapper CPU s"]
    return markdown([*titles, *more], rows)


def markdown(titles: Many[str], rows: Many[Many[str]]) -> str:
    """Return a Markdown table."""
    lines = [titles, ["---"] * len(titles), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _by_sequence(summaries: Many[Summary]) -> dict[str, list[Summary]]:
    found: dict[str, list[Summary]] = {}
    for summary in summaries:
        found.setdefault(summary.sequences[0], []).append(summary)
    return found


def _write_rows(results: Many[dict[str, Any]], path: Path) -> None:
    """Write one row per (sequence, method, gap, pair, draw); a failed cell is one row."""
    import pyarrow as pa
    from pyarrow import parquet

    rows: list[dict[str, Any]] = []
    for result in results:
        sequence = result["sequence"]
        head = {"sequence": sequence, "half": half_of(sequence), "method": result["method"]}
        rows += [{**head, "error": None, **row} for row in result["rows"]]
        if result["error"] is not None:
            rows.append({**head, "error": result["error"]})
    texts = ("sequence", "half", "method", "error")
    fields = [(name, pa.string()) for name in texts]
    fields += [(name, pa.float64()) for name in COLUMNS]
    table = pa.Table.from_pylist(rows, schema=pa.schema(fields))
    parquet.write_table(table.replace_schema_metadata(COLUMNS), path, compression="zstd")


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None
