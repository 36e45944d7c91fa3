"""Sections of the report page; each returns HTML, or an empty string without its facts."""

from __future__ import annotations

import json
from html import escape

import numpy as np

from mvmatch.report import chart
from mvmatch.report.plain import Facts, items, part


def tiles(facts: Facts) -> str:
    """Key figures at a glance."""
    model, stages = part(facts, "model"), items(facts, "stages")
    shown: list[tuple[str, str]] = []
    if model:
        shown.append((f"{model.get('registered')} / {model.get('total')}", "images registered"))
        shown.append((_count(model.get("num_points")), "3D points"))
        if model.get("dense"):
            points = part(model, "dense").get("num_points")
            shown.append((_count(points), "3D points after densifying"))
        shown.append(
            (_number(model.get("mean_reprojection_error"), 2, " px"), "reprojection error")
        )
        shown.append((_number(model.get("mean_track_length"), 1), "images per point"))
    if facts.get("accuracy"):
        error = part(facts, "accuracy").get("ate_percent")
        shown.append((_number(error, 3, " %"), "trajectory error of the path"))
    if facts.get("matches"):
        shown.append((_count(part(facts, "matches").get("num_tracks")), "tracks"))
    if stages:
        shown.append((chart.seconds(_total(stages, "wall_s")), "elapsed"))
        shown.append((chart.seconds(_total(stages, "cpu_s")), "CPU time"))
    if facts.get("peak_rss_mb"):
        shown.append((_number(facts["peak_rss_mb"], 0, " MB"), "peak memory"))
    cells = (f'<div class="tile"><b>{value}</b><span>{name}</span></div>' for value, name in shown)
    return f'<div class="tiles">{"".join(cells)}</div>' if shown else ""


def notes(facts: Facts) -> str:
    """Warnings and damage."""
    lines = [str(line) for line in items(facts, "warnings")]
    if facts.get("damage"):
        damage = part(facts, "damage")
        lines.insert(0, f"{damage.get('message')} - {damage.get('frames_read')} frames were read")
    if not lines:
        return ""
    listed = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return _section("Warnings", f"<ul>{listed}</ul>")


def findings(facts: Facts) -> str:
    """Return what stands in the way of a whole model, and what to try."""
    found = items(part(facts, "model"), "findings")
    if not found:
        return ""
    lines = (
        f"<li>{escape(str(each.get('sentence')))}<br>"
        f'<span class="soft">{escape(str(each.get("advice")))}</span></li>'
        for each in found
    )
    return _section("What stands in the way", f"<ul>{''.join(lines)}</ul>")


def accuracy(facts: Facts) -> str:
    """Comparison with known poses."""
    known = part(facts, "accuracy")
    if not known:
        return ""
    rows = [
        ("Trajectory error (RMS)", _number(known.get("ate"), 4)),
        ("Path length", _number(known.get("path_length"), 2)),
        ("Error as share of the path", _number(known.get("ate_percent"), 3, " %")),
    ]
    note = "Camera centres after the best rotation, translation and scale, in units of the truth."
    return _section("Accuracy against the truth", f"<p>{note}</p>{_table(rows)}")


def source(facts: Facts) -> str:
    """Input, encoding and camera."""
    given = part(facts, "input")
    if not given:
        return ""
    rows = [
        ("Input", str(given.get("path"))),
        ("Kind", {"av1": "AV1 video, used as it is", "frames": "folder of images"}.get(
            str(given.get("kind")), str(given.get("kind") or "unknown"))),
        ("Size", f"{given.get('width')} x {given.get('height')} px"),
        ("Frames", _count(given.get("num_frames"))),
        ("Frame rate", _rate(given.get("frame_rate"))),
    ]  # fmt: skip
    encoding = part(given, "encoding")
    if encoding:
        rows.append(("Encoded with", f"{encoding.get('encoder')}: {encoding.get('settings')}"))
        size = _number((encoding.get("num_bytes") or 0) / 1000, 0, " kB")
        cost = f"{chart.seconds(encoding.get('seconds') or 0)} elapsed"
        rows.append(("Coded size", f"{size}, {cost}"))
    camera = part(facts, "camera")
    if camera:
        prior = " (a guess, which the mapper refines)" if camera.get("is_prior") else ""
        rows.append(("Camera", f"{camera.get('source')}{prior}"))
        rows.append(("Camera parameters", _parameters(camera, "params")))
        if camera.get("final_params"):
            rows.append(("After mapping", _parameters(camera, "final_params")))
    return _section("Input and camera", _table(rows))


