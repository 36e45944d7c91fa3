"""Two-view geometry beside PoseLib, which estimates with solvers and a RANSAC of its own."""

import numpy as np
import pytest

from mvmatch.geometry.pose_error import rotation_angle
from mvmatch.geometry.two_view import RansacOptions, fit_pair

poselib = pytest.importorskip("poselib")
pycolmap = pytest.importorskip("pycolmap")

FOCAL, SIZE = 500.0, (640, 480)
CENTER = np.array([320.0, 240.0])
MAX_ERROR = 2.0


def camera():
    return pycolmap.Camera(
        model="PINHOLE", width=SIZE[0], height=SIZE[1], params=[FOCAL, FOCAL, *CENTER]
    )


def two_views(scene: str, seed: int):
    """Points (N, 2) of both views, a quarter of them wrong, and the true relative rotation."""
    generator = np.random.default_rng(seed)
    xy0 = generator.uniform([20, 20], [620, 460], (400, 2))
    rays = np.c_[(xy0 - CENTER) / FOCAL, np.ones(400)]
    depth = generator.uniform(3.0, 12.0, 400)
    if scene == "plane":
        depth = 6.0 / (rays @ [0.2, 0.1, 1.0])
    angle = np.radians(generator.uniform(1.0, 5.0))
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    translation = np.zeros(3) if scene == "turn" else generator.uniform([0.3, -0.2, 0.1], 0.6)
    seen = (rays * depth[:, None]) @ rotation.T + translation
    xy1 = seen[:, :2] / seen[:, 2:] * FOCAL + CENTER
    xy1 += generator.normal(scale=0.3, size=xy1.shape)
    wrong = np.arange(400) % 4 == 0
    xy1[wrong] = generator.uniform([20, 20], [620, 460], (wrong.sum(), 2))
    return xy0, xy1, rotation


def by_poselib(xy0, xy1):
    """Relative rotation (3, 3) and inliers of E, and inliers of H, of PoseLib."""
    settings = {"max_iterations": 10_000, "min_iterations": 100, "seed": 1}
    model = {"model": "PINHOLE", "width": SIZE[0], "height": SIZE[1]}
    model["params"] = [FOCAL, FOCAL, *CENTER]
    pose, of_e = poselib.estimate_relative_pose(
        xy0, xy1, model, model, settings | {"max_epipolar_error": MAX_ERROR}, {}
    )
    _, of_h = poselib.estimate_homography(xy0, xy1, settings | {"max_reproj_error": MAX_ERROR}, {})
    return np.asarray(pose.R), np.array(of_e["inliers"]), np.array(of_h["inliers"])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("scene", ["depth", "plane"])
def test_pose_and_inliers_are_those_of_poselib(scene: str, seed: int):
    xy0, xy1, truth = two_views(scene, seed)
    options = RansacOptions(max_error=MAX_ERROR, min_num_trials=100)
    fit = fit_pair(xy0, xy1, camera(), camera(), options=options)
    rotation, of_e, of_h = by_poselib(xy0, xy1)

    assert fit.cam1_from_cam0 is not None
    found = fit.cam1_from_cam0.rotation.matrix()
    # Both refine on inliers of their own: as near to each other as noise of 0.3 px lets them be.
    if scene != "plane":  # which has two poses
        assert rotation_angle(found @ rotation.T) < 0.2
        assert rotation_angle(found @ truth.T) < 0.2
    chosen = of_e if fit.score.model == "E" else of_h
    assert np.mean(fit.inliers == chosen) > 0.98


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("scene", "configuration"),
    [
        ("depth", "CALIBRATED"),
        ("plane", "PLANAR_OR_PANORAMIC"),
        ("turn", "PLANAR_OR_PANORAMIC"),
    ],
)
def test_what_only_e_or_h_too_explains_is_told_as_by_poselib_and_colmap(
    scene: str, configuration: str, seed: int
):
    xy0, xy1, _ = two_views(scene, seed)
    options = RansacOptions(max_error=MAX_ERROR, min_num_trials=100)
    fit = fit_pair(xy0, xy1, camera(), camera(), options=options)
    _, of_e, of_h = by_poselib(xy0, xy1)
    assert fit.homography_ratio == pytest.approx(np.sum(of_e & of_h) / of_e.sum(), abs=0.05)

    settings = pycolmap.TwoViewGeometryOptions()
    settings.ransac.max_error = MAX_ERROR
    pairs = np.repeat(np.arange(len(xy0), dtype=np.uint32)[:, None], 2, axis=1)
    colmap = pycolmap.estimate_calibrated_two_view_geometry(
        camera(), xy0, camera(), xy1, pairs, settings
    )
    # COLMAP calls planar or panoramic what H explains to 80 %.
    assert (fit.homography_ratio > settings.max_H_inlier_ratio) == (configuration != "CALIBRATED")
    assert colmap.config == int(getattr(pycolmap.TwoViewGeometryConfiguration, configuration))
