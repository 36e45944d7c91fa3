"""The tables of the protocol, shaped as the paper's I to IV, as Markdown and LaTeX."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from mvmatch.bench.protocol_methods import METHODS, VectorMethod
from mvmatch.bench.protocol_summary import STAGES, Row, summarise
from mvmatch.bench.report import markdown

if TYPE_CHECKING:
    from collections.abc import Callable
    from collections.abc import Sequence as Many

    from mvmatch.bench.store import Result


_Show: TypeAlias = "Callable[[Row], str]"

_EVERYWHERE = "all"
"""In the place of a sequence: the same reason holds for each of them."""


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table as text."""

    number: str
    """Of the paper's table: I to IV."""
    title: str
    note: str
    """What its figures mean."""
    columns: tuple[str, ...]
    """The first two are sequence and method."""
    rows: tuple[tuple[str, ...], ...]
    """A row of three is sequence, method and the reason why there are no figures."""

    def markdown(self) -> str:
        """Return it as Markdown."""
        blank = [""] * (len(self.columns) - 3)
        rows = [[*row, *blank] if len(row) == 3 else list(row) for row in self.rows]
        head = f"## Table {self.number}: {self.title}"
        return f"{head}\n\n{self.note}\n\n{markdown(list(self.columns), rows)}\n"

    def latex(self) -> str:
        r"""Return it as a ``table*`` for LaTeX with the package booktabs."""
        width = len(self.columns)
        lines = [
            r"\begin{table*}", r"\centering", r"\footnotesize",
            r"\setlength{\tabcolsep}{3pt}", rf"\caption{{{tex(self.title)}. {tex(self.note)}}}",
            rf"\label{{tab:{self.number.lower()}}}", rf"\begin{{tabular}}{{ll{'r' * (width - 2)}}}",
            r"\toprule", rf"{' & '.join(map(tex, self.columns))} \\", r"\midrule",
        ]  # fmt: skip
        before = self.rows[0][0] if self.rows else ""
        for row in self.rows:
            if row[0] != before:
                lines.append(r"\midrule")
            before = row[0]
            cells = [tex(cell) for cell in row]
            if len(row) == 3:
                cells[2] = rf"\multicolumn{{{width - 2}}}{{p{{0.6\linewidth}}}}{{{cells[2]}}}"
            lines.append(rf"{' & '.join(cells)} \\")
        lines += [r"\bottomrule", r"\end{tabular}", r"\end{table*}"]
        return "\n".join(lines) + "\n"


def tex(text: str) -> str:
    r"""Return plain text as LaTeX.

    >>> tex("50 % of_a ± b")
    '50 \\% of\\_a $\\pm$ b'
    """
    special = {
        "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_",
        "{": r"\{", "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
        "±": r"$\pm$", "∞": r"$\infty$", "µ": r"$\mu$", "·": r"$\cdot$", "⁻": r"$^{-}$",
        "⁶": r"$^{6}$", "×": r"$\times$",
    }  # fmt: skip
    return "".join(special.get(letter, letter) for letter in text)


def protocol_tables(results: Many[Result]) -> list[Table]:
    """Return the four tables."""
    rows = summarise(results)
    once = [row for number, row in enumerate(rows) if _first(rows, number)]
    vectors = [row for row in rows if isinstance(METHODS.get(row["method"]), VectorMethod)]
    return [
        _table(
            "I", "Structure from motion", once, _MODELS,
            "The camera is held where it is known; the mapper and its checks are the same for all. "
            "Distinct points are in no "
            "image within 1 px of an earlier one. ATE after alignment by a similarity, % of the "
            "path; RPE over one frame. Front end: from preprocessing to verification, elapsed / "
            "CPU. BA: CPU ms of an iteration of bundle adjustment.",
        ),
        _table(
            "II", "Time, CPU and memory", once, _COST,
            "Elapsed / CPU seconds. Preprocessing is extraction of features or reading of vectors "
            "(blank where the frames are read while tracking); encoding stands apart. Cores: "
            "processors busy on average from preprocessing to verification. Peak: the sum of the "
            "resident memory of all processes.",
        ),
        _table(
            "III", "Matching quality", rows, _QUALITY,
            "Mean over the pairs of a gap of the median over repeated estimations; ± is the "
            "standard deviation over the seeds. Distinct matches are further than 1 px from each "
            "other. The normalised Sampson error is squared, in 10⁻⁶.",
        ),
        _table(
            "IV", "Encoders", vectors, _ENCODERS,
            "Methods that read motion vectors, by encoder and preset.",
        ),
    ]  # fmt: skip


