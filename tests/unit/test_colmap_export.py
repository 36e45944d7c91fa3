import sqlite3

import numpy as np
import pytest

from mvmatch.errors import DataError
from mvmatch.export.colmap import write_database
from mvmatch.export.scores import score_database
from mvmatch.export.verification import VerificationOptions
from mvmatch.types import Tracks

pycolmap = pytest.importorskip("pycolmap")


def camera():
    return pycolmap.Camera(model="PINHOLE", width=640, height=480, params=[500, 500, 320, 240])


def sideways_tracks(frames: int = 4, points: int = 60) -> Tracks:
    """Static points before a camera that moves 0.2 to the right per frame; depths 4 to 12."""
    generator = np.random.default_rng(0)
    x, y, z = generator.uniform([-1, -1.5, 4], [1, 1.5, 12], (points, 3)).T
    return Tracks.from_lists(
        *(
            [
                (f, 500 * (x[p] - 0.2 * f) / z[p] + 320, 500 * y[p] / z[p] + 240)
                for f in range(frames)
            ]
            for p in range(points)
        )
    )


NAMES = [f"{frame:06d}.png" for frame in range(4)]


def test_images_are_numbered_in_frame_order_and_keypoints_keep_their_origin(tmp_path):
    tracks = sideways_tracks()
    write_database(tracks, tmp_path / "database.db", camera=camera(), image_names=NAMES)

    with pycolmap.Database.open(tmp_path / "database.db") as database:
        images = database.read_all_images()
        assert [(image.image_id, image.name) for image in images] == list(enumerate(NAMES, 1))
        assert [image.frame_id for image in images] == [1, 2, 3, 4]
        for frame in range(4):
            keypoints = database.read_keypoints(frame + 1)[:, :2]
            np.testing.assert_array_equal(keypoints, tracks.keypoints(frame))


def test_matches_and_geometries_hold_every_pair_of_a_track_up_to_the_gap(tmp_path):
    summary = write_database(
        sideways_tracks(), tmp_path / "database.db", camera=camera(), image_names=NAMES, max_gap=2
    )

    assert (summary.num_images, summary.num_keypoints) == (4, 240)
    assert (summary.num_pairs, summary.num_verified_pairs) == (5, 5)
    assert summary.num_inliers == summary.num_matches == 300
    with pycolmap.Database.open(tmp_path / "database.db") as database:
        assert database.num_verified_image_pairs() == 5
        assert not database.exists_matches(1, 4)
        np.testing.assert_array_equal(
            database.read_matches(1, 3), np.column_stack([np.arange(60)] * 2)
        )
        pose = database.read_two_view_geometry(1, 3).cam2_from_cam1
    np.testing.assert_allclose(pose.translation, [-1, 0, 0], atol=1e-3)


def test_wrong_matches_stay_out_of_the_geometry_unless_they_are_trusted(tmp_path):
    tracks = sideways_tracks(frames=2)
    tracks.xy[tracks.observations(1)[:10], 1] += 50  # rows that cannot move under sideways motion

    inliers = {}
    for mode in ("all", "sampled", "trust"):
        options = VerificationOptions(mode=mode, max_sample=40)
        path = tmp_path / f"{mode}.db"
        summary = write_database(
            tracks, path, camera=camera(), image_names=NAMES[:2], verification=options
        )
        inliers[mode] = summary.num_inliers
    assert inliers == {"all": 50, "sampled": 50, "trust": 60}


def test_a_frame_without_tracks_is_an_image_without_keypoints(tmp_path):
    write_database(
        sideways_tracks(frames=2), tmp_path / "database.db", camera=camera(), image_names=NAMES
    )

    with pycolmap.Database.open(tmp_path / "database.db") as database:
        assert database.num_images() == 4
        assert database.num_keypoints_for_image(4) == 0


def test_tracks_beyond_the_names_are_refused_and_nothing_is_left_behind(tmp_path):
    with pytest.raises(DataError, match="reach frame 3"):
        write_database(
            sideways_tracks(), tmp_path / "database.db", camera=camera(), image_names=NAMES[:2]
        )
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_does_not_exist_is_named(tmp_path):
    path = tmp_path / "missing" / "database.db"
    with pytest.raises(DataError, match="missing"):
        write_database(sideways_tracks(), path, camera=camera(), image_names=NAMES)


