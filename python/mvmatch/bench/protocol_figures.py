"""Figures of the protocol at the width of a column: utilisation, adjacency, error bars."""

# matplotlib's stubs are incomplete.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.bench.protocol_judge import MAP
from mvmatch.bench.protocol_summary import Row, summarise
from mvmatch.bench.sampling import Sample, utilisation

if TYPE_CHECKING:
    from collections.abc import Sequence as Many
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from mvmatch.bench.store import Result

WIDTH = 3.5
"""Inches: a column of a paper in two columns."""

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's, told apart with every kind of colour vision; lines differ in dashes too."""

_DASHES: tuple[Any, ...] = ("-", "--", "-.", ":")
_MARKERS = "osD^vP*"
_BINS = 80
"""Points of a curve of utilisation, at most."""

_STYLE: dict[Any, Any] = {
    "font.size": 8, "axes.labelsize": 8, "legend.fontsize": 6.5, "xtick.labelsize": 7,
    "ytick.labelsize": 7, "lines.linewidth": 1.2, "axes.grid": True, "grid.alpha": 0.3,
    "svg.hashsalt": "mvmatch",
}  # fmt: skip


def write_figures(results: Many[Result], folder: Path) -> list[Path]:
    """Draw every figure as PNG and SVG.

    Returns
    -------
    list of Path
        ``NAME.png`` and ``NAME.svg`` of ``cpu-SEQUENCE``, ``errors-SEQUENCE`` and
        ``adjacency-SEQUENCE-METHOD``, for what has a result.
    """
    import matplotlib as mpl

    folder.mkdir(parents=True, exist_ok=True)
    done = [result for result in results if result["error"] is None]
    made: list[Path] = []
    with mpl.rc_context(_STYLE):
        for name in dict.fromkeys(result["sequence"] for result in done):
            own = [result for result in done if result["sequence"] == name]
            if any(len(result["usage"]["samples"]) > 1 for result in own):
                made += _save(draw_utilisation(own), folder, f"cpu-{name}")
            made += _save(draw_errors(summarise(own)), folder, f"errors-{name}")
            for result in own:
                figure = draw_adjacency(result)
                made += _save(figure, folder, f"adjacency-{name}-{result['method']}")
    return made


def draw_utilisation(results: Many[Result]) -> Figure:
    """Draw processors in use over time, one curve per method; 100 % is one core.

    A dot marks the end of verification, where the mapper begins. Time is logarithmic: methods
    differ by a factor of fifty.
    """
    figure, axes = _figure(2.8)
    for number, result in enumerate(results):
        usage = result["usage"]
        times, cores = binned([Sample(**sample) for sample in usage["samples"]])
        style = {"color": COLOURS[number % len(COLOURS)], "ls": _DASHES[number % len(_DASHES)]}
        axes.plot(times, 100 * cores, label=result["method"], **style)
        ends = [stage["begin_s"] for stage in result["stages"] if stage["name"] == MAP]
        if ends and len(times):
            at = ends[0] - usage["begin_s"]
            axes.plot(at, 100 * np.interp(at, times, cores), "o", ms=3.5, color=style["color"])
    processors = max(result["usage"]["processors"] or 1 for result in results)

    def shared(percent: NDArray[np.float64]) -> NDArray[np.float64]:
        return percent / processors

    def single(percent: NDArray[np.float64]) -> NDArray[np.float64]:
        return percent * processors

    share = axes.secondary_yaxis("right", functions=(shared, single))
    share.set_ylabel(f"share of the machine (%, {processors} processors)")
    axes.set_xlabel("time (s); dot: the mapper begins")
    axes.set_ylabel("CPU utilisation (%, 100 = one core)")
    axes.set_ylim(bottom=0)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    _legend(axes)
    return figure


