import numpy as np
import pytest

from mvmatch.geometry.trajectory import align_cameras, align_similarity, trajectory_error

HELIX = np.array([[np.cos(a), np.sin(a), 0.1 * a] for a in np.linspace(0, 6, 20)])


def rotation_about_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def test_a_similarity_is_recovered_from_the_points_it_moved():
    moved = 2.5 * HELIX @ rotation_about_z(0.7).T + [1, 2, 3]

    similarity = align_similarity(HELIX, moved)
    assert similarity.scale == pytest.approx(2.5)
    np.testing.assert_allclose(similarity.rotation, rotation_about_z(0.7), atol=1e-12)
    np.testing.assert_allclose(similarity.apply(HELIX), moved, atol=1e-12)


def test_a_mirrored_path_is_not_aligned_by_a_reflection():
    similarity = align_similarity(HELIX, HELIX * [1, 1, -1])

    assert np.linalg.det(similarity.rotation) == pytest.approx(1)


def test_a_similar_trajectory_has_no_error():
    error = trajectory_error(0.1 * HELIX @ rotation_about_z(1).T - 4, HELIX)

    assert error.rmse == pytest.approx(0, abs=1e-12)
    assert error.num_frames == 20


def test_the_error_is_given_in_percent_of_the_reference_path():
    line = np.array([[x, 0.0, 0.0] for x in range(11)])
    zigzag = line + [[0, (-1) ** x * 0.1, 0] for x in range(11)]

    error = trajectory_error(zigzag, line)
    assert error.path_length == 10
    assert error.rmse == pytest.approx(0.1, rel=0.02)
    assert error.percent_of_path == pytest.approx(1.0, rel=0.02)


def test_a_reference_that_stands_still_gives_infinite_percent():
    assert np.isinf(trajectory_error(HELIX, np.zeros((20, 3))).percent_of_path)


def test_points_that_all_coincide_cannot_be_aligned():
    with pytest.raises(ValueError, match="coincide"):
        align_similarity(np.zeros((5, 3)), HELIX[:5])


def on_a_line(turns) -> np.ndarray:
    """Cameras 1 m apart on the x axis."""
    turned = [rotation_about_z(turn) for turn in turns]
    return np.array([np.column_stack([R, [x, 0, 0]]) for x, R in enumerate(turned)])


def test_cameras_on_a_line_are_aligned_by_where_they_look():
    true = on_a_line([0.1, 0.0, -0.1, 0.2])
    turn = np.array([[1, 0, 0], [0, 0.6, -0.8], [0, 0.8, 0.6]]) @ rotation_about_z(0.5)
    found = np.concatenate(
        [turn @ true[:, :, :3], 0.25 * (turn @ true[:, :, 3:]) + [[3.0], [4], [5]]], axis=2
    )

    similarity = align_cameras(found, true, distance=8.0)
    assert similarity.scale == pytest.approx(4)
    np.testing.assert_allclose(similarity.rotation, turn.T, atol=1e-12)
    np.testing.assert_allclose(similarity.apply(found[:, :, 3]), true[:, :, 3], atol=1e-12)


def test_a_camera_that_does_not_move_gives_no_scale():
    still = np.repeat(on_a_line([0.0]), 4, axis=0)
    for found, true in ((still, on_a_line([0.0] * 4)), (on_a_line([0.0] * 4), still)):
        with pytest.raises(ValueError, match="coincide"):
            align_cameras(found, true, distance=8.0)
    with pytest.raises(ValueError, match="two \\(N, 3, 4\\) arrays"):
        align_cameras(still[:, :, 3], still, distance=8.0)
