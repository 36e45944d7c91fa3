import pytest

from mvmatch.footage import FootageObserver
from mvmatch.testing.fields import field_from_rows
from mvmatch.tracks import TrackOptions, build_tracks

BLOCKS = [[x, y, 8, 8] for y in range(0, 64, 8) for x in range(0, 128, 8)]
RULES = TrackOptions(max_error=None, max_drift=None, carry="translate", cell=None)
LOGO = ([112, 0, 8, 8], [112, 8, 8, 8])


def watched(step, *, frames=16, cut=None, repeat=None):
    """Tracks and findings of a picture that moves by ``step`` px under a logo."""
    fields = []
    for frame in range(frames):
        blocks = [] if frame == 0 else BLOCKS[:2] if frame == cut else BLOCKS
        vector = (0.0, 0.0) if frame == repeat else (float(step), 0.0)
        rows = [(b, (0.0, 0.0) if b in LOGO else vector, frame - 1) for b in blocks]
        fields.append(field_from_rows(frame, rows, width=128, height=64))
    observer = FootageObserver()
    tracks = build_tracks(observer.watch(fields), options=RULES)
    return tracks, *observer.clean(tracks, min_length=3)


def test_no_track_is_left_on_an_overlay_and_none_beside_it_is_lost():
    tracks, cleaned, footage = watched(3)
    assert footage.overlays.contain(tracks.frame, tracks.xy).sum() > 0
    assert footage.overlays.contain(cleaned.frame, cleaned.xy).sum() == 0
    assert len(cleaned.frame) >= len(tracks.frame) - footage.num_overlay_observations * 1.1
    assert footage.num_overlay_observations > 0


def test_no_track_crosses_a_cut():
    _, cleaned, footage = watched(3, cut=8)
    assert footage.cuts == (8,)
    assert footage.longest_shot(16) == 8
    start, end = cleaned.frame[cleaned.offsets[:-1]], cleaned.frame[cleaned.offsets[1:] - 1]
    assert not ((start < 8) & (end >= 8)).any()


def test_a_picture_that_no_track_enters_is_a_break_whatever_the_reason():
    """Key frames have no vectors, and so no cut is found there."""
    fields = []
    for frame in range(16):
        rows = [] if frame in {0, 10} else [(b, (3.0, 0.0), frame - 1) for b in BLOCKS]
        fields.append(field_from_rows(frame, rows, width=128, height=64))
    observer = FootageObserver()
    tracks = build_tracks(observer.watch(fields), options=RULES)
    cleaned, footage = observer.clean(tracks, min_length=3)
    assert (footage.cuts, footage.breaks) == ((), (10,))
    assert footage.longest_shot(16) == 10
    said = footage.warnings(len(cleaned.frame))
    assert "No track goes on into the pictures 10, 1 in all" in said[0]
    assert footage.summary()["breaks"] == [10]


def test_without_tracks_nothing_is_said_of_breaks():
    observer = FootageObserver()
    tracks = build_tracks(observer.watch([]), options=RULES)
    assert observer.clean(tracks, min_length=3)[1].breaks == ()


def test_a_repeated_picture_keeps_its_observations():
    tracks, cleaned, footage = watched(3, repeat=8)
    assert footage.repeats == (8,)
    assert len(cleaned.observations(8)) > 0.9 * (len(tracks.observations(8)) - len(LOGO))


def test_a_far_sky_without_texture_stands_still_and_is_not_worth_a_warning():
    sky = [0, 0, 64, 32]
    beside = [b for b in BLOCKS if b[0] >= 64 or b[1] >= 32]
    fields = []
    for frame in range(16):
        rows = [(b, (3.0, 0.0), frame - 1) for b in beside] + [(sky, (0.0, 0.0), frame - 1)]
        fields.append(field_from_rows(frame, rows if frame else [], width=128, height=64))
    observer = FootageObserver()
    tracks = build_tracks(observer.watch(fields), options=RULES)
    cleaned, footage = observer.clean(tracks, min_length=3)
    assert footage.overlays.area_share == footage.overlays.mean_area_share == 0.25
    assert footage.num_overlay_observations > 0
    assert footage.warnings(len(cleaned.frame)) == []


def test_a_static_camera_keeps_all_tracks_and_warns_of_nothing():
    tracks, cleaned, footage = watched(0)
    assert len(cleaned) == len(tracks) > 0
    assert footage.warnings(len(cleaned.frame)) == []
    assert footage.longest_shot(16) == 16


@pytest.mark.parametrize(
    ("found", "text"),
    [
        ({"cut": 8}, "Scene cuts before the pictures 8, 1 in all"),
        ({"repeat": 8}, "show the one before them again: 8, 1 in all"),
        ({}, "Static overlays cover up to 1.6% of the picture"),
    ],
)
def test_what_is_found_is_said(found, text):
    _, cleaned, footage = watched(3, **found)
    assert any(text in warning for warning in footage.warnings(len(cleaned.frame)))
    summary = footage.summary()
    assert summary["cuts"] == list(footage.cuts)
    assert summary["overlay_area_share"] == 2 / 128


def test_a_camera_at_rest_is_seen_though_things_move_before_it():
    """Where zero vectors are left out, tracks see the movers alone."""
    for moving, stands_still in ((len(BLOCKS) // 4, True), (len(BLOCKS) // 2 + 8, False)):
        rows = [(b, (3.0, 0.0) if i < moving else (0.0, 0.0)) for i, b in enumerate(BLOCKS)]
        observer = FootageObserver()
        fields = [field_from_rows(0, [], width=128, height=64)]
        for frame in range(1, 16):
            given = [(block, vector, frame - 1) for block, vector in rows]
            fields.append(field_from_rows(frame, given, width=128, height=64))
        tracks = build_tracks(observer.watch(fields), options=RULES)
        footage = observer.clean(tracks, min_length=3)[1]
        assert footage.still_area_share == pytest.approx(1 - moving / len(BLOCKS))
        assert footage.stands_still is stands_still
        assert footage.summary()["still_area_share"] == footage.still_area_share


def test_a_camera_that_stops_for_most_of_the_time_does_not_stand_still():
    """One frame of twenty that moves is too little, four are enough."""
    for moving, stands_still in ((1, True), (4, False)):
        fields = [field_from_rows(0, [], width=128, height=64)]
        for frame in range(1, 21):
            vector = (3.0, 0.0) if frame <= moving else (0.0, 0.0)
            rows = [(block, vector, frame - 1) for block in BLOCKS]
            fields.append(field_from_rows(frame, rows, width=128, height=64))
        observer = FootageObserver()
        tracks = build_tracks(observer.watch(fields), options=RULES)
        assert observer.clean(tracks, min_length=3)[1].stands_still is stands_still
