"""The verb convert: every target, its words and its faults."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mvmatch.cli import main
from mvmatch.export.model import read_model, write_binary
from mvmatch.export.trajectory import frame_times

pycolmap = pytest.importorskip("pycolmap")

NAMES = [f"frame_{frame:06d}.png" for frame in range(2, 8)]


@pytest.fixture
def stored(make_model, tmp_path):
    """Folder of a model whose first frame is 2."""
    write_binary(make_model(NAMES), tmp_path / "model")
    return tmp_path / "model"


@pytest.fixture
def images(tmp_path):
    folder = tmp_path / "images"
    folder.mkdir()
    picture = np.full((120, 160, 3), (10, 20, 30), np.uint8)
    for name in NAMES:
        assert pycolmap.Bitmap.from_array(picture).write(folder / name)
    return folder


def write_masks(folder):
    folder.mkdir()
    mask = pycolmap.Bitmap.from_array(np.full((120, 160), 255, np.uint8))
    for name in NAMES:
        assert mask.write(folder / f"{name}.png")
    return folder


def converted(capsys, *words) -> dict:
    capsys.readouterr()
    assert main(["convert", *map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("target", ["text", "binary", "nerfstudio", "ply", "tum", "kitti"])
def test_every_target_says_what_it_made(target, stored, tmp_path, capsys):
    out = tmp_path / "out"
    printed = converted(capsys, stored, out, "--to", target)
    assert printed["made"] == [str(out)]
    assert (printed["format"], printed["num_images"], printed["num_points"]) == (target, 6, 40)
    assert out.is_dir() == (target in {"text", "binary", "nerfstudio"})
    assert printed["next"] is None or str(out) in printed["next"]


def test_a_model_is_coloured_in_its_own_place(stored, images, capsys):
    printed = converted(capsys, stored, stored, "--to", "binary", "--images", images)
    assert printed["warnings"] == []
    colors = [point.color.tolist() for point in read_model(stored).points3D.values()]
    assert colors == [[10, 20, 30]] * 40


def test_images_of_another_folder_are_named_in_transforms(stored, images, tmp_path, capsys):
    out = tmp_path / "deep" / "out"
    converted(capsys, stored, out, "--to", "nerfstudio", "--images", images)
    document = json.loads((out / "transforms.json").read_text())
    paths = [out / frame["file_path"] for frame in document["frames"]]
    assert [path.resolve() for path in paths] == [(images / name).resolve() for name in NAMES]


def test_masks_are_named_in_transforms(stored, images, tmp_path, capsys):
    out = tmp_path / "deep" / "out"
    words = [stored, out, "--to", "nerfstudio", "--images", images, "--masks", tmp_path / "masks"]
    write_masks(tmp_path / "masks")
    converted(capsys, *words)
    document = json.loads((out / "transforms.json").read_text())
    paths = [out / frame["mask_path"] for frame in document["frames"]]
    assert [path.resolve().name for path in paths] == [f"{name}.png" for name in NAMES]
    assert all(path.is_file() for path in paths)


def test_masks_of_an_undistorted_workspace_fit_in_nerfstudio(make_model, images, tmp_path, capsys):
    lens = ("SIMPLE_RADIAL", [150.0, 81.0, 59.0, -0.25])
    write_binary(make_model(NAMES, cameras=[lens]), tmp_path / "model")
    masks, flat, out = write_masks(tmp_path / "masks"), tmp_path / "flat", tmp_path / "out"
    words = ["--to", "undistorted", "--images", images, "--masks", masks]
    converted(capsys, tmp_path / "model", flat, *words)
    words = [flat / "sparse" / "0", out, "--to", "nerfstudio", "--images", flat / "images"]
    converted(capsys, *words, "--masks", flat / "masks")
    document = json.loads((out / "transforms.json").read_text())
    assert (document["k1"], document["k2"]) == (0.0, 0.0)
    assert len(document["frames"]) == len(NAMES)
    for frame in document["frames"]:
        picture, mask = (
            pycolmap.Bitmap.read(out / frame[key], as_rgb=False)
            for key in ("file_path", "mask_path")
        )
        assert picture.width == mask.width == document["w"] != 160
        assert picture.height == mask.height == document["h"]
    # Those of the pictures as they were do not.
    assert main([str(word) for word in ["convert", *words, "--masks", masks]]) == 1
    assert "are 160x120 px but the model's are" in capsys.readouterr().err


def test_the_frames_of_a_video_are_written_for_nerfstudio(make_model, data, tmp_path, capsys):
    clip, out = data / "svt_flat_p8.mp4", tmp_path / "out"
    size = pycolmap_size(clip)
    names = ["frame_000000.png", "frame_000002.png", "frame_000005.png"]
    write_binary(make_model(names, size=size), tmp_path / "model")
    converted(capsys, tmp_path / "model", out, "--to", "nerfstudio", "--images", clip)
    document = json.loads((out / "transforms.json").read_text())
    pictures = [pycolmap.Bitmap.read(out / f["file_path"], True) for f in document["frames"]]
    assert [(picture.width, picture.height) for picture in pictures] == [size] * 3
    assert sorted(path.name for path in (out / "images").iterdir()) == names


def test_an_undistorted_workspace_is_made_from_a_video(make_model, data, tmp_path, capsys):
    clip, out = data / "svt_flat_p8.mp4", tmp_path / "out"
    size = width, height = pycolmap_size(clip)
    lens = ("SIMPLE_RADIAL", [0.9 * width, width / 2, height / 2, 0.05])
    names = ["frame_000000.png", "frame_000002.png", "frame_009999.png"]
    write_binary(make_model(names, cameras=[lens], size=size), tmp_path / "model")
    words = [tmp_path / "model", out, "--to", "undistorted", "--images", clip]
    (warning,) = converted(capsys, *words)["warnings"]
    assert "1 pictures are not in" in warning
    made = read_model(out / "sparse" / "0")
    assert [camera.model.name for camera in made.cameras.values()] == ["PINHOLE"]
    assert sorted(path.name for path in (out / "images").iterdir()) == names[:2]
    assert main(["convert", *map(str, words)]) == 1
    assert "is there already" in capsys.readouterr().err


def pycolmap_size(clip) -> tuple[int, int]:
    import av

    with av.open(str(clip)) as container:
        return container.streams.video[0].width, container.streams.video[0].height


def test_points_without_colours_are_announced(stored, tmp_path, capsys):
    (warning,) = converted(capsys, stored, tmp_path / "a.ply", "--to", "ply")["warnings"]
    assert "--images" in warning


def test_tum_takes_times_from_a_video_or_a_rate(stored, data, tmp_path, capsys):
    out, clip = tmp_path / "path.tum", data / "svt_flat_p8.mkv"
    converted(capsys, stored, out, "--to", "tum", "--timestamps", clip)
    np.testing.assert_allclose(np.loadtxt(out)[:, 0], frame_times(clip)[2:8], atol=1e-9)
    converted(capsys, stored, out, "--to", "tum", "--fps", "25")
    np.testing.assert_allclose(np.loadtxt(out)[:, 0], np.arange(2, 8) / 25, atol=1e-9)


def test_kitti_says_which_frame_its_first_line_is(stored, tmp_path, capsys):
    printed = converted(capsys, stored, tmp_path / "poses.txt", "--to", "kitti")
    assert printed["first_frame"] == 2
    assert "first frame with a pose is 2" in printed["warnings"][0]


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["--to", "obj"],
        ["--to", "kitti", "--fps", "25"],
        ["--to", "ply", "--timestamps", __file__],
        ["--to", "tum", "--fps", "25", "--timestamps", __file__],
        ["--to", "tum", "--fps", "0"],
        ["--to", "tum", "--fps", "nan"],
        ["--to", "tum", "--images", "."],
        ["--to", "undistorted"],
        ["--to", "ply", "--masks", "."],
    ],
)
def test_words_that_do_not_fit_are_refused_before_anything_is_read(words, tmp_path, capsys):
    assert main(["convert", str(tmp_path), str(tmp_path / "out"), *words]) == 2
    assert capsys.readouterr().err.startswith("usage: ")


@pytest.mark.parametrize("target", ["text", "binary", "nerfstudio", "ply", "tum", "kitti"])
def test_a_folder_without_a_model_is_two_lines_and_exit_code_1(target, tmp_path, capsys):
    assert main(["convert", str(tmp_path), str(tmp_path / "out"), "--to", target]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith(f"error: {tmp_path} holds no COLMAP model")
    assert len(lines) == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("target", ["text", "binary", "nerfstudio", "ply", "tum", "kitti"])
def test_an_output_that_cannot_be_written_is_exit_code_1(target, stored, tmp_path, capsys):
    (tmp_path / "file").touch()
    assert main(["convert", str(stored), str(tmp_path / "file" / "out"), "--to", target]) == 1
    assert "error: cannot write" in capsys.readouterr().err
