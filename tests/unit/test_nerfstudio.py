"""transforms.json by the rules of its reader: cameras look along -z, lenses are OpenCV's."""

import json
from pathlib import Path

import numpy as np
import pytest

from mvmatch.camera import parse_camera
from mvmatch.errors import DataError
from mvmatch.export.nerfstudio import write_nerfstudio

pycolmap = pytest.importorskip("pycolmap")

CAMERAS = [
    ("SIMPLE_PINHOLE", [150.0, 81.0, 59.0]),
    ("PINHOLE", [150.0, 148.0, 81.0, 59.0]),
    ("SIMPLE_RADIAL", [150.0, 81.0, 59.0, -0.1]),
    ("RADIAL", [150.0, 81.0, 59.0, -0.1, 0.03]),
    ("OPENCV", [150.0, 148.0, 81.0, 59.0, -0.1, 0.03, 0.004, -0.002]),
    ("FULL_OPENCV", [150.0, 148.0, 81.0, 59.0, -0.1, 0.03, 0.004, -0.002, 0.01, 0, 0, 0]),
    ("SIMPLE_FISHEYE", [150.0, 81.0, 59.0]),
    ("FISHEYE", [150.0, 148.0, 81.0, 59.0]),
    ("SIMPLE_RADIAL_FISHEYE", [150.0, 81.0, 59.0, 0.05]),
    ("RADIAL_FISHEYE", [150.0, 81.0, 59.0, 0.05, -0.02]),
    ("OPENCV_FISHEYE", [150.0, 148.0, 81.0, 59.0, 0.05, -0.02, 0.01, -0.003]),
]


