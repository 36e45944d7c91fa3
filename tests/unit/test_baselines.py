import numpy as np
import pytest

from mvmatch.baselines import match_sift, track_dis, track_klt
from mvmatch.baselines.images import list_images
from mvmatch.camera import parse_camera
from mvmatch.errors import DataError

cv2 = pytest.importorskip("cv2")

SHIFT = np.array([3.0, 1.0])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Five frames in which a texture moves by SHIFT px per frame."""
    generator = np.random.default_rng(0)
    texture = cv2.GaussianBlur(generator.uniform(0, 255, (200, 260)), (0, 0), 2.0)
    texture = ((texture - texture.mean()) * 4 + 128).clip(0, 255).astype(np.uint8)
    path = tmp_path_factory.mktemp("frames")
    for frame in range(5):
        x, y = (20 - SHIFT * frame).astype(int)
        cv2.imwrite(str(path / f"{frame}.png"), texture[y : y + 160, x : x + 200])
    return path


@pytest.mark.parametrize(("track", "tolerance"), [(track_klt, 0.05), (track_dis, 0.2)])
def test_points_on_a_moving_texture_move_with_it(folder, track, tolerance):
    tracks = track(list_images(folder))

    assert len(tracks) > 50
    for frame in range(4):
        pair = tracks.between(frame, frame + 1)
        np.testing.assert_allclose(np.median(pair.xy1 - pair.xy0, axis=0), SHIFT, atol=tolerance)


def test_klt_corners_are_given_in_the_origin_of_colmap(tmp_path):
    for frame in range(3):
        image = np.zeros((64, 64), np.uint8)
        image[20:40, 20:40] = 255  # corners lie at 20 and 40 where the origin is the image corner
        cv2.imwrite(str(tmp_path / f"{frame}.png"), image)
    corners = track_klt(list_images(tmp_path)).keypoints(0)

    nearest = np.abs(corners[:, None] - np.array([20.0, 40.0])[:, None]).min(axis=(1, 2))
    assert len(corners) >= 4
    assert nearest.max() <= 1.0


def test_sift_writes_a_verified_database(folder, tmp_path):
    pycolmap = pytest.importorskip("pycolmap")
    camera = parse_camera("300", 200, 160).camera
    match_sift(folder, tmp_path / "sift.db", camera=camera, max_frames=3)

    with pycolmap.Database.open(tmp_path / "sift.db") as database:
        assert database.num_images() == 3
        assert database.num_verified_image_pairs() == 3
        assert database.read_camera(1).params.tolist() == [300.0, 100.0, 80.0]


def test_one_image_is_not_enough(tmp_path):
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((8, 8), np.uint8))
    with pytest.raises(DataError, match="holds 1 images"):
        list_images(tmp_path)
