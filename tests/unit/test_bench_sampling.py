"""Samples of a tree of processes against what the system counts at its end."""

import subprocess
import sys
import time

import pytest

from mvmatch.bench.apart import run_apart
from mvmatch.bench.sampling import Sample, TreeSampler, utilisation

resource = pytest.importorskip("resource")
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="samples come from /proc")

SPIN = "import time\nend = {0}\nwhile time.process_time() < end: pass"


def work(seconds):
    """Keep this process busy, then a child of it, for ``seconds`` of CPU time each."""
    held = bytearray(64_000_000)
    exec(SPIN.format(time.process_time() + seconds))
    subprocess.run([sys.executable, "-c", SPIN.format(seconds)], check=True)
    return {"held": len(held)}


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
    assert sampler.samples[-1].time_s - sampler.samples[0].time_s == pytest.approx(wall, rel=0.05)
    assert sampler.own_cpu_s < 0.01 * wall
    assert 64 < sampler.peak_rss_mb < 400


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
