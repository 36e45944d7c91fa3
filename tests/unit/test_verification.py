"""Verdicts on matches: few pairs are estimated, what tracks carry on is right, and says so."""

import numpy as np
import pytest

from mvmatch.cli.settings import Settings
from mvmatch.export.colmap import write_database
from mvmatch.export.verification import VerificationOptions, nearest_pairs, verify_tracks
from mvmatch.types import Tracks

pycolmap = pytest.importorskip("pycolmap")


def camera():
    return pycolmap.Camera(model="PINHOLE", width=640, height=480, params=[500, 500, 320, 240])


def sideways(frames: int, points: int = 80, *, seed: int = 0) -> list[list[tuple]]:
    """Static points, depths 4 to 12, before a camera that moves 0.05 to the right per frame."""
    generator = np.random.default_rng(seed)
    x, y, z = generator.uniform([-1, -1.5, 4], [1, 1.5, 12], (points, 3)).T
    return [
        [(f, 500 * (x[p] - 0.05 * f) / z[p] + 320, 500 * y[p] / z[p] + 240) for f in range(frames)]
        for p in range(points)
    ]


def verified(rows, **options):
    tracks = Tracks.from_lists(*rows)
    found = verify_tracks(tracks, camera(), options=VerificationOptions(**options), max_gap=10)
    return tracks, {(pair.frame0, pair.frame1): pair for pair in found}


def tracks_of(tracks, pair) -> set[int]:
    """Tracks whose match in the pair is taken for right."""
    observed = tracks.observations(pair.frame0)[pair.matches[pair.inliers, 0]]
    return set(tracks.track_index[observed].tolist())


def test_three_pairs_per_frame_are_estimated_and_all_right_matches_are_kept():
    _, pairs = verified(sideways(16))

    assert len(pairs) == 105
    estimated = [pair[1] - pair[0] for pair, found in pairs.items() if found.fit is not None]
    # The last frames have no pair at the longer distances and take the nearest there is.
    assert {gap: estimated.count(gap) for gap in (2, 5, 10)} == {2: 14, 5: 11, 10: 6}
    assert len(estimated) < 45
    assert all(found.inliers.all() for found in pairs.values())


def test_estimated_pairs_grow_with_the_frames_and_not_faster():
    counts = [
        sum(found.fit is not None for found in verified(sideways(frames, 20))[1].values())
        for frames in (20, 30, 40)
    ]
    assert counts[2] - counts[1] == counts[1] - counts[0] == 30


def test_matches_that_reach_further_are_tested_at_doubled_gaps():
    tracks = Tracks.from_lists(*sideways(50, 20))
    pairs = verify_tracks(tracks, camera())
    gaps = {pair.frame1 - pair.frame0 for pair in pairs if pair.fit is not None}
    assert {2, 5, 10, 20, 40} <= gaps


def test_a_slow_object_is_also_dropped_from_pairs_too_short_to_show_it():
    rows = sideways(12)
    rows[:10] = [[(f, x, y + 1.0 * f) for f, x, y in row] for row in rows[:10]]

    tracks, alone = verified(rows, mode="all")
    assert set(range(10)) <= tracks_of(tracks, alone[5, 6]), "1 px is within the bound of 4 px"
    tracks, pairs = verified(rows)
    assert pairs[5, 6].fit is None
    assert tracks_of(tracks, pairs[5, 6]) == set(range(10, 80))


def test_a_track_that_goes_astray_keeps_its_matches_before():
    rows = sideways(30)
    rows[0] = [(f, x, y + 30.0 * (f >= 15)) for f, x, y in rows[0]]

    tracks, pairs = verified(rows)
    assert pairs[3, 6].fit is None
    assert pairs[10, 14].fit is None
    assert pairs[14, 15].fit is None
    assert 0 in tracks_of(tracks, pairs[3, 6])
    assert 0 in tracks_of(tracks, pairs[10, 14])
    assert 0 not in tracks_of(tracks, pairs[14, 15])
    assert 0 not in tracks_of(tracks, pairs[13, 17])


def test_no_pair_across_a_scene_cut_is_verified_by_itself_or_by_its_neighbours():
    generator = np.random.default_rng(1)
    before, after = sideways(10, 300), sideways(10, 300, seed=2)
    order = generator.permutation(300)
    # At the cut every track jumps to an unrelated point.
    rows = [
        b + [(f + 10, x, y) for f, x, y in after[o]] for b, o in zip(before, order, strict=True)
    ]

    _, pairs = verified(rows)
    across = [pair for pair in pairs if pair[0] < 10 <= pair[1]]
    assert len(across) == 55
    judged_by_tracks = [pairs[pair] for pair in across if pairs[pair].fit is None]
    assert len(judged_by_tracks) > 20
    assert not any(pairs[pair].inliers.any() for pair in across)
    inside = [pairs[pair] for pair in pairs if pair not in across]
    assert all(found.inliers.mean() > 0.9 for found in inside)


