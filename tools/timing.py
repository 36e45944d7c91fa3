"""Time processes: what the tools that compare share."""

from __future__ import annotations

import resource
import subprocess
import time
from pathlib import Path
from typing import IO, TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable

ROOT = Path(__file__).resolve().parent.parent
COUNT_VECTORS = ROOT / "target" / "release" / "examples" / "count_vectors"


class Times(NamedTuple):
    """Seconds of one run: of the clock, and of the processor in all processes it started."""

    wall: float
    cpu: float


def timed(work: Callable[[], str]) -> tuple[Times, str]:
    """Time ``work``, which waits for the processes it starts; return what it returned as well."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    output = work()
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Times(wall, cpu), output


def run(command: list[str], *, stdout: int | IO[bytes] = subprocess.PIPE) -> tuple[Times, str]:
    """Time one process; return what it printed as well, if that goes nowhere else."""

    def work() -> str:
        done = subprocess.run(
            command, check=True, stdout=stdout, stderr=subprocess.DEVNULL, text=True
        )
        return done.stdout or ""

    return timed(work)


def pipe(producer: list[str], consumer: list[str]) -> tuple[Times, str]:
    """Time two processes; return what the second printed about the output of the first as well."""

    def work() -> str:
        with subprocess.Popen(
            producer, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        ) as process:
            done = subprocess.run(
                consumer, check=True, stdin=process.stdout, stdout=subprocess.PIPE, text=True
            )
        if process.returncode != 0:
            raise subprocess.CalledProcessError(process.returncode, producer)
        return done.stdout

    return timed(work)
