"""From a video to trajectories that evo measures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvmatch.cli import main
from mvmatch.sources import open_video
from mvmatch.testing import synthetic_drive

if TYPE_CHECKING:
    from pathlib import Path


def test_evo_finds_the_true_path_in_what_a_run_and_convert_made(data: Path, tmp_path: Path) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface")
    from evo.core import metrics
    from evo.core.trajectory import PosePath3D

    clip, out = data / "drive.ivf", tmp_path / "out"
    camera = "PINHOLE,260.48,260.48,176,100"  # of synthetic_drive
    assert main(["run", str(clip), "-o", str(out), "--camera", camera]) == 0
    model = str(out / "sparse" / "0")
    words = {"tum": ["--timestamps", str(clip)], "kitti": []}
    for target, more in words.items():
        assert main(["convert", model, str(tmp_path / target), "--to", target, *more]) == 0
    tum = file_interface.read_tum_trajectory_file(tmp_path / "tum")
    kitti = file_interface.read_kitti_poses_file(tmp_path / "kitti")

    with open_video(clip) as source:
        for _ in source:
            pass
        times = sorted(facts.pts for facts in source.frames if facts.pts is not None)
    np.testing.assert_allclose(tum.timestamps, times, atol=1e-9)
    np.testing.assert_allclose(tum.poses_se3, kitti.poses_se3, atol=1e-12)
    scene = synthetic_drive(20, (352, 200))
    truth = [np.vstack([pose, [0, 0, 0, 1]]) for pose in scene.cam_from_world]
    path = PosePath3D(poses_se3=[np.linalg.inv(pose) for pose in truth])
    kitti.align(path, correct_scale=True)
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data((path, kitti))
    assert error.get_statistic(metrics.StatisticsType.rmse) < 0.01 * path.path_length
    # The path is nearly straight: what turns about it, alignment cannot see. Steps show it.
    turned = metrics.RPE(metrics.PoseRelation.rotation_angle_deg, delta=1, all_pairs=True)
    turned.process_data((path, kitti))
    assert turned.get_statistic(metrics.StatisticsType.max) < 0.1
