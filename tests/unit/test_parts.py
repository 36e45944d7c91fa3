"""Where no model holds a whole sequence, its parts are delivered, and the joint is named."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mvmatch.footage import Footage
from mvmatch.overlays import Overlays
from mvmatch.types import Tracks

pycolmap = pytest.importorskip("pycolmap")

from mvmatch.export.colmap import write_database  # noqa: E402
from mvmatch.geometry.trajectory import trajectory_error  # noqa: E402
from mvmatch.sfm import (  # noqa: E402
    AcceptanceOptions,
    MapperOptions,
    diagnose,
    reconstruct,
    status_of,
)
from mvmatch.sfm.evidence import read_evidence  # noqa: E402
from mvmatch.sfm.keyframes import KeyframeOptions  # noqa: E402
from mvmatch.sfm.parts import find_joints, is_sound, parted  # noqa: E402
from mvmatch.sfm.result import Joint  # noqa: E402

FOCAL = 500.0
SIZE = np.array([640, 480])
QUICK = MapperOptions(max_attempts=1, fallback=False)

Row = list[tuple[int, float, float]]


def centers(count: int) -> np.ndarray:
    """(F, 3) way of a camera that looks along z, walks along x and sways."""
    frames = np.arange(count)
    return np.stack([0.25 * frames, 0.1 * np.sin(frames / 3), 0.15 * np.cos(frames / 4)], axis=1)


def scene(count: int, *, first: int, seed: int) -> list[Row]:
    """Tracks of a cloud of points through ``count`` pictures, the first of that number."""
    generator = np.random.default_rng(seed)
    points = generator.uniform([-6, -4, 4], [6 + 0.25 * count, 4, 18], (40 * count, 3))
    seen = points[:, None] - centers(count)
    xy = seen[..., :2] / seen[..., 2:] * FOCAL + SIZE / 2
    xy += generator.normal(scale=0.1, size=xy.shape)
    inside = ((xy > 0) & (xy < SIZE)).all(axis=2)
    rows = [[(first + f, *xy[p, f]) for f in np.flatnonzero(inside[p])] for p in range(len(points))]
    return [row for row in rows if len(row) >= 3]


def joined(before: list[Row], after: list[Row], *, first: int, most: int) -> Tracks:
    """Continue some tracks of one scene by those of another that begin near their ends: all wrong.

    ``first``: the first picture of the other scene.
    """
    starts = [row for row in after if row[0][0] == first]
    at = np.array([row[0][1:] for row in starts])
    rows, used = list[Row](), set[int]()
    for row in before:
        distance = np.linalg.norm(at - row[-1][1:], axis=1)
        near = int(distance.argmin())
        is_link = row[-1][0] == first - 1 and near not in used and len(used) < most
        if is_link:
            used.add(near)
        rows.append(row + starts[near] if is_link else row)
    linked = {id(starts[near]) for near in used}
    return Tracks.from_lists(*rows, *(row for row in after if id(row) not in linked))


def mapped(tracks: Tracks, folder, options=QUICK):
    camera = pycolmap.Camera(
        model="PINHOLE", width=640, height=480, params=[FOCAL, FOCAL, 320, 240]
    )
    camera.has_prior_focal_length = True
    names = [f"{frame:06d}.png" for frame in range(tracks.num_frames)]
    write_database(tracks, folder / "database.db", camera=camera, image_names=names)
    return reconstruct(folder / "database.db", folder / "sfm", options=options)


def path_error(folder, image_ids: range) -> float:
    model = pycolmap.Reconstruction(folder)
    assert sorted(model.reg_image_ids()) == list(image_ids)
    found = [model.image(image_id).projection_center() for image_id in image_ids]
    return trajectory_error(found, centers(len(image_ids))).percent_of_path


def test_two_scenes_that_wrong_tracks_join_are_two_models_and_the_joint_is_named(tmp_path):
    tracks = joined(scene(18, first=0, seed=0), scene(12, first=18, seed=1), first=18, most=40)
    result = mapped(tracks, tmp_path)

    assert result.accepted
    assert status_of(result) == "partial"
    (joint,) = result.joints
    assert (joint.before, joint.after) == (18, 19)
    assert "hold the two sides together" in joint.reason
    assert (result.registered, result.total) == (18, 30)
    assert [image.image_id for image in result.unregistered] == list(range(19, 31))
    assert result.path == tmp_path / "sfm" / "0"
    assert result.further == (tmp_path / "sfm" / "1",)
    assert path_error(result.path, range(1, 19)) < 0.3
    assert path_error(result.further[0], range(19, 31)) < 0.3
    assert result.attempts[0].images == (1, 30)
    assert not result.attempts[0].check.accepted


def test_the_doctor_names_a_joint_that_enough_tracks_lead_across(tmp_path):
    tracks = joined(scene(18, first=0, seed=0), scene(12, first=18, seed=1), first=18, most=40)
    result = mapped(tracks, tmp_path)
    nowhere = Overlays(end=np.array([1]), cells=np.zeros((1, 1, 1), bool))
    footage = Footage(
        cuts=(), breaks=(), jumps=(), repeats=(), num_overlay_observations=0, overlays=nowhere
    )
    found = diagnose(result, tmp_path / "database.db", tracks=tracks, footage=footage)

    assert found.status == "partial"
    assert [each.code for each in found.findings] == ["joint", "other-model"]
    assert found.findings[0].frames == ((17, 18),)
    assert found.findings[0].sentence.startswith("No model holds across the pictures 17 to 18: ")
    assert found.findings[1].frames == ((18, 29),)
    assert "18 to 29 are in a model of their own, number 1" in found.findings[1].sentence

    alone = dataclasses.replace(result, further=())
    found = diagnose(alone, tmp_path / "database.db", tracks=tracks, footage=footage)
    assert [each.code for each in found.findings] == ["joint", "unregistered"]
    assert found.findings[1].frames == ((18, 29),)


def test_two_scenes_without_a_track_between_them_are_two_models(tmp_path):
    tracks = Tracks.from_lists(*scene(10, first=0, seed=0), *scene(14, first=10, seed=1))
    result = mapped(tracks, tmp_path)

    assert [(joint.before, joint.after) for joint in result.joints] == [(10, 11)]
    assert path_error(result.path, range(11, 25)) < 0.3
    assert path_error(result.further[0], range(1, 11)) < 0.3


def test_parts_of_a_long_video_hold_all_their_images_and_none_of_the_others(tmp_path):
    before, after = scene(40, first=0, seed=0), scene(30, first=40, seed=1)
    keyframes = KeyframeOptions(max_images=20)
    options = MapperOptions(max_attempts=1, fallback=False, keyframes=keyframes)
    result = mapped(joined(before, after, first=40, most=40), tmp_path, options)

    assert result.num_keyframes < result.total
    (joint,) = result.joints
    assert joint.before <= 40 < joint.after
    assert abs(result.registered - 40) <= joint.after - joint.before
    model = pycolmap.Reconstruction(result.path)
    assert sorted(model.reg_image_ids()) == list(range(1, result.registered + 1))
    assert len(result.unregistered) == 70 - result.registered


def test_a_part_that_is_too_small_is_no_model(tmp_path):
    tracks = Tracks.from_lists(*scene(10, first=0, seed=0), *scene(14, first=10, seed=1))
    large = AcceptanceOptions(min_part=0.7)
    result = mapped(
        tracks, tmp_path, MapperOptions(max_attempts=1, fallback=False, acceptance=large)
    )

    assert status_of(result) == "failed"
    assert (result.path, result.further, result.joints) == (None, (), ())
    assert "images are registered" in result.reasons[0]
    assert not (tmp_path / "sfm").exists()


def test_a_part_that_few_points_hold_together_is_no_model(tmp_path):
    strict = dataclasses.replace(QUICK, acceptance=AcceptanceOptions(min_part_joint=10_000))
    parts = Tracks.from_lists(*scene(10, first=0, seed=0), *scene(14, first=10, seed=1))
    assert status_of(mapped(parts, tmp_path, strict)) == "failed"
    whole = Tracks.from_lists(*scene(24, first=0, seed=0))
    assert mapped(whole, tmp_path, strict).accepted, "the bound is one for parts"


def test_a_part_is_not_believed_on_the_word_of_two_pairs(tmp_path):
    result = mapped(Tracks.from_lists(*scene(16, first=0, seed=0)), tmp_path)
    evidence = read_evidence(tmp_path / "database.db")
    check = result.attempts[-1].check
    for count, sound in ((2, False), (3, True)):
        few = dataclasses.replace(evidence, pairs=evidence.pairs[:count])
        assert is_sound(result.reconstruction, check, few, QUICK) is sound


def test_images_are_parted_after_the_one_before_the_joint():
    joints = [Joint(before=4, after=7, reason=""), Joint(before=9, after=10, reason="")]
    assert parted([1, 4, 7, 9, 10], joints) == [[1, 4], [7, 9], [10]]
    assert parted([1, 4], []) == [[1, 4]]


def test_a_model_is_parted_where_the_image_pairs_contradict_it(tmp_path):
    result = mapped(Tracks.from_lists(*scene(16, first=0, seed=0)), tmp_path)
    evidence = read_evidence(tmp_path / "database.db")
    model = pycolmap.Reconstruction(result.path)
    assert find_joints(model, evidence, AcceptanceOptions()) == ()

    for image_id in range(10, 17):  # the second part, turned by 20 degrees
        turn = pycolmap.Rotation3d(np.array([0.0, np.radians(20.0), 0.0]))
        frame = model.frame(model.image(image_id).frame_id)
        pose = model.image(image_id).cam_from_world()
        frame.set_cam_from_world(1, pycolmap.Rigid3d(turn, np.zeros(3)) * pose)
    (joint,) = find_joints(model, evidence, AcceptanceOptions())
    assert abs(joint.before - 9) <= 1, "a few pairs of every image are evidence"
    assert joint.reason.endswith("image pairs across contradict the model")


def test_some_images_are_known_by_their_own_pairs_alone(tmp_path):
    mapped(Tracks.from_lists(*scene(8, first=0, seed=0)), tmp_path)
    evidence = read_evidence(tmp_path / "database.db")
    part = evidence.within([3, 4, 5])

    assert (part.image_ids, part.num_images) == ([3, 4, 5], 3)
    assert {(pair.image0, pair.image1) for pair in part.pairs} <= {(3, 4), (3, 5), (4, 5)}
    assert 0 < len(part.pairs) < len(evidence.pairs)
    assert part.num_observations == sum(evidence.matched[image] for image in (3, 4, 5))
