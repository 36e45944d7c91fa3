"""Miniatures of the folders of data sets, each with poses worked out by hand."""

import numpy as np
import pytest

from mvmatch.bench.datasets import find_sequences, layout_of, load_sequence
from mvmatch.bench.digests import folder_digest
from mvmatch.errors import DataError

cv2 = pytest.importorskip("cv2")
pycolmap = pytest.importorskip("pycolmap")

TURNED = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
"""Camera to world: looks along the world's x axis, its own x axis along the world's -z."""
CENTERS = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0.5, 0]])


def write_picture(path, size=(60, 40), value=0):
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((size[1], size[0], 3), value, np.uint8))


def assert_looks_along_x(sequence, centers=CENTERS):
    np.testing.assert_allclose(sequence.centers, centers, atol=1e-12)
    ahead = np.add(centers, [5.0, 0, 0])
    R, t = sequence.cam_from_world[:, :, :3], sequence.cam_from_world[:, :, 3]
    np.testing.assert_allclose(np.einsum("nij,nj->ni", R, ahead) + t, [[0, 0, 5]] * 3, atol=1e-12)


@pytest.fixture
def kitti(tmp_path):
    folder = tmp_path / "dataset" / "sequences" / "07"
    for frame in range(3):
        write_picture(folder / "image_0" / f"{frame:06d}.png", value=frame)
    (folder / "times.txt").write_text("0.0\n0.1\n0.2\n")
    (folder / "calib.txt").write_text(
        "P0: 50 0 29.5 0 0 50 19.5 0 0 0 1 0\nP1: 50 0 29.5 -25 0 50 19.5 0 0 0 1 0\n"
        "P2: 40 0 28.5 2 0 40 18.5 0 0 0 1 0\nTr: 1 0 0 0 0 1 0 0 0 0 1 0\n"
    )
    poses = folder.parent.parent / "poses" / "07.txt"
    poses.parent.mkdir()
    np.savetxt(poses, [np.column_stack([TURNED, center]).ravel() for center in CENTERS])
    return folder


def test_kitti_odometry_gives_the_left_grey_camera(kitti):
    sequence = load_sequence(kitti)

    assert (sequence.name, len(sequence), sequence.size) == ("kitti-07", 3, (60, 40))
    assert sequence.camera.params.tolist() == [50, 50, 30, 20]  # OpenCV's origin + 0.5
    assert_looks_along_x(sequence)


def test_the_colour_camera_of_kitti_stands_beside_the_grey_one(kitti):
    (kitti / "image_0").rename(kitti / "image_2")
    sequence = load_sequence(kitti)

    assert sequence.camera.params.tolist() == [40, 40, 29, 19]
    # P2 = K [I | t] with t = 2 / 40: what lies ahead of the grey camera lies 0.05 m right of it.
    R, t = sequence.cam_from_world[0, :, :3], sequence.cam_from_world[0, :, 3]
    np.testing.assert_allclose(R @ [5.0, 0, 0] + t, [0.05, 0, 5], atol=1e-12)


def test_kitti_is_found_from_its_root_and_from_its_sequences(kitti):
    assert find_sequences([kitti.parent.parent]) == {"kitti-07": kitti}
    assert find_sequences([kitti.parent]) == {"kitti-07": kitti}
    assert find_sequences([kitti]) == {"kitti-07": kitti}


def test_sequences_of_kitti_whose_poses_are_not_public_have_none(kitti):
    folder = kitti.rename(kitti.parent / "11")
    sequence = load_sequence(folder)

    assert not sequence.posed.any()
    assert sequence.focal_known


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (
            lambda folder: (folder.parent.parent / "poses" / "07.txt").unlink(),
            r"07\.txt is missing: unpack data_odometry_poses",
        ),
        (lambda folder: (folder / "calib.txt").unlink(), "unpack data_odometry_calib"),
        (lambda folder: (folder / "calib.txt").write_text("P0: 1 2 3\n"), "no projection P0"),
        (
            lambda folder: (folder / "calib.txt").write_text("P0: 0 0 1 0 0 1 1 0 0 0 1 0\n"),
            "P0: is no projection",
        ),
        (lambda folder: (folder / "calib.txt").write_bytes(b"\xff\xfe"), "cannot be read"),
        (lambda folder: (folder / "image_0").rename(folder / "image_3"), "neither image_0"),
        (lambda folder: (folder / "image_0" / "000002.png").unlink(), "for 2 images; 12 each"),
        (lambda folder: (folder / "image_0" / "000000.png").write_bytes(b"x"), "not an image"),
        (
            lambda folder: (folder.parent.parent / "poses" / "07.txt").write_text(""),
            "has no poses: one 3x4 matrix",
        ),
        (
            lambda folder: (folder.parent.parent / "poses" / "07.txt").write_text("nan " * 12),
            "not finite",
        ),
    ],
)
def test_kitti_that_is_nearly_right_says_what_to_get(kitti, broken, message):
    broken(kitti)
    with pytest.raises(DataError, match=message):
        load_sequence(kitti)


COLMAP_POSE = pycolmap.Rotation3d(TURNED.T)


def write_model(folder, cameras, images):
    """Write the text files of COLMAP before 3.12, ids from 0 as ETH3D has them, no points."""
    folder.mkdir(parents=True)
    lines = [f"{number} {camera}" for number, camera in enumerate(cameras)]
    (folder / "cameras.txt").write_text(
        "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n" + "\n".join(lines)
    )
    x, y, z, w = COLMAP_POSE.quat
    lines = []
    for number, (name, camera, center) in enumerate(images):
        t = -TURNED.T @ np.asarray(center)
        lines.append(f"{number} {w} {x} {y} {z} {t[0]} {t[1]} {t[2]} {camera} {name}\n")
    (folder / "images.txt").write_text(
        "# IMAGE_ID, QW, QX, QY, QZ, ...\n" + "\n".join(lines) + "\n"
    )
    (folder / "points3D.txt").write_text("# POINT3D_ID, X, Y, Z, ...\n")


