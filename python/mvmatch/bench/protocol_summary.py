"""From the cells of the protocol to one flat row per sequence, method and gap."""

# pyarrow carries no types.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.bench.protocol_judge import PAIR_COLUMNS, VERIFY
from mvmatch.bench.protocol_methods import MATCH, METHODS, PREPROCESS, VectorMethod
from mvmatch.geometry.pose_error import pose_auc

if TYPE_CHECKING:
    from collections.abc import Sequence as Many
    from pathlib import Path

    from numpy.typing import NDArray

    from mvmatch.bench.store import Result

AUC_DEGREES = (5.0, 10.0, 20.0)
STAGES = ("encode", PREPROCESS, MATCH, VERIFY, "map")
"""As the tables show them; mapping includes the points added behind it."""

_ESTIMATED = ("inlier_ratio", "sampson_px", "sampson_normalized")
_OF_MODELS = (
    "registered", "total", "points", "distinct_points", "reprojection_px", "track_length", "ate",
    "ate_percent", "rpe", "rpe_deg", "ba_cpu_s",
)  # fmt: skip

_TEXTS = ("sequence", "method", "error", "encoder")
_COUNTS = (
    "gap", "pairs", "num_frames", "num_bytes", "registered", "total", "points", "distinct_points",
)  # fmt: skip

Row = dict[str, Any]


def summarise(results: Many[Result]) -> list[Row]:
    """Return one row per sequence, method and gap; a cell without a result has one, gap None.

    Of every pair and measure the median over its estimations counts. Over the pairs of a gap ratios
    and counts are averaged, Sampson errors give their median, and pose errors the area under their
    recall curve (``auc_5`` ...). ``..._std`` is the standard deviation over the seeds of the figure
    that each seed alone gives: it tells what chance in the estimation does, not what other footage
    would.
    """
    rows: list[Row] = []
    for result in results:
        head = _head(result)
        gaps = sorted({row["gap"] for row in result["rows"]})
        rows += [head | {"gap": gap} | _at_gap(result["rows"], gap) for gap in gaps]
        if not gaps:
            rows.append(head | {"gap": None})
    return rows


def costs(result: Result) -> dict[str, tuple[float, float]]:
    """Return elapsed and CPU time, s, of the :data:`STAGES` that a cell has.

    Where reading vectors and chaining them are one stage, what reading alone took (measured in a
    pass of its own) is taken off matching and shown as what precedes it.
    """
    found: dict[str, tuple[float, float]] = {}
    if result["encoding"] is not None:
        found["encode"] = result["encoding"]["seconds"], result["encoding"]["cpu_seconds"]
    for stage in result["stages"]:
        name = "map" if stage["name"] == "densify" else stage["name"]
        wall, cpu = found.get(name, (0.0, 0.0))
        found[name] = wall + stage["wall_s"], cpu + stage["cpu_s"]
    if result["reading"] is not None:
        reading, whole = result["reading"], found[MATCH]
        found[PREPROCESS] = reading["wall_s"], reading["cpu_s"]
        found[MATCH] = (
            max(0.0, whole[0] - reading["wall_s"]),
            max(0.0, whole[1] - reading["cpu_s"]),
        )
    return found


def by_seed(rows: Many[Row], name: str) -> NDArray[np.float64]:
    """(pairs, seeds) values of a measure."""
    seeds = len({row["seed"] for row in rows})
    ordered = sorted(rows, key=lambda row: (row["frame0"], row["seed"]))
    return np.array([row[name] for row in ordered], np.float64).reshape(-1, seeds)


