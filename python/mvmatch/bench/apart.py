"""Functions in a process of their own: what they cost, and an end for those that find none."""

from __future__ import annotations

import json
import os
import signal
import tempfile
import time
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

from mvmatch.measure import peak_rss_mb

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.process import BaseProcess

    from mvmatch.bench.sampling import TreeSampler


@dataclass(frozen=True, kw_only=True)
class Apart:
    """What came of a function that ran in a fresh process."""

    value: dict[str, Any]
    """What it returned; empty when it failed."""
    error: str | None
    """Why there is no value."""
    wall_s: float
    """Elapsed time in s, the start of the interpreter included."""
    cpu_s: float
    """User and system time in s of the process and of those that it started and waited for."""
    peak_rss_mb: float | None
    """Largest resident memory in MB; None where the system cannot tell, and without a value."""


def run_apart(
    function: Callable[..., dict[str, Any]],
    *arguments: Any,
    timeout_s: float | None = None,
    sampler: TreeSampler | None = None,
) -> Apart:
    """Call a function in a fresh process; a crash or an endless loop is a result with its reason.

    Parameters
    ----------
    function : callable
        Of a module, returning plain values; infinities and NaN pass.
    arguments
        Can be pickled.
    timeout_s : float, optional
        Elapsed time in s after which the process is ended, with those that it started.
    sampler : TreeSampler, optional
        Takes samples of the process and those that it started while they run.
    """
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "answer.json"
        process = get_context("spawn").Process(target=_call, args=(answer, function, arguments))
        begin, before = time.perf_counter(), _children_cpu_s()
        process.start()
        try:
            if sampler is None:
                process.join(timeout_s)
            else:
                sampler.follow(process, timeout_s)
        finally:
            late = process.is_alive()
            if late:
                _end(process)
        wall_s, cpu_s = time.perf_counter() - begin, _children_cpu_s() - before
        value: dict[str, Any] = {"error": f"the process died without a word ({process.exitcode})"}
        if late:
            value = {"error": f"stopped after {timeout_s:g} s"}
        elif answer.is_file():
            value = json.loads(answer.read_text(encoding="utf-8"))
    return Apart(
        value=value.get("value", {}),
        error=value.get("error"),
        wall_s=wall_s,
        cpu_s=cpu_s,
        peak_rss_mb=value.get("peak_rss_mb"),
    )


def _children_cpu_s() -> float:
    """CPU time in s of finished children; that of this process, which waits and samples, is not."""
    times = os.times()
    return times.children_user + times.children_system


def _call(
    answer: Path, function: Callable[..., dict[str, Any]], arguments: tuple[Any, ...]
) -> None:
    if hasattr(os, "setsid"):
        os.setsid()  # so that what it starts can be ended with it
        Thread(target=_follow_parent, daemon=True).start()
    try:
        text = json.dumps({"value": function(*arguments), "peak_rss_mb": peak_rss_mb()})
    except Exception as error:
        text = json.dumps({"error": f"{type(error).__name__}: {error}"})
    partial = answer.with_suffix(".partial")
    partial.write_text(text, encoding="utf-8")
    partial.replace(answer)


def _follow_parent() -> None:
    """End with the process that waits for the answer, should it be killed."""
    parent = parent_process()
    assert parent is not None
    parent.join()
    os.killpg(os.getpid(), signal.SIGKILL)


def _end(process: BaseProcess) -> None:
    """End a process and its children, at once; they have nothing to tidy up that is not scratch."""
    assert process.pid is not None
    own_group = hasattr(os, "getpgid") and os.getpgid(process.pid) == process.pid
    if own_group:
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.join()
