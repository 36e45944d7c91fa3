"""Key frames are chosen by what tracks do; what is not mapped gets its pose from the map."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from mvmatch.errors import DataError
from mvmatch.sfm.keyframes import KeyframeOptions, choose_keyframes
from mvmatch.types import Tracks

pycolmap = pytest.importorskip("pycolmap")

from mvmatch.export.colmap import write_database  # noqa: E402
from mvmatch.export.verification import VerificationOptions  # noqa: E402
from mvmatch.geometry.trajectory import trajectory_error  # noqa: E402
from mvmatch.sfm import MapperOptions, densify, reconstruct  # noqa: E402
from mvmatch.sfm.database import read_image_tracks  # noqa: E402
from mvmatch.sfm.keyframes import select_keyframes  # noqa: E402

DIAGONAL = 800.0
FOCAL = 500.0


def moving(positions: list[float], *, life: int | None = None) -> Tracks:
    """Points that all move along x, to these positions; with a life, ten start in each frame."""
    rows: list[list[tuple[int, float, float]]] = []
    count = len(positions)
    for start in range(count) if life is not None else [0]:
        end = count if life is None else min(count, start + life)
        frames = range(start, end)
        rows += [[(f, 20.0 + positions[f], 30.0 * line) for f in frames] for line in range(10)]
    return Tracks.from_lists(*(row for row in rows if len(row) >= 2))


def chosen(tracks: Tracks, **options) -> list[int]:
    return choose_keyframes(tracks, diagonal=DIAGONAL, options=KeyframeOptions(**options)).tolist()


def test_key_frames_follow_the_motion_of_the_tracks():
    slow, fast = [8.0 * f for f in range(31)], [20.0 * f for f in range(31)]
    assert chosen(moving(slow), min_displacement=0.05) == [0, 5, 10, 15, 20, 25, 30]
    assert chosen(moving(fast), min_displacement=0.05) == list(range(0, 31, 2))


def test_key_frames_are_never_farther_apart_than_matches_reach_while_something_moves():
    assert chosen(moving(list(range(25))), max_gap=10) == [0, 10, 20, 24]


def test_a_camera_at_rest_adds_no_key_frame():
    stops = [8.0 * min(f, 10) + 8.0 * max(f - 60, 0) for f in range(71)]
    frames = chosen(moving(stops), min_displacement=0.05)
    assert frames == [0, 5, 10, 61, 66, 70]
    assert chosen(moving([0.0] * 50)) == [0]


def test_repeated_pictures_add_no_key_frame():
    plain = [8.0 * f for f in range(21)]
    twice = [8.0 * (f // 2) for f in range(42)]
    once = chosen(moving(plain), min_displacement=0.05, max_gap=100)
    repeated = chosen(moving(twice), min_displacement=0.05, max_gap=100)
    assert [frame // 2 for frame in repeated] == once


@pytest.mark.parametrize("least", [0.3, 0.5, 0.8])
def test_successive_key_frames_share_the_tracks_that_were_asked_for(least):
    tracks = moving([0.1 * f for f in range(60)], life=10)
    frames = chosen(tracks, min_share=least)
    shared = [len(tracks.between(a, b)) / len(tracks.observations(a)) for a, b in pairwise(frames)]
    assert min(shared) >= least
    assert len(frames) < 60


def test_a_cut_has_a_key_frame_on_either_side():
    before = [[(f, 8.0 * f, 30.0 * k) for f in range(13)] for k in range(10)]
    after = [[(f, 8.0 * f, 30.0 * k) for f in range(13, 30)] for k in range(10)]
    frames = chosen(Tracks.from_lists(*before, *after))
    assert {12, 13} <= set(frames)


def test_frames_without_tracks_are_no_key_frames():
    late = [[(f, 8.0 * f, 30.0 * k) for f in (*range(5, 12), *range(14, 25))] for k in range(10)]
    assert chosen(Tracks.from_lists(*late), min_displacement=0.05) == [5, 10, 15, 20, 24]
    assert chosen(Tracks.from_lists()) == []


def corridor(num_frames: int, *, without: tuple[int, ...] = ()) -> Tracks:
    """Tracks of points along the way of a camera that looks sideways and sways."""
    generator = np.random.default_rng(0)
    points = generator.uniform([-4, -4, 4], [4 + 0.15 * num_frames, 4, 14], (7 * num_frames, 3))
    seen = points[:, None] - centers(num_frames)
    xy = seen[..., :2] / seen[..., 2:] * FOCAL + [320, 240]
    xy += generator.normal(scale=0.2, size=xy.shape)
    inside = ((xy > 0) & (xy < [640, 480])).all(axis=2)
    inside[:, list(without)] = False
    rows = [[(f, *xy[p, f]) for f in np.flatnonzero(inside[p])] for p in range(len(points))]
    return Tracks.from_lists(*(row for row in rows if len(row) >= 3))


def centers(num_frames: int) -> np.ndarray:
    frames = np.arange(num_frames)
    return np.stack([0.15 * frames, 0.1 * np.sin(frames / 5), 0.2 * np.sin(frames / 9)], axis=1)


def write(tracks: Tracks, path, num_frames: int, **options):
    camera = pycolmap.Camera(
        model="PINHOLE", width=640, height=480, params=[FOCAL, FOCAL, 320, 240]
    )
    camera.has_prior_focal_length = True
    names = [f"{frame:06d}.png" for frame in range(num_frames)]
    write_database(tracks, path, camera=camera, image_names=names, **options)
    return path


def test_tracks_come_back_from_the_matches_of_a_database(tmp_path):
    tracks = corridor(30, without=(11,))
    trust = VerificationOptions(mode="trust")
    path = write(tracks, tmp_path / "database.db", 30, verification=trust, max_gap=None)
    read = read_image_tracks(path)

    def by_content(each: Tracks) -> set[tuple[tuple[int, float, float], ...]]:
        observed = list(zip(each.frame.tolist(), *each.xy.T.tolist(), strict=True))
        bounds = each.offsets.tolist()
        return {tuple(observed[a:b]) for a, b in pairwise(bounds)}

    assert by_content(read.tracks) == by_content(tracks)
    assert read.image_ids.tolist() == list(range(1, 31))
    with pycolmap.Database.open(path) as database:
        for frame in range(30):
            observed = read.tracks.observations(frame)
            keypoints = database.read_keypoints(frame + 1)
            np.testing.assert_array_equal(
                keypoints[read.keypoint[observed]], read.tracks.xy[observed]
            )


def test_matches_that_contradict_each_other_leave_tracks_with_one_keypoint_per_image(tmp_path):
    path = write(corridor(9), tmp_path / "database.db", 9)
    with pycolmap.Database.open(path) as database:
        database.clear_two_view_geometries()
        crossed = np.stack([np.arange(20), np.arange(20)[::-1]], axis=1).astype(np.uint32)
        straight = np.stack([np.arange(20), np.arange(20)], axis=1).astype(np.uint32)
        doubled = np.stack([np.zeros(20), np.arange(20)], axis=1).astype(np.uint32)
        for pair, matches in (((1, 2), straight), ((2, 3), crossed), ((1, 3), doubled)):
            geometry = pycolmap.TwoViewGeometry()
            geometry.inlier_matches = matches
            database.write_two_view_geometry(*pair, geometry)
    tracks = read_image_tracks(path).tracks
    assert len(tracks) == 20
    for a, b in pairwise(tracks.offsets):
        assert (np.diff(tracks.frame[a:b]) > 0).all()


def test_matches_of_keypoints_that_are_not_there_are_refused(tmp_path):
    path = write(corridor(9), tmp_path / "database.db", 9)
    with pycolmap.Database.open(path) as database:
        geometry = database.read_two_view_geometry(1, 2)
        geometry.inlier_matches = geometry.inlier_matches + np.uint32(10_000)
        database.update_two_view_geometry(1, 2, geometry)
    with pytest.raises(DataError, match="images 1 and 2 have matches of keypoints"):
        read_image_tracks(path)


def test_a_long_video_without_a_single_match_gives_no_model_and_says_why(tmp_path):
    path = write(moving([0.0, 1.0]), tmp_path / "database.db", 70)
    result = reconstruct(path, tmp_path / "sfm")
    assert not result.accepted
    assert result.reasons == ("no image pair has enough verified matches",)


def test_short_sequences_and_matches_across_the_whole_are_mapped_as_they_are(tmp_path):
    near = write(corridor(40), tmp_path / "near.db", 40)
    far = write(corridor(40), tmp_path / "far.db", 40, max_gap=None)
    assert select_keyframes(near, KeyframeOptions()) is None
    assert select_keyframes(near, KeyframeOptions(max_images=39)) is not None
    assert select_keyframes(near, KeyframeOptions(max_images=39, mode="all")) is None
    assert select_keyframes(far, KeyframeOptions(max_images=39, max_reach=10)) is None


def there_and_back(half: int) -> tuple[Tracks, list[tuple[int, int]]]:
    """Tracks of a corridor and of the way back, a few of them tied together at its ends."""
    there = corridor(half)
    back = there.frame[::-1]
    returned = Tracks(
        offsets=(there.offsets[-1] - there.offsets[::-1]).astype(np.int64),
        frame=(2 * half - 1 - back).astype(np.int32),
        xy=there.xy[::-1],
    )
    start = (0, 5, 10)
    rows: list[list[tuple[int, float, float]]] = []
    for a, b in pairwise(there.offsets.tolist()):
        seen = {int(f): xy for f, xy in zip(there.frame[a:b], there.xy[a:b].tolist(), strict=True)}
        if all(frame in seen for frame in start):
            row = [(frame, *seen[frame]) for frame in start]
            rows.append(row + [(2 * half - 1 - f, x, y) for f, x, y in reversed(row)])
    pairs = [(a, 2 * half - 1 - b) for a in start for b in start]
    return Tracks.concatenate(there, returned, Tracks.from_lists(*rows)), pairs


def test_a_loop_is_mapped_by_key_frames_and_ties_its_ends_together(tmp_path):
    tracks, loops = there_and_back(40)
    trust = VerificationOptions(mode="trust")
    path = write(tracks, tmp_path / "database.db", 80, loops=loops, verification=trust)
    # So few keypoints that nothing but loops would be left of the others.
    options = KeyframeOptions(max_keypoints=20, max_observations=20)
    selection = select_keyframes(path, options, mapped=tmp_path / "keys.db")
    assert selection is not None
    assert {frame for pair in loops for frame in pair} <= set(selection.frames.tolist())
    images = selection.read_images()
    within = images.tracks.select(selection.within_model(images.tracks))
    assert len(within.between(0, 79)) == len(tracks.between(0, 79)) >= 30
    with pycolmap.Database.open(tmp_path / "keys.db") as database:
        for first, second in loops:
            geometry = database.read_two_view_geometry(first + 1, second + 1)
            assert len(geometry.inlier_matches) == len(tracks.between(first, second))


def test_loops_leave_the_other_key_frames_as_they_are(tmp_path):
    tracks, loops = there_and_back(40)
    trust = VerificationOptions(mode="trust")
    plain = write(tracks, tmp_path / "plain.db", 80, verification=trust)
    tied = write(tracks, tmp_path / "tied.db", 80, loops=loops, verification=trust)
    without, having = (
        select_keyframes(path, KeyframeOptions()).frames.tolist() for path in (plain, tied)
    )
    assert set(having) <= set(without) | {frame for pair in loops for frame in pair}


def test_the_model_of_a_loop_has_points_seen_from_both_ends(tmp_path):
    tracks, loops = there_and_back(32)
    path = write(tracks, tmp_path / "database.db", 64, loops=loops)
    result = reconstruct(path, tmp_path / "sfm")
    assert result.accepted, result.reasons
    assert result.num_keyframes < result.registered == 64
    both = 0
    for point in result.reconstruction.points3D.values():
        seen = {element.image_id for element in point.track.elements}
        both += bool(seen & {1, 6, 11}) and bool(seen & {64, 59, 54})
    assert both >= 30


def test_a_camera_that_stands_still_for_long_gives_no_model_and_says_why(tmp_path):
    generator = np.random.default_rng(0)
    places = generator.uniform([20, 20], [620, 460], (80, 2))
    rows = [
        [(f, *(place + generator.normal(scale=0.05, size=2))) for f in range(64)]
        for place in places
    ]
    path = write(Tracks.from_lists(*rows), tmp_path / "database.db", 64)
    result = reconstruct(path, tmp_path)
    assert not result.accepted
    assert "does not move" in result.reasons[0]
    assert result.unregistered == ()


def test_key_frames_are_matched_along_the_tracks_within_the_budget(tmp_path):
    path = write(corridor(40), tmp_path / "database.db", 40)
    options = KeyframeOptions(max_images=0, max_keypoints=60)
    selection = select_keyframes(path, options, mapped=tmp_path / "keyframes.db")
    assert selection is not None
    with (
        pycolmap.Database.open(path) as whole,
        pycolmap.Database.open(tmp_path / "keyframes.db") as part,
    ):
        assert [image.image_id for image in part.read_all_images()] == selection.image_ids
        matched = {image_id: set() for image_id in selection.image_ids}
        for pair_id, geometry in zip(*part.read_two_view_geometries(), strict=True):
            first, second = pycolmap.pair_id_to_image_pair(pair_id)
            matched[first].update(geometry.inlier_matches[:, 0].tolist())
            matched[second].update(geometry.inlier_matches[:, 1].tolist())
        for image_id in selection.image_ids:
            np.testing.assert_array_equal(
                part.read_keypoints(image_id), whole.read_keypoints(image_id)
            )
    assert 30 < max(len(keypoints) for keypoints in matched.values()) <= 60


def test_a_model_has_no_more_observations_than_memory_was_planned_for(tmp_path):
    path = write(corridor(40), tmp_path / "database.db", 40)

    def most(**bounds) -> int:
        selection = select_keyframes(path, KeyframeOptions(max_images=0, **bounds))
        tracks = selection.read_images().tracks
        kept = tracks.select(selection.within_model(tracks))
        return int(np.bincount(kept.frame).max())

    everything = most(max_observations=None, max_total=None)
    assert most() == everything > 60
    assert most(max_observations=50) <= 50
    assert most(max_total=40 * 30) <= 30


LENGTH, BLACK = 64, 33


@pytest.fixture(scope="module")
def long_video(tmp_path_factory):
    """A video with one black picture, and the model made of it."""
    folder = tmp_path_factory.mktemp("long")
    tracks = corridor(LENGTH, without=(BLACK,))
    path = write(tracks, folder / "database.db", LENGTH)
    before = path.read_bytes()
    result = reconstruct(path, folder)
    assert path.read_bytes() == before, "the database is only read"
    return path, tracks, result


def test_every_frame_of_a_long_video_that_sees_something_gets_a_pose(long_video):
    _, _, result = long_video
    assert result.accepted
    assert result.num_keyframes < LENGTH // 2
    assert (result.registered, result.total) == (LENGTH - 1, LENGTH)
    model = pycolmap.Reconstruction(result.path)
    frames = [image_id - 1 for image_id in sorted(model.reg_image_ids())]
    found = [model.image(frame + 1).projection_center() for frame in frames]
    assert trajectory_error(found, centers(LENGTH)[frames]).percent_of_path < 0.05


def test_a_frame_that_cannot_be_registered_is_named_with_the_reason(long_video):
    _, _, result = long_video
    (lost,) = result.unregistered
    assert (lost.image_id, lost.name) == (BLACK + 1, f"{BLACK:06d}.png")
    assert "0 points" in lost.reason


def test_the_model_of_a_long_video_fits_its_database_and_takes_further_points(long_video):
    path, tracks, result = long_video
    model = pycolmap.Reconstruction(result.path)
    with pycolmap.Database.open(path) as database:
        for image_id in model.reg_image_ids():
            xy = np.array([point.xy for point in model.image(image_id).points2D])
            np.testing.assert_array_equal(xy, database.read_keypoints(image_id))
    for point_id, point in model.points3D.items():
        for element in point.track.elements:
            image = model.image(element.image_id)
            assert image.point2D(element.point2D_idx).point3D_id == point_id
    assert all(model.image(i).num_points3D >= 30 for i in model.reg_image_ids())
    densify(model, tracks)


def test_key_frames_give_the_path_that_all_frames_give(long_video, tmp_path):
    path, _, result = long_video
    options = MapperOptions(keyframes=KeyframeOptions(mode="all"), max_attempts=1, fallback=False)
    everything = reconstruct(path, tmp_path, options=options)
    assert everything.num_keyframes == LENGTH
    (lost,) = everything.unregistered
    assert lost.image_id == BLACK + 1

    def error(model) -> float:
        frames = [frame for frame in range(LENGTH) if frame != BLACK]
        found = [model.image(frame + 1).projection_center() for frame in frames]
        return trajectory_error(found, centers(LENGTH)[frames]).rmse

    assert error(result.reconstruction) <= 1.2 * error(everything.reconstruction)
