"""Facts of many frames in little memory."""

from __future__ import annotations

import pytest

from mvmatch.sources.frames import FrameFacts, FrameLog


def facts(index: int, references: tuple[int, ...]) -> FrameFacts:
    return FrameFacts(
        decode_index=index,
        display_index=1 << 40,
        frame_type="SWITCH" if references else "KEY",
        is_shown=bool(index % 2),
        is_repeat=not index % 2,
        width=65_536,
        height=1,
        base_q_idx=255,
        pts=index / 30 if index % 2 else None,
        ref_display_index=references,
    )


def test_frames_come_back_as_they_went_in() -> None:
    expected = [facts(0, ()), facts(1, (-1, 0, 1, 2, 3, 4, 1 << 40)), facts(2, ())]
    log = FrameLog()
    for frame in expected:
        log.append(frame)
    assert list(log) == expected
    assert log[-1] == expected[-1]
    assert log[1:] == expected[1:]
    assert len(log) == 3
    with pytest.raises(IndexError):
        _ = log[3]
