"""The report says what happened, opens offline, and survives missing facts."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from mvmatch.report import write_report
from mvmatch.report.chart import MAX_HEATMAP, _cells, heatmap, histogram
from mvmatch.types import TwoViewScore

if TYPE_CHECKING:
    from pathlib import Path

    from browser import Browser

FRAMES = 24


def facts() -> dict[str, Any]:
    """What a run would hand over, NumPy values and dataclasses included."""
    rng = np.random.default_rng(0)
    before = [[frame, frame + 1, 2400] for frame in range(FRAMES - 1)]
    after = {
        (i, j): int(4000 * 0.7 ** (j - i)) for i in range(FRAMES) for j in range(i + 1, FRAMES)
    }
    scores = [
        TwoViewScore(
            frame0=i,
            frame1=j,
            model="E",
            num_correspondences=after[i, j],
            num_inliers=int(after[i, j] * 0.96),
            inlier_ratio=float(np.clip(rng.normal(0.97, 0.02), 0, 1)),
            median_sampson_px=float(rng.gamma(3, 0.03) * (1 + 0.1 * (j - i))),
            median_sampson_normalized=1e-7,
        )
        for i in range(FRAMES)
        for j in range(i + 1, min(FRAMES, i + 11))
    ]
    return {
        "schema_version": 2,
        "mvmatch": {
            "version": "0.1.0",
            "created": "2026-01-01T12:00:00+00:00",
            "command": ["mvmatch", "run", "clip.mp4"],
            "versions": {"python": "3.11", "numpy": "2.3"},
        },
        "input": {
            "path": "/data/drive/<clip> & more",
            "kind": "frames",
            "width": 1241,
            "height": 376,
            "num_frames": FRAMES,
            "frame_rate": 10.0,
            "codec": "av1",
            "encoding": {
                "encoder": "svt",
                "settings": "preset=8 crf=30",
                "num_frames": FRAMES,
                "num_bytes": 1040217,
                "seconds": 2.7,
                "cpu_seconds": 4.1,
            },
        },
        "camera": {
            "source": "1.2 times the larger side",
            "is_prior": True,
            "model": "SIMPLE_PINHOLE",
            "params": [1489.2, 620.5, 188.0],
            "final_params": None,
        },
        "options": {"preset": "default", "track": {"min_length": 3}},
        "reference_structure": {
            "coded_frames": FRAMES,
            "shown_frames": FRAMES,
            "hidden_frames": 0,
            "repeated_frames": 0,
            "key_frames": [0],
            "intra_frames": [0],
            "num_vectors": 55_000,
            "vectors_per_distance": {"1": 54_000, "2": 1_000},
            "area_share_per_distance": {"-1": 0.01, "1": 0.96, "2": 0.03},
            "share_to_previous": 0.977,
            "inter_area_share": 0.47,
            "median_vectors_per_frame": 2400.0,
        },
        "stages": [
            {"name": "encode", "wall_s": 2.7, "cpu_s": 4.1, "peak_rss_mb": 200.0},
            {"name": "motion", "wall_s": 0.31, "cpu_s": 0.3, "peak_rss_mb": 210.0},
            {"name": "tracks", "wall_s": 0.12, "cpu_s": 0.12, "peak_rss_mb": 220.0},
            {"name": "verification", "wall_s": 1.4, "cpu_s": 2.2, "peak_rss_mb": 260.0},
            {"name": "mapping", "wall_s": 9.4, "cpu_s": 14.2, "peak_rss_mb": 410.0},
        ],
        "peak_rss_mb": np.float64(410.0),
        "matches": {
            "num_tracks": 9_800,
            "num_observations": 45_000,
            "mean_track_length": 4.6,
            "max_track_length": 21,
            "keypoints_per_image": rng.integers(1500, 2100, FRAMES),
            "matches_per_image": [9000] * FRAMES,
            "num_pairs": 200,
            "num_estimated_pairs": 60,
            "num_verified_pairs": 200,
            "num_matches": sum(after.values()),
            "num_inliers": int(0.97 * sum(after.values())),
        },
        "adjacency_before": before,
        "adjacency_after": np.array([(i, j, count) for (i, j), count in after.items()]),
        "scores": scores,
        "model": {
            "mapper": "incremental",
            "accepted": True,
            "reasons": [],
            "registered": FRAMES,
            "total": FRAMES,
            "num_points": 9_120,
            "mean_reprojection_error": 0.31,
            "mean_track_length": 4.4,
            "attempts": [{"seed": 0}, {"seed": 1}],
        },
        "accuracy": {"ate_percent": 0.07, "path_length": 14.4, "ate": 0.01},
        "damage": None,
        "warnings": ["tracks are cut at the key frames 8"],
    }


class Outline(HTMLParser):
    """Checks that tags nest, and collects headings and addresses."""

    VOID = frozenset({"meta", "br", "rect", "line", "image"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.headings: list[str] = []
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [v or "" for k, v in attrs if k in ("src", "href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag("image" if tag else tag, attrs)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("h1", "h2"):
            self.headings.append(data)


def outline(path: Path) -> Outline:
    parsed = Outline()
    parsed.feed(path.read_text("utf-8"))
    assert parsed.open == []
    return parsed


def test_the_json_holds_the_facts_as_plain_values(tmp_path: Path) -> None:
    write_report(tmp_path, facts())
    stored = json.loads((tmp_path / "report.json").read_text("utf-8"))
    assert stored["model"]["registered"] == FRAMES
    assert stored["peak_rss_mb"] == 410.0
    assert stored["adjacency_before"][:2] == [[0, 1, 2400], [1, 2, 2400]]
    assert stored["scores"][0]["model"] == "E"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["report.html", "report.json"]


def test_a_number_that_does_not_exist_becomes_null(tmp_path: Path) -> None:
    write_report(tmp_path, {"model": {"num_points": float("nan")}})
    assert json.loads((tmp_path / "report.json").read_text())["model"]["num_points"] is None


def test_the_page_has_a_section_for_every_question_and_asks_nobody(tmp_path: Path) -> None:
    page = outline(write_report(tmp_path, facts()))
    assert page.headings == [
        "drive/<clip> & more",
        "Warnings",
        "Accuracy against the truth",
        "Input and camera",
        "Reference structure",
        "Tracks and matches",
        "Which images are connected",
        "Two-view geometry",
        "Model",
        "Cost",
        "Options",
    ]
    assert all(address.startswith("data:image/png;base64,") for address in page.addresses)
    text = (tmp_path / "report.html").read_text("utf-8")
    assert "<script" not in text
    assert "url(http" not in text
    for figure in ("24 / 24", "9,120", "0.31 px", "0.070 %", "13.9 s", "410 MB", "SIMPLE_PINHOLE"):
        assert figure in text, figure


@pytest.mark.parametrize("width", [360, 1200])
def test_the_page_opens_in_a_browser_without_complaint_and_fits(
    browser: Browser, tmp_path: Path, width: int
) -> None:
    found = browser.visit(write_report(tmp_path, facts()), size=(width, 800))
    assert found.title == "drive/<clip> & more - mvmatch report"
    assert (found.complaints, found.requests, found.broken, found.overflow) == ((), (), (), 0)
    for words in ("All 24 images registered", "Two-view geometry", "0.070 %", "keypoints"):
        assert words in found.text, words


@pytest.mark.parametrize("missing", sorted(facts()))
def test_the_page_survives_a_missing_part(tmp_path: Path, missing: str) -> None:
    for replaced in ({}, {missing: None}):
        data = {key: value for key, value in facts().items() if key != missing}
        outline(write_report(tmp_path, {**data, **replaced}))


def test_the_page_survives_nothing_at_all(tmp_path: Path) -> None:
    write_report(tmp_path / "new", {})
    assert "No model was built" in (tmp_path / "new" / "report.html").read_text("utf-8")


def test_parts_with_unknown_values_are_drawn_without_them(tmp_path: Path) -> None:
    data = facts()
    for part in ("input", "camera", "reference_structure", "matches", "model", "accuracy"):
        data[part] = dict.fromkeys(data[part])
    data["scores"] = [
        TwoViewScore(
            frame0=0,
            frame1=1,
            model=None,
            num_correspondences=9,
            num_inliers=0,
            inlier_ratio=0.0,
            median_sampson_px=float("nan"),
            median_sampson_normalized=float("nan"),
        )
    ]
    outline(write_report(tmp_path, data))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"registered": 20}, "! 20 of 24 images registered"),
        (
            {"accepted": False, "reasons": ["reprojection error 1.2 px"]},
            "✗ Model not trusted: reprojection error 1.2 px",
        ),
        ({}, "✓ All 24 images registered"),
    ],
)
def test_the_verdict_is_in_words(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    data = facts()
    data["model"] |= change
    write_report(tmp_path, data)
    assert words in (tmp_path / "report.html").read_text("utf-8")


def test_damage_comes_first(tmp_path: Path) -> None:
    data = facts() | {"damage": {"message": "the file ends in frame 7", "frames_read": 7}}
    write_report(tmp_path, data)
    text = (tmp_path / "report.html").read_text("utf-8")
    assert "Broken input: the file ends in frame 7" in text
    assert "7 frames were read" in text


def test_a_heatmap_of_a_long_video_stays_small_and_keeps_single_pairs() -> None:
    from base64 import b64decode

    frames = 4 * MAX_HEATMAP
    drawn = heatmap(np.array([[100, 109, 50]]), frames, label="pairs", top=50)
    data = b64decode(re.search(r"base64,([^\"]+)", drawn)[1])  # type: ignore[index]
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert int.from_bytes(data[16:20], "big") == MAX_HEATMAP
    assert len(drawn) < 20_000


def test_the_cells_of_a_heatmap_mirror_each_other_and_keep_the_largest_count() -> None:
    frames = 2 * MAX_HEATMAP
    cells = _cells(np.array([[100, 108, 7], [101, 109, 50], [frames - 2, frames - 1, 3]]), frames)
    assert (cells[50, 54], cells[54, 50], cells[-1, -1], cells.sum()) == (50, 50, 3, 103)


def test_a_histogram_counts_every_value_once() -> None:
    drawn = histogram([0.0, 0.4, 0.4, 1.0, 7.0], x_label="px", y_label="pairs", upper=1.0)
    counts = [int(n) for n in re.findall(r": (\d+)</title>", drawn)]
    assert sum(counts) == 5
    assert counts[-1] == 2  # the value beyond the end is in the last bin
