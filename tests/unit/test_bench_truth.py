import importlib.util

import numpy as np
import pytest

from mvmatch.bench.datasets import load_sequence
from mvmatch.bench.truth import RenderedTruth
from mvmatch.errors import DataError

SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])


def two_triangles(depth: float, scale: float) -> np.ndarray:
    corners = SQUARE * scale + [0, 0, depth]
    return corners[[[0, 1, 2], [0, 2, 3]]]


def scene(**changes) -> dict:
    """A wall 10 m ahead (static) and a small plate 5 m ahead that moves right by 1 m in frame 1."""
    pose = np.broadcast_to(np.eye(4), (2, 2, 4, 4)).copy()
    pose[1, 1, 0, 3] = 1.0
    cam = np.broadcast_to(np.eye(3, 4), (2, 3, 4)).copy()
    cam[1, 0, 3] = 0.5
    arrays = {
        "tri": np.concatenate([two_triangles(10.0, 20.0), two_triangles(5.0, 0.5)]),
        "tri_obj": np.array([0, 0, 1, 1]),
        "obj_T": pose,
        "cam": cam,
        "K": np.array([[100.0, 0, 100], [0, 100, 50], [0, 0, 1]]),
        "k1": 0.0,
        "size": np.array([200, 100]),
    }
    return arrays | changes


def test_static_moving_and_hidden_points_are_told_apart(tmp_path):
    pytest.importorskip("embreex")
    np.savez(tmp_path / "scene.npz", **scene())
    truth = RenderedTruth.load(tmp_path / "scene.npz")
    # A point of the wall, one of the plate, and one of the wall that the plate will cover.
    found = truth.targets(0, 1, [[150.5, 50], [100.3, 50.2], [113.5, 50]])

    # The camera moves right by 0.5 m: the wall by -0.5 * 100 / 10, the plate by 0.5 * 100 / 5.
    np.testing.assert_allclose(found.xy, [[145.5, 50], [110.3, 50.2], [108.5, 50]], atol=1e-9)
    assert found.visible.tolist() == [True, True, False]
    assert found.moving.tolist() == [False, True, False]


def test_arrays_that_do_not_fit_together_are_refused(tmp_path):
    path = tmp_path / "scene.npz"
    for changes, message in (
        ({"cam": np.zeros((3, 3, 4))}, "cam has the shape"),
        ({"tri_obj": np.array([0, 0, 1, 2])}, "objects that obj_T does not have"),
        ({"tri": np.array([None])}, "no scene with exact geometry"),
    ):
        np.savez(path, **scene(**changes))
        with pytest.raises(DataError, match=message):
            RenderedTruth.load(path)


@pytest.mark.parametrize("name", ["terrain_drone", "tripod_movers", "street_drive"])
def test_targets_are_those_of_the_tool_that_came_with_the_sequences(shared, name):
    pytest.importorskip("embreex")
    pytest.importorskip("cv2")
    spec = importlib.util.spec_from_file_location("truth_tool", shared / "truth" / "truth.py")
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    truth = load_sequence(shared / "truth" / name).truth
    xy = np.random.default_rng(0).uniform([0, 0], [960, 540], (2000, 2))

    expected = tool.target(tool.load(str(shared / "truth" / name)), 3, 13, xy)
    found = truth.targets(3, 13, xy)
    np.testing.assert_allclose(found.xy, expected[0], atol=1e-9)
    np.testing.assert_array_equal(found.visible, expected[1])
    np.testing.assert_array_equal(found.moving, expected[2])