@pytest.fixture
def hall(tmp_path):
    """Pictures 8 to 13, of which 9 to 11 are the longest run of one size."""
    folder = tmp_path / "hall"
    small, large = "SIMPLE_RADIAL 60 40 50 30 20 0.1", "SIMPLE_RADIAL 40 60 50 20 30 0.1"
    refocused = "SIMPLE_RADIAL 60 40 54 30 20 0.1"
    cameras = {8: 1, 9: 0, 10: 0, 11: 2, 12: 1, 13: 0}
    for number, camera in cameras.items():
        write_picture(folder / "images" / f"P{number}.png", (40, 60) if camera == 1 else (60, 40))
    centers = dict(zip((9, 10, 11), CENTERS, strict=True))
    images = [(f"P{n}.png", cameras[n], centers.get(n, (0, 0, 9))) for n in (13, 12, 11, 10, 9, 8)]
    write_model(folder / "sparse", [small, large, refocused], images)
    return folder


def test_of_a_colmap_data_set_the_longest_run_of_one_size_is_taken(hall):
    sequence = load_sequence(hall)

    assert [path.name for path in sequence.frames.paths] == ["P9.png", "P10.png", "P11.png"]
    assert_looks_along_x(sequence)
    # COLMAP's origin is ours; the focal length is the median of 50, 50 and 54.
    assert sequence.camera.params.tolist() == [50, 30, 20, 0.1]


def test_a_model_in_sparse_0_and_pictures_scaled_since_are_read(hall):
    (hall / "sparse").rename(hall / "0")
    (hall / "sparse").mkdir()
    (hall / "0").rename(hall / "sparse" / "0")
    for number in (9, 10, 11):
        write_picture(hall / "images" / f"P{number}.png", (30, 20))
    sequence = load_sequence(hall)

    assert sequence.size == (30, 20)
    np.testing.assert_allclose(sequence.camera.params, [25, 15, 10, 0.1])


def test_the_poses_of_a_colmap_model_are_what_pycolmap_reads(hall):
    model = pycolmap.Reconstruction(hall / "sparse")
    centers = {image.name: image.projection_center() for image in model.images.values()}
    sequence = load_sequence(hall)

    expected = [centers[path.name] for path in sequence.frames.paths]
    np.testing.assert_allclose(sequence.centers, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (lambda folder: (folder / "images").rename(folder / "photos"), "no images/ beside it"),
        (lambda folder: (folder / "sparse" / "images.txt").unlink(), "holds no COLMAP model"),
        (lambda folder: (folder / "sparse" / "cameras.txt").write_text("x"), "not a whole COLMAP"),
        (
            lambda folder: [path.unlink() for path in (folder / "images").glob("P1?.png")],
            "holds 2 of the images .* no two of one size",
        ),
        (lambda folder: (folder / "images" / "P9.png").write_bytes(b"x"), "not an image"),
    ],
)
def test_a_colmap_folder_that_is_nearly_right_says_what_is_wrong(hall, broken, message):
    broken(hall)
    with pytest.raises(DataError, match=message):
        load_sequence(hall)


@pytest.fixture
def eth3d(tmp_path):
    folder = tmp_path / "courtyard"
    names = [f"dslr_images_undistorted/DSC_028{number}.png" for number in range(3)]
    for name in names:
        write_picture(folder / "images" / name)
    images = [(name, 0, center) for name, center in zip(names, CENTERS, strict=True)]
    calibration = folder / "dslr_calibration_undistorted"
    write_model(calibration, ["PINHOLE 60 40 50 51 30.25 20.5"], images)
    return folder


def test_eth3d_is_a_colmap_model_with_colmaps_pixel_origin(eth3d):
    sequence = load_sequence(eth3d)

    assert (sequence.name, len(sequence)) == ("courtyard", 3)
    assert sequence.camera.params.tolist() == [50, 51, 30.25, 20.5]
    assert_looks_along_x(sequence)
    assert find_sequences([eth3d.parent]) == {"courtyard": eth3d}


def test_eth3d_without_its_calibration_or_with_distorted_pictures_names_the_archive(eth3d):
    pictures = eth3d / "images" / "dslr_images_undistorted"
    pictures.rename(eth3d / "images" / "dslr_images")
    with pytest.raises(DataError, match=r"courtyard_dslr_undistorted\.7z .* distorted"):
        load_sequence(eth3d)
    (eth3d / "images" / "dslr_images").rename(pictures)
    (eth3d / "dslr_calibration_undistorted" / "images.txt").unlink()
    with pytest.raises(DataError, match="holds no COLMAP model"):
        load_sequence(eth3d)


@pytest.mark.parametrize("fixture", ["kitti", "hall", "eth3d"])
def test_the_digest_changes_with_poses_and_pictures_and_nothing_else(fixture, request):
    folder = request.getfixturevalue(fixture)
    layout = layout_of(folder)
    before = folder_digest(folder)
    (folder / "notes").mkdir()
    assert folder_digest(folder) == before
    poses = next(path for path in layout.files(folder) if path.name in {"images.txt", "07.txt"})
    poses.write_bytes(poses.read_bytes() + b"\n")
    changed = folder_digest(folder)
    assert changed != before
    write_picture(next(path for path in layout.files(folder) if path.suffix == ".png"), (90, 90))
    assert folder_digest(folder) not in {before, changed}
