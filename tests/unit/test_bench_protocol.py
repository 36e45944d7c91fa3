"""The protocol of the paper: its file, its figures by hand, its tables, a whole small run."""

import json
import math
import re

import numpy as np
import pytest

from mvmatch.bench.protocol import protocol_cells, run_protocol
from mvmatch.bench.protocol_figures import adjacency, binned, write_figures
from mvmatch.bench.protocol_methods import METHODS
from mvmatch.bench.protocol_options import ProtocolOptions, load_protocol
from mvmatch.bench.protocol_page import protocol_page
from mvmatch.bench.protocol_report import write_protocol
from mvmatch.bench.protocol_summary import costs, summarise
from mvmatch.bench.protocol_tables import protocol_tables, tex
from mvmatch.bench.sampling import Sample
from mvmatch.errors import DataError

pytest.importorskip("cv2")
pytest.importorskip("pycolmap")


@pytest.fixture(scope="module")
def data(make_drive, tmp_path_factory):
    return make_drive(tmp_path_factory.mktemp("data") / "drive", 6)


@pytest.fixture(scope="module", autouse=True)
def without_superglue():
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("MVMATCH_SUPERGLUE", raising=False)
        yield


@pytest.fixture(scope="module")
def finished(data, tmp_path_factory):
    out = tmp_path_factory.mktemp("out")
    config = out / "tiny.toml"
    methods = 'methods = ["svt-paper", "superpoint-superglue"]'
    config.write_text(f"{methods}\ngaps = [1, 3]\nrepetitions = 2\n")
    return config, out, run_protocol(load_protocol(config), [data], out)


def row(gap, frame0, seed, inlier_ratio, pose_deg=1.0, sampson_px=0.5):
    return {
        "gap": gap, "frame0": frame0, "seed": seed, "matches": 100, "distinct": 80,
        "inlier_ratio": inlier_ratio, "sampson_px": sampson_px, "sampson_normalized": 1e-6,
        "rotation_deg": pose_deg, "translation_deg": pose_deg, "pose_deg": pose_deg,
    }  # fmt: skip


def result(**changes):
    stages = [
        {"name": "match", "begin_s": 5.0, "wall_s": 4.0, "cpu_s": 3.0},
        {"name": "verify", "begin_s": 9.0, "wall_s": 2.0, "cpu_s": 2.0},
    ]
    samples = [{"time_s": t, "cpu_s": c, "rss_mb": 100.0} for t, c in ((0.0, 0.0), (8.0, 5.0))]
    return {
        "sequence": "road", "method": "svt-paper", "error": None, "num_frames": 3,
        "encoding": {"seconds": 2.0, "cpu_seconds": 1.5, "num_bytes": 2000},
        "stages": stages, "reading": {"wall_s": 1.0, "cpu_s": 0.5}, "model": None,
        "rows": [row(1, 0, 0, 0.9)],
        "adjacency": {
            "keypoints": 50.0, "pairs": [[0, 1, 30, 20], [1, 2, 60, 40]], "linked": None,
        },
        "usage": {
            "begin_s": 4.0, "processors": 2, "samples": samples, "peak_rss_mb": 100.0,
        },
    } | changes  # fmt: skip


def failed(reason="not run: no hardware"):
    return result(
        method="nvenc-paper", error=reason, rows=[], stages=[], reading=None, encoding=None,
        adjacency=None, usage=None,
    )  # fmt: skip


