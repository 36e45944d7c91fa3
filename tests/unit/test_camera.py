import pytest

from mvmatch.camera import parse_camera
from mvmatch.errors import DataError

pytest.importorskip("pycolmap")


def test_without_a_camera_the_prior_is_1_2_times_the_longer_side_and_says_so():
    choice = parse_camera(None, 1000, 500)

    assert choice.is_prior
    assert choice.camera.params.tolist() == [1200.0, 500.0, 250.0, 0.0]
    assert "1200" in choice.source


def test_a_number_is_a_focal_length_in_px():
    choice = parse_camera("700.5", 1000, 500)

    assert not choice.is_prior
    assert choice.camera.model_name == "SIMPLE_PINHOLE"
    assert choice.camera.params.tolist() == [700.5, 500.0, 250.0]


@pytest.mark.parametrize(
    "text",
    [
        "PINHOLE,700,701,500,250",
        "PINHOLE, 700, 701, 500, 250",
        "pinhole 1000 500 700 701 500 250",
        "1 PINHOLE 1000 500 700 701 500 250",
    ],
)
def test_every_spelling_of_a_colmap_camera_gives_the_same_camera(text: str):
    camera = parse_camera(text, 1000, 500).camera

    assert (camera.model_name, camera.width, camera.height) == ("PINHOLE", 1000, 500)
    assert camera.params.tolist() == [700.0, 701.0, 500.0, 250.0]


def test_a_camera_of_twice_the_size_is_scaled_to_the_video():
    camera = parse_camera("PINHOLE 2000 1000 700 700 1000 500", 1000, 500).camera

    assert camera.params.tolist() == [350.0, 350.0, 500.0, 250.0]


def test_a_camera_of_another_shape_is_refused_with_both_sizes():
    with pytest.raises(DataError, match=r"2000x2000.*1000x500"):
        parse_camera("PINHOLE 2000 2000 700 700 1000 500", 1000, 500)


def test_kitti_principal_points_move_by_half_a_pixel(tmp_path):
    row = "700 0 600 0 0 710 180 0 0 0 1 0"
    path = tmp_path / "calib.txt"
    for text in (f"{row}\n{row}\n", f"P0: {row}\nP1: 1 0 0 0 0 1 0 0 0 0 1 0\n"):
        path.write_text(text)
        camera = parse_camera(str(path), 1241, 376).camera
        assert camera.params.tolist() == [700.0, 710.0, 600.5, 180.5]


def test_a_cameras_txt_of_colmap_is_read(tmp_path):
    path = tmp_path / "cameras.txt"
    path.write_text("# Camera list\n1 SIMPLE_RADIAL 960 540 760 480 270 -0.05\n")

    camera = parse_camera(str(path), 960, 540).camera
    assert camera.params.tolist() == [760.0, 480.0, 270.0, -0.05]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("no-such-file.txt", "neither a camera nor an existing file"),
        ("PINHOLE,1,2,3", "takes 4 parameters"),
        ("PINHOLE,1,2,3,nan", "finite"),
        ("PINHOLE,a,2,3,4", "numbers"),
        ("-5", "positive"),
        ("inf", "positive"),
        ("nan", "positive"),
    ],
)
def test_nonsense_is_refused_with_a_reason(text: str, reason: str):
    with pytest.raises(DataError, match=reason):
        parse_camera(text, 1000, 500)


def test_a_file_without_a_camera_and_one_with_two_are_refused(tmp_path):
    path = tmp_path / "camera.txt"
    path.write_text("hello\n")
    with pytest.raises(DataError, match="no camera"):
        parse_camera(str(path), 10, 10)

    path.write_text("1 SIMPLE_PINHOLE 10 10 9 5 5\n2 SIMPLE_PINHOLE 10 10 9 5 5\n")
    with pytest.raises(DataError, match="2 cameras"):
        parse_camera(str(path), 10, 10)

    path.write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(DataError, match="not text"):
        parse_camera(str(path), 10, 10)
