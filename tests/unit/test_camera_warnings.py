"""What a run says of its camera."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pycolmap

from mvmatch.camera import CameraChoice
from mvmatch.outputs import camera_warnings


def choice(*, is_prior: bool = False) -> CameraChoice:
    camera = pycolmap.Camera(model="PINHOLE", width=640, height=480, params=[500, 500, 320, 240])
    return CameraChoice(camera=camera, source="camera file camera.txt", is_prior=is_prior)


def model_with(focal: float) -> Any:
    camera = pycolmap.Camera(
        model="PINHOLE", width=640, height=480, params=[focal, focal, 320, 240]
    )
    return SimpleNamespace(reconstruction=SimpleNamespace(cameras={1: camera}))


def test_a_corrected_focal_length_is_told_with_both_values_and_the_way_back():
    (warning,) = camera_warnings(choice(), model_with(490.0))
    assert "500.0 px" in warning
    assert "490.0 px (-2.0%)" in warning
    assert "mapper.intrinsics=fixed" in warning


def test_a_camera_that_was_kept_needs_no_word():
    assert camera_warnings(choice(), model_with(500.0)) == []
    assert camera_warnings(choice(), SimpleNamespace(reconstruction=None)) == []


def test_a_prior_is_called_a_prior(monkeypatch):
    def warning(**words: bool) -> str:
        (told,) = camera_warnings(choice(is_prior=True), model_with(490.0), **words)
        assert told.startswith("The camera is a guess (")
        return told

    for is_there, means in ((True, "--refine"), (False, "mvmatch[refine]")):
        monkeypatch.setattr("mvmatch.outputs.has_opencv", lambda there=is_there: there)
        assert means in warning()
        assert means not in warning(is_refined=True)


def test_a_prior_that_the_video_could_not_better_is_said_to_be_kept():
    (kept,) = camera_warnings(choice(is_prior=True), model_with(500.0))
    (bettered,) = camera_warnings(choice(is_prior=True), model_with(490.0))
    assert "which the model keeps" in kept
    assert "keeps" not in bettered


def test_what_was_done_to_a_camera_is_said_whatever_becomes_of_the_model():
    scaled = replace(choice(), warnings=("It was scaled.",))
    for model in (model_with(500.0), SimpleNamespace(reconstruction=None)):
        assert camera_warnings(scaled, model) == ["It was scaled."]
    assert camera_warnings(scaled, model_with(490.0))[0] == "It was scaled."
    assert camera_warnings(replace(scaled, is_prior=True), model_with(490.0))[0] == "It was scaled."
