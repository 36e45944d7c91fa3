"""Every small stream gives the vectors it always gave, and they point where the scene moved.

``tests/data/expected.txt`` holds one line per coded frame. After a deliberate change of the streams
or of the columns, write it anew with ``python tests/golden/test_streams.py`` and look at the diff.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

pytest.importorskip("mvmatch._core", reason="the compiled module is not built")

from mvmatch import _core
from mvmatch.testing import synthetic_drive
from mvmatch.types import MotionFlags

if TYPE_CHECKING:
    from collections.abc import Iterator

REPOSITORY = Path(__file__).resolve().parents[2]
DATA = REPOSITORY / "tests" / "data"
EXPECTED = DATA / "expected.txt"
STREAMS = sorted(path.name for path in DATA.glob("*.ivf"))
COPIES = ("svt_flat_p8.obu", "svt_flat_p8.annexb")
COLUMNS = (
    ("block", "<i4"),
    ("mv", "<f4"),
    ("ref_frame", "<i4"),
    ("flags", "<u2"),
    ("segment_id", "u1"),
    ("qindex", "u1"),
    ("residual", "<f4"),
    ("warp", "<f8"),
)
DRIVES = {
    "drive.ivf": (20, (352, 200)),
    "svt_flat_p8.ivf": (10, (208, 120)),
    "svt_random_access_p2.ivf": (18, (208, 120)),
    "aom_realtime.ivf": (10, (208, 120)),
    "aom_good_lag.ivf": (18, (208, 120)),
    "aom_720p.ivf": (3, (1280, 720)),
    "aom_tiles_8x8.ivf": (4, (512, 512)),
    "aom_segments_delta_q.ivf": (10, (208, 120)),
    "rav1e_reordered.ivf": (14, (208, 120)),
}


def coded_frames(path: Path) -> Iterator[_core.CodedFrame]:
    parser, reader = _core.Av1Parser(), _core.ContainerReader(str(path))
    while (unit := reader.next_unit()) is not None:
        parser.push(unit[1])
        while (frame := parser.next_frame()) is not None:
            yield frame


def line(frame: _core.CodedFrame) -> str:
    """Facts of a frame and a digest of its rows."""
    if frame.show_existing_frame:
        return f"{frame.display_index} shows decoded frame {frame.decode_index}"
    motion = frame.motion()
    digest = hashlib.sha256()
    for name, dtype in COLUMNS:
        column = np.nan_to_num(motion[name], nan=-1e9)
        digest.update(np.ascontiguousarray(column.astype(dtype)).tobytes())
    shown = "shown" if frame.show_frame else "hidden"
    return (
        f"{frame.display_index} {frame.frame_type} {shown} {len(motion['mv'])} rows "
        f"{digest.hexdigest()[:16]}"
    )


def lines_of(name: str) -> list[str]:
    return [line(frame) for frame in coded_frames(DATA / name)]


def expected() -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    current: list[str] = []
    for text in EXPECTED.read_text(encoding="utf-8").splitlines():
        if text.startswith("# "):
            current = found.setdefault(text[2:], [])
        elif text:
            current.append(text)
    return found


def dump(name: str) -> Path:
    """Write all rows of a stream for a look at what changed."""
    folder = REPOSITORY / "tests" / "out"
    folder.mkdir(exist_ok=True)
    rows: dict[str, Any] = {}
    for number, frame in enumerate(coded_frames(DATA / name)):
        if not frame.show_existing_frame:
            rows |= {f"{number}.{key}": value for key, value in frame.motion().items()}
    np.savez_compressed(folder / f"{name}.npz", **rows)
    return folder / f"{name}.npz"


@pytest.mark.parametrize("name", STREAMS)
def test_a_stream_gives_the_rows_it_always_gave(name: str) -> None:
    found = lines_of(name)
    if found != expected()[name]:
        pytest.fail(f"{name} changed; all its rows are in {dump(name)}")


def test_every_expected_stream_is_there() -> None:
    assert sorted(expected()) == STREAMS


@pytest.mark.parametrize("name", COPIES)
def test_another_container_changes_nothing(name: str) -> None:
    assert lines_of(name) == lines_of("svt_flat_p8.ivf")


def test_together_the_streams_use_every_tool() -> None:
    flags, segments, quantisers, largest = 0, 0, 0, 0
    for name in STREAMS:
        for frame in coded_frames(DATA / name):
            if not frame.show_existing_frame:
                motion = frame.motion()
                flags |= int(np.bitwise_or.reduce(motion["flags"], initial=0))
                segments = max(segments, int(motion["segment_id"].max(initial=0)))
                quantisers = max(quantisers, len(np.unique(motion["qindex"])))
                largest = max(largest, int(motion["block"][:, 2:].max(initial=0)))
    assert flags == sum(MotionFlags)
    assert segments >= 2
    assert quantisers >= 3
    assert largest == 128


@pytest.mark.parametrize("name", sorted(DRIVES))
def test_most_vectors_point_to_where_the_scene_really_was(name: str) -> None:
    num_frames, size = DRIVES[name]
    scene = synthetic_drive(num_frames, size)
    errors: list[np.ndarray] = []
    for frame in coded_frames(DATA / name):
        if frame.show_existing_frame:
            continue
        motion, number = frame.motion(), int(frame.display_index)
        center = motion["block"][:, :2] + motion["block"][:, 2:] / 2
        near = np.abs(motion["ref_frame"] - number) <= 2
        near &= (center < size).all(axis=1)
        for reference in np.unique(motion["ref_frame"][near]).tolist():
            rows = near & (motion["ref_frame"] == reference)
            target, visible = scene.transfer(number, reference, center[rows])
            error = np.linalg.norm(center[rows] + motion["mv"][rows] - target, axis=1)
            errors.append(error[visible])
    error = np.concatenate(errors)
    assert len(error) > 700
    assert np.median(error) < 0.6
    assert (error < 2).mean() > 0.75


def main() -> None:
    text = "\n\n".join("\n".join([f"# {name}", *lines_of(name)]) for name in STREAMS)
    EXPECTED.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
