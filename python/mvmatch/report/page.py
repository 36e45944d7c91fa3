"""The report page: sections in the order in which a reader asks."""

from __future__ import annotations

from html import escape
from pathlib import PurePath
from typing import Any

from mvmatch.report import sections
from mvmatch.report.plain import Facts, items, part
from mvmatch.report.style import CSS


def page(facts: Facts) -> str:
    """Return the whole HTML document for the facts of a run (plain JSON values)."""
    title = _title(facts)
    body = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="soft">{escape(_subtitle(facts))}</p>',
        _verdict(facts),
        sections.tiles(facts),
        sections.findings(facts),
        sections.notes(facts),
        sections.accuracy(facts),
        sections.source(facts),
        sections.reference_structure(facts),
        sections.matches(facts),
        sections.adjacency(facts),
        sections.scores(facts),
        sections.model(facts),
        sections.cost(facts),
        sections.options(facts),
        _footer(facts),
    ]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)} - mvmatch report</title><style>{CSS}</style></head>\n"
        f"<body><main>\n{chr(10).join(part for part in body if part)}\n</main></body></html>\n"
    )


def _title(facts: Facts) -> str:
    """Return the name of the input; a folder of frames keeps the name of the folder around it."""
    path = PurePath(str(_get(facts, "input", "path") or "run"))
    keep = 2 if _get(facts, "input", "kind") == "frames" else 1
    return "/".join(part for part in path.parts[-keep:] if part != path.anchor) or "run"


def _subtitle(facts: Facts) -> str:
    parts = [
        str(_get(facts, "mvmatch", "created") or ""),
        f"preset {preset}" if (preset := _get(facts, "options", "preset")) else "",
        f"{_get(facts, 'model', 'mapper')} mapper" if _get(facts, "model", "mapper") else "",
    ]
    return " · ".join(part for part in parts if part)


def _verdict(facts: Facts) -> str:
    model = part(facts, "model")
    if facts.get("damage"):
        text = f"! Broken input: {_get(facts, 'damage', 'message')}"
        return f'<div class="verdict bad">{escape(text)}</div>'
    if not model:
        return '<div class="verdict doubt">No model was built in this run</div>'
    registered, total = model.get("registered", 0), model.get("total", 0)
    if not model.get("accepted", True):
        reasons = "; ".join(map(str, items(model, "reasons") or ["no reason was recorded"]))
        return f'<div class="verdict bad">✗ Model not trusted: {escape(reasons)}</div>'
    if registered < total:
        text = f"! {registered} of {total} images registered"
        return f'<div class="verdict doubt">{text}</div>'
    return f'<div class="verdict good">✓ All {total} images registered</div>'


def _footer(facts: Facts) -> str:
    about = part(facts, "mvmatch")
    versions = part(about, "versions")
    listed = ", ".join(f"{name} {version}" for name, version in versions.items())
    command = items(about, "command")
    told = f"<br><code>{escape(' '.join(map(str, command)))}</code>" if command else ""
    return (
        f"<footer>mvmatch {escape(str(about.get('version', '')))}"
        f"{' · ' + escape(listed) if listed else ''}{told}</footer>"
    )


def _get(facts: Facts, section: str, key: str) -> Any:
    return part(facts, section).get(key)
