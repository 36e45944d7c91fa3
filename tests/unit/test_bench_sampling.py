"""Samples of a tree of processes against what the system counts at its end."""

import re
import shlex
import subprocess
import sys
import time
from multiprocessing import get_context, spawn
from pathlib import Path

import pytest

from mvmatch.bench.apart import run_apart
from mvmatch.bench.sampling import Sample, TreeSampler, utilisation
from mvmatch.measure import StageClock, cpu_seconds

resource = pytest.importorskip("resource")
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="samples come from /proc")

GNU_TIME = Path("/usr/bin/time")
START_S = 0.5
"""What starting a process may take more or less between two clocks of the same run, s."""

SPIN = "import time\nend = {0}\nwhile time.process_time() < end: pass"


def work(seconds):
    """Keep a child of this process busy, then itself, for ``seconds`` of CPU time each."""
    held = bytearray(64_000_000)
    subprocess.run([sys.executable, "-c", SPIN.format(seconds)], check=True)
    exec(SPIN.format(time.process_time() + seconds))
    return {"held": len(held)}


def timed_work(seconds):
    """Do the same as a stage; its cost, the CPU time before it and the moment of its end, s."""
    clock, before = StageClock(), cpu_seconds()
    with clock.stage("match"):
        work(seconds)
    return {"stage_s": clock.stages[0].cpu_s, "before_s": before, "end_s": time.monotonic()}


@pytest.fixture
def gnu_time(tmp_path):
    """Have GNU time start the interpreters of run_apart; a function returns what it measured."""
    if not GNU_TIME.is_file() or "GNU" not in subprocess.getoutput(f"{GNU_TIME} --version"):
        pytest.skip(f"GNU time is not at {GNU_TIME} (Debian: apt-get install time)")
    report, wrapper = tmp_path / "time.txt", tmp_path / "python"
    command = shlex.join([str(GNU_TIME), "-v", "-o", str(report), sys.executable])
    wrapper.write_text(f'#!/bin/sh\nexec {command} "$@"\n')
    wrapper.chmod(0o755)
    before = spawn.get_executable()
    get_context("spawn").set_executable(str(wrapper))
    yield lambda: measured(report.read_text())
    get_context("spawn").set_executable(before)


def measured(report):
    """CPU and elapsed time, s, and the largest resident memory of a process, MB."""
    facts = dict(re.findall(r"^\s*(.+?)(?: \([^()]*\))*: (\S+)$", report, re.MULTILINE))
    clock = [float(part) for part in facts["Elapsed (wall clock) time"].split(":")]
    return {
        "cpu_s": float(facts["User time"]) + float(facts["System time"]),
        "wall_s": sum(part * 60**place for place, part in enumerate(reversed(clock))),
        "peak_rss_mb": float(facts["Maximum resident set size"]) * 1024 / 1e6,
    }


def endless():
    while True:
        pass


def test_cpu_and_wall_agree_with_the_system_and_sampling_costs_next_to_nothing():
    sampler = TreeSampler()
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    apart = run_apart(work, 1.0, sampler=sampler)
    after, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - begin

    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    assert apart.error is None
    assert cpu >= 2
    assert sampler.samples[-1].cpu_s == pytest.approx(cpu, rel=0.05)
    assert apart.cpu_s == pytest.approx(cpu, rel=0.05)
    assert apart.wall_s == pytest.approx(wall, rel=0.05)
    # Sampling begins when the system has started the process.
    assert sampler.samples[-1].time_s - sampler.samples[0].time_s == pytest.approx(wall, abs=1.0)
    assert sampler.own_cpu_s < 0.01 * wall
    assert 64 < sampler.peak_rss_mb < 400


def test_figures_of_the_protocol_agree_with_gnu_time(gnu_time):
    pytest.importorskip("pycolmap")
    from mvmatch.bench.protocol import _usage

    sampler, begin = TreeSampler(), time.monotonic()
    apart = run_apart(timed_work, 1.5, sampler=sampler)
    usage, told = _usage(sampler, begin, apart), gnu_time()
    assert apart.error is None
    assert told["cpu_s"] >= 3

    assert usage["cpu_s"] == pytest.approx(told["cpu_s"], rel=0.05)
    assert usage["samples"][-1]["cpu_s"] == pytest.approx(told["cpu_s"], rel=0.05)
    assert apart.value["before_s"] + apart.value["stage_s"] == pytest.approx(
        told["cpu_s"], rel=0.05
    )

    assert usage["wall_s"] == pytest.approx(told["wall_s"], rel=0.05, abs=START_S)
    assert apart.value["end_s"] - begin == pytest.approx(told["wall_s"], rel=0.05, abs=START_S)

    # The system counts each process for itself, samples the sum of all that there are at once.
    assert apart.peak_rss_mb == pytest.approx(told["peak_rss_mb"], rel=0.05)
    assert usage["peak_rss_mb"] >= 0.95 * told["peak_rss_mb"]

    assert usage["sampler_cpu_s"] < 0.01 * told["wall_s"]


def test_what_takes_too_long_is_ended_and_its_samples_are_kept():
    sampler = TreeSampler(0.05)
    apart = run_apart(endless, timeout_s=1.0, sampler=sampler)
    assert apart.error == "stopped after 1 s"
    assert sampler.samples


def test_utilisation_is_cpu_over_elapsed_time():
    def at(time_s, cpu_s):
        return Sample(time_s=time_s, cpu_s=cpu_s, rss_mb=1)

    assert utilisation([at(0, 0), at(2, 1), at(2, 1), at(3, 3)]) == [(1, 0.5), (2.5, 2)]
    assert utilisation([]) == []


def test_a_process_that_is_gone_gives_no_sample():
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    sampler = TreeSampler()
    sampler.take(gone.pid)
    assert sampler.samples == []
    assert sampler.peak_rss_mb is None
