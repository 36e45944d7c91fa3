"""COLMAP models in and out: text and binary read by COLMAP, points read by plyfile."""

import shutil

import numpy as np
import pytest

from mvmatch.errors import DataError
from mvmatch.export.model import frame_number, read_model, write_binary, write_text
from mvmatch.export.points import write_ply

pycolmap = pytest.importorskip("pycolmap")


def assert_equal_models(found, expected):
    assert sorted(found.cameras) == sorted(expected.cameras)
    for number, camera in expected.cameras.items():
        assert found.camera(number).model == camera.model
        np.testing.assert_array_equal(found.camera(number).params, camera.params)
    assert sorted(found.reg_image_ids()) == sorted(expected.reg_image_ids())
    for number in expected.reg_image_ids():
        image, other = found.image(number), expected.image(number)
        assert image.name == other.name
        pose, true = image.cam_from_world().matrix(), other.cam_from_world().matrix()
        np.testing.assert_allclose(pose, true, atol=1e-14)
        xy = [[point.xy for point in one.points2D] for one in (image, other)]
        np.testing.assert_allclose(*xy, rtol=1e-15)
    assert found.point3D_ids() == expected.point3D_ids()
    for number in expected.point3D_ids():
        point, other = found.point3D(number), expected.point3D(number)
        np.testing.assert_allclose(point.xyz, other.xyz, rtol=1e-15)
        np.testing.assert_array_equal(point.color, other.color)
        assert point.track.length() == other.track.length()


@pytest.mark.parametrize("write", [write_text, write_binary])
def test_colmap_reads_the_same_model_back(write, make_model, tmp_path):
    model = make_model()
    model.point3D(min(model.point3D_ids())).color = np.array([1, 20, 255], np.uint8)
    write(model, tmp_path / "deep" / "model")

    assert_equal_models(pycolmap.Reconstruction(tmp_path / "deep" / "model"), model)
    assert_equal_models(read_model(tmp_path / "deep" / "model"), model)
    assert {path.suffix for path in (tmp_path / "deep" / "model").iterdir()} == {
        ".txt" if write is write_text else ".bin"
    }


def test_a_binary_model_is_replaced_and_never_shadows_a_text_one(make_model, tmp_path):
    write_binary(make_model(), tmp_path)
    other = make_model(["0.png", "1.png", "2.png"])
    with pytest.raises(DataError, match="binary model, which COLMAP reads in the place of text"):
        write_text(other, tmp_path)
    write_binary(other, tmp_path)
    assert_equal_models(read_model(tmp_path), other)


@pytest.mark.parametrize("write", [write_text, write_binary])
def test_models_from_before_rigs_and_frames_are_read(write, make_model, tmp_path):
    write(make_model(), tmp_path)
    for path in [*tmp_path.glob("rigs.*"), *tmp_path.glob("frames.*")]:
        path.unlink()
    assert_equal_models(read_model(tmp_path), make_model())


def test_the_last_number_of_a_name_is_the_frame():
    names = ["frame_000012.png", "cam2/7.jpg", "cam0_000003.0.png", "left.png", "12/a.png"]
    assert [frame_number(name) for name in names] == [12, 7, 0, None, None]


@pytest.mark.parametrize("inside", ["0", "sparse/0"])
def test_a_folder_above_the_model_is_refused_with_the_right_one(inside, make_model, tmp_path):
    write_binary(make_model(), tmp_path / inside)
    with pytest.raises(DataError, match=rf"no COLMAP model.* Did you mean .*{inside}\?"):
        read_model(tmp_path)


def test_a_folder_with_half_a_model_is_refused(make_model, tmp_path):
    write_binary(make_model(), tmp_path)
    (tmp_path / "points3D.bin").unlink()
    with pytest.raises(DataError, match="holds no COLMAP model"):
        read_model(tmp_path)


def test_a_file_is_no_model(tmp_path):
    (tmp_path / "model").touch()
    with pytest.raises(DataError, match="holds no COLMAP model"):
        read_model(tmp_path / "model")


