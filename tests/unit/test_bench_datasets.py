import json

import numpy as np
import pytest

from mvmatch.bench.datasets import find_sequences, half_of, load_sequence, write_frames
from mvmatch.errors import DataError

cv2 = pytest.importorskip("cv2")
pytest.importorskip("pycolmap")

POSES = [np.column_stack([np.eye(3), [0.5 * frame, 0.0, 0.0]]) for frame in range(3)]


@pytest.fixture
def kitti(tmp_path):
    """Three frames and poses in the layout of KITTI, camera centres on a line."""
    folder = tmp_path / "drive"
    (folder / "images").mkdir(parents=True)
    for frame in range(3):
        image = np.full((40, 60, 3), frame, np.uint8)
        cv2.imwrite(str(folder / "images" / f"{frame:06d}.png"), image)
    (folder / "calib.txt").write_text("P0: 50 0 29.5 0 0 50 19.5 0 0 0 1 0\n")
    lines = [" ".join(map(str, pose.ravel())) for pose in POSES]
    (folder / "poses.txt").write_text("\n".join(lines))
    return folder


def test_a_sequence_of_the_kitti_layout_has_poses_and_no_point_truth(kitti):
    sequence = load_sequence(kitti)

    assert (sequence.name, len(sequence), sequence.size) == ("drive", 3, (60, 40))
    assert sequence.camera.params.tolist() == [50, 50, 30, 20]
    np.testing.assert_allclose(sequence.centers, [pose[:, 3] for pose in POSES])
    assert sequence.truth is None
    assert len(sequence.first(2)) == 2


def test_a_folder_of_sequences_gives_each_by_its_name(kitti):
    (kitti.parent / "notes").mkdir()
    assert find_sequences([kitti.parent]) == {"drive": kitti}
    assert find_sequences([kitti]) == {"drive": kitti}
    with pytest.raises(DataError, match="two sequences are named drive"):
        find_sequences([kitti, kitti.parent])


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (lambda folder: (folder / "calib.txt").unlink(), "neither camera.txt nor calib.txt"),
        (lambda folder: (folder / "poses.txt").unlink(), "poses.txt has no poses"),
        (lambda folder: (folder / "poses.txt").write_text("1 2 3\n"), "for 3 images; 12 each"),
        (lambda folder: (folder / "poses.txt").write_text("1 2 x\n"), "has no poses"),
        (
            lambda folder: (folder / "poses.txt").write_text(("0 " * 12 + "\n") * 3),
            "pose 0 is no rotation",
        ),
        (lambda folder: (folder / "scene.npz").write_bytes(b"x"), "no scene with exact geometry"),
    ],
)
def test_a_folder_that_is_not_what_it_should_be_says_what_is_missing(kitti, broken, message):
    broken(kitti)
    with pytest.raises(DataError, match=message):
        load_sequence(kitti)


def test_folders_without_sequences_are_refused(tmp_path):
    with pytest.raises(DataError, match="holds no sequence"):
        find_sequences([tmp_path])
    with pytest.raises(DataError, match="there is no folder"):
        find_sequences([tmp_path / "nowhere"])
    with pytest.raises(DataError, match="has no folder images"):
        load_sequence(tmp_path)


def test_a_nerf_camera_looks_along_its_negative_z_axis(kitti):
    (kitti / "calib.txt").unlink()
    lens = {"fl_x": 50, "fl_y": 51, "cx": 30, "cy": 20, "k1": 0.1, "k2": 0, "p1": 0, "p2": 0}
    matrix = np.eye(4)
    matrix[:3, 3] = [1, 2, 3]
    names = ["000002.png", "000000.png", "gone.png"]
    frames = [
        {"file_path": f"images/{name}", "transform_matrix": matrix.tolist()} for name in names
    ]
    document = {**lens, "w": 60.0, "h": 40.0, "frames": frames}
    (kitti / "transforms.json").write_text(json.dumps(document))
    sequence = load_sequence(kitti)

    assert len(sequence) == 2  # a frame without a pose and a pose without a frame are left out
    assert sequence.camera.model_name == "OPENCV"
    R, t = sequence.cam_from_world[0, :, :3], sequence.cam_from_world[0, :, 3]
    np.testing.assert_allclose(R @ [1, 2, 3 - 5] + t, [0, 0, 5])  # 5 units ahead
    np.testing.assert_allclose(R @ [1, 2 + 1, 3] + t, [0, -1, 0])  # its y axis points up


def test_frames_are_written_under_names_that_sort_in_display_order(kitti, tmp_path):
    paths = write_frames(load_sequence(kitti).first(2), tmp_path / "out")

    assert [path.name for path in paths] == ["000000.png", "000001.png"]
    assert cv2.imread(str(paths[1]))[0, 0].tolist() == [1, 1, 1]


def test_both_halves_hold_four_of_the_eight_known_sequences():
    names = "street_drive street_turn orbit_object room_handheld terrain_drone tripod_movers"
    halves = [half_of(name) for name in [*names.split(), "kitti-b", "fox"]]
    assert halves.count("reporting") == halves.count("tuning") == 4


@pytest.mark.parametrize("name", ["kitti-b", "fox"])
def test_the_measured_sequences_load(shared, name):
    sequence = load_sequence(shared / "sequences" / name)
    steps = np.linalg.norm(np.diff(sequence.centers, axis=0), axis=1)

    assert len(sequence) in {50, 51}
    assert (steps > 0).all()