def test_the_files_of_the_repository_are_what_the_paper_says(repository):
    paper = load_protocol(repository / "configs" / "paper.toml")
    ransac = paper.ransac
    assert (ransac.max_error, ransac.min_inlier_ratio, ransac.max_num_trials) == (4, 0.25, 10_000)
    assert paper.verification.mode == "all"
    assert all(method in METHODS for method in paper.methods)
    assert {"sift", "sift-exhaustive", "klt", "dis", "nvenc-paper"} < set(paper.methods)
    assert load_protocol(repository / "configs" / "default.toml").verification.max_sample == 2000


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gap = 1", "unknown option gap; there are: gaps"),
        ("[ransac]\nmax_err = 1", "unknown option ransac.max_err"),
        ("repetitions = 1.5", "repetitions must be a whole number, not 1.5"),
        ("repetitions = 0", "repetitions must be at least 1, not 0"),
        ("gaps = []", "gaps must hold numbers of frames from 1 on"),
        ('gaps = ["1"]', "gaps must be a list of whole numbers; it holds '1'"),
        ("methods = [1]", "methods must be a list of texts; it holds 1"),
        ("max_frames = 1", 'max_frames must be "off" or at least 2'),
        ("ransac = 4", "ransac is a table of options"),
        ("= 4", "is not valid TOML"),
    ],
)
def test_a_wrong_file_is_refused_with_its_key(tmp_path, text, message):
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(DataError, match=re.escape(message)):
        load_protocol(path)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(DataError, match=re.escape("none.toml cannot be read")):
        load_protocol(tmp_path / "none.toml")


def test_figures_are_medians_over_seeds_and_their_spread_is_that_of_single_seeds():
    rows = [
        row(1, 0, 0, 0.5), row(1, 0, 1, 0.9), row(1, 0, 2, 0.7),
        row(1, 1, 0, 0.3, sampson_px=math.nan), row(1, 1, 1, 0.3), row(1, 1, 2, 0.1),
        row(2, 0, 0, 1.0, pose_deg=math.inf), row(2, 0, 1, 1.0), row(2, 0, 2, 1.0),
    ]  # fmt: skip
    near, far = summarise([result(rows=rows)])
    assert near["pairs"] == 2
    assert near["inlier_ratio"] == pytest.approx((0.7 + 0.3) / 2)
    assert near["inlier_ratio_std"] == pytest.approx(np.std([0.4, 0.6, 0.4], ddof=1))
    assert near["sampson_px"] == pytest.approx(0.5)
    assert (far["gap"], far["inlier_ratio"], far["inlier_ratio_std"]) == (2, 1, 0)
    # One pair with 1 degree: recall rises to 1 at 1 degree and stays.
    assert far["auc_5"] == pytest.approx((0.5 + 4) / 5)
    assert far["auc_5_std"] == pytest.approx(np.std([0, 0.9, 0.9], ddof=1))
    # Three images: 90 matches, each in two of them.
    assert (near["matches_per_image"], near["inliers_per_image"]) == (60, 40)
    assert near["encoder"] == "svt"


def test_pairs_without_true_poses_have_no_area_and_single_seeds_no_spread():
    unknown = row(1, 0, 0, 0.9, pose_deg=math.nan)
    (found,) = summarise([result(rows=[unknown])])
    assert math.isnan(found["auc_5"])
    assert math.isnan(found["inlier_ratio_std"])
    known = row(1, 1, 0, 0.9, pose_deg=math.inf)
    assert summarise([result(rows=[unknown, known])])[0]["auc_5"] == 0


def test_what_reading_takes_is_shown_before_matching_and_not_twice():
    assert costs(result()) == {
        "encode": (2.0, 1.5), "match": (3.0, 2.5), "verify": (2.0, 2.0), "preprocess": (1.0, 0.5),
    }  # fmt: skip
    assert costs(failed()) == {}
    # Processors busy from reading to verification: (3 + 2) CPU s in (4 + 2) s.
    assert summarise([result()])[0]["cores"] == pytest.approx(5 / 6)


def test_a_method_without_figures_is_a_row_with_its_reason_in_every_table():
    tables = protocol_tables([result(), failed("not run: 100 % of_it")])
    assert [table.number for table in tables] == ["I", "II", "III", "IV"]
    for table in tables:
        assert table.rows[1] == ("road", "nvenc-paper", "not run: 100 % of_it")
        assert all(len(line) in {3, len(table.columns)} for line in table.rows)
        assert "| road | nvenc-paper | not run: 100 % of_it |" in table.markdown()
        latex = table.latex()
        assert r"not run: 100 \% of\_it" in latex
        assert latex.count("{") == latex.count("}")
        body = latex[latex.index(r"\midrule") : latex.index(r"\bottomrule")]
        first = next(line for line in body.splitlines() if "svt-paper" in line)
        assert first.count("&") == len(table.columns) - 1
    assert tex("a\\b~^") == r"a\textbackslash{}b\textasciitilde{}\textasciicircum{}"


