"""libaom's ``inspect`` as the paper's extractor, played by a script that prints its JSON."""

from __future__ import annotations

import json
import sys
from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import mvmatch
from mvmatch.bench import protocol_methods
from mvmatch.bench.inspect_tool import _BLOCK_SIZES, inspect_fields, missing_inspect
from mvmatch.bench.protocol_methods import METHODS
from mvmatch.errors import DataError
from mvmatch.matching import match_video
from mvmatch.tracks import TrackOptions

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

SIZES = [tuple(size) for size in _BLOCK_SIZES.tolist()]


def printed(stream: Path, *, runs: bool) -> str:
    """What ``inspect`` prints of a stream, made from mvmatch's own reading of it."""
    with mvmatch.open_video(stream) as source:
        fields = list(source)
        facts = [each for each in source.frames if not each.is_repeat]
    frames = []
    for field, header in zip(fields, facts, strict=True):
        rows, columns = (2 * ((size + 7) // 8) for size in (field.height, field.width))
        sizes = np.zeros((rows, columns), int)
        vectors = np.zeros((rows, columns, 4), int)
        names = np.tile([0, -1], (rows, columns, 1))
        previous = None
        for block, mv, reference in zip(
            field.block.tolist(), field.mv, field.ref_frame, strict=True
        ):
            x, y, w, h = block
            second = block == previous
            previous = block
            place = np.s_[y // 4 : (y + h) // 4, x // 4 : (x + w) // 4]
            sizes[place] = SIZES.index((w, h))
            vectors[(*place, np.s_[2 * second : 2 * second + 2])] = mv * 8
            names[(*place, int(second))] = 1 + header.ref_display_index.index(reference)
        layers = {"blockSize": sizes, "motionVectors": vectors, "referenceFrame": names}
        lists = {name: layer.tolist() for name, layer in layers.items()}
        if runs:
            lists = {name: [rolled(row) for row in layer] for name, layer in lists.items()}
        frames.append(lists)
    lines = []
    for number, frame in enumerate(frames):
        body = "".join(f'  "{name}": {json.dumps(layer)},\n' for name, layer in frame.items())
        lines.append(
            '{\n  "blockSizeMap": {"BLOCK_4X4": 0},\n' + body + f'  "frame": {number}\n}},\n'
        )
    return "[" + "".join(lines) + "null\n]\n"


def rolled(row: list[Any]) -> list[Any]:
    """Write cells that repeat as ``[n]``, as -x does."""
    items: list[Any] = []
    for index, cell in enumerate(row):
        if index and cell == row[index - 1]:
            if isinstance(items[-1], list) and len(items[-1]) == 1:
                items[-1][0] += 1
            else:
                items.append([1])
        else:
            items.append(cell)
    return items


@pytest.fixture
def play(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Put a program on the PATH that prints a text."""

    def put(text: str, *, code: int = 0, says: str = "") -> None:
        folder = tmp_path / "bin"
        folder.mkdir(exist_ok=True)
        (folder / "text").write_text(text)
        script = folder / "inspect"
        script.write_text(
            f"#!{sys.executable}\nimport sys\n"
            f"sys.stdout.write(open({str(folder / 'text')!r}).read())\n"
            f"sys.stderr.write({says!r})\nsys.exit({code})\n"
        )
        script.chmod(0o755)
        monkeypatch.setenv("PATH", str(folder), prepend=":")

    return put


def read(stream: Path) -> list[mvmatch.MotionField]:
    with mvmatch.open_video(stream) as source:
        deque(source, maxlen=0)
    return list(inspect_fields(stream, source.frames, source.info))


def rows_of(field: mvmatch.MotionField) -> list[tuple[float, ...]]:
    columns = (field.block, field.mv, field.ref_frame[:, None])
    return sorted(map(tuple, np.concatenate(columns, axis=1).tolist()))


@pytest.mark.parametrize("runs", [False, True])
@pytest.mark.parametrize("name", ["svt_flat_p8.ivf", "aom_realtime.ivf", "aom_odd_size.ivf"])
def test_the_vectors_are_those_that_the_parser_reads(
    data: Path, play: Callable[..., None], name: str, runs: bool
) -> None:
    play(printed(data / name, runs=runs))
    with mvmatch.open_video(data / name) as source:
        expected = list(source)
    for ours, theirs in zip(expected, read(data / name), strict=True):
        assert rows_of(ours) == rows_of(theirs)
        assert (ours.frame, ours.decode_index, ours.pts) == (
            theirs.frame, theirs.decode_index, theirs.pts,
        )  # fmt: skip
        assert ours.is_key == theirs.is_key
        assert theirs.mv.dtype == np.float32


@pytest.mark.parametrize(
    ("text", "code", "says", "words"),
    [
        ("", 1, "Failed to open", "ended with code 1 after 0 of .* Failed to open"),
        ("[null\n]\n", 0, "", "ended with code 0 after 0 of .* did not say why"),
        ("[{\n  no JSON\n},\n", 0, "", "something else than was expected at frame 0"),
        ('[{\n  "frame": 0\n},\n', 0, "", "KeyError: 'blockSize'"),
    ],
)
def test_a_program_that_fails_or_prints_something_else_is_named(
    data: Path, play: Callable[..., None], text: str, code: int, says: str, words: str
) -> None:
    play(text, code=code, says=says)
    with pytest.raises(DataError, match=words):
        read(data / "svt_flat_p8.ivf")


def test_frames_of_another_stream_are_refused(data: Path, play: Callable[..., None]) -> None:
    text = printed(data / "svt_flat_p8.ivf", runs=True)
    play(text.replace("null\n]", text[1:]))
    with pytest.raises(DataError, match="something else than was expected"):
        read(data / "svt_flat_p8.ivf")


def test_without_the_program_the_row_says_how_to_get_it(
    data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "")
    assert "CONFIG_INSPECTION" in (missing_inspect() or "")
    assert METHODS["inspect-paper"].unavailable() == missing_inspect()
    with pytest.raises(DataError, match="not on the PATH"):
        read(data / "svt_flat_p8.ivf")


def test_the_method_has_the_tracks_that_the_parser_gives(
    data: Path, play: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = data / "svt_flat_p8.ivf"
    play(printed(stream, runs=True))
    monkeypatch.setattr(protocol_methods, "encoded_stream", lambda clip, _: (clip, {}))
    timeline = protocol_methods.Timeline()
    found: Any = METHODS["inspect-paper"].run(stream, timeline, 1)

    expected = match_video(stream, options=TrackOptions.preset("paper")).tracks
    assert len(expected) > 10
    assert sorted(found.tracks.lengths) == sorted(expected.lengths)
    assert sorted(map(tuple, found.tracks.xy)) == sorted(map(tuple, expected.xy))
    assert [stage["name"] for stage in timeline.stages] == [protocol_methods.MATCH]
