"""Tracks: rows, keypoints, pairs."""

from __future__ import annotations

import errno
import itertools
import os

import numpy as np
import pytest

from mvmatch import batches
from mvmatch.errors import DataError
from mvmatch.rows import count_entering, count_keypoints, count_ties, during
from mvmatch.types import Tracks

THREE = Tracks.from_lists(
    [(0, 1.0, 1.0), (1, 2.0, 1.0), (2, 3.0, 1.0)],
    [(1, 9.0, 9.0), (3, 8.0, 9.0)],
    [(0, 5.0, 5.0), (1, 6.0, 5.0)],
)


def test_between_gives_the_points_of_shared_tracks_in_the_order_asked_for():
    forward, backward = THREE.between(0, 1), THREE.between(1, 0)
    assert forward.xy0.tolist() == [[1.0, 1.0], [5.0, 5.0]]
    assert forward.xy1.tolist() == [[2.0, 1.0], [6.0, 5.0]]
    np.testing.assert_array_equal(forward.xy0, backward.xy1)
    np.testing.assert_array_equal(forward.xy1, backward.xy0)


def test_frames_without_a_shared_track_give_no_correspondence():
    assert len(THREE.between(0, 3)) == 0
    assert len(THREE.between(0, 99)) == 0
    assert THREE.keypoints(99).shape == (0, 2)


def test_a_keypoint_keeps_its_number_in_every_pair():
    matches = {(i, j): pairs for i, j, pairs in THREE.pairs()}
    assert sorted(matches) == [(0, 1), (0, 2), (1, 2), (1, 3)]
    for (i, j), pairs in matches.items():
        expected = THREE.between(i, j)
        np.testing.assert_array_equal(THREE.keypoints(i)[pairs[:, 0]], expected.xy0)
        np.testing.assert_array_equal(THREE.keypoints(j)[pairs[:, 1]], expected.xy1)


def test_pairs_and_adjacency_stop_at_the_gap_that_is_asked_for():
    assert [pair[:2] for pair in THREE.pairs(max_gap=1)] == [(0, 1), (1, 2)]
    assert THREE.adjacency(max_gap=1)[0].tolist() == [0, 1, 2]
    assert THREE.adjacency(max_gap=1)[:, :2].tolist() == [[0, 1], [1, 2]]
    assert [1, 3, 1] in THREE.adjacency().tolist()


def test_no_tracks_are_tracks_as_well():
    empty = Tracks.from_lists()
    assert (len(empty), empty.num_frames, list(empty.pairs())) == (0, 0, [])
    assert empty.adjacency().shape == (0, 3)


@pytest.mark.parametrize(
    ("offsets", "frame", "message"),
    [
        ([0, 3], [0, 1], "offsets"),
        ([0, 2, 1, 2], [0, 1], "fall"),
        ([0, 2], [1, 1], "increase"),
        ([0, 2], [-1, 1], "display"),
    ],
)
def test_rows_that_contradict_each_other_are_refused(offsets, frame, message):
    with pytest.raises(ValueError, match=message):
        Tracks(
            offsets=np.array(offsets, np.int64),
            frame=np.array(frame, np.int32),
            xy=np.zeros((len(frame), 2), np.float32),
        )


def test_selected_tracks_are_numbered_anew():
    kept = THREE.select(np.array([False, True, True]))
    assert kept.frame.tolist() == [1, 3, 0, 1]
    assert kept.keypoint_index.tolist() == [0, 0, 0, 1]


def scattered(*, num_tracks: int = 60, num_frames: int = 40) -> Tracks:
    """Tracks of 2 to 11 observations in frames drawn at random."""
    generator = np.random.default_rng(0)
    rows = []
    for _ in range(num_tracks):
        frames = np.sort(generator.permutation(num_frames)[: generator.integers(2, 12)])
        rows.append([(int(f), *generator.uniform(0, 99, 2)) for f in frames])
    return Tracks.from_lists(*rows)


def test_pairs_are_the_same_however_many_frames_are_sorted_together(monkeypatch):
    tracks = scattered()
    for max_gap in (None, 3):
        monkeypatch.setattr("mvmatch.pairing.FRAMES", 1000)
        expected = [(i, j, matches.tolist()) for i, j, matches in tracks.pairs(max_gap)]
        monkeypatch.setattr("mvmatch.pairing.FRAMES", 7)
        assert [(i, j, matches.tolist()) for i, j, matches in tracks.pairs(max_gap)] == expected
        assert len(expected) > 20
        some = [(i, j, matches.tolist()) for i, j, matches in tracks.pairs(max_gap, start=5, end=9)]
        assert some == [pair for pair in expected if 5 <= pair[0] < 9]


def test_keypoints_keep_their_numbers_in_a_stretch_of_frames(monkeypatch):
    monkeypatch.setattr("mvmatch.rows.BLOCK", 16)
    tracks = scattered()
    near = tracks.during(10, 20)
    assert near.num_observations == np.count_nonzero((tracks.frame >= 10) & (tracks.frame < 20))
    for frame in range(40):
        expected = tracks.keypoints(frame) if 10 <= frame < 20 else np.empty((0, 2))
        np.testing.assert_array_equal(near.keypoints(frame), expected)
    pairs = [(i, j, matches.tolist()) for i, j, matches in near.pairs()]
    assert pairs == [
        (i, j, matches.tolist()) for i, j, matches in tracks.pairs(start=10, end=20) if j < 20
    ]
    assert len(pairs) > 10
    assert len(tracks.during(40, 50)) == len(Tracks.from_lists().during(0, 9)) == 0


