"""Pictures are asked where nobody knows the camera."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from mvmatch import stages
from mvmatch.cli import main
from mvmatch.config import RunOptions, from_mapping
from mvmatch.errors import DataError
from mvmatch.matching import match_video
from mvmatch.outputs import dense_warnings
from mvmatch.pipeline import reconstruct_video
from mvmatch.refine import RefineOptions
from mvmatch.sources.options import Skipped
from mvmatch.state import State
from mvmatch.tracks import TrackOptions

if TYPE_CHECKING:
    from pathlib import Path

    from mvmatch.match import Match
    from mvmatch.pipeline import Run

FOCAL = 260.48
"""px, of drive.ivf."""


@pytest.fixture(scope="module")
def match(data: Path) -> Match:
    return match_video(data / "drive.ivf")


def state(source: Path, match: Match, **changed: Any) -> State:
    words: dict[str, Any] = {"camera": None, "options": RunOptions(), "masks": False}
    words |= {"has_to_encode": False, "undistort": False, "progress": None}
    made = State(source=source, **words | changed)
    made.match = match
    return made


def test_tracks_are_aligned_where_the_camera_is_unknown_unless_told_otherwise(
    data: Path, match: Match
) -> None:
    pytest.importorskip("cv2")
    drive = data / "drive.ivf"
    given = f"{FOCAL}"
    never, always = (
        from_mapping({"refine": {"when": word}}, RunOptions()) for word in ("never", "always")
    )
    assert state(drive, match).refines == ("tracks",)
    assert not state(drive, match, camera=given).refines
    assert not state(drive, match, options=never).refines
    assert state(drive, match, camera=given, options=always).refines == ("tracks",)
    assert not state(drive, match, options=RunOptions.preset("paper")).refines


def test_tracks_that_only_make_the_model_denser_are_aligned_whoever_knows_the_camera(
    data: Path,
) -> None:
    pytest.importorskip("cv2")
    drive, given = data / "drive.ivf", f"{FOCAL}"
    dense = match_video(drive, options=TrackOptions.preset("dense"))
    never, always = (
        from_mapping({"refine": {"when": word}}, RunOptions()) for word in ("never", "always")
    )
    assert state(drive, dense).refines == ("tracks", "further")
    assert state(drive, dense, camera=given).refines == ("further",)
    assert state(drive, dense, camera=given, options=always).refines == ("tracks", "further")
    assert not state(drive, dense, options=never).refines
    at_rest = dataclasses.replace(dense.footage, still_area_share=0.8)
    resting = dataclasses.replace(dense, footage=at_rest)
    assert not state(drive, resting, camera=given).refines


def test_without_opencv_it_is_said_that_dense_points_would_be_exacter(
    data: Path, match: Match, monkeypatch: pytest.MonkeyPatch
) -> None:
    dense = match_video(data / "drive.ivf", options=TrackOptions.preset("dense"))
    aligned = dataclasses.replace(dense, is_further_refined=True)
    at_rest = dataclasses.replace(dense.footage, still_area_share=0.8)
    resting = dataclasses.replace(dense, footage=at_rest)
    for is_there in (True, False):
        monkeypatch.setattr("mvmatch.outputs.has_opencv", lambda is_there=is_there: is_there)
        told = [*dense_warnings(dense, RefineOptions())]
        assert ["mvmatch[refine]" in warning for warning in told] == [True] * (not is_there)
        assert not dense_warnings(dense, RefineOptions(when="never"))
        assert not dense_warnings(aligned, RefineOptions())
        assert not dense_warnings(resting, RefineOptions())
        assert not dense_warnings(match, RefineOptions())


def test_nothing_is_asked_of_pictures_that_cannot_be_had(
    data: Path, match: Match, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive, table = data / "drive.ivf", tmp_path / "motion.parquet"
    assert main(["extract", str(drive), str(table)]) == 0
    broken = dataclasses.replace(match, damage=DataError("the stream ends here"))
    skipped = Skipped(
        after_frame=3, num_errors=1, byte_offset=None, section=None, reason="it is damaged"
    )
    holed = dataclasses.replace(match, skipped=(skipped,))
    small = dataclasses.replace(match, info=dataclasses.replace(match.info, width=208, height=120))
    assert not state(drive, small).refines
    assert not state(drive, broken).refines
    assert not state(drive, holed).refines
    assert not state(table, match).refines
    monkeypatch.setattr("mvmatch.state.has_opencv", lambda: False)
    assert not state(drive, match).refines


def run(data: Path, out: Path, **words: Any) -> Run:
    return reconstruct_video(data / "drive.ivf", out, **words)


def focal_error(made: Run) -> float:
    model = made.model.reconstruction
    assert model is not None
    return abs(model.camera(1).mean_focal_length() / FOCAL - 1.0)


def test_a_run_without_a_camera_finds_the_focal_length(data: Path, tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    made = run(data, tmp_path / "out")
    assert made.match.is_refined
    assert focal_error(made) < 0.02
    assert not any("--refine" in warning for warning in made.data["warnings"])


def test_pictures_that_do_not_fit_leave_the_tracks_as_they_are(
    data: Path, match: Match, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("cv2")

    def other(*_: Any, **__: Any) -> Any:
        yield np.zeros((10, 20), np.uint8)

    monkeypatch.setattr("mvmatch.pictures.gray_pictures", other)
    asked = state(data / "drive.ivf", match)
    stages.load_refined(asked, tmp_path, stages.refine(asked, tmp_path))
    np.testing.assert_array_equal(asked.match.tracks.xy, match.tracks.xy)
    assert not asked.match.is_refined
    assert any("20x10 px" in warning for warning in asked.match.warnings)

    insisting = from_mapping({"refine": {"when": "always"}}, RunOptions())
    with pytest.raises(DataError, match="20x10 px"):
        stages.refine(state(data / "drive.ivf", match, options=insisting), tmp_path)
