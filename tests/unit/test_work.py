"""Keys tell inputs and options apart; products are there whole or not at all."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from mvmatch import outputs
from mvmatch.errors import DataError
from mvmatch.tracks import TrackOptions
from mvmatch.work import FOLDER, digest, identity, open_work

if TYPE_CHECKING:
    from collections.abc import Callable


def fill(text: str) -> Callable[[Path], dict[str, Any]]:
    def write(folder: Path) -> dict[str, Any]:
        (folder / "inner").mkdir()
        (folder / "inner" / "product").write_text(text)
        return {"length": len(text)}

    return write


def test_a_product_is_found_under_its_key_alone(tmp_path: Path) -> None:
    with open_work(tmp_path) as work:
        made = work.make("match", "a", "match vectors", fill("tracks"))
        assert (made.facts, made.cost.name) == ({"length": 6}, "match vectors")
        assert work.find("match", "a") == made
        assert work.find("match", "b") is None
        assert work.find("map", "a") is None
    with open_work(tmp_path) as work:
        assert work.find("match", "a") == made


def test_a_stage_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    def fail(folder: Path) -> dict[str, Any]:
        (folder / "half").write_text("half a")
        raise ValueError("broken")

    with open_work(tmp_path) as work:
        made = work.make("match", "a", "match", fill("tracks"))
        with pytest.raises(ValueError, match="broken"):
            work.make("match", "b", "match", fail)
        assert work.find("match", "a") == made
        assert sorted(path.name for path in (tmp_path / FOLDER).iterdir()) == ["lock", "match"]


@pytest.mark.parametrize("change", ["longer", "older", "missing", "more"])
def test_a_product_with_other_files_than_were_written_is_none(change: str, tmp_path: Path) -> None:
    with open_work(tmp_path) as work:
        product = work.make("match", "a", "match", fill("tracks")).folder / "inner" / "product"
        if change == "longer":
            times = product.stat()
            product.write_text("tracks!")
            os.utime(product, ns=(times.st_atime_ns, times.st_mtime_ns))
        elif change == "older":
            os.utime(product, (0, 0))
        elif change == "missing":
            product.unlink()
        else:
            (product.parent / "another").touch()
        assert work.find("match", "a") is None


def test_a_folder_in_which_nothing_was_finished_is_gone(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), open_work(tmp_path / "out"):
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_run_left_is_removed(tmp_path: Path) -> None:
    (tmp_path / FOLDER / ".unfinished-x").mkdir(parents=True)
    with open_work(tmp_path) as work:
        work.make("match", "a", "match", fill("tracks"))
    assert sorted(path.name for path in (tmp_path / FOLDER).iterdir()) == ["lock", "match"]


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(DataError, match="file"), open_work(tmp_path / "file" / "out"):
        pass


def test_an_input_is_its_path_sizes_and_times(tmp_path: Path) -> None:
    first, folder = tmp_path / "a.ivf", tmp_path / "images"
    first.write_text("video")
    folder.mkdir()
    for name in ("1.png", "2.png"):
        (folder / name).write_text("image")
    before = identity(first), identity(folder)
    (folder / "notes.txt").write_text("no image")
    assert (identity(first), identity(folder)) == before
    (folder / "3.PNG").write_text("image")
    assert identity(folder) != before[1]
    (folder / "3.PNG").unlink()
    assert identity(folder) == before[1]
    os.utime(folder / "1.png", (0, 0))
    assert identity(folder) != before[1]
    moved = shutil.copy2(first, tmp_path / "b.ivf")
    assert identity(Path(moved)) != before[0]


def test_a_key_is_that_of_equal_options_and_no_others() -> None:
    options = TrackOptions.preset("default")
    assert digest("match", options) == digest("match", TrackOptions.preset("default"))
    assert digest("match", options) != digest("match", TrackOptions.preset("paper"))
    assert digest("match", options) != digest("map", options)
    with pytest.raises(TypeError, match="cannot depend on a object"):
        digest(object())


@pytest.mark.parametrize("links", [True, False])
def test_results_are_second_names_of_the_last_product_or_copies(
    links: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(self: Path, target: Path) -> None:
        raise PermissionError

    if not links:
        monkeypatch.setattr(Path, "hardlink_to", refuse)
    out = tmp_path / "out"
    stages = [tmp_path / name for name in ("match", "refine")]
    for stage in stages:
        (stage / outputs.MODEL / "0").mkdir(parents=True)
        (stage / outputs.MODEL / "0" / "images.bin").write_text(stage.name)
        (stage / "counts.npz").touch()
    (stages[0] / outputs.TRACKS).write_text("tracks")
    (out / FOLDER).mkdir(parents=True)
    (out / outputs.MASKS).mkdir()

    outputs.publish(stages, out)
    assert sorted(path.name for path in out.iterdir()) == [FOLDER, outputs.MODEL, outputs.TRACKS]
    assert (out / outputs.MODEL / "0" / "images.bin").read_text() == "refine"
    assert (out / outputs.TRACKS).read_text() == "tracks"
    assert (out / outputs.TRACKS).samefile(stages[0] / outputs.TRACKS) == links
    assert list((out / FOLDER).iterdir()) == []
