"""The demo: a rendered drive comes back as a model that is right, not only registered."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("pycolmap")

from mvmatch.demo import IMAGES, TRUTH, run_demo
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from pathlib import Path


def test_a_short_drive_is_reconstructed_close_to_the_truth(tmp_path: Path) -> None:
    made = run_demo(tmp_path, num_frames=12, size=(384, 216))

    assert made.run.model.accepted
    assert made.run.model.registered == 12
    assert made.error is not None
    assert made.error.num_frames == 12
    assert made.error.percent_of_path < 0.5

    assert made.run.match.warnings == []

    report = json.loads((tmp_path / "report.json").read_text("utf-8"))
    assert report["accuracy"]["ate_percent"] == pytest.approx(made.error.percent_of_path)
    assert report["stages"][0]["name"] == "render"
    assert "Accuracy against the truth" in (tmp_path / "report.html").read_text("utf-8")
    assert len(list((tmp_path / IMAGES).iterdir())) == 12
    assert np.loadtxt(tmp_path / TRUTH).shape == (12, 12)


def test_a_folder_with_images_of_its_own_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / IMAGES).mkdir()
    (tmp_path / IMAGES / "frame_000000.png").write_bytes(b"mine")
    with pytest.raises(DataError, match="was not made by the demo"):
        run_demo(tmp_path)
    assert (tmp_path / IMAGES / "frame_000000.png").read_bytes() == b"mine"
