import numpy as np

from mvmatch.cells import field_cells
from mvmatch.overlays import OverlayFinder
from mvmatch.shots import CutFinder, ShotOptions, end_tracks, find_repeats
from mvmatch.testing.fields import field_from_rows
from mvmatch.types import Tracks

BLOCKS = [[x, y, 8, 8] for y in range(0, 32, 8) for x in range(0, 64, 8)]


def finders(pictures, **options):
    """Cut finder and overlays of fields: per picture its rows (block, vector, reference)."""
    cuts, overlays = CutFinder(ShotOptions(**options)), OverlayFinder()
    for decode, (frame, rows) in enumerate(pictures):
        field = field_from_rows(frame, rows, decode_index=decode)
        cuts.add(field, field_cells(field))
        overlays.add(field, field_cells(field))
    return cuts, overlays.overlays()


def cuts_of(pictures, **options):
    finder, overlays = finders(pictures, **options)
    return finder.cuts(overlays)


def jumps_or_cuts(pictures):
    finder, overlays = finders(pictures)
    return finder.cuts(overlays) + finder.jumps(overlays)


def covered(frame, share, reference=None, vector=(3.0, 0.0)):
    count = round(share * len(BLOCKS))
    reference = frame - 1 if reference is None else reference
    return frame, [(block, vector, reference) for block in BLOCKS[:count]]


def drive(shares):
    return [(0, []), *(covered(frame, share) for frame, share in enumerate(shares, 1))]


def test_a_collapse_of_the_predicted_area_is_a_cut():
    assert cuts_of(drive([0.9] * 6 + [0.05] + [0.9] * 6)) == (7,)


def test_a_jump_within_a_scene_is_told_from_a_cut():
    finder, overlays = finders(drive([0.9] * 6 + [0.3] + [0.9] * 6))
    assert finder.cuts(overlays) == ()
    assert finder.jumps(overlays) == (7,)


def test_intra_coded_footage_has_no_cuts_as_long_as_it_goes_on_alike():
    assert jumps_or_cuts(drive([0.4, 0.3, 0.35, 0.4, 0.3, 0.25, 0.4])) == ()


def test_a_key_frame_amid_continuous_motion_is_no_cut():
    pictures = drive([0.9] * 12)
    pictures[6] = (6, [])
    assert jumps_or_cuts(pictures) == ()


def test_a_flash_is_no_cut_because_the_picture_after_it_refers_to_the_one_before():
    pictures = drive([0.9] * 12)
    pictures[6] = covered(6, 0.1)
    pictures[7] = covered(7, 0.9, reference=5)
    assert jumps_or_cuts(pictures) == ()


def test_a_cut_shows_in_a_pyramid_of_references():
    def pyramid(links):
        decoded = [(0, []), *(covered(f, 0.9 if f in links else 0.05, r) for f, r in ORDER)]
        for leaf, later in ((1, 2), (3, 4), (5, 6), (7, 8)):
            rows = covered(leaf, 0.9, leaf - 1)[1] + covered(leaf, 0.9, later)[1]
            decoded.append((leaf, rows))
        return decoded

    # Before picture 6: 8 and 6 have no use of what lies before, and 5 none of what comes after.
    order = pyramid({4, 2})
    order[-2] = covered(5, 0.9, 4)
    assert cuts_of(order) == (6,)
    assert cuts_of(pyramid({8, 4, 2, 6})) == ()


ORDER = ((8, 0), (4, 0), (2, 0), (6, 4))


def test_an_overlay_that_goes_on_through_a_cut_does_not_hide_it():
    dashboard = [(block, (0.0, 0.0)) for block in BLOCKS[16:]]

    def picture(frame, width):
        moving = [(block, (3.0, 0.0), frame - 1) for block in BLOCKS[:width]]
        return frame, moving + [(block, vector, frame - 1) for block, vector in dashboard]

    pictures = [(0, []), *(picture(frame, 2 if frame == 10 else 16) for frame in range(1, 20))]
    finder, overlays = finders(pictures)
    assert overlays.area_share == 0.5
    assert finder.cuts() == finder.jumps() == ()
    assert finder.cuts(overlays) == (10,)


def test_cuts_can_be_switched_off():
    assert cuts_of(drive([0.9] * 6 + [0.05] + [0.9] * 6), jump_share=None) == ()


def moving_tracks(steps, count=20, still=0):
    """Tracks through all pictures; all but ``still`` of them move by the steps, px."""
    x = np.concatenate([[0.0], np.cumsum(steps)])
    return Tracks.from_lists(
        *(
            [(frame, 10.0 + (0 if track < still else x[frame]), track) for frame in range(len(x))]
            for track in range(count)
        )
    )


def test_a_picture_shown_twice_amid_motion_is_a_repeat():
    assert find_repeats(moving_tracks([3, 3, 0, 3, 3, 3, 3, 0, 3])) == (3, 8)


def test_pictures_shown_twice_each_are_repeats():
    assert find_repeats(moving_tracks([0, 3, 0, 3, 0, 3])) == (1, 3, 5)


def test_a_static_camera_repeats_nothing():
    assert find_repeats(moving_tracks([0] * 9)) == ()
    assert find_repeats(moving_tracks([3, 3, 0, 3, 3], still=16)) == ()


def test_a_camera_that_rests_for_a_while_repeats_nothing():
    assert find_repeats(moving_tracks([3, 3, 0, 0, 0, 0, 0, 3, 3])) == ()


def test_slow_motion_is_no_repeat():
    assert find_repeats(moving_tracks([3, 0.25, 3, 3])) == ()


def test_repeats_can_be_switched_off():
    options = ShotOptions(repeat_share=None)
    assert find_repeats(moving_tracks([3, 3, 0, 3]), options) == ()
    assert find_repeats(Tracks.from_lists()) == ()


def test_tracks_end_at_cuts_and_go_on_as_others():
    tracks = Tracks.from_lists(
        [(frame, float(frame), 0.0) for frame in range(6)], [(0, 5.0, 5.0), (1, 6.0, 5.0)]
    )
    ended = end_tracks(tracks, cuts=[3], min_length=3)
    assert ended.lengths.tolist() == [3, 3, 2]
    assert ended.frame.tolist() == [0, 1, 2, 3, 4, 5, 0, 1]
    np.testing.assert_array_equal(ended.xy, tracks.xy)


def test_what_is_taken_out_divides_a_track_and_short_remains_go():
    tracks = Tracks.from_lists([(frame, float(frame), 0.0) for frame in range(6)])
    drop = np.array([False, True, False, False, False, False])
    ended = end_tracks(tracks, drop=drop, min_length=3)
    assert ended.frame.tolist() == [2, 3, 4, 5]


def test_without_cuts_tracks_stay_as_they_are():
    tracks = Tracks.from_lists([(0, 1.0, 1.0), (1, 2.0, 1.0)], [(0, 1.0, 4.0), (3, 2.0, 4.0)])
    ended = end_tracks(tracks, min_length=3)
    np.testing.assert_array_equal(ended.offsets, tracks.offsets)
    np.testing.assert_array_equal(ended.frame, tracks.frame)
    assert len(end_tracks(Tracks.from_lists(), cuts=[2])) == 0
