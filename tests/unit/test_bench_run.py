import json
import math

import numpy as np
import pytest

from mvmatch.bench import run
from mvmatch.bench.accuracy import AccuracyOptions
from mvmatch.bench.front_ends import FRONT_ENDS
from mvmatch.bench.report import caption, tables, write_tables
from mvmatch.bench.summary import average, by_draw, summarise
from mvmatch.errors import DataError

pytest.importorskip("cv2")
pytest.importorskip("pycolmap")


@pytest.fixture(scope="module")
def data(make_drive, tmp_path_factory):
    """A rendered drive in the layout of KITTI."""
    return make_drive(tmp_path_factory.mktemp("data") / "drive", 6)


def options_of(data, out, **changes):
    small = AccuracyOptions(gaps=(1, 2), draws=2)
    values = {"methods": ("klt", "svt-default"), "accuracy": small, **changes}
    return run.RunOptions(data=(data,), out=out, **values)


@pytest.fixture(scope="module")
def finished(data, tmp_path_factory):
    options = options_of(data, tmp_path_factory.mktemp("out"))
    return options, run.run_cells(options)


def test_every_cell_has_a_row_per_pair_and_draw(finished):
    _, results = finished

    assert [result["error"] for result in results] == [None, None]
    assert all(len(result["rows"]) == (5 + 4) * 3 for result in results)
    poses = [row["pose_deg"] for result in results for row in result["rows"] if row["draw"] < 0]
    assert np.median(poses) < 1.0


def test_a_second_run_keeps_what_is_there_and_computes_what_is_not(finished):
    options, results = finished
    cell = run.cells_of(options)[1]
    cell.path.unlink()
    states = []
    again = run.run_cells(options, tell=lambda cell, state: states.append((cell.method, state)))

    assert states == [("klt", "kept"), ("svt-default", "running"), ("svt-default", "done")]
    assert again[0] == json.loads(json.dumps(results[0]))
    assert again[1]["rows"] == results[1]["rows"]


def test_other_settings_other_data_and_other_code_make_another_cell(
    data, finished, tmp_path, monkeypatch
):
    options, _ = finished
    key = run.cells_of(options)[0].key
    other = options_of(data, options.out, max_frames=5)
    assert run.cells_of(other)[0].key != key

    (data / "note.txt").write_text("changed")
    assert run.cells_of(options)[0].key != key
    (data / "note.txt").unlink()
    assert run.cells_of(options)[0].key == key

    monkeypatch.setattr(run, "code_digest", lambda _: "another")
    assert run.cells_of(options)[0].key != key


def test_a_method_that_fails_is_a_result_with_its_reason(data, tmp_path, monkeypatch):
    def broken(clip):
        raise RuntimeError("out of luck")

    monkeypatch.setitem(FRONT_ENDS, "klt", broken)
    options = options_of(data, tmp_path, methods=("klt",))
    result = run.compute_cell(run.cells_of(options)[0])

    assert result["error"] == "RuntimeError: out of luck"
    assert "out of luck" in tables([result])
    paths = write_tables([result], options)
    from pyarrow import parquet

    assert parquet.read_table(paths[2]).to_pylist()[0]["error"] == "RuntimeError: out of luck"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"methods": ("magic",)}, "no method magic; there are"),
        ({"sequences": ("road",)}, "no sequence road; there are drive"),
        ({"sequences": ("drive+fog",)}, "no composition fog; there are"),
    ],
)
def test_names_that_are_not_known_are_refused_before_anything_runs(
    data, tmp_path, changes, message
):
    with pytest.raises(DataError, match=message):
        run.cells_of(options_of(data, tmp_path, **changes))


def test_a_pattern_stands_for_the_methods_it_matches_each_once(data, tmp_path):
    options = options_of(data, tmp_path, methods=("svt-default-no-e*", "svt-default-no-extend"))
    methods = [cell.method for cell in run.cells_of(options)]
    assert "svt-default-no-error-bound" in methods
    assert methods.count("svt-default-no-extend") == 1
    assert "svt-default" not in methods


