import numpy as np
import pytest

from mvmatch.bench.compose import COMPOSITIONS, paint_overlay
from mvmatch.bench.datasets import Sequence
from mvmatch.bench.truth import Targets
from mvmatch.errors import DataError
from mvmatch.geometry.trajectory import align_similarity
from mvmatch.testing import synthetic_drive

cv2 = pytest.importorskip("cv2")
pycolmap = pytest.importorskip("pycolmap")

FRAMES = 12


class Rendered:
    """Frames and truth of a synthetic scene."""

    def __init__(self, scene):
        self.scene = scene

    def __len__(self):
        return self.scene.num_frames

    def read(self, index):
        return self.scene.render(index)[:, :, ::-1]

    def targets(self, frame0, frame1, xy):
        target, visible = self.scene.transfer(frame0, frame1, np.asarray(xy, np.float64))
        return Targets(xy=target, visible=visible, moving=np.zeros(len(target), bool))


@pytest.fixture(scope="module")
def drive():
    scene = synthetic_drive(FRAMES, (320, 180))
    rendered = Rendered(scene)
    params = scene.K[[0, 1, 0, 1], [0, 1, 2, 2]]
    return Sequence(
        name="drive",
        frames=rendered,
        camera=pycolmap.Camera(model="PINHOLE", width=320, height=180, params=params),
        cam_from_world=scene.cam_from_world,
        truth=rendered,
    )


def grid(size, step=9):
    x, y = np.meshgrid(np.arange(step, size[0] - step, step), np.arange(step, size[1] - step, step))
    return np.column_stack([x.ravel(), y.ravel()]) + 0.5


@pytest.mark.parametrize("name", list(COMPOSITIONS))
def test_pictures_of_a_composition_match_where_its_truth_says(drive, name):
    sequence = COMPOSITIONS[name](drive)
    before, after = (sequence.frames.read(index).astype(np.float32) for index in (0, 3))
    assert before.shape == (sequence.size[1], sequence.size[0], 3)
    xy = grid(sequence.size)
    found = sequence.truth.targets(0, 3, xy)
    seen, target = xy[found.visible], found.xy[found.visible]
    assert found.visible.mean() > 0.3

    def sample(image, points):
        maps = (points - 0.5).astype(np.float32)[:, None]
        return cv2.remap(image, maps, None, cv2.INTER_LINEAR)[:, 0].mean(axis=1)

    here = sample(before, seen)
    right = np.abs(sample(after, target) - here).mean()
    shifted = min(
        np.abs(sample(after, target + offset) - here).mean()
        for offset in ([1.5, 0], [-1.5, 0], [0, 1.5], [0, -1.5])
    )
    assert right < shifted


@pytest.mark.parametrize("name", list(COMPOSITIONS))
def test_a_composition_is_the_same_every_time(drive, name):
    first, second = (COMPOSITIONS[name](drive) for _ in range(2))

    np.testing.assert_array_equal(first.frames.read(2), second.frames.read(2))
    np.testing.assert_array_equal(first.cam_from_world, second.cam_from_world)
    assert (first.name, first.half) == (f"drive+{name}", drive.half)


def test_repeated_frames_do_not_move(drive):
    sequence = COMPOSITIONS["repeats"](drive)

    assert len(sequence) == FRAMES * 5 // 4
    still = [
        np.array_equal(a, b) for a, b in zip(sequence.centers, sequence.centers[1:], strict=False)
    ]
    assert still[:6] == [True, False, False, False, False, True]
    np.testing.assert_allclose(sequence.truth.targets(0, 1, [[100, 90]]).xy, [[100, 90]])


def test_a_cut_jumps_once(drive):
    sequence = COMPOSITIONS["cut"](drive)
    steps = np.linalg.norm(np.diff(sequence.centers, axis=0), axis=1)

    assert len(sequence) == 8
    assert (steps > 3 * np.median(steps)).tolist() == [False] * 3 + [True] + [False] * 3


def test_nothing_on_the_overlay_is_ever_right(drive):
    covered = paint_overlay((320, 180))[:, :, 3] > 0
    y, x = np.nonzero(covered)
    found = COMPOSITIONS["overlay"](drive).truth.targets(0, 1, np.column_stack([x, y]) + 0.5)

    assert 0.1 < covered.mean() < 0.45
    assert not found.visible.any()


def test_a_pan_has_no_parallax_and_stays_inside_its_picture(drive):
    sequence = COMPOSITIONS["pan"](drive)
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * sequence.size
    assert np.ptp(sequence.centers, axis=0).max() == 0
    for homography in sequence.truth.how.base_from_composed:
        mapped = np.column_stack([corners, np.ones(4)]) @ homography.T
        assert ((mapped[:, :2] / mapped[:, 2:] >= 0).all(axis=1)).all()

    # Points go where the turned camera sees their rays.
    xy = grid(sequence.size)
    rays = np.column_stack([sequence.camera.cam_from_img(xy), np.ones(len(xy))])
    R = sequence.cam_from_world[5, :, :3] @ sequence.cam_from_world[0, :, :3].T
    expected = sequence.camera.img_from_cam(rays @ R.T)
    np.testing.assert_allclose(sequence.truth.targets(0, 5, xy).xy, expected, atol=1e-6)


def test_a_lens_with_distortion_cannot_pan(drive):
    from dataclasses import replace

    bent = pycolmap.Camera(model="SIMPLE_RADIAL", width=320, height=180, params=[200, 160, 90, 0.1])
    with pytest.raises(DataError, match="without distortion"):
        COMPOSITIONS["pan"](replace(drive, camera=bent))


def test_enlarging_keeps_the_field_of_view(drive):
    sequence = COMPOSITIONS["1080p"](drive)
    width, height = sequence.size

    assert (width, height) == (1920, 1080)
    corner = sequence.camera.cam_from_img(np.array([[1920.0, 1080.0]]))
    np.testing.assert_allclose(corner, drive.camera.cam_from_img(np.array([[320.0, 180.0]])))
    assert align_similarity(sequence.centers, drive.centers).scale == pytest.approx(1)


def test_shaken_pictures_are_blurred_and_the_camera_goes_where_it_went(drive):
    sequence = COMPOSITIONS["shake"](drive)
    np.testing.assert_allclose(sequence.centers, drive.centers, atol=1e-9)
    sharp = sequence.frames.steps[4].read(1).astype(np.float32)
    blurred = sequence.frames.read(1).astype(np.float32)

    def detail(image):
        return np.abs(np.diff(image, axis=0)).mean() + np.abs(np.diff(image, axis=1)).mean()

    assert detail(blurred) < 0.9 * detail(sharp)
