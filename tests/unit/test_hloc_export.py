import numpy as np
import pytest

from mvmatch.export.hloc import write_hloc
from mvmatch.types import Tracks

h5py = pytest.importorskip("h5py")


def test_hloc_gets_its_own_origin_and_one_match_per_keypoint(tmp_path):
    tracks = Tracks.from_lists(
        [(0, 10.5, 20.5), (1, 11.5, 20.5)], [(0, 1.0, 2.0)], [(1, 5.0, 6.0), (2, 5.0, 7.0)]
    )
    names = ["a/0.png", "a/1.png", "a/2.png"]
    features, matches = write_hloc(tracks, tmp_path, image_names=names)

    with h5py.File(features) as file:
        np.testing.assert_array_equal(file["a/0.png/keypoints"], [[10.0, 20.0], [0.5, 1.5]])
    with h5py.File(matches) as file:
        np.testing.assert_array_equal(file["a-0.png/a-1.png/matches0"], [0, -1])
        np.testing.assert_array_equal(file["a-0.png/a-1.png/matching_scores0"], [1, 0])
        assert set(file) == {"a-0.png", "a-1.png"}
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["features.h5", "matches.h5"]
