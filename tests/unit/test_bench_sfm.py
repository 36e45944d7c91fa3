"""The benchmark of whole runs: cells, verdicts, tables."""

import json
import math
import shutil

import numpy as np
import pytest

from mvmatch.bench import sfm
from mvmatch.bench.matches import Sample, drawn
from mvmatch.bench.run import open_sequence
from mvmatch.bench.sfm_judge import judge_model
from mvmatch.bench.sfm_methods import METHODS, Input, SiftRun, _colmap_options
from mvmatch.bench.sfm_report import count_draws, reference_of, sfm_tables, verdict
from mvmatch.errors import DataError

pytest.importorskip("cv2")
pycolmap = pytest.importorskip("pycolmap")


@pytest.fixture(scope="module")
def data(make_drive, tmp_path_factory):
    return make_drive(tmp_path_factory.mktemp("data") / "drive", 8)


def options_of(data, out, **changes):
    values = {"methods": ("sift-video", "svt-default"), "intrinsics": ("known",), **changes}
    return sfm.SfmOptions(data=(data,), out=out, **values)


@pytest.fixture(scope="module")
def finished(data, tmp_path_factory):
    options = options_of(data, tmp_path_factory.mktemp("out"), resamplings=1)
    return options, sfm.run_sfm(options)


def test_runs_of_both_kinds_give_models_with_what_they_cost(finished):
    _, results = finished
    assert [result["error"] for result in results] == [None, None]
    for result in results:
        assert result["run"]["accepted"]
        assert result["run"]["registered"] == result["total"] == 8
        assert result["model"]["ate_percent"] < 1
        assert result["model"]["focal_error_percent"] < 1
        assert 0 < result["model"]["distinct_points"] <= result["model"]["points"]
        assert result["model"]["cloud"] is None
        # The process costs more than the stages inside it.
        assert result["run"]["cpu_s"] > sum(stage["cpu_s"] for stage in result["run"]["stages"])
        assert [draw["draw"] for draw in result["draws"]] == [0]
        assert math.isfinite(result["draws"][0]["ate_percent"])
    sift, vectors = results
    assert sift["encoding"] is None
    assert vectors["encoding"]["seconds"] > 0
    assert vectors["encoding"]["cpu_seconds"] > 0


def test_a_model_without_a_single_point_is_judged_like_any_other(data, finished, tmp_path):
    options, _ = finished
    cell = sfm.sfm_cells(options)[1]
    model = pycolmap.Reconstruction(cell.work / "out" / "sparse" / "0")
    for key in list(model.points3D):
        model.delete_point3D(key)
    model.write(tmp_path)

    judged = judge_model(tmp_path, open_sequence(data, cell.sequence, None))

    assert (judged["points"], judged["observations"], judged["ba_cpu_s"]) == (0, 0, 0.0)
    assert judged["ate_percent"] < 1


def test_a_second_benchmark_keeps_results_and_another_judgement_keeps_runs(finished):
    options, results = finished
    states = []
    again = sfm.run_sfm(options, tell=lambda _, state: states.append(state))
    assert states == ["kept", "kept"]
    assert [each["key"] for each in again] == [each["key"] for each in results]

    other = options_of(options.data[0], options.out, methods=("svt-default",))
    (judged,) = sfm.run_sfm(other)
    assert judged["draws"] == []
    assert judged["run"] == json.loads(json.dumps(results[1]["run"]))


def test_more_draws_keep_those_that_are_judged(finished):
    options, results = finished
    base = {"methods": ("svt-default",), "out": options.out}
    (cell,) = sfm.sfm_cells(options_of(options.data[0], **base))
    kept = cell.work / "draws" / "0.json"
    marked = json.loads(kept.read_text()) | {"reasons": ["from the file"]}
    kept.write_text(json.dumps(marked))

    (more,) = sfm.run_sfm(options_of(options.data[0], resamplings=2, **base))
    assert [draw["draw"] for draw in more["draws"]] == [0, 1]
    assert more["draws"][0] == results[1]["draws"][0] | {"reasons": ["from the file"]}
    assert more["draws"][1]["ate_percent"] != more["draws"][0]["ate_percent"]