def reference_structure(facts: Facts) -> str:
    """Which frames the vectors point to."""
    found = part(facts, "reference_structure")
    if not found:
        return ""
    keys = items(found, "key_frames")
    listed = ", ".join(str(key) for key in keys[:12]) + (", ..." if len(keys) > 12 else "")
    rows = [
        ("Coded frames", f"{_count(found.get('coded_frames'))}, "
         f"{_count(found.get('hidden_frames') or 0)} of them hidden"),
        ("Key frames", f"{len(keys)} ({listed})" if keys else "none"),
        ("Vectors", f"{_count(found.get('num_vectors'))}, median "
         f"{_count(found.get('median_vectors_per_frame'))} per frame"),
        ("Area with vectors", _percent(found.get("inter_area_share"))),
        ("To the previous frame", _percent(found.get("share_to_previous"))),
    ]  # fmt: skip
    shares = part(found, "area_share_per_distance") or part(found, "vectors_per_distance")
    drawn = ""
    if shares:
        ordered = sorted(shares.items(), key=lambda item: int(item[0]))
        drawn = _figure(
            chart.bars(
                [100 * float(value) for _, value in ordered],
                [distance for distance, _ in ordered],
                x_label="frame minus reference frame",
                y_label="% of the area with vectors",
                format_value="{:.1f} %",
            )
            if found.get("area_share_per_distance")
            else chart.bars(
                [float(value) for _, value in ordered],
                [distance for distance, _ in ordered],
                x_label="frame minus reference frame",
                y_label="vectors",
            ),
            "1 is the previous frame; negative numbers are future frames.",
        )
    return _section("Reference structure", f'<div class="charts">{drawn}{_table(rows)}</div>')


def matches(facts: Facts) -> str:
    """Tracks, keypoints and matches per image."""
    found = part(facts, "matches")
    if not found:
        return ""
    rows = [
        ("Tracks", _count(found.get("num_tracks"))
         + ", aligned to the pictures" * bool(found.get("is_refined"))),
        ("Observations", _count(found.get("num_observations"))),
        ("Track length", f"mean {_number(found.get('mean_track_length'), 1)}, "
         f"longest {_count(found.get('max_track_length'))}"),
        ("Image pairs", f"{_count(found.get('num_pairs'))}, "
         f"{_count(found.get('num_estimated_pairs'))} estimated, "
         f"{_count(found.get('num_verified_pairs'))} verified"),
        ("Matches", f"{_count(found.get('num_matches'))}, "
         f"{_count(found.get('num_inliers'))} kept as inliers"),
        *_loops(facts),
    ]  # fmt: skip
    charts = "".join(
        _figure(
            chart.bars(
                [float(value) for value in found[key]],
                [str(frame) for frame in range(len(found[key]))],
                x_label="frame",
                y_label=label,
            ),
            caption,
        )
        for key, label, caption in (
            ("keypoints_per_image", "keypoints", "Track points in each image."),
            ("matches_per_image", "matches", "Matches of each image with all others."),
        )
        if found.get(key)
    )
    return _section("Tracks and matches", f'{_table(rows)}<div class="charts">{charts}</div>')


def adjacency(facts: Facts) -> str:
    """Image pairs with correspondences: straight from the stream, and through tracks."""
    drawn = [
        (facts[key], caption)
        for key, caption in (
            ("adjacency_before", "Vectors of the stream: pairs the encoder linked directly."),
            ("adjacency_after", "Matches through tracks: pairs that share points."),
        )
        if facts.get(key)
    ]
    if not drawn:
        return ""
    counted = [(np.array(rows, np.int64).reshape(-1, 3), caption) for rows, caption in drawn]
    top = max(float(pairs[:, 2].max(initial=0)) for pairs, _ in counted)
    frames = max(int(pairs[:, :2].max(initial=0)) + 1 for pairs, _ in counted)
    frames = max(frames, len(items(part(facts, "matches"), "keypoints_per_image")))
    figures = "".join(
        _figure(chart.heatmap(pairs, frames, label=caption, top=top), caption)
        for pairs, caption in counted
    )
    return _section(
        "Which images are connected",
        f'<div class="charts">{figures}</div>'
        f'<p class="soft">Number of correspondences, logarithmic; white: none.</p>'
        f"{chart.colour_key(top)}",
    )


def scores(facts: Facts) -> str:
    """Two-view geometry: histograms over pairs and a table over frame distances."""
    found = [row for row in items(facts, "scores") if row.get("num_correspondences")]
    if not found:
        return ""
    ratio = [row["inlier_ratio"] or 0.0 for row in found]
    sampson = [row["median_sampson_px"] for row in found if row["median_sampson_px"] is not None]
    figures = _figure(
        chart.histogram(ratio, x_label="inlier ratio", y_label="image pairs", upper=1.0),
        "Share of correspondences that fit one camera motion, per estimated image pair.",
    )
    if sampson:
        figures += _figure(
            chart.histogram(sampson, x_label="median Sampson error, px", y_label="image pairs"),
            "Distance of the inliers from their epipolar geometry. It cannot see errors along "
            "the epipolar line.",
        )
    return _section(
        "Two-view geometry", f'<div class="charts">{figures}</div>{_distance_table(found)}'
    )


