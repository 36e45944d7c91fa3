"""What the user sees: progress on stderr, results on stdout, errors in two lines."""

from __future__ import annotations

import json
import re
import sys
import threading
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from mvmatch.errors import BitstreamError, LimitError, MissingExtraError, UnsupportedError
from mvmatch.report.plain import plain

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

    from rich.progress import Progress as Bars

_QUIET_SECONDS = 2.0
_LINE_SECONDS = 5.0


@dataclass(kw_only=True)
class Outcome:
    """What a verb has to say at its end."""

    made: list[Path] = field(default_factory=list["Path"])
    """Files and folders that are there now."""
    figures: dict[str, str] = field(default_factory=dict[str, str])
    """Key figures, label to text."""
    next: str | None = None
    """A command that goes on from here."""
    data: dict[str, Any] = field(default_factory=dict[str, Any])
    """Everything ``--json`` prints besides."""
    warnings: list[str] = field(default_factory=list[str])
    """Sentences for stderr."""
    table: str | None = None
    """Text before the figures."""
    failure: Exception | None = None
    """Why the result is only a part of what was asked for; the exit code is 1 then."""
    partial: str | None = None
    """What there is in spite of the failure."""
    findings: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])
    """What stands in the way of more, each with what to try; the last lines, on stderr."""


def show(outcome: Outcome, *, verb: str, as_json: bool) -> None:
    """Print an outcome; warnings and failures go to stderr."""
    for warning in outcome.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if as_json:
        document: dict[str, Any] = {
            "verb": verb,
            "made": [str(path) for path in outcome.made],
            "next": outcome.next,
            "warnings": outcome.warnings,
            "partial": outcome.partial,
            "error": None if outcome.failure is None else describe(outcome.failure),
            **outcome.data,
        }
        print(json.dumps(plain(document), allow_nan=False))
    else:
        _show_text(outcome)
    if outcome.failure is not None:
        if outcome.partial:
            print(f"partial: {outcome.partial}", file=sys.stderr)
        show_error(outcome.failure)
    for sentence, advice in outcome.findings:
        print(f"found: {sentence}\n       {advice}", file=sys.stderr)


def _show_text(outcome: Outcome) -> None:
    if outcome.table:
        print(outcome.table)
        print()
    width = max((len(label) for label in outcome.figures), default=0)
    for label, text in outcome.figures.items():
        print(f"{label:<{width}}  {text}")
    if outcome.made:
        print("made:", ", ".join(str(path) for path in outcome.made))
    if outcome.next:
        print("next:", outcome.next)


def show_error(error: Exception) -> None:
    """Print what happened and, on a second line, what to do."""
    what, advice = split_advice(error)
    print(f"error: {what}", file=sys.stderr)
    print(f"       {advice}", file=sys.stderr)
    show_notes(error)


def show_notes(error: BaseException) -> None:
    """Print what an error has to say besides: what there is in spite of it."""
    for note in getattr(error, "__notes__", ()):
        print(f"kept:  {note}", file=sys.stderr)


def describe(error: Exception) -> dict[str, Any]:
    """Return an error as plain values."""
    what, advice = split_advice(error)
    facts: dict[str, Any] = {"kind": type(error).__name__, "message": what, "advice": advice}
    if isinstance(error, BitstreamError):
        facts |= {
            "section": error.section,
            "byte_offset": error.byte_offset,
            "frame": error.frame,
        }
    return facts


def split_advice(error: Exception) -> tuple[str, str]:
    """Split a message at its first sentence end: what and where, then what to do."""
    text = str(error).strip()
    if isinstance(error, OSError) and error.filename is not None:
        text = f"{error.filename}: {error.strerror}"
    text = re.sub(r"\s*\n\s*", " ", text)
    end = re.search(r"(?<=[^.])\.\s+(?=[A-Z])|;\s+", text)
    if end is not None:
        advice = text[end.end() :]
        stop = "" if advice.endswith((".", "?", "!")) else "."
        return text[: end.start()], f"{advice[0].upper()}{advice[1:]}{stop}"
    return text.rstrip("."), _general_advice(error)


def _general_advice(error: Exception) -> str:
    if isinstance(error, BitstreamError):
        return "The file is damaged: copy it again, or encode it anew (mvmatch encode)."
    if isinstance(error, UnsupportedError):
        return "Encode the video anew with plain settings: mvmatch encode VIDEO clip.ivf."
    if isinstance(error, LimitError):
        return (
            "The limits protect against hostile files; if you trust this one, "
            "raise it: --set read.limits.NAME=VALUE."
        )
    if isinstance(error, MissingExtraError):
        return "Install it and try again."
    return "`mvmatch --help` shows what each verb takes."


class Ticker:
    """Progress of stages: silent for two seconds, then a bar on a terminal, else a few lines."""

    def __init__(self) -> None:
        self._terminal = sys.stderr.isatty()
        self._begin = time.monotonic()
        self._lock = threading.Lock()
        self._stage = ""
        self._done, self._total = 0, None
        self._bars: Bars | None = None
        self._task: Any = None
        self._last_line = 0.0
        self._timer = threading.Timer(_QUIET_SECONDS, self._show)
        self._timer.daemon = True

    def __enter__(self) -> Ticker:
        self._timer.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._timer.cancel()
        with self._lock:
            if self._bars is not None:
                self._bars.stop()

    def __call__(self, stage: str, done: int, total: int | None) -> None:
        """Take note of how far a stage is."""
        changed = stage != self._stage
        self._stage, self._done, self._total = stage, done, total
        if time.monotonic() - self._begin < _QUIET_SECONDS:
            return
        if changed or self._terminal or time.monotonic() - self._last_line > _LINE_SECONDS:
            self._show()

    def _show(self) -> None:
        with self._lock:
            if self._terminal:
                self._show_bar()
                return
            self._last_line = time.monotonic()
            count = f" {self._done}" if self._done else ""
            total = f" of {self._total}" if self._done and self._total else ""
            print(f"{self._stage or 'working'}{count}{total} ...", file=sys.stderr, flush=True)

    def _show_bar(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
        from rich.progress import TimeElapsedColumn as Elapsed

        if self._bars is None:
            console = Console(stderr=True)
            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
            self._bars = Progress(*columns, Elapsed(), console=console, transient=True)
            self._task = self._bars.add_task(self._stage)
            self._bars.start()
        self._bars.update(
            self._task, description=self._stage, completed=self._done, total=self._total
        )