def test_what_runs_on_no_sequence_for_one_reason_is_said_once_and_last():
    lane = {"sequence": "lane"}
    here, there = [result(), failed()], [result(**lane), failed() | lane]
    late = failed("not run: late") | lane

    last = ("all", "nvenc-paper", "not run: no hardware")
    for table in protocol_tables([*here, *there]):
        assert [row[:2] for row in table.rows[:2]] == [("road", "svt-paper"), ("lane", "svt-paper")]
        assert table.rows[2:] == (last,)
    for table in protocol_tables([*here, result(**lane), late]):
        assert table.rows[1] == ("road", *last[1:])
        assert table.rows[3] == ("lane", "nvenc-paper", "not run: late")


def test_a_curve_of_averages_keeps_the_cpu_time():
    generator = np.random.default_rng(0)
    times, used = (np.cumsum(generator.uniform(0.1, 0.3, 500)) for _ in range(2))
    samples = [
        Sample(time_s=float(t), cpu_s=float(c), rss_mb=1) for t, c in zip(times, used, strict=True)
    ]
    middles, cores = binned(samples)
    step = middles[1] - middles[0]
    assert len(middles) == 80
    assert (cores * step).sum() == pytest.approx(used[-1] - used[0])
    assert len(binned(samples[:1])[0]) == 0


def test_adjacency_is_symmetric_and_figures_have_the_width_of_a_column(tmp_path):
    before, after = adjacency(result())
    assert before.tolist() == [[0, 30, 0], [30, 0, 60], [0, 60, 0]]
    assert after[2, 1] == after[1, 2] == 40

    chained = result(adjacency=result()["adjacency"] | {"linked": [[0, 2, 70]]})
    before, after = adjacency(chained)
    assert before.tolist() == [[0, 0, 70], [0, 0, 0], [70, 0, 0]]
    assert after[2, 1] == 40

    made = write_figures([result(), failed()], tmp_path)
    names = {path.name for path in made}
    stems = ("cpu-road", "errors-road", "adjacency-road-svt-paper")
    assert names == {f"{stem}.{kind}" for stem in stems for kind in ("png", "svg")}
    for path in made:
        if path.suffix == ".png":
            assert int.from_bytes(path.read_bytes()[16:20], "big") == 1050  # 3.5 inches of 300


def test_the_page_asks_for_nothing_from_elsewhere(tmp_path):
    results = [result(), failed("not run: <b>")]
    made = write_figures(results, tmp_path)
    page = protocol_page(protocol_tables(results), made, ProtocolOptions(repetitions=3))
    assert "not run: &lt;b&gt;" in page
    assert page.count("data:image/png;base64,") == 3
    assert re.findall(r'(?:src|href)="(?!data:)', page) == []
    assert "http" not in page.replace("http-equiv", "")
    assert "<th>seeds</th><td>0, 1, 2</td>" in page


def test_the_page_opens_in_a_browser_without_complaint_and_fits(browser, tmp_path):
    results = [result(), failed("not run: <b>"), failed("x" * 300)]
    made = write_figures(results, tmp_path)
    page = tmp_path / "bench.html"
    tables = protocol_tables(results)
    page.write_text(protocol_page(tables, made, ProtocolOptions(name="small")), encoding="utf-8")
    for width in (360, 1200):
        found = browser.visit(page, size=(width, 800))
        assert found.title == "Protocol small"
        assert (found.complaints, found.requests, found.broken, found.overflow) == ((), (), (), 0)
    for words in ("Table IV: Encoders", "not run: <b>", "CPU over time", "How it was made"):
        assert words in found.text, words


