"""Pictures and videos without truth, and what the judges say of them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from mvmatch.bench.accuracy import AccuracyOptions, judge
from mvmatch.bench.datasets import find_sequences, load_sequence, write_frames
from mvmatch.bench.digests import folder_digest
from mvmatch.bench.mapping import pose_errors
from mvmatch.bench.matches import TrackMatches
from mvmatch.bench.summary import by_draw
from mvmatch.errors import DataError
from mvmatch.types import Tracks

cv2 = pytest.importorskip("cv2")
pytest.importorskip("pycolmap")


@pytest.fixture
def walk(tmp_path):
    """Twelve pictures whose names sort otherwise than their numbers."""
    folder = tmp_path / "walk"
    folder.mkdir()
    for number in range(12):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((40, 60, 3), 20 * number, np.uint8))
    return folder


@pytest.fixture
def clip(tmp_path):
    import av

    path = tmp_path / "walk.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for number in range(5):
            image = np.full((48, 64, 3), 40 * number, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())
    return path


def test_pictures_come_in_the_order_of_their_numbers_without_poses(walk):
    sequence = load_sequence(walk)

    assert len(sequence) == 12
    assert [sequence.frames.read(index)[0, 0, 0] for index in (2, 10)] == [40, 200]
    assert not sequence.posed.any()
    assert np.isnan(sequence.centers).all()
    assert not sequence.focal_known
    assert len(sequence.first(3)) == 3


def test_a_camera_beside_the_pictures_is_heeded(walk):
    (walk / "camera.txt").write_text("PINHOLE 60 40 50 51 30 20\n")
    sequence = load_sequence(walk)

    assert sequence.camera.params.tolist() == [50, 51, 30, 20]
    assert sequence.focal_known


def test_frames_of_a_video_are_read_in_any_order(clip, tmp_path):
    sequence = load_sequence(clip)
    levels = [int(sequence.frames.read(index).mean()) for index in (3, 3, 0, 4, 1)]

    assert (sequence.name, len(sequence), sequence.size) == ("walk", 5, (64, 48))
    assert levels == pytest.approx([120, 120, 0, 160, 40], abs=6)
    paths = write_frames(sequence, tmp_path / "out")
    assert [path.name for path in paths] == [f"00000{index}.png" for index in range(5)]
    assert cv2.imread(str(paths[2])).mean() == pytest.approx(80, abs=6)
    with pytest.raises(IndexError):
        sequence.frames.read(5)


def test_pictures_and_videos_count_where_they_are_named_themselves(walk, clip):
    assert find_sequences([walk]) == {"walk": walk}
    assert find_sequences([clip]) == {"walk": clip}
    with pytest.raises(DataError, match="two sequences are named walk"):
        find_sequences([walk, clip])
    with pytest.raises(DataError, match="holds no sequence"):
        find_sequences([walk.parent])


def test_a_picture_beside_sequences_does_not_hide_them(walk):
    cv2.imwrite(str(walk.parent / "overview.png"), np.zeros((4, 4, 3), np.uint8))
    (walk.parent / "drive" / "images").mkdir(parents=True)
    assert list(find_sequences([walk.parent])) == ["drive"]


def test_images_alone_are_nearly_a_sequence(walk):
    (walk.parent / "scene").mkdir()
    walk.rename(walk.parent / "scene" / "images")
    with pytest.raises(DataError, match="give images/ itself"):
        load_sequence(walk.parent / "scene")


def test_a_name_with_a_plus_sign_would_be_a_composition(walk):
    with pytest.raises(DataError, match="plus sign"):
        find_sequences([walk.rename(walk.parent / "walk+pan")])


@pytest.mark.parametrize("content", [b"", b"not a video"])
def test_a_file_that_is_no_video_is_refused(tmp_path, content):
    (tmp_path / "clip.mp4").write_bytes(content)
    with pytest.raises(DataError, match=r"clip\.mp4"):
        load_sequence(tmp_path / "clip.mp4")


def test_the_digest_of_a_video_changes_with_its_size(clip):
    before = folder_digest(clip)
    clip.write_bytes(clip.read_bytes() + b"\0")
    assert folder_digest(clip) != before


@pytest.mark.parametrize("found", [0, 40])
def test_what_needs_true_poses_is_nan_without_them_also_where_a_method_fails(walk, found):
    xy = np.random.default_rng(1).uniform((0, 0), (59, 39), (found, 1, 2))
    tracks = Tracks(
        offsets=np.arange(0, 2 * found + 1, 2),
        frame=np.tile(np.arange(2, dtype=np.int32), found),
        xy=np.concatenate([xy, xy + 1], axis=1).reshape(-1, 2).astype(np.float32),
    )
    matches = TrackMatches(tracks)
    rows = judge(matches, load_sequence(walk).first(2), AccuracyOptions(gaps=(1,), draws=0))

    assert rows[0]["matches"] == found
    assert all(
        math.isnan(rows[0][name]) for name in ("rotation_deg", "translation_deg", "pose_deg")
    )
    assert np.isnan(by_draw(rows)["auc_5"]).all()


def test_a_trajectory_has_no_error_without_true_poses_and_counts_the_known_ones(walk, make_model):
    sequence = load_sequence(walk)
    model = make_model()
    assert all(math.isnan(error) for error in pose_errors(model, sequence).values())
    assert all(math.isnan(error) for error in pose_errors(None, sequence).values())

    poses = sequence.cam_from_world.copy()
    for image in model.images.values():
        poses[image.image_id - 1] = image.cam_from_world().matrix()
    poses[4] = np.nan
    known = replace(sequence, cam_from_world=poses)
    assert pose_errors(model, known)["ate"] == pytest.approx(0, abs=1e-9)
    assert pose_errors(None, known)["ate"] == math.inf
