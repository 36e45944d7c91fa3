"""Points of models against the true surface of a small scene."""

from pathlib import Path

import numpy as np
import pytest

from mvmatch.bench import sfm, sfm_clouds
from mvmatch.bench.apart import Apart
from mvmatch.bench.cloud import (
    CloudOptions,
    JudgedCloud,
    VisibleSurface,
    at_equal_completeness,
    judge_cloud,
    measure_cloud,
    points_by_quality,
    visible_surface,
)
from mvmatch.bench.datasets import ImageFiles, Sequence, load_sequence
from mvmatch.bench.truth import RenderedTruth, StillTruth
from mvmatch.errors import DataError
from mvmatch.geometry.cloud import surface_distance

pytest.importorskip("embreex")
pytest.importorskip("igl")
pycolmap = pytest.importorskip("pycolmap")

NUM_FRAMES = 5
SIZE = (200, 100)
CAMERA = pycolmap.Camera(
    camera_id=1, model="PINHOLE", width=SIZE[0], height=SIZE[1], params=[100.0, 100.0, 100.0, 50.0]
)
OPTIONS = CloudOptions(rays=3000)


def rectangle(x, y, z) -> np.ndarray:
    """Two triangles across the view at depth z."""
    a, b, c, d = ([x[i], y[j], z] for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return np.array([[a, b, c], [a, c, d]], np.float64)


def sequence(truth=None) -> Sequence:
    """A wall 10 m ahead, a still plate at 5 m and one that moves at 4 m; the camera moves by x."""
    world_from_object = np.broadcast_to(np.eye(4), (NUM_FRAMES, 3, 4, 4)).copy()
    world_from_object[:, 2, 1, 3] = np.linspace(0, 1, NUM_FRAMES)
    world_from_cam = np.broadcast_to(np.eye(3, 4), (NUM_FRAMES, 3, 4)).copy()
    world_from_cam[:, 0, 3] = np.arange(NUM_FRAMES) / 2
    plates = [
        rectangle((-40, 40), (-40, 40), 10.0),
        rectangle((-1, 0), (-1, 1), 5.0),
        rectangle((1, 2), (-1, 1), 4.0),
    ]
    cam_from_world = world_from_cam.copy()
    cam_from_world[:, :, 3] *= -1
    rendered = RenderedTruth(
        triangles=np.concatenate(plates),
        triangle_object=np.repeat([0, 1, 2], 2),
        world_from_object=world_from_object,
        world_from_cam=world_from_cam,
        K=CAMERA.calibration_matrix(),
        k1=0.0,
        size=SIZE,
    )
    return Sequence(
        name="plates",
        frames=ImageFiles(()),
        camera=CAMERA,
        cam_from_world=cam_from_world,
        truth=truth or rendered,
    )


def model(points, *, offset=(0.0, 0.0, 0.0), names="{:06d}.png", frames=range(NUM_FRAMES)):
    """Every image sees every point; in a frame of its own, a quarter of the size and turned."""
    made = pycolmap.Reconstruction()
    made.add_camera_with_trivial_rig(CAMERA)
    true = sequence()
    for frame in frames:
        pose = pycolmap.Rigid3d(true.cam_from_world[frame])
        seen = CAMERA.img_from_cam(pose * points)
        image = pycolmap.Image(names.format(frame), seen, 1, frame + 1)
        made.add_image_with_trivial_frame(image, pose)
    for index, xyz in enumerate(points + np.asarray(offset)):
        elements = [pycolmap.TrackElement(frame + 1, index) for frame in frames]
        made.add_point3D(xyz, pycolmap.Track(elements))
    turn = pycolmap.Rotation3d(np.array([0.4, 0.3, 0.2]))
    made.transform(pycolmap.Sim3d(0.25, turn, np.array([1.0, 2.0, 3.0])))
    made.update_point_3d_errors()
    return made


def wall() -> np.ndarray:
    generator = np.random.default_rng(1)
    return np.column_stack([generator.uniform((-6, -4), (8, 4), (500, 2)), np.full(500, 10.0)])


def test_points_on_the_surface_have_no_error_though_the_cameras_stand_on_a_line():
    quality = measure_cloud(model(wall()), sequence(), options=OPTIONS)
    assert quality.num_points == 500
    assert quality.accuracy.maximum == pytest.approx(0, abs=1e-6)
    assert quality.median_depth == pytest.approx(10)
    assert [score.precision for score in quality.scores] == [1] * 5
    recall = [score.recall for score in quality.scores]
    assert recall == sorted(recall)
    assert recall[-1] > 0.5


def test_points_before_the_surface_are_wrong_by_as_much_in_metres_of_the_truth():
    quality = measure_cloud(model(wall(), offset=(0, 0, -0.15)), sequence(), options=OPTIONS)
    assert quality.accuracy.median == pytest.approx(0.15, abs=1e-6)
    assert [score.precision for score in quality.scores] == [0, 0, 0, 1, 1]
    assert quality.share(quality.accuracy.median) == pytest.approx(0.015, rel=1e-4)


def test_only_what_stands_still_and_is_seen_twice_counts_as_surface():
    true = sequence()
    surface = visible_surface(true, OPTIONS)

    # The plate that moves is at depth 4.
    assert sorted(np.unique(surface.samples[:, 2].round(6))) == [5, 10]
    assert sorted(np.unique(surface.triangles[:, :, 2])) == [5, 10]
    # At depth 10 a picture is 20 m wide; the outermost half metre is in one picture alone.
    on_wall = surface.samples[surface.samples[:, 2] > 9]
    assert on_wall[:, 0].min() == pytest.approx(-9.5, abs=0.1)
    assert on_wall[:, 0].max() == pytest.approx(11.5, abs=0.1)
    # What the still plate hides from frame k lies from 2 (-1 - k / 2) + k / 2 to -k / 2.
    hidden = np.zeros(len(on_wall), np.int64)
    for offset in np.arange(NUM_FRAMES) / 2:
        x = on_wall[:, 0]
        hidden += (x > 2 * (-1 - offset) + offset) & (x < -offset) & (abs(on_wall[:, 1]) < 2)
    assert hidden.max() <= NUM_FRAMES - 2


def test_samples_are_even_however_often_a_place_is_seen():
    surface = visible_surface(sequence(), CloudOptions(rays=3000, spacing=0.1))
    cubes = np.floor(surface.samples / (0.1 * surface.median_depth))
    assert len(np.unique(cubes, axis=0)) == len(surface.samples)


def test_what_cannot_be_judged_is_refused():
    with pytest.raises(DataError, match="no true surface"):
        visible_surface(sequence(StillTruth(SIZE)))
    for made, message in (
        (model(wall(), frames=range(2)), "cannot be laid over plates"),
        (model(wall(), names="1{:05d}.png"), "the model shows frame 100004"),
    ):
        with pytest.raises(DataError, match=message):
            judge_cloud(made, sequence(), options=OPTIONS)


def test_the_expected_error_is_that_of_the_linearised_cameras():
    made = model(np.array([[1.0, 0.2, 10], [1.1, -0.1, 20], [0.8, 0.1, 40]]))
    for number, error in zip(sorted(made.points3D), (0.5, 0.7, 0.6), strict=True):
        made.points3D[number].error = error
    xyz, expected = points_by_quality(made)

    usual = np.mean([0.5**2, 0.7**2, 0.6**2])
    for point, error, found in zip(xyz, (0.5, 0.7, 0.6), expected, strict=True):
        rows = []
        for number in made.reg_image_ids():
            pose = made.image(number).cam_from_world()
            steps = [point + sign * 1e-5 * axis for axis in np.eye(3) for sign in (1, -1)]
            seen = CAMERA.img_from_cam(pose * np.array(steps))
            rows.append((seen[::2] - seen[1::2]).T / 2e-5)
        jacobian = np.concatenate(rows)
        freedom = 2 * NUM_FRAMES - 3
        variance = (usual + freedom * error**2) / (1 + freedom)
        covariance = variance * np.linalg.inv(jacobian.T @ jacobian)
        centers = [made.image(i).projection_center() for i in made.reg_image_ids()]
        distance = np.linalg.norm(point - centers, axis=1).min()
        # The pixels of a plane picture are denser to its edge: a few percent at these angles.
        assert found == pytest.approx(np.sqrt(np.trace(covariance)) / distance, rel=0.05)


def test_the_expected_error_is_the_same_share_at_any_scale():
    made = model(wall())
    xyz, expected = points_by_quality(made)
    made.transform(pycolmap.Sim3d(3.0, pycolmap.Rotation3d(), np.zeros(3)))
    larger, of_larger = points_by_quality(made)
    np.testing.assert_allclose(larger, 3 * xyz)
    np.testing.assert_allclose(of_larger, expected)


def test_a_point_without_parallax_is_expected_to_be_infinitely_wrong():
    made = model(wall()[:1], frames=[2])
    assert np.isinf(points_by_quality(made)[1]).all()


def test_a_model_without_points_covers_nothing():
    quality = measure_cloud(model(np.zeros((0, 3))), sequence(), options=OPTIONS)
    assert quality.num_points == 0
    assert np.isinf(quality.chamfer)
    assert quality.scores[-1].f_score == 0


def judged(points, to_surface, samples) -> JudgedCloud:
    surface = VisibleSurface(triangles=np.zeros((0, 3, 3)), samples=samples, median_depth=1.0)
    return JudgedCloud(
        points=points, to_surface=to_surface, surface=surface, options=CloudOptions()
    )


def test_at_equal_completeness_the_fuller_cloud_gives_up_its_worst_points():
    samples = np.column_stack([np.arange(10.0), np.zeros(10), np.zeros(10)])
    full = judged(samples, np.arange(10) / 100, samples)
    part = judged(samples[6:], np.full(4, 0.05), samples)

    of_full, of_part = at_equal_completeness(full, part, 0.5)
    assert (of_full.num_points, of_part.num_points) == (4, 4)
    assert of_full.accuracy.mean == pytest.approx(0.015)
    assert of_part.accuracy.mean == pytest.approx(0.05)
    swapped = at_equal_completeness(part, full, 0.5)
    assert [each.num_points for each in swapped] == [4, 4]
    assert swapped[1].accuracy.mean == pytest.approx(0.015)


def test_the_mean_distance_of_the_surface_is_completeness_where_no_bound_is_given():
    samples = np.column_stack([np.arange(10.0), np.zeros(10), np.zeros(10)])
    full = judged(samples, np.arange(10) / 100, samples)
    part = judged(samples[7:], np.full(3, 0.05), samples)  # 28 / 10 m

    of_full, of_part = at_equal_completeness(full, part)
    assert (of_full.num_points, of_part.num_points) == (3, 3)
    assert of_full.completeness.mean == pytest.approx(of_part.completeness.mean)
    assert of_full.chamfer - of_part.chamfer == pytest.approx((0.01 - 0.05) / 2)


def test_models_of_a_benchmark_are_compared_with_that_of_sift(tmp_path, monkeypatch):
    monkeypatch.setattr(sfm_clouds, "open_sequence", lambda *_: sequence())
    grid = np.stack(np.meshgrid(np.arange(-6, 8, 0.25), np.arange(-4, 4, 0.25), [10.0]), axis=-1)
    full, part = grid.reshape(-1, 3), grid.reshape(-1, 3)[::3]
    results = []
    for method, points in (("sift", part), ("svt-dense", full)):
        model(points).write(made := fresh(tmp_path / method))
        results.append({
            "sequence": "plates", "intrinsics": "known", "method": method, "key": method,
            "error": None, "run": {"accepted": True, "registered": NUM_FRAMES, "model": str(made)},
            "model": {"cloud": {"chamfer": 0.1}, "ate_percent": 0.01},
        })  # fmt: skip
    options = sfm.SfmOptions(data=(), out=tmp_path / "out")
    cells = [
        sfm.SfmCell(sequence="plates", method=each["method"], intrinsics="known",
                    folder=tmp_path, options=options)
        for each in results
    ]  # fmt: skip
    monkeypatch.setattr(sfm_clouds, "run_apart", called_here)

    (compared,) = sfm_clouds.compare_clouds(cells, results)
    assert (compared["error"], compared["reference"]) == (None, "sift")
    by_recall, by_distance = compared["rows"]
    for row in (by_recall, by_distance):
        assert row["method"] == "svt-dense"
        assert row["sift"]["num_points"] == len(part)
        assert row["own"]["num_points"] < len(full)
    assert by_recall["own"]["recall"] >= by_recall["sift"]["recall"] > 0
    assert by_distance["own"]["completeness"] <= by_distance["sift"]["completeness"]

    monkeypatch.setattr(sfm_clouds, "run_apart", None)
    assert sfm_clouds.compare_clouds(cells, results) == [compared]


def fresh(folder: Path) -> Path:
    folder.mkdir()
    return folder


def called_here(function, *arguments, **_) -> Apart:
    value = function(*arguments)
    return Apart(value=value, error=None, wall_s=0.0, cpu_s=0.0, peak_rss_mb=None)


def test_no_shorter_part_of_the_fuller_cloud_would_do():
    generator = np.random.default_rng(2)
    samples = generator.uniform(size=(300, 3))
    full = judged(generator.uniform(size=(200, 3)), np.zeros(200), samples)
    part = judged(generator.uniform(size=(40, 3)), np.zeros(40), samples)

    kept, whole = at_equal_completeness(full, part, 0.1)
    assert whole.num_points == 40
    recall = [full.recall(0.1, size) for size in range(201)]
    wanted = part.recall(0.1)
    assert kept.num_points == next(k for k, each in enumerate(recall) if each >= wanted)


def test_more_of_a_cloud_covers_more_and_the_curve_ends_at_the_whole():
    samples = np.column_stack([np.arange(10.0), np.zeros(10), np.zeros(10)])
    cloud = judged(samples, np.arange(10) / 100, samples)

    curve = cloud.curve([0.2, 0.5, 1.0])
    assert [each.num_points for each in curve] == [2, 5, 10]
    assert [each.accuracy.mean for each in curve] == pytest.approx([0.005, 0.02, 0.045])
    assert [each.scores[-1].recall for each in curve] == pytest.approx([0.2, 0.5, 1.0])
    assert curve[-1] == cloud.quality()


@pytest.mark.parametrize("name", ["orbit_object", "terrain_drone"])
def test_true_points_of_a_rendered_sequence_lie_on_its_surface(shared, name):
    true = load_sequence(shared / "truth" / name)
    surface = visible_surface(true, CloudOptions(views=4, rays=2000))
    cloud = JudgedCloud(
        points=surface.samples[::2],
        to_surface=np.zeros(len(surface.samples[::2])),
        surface=surface,
        options=CloudOptions(),
    )
    assert cloud.quality().scores[0].recall >= 0.5
    # Directions of rays are exact, where they hit is decided in single precision.
    assert surface_distance(cloud.points, surface.triangles).max() < 1e-3
