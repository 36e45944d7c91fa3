"""The protocol as one page that asks for nothing from elsewhere: tables, figures, provenance."""

from __future__ import annotations

import base64
from html import escape
from typing import TYPE_CHECKING, Any

from mvmatch.bench.report import machine
from mvmatch.config import to_toml
from mvmatch.outputs import provenance
from mvmatch.report.style import CSS

if TYPE_CHECKING:
    from collections.abc import Mapping
    from collections.abc import Sequence as Many
    from pathlib import Path

    from mvmatch.bench.protocol_options import ProtocolOptions
    from mvmatch.bench.protocol_tables import Table

_CAPTIONS = {
    "cpu": "CPU utilisation of the whole process tree over time; 100 % is one core.",
    "errors": "Medians over repeated estimations; bars are the standard deviation over the seeds.",
    "adjacency": "Matches of every pair of frames, before and after verification.",
}
_MORE = """
main { max-width: 1280px; }
img { max-width: 100%; width: 420px; background: #fff; border-radius: 4px; }
table.numbers { font-size: 14px; } table.numbers :is(td, th) { padding-right: 12px; }
table.numbers :is(td, th):nth-child(-n+2) { text-align: left; }
table.numbers td.reason { text-align: left; white-space: normal; color: var(--soft); }
"""


def protocol_page(tables: Many[Table], figures: Many[Path], options: ProtocolOptions) -> str:
    """Return the HTML document.

    Parameters
    ----------
    tables : sequence of Table
        In their order.
    figures : sequence of Path
        PNG files, which are put into the page; other files are passed over.
    options : ProtocolOptions
        What was run.
    """
    title = f"Protocol {options.name}"
    about = provenance()["mvmatch"]
    pictures = [path for path in figures if path.suffix == ".png"]
    body = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="soft">{escape(about["created"])}</p>',
        *(_section(f"Table {table.number}: {table.title}", _table(table)) for table in tables),
        *(_figures(kind, pictures) for kind in _CAPTIONS),
        _section("How it was made", _origin(about, options)),
    ]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{CSS}{_MORE}</style></head>\n"
        f"<body><main>\n{chr(10).join(body)}\n</main></body></html>\n"
    )


def _section(title: str, content: str) -> str:
    return f"<section><h2>{escape(title)}</h2>\n{content}\n</section>"


def _table(table: Table) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in table.columns)
    rows: list[str] = []
    for row in table.rows:
        cells = [f"<td>{escape(cell)}</td>" for cell in row]
        if len(row) == 3:
            width = len(table.columns) - 2
            cells[2] = f'<td class="reason" colspan="{width}">{escape(row[2])}</td>'
        rows.append(f"<tr>{''.join(cells)}</tr>")
    return (
        f'<p class="soft">{escape(table.note)}</p><div class="wide"><table class="numbers">'
        f"<tr>{head}</tr>{''.join(rows)}</table></div>"
    )


def _figures(kind: str, pictures: Many[Path]) -> str:
    parts: list[str] = []
    for path in pictures:
        if path.name.startswith(f"{kind}-"):
            name = escape(path.stem.removeprefix(f"{kind}-"))
            data = base64.b64encode(path.read_bytes()).decode("ascii")
            parts.append(
                f'<figure><img alt="{escape(_CAPTIONS[kind])} {name}" '
                f'src="data:image/png;base64,{data}"><figcaption>{name}</figcaption></figure>'
            )
    if not parts:
        return ""
    text = f"<p>{escape(_CAPTIONS[kind])}</p>"
    return _section(_TITLES[kind], f'{text}<div class="charts">{"".join(parts)}</div>')


_TITLES = {"cpu": "CPU over time", "errors": "Error bars", "adjacency": "Matches of pairs"}


def _origin(about: Mapping[str, Any], options: ProtocolOptions) -> str:
    ran = machine()
    seeds = range(options.ransac.seed, options.ransac.seed + options.repetitions)
    versions = {**about["versions"], **ran["versions"]}
    facts = {
        "machine": f"{ran['machine']}, {ran['processors']} processors",
        "versions": ", ".join(f"{name} {version}" for name, version in versions.items()),
        "mvmatch": about["version"],
        "command": " ".join(about["command"]),
        "seeds": ", ".join(map(str, seeds)),
    }
    rows = "".join(
        f"<tr><th>{name}</th><td>{escape(str(text))}</td></tr>" for name, text in facts.items()
    )
    return f"<table>{rows}</table><pre>{escape(to_toml(options))}</pre>"