def _loops(facts: Facts) -> list[tuple[str, str]]:
    """Pairs of images far apart in time, where they were looked for."""
    if facts.get("loops") is None:
        return []
    return [("Image pairs of closed loops", _count(len(items(facts, "loops"))))]


def _dense(found: Facts, *, is_refined: bool) -> list[tuple[str, str]]:
    if not found:
        return []
    added, tracks = _count(found.get("num_added")), _count(found.get("num_tracks"))
    text = f"{_count(found.get('num_points'))}: {added} of {tracks} further tracks added"
    text += ", aligned to the pictures" * is_refined
    return [("Points after densifying", text)]


def model(facts: Facts) -> str:
    """Return the result of the mapper, and each attempt."""
    found = part(facts, "model")
    if not found:
        return ""
    rows = [
        ("Mapper", str(found.get("mapper"))),
        ("Registered", f"{found.get('registered')} of {found.get('total')}"),
        ("Points", _count(found.get("num_points"))),
        *_dense(
            part(found, "dense"),
            is_refined=bool(part(facts, "matches").get("is_further_refined")),
        ),
        ("Mean reprojection error", _number(found.get("mean_reprojection_error"), 3, " px")),
        ("Mean track length", _number(found.get("mean_track_length"), 2, " images")),
        *([("Further models", ", ".join(items(found, "further")))] if found.get("further") else []),
        ("Accepted", "yes" if found.get("accepted", True) else "no"),
    ]
    reasons = "".join(f"<li>{escape(str(reason))}</li>" for reason in items(found, "reasons"))
    attempts = items(found, "attempts")
    details = ""
    if len(attempts) > 1:
        text = escape(json.dumps(attempts, indent=1))
        details = f"<details><summary>{len(attempts)} attempts</summary><pre>{text}</pre></details>"
    return _section("Model", f"{_table(rows)}{f'<ul>{reasons}</ul>' if reasons else ''}{details}")


def cost(facts: Facts) -> str:
    """Time and memory per stage."""
    stages = items(facts, "stages")
    if not stages:
        return ""
    drawn = chart.paired_bars(
        [str(stage.get("name")) for stage in stages],
        [float(stage.get("wall_s") or 0) for stage in stages],
        [float(stage.get("cpu_s") or 0) for stage in stages],
        keys=("elapsed", "CPU"),
    )
    figure = _figure(drawn, "CPU time adds all threads and child processes.")
    return _section("Cost", f'<div class="wide">{figure}</div>')


def options(facts: Facts) -> str:
    """Effective options, folded."""
    found = part(facts, "options")
    if not found:
        return ""
    text = escape(json.dumps(found, indent=1))
    return _section("Options", f"<details><summary>All options of this run</summary>"
                    f"<pre>{text}</pre></details>")  # fmt: skip


def _distance_table(found: list[Facts]) -> str:
    """One row per frame distance: pairs, matches, inliers, error."""
    by_distance: dict[int, list[Facts]] = {}
    for row in found:
        by_distance.setdefault(abs(row["frame1"] - row["frame0"]), []).append(row)
    lines = [
        "<tr><th>frames apart</th><th>pairs</th><th>median matches</th>"
        "<th>median inlier ratio</th><th>median Sampson, px</th><th>E / H / none</th></tr>"
    ]
    for distance in sorted(by_distance)[:20]:
        rows = by_distance[distance]
        errors = [r["median_sampson_px"] for r in rows if r["median_sampson_px"] is not None]
        models = [sum(r["model"] == kind for r in rows) for kind in ("E", "H", None)]
        cells = (
            str(distance),
            _count(len(rows)),
            _count(float(np.median([r["num_correspondences"] for r in rows]))),
            _number(float(np.median([r["inlier_ratio"] or 0 for r in rows])), 3),
            _number(float(np.median(errors)), 3) if errors else "-",
            " / ".join(map(str, models)),
        )
        lines.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    return f'<div class="wide"><table class="numbers">{"".join(lines)}</table></div>'


def _section(title: str, content: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{content}</section>"


def _figure(drawing: str, caption: str) -> str:
    return f"<figure>{drawing}<figcaption>{escape(caption)}</figcaption></figure>"


def _table(rows: list[tuple[str, str]]) -> str:
    lines = (f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    return f"<div><table>{''.join(lines)}</table></div>"


def _parameters(camera: Facts, key: str) -> str:
    values = ", ".join(f"{value:.2f}" for value in items(camera, key))
    return f"{camera.get('model')} {values}"


def _count(value: float | None) -> str:
    return "-" if value is None else f"{value:,.0f}"


def _number(value: float | None, digits: int, unit: str = "") -> str:
    return "-" if value is None else f"{value:,.{digits}f}{unit}"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f} %"


def _total(stages: list[Facts], key: str) -> float:
    return sum(float(stage.get(key) or 0) for stage in stages)


def _rate(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g} per s"
