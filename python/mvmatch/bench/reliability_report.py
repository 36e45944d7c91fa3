"""What the reliability of confidences looks like: Markdown, JSON, a reliability diagram."""

# pyright: reportUnknownMemberType=false
# (matplotlib types its methods in part only)

from __future__ import annotations

import dataclasses
import json
from typing import TYPE_CHECKING, get_args

from mvmatch.bench.datasets import SPLIT_RULE, Half
from mvmatch.bench.reliability import GROSS, RIGHT, Reliability, Stream
from mvmatch.bench.report import markdown
from mvmatch.outputs import provenance
from mvmatch.report.plain import plain

if TYPE_CHECKING:
    from collections.abc import Sequence as Many
    from pathlib import Path

    from matplotlib.axes import Axes

    from mvmatch.bench.reliability import ReliabilityOptions

    Rated = tuple[Stream, Reliability]

TABLE, SUMMARY, DIAGRAM = "confidence.md", "confidence.json", "confidence.png"


def write_reliability(results: Many[Rated], options: ReliabilityOptions) -> list[Path]:
    """Write table, JSON and diagram into the folder of the run and return their paths."""
    paths = [options.out / name for name in (TABLE, SUMMARY, DIAGRAM)]
    paths[0].write_text(reliability_table(results), encoding="utf-8")
    document = {
        **provenance(),
        "split": SPLIT_RULE,
        "options": dataclasses.asdict(options),
        "streams": [
            {**dataclasses.asdict(stream), **dataclasses.asdict(reliability)}
            for stream, reliability in results
        ],
    }
    paths[1].write_text(json.dumps(plain(document), indent=1), encoding="utf-8")
    draw_diagram(results, paths[2])
    return paths


def reliability_table(results: Many[Rated]) -> str:
    """Return one row per stream and the mean over the streams of each half, as Markdown."""
    titles = [
        "half", "sequence", "encoder", "quality", "vectors", "confidence %", f"< {RIGHT:g} px %",
        "calibration error %", f"> {GROSS:g} px %", "of the confident half %",
    ]  # fmt: skip
    rows: list[list[str]] = []
    for half in reversed(get_args(Half)):
        found = [each for each in results if each[0].half == half]
        rows += [_row(half, [each]) for each in found]
        if found:
            rows.append(_row(half, found))
    return f"The split: {SPLIT_RULE}.\n\n{markdown(titles, rows)}\n"


def draw_diagram(results: Many[Rated], path: Path) -> None:
    """Draw the share of right vectors over their confidence, one panel per half.

    Above: a line per stream, on the diagonal if confidence is what it says; below: the share of the
    half's vectors in each bin, streams with the same weight.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    halves = [half for half in reversed(get_args(Half)) if any(s.half == half for s, _ in results)]
    figure = Figure(figsize=(5.5 * len(halves), 6.5), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(
        2, len(halves), squeeze=False, sharex=True, height_ratios=(4, 1), sharey="row"
    )
    for column, half in enumerate(halves):
        found = [each for each in results if each[0].half == half]
        _draw_lines(panels[0, column], found)
        panels[0, column].set_title(f"{half} half")
        _draw_counts(panels[1, column], found)
        panels[1, column].set_xlabel(f"confidence to be within {RIGHT:g} px of the truth")
    panels[0, 0].set_ylabel(f"share within {RIGHT:g} px of the truth")
    panels[1, 0].set_ylabel("share of vectors")
    figure.savefig(path)


def _draw_lines(axes: Axes, found: Many[Rated]) -> None:
    axes.plot([0, 1], [0, 1], color="0.6", linewidth=1)
    names = list(dict.fromkeys(stream.encoder for stream, _ in found))
    for stream, reliability in found:
        # A handful of vectors says nothing.
        bins = [each for each in reliability.bins if each.count >= 50]
        first = stream == next(s for s, _ in found if s.encoder == stream.encoder)
        axes.plot(
            [each.confidence for each in bins],
            [each.hits for each in bins],
            color=f"C{names.index(stream.encoder)}",
            linewidth=1,
            marker=".",
            label=stream.encoder if first else None,
        )
    axes.set(xlim=(0, 1), ylim=(0, 1))
    axes.legend()


def _draw_counts(axes: Axes, found: Many[Rated]) -> None:
    pairs = [
        (each.confidence, each.count / reliability.count / len(found))
        for _, reliability in found
        for each in reliability.bins
    ]
    places, shares = zip(*pairs, strict=True)
    axes.hist(places, bins=[k / 10 for k in range(11)], weights=shares, color="0.6")


def _row(half: Half, found: Many[Rated]) -> list[str]:
    """Return the row of a stream, or of the mean over several."""
    ratings = [reliability for _, reliability in found]

    def mean(name: str) -> float:
        return 100 * sum(getattr(each, name) for each in ratings) / len(ratings)

    names = [f"mean of {len(found)} streams", "", ""]
    if len(found) == 1:
        stream = found[0][0]
        quality = "default" if stream.quality is None else str(stream.quality)
        names = [stream.sequence, stream.encoder, quality]
    return [
        half, *names, f"{sum(each.count for each in ratings):,}",
        f"{mean('confidence'):.1f}", f"{mean('hits'):.1f}", f"{mean('calibration_error'):.1f}",
        f"{mean('gross'):.2f}", f"{mean('gross_confident'):.2f}",
    ]  # fmt: skip
