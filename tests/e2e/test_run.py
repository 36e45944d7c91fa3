"""From a stream to results."""

from __future__ import annotations

import dataclasses
import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pycolmap
import pytest

from mvmatch import pipeline
from mvmatch.cli import main
from mvmatch.demo import _write_png
from mvmatch.errors import DataError
from mvmatch.geometry.trajectory import trajectory_error
from mvmatch.matching import match_video
from mvmatch.pipeline import reconstruct_video
from mvmatch.sources import open_video
from mvmatch.store import StoredMotion
from mvmatch.testing import check_source, synthetic_drive

if TYPE_CHECKING:
    from pathlib import Path

    from _pytest.capture import CaptureFixture

    from mvmatch.stages import Stage
    from mvmatch.state import State

DRIVE_CAMERA = "PINHOLE,260.48,260.48,176,100"
"""Of drive.ivf: 0.74 times the width (mvmatch.testing.synthetic_drive)."""

CONTAINERS = ("mp4", "mkv", "webm", "obu", "annexb")


@pytest.mark.parametrize("suffix", CONTAINERS)
def test_tracks_do_not_depend_on_the_container(suffix: str, data: Path) -> None:
    expected = match_video(data / "svt_flat_p8.ivf").tracks
    found = match_video(data / f"svt_flat_p8.{suffix}").tracks
    assert len(expected) > 0
    np.testing.assert_array_equal(found.offsets, expected.offsets)
    np.testing.assert_array_equal(found.frame, expected.frame)
    np.testing.assert_array_equal(found.xy, expected.xy)


def test_a_stored_table_gives_the_same_tracks_as_its_video(data: Path, tmp_path: Path) -> None:
    table = tmp_path / "motion.parquet"
    assert main(["extract", str(data / "svt_random_access_p6.ivf"), str(table)]) == 0
    expected = match_video(data / "svt_random_access_p6.ivf").tracks
    found = match_video(table).tracks
    np.testing.assert_array_equal(found.xy, expected.xy)


@pytest.mark.parametrize("name", ["svt_flat_p8.mp4", "svt_random_access_p6.ivf"])
def test_videos_keep_the_contract_of_motion_sources(name: str, data: Path) -> None:
    with open_video(data / name) as source:
        check_source(source)


def test_stored_motion_keeps_the_contract_of_motion_sources(data: Path, tmp_path: Path) -> None:
    table = tmp_path / "motion.parquet"
    assert main(["extract", str(data / "svt_flat_p8.ivf"), str(table)]) == 0
    with StoredMotion(table) as source:
        check_source(source)


def test_times_of_frames_come_from_the_container(data: Path) -> None:
    with open_video(data / "svt_flat_p8.mkv") as source:
        times = [field.pts for field in source]
    assert times[0] == 0.0
    assert times == sorted(set(times))


