"""What stands in the way of a model is named, with the pictures where it does."""

import numpy as np
import pytest

from mvmatch.errors import BitstreamError
from mvmatch.export.colmap import write_database
from mvmatch.footage import Footage
from mvmatch.overlays import Overlays
from mvmatch.rows import count_entering
from mvmatch.sfm import Diagnosis, MapperOptions, diagnose, reconstruct
from mvmatch.types import Tracks

pycolmap = pytest.importorskip("pycolmap")

FOCAL = 500.0
SIZE = np.array([640, 480])
QUICK = MapperOptions(max_attempts=1, fallback=False)


def camera(focal=FOCAL, *, known=True):
    made = pycolmap.Camera(model="PINHOLE", width=640, height=480, params=[focal, focal, 320, 240])
    made.has_prior_focal_length = known
    return made


def cloud(count=500, seed=0):
    """Points around a path along x, seen along z."""
    return np.random.default_rng(seed).uniform([-8, -4, 3], [20, 4, 25], (count, 3))


def observe(centers, *, points=None, angles=None, hidden=(), noise=0.1):
    """Tracks of points from centers; tracks end at the hidden boundaries."""
    points = cloud() if points is None else points
    angles = np.zeros(len(centers)) if angles is None else angles
    generator = np.random.default_rng(1)
    rows = {}
    for frame, (center, angle) in enumerate(zip(centers, angles, strict=True)):
        c, s = np.cos(angle), np.sin(angle)
        seen = (points - center) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]).T
        xy = seen[:, :2] / seen[:, 2:] * FOCAL + SIZE / 2
        xy += generator.normal(scale=noise, size=xy.shape)
        inside = (seen[:, 2] > 0.5) & (xy > 0).all(axis=1) & (xy < SIZE).all(axis=1)
        part = sum(frame >= boundary for boundary in hidden)
        for index in np.flatnonzero(inside):
            rows.setdefault((index, part), []).append((frame, *xy[index]))
    return Tracks.from_lists(*(row for row in rows.values() if len(row) >= 3))


def sideways(count, step=0.3):
    return np.column_stack([step * np.arange(count), np.zeros((count, 2))])


def footage(**found):
    nowhere = Overlays(end=np.array([1]), cells=np.zeros((1, 1, 1), bool))
    nothing = {"cuts": (), "breaks": (), "jumps": (), "repeats": (), "num_overlay_observations": 0}
    return Footage(**nothing | found, overlays=nowhere)


def examine(tmp_path, tracks, *, given=None, options=QUICK, num_frames=None, **known) -> Diagnosis:
    """Map tracks as a run does, and ask why that failed."""
    path = tmp_path / "database.db"
    names = [f"{frame:06d}.png" for frame in range(num_frames or tracks.num_frames)]
    write_database(tracks, path, camera=given or camera(), image_names=names)
    before = path.read_bytes()
    result = reconstruct(path, tmp_path / "sfm", options=options)
    found = diagnose(result, path, tracks=tracks, footage=known.pop("footage", footage()), **known)
    assert path.read_bytes() == before, "the database is only read"
    return found


def finding(diagnosis, code):
    found = [each for each in diagnosis.findings if each.code == code]
    assert len(found) == 1, [each.code for each in diagnosis.findings]
    assert found[0].sentence.endswith(".")
    assert found[0].advice.endswith(".")
    return found[0]


def test_a_whole_model_has_nothing_to_say(tmp_path):
    assert examine(tmp_path, observe(sideways(10))) == Diagnosis(status="complete", findings=())


def test_a_scene_cut_is_named_with_its_picture_and_what_is_missing(tmp_path):
    tracks = observe(sideways(16), hidden=(10,))
    lenient = MapperOptions(acceptance=_any_share())
    found = examine(tmp_path, tracks, options=lenient, footage=footage(cuts=(10,)))
    assert found.status == "partial"
    assert [each.code for each in found.findings] == ["scene-cut", "unregistered"]
    assert finding(found, "scene-cut").frames == ((10, 10),)
    assert finding(found, "unregistered").frames == ((10, 15),)
    assert "10 to 15" in finding(found, "unregistered").sentence


def test_tracks_that_end_at_a_key_frame_are_told_from_a_cut(tmp_path):
    found = examine(tmp_path, observe(sideways(16), hidden=(8,)), key_frames=(0, 8))
    assert found.status == "partial"
    assert finding(found, "key-frame").frames == ((8, 8),)
    assert "--re-encode" in finding(found, "key-frame").advice


def test_a_gap_between_two_pictures_is_found_where_it_is(tmp_path):
    found = examine(tmp_path, observe(sideways(16), hidden=(7,)))
    gap = finding(found, "few-tracks")
    assert gap.frames == ((6, 7),)
    assert gap.sentence.startswith("Only 0 tracks lead from picture 6 to 7")


def test_pictures_with_hardly_a_point_are_found(tmp_path):
    tracks = observe(sideways(12))
    dropped = (tracks.frame == 4) & (tracks.track_index > 5)
    thinned = Tracks(
        offsets=np.concatenate(
            ([0], np.cumsum(np.bincount(tracks.track_index[~dropped], minlength=len(tracks))))
        ).astype(np.int64),
        frame=tracks.frame[~dropped],
        xy=tracks.xy[~dropped],
    )
    found = examine(tmp_path, thinned)
    assert finding(found, "few-tracks").frames == ((4, 4),)
    assert finding(found, "unregistered").frames == ((4, 4),)


