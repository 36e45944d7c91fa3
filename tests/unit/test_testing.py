"""The synthetic scene is exact, and the source contract finds what breaks it."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvmatch.testing import (
    Rectangle,
    SyntheticScene,
    check_source,
    exact_motion_field,
    exact_motion_fields,
    exact_paths,
    synthetic_drive,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvmatch.types import MotionField


def wall_scene() -> SyntheticScene:
    """A camera that moves 0.1 m to the right per frame, 2 m before a wall that fills the view."""
    wall = Rectangle(
        corner=np.array([-4.0, -4.0, 2.0]),
        side_u=np.array([8.0, 0.0, 0.0]),
        side_v=np.array([0.0, 8.0, 0.0]),
        texture="noise",
        seed=1,
        tint=(128.0, 128.0, 128.0),
    )
    poses = np.tile(np.eye(3, 4), (5, 1, 1))
    poses[:, 0, 3] = -0.1 * np.arange(5)
    K = np.array([[100.0, 0, 48.0], [0, 100.0, 32.0], [0, 0, 1]])
    return SyntheticScene(rectangles=(wall,), width=96, height=64, K=K, cam_from_world=poses)


def test_a_sideways_step_moves_a_wall_by_focal_length_times_step_over_depth() -> None:
    xy = np.array([[48.0, 32.0], [90.0, 5.0], [2.0, 30.0]])
    target, visible = wall_scene().transfer(0, 1, xy)
    np.testing.assert_allclose(target - xy, [[-5.0, 0.0]] * 3, atol=1e-9)
    np.testing.assert_array_equal(visible, [True, True, False])  # the last one leaves the picture


def test_the_pictures_move_as_the_truth_says() -> None:
    scene = dataclasses.replace(wall_scene(), noise=0.0)
    first, second = (scene.render(frame)[:, :, 1].astype(float) for frame in (0, 1))
    moved = np.abs(first[:, 5:] - second[:, :-5]).mean()
    assert first.std() > 8
    assert moved < 0.2 * np.abs(first - second).mean()
    for wrong in (4, 6):
        assert moved < 0.5 * np.abs(first[:, wrong:] - second[:, :-wrong]).mean()


def test_a_nearer_rectangle_hides_the_one_behind_it() -> None:
    scene = wall_scene()
    front = dataclasses.replace(
        scene.rectangles[0],
        corner=np.array([0.0, -4.0, 1.0]),
        side_u=np.array([0.2, 0.0, 0.0]),
    )
    scene = dataclasses.replace(scene, rectangles=(*scene.rectangles, front))
    rectangle, point = scene.surface(0, np.array([[50.0, 32.0], [40.0, 32.0]]))
    np.testing.assert_array_equal(rectangle, [1, 0])
    np.testing.assert_allclose(point[:, 2], [1.0, 2.0])
    # 66 px in frame 0 is just right of the post at 48..68 px? In frame 1 the post is at 38..58.
    _, visible = scene.transfer(1, 0, np.array([[60.0, 32.0], [70.0, 32.0]]))
    np.testing.assert_array_equal(visible, [False, True])


def test_the_drive_comes_back_to_where_a_point_started() -> None:
    scene = synthetic_drive(12, (320, 180))
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, 1, (400, 2)) * (320, 180)
    there, visible = scene.transfer(3, 6, xy)
    assert visible.mean() > 0.6
    back, seen = scene.transfer(6, 3, there[visible])
    assert seen.mean() > 0.99
    np.testing.assert_allclose(back[seen], xy[visible][seen], atol=1e-6)


def test_the_drive_is_the_same_every_time() -> None:
    one, two = synthetic_drive(3, (64, 36)), synthetic_drive(3, (64, 36))
    np.testing.assert_array_equal(one.render(2), two.render(2))
    assert one.path_length == pytest.approx(0.72, rel=0.02)


def test_exact_fields_keep_the_contract_and_hit_the_true_place() -> None:
    scene = synthetic_drive(4, (200, 120))
    assert check_source(exact_motion_fields(scene)) == 4
    exact = exact_motion_field(scene, 2, quantize=False)
    target, visible = scene.transfer(2, 1, exact.centers)
    assert visible.all()
    np.testing.assert_allclose(exact.centers + exact.mv, target, atol=1e-4)
    rounded = exact_motion_field(scene, 2)
    np.testing.assert_array_equal(rounded.mv * 8, np.rint(rounded.mv * 8))


def test_paths_pass_through_their_start_and_through_every_exact_transfer() -> None:
    scene = wall_scene()
    paths = exact_paths(scene, 2, np.array([[48.0, 32.0], [93.0, 10.0]]))
    np.testing.assert_allclose(paths[:, 0], [[58, 32], [53, 32], [48, 32], [43, 32], [38, 32]])
    assert np.isnan(paths[1, 1]).all()  # 98 px is outside the picture
    np.testing.assert_allclose(paths[2, 1], [93.0, 10.0])


def field_of_wall(frame: int = 1) -> MotionField:
    return exact_motion_field(wall_scene(), frame)


@pytest.mark.parametrize(
    ("broken", "complaint"),
    [
        (lambda f: dataclasses.replace(f, ref_frame=np.full_like(f.ref_frame, f.frame)), "itself"),
        (lambda f: dataclasses.replace(f, ref_frame=f.ref_frame - 9), "not decoded before"),
        (lambda f: dataclasses.replace(f, mv=f.mv * np.float32(np.nan)), "mv is not finite"),
        (lambda f: dataclasses.replace(f, mv=f.mv.astype(np.float64)), "mv is float64"),
        (lambda f: dataclasses.replace(f, block=f.block + np.int32(96)), "outside the picture"),
        (lambda f: dataclasses.replace(f, block=f.block * np.int32(-1)), "starts left"),
        (lambda f: dataclasses.replace(f, flags=f.flags[1:]), "flags has shape"),
        (lambda f: dataclasses.replace(f, is_key=True), "a key frame has"),
        (lambda f: dataclasses.replace(f, decode_index=0), "decode indices must rise"),
    ],
)
def test_the_contract_names_the_broken_promise(
    broken: Callable[[MotionField], MotionField], complaint: str
) -> None:
    with pytest.raises(AssertionError, match=complaint):
        check_source([field_of_wall(0), broken(field_of_wall(1))])


def test_an_empty_source_breaks_the_contract() -> None:
    with pytest.raises(AssertionError, match="no motion field"):
        check_source([])
