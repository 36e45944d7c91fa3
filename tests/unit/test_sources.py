"""Telling files apart, and saying what to do with those that are not AV1."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvmatch.errors import DataError
from mvmatch.sources import FrameFacts, ReferenceStructure, open_video, sniff
from mvmatch.types import MotionField

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("head", "kind"),
    [
        (b"", "empty"),
        (b"DKIF\0\0\x20\0AV01", "av1-elementary"),
        (b"\x12\x00\x0a\x0b", "av1-elementary"),
        (b"\x20\x1f\x01\x10\x0c\x08", "av1-elementary"),
        (b"\0\0\0\x20ftypisom", "container"),
        (b"\x1a\x45\xdf\xa3\x01", "container"),
        ("just a few words, für dich\n".encode(), "text"),
        (b"\x89PNG\r\n\x1a\n\0\0", "unknown"),
    ],
)
def test_files_are_told_apart_by_their_first_bytes(tmp_path: Path, head: bytes, kind: str) -> None:
    path = tmp_path / "clip.mp4"
    path.write_bytes(head)
    assert sniff(path) == kind


def test_an_empty_file_is_called_empty(tmp_path: Path) -> None:
    path = tmp_path / "clip.ivf"
    path.touch()
    with pytest.raises(DataError, match="is empty"):
        open_video(path)


def test_a_text_file_is_called_text(tmp_path: Path) -> None:
    path = tmp_path / "clip.ivf"
    path.write_text("not a video\n")
    with pytest.raises(DataError, match="text file"):
        open_video(path)


def test_a_folder_is_sent_to_the_encoder(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="mvmatch encode"):
        open_video(tmp_path)


def test_a_missing_file_is_a_file_not_found_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"clip\.ivf"):
        open_video(tmp_path / "clip.ivf")


def field(frame: int, block: list[list[int]], references: list[int]) -> MotionField:
    rows = len(block)
    return MotionField(
        frame=frame,
        decode_index=frame,
        pts=None,
        width=64,
        height=32,
        is_key=not rows,
        is_shown=True,
        block=np.array(block, np.int32).reshape(rows, 4),
        mv=np.zeros((rows, 2), np.float32),
        ref_frame=np.array(references, np.int32),
        flags=np.zeros(rows, np.uint16),
        segment_id=np.zeros(rows, np.uint8),
        qindex=np.zeros(rows, np.uint8),
        residual=np.zeros(rows, np.float32),
        warp=np.full((rows, 6), np.nan),
    )


def facts(frame: int, frame_type: str) -> FrameFacts:
    return FrameFacts(
        decode_index=frame,
        display_index=frame,
        frame_type=frame_type,
        is_shown=True,
        is_repeat=False,
        width=64,
        height=32,
        base_q_idx=100,
        ref_display_index=(),
    )


def test_the_share_to_the_previous_picture_is_weighted_by_area_inside_the_picture() -> None:
    structure = ReferenceStructure()
    structure.add(field(0, [], []))
    # 32x32 to the previous picture; 64x64 at x = 32 shows only 32x32 of itself.
    structure.add(field(2, [[0, 0, 32, 32], [32, 0, 64, 64]], [1, 0]))
    assert structure.share_to_previous == pytest.approx(0.5)
    assert structure.inter_area_share == pytest.approx(1.0)


def test_a_compound_block_covers_its_area_once() -> None:
    structure = ReferenceStructure()
    structure.add(field(2, [[0, 0, 32, 32], [0, 0, 32, 32]], [1, 0]))
    assert structure.inter_area_share == pytest.approx(0.5)
    assert structure.num_vectors == 2


def test_rows_are_counted_by_distance_however_far_it_is() -> None:
    structure = ReferenceStructure()
    far = -(2**31) + 5
    block = [[0, 0, 32, 32], [32, 0, 32, 32], [0, 0, 32, 32], [0, 32, 8, 8]]
    structure.add(field(2, block, [1, 3, far, 1]))
    arrays = structure.to_arrays()
    assert arrays["per_distance"].tolist() == [[-1, 1, 1024], [1, 2, 1024], [2 - far, 1, 1024]]
    assert sorted(arrays["per_pair"].tolist()) == [[2, far, 1], [2, 1, 2], [2, 3, 1]]


def test_only_key_frames_are_warned_about() -> None:
    structure = ReferenceStructure()
    frames = [facts(0, "KEY"), facts(1, "KEY")]
    assert "no motion vectors" in structure.warnings(frames)[0]
    assert structure.summary(frames)["key_frames"] == [0, 1]


def test_key_frames_every_second_frame_forbid_tracks_of_three() -> None:
    structure = ReferenceStructure()
    structure.add(field(1, [[0, 0, 64, 32]], [0]))
    kinds = ["KEY", "INTER", "KEY", "INTER"]
    warnings = structure.warnings([facts(i, kind) for i, kind in enumerate(kinds)])
    assert "cannot reach three frames" in warnings[0]