@pytest.mark.parametrize("size", [1, 5, 100, 10_000])
def test_parts_put_together_are_the_tracks(size):
    tracks = scattered()
    assert all(len(p) == 1 or p.num_observations <= size for p in tracks.parts(size))
    assert_same(batches.joined(tracks.parts(size)), tracks)


def assert_same(found: Tracks, expected: Tracks) -> None:
    for name in ("offsets", "frame", "xy"):
        array = getattr(found, name)
        np.testing.assert_array_equal(array, getattr(expected, name))
        assert array.dtype == getattr(expected, name).dtype


def is_in_file(array: np.ndarray) -> bool:
    while isinstance(array, np.ndarray):
        if isinstance(array, np.memmap):
            return True
        array = array.base
    return False


def test_long_tracks_lie_in_a_file_that_has_no_name(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    tracks = scattered()
    assert not is_in_file(batches.joined(tracks.parts(50)).xy)
    monkeypatch.setattr(batches, "IN_MEMORY", 100)
    found = batches.joined(tracks.parts(50))
    assert all(is_in_file(array) for array in (found.offsets, found.frame, found.xy))
    assert list(tmp_path.iterdir()) == []
    assert_same(found, tracks)
    assert [p[:2] for p in found.pairs(3)] == [p[:2] for p in tracks.pairs(3)]
    for kept in (tracks.lengths > 6, tracks.lengths > 99):
        assert_same(found.select(kept), tracks.select(kept))
    assert_same(
        Tracks.concatenate(found, found.select(tracks.lengths > 6)),
        Tracks.concatenate(tracks, tracks.select(tracks.lengths > 6)),
    )


def test_a_full_disk_is_named(monkeypatch, tmp_path):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.setattr("tempfile.SpooledTemporaryFile.write", full)
    with pytest.raises(DataError, match=f"in {tmp_path}.*No space.*TMPDIR"):
        batches.joined(scattered().parts())


@pytest.mark.parametrize("block", [1, 2, 3, 7, 1000])
def test_frames_that_fall_are_found_wherever_they_are(block, monkeypatch):
    monkeypatch.setattr("mvmatch.rows.BLOCK", block)
    tracks = scattered(num_tracks=6)
    starts = set(tracks.offsets.tolist())
    for row in range(1, tracks.num_observations):
        frame = tracks.frame.copy()
        frame[row] = frame[row - 1]
        after = frame[row + 1 : row + 2] <= frame[row]
        broken = row not in starts or (row + 1 not in starts and after.any())
        if not broken:
            Tracks(offsets=tracks.offsets, frame=frame, xy=tracks.xy)
            continue
        with pytest.raises(ValueError, match="increase"):
            Tracks(offsets=tracks.offsets, frame=frame, xy=tracks.xy)


def test_tracks_seen_for_a_while_know_their_numbers():
    tracks = scattered()
    numbers, near = during(tracks, 10, 20)
    expected = [t for t in range(len(tracks)) if np.any(inside(tracks, t))]
    assert numbers.tolist() == expected
    assert 0 < len(expected) < len(tracks)
    for number, length in zip(expected, near.lengths.tolist(), strict=True):
        assert length == np.count_nonzero(inside(tracks, number))


def inside(tracks: Tracks, track: int) -> np.ndarray:
    frame = tracks.frame[tracks.offsets[track] : tracks.offsets[track + 1]]
    return (frame >= 10) & (frame < 20)


def test_keypoints_and_entering_tracks_are_counted():
    assert count_keypoints(THREE, 5).tolist() == [2, 3, 1, 1, 0]
    assert count_entering(THREE, 5).tolist() == [0, 2, 2, 1, 0]
    assert count_entering(Tracks.from_lists(), 2).tolist() == [0, 0]


def test_tracks_that_tie_frames_are_those_seen_twice_on_both_sides_and_near():
    tracks = scattered()
    num_frames = int(tracks.frame.max()) + 1
    ends = np.isin(np.arange(num_frames - 1), (4, 9))
    first, last = {0, 5, 10}, {4, 9, num_frames - 1}
    for reach in (2, 5, 20):
        expected = []
        for step in range(num_frames - 1):
            count = 0
            for start, stop in itertools.pairwise(tracks.offsets.tolist()):
                frames = tracks.frame[start:stop].tolist()
                before = [frame for frame in frames if frame <= step][-2:]
                after = [frame for frame in frames if frame > step][:2]
                both = len(before) == 2 or (before[-1:] and before[-1] in first)
                both = both and (len(after) == 2 or (after[:1] and after[0] in last))
                count += bool(both and before[0] > step - reach and after[-1] <= step + reach)
            expected.append(count)
        assert count_ties(tracks, num_frames, reach=reach, ends=ends).tolist() == expected
    assert count_ties(Tracks.from_lists(), 3, reach=2, ends=np.zeros(2, bool)).tolist() == [0, 0]


def test_the_reach_is_the_largest_distance_of_a_pair():
    tracks = scattered()
    for max_gap in (None, 1, 3, 100):
        gaps = [j - i for i, j, _ in tracks.pairs(max_gap)]
        assert tracks.reach(max_gap) == max(gaps)
    assert Tracks.from_lists().reach() == Tracks.from_lists([(3, 0.0, 0.0)]).reach(10) == 0
