"""Damaged MP4, Matroska and WebM files: fields or an error of ours, whatever FFmpeg makes of them.

``MVMATCH_MUTATIONS=10000`` reads more files.
"""

from __future__ import annotations

import os
import random
from typing import TYPE_CHECKING

import pytest

from mvmatch import Limits, open_video
from mvmatch.errors import MvmatchError

if TYPE_CHECKING:
    from pathlib import Path

LIMITS = Limits(max_frame_area=1 << 20, max_samples=1 << 26)


def damage(stream: bytes, source: random.Random) -> bytes:
    """Flip bits, overwrite, remove or repeat bytes, or cut the end off."""
    changed = bytearray(stream)
    for _ in range(source.randint(1, 4)):
        at = source.randrange(len(changed))
        span = source.randint(1, 64)
        match source.randrange(6):
            case 0 | 1:
                changed[at] ^= 1 << source.randrange(8)
            case 2:
                changed[at : at + span] = source.randbytes(len(changed[at : at + span]))
            case 3:
                del changed[at : at + span]
            case 4:
                changed[at:at] = changed[at : at + span]
            case _:
                del changed[max(at, 16) :]
    return bytes(changed)


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "webm"])
def test_a_damaged_container_gives_fields_or_one_of_our_errors(
    data: Path, tmp_path: Path, suffix: str
) -> None:
    stream = (data / f"svt_flat_p8.{suffix}").read_bytes()
    source = random.Random(7)
    path = tmp_path / f"damaged.{suffix}"
    read = 0
    for _ in range(int(os.environ.get("MVMATCH_MUTATIONS", "40"))):
        path.write_bytes(damage(stream, source))
        try:
            with open_video(path, errors="resume", limits=LIMITS) as video:
                read += sum(1 for _ in video)
        except MvmatchError:
            pass
    assert read > 0


def test_files_that_once_raised_something_else_do_so_no_more(data: Path) -> None:
    paths = [path for path in (data / "bugs").iterdir() if path.suffix != ".md"]
    assert paths
    for path in paths:
        try:
            with open_video(path, errors="resume", limits=LIMITS) as video:
                list(video)
        except MvmatchError:
            pass
