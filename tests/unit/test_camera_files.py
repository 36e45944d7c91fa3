"""Calibration files of other programs: the same pixels as theirs, half a pixel further."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from mvmatch.camera import parse_camera
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

pytest.importorskip("pycolmap")

SIZE = (640, 480)
K = np.array([[500.0, 0, 310.0], [0, 510.0, 245.0], [0, 0, 1]])
POINTS = np.random.default_rng(0).uniform((-0.5, -0.4, 1), (0.5, 0.4, 1.5), (50, 3))

KALIBR = """
cam0:
  camera_model: pinhole
  distortion_coeffs: [-0.2, 0.05, 1e-4, -2e-04]
  distortion_model: radtan
  intrinsics: [500.0, 510.0, 310.0, 245.0]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
"""
ROS = """
image_width: 640
image_height: 480
camera_name: left
camera_matrix:
  rows: 3
  cols: 3
  data: [500.0, 0.0, 310.0, 0.0, 510.0, 245.0, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.2, 0.05, 0.0001, -0.0002, 0.0]
"""


def write_opencv(path: Path, coefficients: list[float] | None, **more: object) -> Path:
    cv2 = pytest.importorskip("cv2")
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", SIZE[0])
    storage.write("image_height", SIZE[1])
    storage.write("camera_matrix", K)
    if coefficients is not None:
        storage.write("distortion_coefficients", np.array([coefficients]))
    for name, value in more.items():
        storage.write(name, value)
    storage.release()
    return path


def write_json(path: Path, **fields: object) -> str:
    path.write_text(json.dumps(fields))
    return str(path)


def projected(camera: Any) -> NDArray[np.float64]:
    return np.asarray(camera.img_from_cam(POINTS), np.float64)


@pytest.mark.parametrize("suffix", ["yml", "yaml", "json"])
@pytest.mark.parametrize(
    ("coefficients", "model"),
    [
        (None, "PINHOLE"),
        ([0.0] * 5, "PINHOLE"),
        ([-0.2, 0.05, 1e-4, -2e-4], "OPENCV"),
        ([-0.2, 0.05, 1e-4, -2e-4, 0.0], "OPENCV"),
        ([-0.2, 0.05, 1e-4, -2e-4, 0.02], "FULL_OPENCV"),
        ([-0.2, 0.05, 1e-4, -2e-4, 0.02, 0.1, -0.03, 0.01], "FULL_OPENCV"),
    ],
)
def test_opencv_files_project_as_opencv_does(
    coefficients: list[float] | None, model: str, suffix: str, tmp_path: Path
) -> None:
    cv2 = pytest.importorskip("cv2")
    path = write_opencv(tmp_path / f"calibration.{suffix}", coefficients)

    choice = parse_camera(str(path), *SIZE)

    assert (choice.camera.model_name, choice.is_prior, choice.warnings) == (model, False, ())
    given = np.array(coefficients or [0.0] * 4)
    expected = cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), K, given)[0].reshape(-1, 2)
    np.testing.assert_allclose(projected(choice.camera), expected + 0.5, atol=1e-9)


def test_a_fisheye_of_opencv_projects_as_opencv_does(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    coefficients = [0.01, -0.02, 0.003, 0.001]
    path = write_opencv(tmp_path / "fisheye.yml", coefficients, fisheye_model=1)

    camera = parse_camera(str(path), *SIZE).camera

    assert camera.model_name == "OPENCV_FISHEYE"
    zero = np.zeros((3, 1))
    expected = cv2.fisheye.projectPoints(POINTS[:, None], zero, zero, K, np.array(coefficients))[
        0
    ].reshape(-1, 2)
    np.testing.assert_allclose(projected(camera), expected + 0.5, atol=1e-9)


def test_the_first_line_of_older_opencv_is_no_obstacle(tmp_path: Path) -> None:
    path = write_opencv(tmp_path / "old.yml", [-0.2, 0.05, 1e-4, -2e-4])
    lines = path.read_text().splitlines()
    path.write_text("\n".join(["%YAML:1.0", *lines[1:]]))
    assert parse_camera(str(path), *SIZE).camera.model_name == "OPENCV"


@pytest.mark.parametrize("text", [ROS, KALIBR], ids=["ros", "kalibr"])
def test_ros_and_kalibr_mean_the_camera_that_opencv_means(text: str, tmp_path: Path) -> None:
    opencv = write_opencv(tmp_path / "opencv.yml", [-0.2, 0.05, 1e-4, -2e-4])
    path = tmp_path / "camera.yaml"
    path.write_text(text)

    found, expected = (parse_camera(str(file), *SIZE).camera for file in (path, opencv))
    assert found.model_name == expected.model_name
    np.testing.assert_allclose(found.params, expected.params, rtol=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        ROS.replace("plumb_bob", "equidistant").replace("-0.0002, 0.0", "-0.0002"),
        KALIBR.replace("radtan", "equidistant"),
    ],
    ids=["ros", "kalibr"],
)
def test_equidistant_is_a_fisheye(text: str, tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    assert parse_camera(str(path), *SIZE).camera.model_name == "OPENCV_FISHEYE"


def test_a_message_of_ros_is_read(tmp_path: Path) -> None:
    path = tmp_path / "camera_info.yaml"
    path.write_text(
        "height: 480\nwidth: 640\ndistortion_model: plumb_bob\nD: [0.0, 0.0, 0.0, 0.0, 0.0]\n"
        "K: [500.0, 0.0, 310.0, 0.0, 510.0, 245.0, 0.0, 0.0, 1.0]\n"
    )
    camera = parse_camera(str(path), *SIZE).camera
    assert camera.params.tolist() == [500.0, 510.0, 310.5, 245.5]


def test_nerfstudio_has_the_origin_of_colmap(tmp_path: Path) -> None:
    pinhole = {"fl_x": 500.0, "fl_y": 510.0, "cx": 310.0, "cy": 245.0, "w": 640, "h": 480}
    path = tmp_path / "transforms.json"
    distortion = {"k1": -0.2, "k2": 0.05, "p1": 1e-4, "p2": -2e-4}

    camera = parse_camera(write_json(path, **pinhole, **distortion), *SIZE).camera
    assert camera.model_name == "OPENCV"
    assert camera.params.tolist() == [500, 510, 310, 245, -0.2, 0.05, 1e-4, -2e-4]

    camera = parse_camera(write_json(path, **pinhole, **distortion, k3=0.1), *SIZE).camera
    assert camera.model_name == "FULL_OPENCV"
    assert camera.params.tolist()[8:] == [0.1, 0, 0, 0]

    fisheye = {"camera_model": "OPENCV_FISHEYE", "k1": 0.1, "k2": 0.2, "k3": 0.3, "k4": 0.4}
    camera = parse_camera(write_json(path, **pinhole, **fisheye), *SIZE).camera
    assert camera.params.tolist()[4:] == [0.1, 0.2, 0.3, 0.4]


def test_nerfstudio_intrinsics_of_every_frame_and_an_angle_are_read(tmp_path: Path) -> None:
    path = tmp_path / "transforms.json"
    frames = [{"fl_x": 500.0, "file_path": name} for name in ("a.png", "b.png")]
    camera = parse_camera(write_json(path, w=640, h=480, frames=frames), *SIZE).camera
    assert camera.params.tolist() == [500.0, 500.0, 320.0, 240.0]

    camera = parse_camera(write_json(path, w=640, h=480, camera_angle_x=math.pi / 2), *SIZE).camera
    assert camera.params.tolist() == pytest.approx([320.0, 320.0, 320.0, 240.0])

    frames[1]["fl_x"] = 600.0
    with pytest.raises(DataError, match="different intrinsics"):
        parse_camera(write_json(path, w=640, h=480, frames=frames), *SIZE)


def test_another_resolution_is_scaled_with_a_warning(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(ROS)
    choice = parse_camera(str(path), 320, 240)
    assert choice.camera.params.tolist()[:4] == [250.0, 255.0, 155.25, 122.75]
    assert "640x480 pictures and was scaled to 320x240" in choice.warnings[0]
    with pytest.raises(DataError, match=r"640x480 images, the video is 640x360: another shape"):
        parse_camera(str(path), 640, 360)


def test_a_calibration_without_a_size_must_fit_the_video(tmp_path: Path) -> None:
    path = tmp_path / "transforms.json"
    text = write_json(path, fl_x=500.0, cx=310.0, cy=245.0)
    assert parse_camera(text, *SIZE).camera.params.tolist() == [500.0, 500.0, 310.0, 245.0]
    with pytest.raises(DataError, match="outside the 320x240 video"):
        parse_camera(text, 320, 240)


MATRIX = "camera_matrix: [500, 0, 320, 0, 500, 240, 0, 0, 1]\n"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "holds no fields"),
        ("- 1\n- 2\n", "holds no fields"),
        ("a: [1, 2", "cannot be read as YAML"),
        ("model: pinhole\n", "no camera that mvmatch can read"),
        ("camera_matrix: [1, 2, 3]\n", "3x3 numbers"),
        ("camera_matrix: {rows: 3, cols: 3}\n", "matrix with data"),
        ("camera_matrix: 5\n", "matrix with data"),
        (MATRIX.replace("500", ".nan"), "finite number"),
        (MATRIX.replace("500", "true"), "finite number"),
        (MATRIX.replace("500", "-500"), "focal lengths positive"),
        (MATRIX.replace("500, 0, 320", "500, 3, 320"), "no skew"),
        (MATRIX.replace("[", "[[").replace("]", "]]"), None),
        (MATRIX + "distortion_coefficients: [1, 2, 3]\n", "3 coefficients"),
        (MATRIX + "D: [.inf, 0, 0, 0]\n", "finite number"),
        (MATRIX + f"D: {[0.0] * 8 + [0.1] * 4}\n", "thin prism"),
        (MATRIX + "distortion_model: equidistant\nD: [0, 0, 0, 0, 0]\n", "4 coefficients"),
        (MATRIX + "distortion_model: magic\n", "unknown distortion model 'magic'"),
        (MATRIX + "image_width: 640\n", "not the other of image_width and image_height"),
        (MATRIX + "image_width: 640.5\nimage_height: 480\n", "positive whole numbers"),
        (MATRIX + "image_width: -640\nimage_height: -480\n", "positive whole numbers"),
        (MATRIX + "image_width: [1]\nimage_height: 480\n", "finite number"),
        (KALIBR + KALIBR.replace("cam0", "cam1"), "2 cameras"),
        ("cam0: 5\n", "no fields"),
        (KALIBR.replace("pinhole", "omni"), "'omni'"),
        (KALIBR.replace("[500.0, ", "["), "fx, fy, cx, cy"),
        (KALIBR.replace("  intrinsics", "  other"), "must be a list"),
        (KALIBR.replace("[640, 480]", "[640]"), "width and height"),
        ("a: !!python/object/apply:os.system ['echo']\n", "cannot be read as YAML"),
        ("a: !!opencv-matrix 5\n", "not followed by fields"),
        ("a: &a [1]\nb: [*a, *a]\n", "references"),
        ("a: " + "[" * 3000 + "]" * 3000, "nested too deeply"),
        ("a: " + "9" * 5000 + "\n", "cannot be read as YAML"),
        ("a: 2026-99-99\n", "cannot be read as YAML"),
        ("a: b: c\n\x00", "cannot be read as YAML"),
    ],
)
def test_hostile_yaml_is_refused_with_a_reason(
    text: str, reason: str | None, tmp_path: Path
) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    if reason is None:
        assert parse_camera(str(path), *SIZE).camera.model_name == "PINHOLE"
        return
    with pytest.raises(DataError, match=reason) as caught:
        parse_camera(str(path), *SIZE)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("{", "not valid JSON"),
        ('{"fl_x": NaN, "w": 640, "h": 480}', "fl_x must be a finite number"),
        ('{"fl_x": -5, "w": 640, "h": 480}', "focal lengths positive"),
        ('{"fl_x": "many", "w": 640, "h": 480}', "finite number"),
        ('{"fl_x": null, "w": 640, "h": 480}', "finite number"),
        ('{"fl_x": 500, "w": 640}', "not the other of w and h"),
        ('{"fl_x": 500, "w": 0, "h": 0}', "positive whole numbers"),
        ('{"fl_x": 500}', "needs w and h, or cx and cy"),
        ('{"w": 640, "h": 480, "frames": []}', "no focal length"),
        ('{"w": 640, "h": 480, "frames": {}}', "frames must be a list"),
        ('{"w": 640, "h": 480, "frames": [5]}', "a frame has no fields"),
        ('{"camera_angle_x": 1.0}', "needs the size"),
        ('{"camera_angle_x": 4.0, "w": 640, "h": 480}', "between 0 and pi"),
        ('{"fl_x": 500, "w": 640, "h": 480, "k4": 0.1}', "k4"),
        ('{"fl_x": 500, "w": 640, "h": 480, "camera_model": "EQUIRECTANGULAR"}', "EQUIRECT"),
        ('{"fl_x": 1' + "0" * 5000 + "}", "not valid JSON"),
        ('{"fl_x": 1' + "0" * 400 + ', "w": 640, "h": 480}', "finite number"),
        ('{"a": ' * 100_000, "not valid JSON: nested too deeply"),
    ],
)
def test_hostile_json_is_refused_with_a_reason(text: str, reason: str, tmp_path: Path) -> None:
    path = tmp_path / "transforms.json"
    path.write_text(text)
    with pytest.raises(DataError, match=reason) as caught:
        parse_camera(str(path), *SIZE)
    assert "\n" not in str(caught.value)


def test_a_file_too_large_for_a_camera_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text("# " + "x" * (1 << 20))
    with pytest.raises(DataError, match="larger than 1 MiB"):
        parse_camera(str(path), *SIZE)
