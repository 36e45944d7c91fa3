"""The report of a run: ``report.json`` for programs, ``report.html`` for people.

The page is one file without scripts and without requests; it opens offline and prints.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from mvmatch.report.page import page
from mvmatch.report.plain import plain

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

__all__ = ["write_report"]


def write_report(out_dir: Path, data: Mapping[str, Any]) -> Path:
    """Write ``report.json`` and ``report.html``, each in place only when it is complete.

    Parameters
    ----------
    out_dir : folder, created when missing.
    data : facts of the run as in ``docs/reference/report-schema.md``; missing keys are left out of
        the page. NumPy values, paths and dataclasses are converted, NaN becomes null.

    Returns
    -------
    Path of ``report.html``.
    """
    out_dir.mkdir(parents=True, exist_ok=True)
    facts = plain(data)
    _replace(out_dir / "report.json", json.dumps(facts, indent=1, allow_nan=False) + "\n")
    return _replace(out_dir / "report.html", page(facts))


def _replace(path: Path, text: str) -> Path:
    partial = path.with_name(f".{path.name}.partial")
    partial.write_text(text, encoding="utf-8")
    return partial.replace(path)