@pytest.mark.parametrize("name", ["cameras", "images", "points3D", "rigs", "frames"])
def test_a_cut_file_is_refused(name, make_model, tmp_path):
    write_binary(make_model(), tmp_path / "whole")
    whole = (tmp_path / "whole" / f"{name}.bin").read_bytes()
    # COLMAP reads a camera or rig of which a few bytes are missing.
    step = 97 if len(whole) > 500 else 5
    for length in range(0, len(whole) - 8, step):
        shutil.copytree(tmp_path / "whole", tmp_path / "cut", dirs_exist_ok=True)
        (tmp_path / "cut" / f"{name}.bin").write_bytes(whole[:length])
        with pytest.raises(DataError, match=r"cut|not a whole COLMAP model|is empty"):
            read_model(tmp_path / "cut")


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
def test_text_that_is_no_model_is_refused(name, make_model, tmp_path):
    write_text(make_model(), tmp_path)
    (tmp_path / f"{name}.txt").write_text("1 hello world\n")
    with pytest.raises(DataError, match="not a whole COLMAP model"):
        read_model(tmp_path)


def test_an_empty_model_is_refused(tmp_path):
    write_binary(pycolmap.Reconstruction(), tmp_path)
    with pytest.raises(DataError, match="is empty: no image has a pose"):
        read_model(tmp_path)


def test_a_pose_that_is_not_finite_is_refused(make_model, tmp_path):
    model = make_model()
    model.frame(2).set_cam_from_world(
        1, pycolmap.Rigid3d(pycolmap.Rotation3d(), np.full(3, np.nan))
    )
    write_binary(model, tmp_path)
    with pytest.raises(DataError, match="not finite"):
        read_model(tmp_path)


def test_ply_holds_colour_error_and_track_length_of_every_point(make_model, tmp_path):
    plyfile = pytest.importorskip("plyfile", reason="needs plyfile, a reader of PLY")
    model = make_model()
    for number in model.point3D_ids():
        model.point3D(number).color = np.array([number, 2 * number, 255 - number], np.uint8)
        model.point3D(number).error = number / 8
    write_ply(model, tmp_path / "points.ply")

    vertices = plyfile.PlyData.read(tmp_path / "points.ply")["vertex"]
    points = [model.point3D(number) for number in sorted(model.point3D_ids())]
    assert len(vertices) == len(points)
    for vertex, point in zip(vertices, points, strict=True):
        np.testing.assert_array_equal([vertex[k] for k in "xyz"], point.xyz.astype(np.float32))
        colour = [vertex[k] for k in ("red", "green", "blue")]
        np.testing.assert_array_equal(colour, point.color)
        assert (vertex["error"], vertex["track_length"]) == (point.error, point.track.length())


def test_colmap_reads_the_points_too(make_model, tmp_path):
    model = make_model()
    for number in model.point3D_ids():
        model.point3D(number).color = np.array([number, 0, 9], np.uint8)
    write_ply(model, tmp_path / "points.ply")

    found = pycolmap.Reconstruction()
    found.import_PLY(tmp_path / "points.ply")
    assert found.num_points3D() == model.num_points3D()
    for number in model.point3D_ids():
        np.testing.assert_allclose(found.point3D(number).xyz, model.point3D(number).xyz, rtol=1e-6)
        np.testing.assert_array_equal(found.point3D(number).color, model.point3D(number).color)


def test_a_model_without_points_gives_no_ply(make_model, tmp_path):
    with pytest.raises(DataError, match="has no points"):
        write_ply(make_model(num_points=0), tmp_path / "points.ply")


@pytest.mark.parametrize("write", [write_text, write_binary, write_ply])
def test_a_place_that_cannot_be_written_is_refused(write, make_model, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(DataError, match=r"cannot write .*Choose another place"):
        write(make_model(), tmp_path / "file" / "out")
    (tmp_path / "folder").mkdir()
    if write is write_ply:
        with pytest.raises(DataError, match="cannot write"):
            write(make_model(), tmp_path / "folder")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]
