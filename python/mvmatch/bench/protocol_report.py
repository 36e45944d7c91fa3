"""Everything that the protocol leaves: tables, figures, a page, and rows for other programs."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING

from mvmatch.bench.digests import code_digest
from mvmatch.bench.protocol_figures import write_figures
from mvmatch.bench.protocol_page import protocol_page
from mvmatch.bench.protocol_summary import write_parquet
from mvmatch.bench.protocol_tables import protocol_tables

if TYPE_CHECKING:
    from collections.abc import Sequence as Many
    from pathlib import Path

    from mvmatch.bench.protocol_options import ProtocolOptions
    from mvmatch.bench.store import Result

SUMMARY, PAIRS = "results.parquet", "pairs.parquet"
MARKDOWN, LATEX, PAGE, FIGURES = "tables.md", "tables.tex", "bench.html", "figures"
_MADE = (SUMMARY, PAIRS, MARKDOWN, LATEX, PAGE, FIGURES)
_DIGEST = ".report"
"""File that tells what the others were made of."""

_SOURCES = (
    "bench/protocol_figures", "bench/protocol_page", "bench/protocol_report",
    "bench/protocol_summary", "bench/protocol_tables", "bench/report", "report/style",
)  # fmt: skip


def write_protocol(results: Many[Result], options: ProtocolOptions, out: Path) -> list[Path]:
    """Write what is made of the results into the folder of a benchmark, unless it is there.

    Returns
    -------
    list of Path
        ``results.parquet``, ``pairs.parquet``, ``tables.md``, ``tables.tex``, ``bench.html``, and
        the folder ``figures``.
    """
    out.mkdir(parents=True, exist_ok=True)
    made = [out / name for name in _MADE]
    digest = hashlib.sha256(f"{code_digest(_SOURCES)} {options}".encode())
    # Cells that cannot be filled are tried in every run: only the time of that is another.
    facts = [{name: result[name] for name in result if name != "mvmatch"} for result in results]
    digest.update(json.dumps(facts, sort_keys=True).encode())
    stamp = out / _DIGEST
    if all(path.exists() for path in made) and _text_of(stamp) == digest.hexdigest():
        return made
    stamp.unlink(missing_ok=True)
    write_parquet(results, out / SUMMARY, out / PAIRS)
    tables = protocol_tables(results)
    text = "\n".join(table.markdown() for table in tables)
    (out / MARKDOWN).write_text(f"# Protocol {options.name}\n\n{text}", encoding="utf-8")
    (out / LATEX).write_text("\n".join(table.latex() for table in tables), encoding="utf-8")
    figures = write_figures(results, out / FIGURES)
    (out / PAGE).write_text(protocol_page(tables, figures, options), encoding="utf-8")
    stamp.write_text(digest.hexdigest(), encoding="utf-8")
    return made


def _text_of(path: Path) -> str | None:
    return path.read_text(encoding="utf-8") if path.is_file() else None
