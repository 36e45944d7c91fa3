"""Colours of points from pictures whose colours are known everywhere."""

import av
import numpy as np
import pytest

from mvmatch.errors import DataError
from mvmatch.export.colors import color_points, frames_that_see_all
from mvmatch.export.model import images_by_frame
from mvmatch.export.pictures import write_frames

pycolmap = pytest.importorskip("pycolmap")

WIDTH, HEIGHT = 160, 120


def gradient(xy) -> np.ndarray:
    """Colour at [x, y] px, linear in both, so that interpolation is exact."""
    x, y = np.moveaxis(np.asarray(xy), -1, 0)
    return np.stack([20 + 1.25 * x, 30 + 1.5 * y, 220 - 0.5 * x - 0.5 * y], axis=-1)


def whole_picture() -> np.ndarray:
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return gradient(np.stack([columns, rows], axis=-1) + 0.5).round().astype(np.uint8)


def write_images(folder, names):
    picture = whole_picture()
    folder.mkdir(exist_ok=True)
    for name in names:
        assert pycolmap.Bitmap.from_array(picture).write(folder / name)
    return folder


def errors(model) -> np.ndarray:
    """(N,) largest difference to the colour where the point is seen, mean over its images."""
    found = []
    for point in model.points3D.values():
        seen = [
            gradient(model.image(e.image_id).points2D[e.point2D_idx].xy)
            for e in point.track.elements
        ]
        found.append(np.abs(point.color - np.mean(seen, axis=0)).max())
    return np.array(found)


def names_of(model):
    return sorted(image.name for image in model.images.values())


def test_points_take_the_colour_of_a_folder_of_images(make_model, tmp_path):
    model = make_model()
    folder = write_images(tmp_path / "images", names_of(model))
    assert color_points(model, folder) == 0
    assert errors(model).max() < 1.5


def test_old_colours_do_not_stay(make_model, tmp_path):
    model = make_model()
    for number in model.point3D_ids():
        model.point3D(number).color = np.array([255, 0, 255], np.uint8)
    color_points(model, write_images(tmp_path / "images", names_of(model)))
    assert errors(model).max() < 1.5


@pytest.fixture
def video(tmp_path):
    """Six pictures without loss."""
    clip = tmp_path / "clip.mov"
    with av.open(str(clip), "w") as container:
        stream = container.add_stream("png", rate=10)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "rgb24"
        for _ in range(6):
            container.mux(
                stream.encode(av.VideoFrame.from_ndarray(whole_picture(), format="rgb24"))
            )
        container.mux(stream.encode(None))
    return clip


def test_points_take_the_colour_of_a_video(make_model, video):
    model = make_model()
    assert color_points(model, video) == 0
    # Points move by a few px from image to image, and one of them gives the colour.
    assert errors(model).max() < 20
    assert np.median(errors(model)) < 8


def test_images_that_are_missing_are_counted_and_leave_points_black(make_model, tmp_path):
    model = make_model()
    folder = write_images(tmp_path / "images", names_of(model)[:3])
    assert color_points(model, folder) == 3
    black = [not p.color.any() for p in model.points3D.values()]
    unseen = [min(e.image_id for e in p.track.elements) > 3 for p in model.points3D.values()]
    assert black == unseen
    assert any(unseen)


def test_a_folder_without_any_image_of_the_model_is_refused(make_model, tmp_path):
    with pytest.raises(DataError, match=r"no image of the model.*frame_000000\.png\. Give"):
        color_points(make_model(), tmp_path)


def test_pictures_of_another_size_are_refused(make_model, tmp_path, video):
    model = make_model(size=(80, 60))
    folder = write_images(tmp_path / "images", names_of(model))
    for source in (folder, video):
        with pytest.raises(DataError, match="160x120 px but the model's are 80x60"):
            color_points(model, source)


def test_a_video_that_ends_early_is_another_video(make_model, video):
    names = [f"frame_{frame:06d}.png" for frame in range(50, 56)]
    with pytest.raises(DataError, match="ends before"):
        color_points(make_model(names), video)


def test_frames_of_a_video_become_the_images_of_the_model(make_model, video, tmp_path):
    model = make_model(["2.png", "deep/4.png", "40.png"])
    assert write_frames(model, video, tmp_path / "out") == 1
    found = sorted(path.relative_to(tmp_path / "out") for path in (tmp_path / "out").rglob("*.png"))
    assert [path.as_posix() for path in found] == ["2.png", "deep/4.png"]
    picture = pycolmap.Bitmap.read(tmp_path / "out" / "2.png", as_rgb=True).to_array()
    assert np.abs(picture.astype(float) - whole_picture()).mean() < 2


@pytest.mark.parametrize("name", ["../1.png", "/tmp/1.png", "a/../../1.png", "C:\\1.png"])
def test_a_name_that_leads_out_of_the_folder_is_not_written(name, make_model, video, tmp_path):
    with pytest.raises(DataError, match="leads out of the folder"):
        write_frames(make_model([name]), video, tmp_path / "deep" / "out")
    assert not list(tmp_path.glob("*.png"))


def test_a_name_without_an_image_ending_is_not_written(make_model, video, tmp_path):
    with pytest.raises(DataError, match="no known image ending"):
        write_frames(make_model(["1.xyz"]), video, tmp_path / "out")


def test_every_point_is_seen_in_the_few_frames_that_are_decoded(make_model):
    model = make_model([f"{frame}.png" for frame in range(12)])
    frames = {image.image_id: frame for frame, image in images_by_frame(model).items()}
    chosen = frames_that_see_all(model, frames)
    for point in model.points3D.values():
        assert chosen & {frames[e.image_id] for e in point.track.elements}
    assert len(chosen) == 4, "points last three frames"
