"""A run that was stopped goes on where it was; what depends on nothing that changed is kept."""

from __future__ import annotations

import dataclasses
import errno
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

pytest.importorskip("pycolmap")

import pycolmap

from mvmatch import outputs, pipeline, products
from mvmatch.cli import main
from mvmatch.config import RunOptions, from_mapping
from mvmatch.errors import DataError
from mvmatch.pipeline import STAGES, Run, reconstruct_video
from mvmatch.refine import RefineOptions
from mvmatch.sfm import write_model
from mvmatch.stages import Stage
from mvmatch.tracks import TrackOptions
from mvmatch.work import FOLDER, open_work

if TYPE_CHECKING:
    from collections.abc import Callable

    from _pytest.capture import CaptureFixture

CAMERA = "PINHOLE,260.48,260.48,176,100"
"""Of drive.ivf."""
DENSE = RunOptions(track=TrackOptions.preset("dense"), refine=RefineOptions(when="never"))
TAKING_PART = ["encode", "match", "movers", "database", "masks", "map", "densify"]
"""Stages of :func:`full_run`."""


def full_run(clip: Path, out: Path, **changed: Any) -> Run:
    """Run with every stage but those that need OpenCV or a failure."""
    words: dict[str, Any] = {"camera": CAMERA, "options": DENSE, "reencode": True, "masks": True}
    return reconstruct_video(clip, out, **words | changed)


def titles(names: list[str]) -> list[str]:
    return [stage.title for stage in STAGES if stage.name in names]


def names_made(run: Run) -> list[str]:
    """Stages that ran, and were not taken from before."""
    by_title = {stage.title: stage.name for stage in STAGES}
    return [by_title[cost["name"]] for cost in run.data["stages"] if not cost["reused"]]


def patch(
    monkeypatch: pytest.MonkeyPatch, name: str, make: Callable[[Stage, Any, Path], Any]
) -> None:
    """Replace what one stage does."""
    changed = tuple(
        dataclasses.replace(stage, make=lambda state, folder, s=stage: make(s, state, folder))
        if stage.name == name
        else stage
        for stage in STAGES
    )
    monkeypatch.setattr(pipeline, "STAGES", changed)


def facts(run: Run) -> dict[str, Any]:
    """The report without what differs from run to run."""
    stored = json.loads((run.out / "report.json").read_text())
    stored["input"]["encoding"] |= {"seconds": 0, "cpu_seconds": 0}
    return {
        key: value
        for key, value in stored.items()
        if key not in {"mvmatch", "stages", "peak_rss_mb"}
    }


def files(folder: Path) -> set[str]:
    return {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_file() and FOLDER not in path.parts
    }


@pytest.fixture(scope="module")
def clip(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copy2(data / "drive.ivf", tmp_path_factory.mktemp("clip")))


