"""Ctrl-C in the middle of one frame."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")

HUGE_FRAME = '''
import signal
from mvmatch import Limits, _core


def bits(*fields):
    """Fields of (value, number of bits), filled up to whole bytes."""
    text = "".join(format(value, f"0{count}b") for value, count in fields if count)
    text += "0" * (-len(text) % 8)
    return int(text, 2).to_bytes(len(text) // 8, "big")


def obu(kind, payload):
    size = len(payload)
    leb128 = bytes([size & 127 | 128, size >> 7 & 127 | 128, size >> 14])
    return bytes([kind << 3 | 2]) + leb128 + payload


# A still picture of 65536x65536: 512 empty tiles of 4096x2048, of 73 bytes each.
sequence = bits((0, 3), (3, 2), (31, 5), (255, 8), (65535, 16), (65535, 16), (0, 14), (1, 1))
header = bits((0, 3), (1, 1), (0, 2), (0, 9), (0, 2), (100, 8), (0, 24), (0, 1))
tile = bytes(72) + b"\\x01"
tiles = (b"\\x48" + tile) * 511 + tile
unit = obu(2, b"") + obu(1, sequence) + obu(6, header + b"\\0" + tiles)
limits = Limits(max_frame_area=1 << 32, max_unit_samples=1 << 33)
parser = _core.Av1Parser(limits=limits)
'''

LOOP = """
# A shell starts what runs in its background with the signal ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
print("reading", flush=True)
while True:
    parser.push(unit)
    assert parser.next_frame() is not None
"""

COUNTED = """
seen = 0

def count(number, frame):
    # Python runs this once after a call that never looks at signals, however many came.
    global seen
    seen += 1
    if seen == 3:
        raise TimeoutError

signal.signal(signal.SIGALRM, count)
parser.push(unit)
signal.setitimer(signal.ITIMER_REAL, 0.01, 0.01)
try:
    parser.next_frame()
except TimeoutError:
    print("stopped in the middle")
signal.setitimer(signal.ITIMER_REAL, 0)
parser.push(unit)
print(parser.next_frame().decode_index)
"""


def test_signals_are_handled_while_a_frame_is_read() -> None:
    run = subprocess.run(
        [sys.executable, "-c", HUGE_FRAME + COUNTED], capture_output=True, text=True, check=False
    )
    assert run.stdout.splitlines() == ["stopped in the middle", "1"], run.stderr


def test_ctrl_c_ends_the_process_as_the_signal_asks() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HUGE_FRAME + LOOP],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "reading\n"
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate()
    assert "KeyboardInterrupt" in errors
    assert process.returncode == -signal.SIGINT
