"""Functions in a process of their own; those here are the library's, so that it can import them."""

import json
import math
import os
import subprocess
import sys
import time

from mvmatch.bench.apart import run_apart


def test_a_value_comes_back_with_the_infinities_of_failures():
    apart = run_apart(json.loads, '{"ate": Infinity, "names": ["a"]}')
    assert apart.value == {"ate": math.inf, "names": ["a"]}
    assert apart.error is None
    assert apart.peak_rss_mb is None or apart.peak_rss_mb > 1


def test_cpu_time_of_what_the_process_started_counts():
    burn = "import time\nwhile time.process_time() < 1: pass"
    apart = run_apart(subprocess.getstatusoutput, f"{sys.executable} -c '{burn}'")
    assert apart.value[0] == 0
    assert apart.cpu_s >= 1


def test_an_exception_a_crash_and_an_answer_that_is_none_are_reasons():
    assert run_apart(int, "many").error.startswith("ValueError: invalid literal")
    assert run_apart(os._exit, 3).error == "the process died without a word (3)"
    assert run_apart(set).error.startswith("TypeError: ")


def test_memory_is_that_of_the_process_and_not_of_the_one_that_started_it():
    held = bytearray(b"x") * 300_000_000
    apart = run_apart(json.loads, "{}")
    assert len(held) == 300_000_000
    assert apart.peak_rss_mb is None or apart.peak_rss_mb < 250


def test_what_does_not_end_is_ended_with_all_that_it_started(tmp_path):
    note = tmp_path / "pid"
    # The shell is what runs when the time is over: its number is there before.
    command = f"echo $$ > {note}; exec sleep 1000"
    apart = run_apart(subprocess.getstatusoutput, command, timeout_s=10)
    assert apart.error == "stopped after 10 s"
    assert apart.value == {}
    if not note.is_file():
        return  # a machine so busy that nothing was started yet
    pid = int(note.read_text())
    for _ in range(100):
        if not is_running(pid):
            break
        time.sleep(0.1)
    assert not is_running(pid)


def is_running(pid: int) -> bool:
    """Whether a process exists and is no corpse that nobody has asked for."""
    state = subprocess.run(
        ["ps", "-o", "stat=", "-p", str(pid)], capture_output=True, text=True, check=False
    ).stdout.strip()
    return state != "" and not state.startswith("Z")