def write_parquet(results: Many[Result], summary: Path, pairs: Path) -> None:
    """Write the rows of :func:`summarise`, and every estimation of every pair."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = summarise(results)
    kinds = {**dict.fromkeys(_TEXTS, pa.string()), **dict.fromkeys(_COUNTS, pa.int64())}
    kinds["accepted"] = pa.bool_()
    names = dict.fromkeys(name for row in rows for name in row)
    schema = pa.schema([(name, kinds.get(name, pa.float64())) for name in names])
    pq.write_table(pa.Table.from_pylist(rows, schema=schema), summary, compression="zstd")
    every = [
        {"sequence": result["sequence"], "method": result["method"], **row}
        for result in results
        for row in result["rows"]
    ]
    floats = {"sampson_px", "sampson_normalized", "rotation_deg", "translation_deg", "pose_deg"}
    floats.add("inlier_ratio")
    fields = [pa.field("sequence", pa.string()), pa.field("method", pa.string())]
    for name, meaning in PAIR_COLUMNS.items():
        kind = pa.float64() if name in floats else pa.int64()
        fields.append(pa.field(name, kind, metadata={"description": meaning}))
    table = pa.Table.from_pylist(every, schema=pa.schema(fields))
    pq.write_table(table, pairs, compression="zstd")


def _head(result: Result) -> Row:
    """Return what does not depend on the gap."""
    row: Row = {name: result[name] for name in ("sequence", "method", "error", "num_frames")}
    method = METHODS.get(result["method"])
    vectors = isinstance(method, VectorMethod)
    row["encoder"] = result["method"].removesuffix(f"-{method.preset}") if vectors else None
    row["num_bytes"] = result["encoding"]["num_bytes"] if result["encoding"] else None
    found = costs(result)
    for stage in STAGES:
        wall, cpu = found.get(stage, (None, None))
        row |= {f"{stage}_wall_s": wall, f"{stage}_cpu_s": cpu}
    usage, adjacency, model = result["usage"], result["adjacency"], result["model"]
    row["peak_rss_mb"] = usage["peak_rss_mb"] if usage else None
    front = [found[stage] for stage in (PREPROCESS, MATCH, VERIFY) if stage in found]
    wall, cpu = (sum(cost) for cost in zip(*front, strict=True)) if front else (None, None)
    row |= {"front_end_wall_s": wall, "front_end_cpu_s": cpu}
    row["cores"] = cpu / wall if wall and cpu is not None else None
    row["keypoints"] = adjacency["keypoints"] if adjacency else None
    for place, name in ((2, "matches_per_image"), (3, "inliers_per_image")):
        # A match belongs to both of its images.
        total = 2 * sum(pair[place] for pair in adjacency["pairs"]) if adjacency else None
        row[name] = None if total is None else total / result["num_frames"]
    row |= {name: model[name] if model else None for name in _OF_MODELS}
    row["accepted"] = model["accepted"] if model else None
    return row


def _at_gap(rows: Many[Row], gap: int) -> Row:
    chosen = [row for row in rows if row["gap"] == gap]
    found: Row = {"pairs": len({row["frame0"] for row in chosen})}
    for name in ("matches", "distinct"):
        found[name] = float(by_seed(chosen, name)[:, 0].mean())
    for name in _ESTIMATED:
        values = by_seed(chosen, name)
        reduce = np.mean if name == "inlier_ratio" else _median
        found[name] = float(reduce(_rowwise(values)))
        alone = [float(reduce(values[:, seed])) for seed in range(values.shape[1])]
        found[f"{name}_std"] = float(np.std(alone, ddof=1)) if len(alone) > 1 else math.nan
    poses = by_seed(chosen, "pose_deg")
    poses = poses[~np.isnan(poses).any(axis=1)]  # those whose true poses are known
    areas = np.array([pose_auc(poses[:, seed], AUC_DEGREES) for seed in range(poses.shape[1])])
    middle = pose_auc(np.median(poses, axis=1), AUC_DEGREES)
    for number, degrees in enumerate(AUC_DEGREES):
        found[f"auc_{degrees:g}"] = middle[number]
        spread = float(areas[:, number].std(ddof=1)) if len(areas) > 1 else math.nan
        found[f"auc_{degrees:g}_std"] = spread
    return found


def _rowwise(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([_median(row) for row in values])


def _median(values: NDArray[np.float64]) -> float:
    """Median of what is there; NaN of nothing."""
    known = values[~np.isnan(values)]
    return float(np.median(known)) if len(known) else math.nan
