"""The verb that runs the paper's protocol."""

from __future__ import annotations

import difflib
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from mvmatch.cli.console import Outcome
from mvmatch.cli.settings import Json, Output

if TYPE_CHECKING:
    from mvmatch.bench.protocol import ProtocolCell


def _require_config(_: type, path: Path) -> None:
    """Refuse a word that is no file: where a verb was meant, name it."""
    if path.exists() or path.suffix or len(path.parts) > 1:
        return  # what is wrong with a file is said where it is read
    from mvmatch.cli.bench import app

    verbs = [name for name in app if not name.startswith("-")]
    near = difflib.get_close_matches(path.name, verbs, n=1)
    meant = f" Did you mean {near[0]}?" if near else ""
    message = (
        f"There is no benchmark and no file {path}.{meant} "
        f"Benchmarks: {', '.join(verbs)}, or a TOML file such as configs/paper.toml"
    )
    raise ValueError(message)


def paper(
    config: Annotated[Path, Parameter(validator=_require_config)],
    /,
    *,
    data: list[Path],
    out: Output = Path("out/paper"),
    json: Json = False,
) -> Outcome:
    """Run the protocol of a TOML file (configs/paper.toml) and write its tables and figures.

    What is computed already is kept: a run that was interrupted goes on where it was. A method that
    cannot run here, crashes or takes too long is a row with its reason.

    Parameters
    ----------
    config
        Methods, pairs, estimation; docs/reference/protocol.md lists the keys.
    data
        Folders that are sequences or hold some; can be repeated.
    out
        Folder for tables, figures, results and streams.
    """
    from mvmatch.bench.protocol import protocol_cells, run_protocol
    from mvmatch.bench.protocol_options import load_protocol
    from mvmatch.bench.protocol_report import MARKDOWN, write_protocol

    options = load_protocol(config)
    progress = _Progress(len(protocol_cells(options, data, out)))
    results = run_protocol(options, data, out, tell=progress)
    made = write_protocol(results, options, out)
    failed = [f"{each['sequence']} {each['method']}" for each in results if each["error"]]
    return Outcome(
        made=made,
        figures={"results": str(len(results)), "without figures": ", ".join(failed) or "none"},
        data={"cells": results},
        table=(out / MARKDOWN).read_text(encoding="utf-8"),
    )


class _Progress:
    """One line per cell and state, with the time that the rest may take."""

    def __init__(self, total: int) -> None:
        self._total = total
        self._number = 0
        self._seconds: list[float] = []
        self._begin = 0.0

    def __call__(self, cell: ProtocolCell, state: str) -> None:
        """Print how far the run is."""
        if state in {"kept", "running"}:
            self._number += 1
            self._begin = time.monotonic()
        elif state == "done":
            self._seconds.append(time.monotonic() - self._begin)
        where = f"[{self._number}/{self._total}] {cell.sequence} {cell.method}: {state}"
        print(f"{where}{self._remaining(state)}", file=sys.stderr, flush=True)

    def _remaining(self, state: str) -> str:
        """Say what is left, by the mean of the cells that were computed in this run."""
        if state == "kept" or not self._seconds:
            return ""
        left = self._total - self._number + (state == "running")
        minutes = left * sum(self._seconds) / len(self._seconds) / 60
        return f", about {minutes:.1f} min left" if left else ""
