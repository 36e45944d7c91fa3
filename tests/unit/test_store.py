"""Motion and tracks in Parquet: what is written is what is read."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvmatch.errors import DataError
from mvmatch.sources import FrameFacts
from mvmatch.store import (
    StoredMotion,
    TracksTable,
    is_table,
    read_tracks,
    write_motion,
    write_tracks,
)
from mvmatch.types import MotionField, Tracks, VideoInfo

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

INFO = VideoInfo(width=64, height=32, num_frames=2, frame_rate=25.0, codec="av1")


def field(frame: int, rows: int) -> MotionField:
    rng = np.random.default_rng(frame)
    return MotionField(
        frame=frame,
        decode_index=frame,
        pts=frame / 25,
        width=64,
        height=32,
        is_key=not rows,
        is_shown=True,
        block=rng.integers(0, 64, (rows, 4)).astype(np.int32),
        mv=rng.integers(-80, 80, (rows, 2)).astype(np.float32) / 8,
        ref_frame=np.zeros(rows, np.int32),
        flags=rng.integers(0, 64, rows).astype(np.uint16),
        segment_id=rng.integers(0, 8, rows).astype(np.uint8),
        qindex=rng.integers(0, 256, rows).astype(np.uint8),
        residual=rng.random(rows, np.float32),
        warp=np.where(rng.random((rows, 6)) < 0.5, np.nan, rng.random((rows, 6))),
    )


def facts(frame: int) -> FrameFacts:
    return FrameFacts(
        decode_index=frame,
        display_index=frame,
        frame_type="INTER" if frame else "KEY",
        is_shown=True,
        is_repeat=False,
        width=64,
        height=32,
        base_q_idx=9,
        ref_display_index=(0,) * 7 if frame else (),
    )


def test_motion_comes_back_with_every_column_and_its_empty_frames(tmp_path: Path) -> None:
    written = [field(0, 0), field(1, 5), field(2, 0), field(3, 2)]
    path = tmp_path / "motion.parquet"
    headers = [facts(frame) for frame in range(4)]
    assert write_motion(iter(written), path, info=INFO, frames=lambda: headers) == 7

    with StoredMotion(path) as stored:
        assert stored.info == INFO
        assert list(stored.frames) == headers
        found = list(stored)
    for before, after in zip(written, found, strict=True):
        assert (before.frame, before.pts, before.is_key) == (after.frame, after.pts, after.is_key)
        for name in ("block", "mv", "ref_frame", "flags", "segment_id", "qindex", "warp"):
            first, second = getattr(before, name), getattr(after, name)
            assert first.dtype == second.dtype
            np.testing.assert_array_equal(first, second)


def test_tracks_come_back_with_their_video_and_image_names(tmp_path: Path) -> None:
    tracks = Tracks.from_lists(
        [(0, 2.0, 2.5), (1, 6.0, 2.5)], [(0, 1.0, 1.0), (1, 1.5, 1.0), (2, 2.0, 1.0)]
    )
    path = tmp_path / "tracks.parquet"
    table = TracksTable(tracks=tracks, info=INFO, image_names=("a.png", "b.png", "c.png"))
    write_tracks(table, path, options={"min_length": 2})

    found = read_tracks(path)
    assert found.image_names == table.image_names
    assert found.info == INFO
    for name in ("offsets", "frame", "xy"):
        np.testing.assert_array_equal(getattr(found.tracks, name), getattr(tracks, name))
        assert getattr(found.tracks, name).dtype == getattr(tracks, name).dtype


def test_tracks_are_read_whole_however_many_rows_are_read_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lengths = [4, 1, 3, 2, 6]
    tracks = Tracks.from_lists(*([(i, i, 7.0 * n) for i in range(n)] for n in lengths))
    path = tmp_path / "tracks.parquet"
    names = tuple("abcdef")
    write_tracks(TracksTable(tracks=tracks, info=INFO, image_names=names), path, options={})
    for rows in (1, 2, 3, 5, 16):
        monkeypatch.setattr("mvmatch.store._ROWS_AT_ONCE", rows)
        found = read_tracks(path).tracks
        for name in ("offsets", "frame", "xy"):
            np.testing.assert_array_equal(getattr(found, name), getattr(tracks, name))


def test_no_tracks_are_a_table_too(tmp_path: Path) -> None:
    path = tmp_path / "tracks.parquet"
    table = TracksTable(tracks=Tracks.from_lists(), info=INFO, image_names=())
    write_tracks(table, path, options={})
    assert len(read_tracks(path).tracks) == 0


def test_units_and_conventions_are_in_the_file(tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    path = tmp_path / "motion.parquet"
    write_motion([field(1, 3)], path, info=INFO, frames=lambda: [facts(1)])
    schema = pq.read_schema(path)
    assert schema.field("mv_x").metadata[b"unit"] == b"px"
    assert b"xy_in_current + mv" in pq.read_metadata(path).metadata[b"mvmatch"]


def test_a_source_that_fails_leaves_no_table(tmp_path: Path) -> None:
    def failing() -> Iterator[MotionField]:
        yield field(1, 3)
        raise RuntimeError("boom")

    with pytest.raises(RuntimeError):
        write_motion(failing(), tmp_path / "motion.parquet", info=INFO, frames=list)
    assert list(tmp_path.iterdir()) == []


def test_a_motion_table_is_not_taken_for_tracks(tmp_path: Path) -> None:
    path = tmp_path / "motion.parquet"
    write_motion([field(1, 3)], path, info=INFO, frames=list)
    assert is_table(path)
    with pytest.raises(DataError, match="a tracks table is needed"):
        read_tracks(path)


def test_another_file_is_not_taken_for_a_table(tmp_path: Path) -> None:
    path = tmp_path / "tracks.parquet"
    path.write_bytes(b"PAR1 but not really")
    with pytest.raises(DataError, match="not a tracks table"):
        read_tracks(path)


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    table = TracksTable(tracks=Tracks.from_lists(), info=INFO, image_names=())
    with pytest.raises(DataError, match=r"cannot write .*tracks\.parquet"):
        write_tracks(table, tmp_path / "file" / "tracks.parquet", options={})
