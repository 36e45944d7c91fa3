"""Compare the parser with what libaom's inspection hook saw: ``tools/conformance.py DIR ...``.

``DIR`` holds a ``MANIFEST.json`` with a list ``streams`` and, for each stream, a golden ``.npz`` in
the layout of the project's corpus (arrays per record, per reference and per 4x4 cell). Every array
of a golden is compared; where a golden does not define one, the last lines say where and why.
Arrays that users do not see come from a module with the cargo feature ``trace``, which is built
first. Files that the manifest calls ``corrupt`` are compared byte by byte with the stream they were
made from: every record before the damage must come and be equal, then a typed error must follow,
unless libaom reads on. The exit code is 1 when anything else happens or an array is not compared.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from oracle.module import use_trace_module

if TYPE_CHECKING:
    from collections.abc import Iterator

    from oracle.damage import Demand
    from oracle.report import Report

GOOD = {"equal", "refused", "read on"}


def files(directory: Path) -> Iterator[tuple[str, Path, Demand | None, str]]:
    """Files of a folder: name, golden, what a damaged one must give, what is damaged in it."""
    from oracle.damage import demand_of

    manifest = json.loads((directory / "MANIFEST.json").read_text())
    for stream in manifest["streams"]:
        yield stream["file"], directory / stream["golden"], None, ""
    for stream in manifest.get("containers", []):
        yield stream["file"], directory / f"{stream['of']}.golden.npz", None, ""
    for stream in manifest.get("corrupt", []):
        golden = directory / f"{stream['of']}.golden.npz"
        yield stream["file"], golden, demand_of(stream, directory), stream["what"]


def summary(report: Report, verdicts: Counter[str], trace: str) -> str:
    """Say what was compared, what was not, and why."""
    missing = report.not_compared
    lines = ["", ", ".join(f"{count} {name}" for name, count in sorted(verdicts.items())), trace]
    lines.append(f"compared arrays ({len(report.compared)}): {', '.join(sorted(report.compared))}")
    for reason, arrays in report.exceptions():
        lines.append(f"{reason} ({len(arrays)}): {', '.join(arrays)}")
    lines.append(f"NOT compared ({len(missing)}): {', '.join(missing) or 'none'}")
    return "\n".join(lines)


def main() -> int:
    """Print the table; 0 when nothing differs and every array was compared."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("directory", type=Path, nargs="+")
    parser.add_argument("--only", default="", help="streams whose name contains this")
    parser.add_argument("--no-build", action="store_true", help="use the trace module as it is")
    parser.add_argument("--no-trace", action="store_true", help="the module that users have")
    options = parser.parse_args()
    trace = "NO TRACE: not asked for"
    if not options.no_trace:
        trace = use_trace_module(build=not options.no_build)
    from oracle.report import Report

    report, verdicts = Report(), Counter[str]()
    for directory in options.directory:
        for name, golden, demand, what in files(directory):
            if options.only not in name:
                continue
            verdict, detail = report.check(directory / name, golden, demand)
            verdicts[verdict] += 1
            print(f"{name:<40} {verdict:<9} {detail}{f' ({what})' if what else ''}")
    print(summary(report, verdicts, trace))
    is_complete = options.no_trace or not report.not_compared
    return 0 if verdicts and set(verdicts) <= GOOD and is_complete else 1


if __name__ == "__main__":
    sys.exit(main())