@pytest.fixture(scope="module")
def whole(clip: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run that nothing disturbed."""
    return full_run(clip, tmp_path_factory.mktemp("whole") / "out")


@pytest.fixture
def copied(whole: Run, tmp_path: Path) -> Path:
    """Its folder, for a second run."""
    return Path(shutil.copytree(whole.out, tmp_path / "copied"))


def test_a_finished_run_has_nothing_left_to_do(whole: Run, clip: Path, copied: Path) -> None:
    assert names_made(whole) == TAKING_PART
    assert whole.reused == ()
    again = full_run(clip, copied)
    assert names_made(again) == []
    assert list(again.reused) == titles(TAKING_PART)
    assert facts(again) == facts(whole)
    assert files(again.out) == files(whole.out)


@pytest.mark.parametrize(
    ("name", "error"),
    [*((name, RuntimeError) for name in TAKING_PART), ("map", KeyboardInterrupt)],
)
def test_an_interrupted_run_goes_on_at_the_stage_where_it_was(
    name: str,
    error: type[BaseException],
    whole: Run,
    clip: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = tmp_path / "out"

    def stop(stage: Stage, state: Any, folder: Path) -> Any:
        stage.make(state, folder)  # its files are there, but it has not ended
        raise error("stopped")

    patch(monkeypatch, name, stop)
    with pytest.raises(error):
        full_run(clip, out)
    finished = TAKING_PART[: TAKING_PART.index(name)]
    assert files(out) == set() if out.exists() else not finished

    monkeypatch.undo()
    run = full_run(clip, out)
    assert list(run.reused) == titles(finished)
    assert facts(run) == facts(whole)
    assert files(out) == files(whole.out)
    one, other = (each.model.reconstruction for each in (run, whole))
    for image_id in one.reg_image_ids():
        poses = [model.image(image_id).cam_from_world().matrix() for model in (one, other)]
        assert (poses[0] == poses[1]).all()


AFTER_MATCH = TAKING_PART[2:]


@pytest.mark.parametrize(
    ("changed", "again"),
    [
        ({"encode": {"quality": 32}}, TAKING_PART),
        ({"track": {"min_length": 4}}, TAKING_PART[1:]),
        ({"footage": {"shots": {"still": 0.3}}}, TAKING_PART[1:]),
        ({"read": {"threads": 1}}, []),
        ({"refine": {"num_neighbors": 10}}, []),
        ({"movers": {"min_weight": 0.4}}, AFTER_MATCH),
        ({"verification": {"mode": "trust"}}, ["database", "map", "densify"]),
        ({"mapper": {"max_attempts": 3}}, ["map", "densify"]),
        ({"densify": {"min_angle": 2.0}}, ["densify"]),
    ],
)
def test_a_changed_option_repeats_what_depends_on_it_and_nothing_else(
    changed: dict[str, Any], again: list[str], clip: Path, copied: Path
) -> None:
    options = from_mapping(changed, DENSE)
    assert names_made(full_run(clip, copied, options=options)) == again


def test_refined_tracks_are_kept_beside_those_they_were_made_from(clip: Path, copied: Path) -> None:
    pytest.importorskip("cv2")
    refined = from_mapping({"refine": {"when": "always"}}, DENSE)
    first = full_run(clip, copied, options=refined)
    assert names_made(first) == ["refine", *AFTER_MATCH]
    again = full_run(clip, copied, options=refined)
    assert names_made(again) == []
    assert facts(again) == facts(first)
    for name in ("tracks", "further"):
        kept, made = (getattr(each.match, name) for each in (again, first))
        np.testing.assert_array_equal(kept.xy, made.xy)
    assert names_made(full_run(clip, copied)) == AFTER_MATCH


def test_tracks_that_close_loops_are_kept_beside_those_of_vectors(clip: Path, copied: Path) -> None:
    # The street is seen again from farther along it.
    looking = from_mapping({"loops": {"matcher": "sift", "min_apart": 12}}, DENSE)
    first = full_run(clip, copied, options=looking)
    assert names_made(first) == ["loops", *AFTER_MATCH]
    assert first.match.loops
    assert first.data["loops"] == [list(pair) for pair in first.match.loops]
    matches = {(i, j): count for i, j, count in first.data["adjacency_after"]}
    assert all(matches[pair] > 0 for pair in first.match.loops)
    again = full_run(clip, copied, options=looking)
    assert names_made(again) == []
    assert facts(again) == facts(first)
    plain = full_run(clip, copied)
    assert names_made(plain) == AFTER_MATCH
    assert plain.data["loops"] is None


def test_another_camera_leaves_the_tracks(clip: Path, copied: Path) -> None:
    run = full_run(clip, copied, camera="PINHOLE,260.5,260.5,176,100")
    assert names_made(run) == AFTER_MATCH


def test_masks_come_and_go_without_the_model(clip: Path, copied: Path) -> None:
    assert names_made(full_run(clip, copied, masks=False)) == []
    assert not (copied / outputs.MASKS).exists()
    assert names_made(full_run(clip, copied)) == ["masks"]
    assert (copied / outputs.MASKS).is_dir()


def test_options_that_only_encoding_has_do_not_matter_to_av1(clip: Path, tmp_path: Path) -> None:
    words: dict[str, Any] = {"reencode": False, "masks": False}
    full_run(clip, tmp_path, **words)
    other = from_mapping({"encode": {"quality": 32}}, DENSE)
    assert names_made(full_run(clip, tmp_path, options=other, **words)) == []


def test_another_input_begins_anew(clip: Path, copied: Path, tmp_path: Path) -> None:
    touched = Path(shutil.copy2(clip, tmp_path))
    assert names_made(full_run(touched, copied)) == TAKING_PART
    os.utime(touched, (0, 0))
    assert names_made(full_run(touched, copied)) == TAKING_PART


def test_a_fresh_run_uses_nothing(clip: Path, copied: Path) -> None:
    assert names_made(full_run(clip, copied, fresh=True)) == TAKING_PART


@pytest.mark.parametrize("record", ["", "{}", "[1]", '{"key": 1, "files": {}}'])
def test_a_record_that_makes_no_sense_is_not_used(record: str, clip: Path, copied: Path) -> None:
    (copied / FOLDER / "masks" / "stage.json").write_text(record)
    assert names_made(full_run(clip, copied)) == ["masks"]


def test_a_product_that_somebody_changed_is_made_anew(clip: Path, copied: Path) -> None:
    database = copied / FOLDER / "database" / outputs.DATABASE
    with database.open("ab") as file:
        file.write(b"more")
    assert names_made(full_run(clip, copied)) == ["database"]


def test_a_stage_is_added_by_an_entry_in_the_list(
    clip: Path, copied: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def shift(state: Any, folder: Path) -> dict[str, Any]:
        model = state.model.reconstruction
        model.transform(pycolmap.Sim3d(scale=2.0))
        write_model(model, folder / outputs.MODEL)
        return {"scale": 2.0}

    def load(state: Any, folder: Path, facts: dict[str, Any]) -> None:
        state.model = products.with_models(state.model, folder / outputs.MODEL)

    added = Stage(
        name="scale",
        title="scale",
        needs=("map",),
        depends=lambda _: None,
        make=shift,
        load=load,
    )
    until_map = STAGES[: [stage.name for stage in STAGES].index("map") + 1]
    monkeypatch.setattr(pipeline, "STAGES", (*until_map, added))
    first = full_run(clip, copied)
    assert [cost["name"] for cost in first.data["stages"] if not cost["reused"]] == ["scale"]
    kept = copied / FOLDER / "scale" / outputs.MODEL / "0" / "images.bin"
    assert kept.read_bytes() == (copied / outputs.MODEL / "0" / "images.bin").read_bytes()
    again = full_run(clip, copied)
    assert again.reused[-1] == "scale"
    points = [len(each.model.reconstruction.points3D) for each in (first, again)]
    assert points[0] == points[1] > 0


KILLED = """
import os, signal, sys
from mvmatch import outputs, pipeline
from mvmatch.cli import main

def kill(*_):
    os.kill(os.getpid(), signal.SIGKILL)

{patch}
main(["run", sys.argv[1], "-o", sys.argv[2], "--camera", sys.argv[3]])
"""
IN_A_STAGE = """
made = pipeline.stages.write_database
pipeline.stages.write_database = lambda *a, **k: (made(*a, **k), kill())
"""
PUBLISHING = "outputs._link = kill"


def killed(patch: str, clip: Path, out: Path) -> None:
    words = [sys.executable, "-c", KILLED.format(patch=patch), str(clip), str(out), CAMERA]
    ended = subprocess.run(words, check=False, capture_output=True)
    assert ended.returncode == -signal.SIGKILL, ended.stderr.decode()


@pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")
@pytest.mark.parametrize(("patch", "again"), [(IN_A_STAGE, ["database", "map"]), (PUBLISHING, [])])
def test_a_killed_run_leaves_a_folder_that_the_next_one_goes_on_with(
    patch: str, again: list[str], clip: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    killed(patch, clip, out)
    assert not (out / outputs.REPORT).exists()
    run = reconstruct_video(clip, out, camera=CAMERA)
    assert names_made(run) == again
    assert run.model.accepted
    assert sorted(path.name for path in (out / FOLDER).iterdir()) == [
        "database",
        "lock",
        "map",
        "match",
        "movers",
    ]


def test_results_of_an_older_run_stay_until_the_new_ones_are_there(
    clip: Path, copied: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = {name: (copied / name).read_bytes() for name in files(copied)}

    def stop(stage: Stage, state: Any, folder: Path) -> Any:
        raise RuntimeError("stopped")

    patch(monkeypatch, "map", stop)
    options = from_mapping({"track": {"min_length": 4}}, DENSE)
    with pytest.raises(RuntimeError, match="stopped"):
        full_run(clip, copied, options=options)
    assert {name: (copied / name).read_bytes() for name in files(copied)} == before


def test_a_full_disk_is_an_error_of_the_data_and_keeps_what_was_finished(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(stage: Stage, state: Any, folder: Path) -> Any:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder))

    patch(monkeypatch, "database", fail)
    with pytest.raises(DataError, match="No space left") as caught:
        full_run(clip, tmp_path)
    assert "encode, match, movers" in caught.value.__notes__[0]
    monkeypatch.undo()
    assert names_made(full_run(clip, tmp_path)) == TAKING_PART[3:]


LIMITED = """
import resource, signal, sys
from mvmatch.cli import main

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[4]),) * 2)
sys.exit(main(["run", sys.argv[1], "-o", sys.argv[2], "--camera", sys.argv[3]]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="limits of Unix")
@pytest.mark.parametrize("num_bytes", [5_000, 100_000, 200_000])
def test_writing_that_fails_anywhere_is_two_lines_and_never_half_a_result(
    num_bytes: int, clip: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    words = [sys.executable, "-c", LIMITED, str(clip), str(out), CAMERA, str(num_bytes)]
    ended = subprocess.run(words, check=False, capture_output=True, text=True)
    assert ended.returncode == 1, ended.stderr
    assert "Traceback" not in ended.stderr
    assert "error: cannot write" in ended.stderr
    assert not out.exists() or files(out) == set()
    assert reconstruct_video(clip, out, camera=CAMERA).model.accepted


def test_the_command_line_says_what_was_kept_and_what_was_reused(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: CaptureFixture[str]
) -> None:
    def stop(stage: Stage, state: Any, folder: Path) -> Any:
        raise KeyboardInterrupt

    words = ["run", str(clip), "-o", str(tmp_path), "--camera", CAMERA]
    patch(monkeypatch, "map", stop)
    assert main(words) == 130
    printed = capsys.readouterr().err
    assert "interrupted\nkept:  " in printed
    assert "database, match, movers" in printed
    monkeypatch.undo()
    assert main(words) == 0
    reused = next(line for line in capsys.readouterr().out.splitlines() if "reused" in line)
    assert "match, find movers, verify and write database" in reused
    assert main([*words, "--fresh"]) == 0
    assert "reused" not in capsys.readouterr().out


def test_two_runs_do_not_work_in_one_folder(clip: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with open_work(out), pytest.raises(DataError, match="another run is at work"):
        reconstruct_video(clip, out, camera=CAMERA)
    assert not out.exists()