def _first(rows: Many[Row], number: int) -> bool:
    """Whether a row is the first of its cell."""
    if number == 0:
        return True
    names = ("sequence", "method")
    return [rows[number][name] for name in names] != [rows[number - 1][name] for name in names]


def _table(
    number: str, title: str, rows: Many[Row], columns: Many[tuple[str, _Show]], note: str
) -> Table:
    lines: list[tuple[str, ...]] = []
    without, last = _without_figures(rows), {}
    for row in rows:
        names = row["sequence"], row["method"]
        if row["method"] in without:
            last[row["method"]] = (_EVERYWHERE, row["method"], row["error"])
        elif row["error"] is not None:
            lines.append((*names, row["error"]))
        else:
            lines.append((*names, *(show(row) for _, show in columns)))
    lines += last.values()
    titles = ("sequence", "method", *(name for name, _ in columns))
    return Table(number=number, title=title, note=note, columns=titles, rows=tuple(lines))


def _without_figures(rows: Many[Row]) -> set[str]:
    """Find the methods that have no figures anywhere, for one and the same reason."""
    reasons: dict[str, set[str | None]] = {}
    for row in rows:
        reasons.setdefault(row["method"], set()).add(row["error"])
    several = len({row["sequence"] for row in rows}) > 1
    return {
        method for method, why in reasons.items() if several and len(why) == 1 and None not in why
    }


def _number(name: str, decimals: int, factor: float = 1.0) -> _Show:
    """Show a value, with its standard deviation where there is one."""

    def show(row: Row) -> str:
        text = _text(row.get(name), decimals, factor)
        spread = row.get(f"{name}_std")
        if not text or spread is None or not math.isfinite(spread):
            return text
        return f"{text} ± {_text(spread, decimals, factor)}"

    return show


def _seconds(stage: str) -> _Show:
    def show(row: Row) -> str:
        parts = [_text(row.get(f"{stage}_{kind}_s"), 2) for kind in ("wall", "cpu")]
        return " / ".join(parts) if all(parts) else ""

    return show


def _registered(row: Row) -> str:
    if row["registered"] is None:
        return ""
    text = f"{row['registered']} of {row['total']}"
    return text if row["accepted"] else f"{text}, refused"


def _text(value: Any, decimals: int, factor: float = 1.0) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return "∞" if math.isinf(value) else f"{factor * value:,.{decimals}f}"


_AUC = tuple((f"AUC@{degrees}", _number(f"auc_{degrees}", 1, 100)) for degrees in (5, 10, 20))
_SAMPSON = ("Sampson px", _number("sampson_px", 3))
_QUALITY = (
    ("gap", _number("gap", 0)), ("matches", _number("matches", 0)),
    ("distinct", _number("distinct", 0)), ("inlier ratio", _number("inlier_ratio", 4)),
    _SAMPSON, ("Sampson normalised", _number("sampson_normalized", 4, 1e6)), *_AUC,
)  # fmt: skip
_COST = (
    *((f"{stage} s", _seconds(stage)) for stage in STAGES),
    ("cores", _number("cores", 2)), ("peak MB", _number("peak_rss_mb", 0)),
    ("matches / image", _number("matches_per_image", 0)),
)  # fmt: skip
_MODELS = (
    ("registered", _registered), ("points", _number("points", 0)),
    ("distinct", _number("distinct_points", 0)), ("reprojection px", _number("reprojection_px", 3)),
    ("track length", _number("track_length", 1)), ("ATE %", _number("ate_percent", 3)),
    ("RPE", _number("rpe", 4)), ("RPE deg", _number("rpe_deg", 4)),
    ("front end s", _seconds("front_end")), ("map s", _seconds("map")),
    ("BA ms", _number("ba_cpu_s", 1, 1000)),
)  # fmt: skip
_ENCODERS = (
    ("gap", _number("gap", 0)), ("kB", _number("num_bytes", 0, 1e-3)),
    ("encode s", _seconds("encode")), ("matches", _number("matches", 0)),
    ("distinct", _number("distinct", 0)), ("inlier ratio", _number("inlier_ratio", 4)), _SAMPSON,
    _AUC[0], ("ATE %", _number("ate_percent", 3)),
)  # fmt: skip
