"""TUM RGB-D: its quaternion order, its times, its cameras."""

import numpy as np
import pytest

from mvmatch.bench.datasets import find_sequences, load_sequence
from mvmatch.errors import DataError

cv2 = pytest.importorskip("cv2")
pytest.importorskip("pycolmap")
pytest.importorskip("scipy")

START = 1305031102.0
"""s, as in the data set: times need all digits of a double."""
HALF = np.sqrt(0.5)


@pytest.fixture
def tum(tmp_path):
    """Pictures at 0, 4 and 12 ms; the camera moves along x by 1 m per 10 ms and turns about z."""
    folder = tmp_path / "rgbd_dataset_freiburg1_xyz"
    (folder / "rgb").mkdir(parents=True)
    lines = ["# color images", "# timestamp filename"]
    for index, time in enumerate((0.0, 0.004, 0.012)):
        name = f"rgb/{START + time:.6f}.png"
        cv2.imwrite(str(folder / name), np.full((48, 64, 3), index, np.uint8))
        lines.append(f"{START + time:.6f} {name}")
    (folder / "rgb.txt").write_text("\n".join(lines) + "\n")
    (folder / "groundtruth.txt").write_text(
        "# timestamp tx ty tz qx qy qz qw\n"
        f"{START:.4f} 0 2 3 0 0 0 1\n"
        f"{START + 0.01:.4f} 1 2 3 0 0 {HALF} {HALF}\n"
        f"{START + 0.02:.4f} 2 2 3 0 0 1 0\n"
    )
    return folder


def test_poses_between_two_of_the_motion_capture_are_interpolated(tum):
    sequence = load_sequence(tum)
    turned = np.radians([0.0, 36.0, 108.0])  # 90 degrees in 10 ms

    np.testing.assert_allclose(sequence.centers, [[0, 2, 3], [0.4, 2, 3], [1.2, 2, 3]], atol=1e-4)
    for pose, angle in zip(sequence.cam_from_world, turned, strict=True):
        # Camera to world, x y z w: the camera's x axis turns towards the world's y axis.
        np.testing.assert_allclose(
            pose[:, :3].T @ [1, 0, 0], [np.cos(angle), np.sin(angle), 0], atol=1e-4
        )


def test_poses_whose_times_are_met_are_those_that_evo_reads(tum):
    file_interface = pytest.importorskip("evo.tools.file_interface")
    truth = file_interface.read_tum_trajectory_file(str(tum / "groundtruth.txt"))
    rows = [f"{time:.6f} rgb/{START:.6f}.png" for time in truth.timestamps]
    (tum / "rgb.txt").write_text("\n".join(rows))
    sequence = load_sequence(tum)

    found = np.linalg.inv([np.vstack([pose, [0, 0, 0, 1]]) for pose in sequence.cam_from_world])
    np.testing.assert_allclose(found, truth.poses_se3, atol=1e-9)


@pytest.mark.parametrize(
    ("number", "model", "params"),
    [
        (
            "1",
            "FULL_OPENCV",
            [51.73, 51.65, 31.91, 25.58, 0.2624, -0.9531, -0.0054, 0.0026, 1.1633],
        ),
        (
            "2",
            "FULL_OPENCV",
            [52.09, 52.10, 32.56, 25.02, 0.2312, -0.7849, -0.0033, -0.0001, 0.9172],
        ),
        ("3", "PINHOLE", [53.54, 53.92, 32.06, 24.81]),
    ],
)
def test_the_camera_is_the_published_one_with_colmaps_origin(tum, number, model, params):
    folder = tum.rename(tum.parent / f"rgbd_dataset_freiburg{number}_desk")
    camera = load_sequence(folder).camera

    assert camera.model_name == model
    # A tenth of 640x480: (318.6 + 0.5) / 10 = 31.91.
    np.testing.assert_allclose(camera.params[: len(params)], params, rtol=1e-12)


def test_pictures_without_poses_near_have_none(tum):
    late = "\n".join(f"{START + 0.02 + late:.6f} rgb/{START:.6f}.png" for late in (0, 0.001, 9))
    (tum / "rgb.txt").write_text(late)
    assert load_sequence(tum).posed.tolist() == [True, False, False]


def test_poses_far_apart_do_not_bridge_a_gap(tum):
    rows = f"{START} 0 0 0 0 0 0 1\n{START + 0.05} 1 0 0 0 0 0 1\n"
    (tum / "groundtruth.txt").write_text(rows)
    assert load_sequence(tum).posed.tolist() == [True, False, False]


def test_a_folder_named_otherwise_needs_a_camera(tum):
    folder = tum.rename(tum.parent / "desk")
    with pytest.raises(DataError, match="name it as the archive does"):
        load_sequence(folder)
    (folder / "camera.txt").write_text("PINHOLE 64 48 50 51 32 24\n")
    assert load_sequence(folder).camera.params.tolist() == [50, 51, 32, 24]
    assert find_sequences([folder.parent]) == {"desk": folder}


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (lambda folder: (folder / "groundtruth.txt").unlink(), "no groundtruth.txt"),
        (lambda folder: (folder / "rgb.txt").unlink(), "no rgb.txt"),
        (lambda folder: (folder / "rgb.txt").write_text("# nothing\n"), "lists 0 pictures"),
        (lambda folder: (folder / "rgb.txt").write_text("soon rgb/a.png\n"), "line 1: a time"),
        (lambda folder: (folder / "rgb.txt").write_bytes(b"\xff\x00\n"), "line 1: a time"),
        (lambda folder: next((folder / "rgb").iterdir()).unlink(), "1 are not there, such as"),
        (lambda folder: (folder / "groundtruth.txt").write_text("1 2 3\n"), "3 numbers on a line"),
        (
            lambda folder: (folder / "groundtruth.txt").write_text("1 0 0 0 0 0 0 1\n" * 2),
            "two poses or more",
        ),
        (
            lambda folder: (folder / "groundtruth.txt").write_text(
                "1 0 0 0 0 0 0 0\n2 0 0 0 0 0 0 1\n"
            ),
            "unit quaternion",
        ),
        (
            lambda folder: (folder / "groundtruth.txt").write_text(
                "1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n"
            ),
            "do both belong to one sequence",
        ),
    ],
)
def test_a_sequence_that_is_nearly_right_says_what_is_wrong(tum, broken, message):
    broken(tum)
    with pytest.raises(DataError, match=message):
        load_sequence(tum)