def test_what_is_there_is_not_drawn_again_until_something_changes(tmp_path):
    options = ProtocolOptions(name="small")
    made = write_protocol([result()], options, tmp_path)
    assert all(path.exists() for path in made)
    page = tmp_path / "bench.html"
    page.write_text("mine")
    assert write_protocol([result()], options, tmp_path) == made
    assert page.read_text() == "mine"

    write_protocol([result(), failed()], options, tmp_path)
    assert "Protocol small" in page.read_text()
    page.unlink()
    write_protocol([result(), failed()], options, tmp_path)
    assert page.exists()

    # What cannot run is tried in every run, and is the same but for the time.
    page.write_text("mine")
    write_protocol([result(), failed() | {"mvmatch": {"created": "later"}}], options, tmp_path)
    assert page.read_text() == "mine"


def test_a_whole_run_has_figures_for_what_runs_and_reasons_for_the_rest(finished):
    vectors, absent = finished[2]
    assert vectors["error"] is None
    assert [stage["name"] for stage in vectors["stages"]][:3] == ["match", "verify", "map"]
    assert vectors["model"]["registered"] == vectors["num_frames"] == 6
    assert vectors["model"]["ate_percent"] < 1
    assert len(vectors["rows"]) == (5 + 3) * 2
    assert {each["seed"] for each in vectors["rows"]} == {0, 1}
    assert all(each["inlier_ratio"] > 0.8 for each in vectors["rows"])
    pairs = np.array(vectors["adjacency"]["pairs"])
    assert (pairs[:, 3] <= pairs[:, 2]).all()
    assert (pairs[:, 0] < pairs[:, 1]).all()
    linked = np.array(vectors["adjacency"]["linked"])
    assert {tuple(pair) for pair in linked[:, :2]} >= {(frame, frame + 1) for frame in range(5)}
    assert len(linked) < len(pairs)  # what tracks are for
    gap1 = {each["frame0"]: each["matches"] for each in vectors["rows"] if each["gap"] == 1}
    assert {int(i): int(n) for i, j, n, _ in pairs if j == i + 1} == gap1
    assert absent["error"].startswith("not run: ")
    assert absent["rows"] == []


def test_a_second_run_keeps_what_is_there_and_the_verb_writes_everything(data, finished, capsys):
    import pyarrow.parquet as pq

    from mvmatch.cli import main

    config, out, _ = finished
    assert main(["bench", str(config), "--data", str(data), "-o", str(out)]) == 0
    told = capsys.readouterr()
    assert "[1/2] drive svt-paper: kept" in told.err
    assert "## Table I: Structure from motion" in told.out
    summary = pq.read_table(out / "results.parquet").to_pylist()
    assert [(each["method"], each["gap"]) for each in summary] == [
        ("svt-paper", 1), ("svt-paper", 3), ("superpoint-superglue", None),
    ]  # fmt: skip
    assert pq.read_table(out / "pairs.parquet").num_rows == 16
    for name in ("tables.md", "tables.tex", "bench.html", "figures/cpu-drive.svg"):
        assert (out / name).stat().st_size > 0

    words = ["bench", "paper", str(config), "--data", str(data), "-o", str(out), "--json"]
    assert main(words) == 0
    assert len(json.loads(capsys.readouterr().out)["cells"]) == 2


def test_what_takes_too_long_is_a_row_and_other_settings_another_result(data, tmp_path):
    options = ProtocolOptions(methods=("klt",), timeout_s=0.01)
    (late,) = run_protocol(options, [data], tmp_path)
    assert late["error"] == "preparing: stopped after 0.01 s"

    def key(**changes):
        values = {"methods": ("klt",), **changes}
        return protocol_cells(ProtocolOptions(**values), [data], tmp_path)[0].key

    assert key() == key(name="other", timeout_s=5.0)
    assert key() != key(repetitions=2)
    assert key() != key(methods=("dis",))
    with pytest.raises(DataError, match="no method magic; there are svt-default"):
        key(methods=("magic",))
