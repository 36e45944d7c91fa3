"""What a stage costs: wall time, CPU time of this process and its children, peak memory."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Generator


@dataclass(frozen=True, kw_only=True)
class StageCost:
    """Cost of one stage."""

    name: str
    wall_s: float
    """Elapsed time in s."""
    cpu_s: float
    """CPU time in s: user and system, all threads, finished children included."""
    peak_rss_mb: float | None
    """Largest resident memory of this process so far in MB; None where the system cannot tell."""


class StageClock:
    """Collects the cost of named stages, in the order in which they ran."""

    def __init__(self) -> None:
        self.stages: list[StageCost] = []

    @contextlib.contextmanager
    def stage(self, name: str) -> Generator[None]:
        """Measure the body; a failing stage is recorded too."""
        wall, cpu = time.perf_counter(), cpu_seconds()
        try:
            yield
        finally:
            self.stages.append(
                StageCost(
                    name=name,
                    wall_s=time.perf_counter() - wall,
                    cpu_s=cpu_seconds() - cpu,
                    peak_rss_mb=peak_rss_mb(),
                )
            )


def cpu_seconds() -> float:
    """CPU time in s that this process and its finished children have used."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def peak_rss_mb() -> float | None:
    """Largest resident memory of this process so far, in MB (10⁶ bytes)."""
    with contextlib.suppress(OSError), Path("/proc/self/status").open(encoding="utf-8") as status:
        # Linux: what getrusage tells is at least what the process had that started this one.
        for line in status:
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6