def test_an_older_database_survives_a_failed_write(tmp_path, monkeypatch):
    path = tmp_path / "database.db"
    write_database(sideways_tracks(), path, camera=camera(), image_names=NAMES)
    before = path.read_bytes()

    def fail(*_arguments, **_options):
        raise RuntimeError("power cut")

    monkeypatch.setattr("mvmatch.export.verification.fit_pair", fail)
    with pytest.raises(RuntimeError, match="power cut"):
        write_database(sideways_tracks(), path, camera=camera(), image_names=NAMES)
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["database.db"]


def test_scores_are_made_from_the_stored_matches_of_any_front_end(tmp_path):
    path = tmp_path / "database.db"
    write_database(sideways_tracks(), path, camera=camera(), image_names=NAMES)
    with sqlite3.connect(path) as connection:
        connection.execute("DELETE FROM two_view_geometries")
    connection.close()

    scores = score_database(path, max_gap=2)
    assert [(s.frame0, s.frame1) for s in scores] == [(0, 1), (0, 2), (1, 2), (1, 3), (2, 3)]
    assert all(score.inlier_ratio == 1.0 for score in scores)


def test_a_text_file_is_not_a_database(tmp_path):
    path = tmp_path / "database.db"
    path.write_text("hello")
    with pytest.raises(DataError, match="not a COLMAP database"):
        score_database(path)


def test_a_database_written_piece_by_piece_is_the_one_written_at_once(tmp_path, monkeypatch):
    frames = 70
    tracks, further = sideways_tracks(frames, 40), sideways_tracks(frames, 10)
    names = [f"{frame:06d}.png" for frame in range(frames)]

    def rows(name: str, size: int) -> list[list[tuple]]:
        for constant in ("export.colmap._FRAMES", "export.verification._FRAMES", "pairing.FRAMES"):
            monkeypatch.setattr(f"mvmatch.{constant}", size)
        path = tmp_path / name
        write_database(tracks, path, camera=camera(), image_names=names, further=further)
        tables = ("keypoints", "matches", "two_view_geometries")
        with sqlite3.connect(path) as database:
            return [database.execute(f"SELECT * FROM {table}").fetchall() for table in tables]

    pieces, whole = rows("pieces.db", 3), rows("whole.db", 1000)
    assert pieces == whole
    assert [len(table) for table in whole] == [70, 645, 645]


def far_apart(tracks: Tracks) -> Tracks:
    """The same with the third and fourth frame thirty frames later."""
    frame = np.where(tracks.frame < 2, tracks.frame, tracks.frame + 28).astype(np.int32)
    return Tracks(offsets=tracks.offsets, frame=frame, xy=tracks.xy)


FAR_NAMES = [f"{frame:06d}.png" for frame in range(32)]


@pytest.mark.parametrize("mode", ["tracks", "sampled", "all", "trust"])
def test_pairs_of_a_loop_are_matched_however_far_apart(mode, tmp_path):
    tracks, path = far_apart(sideways_tracks()), tmp_path / "database.db"
    summary = write_database(
        tracks,
        path,
        camera=camera(),
        image_names=FAR_NAMES,
        max_gap=2,
        verification=VerificationOptions(mode=mode),
        loops=[(1, 31), (0, 30), (0, 1), (5, 20)],
    )
    with pycolmap.Database.open(path) as database:
        written = [
            tuple(pycolmap.pair_id_to_image_pair(pair))
            for pair in database.read_two_view_geometries()[0]
        ]
        for ids in ((1, 31), (2, 32)):
            inliers = database.read_two_view_geometry(*ids).inlier_matches
            np.testing.assert_array_equal(inliers, np.repeat(np.arange(60), 2).reshape(60, 2))
    assert sorted(written) == [(1, 2), (1, 31), (2, 32), (31, 32)]
    assert summary.num_pairs == summary.num_verified_pairs == 4


def test_a_loop_that_no_camera_could_have_made_is_not_verified(tmp_path):
    tracks, path = far_apart(sideways_tracks()), tmp_path / "database.db"
    xy = tracks.xy.copy()
    late = np.flatnonzero(tracks.frame >= 30)
    xy[late] = np.random.default_rng(0).uniform([0, 0], [640, 480], (len(late), 2))
    scrambled = Tracks(offsets=tracks.offsets, frame=tracks.frame, xy=xy)
    write_database(
        scrambled, path, camera=camera(), image_names=FAR_NAMES, max_gap=2, loops=[(0, 30)]
    )
    with pycolmap.Database.open(path) as database:
        assert database.exists_matches(1, 31)
        assert not database.exists_two_view_geometry(1, 31)
