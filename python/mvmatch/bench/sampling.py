"""What a tree of processes uses while it runs: CPU time and memory, over time.

Linux tells both in ``/proc``. On other systems there are no samples; the totals that
:func:`mvmatch.bench.apart.run_apart` takes from the system are there all the same.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from itertools import pairwise
from multiprocessing.connection import wait
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from collections.abc import Sequence as Many
    from multiprocessing.process import BaseProcess

_PROC = Path("/proc")
_UTIME, _CSTIME, _RSS = 11, 14, 21
"""Places in ``/proc/PID/stat`` behind the name (proc(5)): first and last time, pages."""


@dataclass(frozen=True, kw_only=True)
class Sample:
    """What a tree had used at a moment."""

    time_s: float
    """Monotonic clock of the system, s."""
    cpu_s: float
    """User and system time so far, s: of all its processes, and of those that ended."""
    rss_mb: float
    """Resident memory now, MB: the sum over its processes, shared pages counted in each."""


class TreeSampler:
    """Samples a process and all that it started, from the thread that waits for it.

    Parameters
    ----------
    interval_s : float
        Time between samples. The system counts in hundredths of a second: at 0.2 s a sample is
        within 5 % of a processor.
    """

    def __init__(self, interval_s: float = 0.2) -> None:
        self.interval_s = interval_s
        self.samples: list[Sample] = []
        self.own_cpu_s = 0.0
        """CPU time that taking the samples took, s."""

    @property
    def peak_rss_mb(self) -> float | None:
        """Largest resident memory of a sample, MB; None without samples."""
        return max((sample.rss_mb for sample in self.samples), default=None)

    def follow(self, process: BaseProcess, timeout_s: float | None) -> None:
        """Sample a process until it ends or its time is over."""
        assert process.pid is not None
        end = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            self.take(process.pid)
            left = self.interval_s if end is None else min(self.interval_s, end - time.monotonic())
            if wait([process.sentinel], max(0.0, left)):
                # It has ended, and its times are there until someone asks for its exit code.
                self.take(process.pid)
                process.join()
                return
            if end is not None and time.monotonic() >= end:
                return

    def take(self, pid: int) -> None:
        """Take one sample; none where the system does not tell."""
        begin = time.thread_time()
        used = [stat for each in _tree(pid) if (stat := _stat(each)) is not None]
        if used:
            ticks, pages = (sum(values) for values in zip(*used, strict=True))
            before = self.samples[-1].cpu_s if self.samples else 0.0
            sample = Sample(
                time_s=time.monotonic(),
                # A process that nobody waited for takes its time with it.
                cpu_s=max(before, ticks / os.sysconf("SC_CLK_TCK")),
                rss_mb=pages * os.sysconf("SC_PAGE_SIZE") / 1e6,
            )
            self.samples.append(sample)
        self.own_cpu_s += time.thread_time() - begin


def utilisation(samples: Many[Sample]) -> list[tuple[float, float]]:
    """Return the middle of each interval, s, and the processors busy in it; 1 is one core."""
    return [
        ((a.time_s + b.time_s) / 2, (b.cpu_s - a.cpu_s) / (b.time_s - a.time_s))
        for a, b in pairwise(samples)
        if b.time_s > a.time_s
    ]


def _tree(pid: int) -> Iterator[int]:
    """Yield a process and its descendants."""
    yield pid
    for thread in _entries(_PROC / str(pid) / "task"):
        try:
            children = (thread / "children").read_text(encoding="ascii")
        except OSError:
            continue  # it ended meanwhile
        for child in children.split():
            yield from _tree(int(child))


def _entries(folder: Path) -> list[Path]:
    try:
        return [folder / name for name in os.listdir(folder)]  # noqa: PTH208
    except OSError:
        return []


def _stat(pid: int) -> tuple[int, int] | None:
    """CPU time in ticks, of its finished children too, and resident pages; None if it is gone."""
    try:
        text = (_PROC / str(pid) / "stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    # The name stands in brackets and may hold anything.
    fields = text.rpartition(")")[2].split()
    return sum(map(int, fields[_UTIME : _CSTIME + 1])), int(fields[_RSS])
