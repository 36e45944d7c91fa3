"""Trajectories of models, read by evo."""

import re

import numpy as np
import pytest

from mvmatch.errors import DataError
from mvmatch.export.trajectory import frame_times, write_kitti, write_tum
from mvmatch.sources import open_video

pycolmap = pytest.importorskip("pycolmap")

GAPS = [f"frame_{frame:06d}.png" for frame in (12, 3, 4, 7, 100)]


def world_from_cam(model, order):
    poses = [model.image(number).cam_from_world().inverse().matrix() for number in order]
    return np.array([np.vstack([pose, [0, 0, 0, 1]]) for pose in poses])


def test_evo_reads_tum_poses_at_the_times_of_their_frames(make_model, tmp_path):
    file_interface = pytest.importorskip("evo.tools.file_interface")
    model, times = make_model(GAPS), np.arange(101) * 0.04 + 17.5
    write_tum(model, tmp_path / "path.tum", times=times)

    found = file_interface.read_tum_trajectory_file(tmp_path / "path.tum")
    assert found.check()[0]
    np.testing.assert_allclose(found.timestamps, times[[3, 4, 7, 12, 100]], atol=1e-9)
    expected = world_from_cam(model, [2, 3, 4, 1, 5])
    np.testing.assert_allclose(found.poses_se3, expected, atol=1e-12)


def test_without_times_the_frame_number_is_the_timestamp(make_model, tmp_path):
    file_interface = pytest.importorskip("evo.tools.file_interface")
    write_tum(make_model(GAPS), tmp_path / "path.tum")
    found = file_interface.read_tum_trajectory_file(tmp_path / "path.tum")
    np.testing.assert_array_equal(found.timestamps, [3, 4, 7, 12, 100])


def test_evo_reads_kitti_poses_in_frame_order(make_model, tmp_path):
    file_interface = pytest.importorskip("evo.tools.file_interface")
    model = make_model(["7.png", "6.png", "8.png"])
    assert write_kitti(model, tmp_path / "poses.txt") == range(6, 9)

    found = file_interface.read_kitti_poses_file(tmp_path / "poses.txt")
    assert found.check()[0]
    np.testing.assert_allclose(found.poses_se3, world_from_cam(model, [2, 1, 3]), atol=1e-12)


def test_kitti_names_the_frames_that_are_missing(make_model, tmp_path):
    message = r"93 of 98 .* none: 5, 6, 8, 9, 10, 11, 13, 14 and 85 more\. Use TUM"
    with pytest.raises(DataError, match=message):
        write_kitti(make_model(GAPS), tmp_path / "poses.txt")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("write", [write_tum, write_kitti])
@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["left.png", "0.png", "1.png"], r"left\.png carries no frame number\. Name"),
        (["a/7.png", "b/0007.png", "8.png"], r"a/7\.png and b/0007\.png have the same .* 7"),
    ],
)
def test_frames_that_cannot_be_told_apart_are_refused(write, names, message, make_model, tmp_path):
    with pytest.raises(DataError, match=message):
        write(make_model(names), tmp_path / "path")


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (np.arange(100.0), "times of 100 frames but the model has frame 100"),
        (np.zeros(101), "do not increase"),
        (np.full(101, np.nan), "do not increase"),
    ],
)
def test_times_that_cannot_be_are_refused(times, message, make_model, tmp_path):
    with pytest.raises(DataError, match=message):
        write_tum(make_model(GAPS), tmp_path / "path.tum", times=times)


@pytest.mark.parametrize("suffix", ["ivf", "mkv", "mp4", "webm"])
def test_times_of_a_video_are_those_of_its_shown_frames(suffix, data):
    clip = data / f"svt_flat_p8.{suffix}"
    with open_video(clip) as source:
        for _ in source:
            pass
        shown = {facts.display_index: facts.pts for facts in source.frames if facts.is_shown}
    expected = [time for _, time in sorted(shown.items())]
    np.testing.assert_allclose(frame_times(clip), expected, atol=1e-9)


def test_times_of_a_video_with_hidden_frames_are_in_display_order(data):
    clip = data / "svt_random_access_p6.ivf"
    with open_video(clip) as source:
        for _ in source:
            pass
        shown = {facts.display_index: facts.pts for facts in source.frames if facts.is_shown}
    np.testing.assert_allclose(frame_times(clip), [shown[k] for k in sorted(shown)], atol=1e-9)


def test_times_come_from_a_text_file_too(tmp_path):
    path = tmp_path / "times.txt"
    path.write_text("# s\n0.0\n1.036e-01  # second\n\n2.1\n")
    np.testing.assert_array_equal(frame_times(path), [0, 0.1036, 2.1])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "holds no times"),
        (b"first\n", "is not a list of times"),
        (b"\0\1\2" * 99, "cannot be read as a video"),
    ],
)
def test_a_file_without_times_is_refused(content, message, tmp_path):
    path = tmp_path / "times"
    path.write_bytes(content)
    with pytest.raises(DataError, match=re.escape(str(path)) + f".*{message}"):
        frame_times(path)


def test_a_stream_without_times_is_refused(data):
    with pytest.raises(DataError, match="--fps"):
        frame_times(data / "svt_flat_p8.obu")
