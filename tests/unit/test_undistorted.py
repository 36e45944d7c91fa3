"""Undistorted workspaces: pictures and model agree, and programs that splat find both."""

from pathlib import Path

import av
import numpy as np
import pytest

from mvmatch.errors import DataError
from mvmatch.export.model import read_model
from mvmatch.export.undistorted import undistorted_model, write_undistorted

pycolmap = pytest.importorskip("pycolmap")

WIDTH, HEIGHT = 160, 120
LENSES = [
    ("SIMPLE_RADIAL", [150.0, 81.0, 59.0, -0.25]),
    ("SIMPLE_RADIAL", [150.0, 81.0, 59.0, 0.2]),
    ("OPENCV", [150.0, 148.0, 81.0, 59.0, -0.2, 0.03, 0.002, -0.001]),
    ("OPENCV_FISHEYE", [150.0, 148.0, 81.0, 59.0, 0.05, -0.01, 0.0, 0.0]),
]
RADIAL = LENSES[0]
COLOR = np.array([200.0, 120.0, 40.0])


def pixel_centers(width, height):
    """(H, W, 2) px, COLMAP's origin."""
    rows, columns = np.mgrid[:height, :width]
    return np.stack([columns, rows], axis=-1) + 0.5


def photograph(spots) -> np.ndarray:
    """A picture with a spot of 2 px around each position, px, on black."""
    distance = np.linalg.norm(pixel_centers(WIDTH, HEIGHT)[:, :, None] - spots, axis=-1)
    brightness = np.exp(-0.5 * (distance / 2.0) ** 2).sum(axis=-1).clip(0, 1)
    return (brightness[..., None] * COLOR).round().astype(np.uint8)


def spot_near(picture, xy, reach=6.0):
    """Centre of mass, px, of what is bright around a position."""
    places = pixel_centers(picture.shape[1], picture.shape[0])
    weight = picture[..., 0] * (np.linalg.norm(places - xy, axis=-1) < reach)
    return (places * weight[..., None]).sum(axis=(0, 1)) / weight.sum()


@pytest.fixture
def scene(make_model):
    """Function that makes a model of few far-apart points through a lens."""

    def make(lens=RADIAL, names=("0.png", "1.png", "2.png"), **changed):
        return make_model(names, cameras=[lens], num_points=5, **changed)

    return make


def true_spots(model, image):
    return image.camera.img_from_cam(
        image.cam_from_world() * np.array([model.point3D(i).xyz for i in sorted(model.points3D)])
    )


def write_folder(model, folder):
    for image in model.images.values():
        path = folder / image.name
        path.parent.mkdir(parents=True, exist_ok=True)
        assert pycolmap.Bitmap.from_array(photograph(true_spots(model, image))).write(path)
    return folder