def draw_adjacency(result: Result) -> Figure:
    """Draw the matches of every pair of frames, logarithmic.

    Of vectors before and after tracks join them (the paper's figure 1), of other methods before and
    after verification.
    """
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import MaxNLocator

    before, after = adjacency(result)
    linked = result["adjacency"]["linked"] is not None
    titles = ("vectors alone", "tracks, verified") if linked else ("matches", "verified")
    figure, panels = _figure(1.95, columns=2)
    top = max(10.0, float(before.max()))
    norm = LogNorm(1, top)
    image = None
    for axes, counts, title in zip(panels, (before, after), titles, strict=True):
        shown = np.ma.masked_equal(counts, 0)
        image = axes.imshow(shown, norm=norm, cmap="cividis_r", interpolation="nearest")
        axes.set_title(title, fontsize=8)
        axes.set_xlabel("frame")
        axes.grid(visible=False)
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(5, integer=True))
    panels[0].set_ylabel("frame")
    panels[1].tick_params(labelleft=False)
    if image is not None:
        figure.colorbar(image, ax=panels, label="matches of a pair", shrink=0.8)
    return figure


def draw_errors(rows: Many[Row]) -> Figure:
    """Draw inlier ratio, Sampson error and AUC of every method; bars are deviations over seeds."""
    methods = list(dict.fromkeys(row["method"] for row in rows))
    gaps = sorted({row["gap"] for row in rows if row["gap"] is not None})
    shown = (
        ("inlier_ratio", "inlier ratio (%)", 100),
        ("sampson_px", "Sampson error (px)", 1),
        ("auc_5", "AUC@5° (%)", 100),
    )
    figure, panels = _figure(1.2 + 1.25 * len(shown), rows=len(shown))
    for axes, (name, label, factor) in zip(panels, shown, strict=True):
        for number, gap in enumerate(gaps):
            own = [row for row in rows if row["gap"] == gap]
            x = [
                methods.index(row["method"]) + 0.18 * (number - (len(gaps) - 1) / 2) for row in own
            ]
            bars = [factor * _known(row[f"{name}_std"]) for row in own]
            axes.errorbar(
                x, [factor * row[name] for row in own], yerr=bars, ls="", capsize=2.5, ms=4,
                marker=_MARKERS[number % len(_MARKERS)], color=COLOURS[number % len(COLOURS)],
                label=f"gap {gap}",
            )  # fmt: skip
        axes.set_ylabel(label)
        axes.ticklabel_format(axis="y", useOffset=False, style="plain")
        axes.set_xticks(range(len(methods)), [""] * len(methods))
        axes.set_xlim(-0.5, len(methods) - 0.5)
    panels[-1].set_xticks(range(len(methods)), methods, rotation=40, ha="right")
    _legend(panels[0])
    return figure


def binned(samples: Many[Sample]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times, s, and processors in use, averaged over intervals of equal length.

    Every interval holds CPU time of the same samples as the raw curve: the area is kept.
    """
    if len(samples) < 2:
        return np.empty(0), np.empty(0)
    times = np.array([sample.time_s for sample in samples])
    used = np.array([sample.cpu_s for sample in samples])
    if len(samples) <= _BINS:
        curve = np.array(utilisation(samples)).reshape(-1, 2)
        return curve[:, 0], curve[:, 1]
    edges = np.linspace(times[0], times[-1], _BINS + 1)
    return (edges[1:] + edges[:-1]) / 2, np.diff(np.interp(edges, times, used)) / np.diff(edges)


def adjacency(result: Result) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the (F, F) symmetric counts of the two panels of :func:`draw_adjacency`."""
    frames = result["num_frames"]
    before, after = (np.zeros((frames, frames), np.int64) for _ in range(2))
    pairs = np.array(result["adjacency"]["pairs"], np.int64).reshape(-1, 4)
    linked = result["adjacency"]["linked"]
    first = pairs if linked is None else np.array(linked, np.int64).reshape(-1, 3)
    for counts, rows, column in ((before, first, 2), (after, pairs, 3)):
        counts[rows[:, 0], rows[:, 1]] = counts[rows[:, 1], rows[:, 0]] = rows[:, column]
    return before, after


def _figure(height: float, *, rows: int = 1, columns: int = 1) -> tuple[Figure, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns)


def _legend(axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    axes.figure.legend(handles, labels, loc="outside upper center", ncols=3, frameon=False)


def _known(spread: float) -> float:
    return spread if math.isfinite(spread) else 0.0


def _save(figure: Figure, folder: Path, name: str) -> list[Path]:
    paths = [folder / f"{name}.{kind}" for kind in ("png", "svg")]
    figure.savefig(paths[0], dpi=300)
    figure.savefig(paths[1], metadata={"Date": None})
    return paths
