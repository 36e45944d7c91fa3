"""Places seen again: which pictures are tied together, and where the tracks between them lie."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvmatch.bridge import LoopOptions, close_loops, require_matcher
from mvmatch.bridge.retrieval import retrieve, similarities
from mvmatch.config import RunOptions, from_mapping
from mvmatch.errors import UnsupportedError
from mvmatch.pipeline import reconstruct_video
from mvmatch.testing import SyntheticScene, synthetic_drive

pycolmap = pytest.importorskip("pycolmap")

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from mvmatch.bridge import Loops

SIZE = (480, 270)
ELSEWHERE = [-1, -2, -3]
"""Pictures of other things."""
ROUND = [0, 3, 6, *ELSEWHERE, 1, 4, 7]
"""Frames of a drive: the start, something else, and almost where it began."""
FARTHER = [0, 3, 6, *ELSEWHERE, 60, 64, 68]
"""The start, and 21 m on in the same street."""


@pytest.fixture(scope="module")
def street() -> SyntheticScene:
    return synthetic_drive(70, SIZE)


def pictures(scene: SyntheticScene, frames: list[int]) -> Iterator[NDArray[np.uint8]]:
    for frame in frames:
        grey = scene.render(frame).mean(axis=2) if frame >= 0 else other(-frame)
        yield np.ascontiguousarray(grey.astype(np.uint8))


def other(seed: int) -> NDArray[np.float64]:
    """(H, W) blotches."""
    coarse = np.random.default_rng(seed).uniform(0, 255, (SIZE[1] // 10, SIZE[0] // 10))
    return np.kron(coarse, np.ones((10, 10))).astype(np.float64)


def closed(scene: SyntheticScene, frames: list[int]) -> Loops:
    params = [*scene.K[[0, 1, 0, 1], [0, 1, 2, 2]]]
    camera = pycolmap.Camera(model="PINHOLE", width=SIZE[0], height=SIZE[1], params=params)
    options = LoopOptions(matcher="sift", min_apart=5)
    return close_loops(pictures(scene, frames), np.arange(len(frames)), camera, options=options)


@pytest.fixture(scope="module")
def loops(street: SyntheticScene) -> Loops:
    return closed(street, ROUND)


@pytest.fixture(scope="module")
def farther(street: SyntheticScene) -> Loops:
    return closed(street, FARTHER)


def test_the_way_back_is_tied_to_the_way_there_and_nothing_else(loops: Loops) -> None:
    assert loops.closed
    start, end = {0, 1, 2}, {6, 7, 8}
    assert all(first in start and second in end for first, second in loops.closed)
    assert {frame for pair in loops.pairs for frame in pair} <= start | end
    assert list(loops.pairs) == sorted(set(loops.pairs))


def test_every_track_is_seen_twice_at_both_ends(loops: Loops) -> None:
    assert len(loops.tracks) >= 30
    late = loops.tracks.frame >= 6
    for part in (late, ~late):
        counts = np.bincount(loops.tracks.track_index[part], minlength=len(loops.tracks))
        assert counts.min() >= 2


@pytest.mark.parametrize(("way", "frames"), [("loops", ROUND), ("farther", FARTHER)])
def test_tracks_lie_where_the_scene_is(
    way: str, frames: list[int], street: SyntheticScene, request: pytest.FixtureRequest
) -> None:
    found: Loops = request.getfixturevalue(way)
    across = [pair for pair in found.pairs if pair[1] - pair[0] >= 5]
    assert across
    for first, second in across:
        pair = found.tracks.between(first, second)
        truth, _ = street.transfer(frames[first], frames[second], pair.xy0)
        error = np.linalg.norm(pair.xy1 - truth, axis=1)
        known = np.isfinite(error)  # corners of roofs before the sky may have no place in the scene
        assert known.mean() > 0.5
        assert np.median(error[known]) < 0.5
        assert (error[known] < 2.0).mean() > 0.9


def test_a_way_that_never_comes_back_has_no_loops(street: SyntheticScene) -> None:
    onward = closed(street, [0, 3, 6, *ELSEWHERE, -4, -5, -6])
    assert (len(onward.tracks), onward.pairs, onward.closed) == (0, (), ())


def test_no_key_frames_give_no_loops() -> None:
    camera = pycolmap.Camera(model="PINHOLE", width=8, height=8, params=[8, 8, 4, 4])
    found = close_loops(
        iter(()), np.empty(0, np.int64), camera, options=LoopOptions(matcher="sift")
    )
    assert (len(found.tracks), found.pairs) == (0, ())


def test_pictures_with_the_same_rare_words_are_alike() -> None:
    words = np.eye(40, dtype=np.float32)
    common, rare, other = words[:10], words[10:20], words[20:30]
    alike = similarities(
        [np.concatenate([common, each]) for each in (rare, other, rare)] + [words[:0]]
    )
    assert alike[0, 2] == pytest.approx(1.0)
    assert alike[0, 1] < 0.5
    assert (alike[3] == 0).all()
    assert np.array_equal(alike, alike.T)


def test_what_is_retrieved_is_far_apart_and_bounded() -> None:
    likeness = np.random.default_rng(0).uniform(0.1, 1.0, (40, 40))
    frame = 10 * np.arange(40)
    pairs = retrieve(likeness, frame, min_apart=100, max_pairs=12, max_per_picture=2)
    assert len(pairs) == 12
    assert min(frame[second] - frame[first] for first, second in pairs) >= 100
    assert np.bincount(np.ravel(pairs)).max() <= 2
    scores = [likeness[pair] for pair in pairs]
    assert scores == sorted(scores, reverse=True)
    apart = np.abs(np.array(pairs)[:, None] - np.array(pairs)[None]).max(axis=2)
    assert apart[~np.eye(12, dtype=bool)].min() > 1, "neighbours on both sides say the same"


def test_options_without_sense_are_refused() -> None:
    with pytest.raises(ValueError, match="max_pairs is 0"):
        LoopOptions(max_pairs=0)


def test_a_matcher_that_is_not_there_ends_a_run_before_it_begins(tmp_path: Path) -> None:
    require_matcher("none")
    require_matcher("sift")
    try:
        require_matcher("aliked")
    except UnsupportedError:
        options = from_mapping({"loops": {"matcher": "aliked"}}, RunOptions())
        # There is not even a video: nobody looked.
        with pytest.raises(UnsupportedError, match=r"cannot match with aliked.*Use sift"):
            reconstruct_video(tmp_path / "none.ivf", tmp_path / "out", options=options)
    else:
        pytest.skip("this pycolmap has ALIKED")
