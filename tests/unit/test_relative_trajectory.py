import numpy as np
import pytest

from mvmatch.geometry.trajectory import relative_trajectory_error, trajectory_error


def rotation(angles: np.ndarray) -> np.ndarray:
    a, b, c = angles
    turns = [
        np.array([[np.cos(v), -np.sin(v), 0], [np.sin(v), np.cos(v), 0], [0, 0, 1]])
        for v in (a, b, c)
    ]
    axes = [turn[np.ix_(order, order)] for turn, order in zip(turns, _ORDERS, strict=True)]
    return axes[0] @ axes[1] @ axes[2]


_ORDERS = ([0, 1, 2], [1, 2, 0], [2, 0, 1])


def walk(seed: int, num_frames: int = 25) -> np.ndarray:
    """Poses (camera to world) of a smooth walk, with a disturbance that depends on the seed."""
    generator = np.random.default_rng(seed)
    time = np.linspace(0, 3, num_frames)
    centers = np.column_stack([4 * time, np.sin(time), 0.2 * time**2])
    centers += generator.normal(0, 0.02, centers.shape)
    angles = np.column_stack([0.3 * time, 0.1 * np.cos(time), 0.2 * time])
    angles += generator.normal(0, 0.01, angles.shape)
    return np.array(
        [np.column_stack([rotation(a), c]) for a, c in zip(angles, centers, strict=True)]
    )


def random_path(generator: np.random.Generator, num_frames: int) -> np.ndarray:
    """Poses without any order: each turned and placed at random."""
    turns = generator.uniform(-np.pi, np.pi, (num_frames, 3))
    centers = generator.normal(0, 5, (num_frames, 3))
    return np.array(
        [np.column_stack([rotation(a), c]) for a, c in zip(turns, centers, strict=True)]
    )


def disturbed(truth: np.ndarray, generator: np.random.Generator, noise: float) -> np.ndarray:
    """The path with noise, in a frame of its own: another scale, origin and orientation."""
    turn, scale = rotation(generator.uniform(-3, 3, 3)), generator.uniform(0.1, 10)
    poses: list[np.ndarray] = []
    for pose in truth:
        shaken = pose[:, :3] @ rotation(generator.normal(0, noise, 3))
        center = pose[:, 3] + generator.normal(0, noise, 3)
        poses.append(np.column_stack([turn @ shaken, scale * turn @ center + [7, 8, 9]]))
    return np.array(poses)


def walks(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Truth and estimate: a smooth walk, or at odd seeds poses at random."""
    generator = np.random.default_rng(seed)
    truth = random_path(generator, 30) if seed % 2 else walk(seed)
    return truth, disturbed(truth, generator, (0.001, 0.05, 1.0)[seed % 3])


@pytest.mark.parametrize("delta", [1, 5])
@pytest.mark.parametrize("seed", range(6))
def test_trajectory_errors_are_those_of_evo(seed, delta):
    metrics = pytest.importorskip("evo.core.metrics")
    from evo.core.trajectory import PosePath3D

    truth, estimate = walks(seed)
    paths = [
        PosePath3D(poses_se3=[np.vstack([pose, [0, 0, 0, 1]]) for pose in poses])
        for poses in (truth, estimate)
    ]
    paths[1].align(paths[0], correct_scale=True)
    statistics = metrics.StatisticsType

    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((paths[0], paths[1]))
    ate = trajectory_error(estimate[:, :, 3], truth[:, :, 3])
    for kind, value in (
        (statistics.rmse, ate.rmse),
        (statistics.median, ate.median),
        (statistics.max, ate.maximum),
    ):
        assert value == pytest.approx(ape.get_statistic(kind), rel=1e-9, abs=1e-9)
    assert ate.path_length == pytest.approx(paths[0].path_length, rel=1e-9)

    ours = relative_trajectory_error(estimate, truth, delta=delta)
    for relation, value in (
        (metrics.PoseRelation.translation_part, ours.translation_rmse),
        (metrics.PoseRelation.rotation_angle_deg, ours.rotation_rmse),
    ):
        rpe = metrics.RPE(relation, delta=delta, all_pairs=True)
        rpe.process_data((paths[0], paths[1]))
        expected = rpe.get_statistic(statistics.rmse)
        assert value == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert ours.num_pairs == len(truth) - delta


def test_a_path_of_another_scale_has_no_relative_error():
    truth = walk(3)
    scaled = truth.copy()
    scaled[:, :, 3] *= 0.1

    error = relative_trajectory_error(scaled, truth)
    assert error.translation_rmse == pytest.approx(0, abs=1e-12)
    assert error.rotation_rmse == pytest.approx(0, abs=1e-6)


def test_frames_further_apart_than_the_path_is_long_are_refused():
    with pytest.raises(ValueError, match="apart"):
        relative_trajectory_error(walk(0), walk(1), delta=25)