def test_a_camera_at_rest_has_no_parallax_at_all(tmp_path):
    found = examine(tmp_path, observe(np.zeros((12, 3)), noise=0.05))
    assert found.status == "failed"
    assert [each.code for each in found.findings] == ["static"]
    assert found.findings[0].frames == ((0, 11),)


def test_a_rest_in_the_middle_is_found_beside_what_broke_the_model(tmp_path):
    path = np.concatenate([sideways(8), np.repeat(sideways(8)[-1:], 14, axis=0)])
    found = examine(tmp_path, observe(path, noise=0.05, hidden=(4,)))
    assert finding(found, "few-tracks").frames == ((3, 4),)
    assert finding(found, "static").frames == ((7, 21),)


def test_slow_motion_is_not_rest(tmp_path):
    found = examine(tmp_path, observe(sideways(20, step=0.006), noise=0.02, hidden=(10,)))
    assert "static" not in [each.code for each in found.findings]


def test_a_camera_that_only_turns_is_told_from_one_that_moves(tmp_path):
    found = examine(tmp_path, observe(np.zeros((12, 3)), angles=np.linspace(0, 0.4, 12)))
    assert found.status == "failed"
    assert [each.code for each in found.findings] == ["rotation"]
    assert found.findings[0].frames == ((0, 11),)


def test_a_turn_in_the_middle_is_found_near_where_it_is(tmp_path):
    centers = np.concatenate([sideways(12), np.repeat(sideways(12)[-1:], 24, axis=0)])
    angles = np.concatenate([np.zeros(12), np.linspace(0, 0.9, 24)])
    points = np.concatenate([cloud(400), cloud(400, seed=3) * [1, 1, 0.6] + [10, 0, 0]])
    found = examine(tmp_path, observe(centers, angles=angles, points=points, hidden=(5,)))
    ((first, last),) = finding(found, "rotation").frames
    assert abs(first - 12) <= 5
    assert last == 35


def test_a_wall_is_named_as_the_plane_it_is(tmp_path):
    wall = cloud(1500)
    wall[:, 2] = 6.0
    found = examine(tmp_path, observe(sideways(14), points=wall, hidden=(7,)))
    assert finding(found, "planar").frames[0][0] <= 1


def test_a_wrong_focal_length_is_named_with_a_better_one(tmp_path):
    angles = np.linspace(0, 0.5, 14)
    path = np.column_stack([2 * np.sin(angles), np.zeros(14), 0.25 * np.arange(14)])
    found = examine(tmp_path, observe(path, angles=angles), given=camera(2 * FOCAL))
    assert found.status == "failed"
    text = finding(found, "focal-length").sentence
    assert "1000 px" in text
    better = float(text.split("it is ")[1].split(" px")[0])
    assert abs(better - FOCAL) < abs(2 * FOCAL - better)


def test_damage_makes_a_whole_model_a_partial_one(tmp_path):
    damage = BitstreamError("the frame at byte 17 is cut off")
    found = examine(tmp_path, observe(sideways(10)), damage=damage)
    assert found.status == "partial"
    assert [each.code for each in found.findings] == ["damage"]
    assert found.findings[0].frames == ((10, 10),)
    assert "byte 17" in found.findings[0].sentence


def test_repeated_pictures_are_mentioned_when_something_is_wrong(tmp_path):
    repeats = footage(repeats=(3,))
    assert examine(tmp_path, observe(sideways(8)), footage=repeats).findings == ()
    found = examine(tmp_path, observe(sideways(16), hidden=(7,)), footage=repeats)
    assert finding(found, "repeats").frames == ((3, 3),)


def test_a_camera_at_rest_is_named_though_all_tracks_move(tmp_path):
    seen = footage(still_area_share=0.75)
    found = examine(tmp_path, observe(sideways(20), hidden=(10,)), footage=seen)
    assert finding(found, "static").frames == ((0, 19),)


def test_what_nothing_explains_still_has_a_sentence(tmp_path):
    strict = MapperOptions(max_attempts=1, fallback=False, acceptance=_impossible())
    found = examine(tmp_path, observe(sideways(8)), options=strict)
    assert found.status == "failed"
    assert "reprojection error" in finding(found, "unexplained").sentence


def test_no_tracks_at_all_are_few_tracks(tmp_path):
    found = examine(tmp_path, Tracks.from_lists(), num_frames=4)
    assert finding(found, "few-tracks").frames == ((0, 3),)


def test_tracks_are_counted_where_they_lead_on():
    tracks = Tracks.from_lists([(0, 1, 1), (3, 1, 1)], [(1, 2, 2), (2, 2, 2)])
    assert count_entering(tracks, 5).tolist() == [0, 1, 2, 1, 0]


def _any_share():
    from mvmatch.sfm import AcceptanceOptions

    return AcceptanceOptions(min_registered=0.3, min_observations=0.1, min_part=0.5)


def _impossible():
    from mvmatch.sfm import AcceptanceOptions

    return AcceptanceOptions(max_reprojection_error=0.0)
