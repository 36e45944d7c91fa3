"""Every part of a video that holds is delivered as a whole is: with all its points, and no longer
than the run that made it is the last one."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("pycolmap")

import pycolmap

from mvmatch.cli import main
from mvmatch.demo import _write_png
from mvmatch.geometry.trajectory import trajectory_error
from mvmatch.testing import synthetic_drive

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from _pytest.capture import CaptureFixture

SIZE = (320, 180)
SHOTS = [synthetic_drive(14, SIZE, seed=0), synthetic_drive(10, SIZE, seed=11)]
FIRST = [0, 14]
"""Pictures."""
CUT = ["--bridge", "none"]
"""Both scenes have the same ground: descriptors would find it again."""


def run(folder: Path, *words: str) -> None:
    K = SHOTS[0].K
    camera = f"PINHOLE,{K[0, 0]},{K[1, 1]},{K[0, 2]},{K[1, 2]}"
    words = ("--camera", camera, *CUT, "--preset", "dense", *words)
    assert main(["run", str(folder / "images"), "-o", str(folder / "out"), *words]) == 1


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a video of two shots and of the run on it."""
    folder = tmp_path_factory.mktemp("parts")
    (folder / "images").mkdir()
    for first, shot in zip(FIRST, SHOTS, strict=True):
        for index in range(shot.num_frames):
            _write_png(folder / "images" / f"{first + index:03d}.png", shot.render(index))
    run(folder)
    return folder


def models(folder: Path) -> Iterator[pycolmap.Reconstruction]:
    for number in "01":
        yield pycolmap.Reconstruction(folder / number)


def test_every_part_gets_the_further_points_and_keeps_its_poses(made: Path) -> None:
    before = models(made / "out" / ".work" / "map" / "sparse")
    for first, shot, sparse, dense in zip(
        FIRST, SHOTS, before, models(made / "out" / "sparse"), strict=True
    ):
        ids = list(range(first + 1, first + 1 + shot.num_frames))
        assert sorted(sparse.reg_image_ids()) == sorted(dense.reg_image_ids()) == ids
        assert dense.num_points3D() > 5 * sparse.num_points3D()
        for image_id in ids:
            poses = [each.image(image_id).cam_from_world().matrix() for each in (sparse, dense)]
            np.testing.assert_array_equal(*poses)
        centers = np.array([dense.image(image_id).projection_center() for image_id in ids])
        assert trajectory_error(centers, shot.centers).percent_of_path < 1


def test_points_of_a_part_are_seen_by_its_images_alone_and_where_they_are(made: Path) -> None:
    for model in models(made / "out" / "sparse"):
        inside = set(model.reg_image_ids())
        errors = []
        for point in model.points3D.values():
            assert point.track.length() >= 2
            for element in point.track.elements:
                assert element.image_id in inside
                image = model.image(element.image_id)
                seen = image.project_point(point.xyz)
                assert seen is not None
                errors.append(np.linalg.norm(seen - image.point2D(element.point2D_idx).xy))
        assert np.median(errors) < 0.3
        assert np.quantile(errors, 0.99) < 1.0


def test_the_cloud_of_each_part_lies_on_its_own_scene(made: Path) -> None:
    for first, shot, model in zip(FIRST, SHOTS, models(made / "out" / "sparse"), strict=True):
        ids = list(range(first + 1, first + 1 + shot.num_frames))
        found = np.array([model.image(image_id).projection_center() for image_id in ids])
        # Depths of the model in the scale of the scene, against those of what is rendered.
        scale = np.linalg.norm(shot.centers[-1] - shot.centers[0]) / np.linalg.norm(
            found[-1] - found[0]
        )
        middle = shot.num_frames // 2
        image, pose = model.image(ids[middle]), shot.cam_from_world[middle]
        seen = list(image.get_observation_points2D())
        points = np.array([model.point3D(each.point3D_id).xyz for each in seen])
        depth = (image.cam_from_world() * points)[:, 2] * scale
        _, surface = shot.surface(middle, np.array([each.xy for each in seen]))
        ratios = depth / (surface @ pose[2, :3] + pose[2, 3])
        assert len(ratios) > 500
        assert abs(np.nanmedian(ratios) - 1) < 0.02
        assert np.mean(np.abs(ratios - 1) < 0.1) > 0.85


def test_a_part_that_the_last_run_did_not_make_is_not_there_any_more(
    made: Path, tmp_path: Path
) -> None:
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    run(tmp_path, "--set", "mapper.acceptance.min_part=0.6")
    assert [path.name for path in (tmp_path / "out" / "sparse").iterdir()] == ["0"]
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["model"]["further"] == []


def test_a_model_that_somebody_put_among_the_parts_is_not_replaced(
    made: Path, tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    shutil.copytree(made / "out", tmp_path / "out")
    shutil.copytree(made / "images", tmp_path / "images")
    theirs = tmp_path / "out" / "sparse" / "2"
    shutil.copytree(tmp_path / "out" / "sparse" / "1", theirs)
    run(tmp_path, "--set", "mapper.acceptance.min_part=0.6")
    assert "holds sparse/2 that no run of mvmatch made" in capsys.readouterr().err
    assert pycolmap.Reconstruction(theirs).num_reg_images() == 10
