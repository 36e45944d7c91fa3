"""A run without a whole model says where the footage broke: in report, page and last lines."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("pycolmap")

from mvmatch.bench.compose import COMPOSITIONS
from mvmatch.bench.datasets import Sequence, write_frames
from mvmatch.cli import main
from mvmatch.demo import _write_png
from mvmatch.testing import synthetic_drive

if TYPE_CHECKING:
    from pathlib import Path

    from _pytest.capture import CaptureFixture

SIZE = (320, 180)
SHOT = 14
"""Frames of a drive."""


class Rendered:
    """Frames of a synthetic scene."""

    def __init__(self, scene: Any) -> None:
        self.scene = scene

    def __len__(self) -> int:
        return self.scene.num_frames

    def read(self, index: int) -> Any:
        return self.scene.render(index)[:, :, ::-1]


def examined(source: Path, out: Path, *words: str) -> dict[str, Any]:
    """Run, and return the model's part of the report."""
    code = main(["run", str(source), "-o", str(out), *words])
    model = json.loads((out / "report.json").read_text())["model"]
    assert code == (model["status"] != "complete")
    assert (model["status"] == "complete") == (model["findings"] == [])
    page = (out / "report.html").read_text()
    assert ("What stands in the way" in page) == (model["findings"] != [])
    return model


def codes(model: dict[str, Any]) -> list[str]:
    return [found["code"] for found in model["findings"]]


def test_a_scene_cut_leaves_a_model_of_one_shot_and_says_so_last(
    tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    images = tmp_path / "images"
    images.mkdir()
    for shot, seed in enumerate((0, 11)):
        scene = synthetic_drive(SHOT, SIZE, seed=seed)
        for index in range(SHOT):
            _write_png(images / f"{SHOT * shot + index:03d}.png", scene.render(index))
    K = scene.K
    camera = f"PINHOLE,{K[0, 0]},{K[1, 1]},{K[0, 2]},{K[1, 2]}"
    # Both scenes have the same ground: descriptors would find it again.
    model = examined(images, tmp_path / "out", "--camera", camera, "--bridge", "none")
    assert model["status"] == "partial"
    assert codes(model) == ["scene-cut", "other-model"]
    assert model["findings"][0]["frames"] == [[SHOT, SHOT]]
    assert model["findings"][1]["frames"] in ([[0, SHOT - 1]], [[SHOT, 2 * SHOT - 1]])
    printed = capsys.readouterr().err.splitlines()
    assert printed[-4].startswith(f"found: The scene changes before picture {SHOT}")
    assert printed[-2].startswith("found: The pictures ")
    assert printed[-2].endswith("are in a model of their own, number 1.")


def test_a_pan_is_named_as_a_turn_without_parallax(tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    import pycolmap

    scene = synthetic_drive(24, (480, 270))
    params = scene.K[[0, 1, 0, 1], [0, 1, 2, 2]]
    base = Sequence(
        name="drive",
        frames=Rendered(scene),
        camera=pycolmap.Camera(model="PINHOLE", width=480, height=270, params=params),
        cam_from_world=scene.cam_from_world,
        truth=None,
    )
    pan = COMPOSITIONS["pan"](base)
    write_frames(pan, tmp_path / "images")
    camera = ",".join(["PINHOLE", *map(str, pan.camera.params)])
    model = examined(tmp_path / "images", tmp_path / "out", "--camera", camera)
    assert model["status"] == "failed"
    assert codes(model) == ["rotation"]
    ((first, last),) = model["findings"][0]["frames"]
    assert first <= 2
    assert last >= 21


def test_a_camera_at_rest_is_named(data: Path, tmp_path: Path) -> None:
    model = examined(data / "svt_still_camera.ivf", tmp_path)
    assert model["status"] == "failed"
    assert codes(model) == ["static"]
    assert model["findings"][0]["frames"] == [[0, 9]]


def test_damage_is_found_where_the_pictures_end(data: Path, tmp_path: Path) -> None:
    clip, out = tmp_path / "clip.ivf", tmp_path / "out"
    clip.write_bytes((data / "drive.ivf").read_bytes()[:-3000])
    model = examined(clip, out, "--camera", "PINHOLE,260.48,260.48,176,100")
    assert model["status"] == "partial"
    assert codes(model) == ["damage"]
    assert model["findings"][0]["frames"] == [[model["total"], model["total"]]]
    assert model["total"] < 20


def test_a_whole_model_has_nothing_to_say(data: Path, tmp_path: Path) -> None:
    camera = "PINHOLE,260.48,260.48,176,100"
    model = examined(data / "drive.ivf", tmp_path, "--camera", camera)
    assert (model["status"], model["findings"]) == ("complete", [])
