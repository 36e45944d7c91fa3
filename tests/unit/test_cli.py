"""The command line: exit codes, two-line errors, JSON."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from mvmatch.cli import main
from mvmatch.cli.console import split_advice
from mvmatch.errors import BitstreamError, DataError

if TYPE_CHECKING:
    from pathlib import Path

    from _pytest.capture import CaptureFixture

VERBS = [
    *("run", "probe", "encode", "extract", "track"),
    *("export", "score", "reconstruct", "convert", "encoders"),
]


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself_and_knows_json(verb: str, capsys: CaptureFixture[str]) -> None:
    assert main([verb, "--help"]) == 0
    assert "--json" in capsys.readouterr().out


@pytest.mark.parametrize(
    "words",
    [
        ["frobnicate"],
        ["probe"],
        ["probe", "no-such-file.ivf"],
        ["run"],
        ["run", ".", "--encoder", "x266"],
        ["run", "--print-config", "--set", "track.no_such_option=1"],
        ["run", "--print-config", "--set", "track.max_gap"],
    ],
)
def test_a_wrong_command_line_is_two_lines_and_exit_code_2(
    words: list[str], capsys: CaptureFixture[str]
) -> None:
    assert main(words) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("usage: ")
    assert len(printed.err.splitlines()) == 2


@pytest.mark.parametrize("more", [[], ["--data", "."]])
@pytest.mark.parametrize(
    ("word", "meant"), [("acuracy", "accuracy"), ("smf", "sfm"), ("confidences", "confidence")]
)
def test_a_mistyped_benchmark_is_named(
    word: str, meant: str, more: list[str], capsys: CaptureFixture[str]
) -> None:
    assert main(["bench", word, *more]) == 2
    printed = capsys.readouterr().err
    assert f"Did you mean {meant}? Benchmarks: paper, accuracy, confidence, sfm" in printed


def test_a_word_like_no_benchmark_gets_their_names(capsys: CaptureFixture[str]) -> None:
    assert main(["bench", "frobnicate"]) == 2
    printed = capsys.readouterr().err
    assert "Did you mean" not in printed
    assert "Benchmarks: paper, accuracy, confidence, sfm" in printed


def test_a_missing_file_of_a_benchmark_is_named_as_one(capsys: CaptureFixture[str]) -> None:
    assert main(["bench", "configs/none.toml", "--data", "."]) == 1
    assert "configs/none.toml cannot be read" in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["probe", "extract", "track", "run"])
@pytest.mark.parametrize("content", [b"", b"a text, not a video\n", b"\x89PNG\r\n\x1a\n\0\0\0\0"])
def test_a_file_that_is_no_video_is_two_lines_and_exit_code_1(
    verb: str, content: bytes, tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    clip = tmp_path / "clip.mp4"
    clip.write_bytes(content)
    out = tmp_path / "out"
    outputs = {"probe": [], "run": ["-o", str(out)]}
    assert main([verb, str(clip), *outputs.get(verb, [str(out)])]) == 1
    printed = capsys.readouterr()
    assert printed.err.startswith(f"error: {clip}")
    assert len(printed.err.splitlines()) == 2
    assert not out.exists()


def test_an_error_is_json_when_json_is_asked_for(
    tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    clip = tmp_path / "clip.ivf"
    clip.touch()
    assert main(["probe", str(clip), "--json"]) == 1
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["kind"] == "DataError"
    assert "is empty" in error["message"]
    assert error["advice"]


def test_the_effective_options_can_be_printed_and_read_again(
    tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    assert main(["run", "--print-config", "--preset", "paper", "--set", "track.max_gap=7"]) == 0
    first = capsys.readouterr().out
    assert "max_gap = 7" in first
    path = tmp_path / "run.toml"
    path.write_text(first)
    assert main(["run", "--print-config", "--config", str(path)]) == 0
    assert capsys.readouterr().out == first


def test_advice_is_what_follows_the_first_sentence() -> None:
    what, advice = split_advice(DataError("a.ivf is empty (0 bytes). Was it copied completely?"))
    assert what == "a.ivf is empty (0 bytes)"
    assert advice == "Was it copied completely?"


def test_a_damaged_file_without_advice_gets_some() -> None:
    what, advice = split_advice(BitstreamError("the frame at byte 12.5e3 is cut off"))
    assert what == "the frame at byte 12.5e3 is cut off"
    assert "damaged" in advice
