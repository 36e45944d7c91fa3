"""Models on disk are those of the last run, and files of others stay."""

from __future__ import annotations

import shutil

import pytest

from mvmatch.cli import main
from mvmatch.errors import DataError
from mvmatch.export.colmap import write_database
from mvmatch.sfm import foreign_models, reconstruct, write_models
from mvmatch.types import Tracks

pycolmap = pytest.importorskip("pycolmap")

COLMAP = ["cameras.bin", "frames.bin", "images.bin", "points3D.bin", "rigs.bin"]


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def models(make_model):
    return [make_model(num_points=count) for count in (40, 30, 20)]


@pytest.fixture
def still(tmp_path):
    """Database of a camera that stands still: no model comes of it."""
    rows = [[(f, 20.0 + 20 * k, 30.0 + 15 * k) for f in range(5)] for k in range(25)]
    camera = pycolmap.Camera(model="PINHOLE", width=640, height=480, params=[500, 500, 320, 240])
    images = [f"{frame:06d}.png" for frame in range(5)]
    write_database(
        Tracks.from_lists(*rows), tmp_path / "still.db", camera=camera, image_names=images
    )
    return tmp_path / "still.db"


def test_of_more_models_of_an_earlier_run_none_is_left(models, tmp_path):
    assert [path.name for path in write_models(models, tmp_path)] == ["0", "1", "2"]
    write_models(models[2:], tmp_path)
    assert names(tmp_path) == ["0"]
    assert pycolmap.Reconstruction(tmp_path / "0").num_points3D() == 20
    assert names(tmp_path / "0") == sorted([*COLMAP, "mvmatch.txt"])
    write_models([], tmp_path)
    assert names(tmp_path) == []


def test_only_the_model_goes_from_a_folder_with_other_files(models, tmp_path):
    write_models(models, tmp_path)
    for number in (0, 1):
        (tmp_path / str(number) / "notes.md").write_text("mine")
    (tmp_path / "1" / "dense").mkdir()
    write_models(models[2:], tmp_path)
    assert names(tmp_path) == ["0", "1"]
    assert names(tmp_path / "1") == ["dense", "notes.md"]
    assert (tmp_path / "0" / "notes.md").read_text() == "mine"
    assert pycolmap.Reconstruction(tmp_path / "0").num_points3D() == 20
    assert foreign_models(tmp_path) == []


@pytest.mark.parametrize("kept", ["7", "01", "best"])
def test_a_model_that_was_copied_is_its_owners(kept, models, tmp_path):
    write_models(models[:2], tmp_path)
    shutil.copytree(tmp_path / "1", tmp_path / kept)
    write_models(models[2:], tmp_path)
    assert names(tmp_path) == sorted(["0", kept])
    assert pycolmap.Reconstruction(tmp_path / kept).num_points3D() == 30


@pytest.mark.parametrize("number", ["0", "1"])
@pytest.mark.parametrize("text", [False, True])
def test_models_of_another_program_are_neither_replaced_nor_joined(
    number, text, models, still, tmp_path
):
    folder = tmp_path / "sfm" / number
    folder.mkdir(parents=True)
    (models[0].write_text if text else models[0].write_binary)(folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(DataError, match=rf"sfm.{number} holds a model that mvmatch did not write"):
        reconstruct(still, tmp_path / "sfm")
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_where_no_model_holds_now_that_of_an_earlier_run_is_not_left(models, still, tmp_path):
    write_models(models[:2], tmp_path / "sfm")
    assert main(["reconstruct", str(still), str(tmp_path / "sfm")]) == 1
    assert names(tmp_path / "sfm") == []


def test_models_of_an_earlier_run_stay_where_the_database_is_none(models, tmp_path):
    write_models(models[:2], tmp_path / "sfm")
    (tmp_path / "no.db").write_text("text")
    assert main(["reconstruct", str(tmp_path / "no.db"), str(tmp_path / "sfm")]) == 1
    assert names(tmp_path / "sfm") == ["0", "1"]
