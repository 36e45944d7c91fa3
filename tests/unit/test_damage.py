"""Streams that are damaged in the middle: the frames before stay, reading can go on."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvmatch import match_video, open_video
from mvmatch.cli import main
from mvmatch.config import ReadOptions
from mvmatch.errors import BitstreamError

if TYPE_CHECKING:
    from pathlib import Path

    from mvmatch.types import MotionField


def packets(stream: bytes) -> list[slice]:
    """Where the data of each packet of an IVF file lies."""
    found: list[slice] = []
    at = 32
    while at < len(stream):
        size = int.from_bytes(stream[at : at + 4], "little")
        found.append(slice(at + 12, at + 12 + size))
        at += 12 + size
    return found


def fields_of(path: Path) -> list[MotionField]:
    with open_video(path) as video:
        return list(video)


@pytest.fixture
def damaged(data: Path, tmp_path: Path) -> Path:
    """A stream with a key frame in every second picture, whose tile data is wrong in packet 3."""
    stream = bytearray((data / "svt_key_every_2.ivf").read_bytes())
    packet = packets(stream)[3]
    half = (packet.start + packet.stop) // 2
    stream[half : packet.stop] = b"\x5a" * (packet.stop - half)
    path = tmp_path / "damaged.ivf"
    path.write_bytes(stream)
    return path


def test_damage_raises_after_the_frames_before_it(data: Path, damaged: Path) -> None:
    whole = fields_of(data / "svt_key_every_2.ivf")
    read: list[MotionField] = []
    expected = pytest.raises(BitstreamError, match=r"damaged\.ivf.*byte \d+")
    with open_video(damaged) as video, expected as caught:
        read.extend(video)
    assert caught.value.frame == len(read) == 3
    assert all(np.array_equal(a.mv, b.mv) for a, b in zip(read, whole, strict=False))


def test_reading_resumes_exactly_at_the_first_intact_frame(data: Path, damaged: Path) -> None:
    whole = {field.frame: field for field in fields_of(data / "svt_key_every_2.ivf")}
    with open_video(damaged, errors="resume") as video:
        read = list(video)
        (skipped,) = video.skipped
    assert {field.frame for field in read} == whole.keys() - {3}
    for field in read:
        assert np.array_equal(field.mv, whole[field.frame].mv)
        assert np.array_equal(field.block, whole[field.frame].block)
    assert skipped.after_frame == 3
    assert skipped.num_errors == 1
    assert skipped.byte_offset is not None
    assert "After 3 frames, one error: malformed stream at byte" in str(skipped)


def test_a_stream_without_a_readable_frame_is_an_error_also_to_resume(
    data: Path, tmp_path: Path
) -> None:
    stream = (data / "svt_flat_p8.ivf").read_bytes()
    first = packets(stream)[0]
    path = tmp_path / "headless.ivf"
    path.write_bytes(stream[:32] + stream[first.stop :])
    with pytest.raises(BitstreamError, match=r"headless\.ivf has no frame that can be read"):
        open_video(path, errors="resume")


def test_a_lost_key_frame_loses_all_that_depend_on_it(data: Path, tmp_path: Path) -> None:
    stream = bytearray((data / "svt_flat_p8.ivf").read_bytes())
    for packet in packets(stream)[:1]:
        middle = (packet.start + packet.stop) // 2
        stream[middle : packet.stop] = b"\xff" * (packet.stop - middle)
    path = tmp_path / "lost.ivf"
    path.write_bytes(stream)
    with pytest.raises(BitstreamError, match="no frame that can be read"):
        open_video(path, errors="resume")


def test_probe_tells_what_was_skipped(damaged: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["probe", str(damaged), "--errors", "resume", "--json"]) == 0
    captured = capsys.readouterr()
    document = json.loads(captured.out)
    (skipped,) = document["skipped"]
    assert skipped["after_frame"] == 3
    assert skipped["section"]
    assert "A part of the stream was skipped. After 3 frames" in captured.err
    assert main(["probe", str(damaged), "--json"]) == 1


def test_tracks_are_made_of_what_was_read(damaged: Path) -> None:
    match = match_video(damaged, read=ReadOptions(errors="resume"))
    assert match.damage is None
    assert len(match.skipped) == 1
    assert match.warnings[0].startswith("A part of the stream was skipped.")
    assert match.num_frames > 4
