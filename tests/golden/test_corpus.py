"""The corpus through the doors that users take, and the tool that compares it with libaom."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("mvmatch._core", reason="the compiled module is not built")

from mvmatch.errors import BitstreamError
from mvmatch.sources import open_video
from mvmatch.sources.av1 import Av1Source

if TYPE_CHECKING:
    from mvmatch._core import CodedFrame

REPOSITORY = Path(__file__).resolve().parents[2]
CORPUS = REPOSITORY / "tests" / "data" / "corpus"
COPIES = sorted(path.name for path in (CORPUS / "containers").iterdir())
TOOL = REPOSITORY / "tools" / "conformance.py"


def frames_of(path: Path) -> list[CodedFrame]:
    with open_video(path) as source:
        assert isinstance(source, Av1Source)
        return [frame for frame, _ in source.coded_frames()]


@pytest.mark.parametrize("name", COPIES)
def test_every_container_holds_the_same_frames_as_the_ivf_file(name: str) -> None:
    copied = frames_of(CORPUS / "containers" / name)
    original = frames_of(CORPUS / f"{name.split('.', maxsplit=1)[0]}.ivf")
    for ours, theirs in itertools.zip_longest(copied, original):
        assert ours.header() == theirs.header()
        assert ours.unit_index == theirs.unit_index
        blocks, expected = ours.blocks(), theirs.blocks()
        assert all(np.array_equal(blocks[column], expected[column]) for column in expected)


@pytest.mark.parametrize("suffix", ["mkv", "webm"])
def test_a_matroska_file_that_is_cut_gives_its_whole_frames_and_then_an_error(
    suffix: str, tmp_path: Path
) -> None:
    whole = CORPUS / "containers" / f"aom_good1_gm.{suffix}"
    data = whole.read_bytes()
    cut = tmp_path / whole.name
    cut.write_bytes(data[: len(data) * 2 // 3])
    found: list[CodedFrame] = []
    with open_video(cut) as source:
        assert isinstance(source, Av1Source)
        with pytest.raises(BitstreamError, match=f"{len(data) - cut.stat().st_size} bytes before"):
            found.extend(frame for frame, _ in source.coded_frames())
    assert 0 < len(found) < len(frames_of(whole))


def obus_of(unit: bytes) -> list[tuple[int, bytes]]:
    """Type and bytes of each OBU of a unit; all of them have a size field and no extension."""
    obus: list[tuple[int, bytes]] = []
    position = 0
    while position < len(unit):
        start, size, shift = position, 0, 0
        position += 1
        while True:
            byte = unit[position]
            size |= (byte & 127) << shift
            position, shift = position + 1, shift + 7
            if byte < 128:
                break
        position += size
        obus.append((unit[start] >> 3 & 15, unit[start:position]))
    return obus


def with_redundant_headers(unit: bytes) -> bytes:
    """The unit with its frame headers once more (type 7) before each further tile group."""
    header, groups, parts = b"", 0, list[bytes]()
    for kind, obu in obus_of(unit):
        if kind == 3:
            header, groups = bytes([obu[0] & 0x87 | 7 << 3]) + obu[1:], 0
        elif kind == 4:
            parts += [header] if groups else []
            groups += 1
        parts.append(obu)
    return b"".join(parts)


@pytest.mark.parametrize("name", ["aom_tiles_tg", "aom_tiles_tg2"])
def test_redundant_frame_headers_change_nothing(name: str, tmp_path: Path) -> None:
    data, position = (CORPUS / f"{name}.ivf").read_bytes(), 32
    copy = [data[:32]]
    while position < len(data):
        size = int.from_bytes(data[position : position + 4], "little")
        unit = with_redundant_headers(data[position + 12 : position + 12 + size])
        copy += [len(unit).to_bytes(4, "little"), data[position + 4 : position + 12], unit]
        position += 12 + size
    path = tmp_path / f"{name}.ivf"
    path.write_bytes(b"".join(copy))
    assert path.stat().st_size > len(data) + 100
    for ours, theirs in itertools.zip_longest(frames_of(path), frames_of(CORPUS / path.name)):
        assert ours.header() == theirs.header()
        blocks, expected = ours.blocks(), theirs.blocks()
        assert all(np.array_equal(blocks[column], expected[column]) for column in expected)


def conformance(folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(TOOL), "--no-trace", str(folder)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture
def small_corpus(tmp_path: Path) -> Path:
    """A corpus of one stream, and a copy of it that is cut inside its last packet."""
    for name in ("aom_8x8.ivf", "aom_8x8.golden.npz"):
        (tmp_path / name).write_bytes((CORPUS / name).read_bytes())
    cut = (CORPUS / "aom_8x8.ivf").read_bytes()[:-3]
    (tmp_path / "cut.ivf").write_bytes(cut)
    manifest = {
        "streams": [{"file": "aom_8x8.ivf", "golden": "aom_8x8.golden.npz"}],
        "corrupt": [{"file": "cut.ivf", "of": "aom_8x8", "what": "cut", "libaom": "rc=3"}],
    }
    (tmp_path / "MANIFEST.json").write_text(json.dumps(manifest))
    return tmp_path


def spoil(folder: Path, name: str, index: int) -> None:
    golden = dict(np.load(folder / "aom_8x8.golden.npz"))
    golden[name][index] += 1
    np.savez(folder / "aom_8x8.golden.npz", **golden)


def test_the_conformance_tool_accepts_a_stream_and_a_cut_copy(small_corpus: Path) -> None:
    result = conformance(small_corpus)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "1 equal, 1 refused" in result.stdout
    assert "NO TRACE" in result.stdout


@pytest.mark.parametrize("name", ["mv", "f_base_q_idx", "ref_size", "txb_stats"])
def test_one_wrong_number_before_the_damage_fails(name: str, small_corpus: Path) -> None:
    spoil(small_corpus, name, 1)
    result = conformance(small_corpus)
    assert result.returncode == 1
    assert result.stdout.count("DIFFERENT") == 3
    assert f"DIFFERENT {name} from record" in result.stdout


def test_damage_that_the_reference_sees_and_we_do_not_fails(small_corpus: Path) -> None:
    data = (CORPUS / "aom_8x8.ivf").read_bytes()
    position, last = 32, 32
    while position < len(data):
        last, position = (
            position,
            position + 12 + int.from_bytes(data[position : position + 4], "little"),
        )
    padding = b"\x12\x00\x7a\x01\x80"
    changed = data[:last] + len(padding).to_bytes(4, "little") + data[last + 4 : last + 12]
    (small_corpus / "cut.ivf").write_bytes(changed + padding)
    result = conformance(small_corpus)
    assert result.returncode == 1
    assert "SILENT" in result.stdout