def write_video(model, path):
    """Pictures without loss."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("png", rate=10)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "rgb24"
        for image in sorted(model.images.values(), key=lambda image: image.name):
            picture = photograph(true_spots(model, image))
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode(None))
    return path


def write_masks(model, folder):
    """Masks of one bit, black on the spots: 0 and 1, of which COLMAP reads the 1 as white."""
    for image in model.images.values():
        path = folder / f"{image.name}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        is_spot = photograph(true_spots(model, image))[..., 0] > COLOR[0] / 2
        assert pycolmap.Bitmap.from_array(np.where(is_spot, 0, 1).astype(np.uint8)).write(path)
    return folder


def mask_of(folder, name):
    mask = pycolmap.Bitmap.read(folder / "masks" / f"{name}.png", as_rgb=False)
    assert mask.is_grey
    return mask.to_array()


def picture_of(folder, name):
    return pycolmap.Bitmap.read(folder / "images" / name, as_rgb=True).to_array()


def lone_spots(xy):
    apart = np.linalg.norm(xy[:, None] - xy, axis=-1) + 1e9 * np.eye(len(xy))
    inside = (xy > 8).all(axis=1) & (xy < [WIDTH - 16, HEIGHT - 16]).all(axis=1)
    return xy[(apart.min(axis=1) > 14) & inside]


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("kind", ["folder", "video"])
def test_points_of_the_written_model_lie_where_the_written_pictures_show_them(
    lens, kind, scene, tmp_path
):
    model, out = scene(lens), tmp_path / "out"
    source = (
        write_folder(model, tmp_path / "in")
        if kind == "folder"
        else write_video(model, tmp_path / "clip.mov")
    )
    assert write_undistorted(model, source, out) == 0
    made, compared = read_model(out / "sparse" / "0"), 0
    for image in made.images.values():
        picture = picture_of(out, image.name)
        assert picture.shape[1::-1] == (image.camera.width, image.camera.height)
        assert image.camera.model.name == "PINHOLE"
        for xy in lone_spots(true_spots(made, image)):
            np.testing.assert_allclose(spot_near(picture, xy), xy, atol=0.15)
            compared += 1
    assert compared >= 5
    assert {path.name for path in out.iterdir()} == {"images", "sparse"}
    assert sorted(path.name for path in (out / "images").iterdir()) == ["0.png", "1.png", "2.png"]


def test_the_pictures_are_those_that_opencv_makes(scene, tmp_path):
    cv2 = pytest.importorskip("cv2")
    model = scene(LENSES[2])
    write_undistorted(model, write_folder(model, tmp_path / "in"), tmp_path / "out")
    camera = read_model(tmp_path / "out" / "sparse" / "0").camera(1)

    fx, fy, cx, cy, *distortion = LENSES[2][1]
    flat = camera.calibration_matrix()
    lens = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])  # OpenCV's pixel origin
    flat[:2, 2] -= 0.5
    size = (camera.width, camera.height)
    maps = cv2.initUndistortRectifyMap(
        lens, np.array(distortion), np.eye(3), flat, size, cv2.CV_32FC1
    )
    for image in model.images.values():
        expected = cv2.remap(photograph(true_spots(model, image)), *maps, cv2.INTER_LINEAR)
        found = picture_of(tmp_path / "out", image.name)
        assert found.shape == expected.shape
        # OpenCV interpolates in steps of 1/32 px.
        assert np.abs(found.astype(float) - expected).max() <= 5


def test_observations_keep_their_points_and_their_errors(make_model):
    model = make_model(cameras=[RADIAL])
    made = undistorted_model(model)
    made.update_point_3d_errors()
    assert made.num_points3D() == model.num_points3D()
    assert made.compute_num_observations() == model.compute_num_observations()
    assert max(point.error for point in made.points3D.values()) < 1e-6
    assert model.camera(1).model.name == "SIMPLE_RADIAL", "the one given is not changed"
    np.testing.assert_allclose(
        model.image(1).points2D[0].xy, true_spots(model, model.image(1))[0], atol=1e-9
    )


def test_points_take_their_colours_from_the_pictures(scene, tmp_path):
    model = scene()
    write_undistorted(model, write_folder(model, tmp_path / "in"), tmp_path / "out")
    for point in read_model(tmp_path / "out" / "sparse" / "0").points3D.values():
        np.testing.assert_allclose(point.color, COLOR, atol=25)
    assert not any(point.color.any() for point in model.points3D.values())


def test_pictures_of_a_pinhole_stay_as_they_are(scene, tmp_path):
    model = scene(("PINHOLE", [150.0, 148.0, 81.0, 59.0]))
    folder = write_folder(model, tmp_path / "in")
    bright = np.full((HEIGHT, WIDTH, 3), 200, np.uint8)  # up to its last row and column
    assert pycolmap.Bitmap.from_array(bright).write(folder / "1.png")
    write_undistorted(model, folder, tmp_path / "out")
    made = read_model(tmp_path / "out" / "sparse" / "0")
    np.testing.assert_array_equal(made.camera(1).params, model.camera(1).params)
    for image in model.images.values():
        expected = pycolmap.Bitmap.read(folder / image.name, as_rgb=True).to_array()
        np.testing.assert_array_equal(picture_of(tmp_path / "out", image.name), expected)


def test_two_cameras_and_names_in_folders_keep_apart(make_model, tmp_path):
    names = ("left/0.png", "right/0.png", "left/1.png", "right/1.png")
    model = make_model(names, cameras=LENSES[:2], num_points=5)
    write_undistorted(model, write_folder(model, tmp_path / "in"), tmp_path / "out")
    made = read_model(tmp_path / "out" / "sparse" / "0")
    sizes = {
        name: picture_of(tmp_path / "out", name).shape[1::-1]
        for name in (image.name for image in made.images.values())
    }
    assert set(sizes) == set(names)
    assert sizes["left/0.png"] == sizes["left/1.png"] != sizes["right/0.png"]
    for image in made.images.values():
        assert sizes[image.name] == (image.camera.width, image.camera.height)


@pytest.mark.parametrize("lens", LENSES)
def test_masks_hide_in_the_written_pictures_what_they_hid_before(lens, scene, tmp_path):
    model, out = scene(lens, names=("a/0.png", "b/1.png", "b/2.png")), tmp_path / "out"
    masks = write_masks(model, tmp_path / "masks")
    write_undistorted(model, write_folder(model, tmp_path / "in"), out, masks=masks)
    made, compared = read_model(out / "sparse" / "0"), 0
    for image in made.images.values():
        mask, picture = mask_of(out, image.name), picture_of(out, image.name)
        assert mask.shape == picture.shape[:2] == (image.camera.height, image.camera.width)
        assert set(np.unique(mask)) == {0, 255}
        # The edge of a spot, half as bright as its centre, is true to a pixel: 0.3 of that.
        brightness = picture[..., 0] / COLOR[0]
        assert (mask[brightness > 0.8] == 0).all()
        assert (mask[brightness < 0.2] == 255).all()
        for x, y in lone_spots(true_spots(made, image)).astype(int):
            assert mask[y, x] == 0
            compared += 1
    assert compared >= 5
    names = [path.relative_to(out).as_posix() for path in (out / "masks").rglob("*.png")]
    assert sorted(names) == [f"masks/{name}.png" for name in ("a/0.png", "b/1.png", "b/2.png")]


def test_masks_of_a_pinhole_stay_as_they_are(scene, tmp_path):
    model = scene(("PINHOLE", [150.0, 148.0, 81.0, 59.0]))
    masks = write_masks(model, tmp_path / "masks")
    write_undistorted(model, write_folder(model, tmp_path / "in"), tmp_path / "out", masks=masks)
    for image in model.images.values():
        given = pycolmap.Bitmap.read(masks / f"{image.name}.png", as_rgb=False).to_array()
        np.testing.assert_array_equal(mask_of(tmp_path / "out", image.name), 255 * given)


@pytest.mark.parametrize("fault", ["missing", "of another size", "no picture"])
def test_nothing_is_left_where_a_mask_does_not_fit(fault, scene, tmp_path):
    model = scene()
    masks = write_masks(model, tmp_path / "masks")
    mask = masks / "1.png.png"
    if fault == "missing":
        mask.unlink()
    elif fault == "no picture":
        mask.write_bytes(b"text")
    else:
        pycolmap.Bitmap.from_array(np.zeros((60, 80), np.uint8)).write(mask)
    with pytest.raises(DataError, match=r"1\.png\.png"):
        write_undistorted(
            model, write_folder(model, tmp_path / "in"), tmp_path / "out", masks=masks
        )
    assert list((tmp_path / "out").iterdir()) == []


def test_images_without_a_picture_are_not_in_the_model(scene, tmp_path):
    model = scene(names=tuple(f"{frame}.png" for frame in range(5)))
    folder = write_folder(model, tmp_path / "in")
    (folder / "2.png").unlink()
    assert write_undistorted(model, folder, tmp_path / "out") == 1
    made = read_model(tmp_path / "out" / "sparse" / "0")
    assert sorted(image.name for image in made.images.values() if image.has_pose) == [
        *("0.png", "1.png", "3.png", "4.png")
    ]
    assert model.num_reg_images() == 5


def test_nothing_is_left_of_pictures_that_cannot_be_read(scene, tmp_path):
    model = scene()
    folder = write_folder(model, tmp_path / "in")
    (folder / "1.png").write_bytes(b"no picture")
    with pytest.raises(DataError, match=r"1\.png is not an image"):
        write_undistorted(model, folder, tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize("taken", ["images", "masks", "sparse"])
def test_what_is_there_is_not_replaced(taken, scene, tmp_path):
    model = scene()
    folder = write_folder(model, tmp_path / "images")
    masks = write_masks(model, tmp_path / "given")
    (tmp_path / "out" / taken).mkdir(parents=True)
    with pytest.raises(DataError, match=f"{taken} is there already"):
        write_undistorted(model, folder, tmp_path / "out", masks=masks)
    with pytest.raises(DataError, match="images is there already"):
        write_undistorted(model, folder, Path(tmp_path))


def test_names_do_not_lead_out_of_the_folder(scene, tmp_path):
    model = scene(names=("../0.png", "1.png", "2.png"))
    folder = write_folder(model, tmp_path / "deep" / "in")
    with pytest.raises(DataError, match="leads out of the folder"):
        write_undistorted(model, folder, tmp_path / "out")
    assert not (tmp_path / "out" / "0.png").exists()