def test_the_verb_prints_tables_and_all_results_as_json(data, finished, capsys):
    from mvmatch.cli import main

    options, results = finished
    words = ["bench", "sfm", "--data", str(data), "-o", str(options.out), "--known"]
    words += ["--methods", "sift-video", "--resamplings", "1"]
    assert main(words) == 0
    text = capsys.readouterr().out
    assert "## drive, intrinsics known" in text
    assert "| sift-video | accepted | 8 of 8 |" in text
    assert main([*words, "--json"]) == 0
    (cell,) = json.loads(capsys.readouterr().out)["cells"]
    assert cell["run"]["registered"] == results[0]["run"]["registered"]
    assert (options.out / "sfm.json").is_file()
    without = [word for word in words if word != "--known"]
    assert main([*without, "--no-known", "--no-unknown"]) == 1


def test_other_settings_make_another_run_and_other_draws_another_result_alone(data, tmp_path):
    def keys(**changes):
        cell = sfm.sfm_cells(options_of(data, tmp_path, methods=("svt-fast",), **changes))[0]
        return cell.run_key, cell.key

    run, result = keys()
    assert keys() == (run, result)
    assert keys(max_frames=5)[0] != run
    assert keys(intrinsics=("unknown",))[0] != run
    assert keys(resamplings=3)[0] == run
    assert keys(resamplings=3)[1] != result


def test_a_method_that_fails_is_a_result_with_its_reason(data, tmp_path):
    options = options_of(data, tmp_path, methods=("svt-fast",), timeout_s=0.01)
    (result,) = sfm.run_sfm(options)
    assert result["error"] == "preparing: stopped after 0.01 s"
    assert "- svt-fast failed: preparing: stopped after 0.01 s" in sfm_tables([result])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"methods": ("magic",)}, "no method magic; there are svt-default"),
        ({"sequences": ("road",)}, "no sequence road; there are drive"),
        ({"intrinsics": ()}, "neither known nor unknown"),
    ],
)
def test_what_is_not_known_is_refused_before_anything_runs(data, tmp_path, changes, message):
    with pytest.raises(DataError, match=message):
        sfm.sfm_cells(options_of(data, tmp_path, **changes))


def test_a_draw_takes_the_matches_of_dropped_keypoints_out_and_verifies_the_rest(
    finished, tmp_path
):
    options, _ = finished
    (cell,) = sfm.sfm_cells(options_of(options.data[0], options.out, methods=("sift-video",)))
    path = tmp_path / "drawn.db"
    shutil.copyfile(cell.work / "out" / "database.db", path)
    with pycolmap.Database.open(path) as database:
        before = dict(zip(*database.read_all_matches(), strict=True))
        sizes = {i.image_id: database.num_keypoints_for_image(i.image_id)
                 for i in database.read_all_images()}  # fmt: skip
    METHODS["sift-video"]._drop(path, Sample(share=0.8, seed=3))
    with pycolmap.Database.open(path) as database:
        after = dict(zip(*database.read_all_matches(), strict=True))
        assert database.num_verified_image_pairs() > 0
    kept = {image: drawn(size, 0.8, 3, image) for image, size in sizes.items()}
    assert all(marks.sum() == round(0.8 * len(marks)) for marks in kept.values())
    for pair, matches in before.items():
        first, second = pycolmap.pair_id_to_image_pair(pair)
        expected = matches[kept[first][matches[:, 0]] & kept[second][matches[:, 1]]]
        assert np.array_equal(after.get(pair, np.empty((0, 2))), expected)


def test_known_intrinsics_are_held_and_unknown_ones_refined():
    for mapper in ("colmap", "video"):
        for refine in (False, True):
            found = _colmap_options(mapper, refine=refine)
            assert found.ba_refine_focal_length is refine
            assert found.ba_refine_extra_params is refine
            assert not found.ba_refine_principal_point


def test_without_a_camera_sift_starts_from_the_usual_prior(data, tmp_path):
    given = Input(path=data / "images", size=(320, 180), camera=None)
    method = SiftRun(mapper="video")
    method.run(given, tmp_path / "out")
    with pycolmap.Database.open(tmp_path / "out" / "database.db") as database:
        (camera,) = database.read_all_cameras()
    assert camera.mean_focal_length() == pytest.approx(1.2 * 320)
    assert not camera.has_prior_focal_length