def test_a_composed_sequence_is_composed_before_it_is_cut_to_length(data):
    assert len(run.open_sequence(data, "drive+repeats", 4)) == 4
    assert len(run.open_sequence(data, "drive+repeats", None)) == 7


def test_tables_name_both_halves_and_every_row_is_kept(finished):
    options, results = finished
    paths = write_tables(results, options)
    text = paths[0].read_text()
    from pyarrow import parquet

    assert "reporting: " in text
    assert "tuning: " in text
    assert parquet.read_table(paths[2]).num_rows == sum(len(each["rows"]) for each in results)
    document = json.loads(paths[1].read_text())
    assert document["machine"]["processors"] > 0
    assert "rows" not in document["cells"][0]


def row(draw, frame0=0, **values):
    return {"gap": 1, "frame0": frame0, "draw": draw, "pose_deg": 0.5, **values}


def cell(sequence, method, rows, error=None):
    return {"sequence": sequence, "method": method, "rows": rows, "error": error}


def test_the_spread_is_that_of_the_draws_and_the_value_that_of_all_points():
    rows = [row(draw, within_1px=share) for draw, share in ((-1, 0.9), (0, 0.8), (1, 0.6))]
    (found,) = summarise([cell("drive", "klt", rows)])

    assert found.measures["within_1px"].value == 0.9
    assert found.measures["within_1px"].spread == pytest.approx(math.sqrt(0.02))


def test_pairs_give_the_mean_of_their_shares_and_the_median_of_their_medians():
    values = [(1.0, 0.1), (0.5, 0.2), (math.nan, math.inf)]
    rows = [
        row(-1, frame0=frame, within_1px=share, median_px=error)
        for frame, (share, error) in enumerate(values)
    ]
    reduced = by_draw(rows)

    assert reduced["within_1px"].tolist() == [0.75]
    assert reduced["median_px"].tolist() == [0.2]
    assert np.isnan(reduced["along_px"]).all()
    # Three errors of 0.5: up to a third at 0.5 degrees, then all of it, level up to 1.
    assert reduced["auc_1"].tolist() == pytest.approx([0.5 * (1 / 3) / 2 + 0.5])


def test_an_average_leaves_out_sequences_that_a_method_failed_on_and_composed_ones():
    # street_drive, room_handheld and fox belong to one half.
    results = [
        cell(sequence, method, [row(-1, within_1px=share)])
        for sequence, method, share in (
            ("street_drive", "a", 0.2), ("street_drive", "b", 0.4), ("room_handheld", "a", 0.4),
            ("room_handheld", "b", 0.8), ("street_drive+pan", "a", 1), ("street_drive+pan", "b", 1),
            ("fox", "a", 1.0),
        )
    ]  # fmt: skip
    results.append(cell("fox", "b", [], error="crashed"))
    found = {each.method: each for each in average(results, "reporting")}

    assert found["a"].sequences == ("street_drive", "room_handheld")
    assert found["a"].measures["within_1px"].value == pytest.approx(0.3)
    assert found["b"].measures["within_1px"].value == pytest.approx(0.6)
    assert average(results, "tuning") == []
    assert "not every method has a result: fox." in caption(results, "reporting")


def test_the_verb_prints_the_tables_and_says_what_failed(data, tmp_path, capsys):
    from mvmatch.cli import main

    words = ["bench", "accuracy", "--data", str(data), "-o", str(tmp_path), "--methods", "klt"]
    assert main([*words, "--frames", "3", "--draws", "0"]) == 0
    assert "| 1 | klt |" in capsys.readouterr().out
    assert (tmp_path / "accuracy.parquet").is_file()
    assert main([*words[:-1], "magic"]) == 1
    assert "no method magic" in capsys.readouterr().err
