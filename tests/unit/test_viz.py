"""Drawings have the size of the frame and show what is there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvmatch.testing import exact_motion_field, synthetic_drive
from mvmatch.types import Tracks
from mvmatch.viz import draw_motion, draw_tracks, track_tails

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("matplotlib")

TRACKS = Tracks.from_lists(
    [(0, 10.0, 10.0), (1, 20.0, 12.0), (2, 30.0, 14.0)],
    [(1, 50.0, 40.0), (2, 48.0, 40.0)],
    [(2, 70.0, 40.0), (3, 71.0, 40.0)],
)


def pixels(path: Path) -> np.ndarray:
    from matplotlib.image import imread

    return np.asarray(imread(path))


def test_a_tail_holds_the_last_positions_oldest_first() -> None:
    lines, lengths = track_tails(TRACKS, 2, tail=10)
    assert [line.tolist() for line in lines] == [
        [[10, 10], [20, 12], [30, 14]],
        [[50, 40], [48, 40]],
    ]
    assert lengths == [3, 2]
    lines, _ = track_tails(TRACKS, 2, tail=1)
    assert lines[0].tolist() == [[20, 12], [30, 14]]


def test_tracks_are_drawn_where_they_are(tmp_path: Path) -> None:
    drawn = pixels(draw_tracks(TRACKS, 2, tmp_path / "tracks.png", size=(96, 64)))
    assert drawn.shape[:2] == (64, 96)
    bright = drawn[:, :, :3].max(axis=2) > 0.2
    assert bright[10, 12]
    assert bright[40, 49]
    assert not bright[20:36].any()


def test_a_frame_without_tracks_is_still_a_picture(tmp_path: Path) -> None:
    picture = np.full((64, 96), 128, np.uint8)
    drawn = pixels(draw_tracks(TRACKS, 9, tmp_path / "t.png", size=(96, 64), picture=picture))
    assert abs(float(drawn[:, :, 0].mean()) - 0.5) < 0.02


def test_motion_is_drawn_over_the_picture(tmp_path: Path) -> None:
    scene = synthetic_drive(2, (160, 96))
    field = exact_motion_field(scene, 1)
    drawn = pixels(draw_motion(field, tmp_path / "motion.png", picture=scene.render(1)))
    plain = pixels(
        draw_tracks(TRACKS, 9, tmp_path / "plain.png", size=(160, 96), picture=scene.render(1))
    )
    changed = np.abs(drawn - plain)[:, :, :3].max(axis=2) > 0.1
    assert 0.01 < changed.mean() < 0.6
