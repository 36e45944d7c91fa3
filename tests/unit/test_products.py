"""What a stage hands on comes back from its files as it was."""

from __future__ import annotations

import dataclasses
import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

pytest.importorskip("pycolmap")

from mvmatch import products
from mvmatch.encode import EncodeResult, EncodingCheck
from mvmatch.errors import BitstreamError, LimitError
from mvmatch.export.colmap import DatabaseSummary
from mvmatch.matching import match_video
from mvmatch.overlays import Overlays
from mvmatch.sfm import (
    Attempt,
    Diagnosis,
    Finding,
    ModelCheck,
    ReconstructionResult,
    Unregistered,
)
from mvmatch.sources import Skipped
from mvmatch.tracks import TrackOptions
from mvmatch.types import Tracks, TwoViewScore

if TYPE_CHECKING:
    from pathlib import Path

    from mvmatch.match import Match

TABLE = "tracks.parquet"


def stored(facts: Any) -> Any:
    """Facts as a record gives them back."""
    return json.loads(json.dumps(facts))


def carried(match: Match, folder: Path) -> Match:
    names = [f"{frame}.png" for frame in range(match.num_frames)]
    facts = products.write_match(match, folder, tracks=TABLE, image_names=names, options={})
    return products.read_match(folder, stored(facts), tracks=TABLE)


def assert_same(found: Tracks, expected: Tracks) -> None:
    for name in ("offsets", "frame", "xy"):
        one, other = getattr(found, name), getattr(expected, name)
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", ["drive.ivf", "svt_random_access_p6.ivf", "svt_flat_p8.mkv"])
def test_a_match_comes_back_whole(name: str, data: Path, tmp_path: Path) -> None:
    match = match_video(data / name, options=TrackOptions.preset("dense"))
    cells = np.random.default_rng(0).random((2, 5, 7)) > 0.5
    overlays = Overlays(end=np.array([4, 9], np.int64), cells=cells)
    marked = dataclasses.replace(match.footage, overlays=overlays, repeats=(3, 5))
    skipped = Skipped(after_frame=3, num_errors=1, byte_offset=None, section="5.9.2", reason="bad")
    match = dataclasses.replace(match, footage=marked, skipped=(skipped,))

    found = carried(match, tmp_path)
    assert_same(found.tracks, match.tracks)
    assert_same(found.further, match.further)
    assert len(match.further) > 0
    assert (found.info, found.skipped) == (match.info, match.skipped)
    assert list(found.frames) == list(match.frames)
    assert found.warnings == match.warnings
    assert found.footage.summary() == match.footage.summary()
    np.testing.assert_array_equal(found.footage.overlays.cells, cells)
    np.testing.assert_array_equal(found.footage.overlays.end, overlays.end)
    count = match.num_frames
    assert found.structure.summary(found.frames) == match.structure.summary(match.frames)
    np.testing.assert_array_equal(
        found.structure.adjacency(count), match.structure.adjacency(count)
    )
    assert found.structure.vectors_per_frame == match.structure.vectors_per_frame


@pytest.mark.parametrize(
    "damage",
    [BitstreamError("cut off", section="5.9", byte_offset=7, frame=3), LimitError("too large")],
)
def test_damage_keeps_its_kind_and_place(damage: Any, data: Path, tmp_path: Path) -> None:
    match = dataclasses.replace(match_video(data / "drive.ivf"), damage=damage)
    found: Any = carried(match, tmp_path).damage
    assert type(found) is type(damage)
    assert str(found) == str(damage)
    assert vars(found) == vars(damage)


def test_an_error_of_a_kind_that_is_none_becomes_a_plain_one(data: Path, tmp_path: Path) -> None:
    match = dataclasses.replace(match_video(data / "drive.ivf"), damage=LimitError("too large"))
    facts = products.write_match(
        match, tmp_path, tracks=TABLE, image_names=["a"] * match.num_frames, options={}
    )
    facts["damage"]["kind"] = "os"
    found = products.read_match(tmp_path, stored(facts), tracks=TABLE).damage
    assert str(found) == "too large"


def test_an_encoding_comes_back_with_its_video_where_it_is_now(tmp_path: Path) -> None:
    check = EncodingCheck(
        num_frames=3, num_hidden=0, key_frames=(0,), distance_share={1: 0.9, -1: 0.1}, covered=0.8
    )
    encoding = EncodeResult(
        path=tmp_path / "before" / "encoded.ivf",
        encoder="svt",
        settings="crf=30",
        num_frames=3,
        width=64,
        height=48,
        image_names=("a.png", "b.png", "c.png"),
        num_bytes=100,
        seconds=0.5,
        cpu_seconds=0.7,
        check=check,
        warnings=("odd",),
    )
    found = products.read_encoding(tmp_path, stored(products.encoding_facts(encoding)))
    assert found == dataclasses.replace(encoding, path=tmp_path / "encoded.ivf")
    plain = dataclasses.replace(encoding, check=None, image_names=None)
    found = products.read_encoding(tmp_path, stored(products.encoding_facts(plain)))
    assert found == dataclasses.replace(plain, path=tmp_path / "encoded.ivf")


def test_numbers_of_a_database_come_back_those_that_are_none_included() -> None:
    score = TwoViewScore(
        frame0=0,
        frame1=1,
        model=None,
        num_correspondences=4,
        num_inliers=0,
        inlier_ratio=0.0,
        median_sampson_px=float("nan"),
        median_sampson_normalized=float("nan"),
    )
    summary = DatabaseSummary(
        num_images=2,
        num_keypoints=8,
        num_pairs=1,
        num_estimated_pairs=1,
        num_verified_pairs=0,
        num_matches=4,
        num_inliers=0,
        scores=(score,),
    )
    found = products.read_summary(stored(dataclasses.asdict(summary)))
    assert repr(found) == repr(summary)


def test_a_result_without_a_model_keeps_its_attempts(tmp_path: Path) -> None:
    numbers = {
        item.name: 1
        for item in dataclasses.fields(ModelCheck)
        if item.name not in {"reasons", "agreement"}
    }
    check = ModelCheck(**numbers, agreement=float("nan"), reasons=("bent",))  # type: ignore[arg-type]
    tried = {"images": (1, 9), "initial_images": (1, 5)}
    attempts = (
        Attempt(mapper="incremental", **tried, check=check, reasons=("bent",)),
        Attempt(mapper="global", images=(1, 9), initial_images=None, check=None, reasons=("none",)),
    )
    result = ReconstructionResult(
        reconstruction=None,
        registered=0,
        total=9,
        num_keyframes=9,
        unregistered=(Unregistered(image_id=3, name="c.png", reason="few points"),),
        num_points=0,
        mean_reprojection_error=float("nan"),
        mean_track_length=0.0,
        accepted=False,
        reasons=("no model",),
        attempts=attempts,
        path=None,
    )
    found = products.read_result(tmp_path, stored(products.write_result(result, tmp_path)))
    assert repr(found) == repr(result)


def test_a_diagnosis_comes_back() -> None:
    finding = Finding(code="static", frames=((2, 9),), sentence="It rests.", advice="Move.")
    diagnosis = Diagnosis(status="partial", findings=(finding,))
    assert products.read_diagnosis(stored(dataclasses.asdict(diagnosis))) == diagnosis
