import numpy as np
import pytest

from mvmatch.geometry.movers import MoverOptions, half_line_distance, track_weights
from mvmatch.types import Tracks

pycolmap = pytest.importorskip("pycolmap")

FOCAL = 500.0
FRAMES = 9
BOX = slice(0, 40)
"""Points of the object in the tests."""


def camera():
    return pycolmap.Camera(model="PINHOLE", width=640, height=480, params=[FOCAL, FOCAL, 320, 240])


def turn(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def world(seed=3, count=400, depth=(4.0, 20.0)):
    """World points; the first 40 are close together."""
    generator = np.random.default_rng(seed)
    xy = generator.uniform([20, 20], [620, 460], (count, 2))
    xy[BOX] = generator.uniform([420, 120], [480, 180], (40, 2))
    z = generator.uniform(*depth, count)
    z[BOX] = generator.uniform(7.5, 8.0, 40)
    return np.c_[(xy - [320, 240]) / FOCAL * z[:, None], z]


def tracked(points, *, step=(0.0, 0.0, 0.0), angle=0.0, motion=(0.0, 0.0, 0.0), noise=0.1):
    """Tracks of points seen by a camera that steps and turns; the first 40 points move as well."""
    generator = np.random.default_rng(0)
    seen = np.empty((len(points), FRAMES, 2))
    for frame in range(FRAMES):
        moved = points.copy()
        moved[BOX] += frame * np.asarray(motion)
        local = moved @ turn(frame * angle).T + frame * np.asarray(step)
        seen[:, frame] = local[:, :2] / local[:, 2:] * FOCAL + [320, 240]
    seen += generator.normal(0, noise, seen.shape)
    return Tracks(
        offsets=np.arange(len(points) + 1, dtype=np.int64) * FRAMES,
        frame=np.tile(np.arange(FRAMES, dtype=np.int32), len(points)),
        xy=seen.reshape(-1, 2).astype(np.float32),
    )


MOVING_CAMERA = {"step": (-0.15, 0.0, -0.1), "angle": 0.01}


def test_points_at_rest_keep_their_weight():
    assert track_weights(tracked(world(), **MOVING_CAMERA), camera()).min() > 0.5


def test_an_object_that_crosses_epipolar_lines_loses_its_weight():
    weights = track_weights(tracked(world(), motion=(0.0, -0.1, 0.0), **MOVING_CAMERA), camera())
    assert weights[BOX].max() < 0.5
    assert weights[40:].min() > 0.5


def test_an_object_that_overtakes_along_epipolar_lines_loses_its_weight():
    forward = {"step": (0.0, 0.0, -0.15)}
    weights = track_weights(tracked(world(), motion=(0.0, 0.0, 0.5), **forward), camera())
    assert weights[BOX].max() < 0.5
    assert weights[40:].min() > 0.5


def test_a_static_camera_keeps_what_stands_and_finds_what_moves():
    still = tracked(world(), noise=0.02)
    assert track_weights(still, camera()).min() == 1.0
    # A sixth of the points: one translation would explain them, but a standing camera has none.
    points = world(count=240)
    weights = track_weights(tracked(points, motion=(0.1, 0.0, 0.0), noise=0.02), camera())
    assert weights[BOX].max() < 0.5
    assert weights[40:].min() > 0.5


def test_a_turning_camera_keeps_what_stands_and_finds_what_moves():
    weights = track_weights(tracked(world(), angle=0.01, motion=(0.1, 0.03, 0.0)), camera())
    assert weights[BOX].max() < 0.5
    assert weights[40:].min() > 0.5


def test_near_things_before_a_distant_background_are_at_rest():
    points = world(depth=(4000.0, 8000.0))
    generator = np.random.default_rng(5)
    points[40:160] *= (generator.uniform(4.0, 9.0, 120) / points[40:160, 2])[:, None]
    weights = track_weights(tracked(points, step=(-0.05, 0.0, -0.02), angle=0.01), camera())
    assert np.mean(weights[40:160] > 0.5) > 0.95


def test_a_single_wrong_track_is_no_object():
    tracks = tracked(world(), **MOVING_CAMERA)
    wrong = tracks.track_index == 200
    tracks.xy[wrong, 1] += 4.0 * tracks.frame[wrong]
    assert track_weights(tracks, camera())[200] > 0.5


def test_tracks_too_short_for_every_pair_are_not_judged():
    tracks = Tracks.from_lists(*([(0, 10.0 * k, 5.0), (1, 10.0 * k, 9.0)] for k in range(40)))
    assert track_weights(tracks, camera()).tolist() == [1.0] * 40
    assert len(track_weights(Tracks.from_lists(), camera())) == 0


@pytest.mark.parametrize("pairs", [1, 2, 3])
def test_weights_do_not_depend_on_how_many_pairs_are_sought_at_once(pairs, monkeypatch):
    tracks = tracked(world(), **MOVING_CAMERA, motion=(0.0, 0.1, 0.0))
    expected = track_weights(tracks, camera())
    monkeypatch.setattr("mvmatch.geometry.movers._PAIRS", pairs)
    np.testing.assert_array_equal(track_weights(tracks, camera()), expected)
    assert 0 < np.count_nonzero(expected < 0.5) < len(expected)


def test_the_half_line_begins_at_infinity_and_leads_to_the_epipole():
    # The camera moves along x: points at rest move to the left, by nothing at infinity.
    pose = np.column_stack([np.eye(3), [-1.0, 0.0, 0.0]])
    xy0 = np.array([[300.0, 200.0]] * 4)
    xy1 = np.array([[300.0, 200.0], [280.0, 200.0], [280.0, 203.0], [304.0, 203.0]])
    np.testing.assert_allclose(
        half_line_distance(xy0, xy1, camera(), pose), [0.0, 0.0, 3.0, 5.0], atol=1e-9
    )


def test_without_translation_it_is_the_distance_to_the_turned_point():
    pose = np.column_stack([np.eye(3), np.zeros(3)])
    distance = half_line_distance(
        np.array([[300.0, 200.0]]), np.array([[303.0, 204.0]]), camera(), pose
    )
    np.testing.assert_allclose(distance, [5.0])


@pytest.mark.parametrize("options", [{"gaps": ()}, {"gaps": (0,)}, {"neighborhood": 1}])
def test_options_that_make_no_sense_are_refused(options):
    with pytest.raises(ValueError, match=r"gaps are|neighborhood is"):
        MoverOptions(**options)
