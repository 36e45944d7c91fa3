"""What a stream may cost."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import pytest

from mvmatch import Limits, _core, open_video
from mvmatch.cli import main
from mvmatch.errors import LimitError

if TYPE_CHECKING:
    from pathlib import Path

    from mvmatch.types import MotionField


def test_the_documented_limits_are_those_that_hold() -> None:
    assert dataclasses.asdict(Limits()) == _core.default_limits()


@pytest.mark.parametrize(
    "limits",
    [
        Limits(max_frame_area=100),
        Limits(max_tiles=0),
        Limits(max_unit_bytes=10),
        Limits(max_frames=0),
        Limits(max_unit_samples=100),
        Limits(max_samples=100),
    ],
)
def test_every_limit_refuses_a_stream_and_is_named(data: Path, limits: Limits) -> None:
    default = Limits()
    (name,) = (
        field.name
        for field in dataclasses.fields(limits)
        if getattr(limits, field.name) != getattr(default, field.name)
    )
    with pytest.raises(LimitError, match=rf"aom_64\.ivf.*{name}"):
        open_video(data / "aom_64.ivf", limits=limits)


@pytest.mark.parametrize("name", ["svt_flat_p8.ivf", "svt_flat_p8.mkv"])
def test_frames_before_a_limit_are_read(data: Path, name: str) -> None:
    read: list[MotionField] = []
    video = open_video(data / name, limits=Limits(max_frames=3))
    with video, pytest.raises(LimitError, match="max_frames"):
        read.extend(video)
    assert len(read) == 3


def test_a_limit_is_an_error_also_where_damage_is_skipped(data: Path) -> None:
    video = open_video(data / "aom_64.ivf", errors="resume", limits=Limits(max_frames=2))
    with video, pytest.raises(LimitError):
        list(video)


def test_the_command_line_sets_limits_and_says_how_to_raise_them(
    data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["probe", str(data / "aom_64.ivf"), "--set"]
    assert main([*words, "read.limits.max_frames=3"]) == 1
    errors = capsys.readouterr().err
    assert "max_frames = 4, but the limit is 3" in errors
    assert "--set read.limits.NAME=VALUE" in errors
    assert main([*words, "read.limits.max_frames=off"]) == 0