def test_the_verbs_hand_over_to_each_other(
    data: Path, tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    motion, tracks = tmp_path / "motion.parquet", tmp_path / "tracks.parquet"
    database = tmp_path / "database.db"
    for words in (
        ["extract", str(data / "drive.ivf"), str(motion)],
        ["track", str(motion), str(tracks)],
        ["export", str(tracks), str(database), "--camera", "300"],
        ["score", str(database)],
    ):
        capsys.readouterr()
        assert main([*words, "--json"]) == 0
        printed = json.loads(capsys.readouterr().out)
        assert printed["next"].startswith("mvmatch ")
    assert len(printed["scores"]) > 0


def test_nothing_but_mvmatch_writes_to_standard_error(
    data: Path, tmp_path: Path, capfd: CaptureFixture[str]
) -> None:
    words = ["run", str(data / "drive.ivf"), "-o", str(tmp_path), "--camera", DRIVE_CAMERA]
    assert main(words) == 0
    lines = capfd.readouterr().err.splitlines()
    assert [line for line in lines if not line.endswith(" ...")] == []


def test_a_run_leaves_its_results_and_nothing_else(data: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["run", str(data / "drive.ivf"), "-o", str(out), "--camera", DRIVE_CAMERA]) == 0
    names = {entry.name for entry in out.iterdir() if entry.name != ".work"}
    report = json.loads((out / "report.json").read_text())
    assert names == {"sparse", "database.db", "tracks.parquet", "report.json", "report.html"}
    assert report["model"]["registered"] == report["input"]["num_frames"] == 20
    assert [stage["name"] for stage in report["stages"]] == [
        "match",
        "find movers",
        "verify and write database",
        "map",
    ]


def test_masks_are_written_for_every_picture_on_request(data: Path, tmp_path: Path) -> None:
    words = ["run", str(data / "drive.ivf"), "-o", str(tmp_path), "--camera", DRIVE_CAMERA]
    assert main([*words, "--masks"]) == 0
    report = json.loads((tmp_path / "report.json").read_text())
    names = [f"frame_{frame:06d}.png.png" for frame in range(report["input"]["num_frames"])]
    assert sorted(path.name for path in (tmp_path / "masks").iterdir()) == names
    assert report["movers"]["num_tracks"] < 0.02 * report["matches"]["num_tracks"]
    assert report["footage"]["cuts"] == report["footage"]["repeats"] == []
    assert main(words) == 0
    assert not (tmp_path / "masks").exists()


def test_a_workspace_for_splatting_is_made_on_request(
    data: Path, tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    words = ["run", str(data / "drive.ivf"), "-o", str(tmp_path), "--undistort"]
    assert main([*words, "--camera", "SIMPLE_RADIAL,260.48,176,100,-0.02"]) == 0
    workspace = tmp_path / "undistorted"
    assert str(workspace) in capsys.readouterr().out
    made = pycolmap.Reconstruction(workspace / "sparse" / "0")
    model = pycolmap.Reconstruction(tmp_path / "sparse" / "0")
    assert [camera.model.name for camera in made.cameras.values()] == ["PINHOLE"]
    assert [camera.model.name for camera in model.cameras.values()] == ["SIMPLE_RADIAL"]
    names = sorted(path.name for path in (workspace / "images").iterdir())
    assert names == sorted(image.name for image in made.images.values())
    assert made.num_points3D() == model.num_points3D()
    assert np.mean([point.color.any() for point in made.points3D.values()]) > 0.99
    assert not (workspace / "masks").exists()
    assert main([*words, "--masks", "--camera", "SIMPLE_RADIAL,260.48,176,100,-0.02"]) == 0
    masks = sorted(path.name for path in (workspace / "masks").iterdir())
    assert masks == [f"{name}.png" for name in names]
    words.remove("--undistort")
    assert main([*words, "--camera", "SIMPLE_RADIAL,260.48,176,100,-0.02"]) == 0
    assert not workspace.exists()


def test_a_motion_table_has_no_pictures_to_undistort(
    data: Path, tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    table, out = tmp_path / "motion.parquet", tmp_path / "out"
    assert main(["extract", str(data / "drive.ivf"), str(table)]) == 0
    assert main(["run", str(table), "-o", str(out), "--undistort"]) == 1
    assert "holds no pictures to undistort" in capsys.readouterr().err
    assert not out.exists()


def test_a_long_video_has_a_pose_for_every_frame_though_few_are_mapped(
    data: Path, tmp_path: Path
) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    words = ["run", str(data / "drive.ivf"), "--camera", DRIVE_CAMERA, "--preset", "dense"]
    centers = []
    for most in (10, 60):
        out = tmp_path / str(most)
        long = ["--set", f"mapper.keyframes.max_images={most}"]
        assert main([*words, *long, "-o", str(out)]) == 0
        found = json.loads((out / "report.json").read_text())["model"]
        assert found["registered"] == found["total"] == 20
        assert found["unregistered"] == []
        assert (found["num_keyframes"] < 12) == (most < 20)
        assert found["dense"]["num_added"] > 0
        model = pycolmap.Reconstruction(out / "sparse" / "0")
        centers.append([model.image(f + 1).projection_center() for f in range(20)])
    assert trajectory_error(*centers).percent_of_path < 0.1


def test_a_dense_run_has_the_poses_of_a_default_run_and_many_more_points(
    data: Path, tmp_path: Path
) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    words = ["run", str(data / "drive.ivf"), "--camera", DRIVE_CAMERA]
    models = {}
    for preset in ("default", "dense"):
        out = tmp_path / preset
        assert main([*words, "--preset", preset, "-o", str(out)]) == 0
        models[preset] = pycolmap.Reconstruction(out / "sparse" / "0")
    report = json.loads((tmp_path / "dense" / "report.json").read_text())
    dense = report["model"]["dense"]
    assert report["model"]["num_points"] == models["default"].num_points3D()
    assert dense["num_points"] == models["dense"].num_points3D()
    assert dense["num_points"] > 3 * report["model"]["num_points"]
    for image_id in models["default"].reg_image_ids():
        poses = [each.image(image_id).cam_from_world().matrix() for each in models.values()]
        np.testing.assert_array_equal(*poses)


def test_a_camera_that_nobody_can_read_is_refused_before_anything_is_done(
    data: Path, tmp_path: Path
) -> None:
    stages: list[str] = []
    with pytest.raises(DataError, match="nonsense"):
        reconstruct_video(
            data / "drive.ivf",
            tmp_path / "out",
            camera="nonsense",
            progress=lambda stage, _done, _total: stages.append(stage),
        )
    assert stages == []


def gapped_images(folder: Path) -> str:
    """Write a drive whose middle is missing; return its camera."""
    folder.mkdir()
    scene = synthetic_drive(28, (320, 180))
    for index, frame in enumerate([*range(10), *range(18, 28)]):
        _write_png(folder / f"{index:03d}.png", scene.render(frame))
    K = scene.K
    return f"PINHOLE,{K[0, 0]},{K[1, 1]},{K[0, 2]},{K[1, 2]}"


def test_a_picture_that_is_lost_before_a_gap_is_bridged_does_not_end_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    images = tmp_path / "images"
    camera = gapped_images(images)

    def lost(stage: Stage) -> Stage:
        def make(state: State, folder: Path) -> dict[str, Any]:
            (images / "010.png").write_bytes(b"no picture")
            return stage.make(state, folder)

        return dataclasses.replace(stage, make=make) if stage.name == "bridge" else stage

    monkeypatch.setattr(pipeline, "STAGES", tuple(map(lost, pipeline.STAGES)))
    run = reconstruct_video(images, tmp_path / "out", camera=camera)
    assert run.data["gaps"] == {"after": [9], "bridged": []}
    (warning,) = [text for text in run.data["warnings"] if "010.png" in text]
    assert "1 gaps between pictures that were not bridged" in warning
    assert (tmp_path / "out" / "report.html").exists()


def test_a_gap_is_bridged_and_the_bridge_is_kept(tmp_path: Path) -> None:
    images = tmp_path / "images"
    camera = gapped_images(images)
    run, again = (reconstruct_video(images, tmp_path / "out", camera=camera) for _ in range(2))
    assert run.data["gaps"] == {"after": [9], "bridged": [9]}
    assert (run.model.accepted, run.model.registered) == (True, 20)
    assert "bridge gaps" in again.reused
    assert again.data["gaps"] == run.data["gaps"]
    assert np.array_equal(again.match.tracks.xy, run.match.tracks.xy)
