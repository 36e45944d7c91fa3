import numpy as np
import pytest

from mvmatch.errors import DataError
from mvmatch.export.masks import moving_cells, write_masks
from mvmatch.overlays import Overlays
from mvmatch.types import Tracks

av = pytest.importorskip("av")

SIZE = (100, 60)


def tracks():
    """A column of points at rest on the left, an object in the middle, in two pictures."""
    rest = [[(0, 12.0, y), (1, 12.0, y)] for y in (4.0, 20.0, 36.0, 52.0)]
    item = [[(0, x, 28.0), (1, x + 8.0, 28.0)] for x in (52.0, 60.0)]
    return Tracks.from_lists(*rest, *item), np.array([False] * 4 + [True] * 2)


def read(path):
    with av.open(str(path)) as picture:
        return next(picture.decode(video=0)).to_ndarray(format="gray")


def test_masks_have_the_names_and_the_size_that_colmap_expects_and_can_be_read(tmp_path):
    names = ["a.jpg", "left/b.png"]
    paths = write_masks(*tracks(), tmp_path / "masks", size=SIZE, image_names=names)
    assert [str(path.relative_to(tmp_path)) for path in paths] == [
        "masks/a.jpg.png",
        "masks/left/b.png.png",
    ]
    for path in paths:
        picture = read(path)
        assert picture.shape == (60, 100)
        assert set(np.unique(picture)) == {0, 255}


def test_a_mask_is_black_on_the_object_and_white_elsewhere(tmp_path):
    first, second = write_masks(*tracks(), tmp_path, size=SIZE, image_names=["a", "b"])
    assert read(first)[28, 52] == 0
    assert read(first)[28, 12] == read(first)[4, 60] == read(first)[28, 99] == 255
    assert read(second)[28, 68] == 0


def test_static_overlays_are_black_as_well(tmp_path):
    cells = np.zeros((1, 8, 13), bool)
    cells[0, 7, 12] = True
    overlays = Overlays(end=np.array([2]), cells=cells)
    (path,) = write_masks(
        Tracks.from_lists(),
        np.zeros(0, bool),
        tmp_path,
        size=SIZE,
        image_names=["a"],
        overlays=overlays,
    )
    picture = read(path)
    assert (picture[56:, 96:] == 0).all()
    assert (picture[:56] == 255).all()


def test_an_object_grows_until_it_meets_what_is_at_rest():
    rest, item = [(0, 12.0, 4.0), (1, 12.0, 4.0)], [(0, 28.0, 4.0), (1, 28.0, 4.0)]
    cells = moving_cells(Tracks.from_lists(rest, item), np.array([False, True]), 0, SIZE)
    assert np.flatnonzero(cells[0]).tolist() == [3, 4, 5]
    assert not cells[3:].any()


def test_a_picture_without_tracks_has_nothing_to_hide():
    assert not moving_cells(*tracks(), 7, SIZE).any()


def test_masks_that_cannot_be_written_are_an_error_of_the_user(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="Choose another place"):
        write_masks(*tracks(), tmp_path / "file", size=SIZE, image_names=["a"])
