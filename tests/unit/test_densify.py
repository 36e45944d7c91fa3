"""A finished model gets more points, and nothing else of it changes."""

from __future__ import annotations

import numpy as np
import pytest

from mvmatch.export.colmap import write_database
from mvmatch.sfm import densify, reconstruct, write_model
from mvmatch.types import Tracks

pycolmap = pytest.importorskip("pycolmap")

FOCAL = 500.0
FRAMES = 8


def seen_tracks(count: int, *, seed: int, noise: float = 0.1) -> Tracks:
    """Points in a corridor, seen by a camera that moves ahead and to the right."""
    generator = np.random.default_rng(seed)
    points = generator.uniform([-5, -4, 5], [7, 4, 25], (count, 3))
    centers = np.array([[0.3 * f, 0.05 * np.sin(f), 0.3 * f] for f in range(FRAMES)])
    seen = points[:, None] - centers
    xy = seen[..., :2] / seen[..., 2:] * FOCAL + [320, 240]
    xy += generator.normal(scale=noise, size=xy.shape)
    inside = ((xy > 0) & (xy < [640, 480])).all(axis=2)
    rows = [
        [(frame, *xy[point, frame]) for frame in np.flatnonzero(inside[point])]
        for point in range(count)
    ]
    return Tracks.from_lists(*(row for row in rows if len(row) >= 3))


MAPPED = seen_tracks(300, seed=0)
FURTHER = seen_tracks(1500, seed=1)


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    """Database with further keypoints, and the model mapped from it."""
    folder = tmp_path_factory.mktemp("densify")
    camera = pycolmap.Camera(
        model="PINHOLE", width=640, height=480, params=[FOCAL, FOCAL, 320, 240]
    )
    camera.has_prior_focal_length = True
    names = [f"{frame:06d}.png" for frame in range(FRAMES)]
    for name, further in (("plain", None), ("with further", FURTHER)):
        (folder / name).mkdir()
        path = folder / name / "database.db"
        write_database(MAPPED, path, camera=camera, image_names=names, further=further)
        assert reconstruct(path, folder / name).accepted
    return folder / "with further", folder / "plain"


def poses(model) -> np.ndarray:
    return np.stack([model.image(f + 1).cam_from_world().matrix() for f in range(FRAMES)])


def test_further_keypoints_change_neither_poses_nor_points_of_the_map(mapped):
    model, plain = (pycolmap.Reconstruction(folder / "0") for folder in mapped)
    np.testing.assert_array_equal(poses(model), poses(plain))
    assert model.num_points3D() == plain.num_points3D()


def test_densifying_keeps_every_pose_to_the_bit_and_the_files_read_back_consistent(
    mapped, tmp_path
):
    folder, _ = mapped
    before = pycolmap.Reconstruction(folder / "0")
    model = pycolmap.Reconstruction(before)
    summary = densify(model, Tracks.concatenate(MAPPED, FURTHER))
    read = pycolmap.Reconstruction(write_model(model, tmp_path))

    np.testing.assert_array_equal(poses(read), poses(before))
    assert summary.num_points == read.num_points3D() == before.num_points3D() + summary.num_added
    assert summary.num_added > 0.8 * len(FURTHER)
    with pycolmap.Database.open(folder / "database.db") as database:
        keypoints = {i: database.read_keypoints(i)[:, :2] for i in read.images}
    linked = 0
    for point_id, point in read.points3D.items():
        for element in point.track.elements:
            image = read.image(element.image_id)
            assert image.point2D(element.point2D_idx).point3D_id == point_id
            linked += 1
    assert linked == sum(image.num_points3D for image in read.images.values())
    for image_id, image in read.images.items():
        xy = np.array([point.xy for point in image.points2D])
        np.testing.assert_array_equal(xy, keypoints[image_id])


def test_every_point_added_is_seen_where_its_track_says(mapped):
    model = pycolmap.Reconstruction(mapped[0] / "0")
    old = set(model.point3D_ids())
    densify(model, Tracks.concatenate(MAPPED, FURTHER))
    for point_id in set(model.point3D_ids()) - old:
        point = model.point3D(point_id)
        assert point.track.length() >= 3
        for element in point.track.elements:
            image = model.image(element.image_id)
            error = image.project_point(point.xyz) - image.point2D(element.point2D_idx).xy
            assert np.linalg.norm(error) <= 1.0


def test_wrong_moving_and_flat_tracks_are_not_accepted(mapped, tmp_path):
    generator = np.random.default_rng(2)
    wrong = [
        [(f, *generator.uniform([0, 0], [640, 480])) for f in range(FRAMES)] for _ in range(30)
    ]
    moving = [[(f, 100 + 20 * k, 100.0 + 15 * f) for f in range(FRAMES)] for k in range(20)]
    sky = [[(f, 20.0 + 25 * k, 30.0) for f in range(FRAMES)] for k in range(20)]
    further = Tracks.from_lists(*wrong, *moving, *sky)
    path = tmp_path / "database.db"
    model = pycolmap.Reconstruction(mapped[1] / "0")
    names = [model.image(f + 1).name for f in range(FRAMES)]
    write_database(MAPPED, path, camera=model.camera(1), image_names=names, further=further)
    model = reconstruct(path, tmp_path).reconstruction
    tracks = Tracks.concatenate(MAPPED, further)
    densify(model, tracks)

    has_point = np.zeros(len(tracks), bool)
    for image_id, image in model.images.items():
        numbers = image.get_observation_point2D_idxs()
        has_point[tracks.track_index[tracks.observations(image_id - 1)[numbers]]] = True
    assert not has_point[len(MAPPED) :].any()


def test_tracks_that_the_model_was_not_made_with_are_refused(mapped):
    model = pycolmap.Reconstruction(mapped[0] / "0")
    with pytest.raises(ValueError, match="2D points"):
        densify(model, MAPPED)