def result(method, ate, *, registered=10, accepted=True, wall=1.0, draws=(), error=None):
    return {
        "sequence": "drive", "intrinsics": "known", "method": method, "error": error, "total": 10,
        "encoding": {"seconds": 1.0, "cpu_seconds": 3.0} if method.startswith("svt") else None,
        "run": {"accepted": accepted, "registered": registered, "wall_s": wall, "cpu_s": 2 * wall,
                "peak_rss_mb": None, "stages": []},
        "model": {"ate_percent": ate, "rpe": 0.1, "rpe_deg": 0.1, "focal_error_percent": 0.0,
                  "points": 5, "distinct_points": 4, "observations": 20, "track_length": 4.0,
                  "reprojection_px": 0.5, "ba_cpu_s": 0.1, "cloud": None},
        "draws": [{"accepted": math.isfinite(each), "ate_percent": each} for each in draws],
    }  # fmt: skip


def test_the_reference_is_sift_with_the_most_images_and_then_the_least_error():
    few = result("sift", 0.01, registered=5)
    many, better = result("sift-video", 0.3), result("sift-checked", 0.2)
    refused = result("sift-refused", math.inf, accepted=False)
    assert reference_of([few, many, better, refused, result("svt-fast", 0.0)]) is better
    assert reference_of([refused, result("svt-fast", 0.0)]) is None


def test_wrong_is_what_is_delivered_as_good_where_sift_shows_that_it_can_be_right():
    right, poor = result("sift", 0.05), result("sift", 0.5)
    assert verdict(result("svt-fast", 1.5), right) == "wrong"
    assert verdict(result("svt-fast", 1.5), poor) == "accepted"
    assert verdict(result("svt-fast", 1.5), None) == "accepted"
    assert verdict(result("svt-fast", 0.9), right) == "accepted"
    assert verdict(result("svt-fast", math.inf, accepted=False), right) == "refused"
    assert verdict(result("svt-fast", 1.5, error="crashed"), right) == "failed"
    drawn_thrice = result("svt-fast", 0.1, draws=(0.2, math.inf, 7.0))
    assert count_draws(drawn_thrice, right) == {"accepted": 1, "refused": 1, "wrong": 1}


def test_ratios_to_sift_are_shown_with_and_without_the_encoding():
    table = sfm_tables([result("sift", 0.05, wall=8.0), result("svt-fast", 0.1, wall=2.0)])
    costs = next(line for line in table.splitlines() if line.startswith("| svt-fast | 2.0 | 4.0 |"))
    # 8 / 2 and 16 / 4; with 1 s and 3 CPU s of encoding 8 / 3 and 16 / 7.
    assert costs.startswith("| svt-fast | 2.0 | 4.0 | 1.0 | 3.0 | 4.0 | 4.0 | 2.7 | 2.3 | 200 |")
    # 0.1 CPU s for an iteration of bundle adjustment over 20 observations.
    assert "| 100.0 | 5,000.0 |" in costs


def test_clouds_at_equal_completeness_stand_below_those_as_they_are():
    figures = {"num_points": 1200, "recall": 0.305, "accuracy": 0.01, "completeness": 0.03}
    figures |= {"chamfer": 0.02}
    worse = figures | {"num_points": 700, "recall": 0.3, "chamfer": 0.03}
    compared = {
        "sequence": "drive", "intrinsics": "known", "error": None, "reference": "sift",
        "rows": [{"method": "svt-fast", "equal": "recall", "own": figures, "sift": worse}],
    }  # fmt: skip
    results = [result("sift", 0.05), result("svt-fast", 0.1)]
    table = sfm_tables(results, [compared])
    row = "| svt-fast | recall | 1,200 | 700 | 30.5 | 30.0 | 0.0100 | 0.0100 | 0.0300 | 0.0300 |"
    assert f"{row} 0.0200 | 0.0300 |" in table
    failed = sfm_tables(results, [compared | {"error": "no memory", "rows": []}])
    assert "Clouds were not compared: no memory" in failed
    assert "equal completeness" not in sfm_tables(results)
