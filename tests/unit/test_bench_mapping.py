"""What the benchmark says of a model: its points, and those added after mapping."""

import numpy as np
import pytest

from mvmatch.bench.mapping import count_points
from mvmatch.bench.matches import Sample, TrackMatches, sampled
from mvmatch.types import Tracks

pycolmap = pytest.importorskip("pycolmap")


def model(tracks: Tracks, *, mapped: int):
    """Images one unit apart that look at points 5 units away; the first tracks have a point."""
    camera = pycolmap.Camera(
        camera_id=1, model="PINHOLE", width=640, height=480, params=[500.0, 500.0, 320.0, 240.0]
    )
    made = pycolmap.Reconstruction()
    made.add_camera_with_trivial_rig(camera)
    for frame in range(tracks.num_frames):
        xy = tracks.keypoints(frame).astype(np.float64)
        image = pycolmap.Image(f"{frame}.png", xy, 1, frame + 1)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(), np.array([-float(frame), 0.0, 0.0]))
        made.add_image_with_trivial_frame(image, pose)
    for track in range(mapped):
        rows = range(tracks.offsets[track], tracks.offsets[track + 1])
        elements = [
            pycolmap.TrackElement(int(tracks.frame[row]) + 1, int(tracks.keypoint_index[row]))
            for row in rows
        ]
        made.add_point3D(np.array([0.0, 0.0, 5.0]), pycolmap.Track(elements))
    return made


def seen(x: float) -> list[tuple[int, float, float]]:
    """Track of a point at depth 5 in three images."""
    return [(frame, x - 100.0 * frame, 240.0) for frame in range(3)]


def test_points_that_share_a_place_in_an_image_count_once() -> None:
    tracks = Tracks.from_lists(seen(400.0), seen(400.5), seen(450.0))
    counts = count_points(model(tracks, mapped=3))
    assert counts == {"points": 3, "distinct_points": 2}


def test_there_are_no_points_without_a_model() -> None:
    assert count_points(None) == {"points": 0, "distinct_points": 0}


def test_further_tracks_become_points_and_a_draw_drops_some_of_them() -> None:
    tracks = Tracks.from_lists(*(seen(400.0 + 5 * k) for k in range(5)))
    further = Tracks.from_lists(*(seen(500.0 + 5 * k) for k in range(10)))
    matches = TrackMatches(tracks, further)
    whole = model(Tracks.concatenate(tracks, further), mapped=5)
    matches.densify(whole, sample=None)
    assert whole.num_points3D() == 15

    sample = Sample(share=0.8, seed=0)
    kept = Tracks.concatenate(sampled(tracks, sample), sampled(further, sample))
    drawn = model(kept, mapped=4)
    matches.densify(drawn, sample=sample)
    assert drawn.num_points3D() == 12


def test_nothing_is_added_to_a_model_without_further_tracks() -> None:
    tracks = Tracks.from_lists(seen(400.0))
    made = model(tracks, mapped=1)
    TrackMatches(tracks).densify(made, sample=None)
    assert made.num_points3D() == 1