def write_mask(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert pycolmap.Bitmap.from_array(np.full((120, 160), 255, np.uint8)).write(path)


def project(document: dict, frame: dict, points: np.ndarray) -> np.ndarray:
    """(N, 2) px of points (N, 3) of the world, as nerfstudio sees them."""
    cv2 = pytest.importorskip("cv2")
    values = {**document, **frame}
    opengl = np.linalg.inv(values["transform_matrix"])
    seen = (opengl[:3, :3] @ points.T + opengl[:3, 3:]).T
    assert (seen[:, 2] < 0).all(), "what a camera sees has negative z"
    K = np.array([[values["fl_x"], 0, values["cx"]], [0, values["fl_y"], values["cy"]], [0, 0, 1]])
    inputs = (seen * [1, -1, -1])[:, None], np.zeros(3), np.zeros(3), K
    if document["camera_model"] == "OPENCV_FISHEYE":
        lens = np.array([values[key] for key in ("k1", "k2", "k3", "k4")])
        return cv2.fisheye.projectPoints(*inputs, lens)[0][:, 0]
    lens = np.array([values[key] for key in ("k1", "k2", "p1", "p2", "k3")])
    return cv2.projectPoints(*inputs, lens)[0][:, 0]


@pytest.mark.parametrize("camera", CAMERAS, ids=[kind for kind, _ in CAMERAS])
def test_points_are_where_colmap_sees_them(camera, make_model, tmp_path):
    model = make_model(cameras=[camera])
    document = json.loads(write_nerfstudio(model, tmp_path / "out").read_text())

    points = np.array([point.xyz for point in model.points3D.values()])
    assert (document["w"], document["h"]) == (160, 120)
    for frame in document["frames"]:
        image = model.find_image_with_name(Path(frame["file_path"]).name)
        expected = image.camera.img_from_cam(image.cam_from_world() * points)
        np.testing.assert_allclose(project(document, frame, points), expected, atol=1e-6)


@pytest.mark.parametrize("camera", CAMERAS, ids=[kind for kind, _ in CAMERAS])
def test_the_camera_can_be_given_to_another_run(camera, make_model, tmp_path):
    model = make_model(cameras=[camera])
    read = parse_camera(str(write_nerfstudio(model, tmp_path)), 160, 120).camera
    seen = np.array([[0.1, 0.2, 1.0], [-0.4, 0.1, 1.2], [0.3, -0.3, 0.9]])
    np.testing.assert_allclose(
        read.img_from_cam(seen), model.camera(1).img_from_cam(seen), atol=1e-9
    )


def test_two_cameras_keep_their_own_intrinsics(make_model, tmp_path):
    model = make_model(cameras=[CAMERAS[1], CAMERAS[4]])
    document = json.loads(write_nerfstudio(model, tmp_path).read_text())

    assert not {"fl_x", "w", "k1"} & set(document), "nerfstudio would take these for all frames"
    points = np.array([point.xyz for point in model.points3D.values()])
    for frame in document["frames"]:
        image = model.find_image_with_name(Path(frame["file_path"]).name)
        expected = image.camera.img_from_cam(image.cam_from_world() * points)
        np.testing.assert_allclose(project(document, frame, points), expected, atol=1e-6)


def test_frames_are_sorted_and_their_paths_lead_to_the_images(make_model, tmp_path):
    model = make_model(["b/2.png", "b/1.png", "a/3.png"])
    images, out = tmp_path / "my images", tmp_path / "deep" / "out"
    for name in ("b/2.png", "b/1.png", "a/3.png"):
        (images / name).parent.mkdir(parents=True, exist_ok=True)
        (images / name).touch()
    document = json.loads(write_nerfstudio(model, out, images=images).read_text())

    paths = [frame["file_path"] for frame in document["frames"]]
    assert paths == sorted(paths)
    assert all((out / path).is_file() for path in paths)
    assert not any("\\" in path for path in paths)


def test_images_are_expected_beside_the_file_where_nothing_is_said(make_model, tmp_path):
    document = json.loads(write_nerfstudio(make_model(), tmp_path).read_text())
    assert document["frames"][0]["file_path"] == "images/frame_000000.png"


def test_masks_are_found_from_the_file_and_belong_to_their_images(make_model, tmp_path):
    model = make_model(["b/2.png", "a/1.jpg"])
    masks, out = tmp_path / "masks", tmp_path / "deep" / "out"
    for name in ("b/2.png.png", "a/1.jpg.png"):
        write_mask(masks / name)
    document = json.loads(write_nerfstudio(model, out, masks=masks).read_text())
    for frame in document["frames"]:
        name = frame["file_path"].removeprefix("images/")
        assert frame["mask_path"] == f"../../masks/{name}.png"
        assert (out / frame["mask_path"]).is_file()


def test_an_image_without_a_mask_is_refused_since_nerfstudio_takes_all_or_none(
    make_model, tmp_path
):
    write_mask(tmp_path / "frame_000000.png.png")
    with pytest.raises(DataError, match=r"no mask .*frame_000001\.png\.png"):
        write_nerfstudio(make_model(), tmp_path / "out", masks=tmp_path)
    assert not (tmp_path / "out").exists()


def test_without_masks_none_is_named(make_model, tmp_path):
    document = json.loads(write_nerfstudio(make_model(), tmp_path).read_text())
    assert not any("mask_path" in frame for frame in document["frames"])


def test_the_points_for_splatting_lie_in_the_world_of_the_poses(make_model, tmp_path):
    plyfile = pytest.importorskip("plyfile", reason="needs plyfile, a reader of PLY")
    model = make_model()
    document = json.loads(write_nerfstudio(model, tmp_path).read_text())
    assert "applied_transform" not in document
    vertices = plyfile.PlyData.read(tmp_path / document["ply_file_path"])["vertex"]
    expected = [model.point3D(number).xyz for number in sorted(model.point3D_ids())]
    found = np.column_stack([vertices[axis] for axis in "xyz"])
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_model_without_points_names_no_file_of_points(make_model, tmp_path):
    document = json.loads(write_nerfstudio(make_model(num_points=0), tmp_path).read_text())
    assert "ply_file_path" not in document
    assert [path.name for path in tmp_path.iterdir()] == ["transforms.json"]


@pytest.mark.parametrize(
    ("kind", "params"),
    [
        ("FOV", [150.0, 148.0, 81.0, 59.0, 0.9]),
        ("THIN_PRISM_FISHEYE", [150.0, 148.0, 81.0, 59.0, *[0.01] * 8]),
        ("FULL_OPENCV", [150.0, 148.0, 81.0, 59.0, *[0.01] * 8]),
    ],
)
def test_a_lens_that_nerfstudio_does_not_know_is_refused_by_name(
    kind, params, make_model, tmp_path
):
    with pytest.raises(DataError, match=rf"{kind}\. Undistort the images"):
        write_nerfstudio(make_model(cameras=[(kind, params)]), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_fisheye_and_other_lenses_do_not_mix(make_model, tmp_path):
    with pytest.raises(DataError, match="one kind per dataset"):
        write_nerfstudio(make_model(cameras=[CAMERAS[1], CAMERAS[-1]]), tmp_path)