def test_pairs_that_share_no_track_with_the_estimated_ones_are_estimated_themselves():
    rows = sideways(12, 80)
    rows[:40] = [[row[3], row[7]] for row in rows[:40]]  # gap 4: no target, and no step elsewhere
    rows[40:] = [row[:3] + row[4:7] + row[8:] for row in rows[40:]]

    tracks, pairs = verified(rows)
    assert pairs[3, 7].fit is not None
    assert tracks_of(tracks, pairs[3, 7]) == set(range(40))


def test_few_right_matches_of_a_pair_are_none():
    rows = [row[:3] for row in sideways(3, 14)] + sideways(2, 30, seed=3)
    _, pairs = verified(rows)
    assert pairs[1, 2].inliers.sum() == 0, "14 matches, and COLMAP asks for 15"


def test_a_pair_that_was_not_estimated_says_so_in_database_and_scores(tmp_path):
    rows = sideways(12)
    names = [f"{frame:06d}.png" for frame in range(12)]
    path = tmp_path / "database.db"
    summary = write_database(
        Tracks.from_lists(*rows), path, camera=camera(), image_names=names, max_gap=10
    )

    assert summary.num_verified_pairs == summary.num_pairs == 65
    assert summary.num_estimated_pairs == len(summary.scores) < 40
    estimated = {(score.frame0, score.frame1) for score in summary.scores}
    with pycolmap.Database.open(path) as database:
        for frame in range(1, 11):
            geometry = database.read_two_view_geometry(1, frame + 1)
            assert (geometry.cam2_from_cam1 is not None) == ((0, frame) in estimated)
            assert len(geometry.inlier_matches) == 80


def test_the_nearest_pair_stands_in_where_a_gap_does_not_exist():
    none = np.empty((0, 2), np.uint32)
    pairs = [(0, 1, none), (0, 4, none), (0, 7, none), (3, 4, none)]
    chosen = nearest_pairs(pairs, np.array([2, 5, 10]))
    assert [pair[:2] for pair in chosen] == [(0, 1), (0, 4), (0, 7), (3, 4)]


@pytest.mark.parametrize("gaps", [(), (0, 2), (5, 2), (2, 2)])
def test_gaps_that_do_not_rise_are_refused(gaps):
    with pytest.raises(ValueError, match="gaps"):
        VerificationOptions(gaps=gaps)


def test_full_verification_is_one_flag_away():
    assert Settings().options().verification.mode == "tracks"
    assert Settings(verify="all").options().verification.mode == "all"


def with_holes(frames: int) -> Tracks:
    """Tracks that come, go, and miss frames; some move by themselves."""
    generator = np.random.default_rng(1)
    rows = sideways(frames, 200)
    rows[:30] = [[(f, x, y + 1.0 * f) for f, x, y in row] for row in rows[:30]]
    kept = []
    for row in rows:
        first = generator.integers(0, frames - 20)
        step = generator.choice([1, 1, 1, 3, 7])
        kept.append(row[first : first + 30][::step])
    return Tracks.from_lists(*kept)


@pytest.mark.parametrize(
    ("mode", "max_gap"), [("tracks", 10), ("tracks", 25), ("tracks", None), ("trust", None)]
)
def test_verdicts_do_not_depend_on_how_many_frames_are_judged_together(monkeypatch, mode, max_gap):
    tracks, options = with_holes(60), VerificationOptions(mode=mode)
    monkeypatch.setattr("mvmatch.export.verification._FRAMES", 1000)
    monkeypatch.setattr("mvmatch.pairing.FRAMES", 1000)
    whole = list(verify_tracks(tracks, camera(), options=options, max_gap=max_gap))
    monkeypatch.setattr("mvmatch.export.verification._FRAMES", 8)
    monkeypatch.setattr("mvmatch.pairing.FRAMES", 5)
    pieces = list(verify_tracks(tracks, camera(), options=options, max_gap=max_gap))

    assert len(pieces) == len(whole) > 500
    for one, other in zip(pieces, whole, strict=True):
        assert (one.frame0, one.frame1) == (other.frame0, other.frame1)
        np.testing.assert_array_equal(one.matches, other.matches)
        np.testing.assert_array_equal(one.inliers, other.inliers)
        assert (one.fit is None) == (other.fit is None)
