from dataclasses import replace

import numpy as np
import pytest

from mvmatch.bench.accuracy import COLUMNS, AccuracyOptions, judge
from mvmatch.bench.datasets import Sequence
from mvmatch.bench.matches import KeypointMatches, TrackMatches
from mvmatch.bench.truth import Targets
from mvmatch.geometry.point_error import epipolar_direction
from mvmatch.geometry.pose_error import relative_pose
from mvmatch.testing import exact_paths, synthetic_drive
from mvmatch.types import Tracks

pycolmap = pytest.importorskip("pycolmap")

ONE_GAP = AccuracyOptions(gaps=(3,), draws=2)


class SceneTruth:
    """Truth of a synthetic scene; ``moving`` marks what lies left of a line."""

    def __init__(self, scene, moving_left_of=0.0):
        self.scene, self.line = scene, moving_left_of

    def targets(self, frame0, frame1, xy):
        target, visible = self.scene.transfer(frame0, frame1, np.asarray(xy, np.float64))
        return Targets(xy=target, visible=visible, moving=np.asarray(xy)[:, 0] < self.line)


@pytest.fixture(scope="module")
def drive():
    scene = synthetic_drive(6, (320, 180))
    camera = pycolmap.Camera(
        model="PINHOLE", width=320, height=180, params=scene.K[[0, 1, 0, 1], [0, 1, 2, 2]]
    )
    return Sequence(
        name="drive", frames=None, camera=camera, cam_from_world=scene.cam_from_world,
        truth=SceneTruth(scene),
    )  # fmt: skip


@pytest.fixture(scope="module")
def paths(drive):
    """(6, N, 2) px of points that stay visible through all frames."""
    x, y = np.meshgrid(np.arange(6, 314, 9), np.arange(6, 174, 9))
    xy = np.column_stack([x.ravel(), y.ravel()]) + 0.5
    found = exact_paths(drive.truth.scene, 0, xy)
    return found[:, np.isfinite(found).all(axis=(0, 2))]


def tracks_of(paths, offset=(0.0, 0.0)):
    """Tracks through (F, N, 2) points; from frame 1 on they are off by ``offset``."""
    count, number = paths.shape[:2]
    moved = paths + np.where(np.arange(count)[:, None, None] > 0, offset, 0.0)
    return Tracks(
        offsets=np.arange(0, number * count + 1, count, dtype=np.int64),
        frame=np.tile(np.arange(count, dtype=np.int32), number),
        xy=moved.transpose(1, 0, 2).reshape(-1, 2).astype(np.float32),
    )


def first_row(rows):
    return next(row for row in rows if row["draw"] == -1 and row["frame0"] == 0)


def test_exact_tracks_are_right_everywhere(drive, paths):
    row = first_row(judge(TrackMatches(tracks_of(paths)), drive, ONE_GAP))

    assert set(row) == set(COLUMNS)
    assert row["matches"] == row["static"] == row["distinct"] == paths.shape[1]
    assert row["within_1px"] == row["verified_within_1px"] == 1
    assert row["median_px"] < 1e-3
    assert row["pose_deg"] < 0.1
    assert row["coverage"] == row["right_coverage"] == pytest.approx(paths.shape[1] / (40 * 23))


def test_a_constant_offset_is_the_error(drive, paths):
    row = first_row(judge(TrackMatches(tracks_of(paths, (0.0, 2.0))), drive, ONE_GAP))

    assert row["median_px"] == pytest.approx(2, abs=1e-3)
    assert (row["within_1px"], row["within_3px"], row["right_coverage"]) == (0, 1, 0)


def test_an_error_along_the_epipolar_lines_is_seen_where_sampson_is_blind(drive, paths):
    slid = paths.copy()  # outwards: the camera moves forward
    for frame in range(1, 6):
        pose = relative_pose(drive.cam_from_world[0], drive.cam_from_world[frame])
        slid[frame] -= 2 * epipolar_direction(paths[0], paths[frame], drive.camera, pose)
    row = first_row(judge(TrackMatches(tracks_of(slid)), drive, ONE_GAP))

    assert row["along_px"] == pytest.approx(2, abs=0.01)
    assert row["across_px"] < 0.01
    assert row["sampson_px"] < 0.1


