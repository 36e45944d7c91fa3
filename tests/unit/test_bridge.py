"""Tracks of descriptor matches where motion vectors end."""

from __future__ import annotations

import shutil
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

import av
import numpy as np
import pycolmap
import pytest
from scipy.spatial.distance import cdist

from mvmatch.bridge import BridgeOptions, bridge_tracks, descriptors, find_gaps
from mvmatch.bridge.bridging import MIN_FOUND, _Picture
from mvmatch.bridge.descriptors import DescriptorMatcher, mutual_matches
from mvmatch.encode.frames import open_frames
from mvmatch.errors import UnsupportedError
from mvmatch.footage import Footage
from mvmatch.match import Match
from mvmatch.overlays import Overlays
from mvmatch.pictures import bridge_match
from mvmatch.sources import ReferenceStructure
from mvmatch.types import Tracks, VideoInfo

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from mvmatch.bridge.descriptors import Features

WIDTH, HEIGHT = 320, 240
CAMERA = pycolmap.Camera(
    model="SIMPLE_PINHOLE", width=WIDTH, height=HEIGHT, params=[300.0, WIDTH / 2, HEIGHT / 2]
)
SHIFTS = (0, 4, 8, 70, 74, 78)
"""px; where the picture starts in the texture: a jump after the third one."""


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wall seen by a camera that slides along it."""
    folder = tmp_path_factory.mktemp("pictures")
    noise = np.random.default_rng(1).normal(size=(HEIGHT, WIDTH + 80))
    blurred = sum(np.roll(noise, (dy, dx), (0, 1)) for dy in range(-2, 3) for dx in range(-2, 3))
    texture = np.clip(128 + 8 * blurred, 0, 255).astype(np.uint8)
    for index, shift in enumerate(SHIFTS):
        frame = av.VideoFrame.from_ndarray(
            np.ascontiguousarray(texture[:, shift : shift + WIDTH]), format="gray"
        )
        frame.save(str(folder / f"{index:03d}.png"))
    return folder


def decoded(folder: Path) -> Iterator[NDArray[np.uint8]]:
    for frame in open_frames(folder, frame_rate=30.0, max_frames=None):
        yield np.ascontiguousarray(frame.to_ndarray(format="gray"), np.uint8)


def moving(frames: range, count: int) -> Tracks:
    return Tracks.from_lists(*[[(f, 5.0 + t, 9.0) for f in frames] for t in range(count)])


def test_a_gap_is_where_few_tracks_go_on() -> None:
    tracks = Tracks.concatenate(moving(range(3), 7), moving(range(3, 6), 9), moving(range(6), 2))
    assert find_gaps(tracks, 6, min_tracks=3, min_ties=3) == (2,)
    assert find_gaps(tracks, 6, min_tracks=2, min_ties=2) == ()
    assert find_gaps(tracks, 8, min_tracks=3, min_ties=3) == (2, 5, 6)
    assert find_gaps(Tracks.from_lists(), 3, min_tracks=1, min_ties=1) == (0, 1)
    assert find_gaps(tracks, 6, min_tracks=3, min_ties=3, jumps=(1, 3)) == (0, 2)


def test_a_gap_is_where_tracks_go_on_too_briefly_to_hold_pictures_together() -> None:
    brief = Tracks.concatenate(*(moving(range(first, first + 3), 9) for first in range(6)))
    assert find_gaps(brief, 8, min_tracks=3, min_ties=3) == (1, 2, 3, 4, 5)
    held = Tracks.concatenate(brief, moving(range(4), 3), moving(range(2, 8), 3))
    assert find_gaps(held, 8, min_tracks=3, min_ties=3) == (2,), "the ends of these are seen once"
    assert find_gaps(moving(range(0, 19, 2), 9), 19, min_tracks=3, min_ties=3) == ()
    far = find_gaps(moving(range(0, 21, 4), 9), 21, min_tracks=3, min_ties=3)
    assert set(range(20)) - set(far) == {3, 16}, "seen too far away, but at the ends"


def test_matches_cross_the_gap_and_lie_where_the_camera_went(pictures: Path) -> None:
    tracks = Tracks.concatenate(moving(range(3), 50), moving(range(3, 6), 50))
    bridge = bridge_tracks(
        lambda: decoded(pictures),
        tracks,
        CAMERA,
        num_frames=6,
        options=BridgeOptions(min_tracks=20, min_ties=20),
    )
    assert bridge.gaps == bridge.bridged == (2,)
    across = bridge.tracks.between(2, 3)
    assert len(across) > 30
    error = across.xy1 - across.xy0 + [SHIFTS[3] - SHIFTS[2], 0.0]
    assert np.median(np.linalg.norm(error, axis=1)) < 0.3
    assert len(bridge.tracks.between(1, 3)) > 30, "two pictures of one side make points"


def test_gaps_close_to_each_other_are_seen_from_as_far_as_the_window(pictures: Path) -> None:
    def matched(gaps: tuple[int, ...], window: int) -> set[tuple[int, int]]:
        whole = [range(first, stop) for first, stop in zip((0, *gaps), (*gaps, 6), strict=True)]
        tracks = Tracks.concatenate(*(moving(frames, 50) for frames in whole))
        options = BridgeOptions(min_tracks=20, min_ties=20, reach=1, window=window)
        bridge = bridge_tracks(
            lambda: decoded(pictures), tracks, CAMERA, num_frames=6, options=options
        )
        assert bridge.gaps == tuple(gap - 1 for gap in gaps)
        pairs = ((i, j) for i in range(6) for j in range(i + 1, 6))
        return {pair for pair in pairs if len(bridge.tracks.between(*pair))}

    assert matched((3,), window=3) == {(2, 3)}
    assert matched((2, 5), window=2) == {(1, 2), (4, 5)}
    assert (1, 4) in matched((2, 4), window=3)
    assert (0, 3) in matched((2, 4), window=3)


def test_matches_are_those_of_an_exhaustive_search(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(descriptors, "ROWS", 64)
    random = np.random.default_rng(3)
    first = random.normal(size=(200, 8)).astype(np.float32)
    second = first[random.permutation(200)[:150]] + 0.2 * random.normal(size=(150, 8))
    first, second = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (first, second))
    angle = np.arccos(1.0 - cdist(first, second, "cosine"))
    expected = [
        (i, j)
        for i in range(200)
        for j in range(150)
        if angle[i, j] <= 0.7
        and angle[i, j] < 0.8 * np.delete(angle[i], j).min()
        and angle[i, j] < 0.8 * np.delete(angle[:, j], i).min()
    ]
    assert 50 < len(expected) < 150
    found = mutual_matches(first.astype(np.float32), second.astype(np.float32))
    assert [tuple(pair) for pair in found.tolist()] == expected
    assert mutual_matches(found[:1].astype(np.float32), found.astype(np.float32)).shape == (0, 2)


def features_of(pictures: Path) -> list[Features]:
    return list(DescriptorMatcher(BridgeOptions(), CAMERA).extract(decoded(pictures)))


def test_features_are_those_that_pycolmap_extracts_from_each_picture(
    pictures: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Batches of which the next one is extracted while this one is used.
    monkeypatch.setattr(descriptors, "BATCH", 2)
    level = pycolmap.logging.minloglevel
    options = pycolmap.FeatureExtractionOptions(pycolmap.FeatureExtractorType.SIFT)
    options.sift.first_octave = 0
    options.sift.max_num_orientations = 1
    options.use_gpu = False
    extractor = pycolmap.FeatureExtractor.create(options, pycolmap.Device.cpu)
    for luma, found in zip(decoded(pictures), features_of(pictures), strict=True):
        keypoints, expected = extractor.extract_from_uint8_array(luma)
        assert np.array_equal(found.xy, np.array([(each.x, each.y) for each in keypoints]))
        assert np.array_equal(found.descriptors.data, expected.data)
    assert pycolmap.logging.minloglevel == level


def test_a_picture_without_features_matches_nothing(pictures: Path) -> None:
    matcher = DescriptorMatcher(BridgeOptions(), CAMERA)
    blank, seen = matcher.extract([np.zeros((HEIGHT, WIDTH), np.uint8), next(decoded(pictures))])
    assert len(blank.xy) == 0
    (none,) = matcher.match([(blank, seen)])
    assert none.shape == (0, 2)
    assert matcher.match([]) == []


def test_matches_do_not_depend_on_how_many_pairs_are_matched_at_a_time(
    pictures: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    features, matcher = features_of(pictures), DescriptorMatcher(BridgeOptions(), CAMERA)
    pairs = list(combinations(features, 2))
    monkeypatch.setattr(descriptors, "MAX_WORKERS", 1)
    alone = matcher.match(pairs)
    monkeypatch.setattr(descriptors, "MAX_WORKERS", 4)
    together = matcher.match(pairs)
    assert sum(map(len, alone)) > 100
    assert all(np.array_equal(a, b) for a, b in zip(alone, together, strict=True))


def test_matches_of_chosen_features_bear_their_numbers_in_the_picture(pictures: Path) -> None:
    first, second, *_ = features_of(pictures)
    matcher = DescriptorMatcher(BridgeOptions(), CAMERA)
    (whole,) = matcher.match([(first, second)])
    chosen = np.sort(whole[::2, 0]).astype(np.int64)
    (some,) = matcher.match([(first.only(chosen), second)])
    assert set(some[:, 0]) <= set(chosen)
    found = dict(whole.tolist())
    assert np.mean([found[a] == b for a, b in some.tolist()]) > 0.95


def test_far_pictures_are_matched_by_what_near_ones_show_or_by_all(pictures: Path) -> None:
    features, *_ = features_of(pictures)
    picture = _Picture(0, features)
    picture.find(np.arange(1, MIN_FOUND, dtype=np.uint32))
    assert picture.telling() is features
    picture.find(np.array([MIN_FOUND + 5], np.uint32))
    assert picture.telling().chosen.tolist() == [*range(1, MIN_FOUND), MIN_FOUND + 5]


def test_features_of_a_larger_picture_are_those_of_it_made_smaller(pictures: Path) -> None:
    luma = next(decoded(pictures))
    # Two by two px, with a row and a column left over.
    large = np.pad(np.kron(luma, np.ones((2, 2), np.uint8)), ((0, 1), (0, 1)))
    matcher = DescriptorMatcher(BridgeOptions(max_image_size=2 * WIDTH), CAMERA)
    (small,) = matcher.extract([luma])
    (found,) = matcher.extract([large])
    assert len(small.xy) > 100
    assert np.array_equal(found.xy, 2 * small.xy)
    assert np.array_equal(found.descriptors.data, small.descriptors.data)


def test_a_place_seen_again_behind_other_pictures_is_found_by_all_features(pictures: Path) -> None:
    there = list(decoded(pictures))[:3]
    elsewhere = [np.ascontiguousarray(luma[:, ::-1]) for luma in there]
    tracks = Tracks.concatenate(*(moving(frames, 50) for frames in (range(3), range(3, 6))))
    bridge = bridge_tracks(
        lambda: [*there, *elsewhere, there[0]],
        tracks,
        CAMERA,
        num_frames=7,
        options=BridgeOptions(min_tracks=20, min_ties=20, window=8, near=2),
    )
    assert len(bridge.tracks.between(2, 6)) > 30


def test_behind_a_break_pictures_are_matched_with_a_whole_window_before_it(pictures: Path) -> None:
    here = list(decoded(pictures))
    there, elsewhere = [luma[:, ::-1] for luma in here], [255 - luma for luma in here]
    both, after = (
        np.hstack([elsewhere[index][:, : WIDTH // 2], here[index][:, WIDTH // 2 :]])
        for index in (1, 2)
    )
    order = [here[0], here[1], there[0], there[1], elsewhere[0], both, after]
    tracks = Tracks.concatenate(*(moving(frames, 50) for frames in (range(2), range(2, 4))))
    bridge = bridge_tracks(
        lambda: [np.ascontiguousarray(luma) for luma in order],
        tracks,
        CAMERA,
        num_frames=7,
        options=BridgeOptions(min_tracks=20, min_ties=20, window=3, reach=1, far_reach=1, near=1),
    )
    assert len(bridge.tracks.between(4, 5)) > MIN_FOUND
    # More than a window apart, and seen by the picture between them.
    assert len(bridge.tracks.between(1, 6)) > 30


def test_pictures_are_left_alone_where_nothing_is_missing() -> None:
    tracks = moving(range(6), 30)
    for options in (
        BridgeOptions(min_tracks=20, min_ties=20),
        BridgeOptions(matcher="none", min_tracks=99, min_ties=99),
    ):
        bridge = bridge_tracks(lambda: iter(()), tracks, CAMERA, num_frames=6, options=options)
        assert (len(bridge.tracks), bridge.gaps) == (0, ())


def test_pictures_of_different_things_are_not_bridged(pictures: Path, tmp_path: Path) -> None:
    noise = np.random.default_rng(2).integers(0, 255, (HEIGHT, WIDTH)).astype(np.uint8)
    for index in range(6):
        if index < 3:
            (tmp_path / f"{index:03d}.png").write_bytes(
                (pictures / f"{index:03d}.png").read_bytes()
            )
        else:
            shifted = np.ascontiguousarray(np.roll(noise, 4 * index, 1))
            av.VideoFrame.from_ndarray(shifted, format="gray").save(
                str(tmp_path / f"{index:03d}.png")
            )
    tracks = Tracks.concatenate(moving(range(3), 50), moving(range(3, 6), 50))
    bridge = bridge_tracks(
        lambda: decoded(tmp_path),
        tracks,
        CAMERA,
        num_frames=6,
        options=BridgeOptions(min_tracks=20, min_ties=20),
    )
    assert (bridge.gaps, bridge.bridged) == ((2,), ())


def matched(tracks: Tracks) -> Match:
    """What a video of such pictures gives."""
    nowhere = Overlays(end=np.array([6]), cells=np.zeros((1, 1, 1), bool))
    return Match(
        tracks=tracks,
        further=Tracks.from_lists(),
        info=VideoInfo(width=WIDTH, height=HEIGHT, num_frames=6, frame_rate=30.0, codec="av1"),
        frames=(),
        structure=ReferenceStructure(),
        footage=Footage(
            cuts=(), jumps=(), repeats=(), overlays=nowhere, num_overlay_observations=0, breaks=()
        ),
        damage=None,
    )


@pytest.mark.parametrize(("damaged", "bridged"), [(5, (2,)), (3, ()), (0, ())])
def test_a_damaged_picture_leaves_the_gaps_behind_it_and_is_named(
    damaged: int, bridged: tuple[int, ...], pictures: Path, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(pictures, tmp_path / "pictures"))
    (folder / f"{damaged:03d}.png").write_bytes(b"no picture")
    parts = [moving(range(3), 50), moving(range(3, 5), 50), moving(range(5, 6), 50)]
    match = matched(Tracks.concatenate(*parts))
    options = BridgeOptions(min_tracks=20, min_ties=20, reach=2, far_reach=2)
    found = bridge_match(match, folder, CAMERA, options=options)
    assert (found.gaps, found.bridged) == ((2, 4), bridged)
    assert str(found.unreadable).startswith(str(folder))
    assert any(str(found.unreadable) in warning for warning in found.warnings)
    assert (len(found.tracks.between(2, 3)) > 0) == bool(bridged)


def test_whole_pictures_are_no_reason_for_a_warning(pictures: Path) -> None:
    match = matched(Tracks.concatenate(moving(range(3), 50), moving(range(3, 6), 50)))
    found = bridge_match(match, pictures, CAMERA, options=BridgeOptions(min_tracks=20, min_ties=20))
    assert (found.bridged, found.unreadable) == ((2,), None)


def test_a_matcher_that_is_not_there_is_named(pictures: Path) -> None:
    with pytest.raises(UnsupportedError, match="aliked"):
        bridge_tracks(
            lambda: decoded(pictures),
            moving(range(6), 1),
            CAMERA,
            num_frames=6,
            options=BridgeOptions(matcher="aliked"),
        )