def test_a_match_to_a_hidden_place_is_wrong_though_it_looks_exact(drive):
    x, y = np.meshgrid(np.arange(4, 316, 2), np.arange(4, 176, 2))
    xy = np.column_stack([x.ravel(), y.ravel()]) + 0.5
    target, visible = drive.truth.scene.transfer(0, 3, xy)
    inside = ((target > 0) & (target < (320, 180))).all(axis=1)
    hidden = inside & ~visible
    assert hidden.sum() > 20
    points = np.stack([xy[hidden], xy[hidden], xy[hidden], target[hidden]])
    row = first_row(judge(TrackMatches(tracks_of(points)), drive, ONE_GAP))

    assert row["static"] == hidden.sum()
    assert (row["within_3px"], row["median_px"]) == (0, np.inf)


def test_moving_points_are_counted_apart(drive, paths):
    half = replace(drive, truth=SceneTruth(drive.truth.scene, moving_left_of=160.0))
    row = first_row(judge(TrackMatches(tracks_of(paths)), half, ONE_GAP))

    left = int((paths[0, :, 0] < 160).sum())
    assert (row["moving"], row["static"]) == (left, paths.shape[1] - left)
    assert row["moving_within_1px"] == 1


def test_a_method_without_matches_fails_and_is_not_left_out(drive):
    rows = judge(TrackMatches(Tracks.from_lists()), drive, ONE_GAP)

    assert len(rows) == 3 * 3
    assert all(row["pose_deg"] == np.inf and row["right_coverage"] == 0 for row in rows)


def test_a_camera_that_stands_still_is_judged_by_its_rotation_alone(drive, paths):
    still = replace(drive, cam_from_world=np.repeat(drive.cam_from_world[:1], 6, axis=0))
    still = replace(still, truth=None)
    rows = judge(TrackMatches(tracks_of(np.repeat(paths[:1], 6, axis=0))), still, ONE_GAP)

    assert np.isnan(first_row(rows)["translation_deg"])
    assert first_row(rows)["pose_deg"] == first_row(rows)["rotation_deg"]


def test_a_draw_drops_whole_tracks_and_repeats(drive, paths):
    matches = TrackMatches(tracks_of(paths))
    rows = judge(matches, drive, ONE_GAP)
    counts = {(row["frame0"], row["draw"]): row["matches"] for row in rows}

    expected = round(0.8 * paths.shape[1])
    assert {count for (_, draw), count in counts.items() if draw >= 0} == {expected}
    np.testing.assert_equal(judge(matches, drive, ONE_GAP), rows)
    first = matches.kept(0, 3, share=0.8, seed=0)
    np.testing.assert_array_equal(matches.kept(1, 4, share=0.8, seed=0), first)
    assert (matches.kept(0, 3, share=0.8, seed=1) != first).any()


def test_keypoints_dropped_from_a_frame_are_missing_in_all_its_pairs():
    xy = np.zeros((100, 2), np.float32)
    every = np.repeat(np.arange(100, dtype=np.uint32)[:, None], 2, axis=1)
    matches = KeypointMatches(keypoints=(xy, xy, xy), matches={(0, 1): every, (0, 2): every})
    kept = [matches.kept(0, frame, share=0.8, seed=3) for frame in (1, 2)]

    assert all(50 < marks.sum() < 80 for marks in kept)  # both ends of a match must survive
    assert (kept[0] | kept[1]).sum() <= 80
    assert len(matches.between(1, 2)) == 0


def test_a_database_written_and_read_again_holds_the_same_matches(drive, paths, tmp_path):
    tracks = TrackMatches(tracks_of(paths))
    names = [f"{frame:06d}.png" for frame in range(6)]
    tracks.write(tmp_path / "tracks.db", drive.camera, names, sample=None)
    read = KeypointMatches.from_database(tmp_path / "tracks.db")
    read.write(tmp_path / "matches.db", drive.camera, names, sample=None)

    pair = read.between(0, 3)
    np.testing.assert_array_equal(pair.xy1, tracks.between(0, 3).xy1)
    counts = []
    for name in ("tracks.db", "matches.db"):
        with pycolmap.Database.open(tmp_path / name) as database:
            counts.append((database.num_verified_image_pairs(), database.num_inlier_matches()))
    assert counts[0] == counts[1]
