"""Chaining of motion fields: options, presets and the rules that they switch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mvmatch.sources import open_video
from mvmatch.testing.fields import field_from_rows
from mvmatch.tracks import TrackOptions, build_tracks, chain_fields
from mvmatch.types import Tracks

PLAIN = TrackOptions(
    max_error=None, max_drift=None, carry="translate", epsilon=None, cell=None, extend=False
)


def grid(width, height, size=8):
    return [[x, y, size, size] for y in range(0, height, size) for x in range(0, width, size)]


def translating(num_frames, mv, *, width=64, height=32):
    """Fields of a picture that moves by one vector per frame, each block 8 px."""
    fields = [field_from_rows(0, [], width=width, height=height)]
    for frame in range(1, num_frames):
        rows = [(block, mv, frame - 1) for block in grid(width, height)]
        fields.append(field_from_rows(frame, rows, width=width, height=height))
    return fields


def test_points_are_carried_through_blocks_and_not_snapped_to_their_centers():
    fields = [
        field_from_rows(0, []),
        field_from_rows(1, [([0, 0, 64, 32], (2.5, 0.0), 0)]),
        field_from_rows(2, [([8, 8, 8, 8], (3.0, 1.0), 1)]),
    ]
    tracks = build_tracks(fields, options=PLAIN)
    assert tracks.frame.tolist() == [0, 1, 2]
    assert tracks.xy.tolist() == [[17.5, 13.0], [15.0, 13.0], [12.0, 12.0]]


def test_a_static_block_keeps_its_zero_vector_unless_the_paper_is_followed():
    fields = translating(4, (0.0, 0.0))
    assert len(build_tracks(fields)) == 32
    assert len(build_tracks(fields, options=TrackOptions.preset("paper"))) == 0


def test_the_default_holds_one_track_per_cell_and_frame():
    tracks = build_tracks(translating(6, (1.5, 0.25)))
    assert len(tracks) > 0
    cells = np.column_stack([tracks.frame, np.floor(tracks.xy / 8)])
    assert len(np.unique(cells, axis=0)) == len(cells)


def test_the_neighbor_filter_removes_the_vector_that_stands_alone():
    fields = translating(3, (2.0, 0.0))
    fields[1].mv[9] = (-30.0, 11.0)
    wrong = fields[1].centers[9]
    kept = build_tracks(fields).between(0, 1).xy1
    assert not np.any(np.all(np.abs(kept - wrong) < 4, axis=1))
    assert len(kept) > 10


@pytest.mark.parametrize("carry", ["translate", "fuse"])
def test_a_translation_is_carried_alike_by_every_rule(carry):
    fields = translating(5, (1.25, -0.5))
    tracks = build_tracks(fields, options=TrackOptions(carry=carry))
    for frame0 in range(3):
        pair = tracks.between(frame0, frame0 + 2)
        np.testing.assert_allclose(
            pair.xy0 - pair.xy1, np.tile([2.5, -1.0], (len(pair), 1)), atol=1e-4
        )


def test_fusion_follows_a_zoom_that_translation_rounds_to_blocks():
    middle = np.array([128.0, 64.0])
    blocks = np.array(grid(256, 128, 16))
    vectors = 0.04 * (blocks[:, :2] + 8 - middle)
    rows = [
        [(block, mv, frame) for block, mv in zip(blocks, vectors, strict=True)] for frame in (0, 1)
    ]
    size = {"width": 256, "height": 128}
    fields = [
        field_from_rows(0, [], **size),
        field_from_rows(1, rows[0], **size),
        field_from_rows(2, rows[1], **size),
    ]
    error = {}
    for carry in ("translate", "fuse"):
        pair = build_tracks(fields, options=TrackOptions(carry=carry, cell=None)).between(2, 0)
        exact = (pair.xy0 - middle) * 1.04**2 + middle
        error[carry] = np.linalg.norm(pair.xy1 - exact, axis=1).mean()
    assert error["fuse"] < 0.4 * error["translate"]


def test_a_pyramid_of_future_references_gives_longer_tracks_when_all_are_followed():
    rows = {
        0: [],
        4: [(4.0, 0)],
        2: [(2.0, 0), (-2.0, 4)],
        1: [(1.0, 0), (-1.0, 2)],
        3: [(1.0, 2), (-1.0, 4)],
    }
    fields = [
        field_from_rows(
            frame,
            [(block, (dx, 0.0), reference) for block in grid(64, 32) for dx, reference in motion],
            decode_index=decode_index,
        )
        for decode_index, (frame, motion) in enumerate(rows.items())
    ]
    nearest = build_tracks(fields, options=TrackOptions(cell=None, follow="nearest", extend=False))
    everything = build_tracks(fields, options=TrackOptions(cell=None, extend=False))
    assert everything.lengths.max() > nearest.lengths.max()
    for tracks in (nearest, everything):
        first = tracks.offsets[:-1][tracks.track_index]
        moved = tracks.xy[:, 0] - tracks.xy[first, 0]
        np.testing.assert_array_equal(moved, -(tracks.frame - tracks.frame[first]).astype(float))


def test_tracks_reach_into_a_frame_whose_block_leads_to_them_off_its_center():
    block = [16, 8, 8, 8]
    fields = [
        field_from_rows(0, []),
        field_from_rows(1, [([0, 0, 64, 32], (1.0, 0.0), 0)]),
        field_from_rows(2, [(block, (2.0, 0.0), 1)]),
        field_from_rows(3, [([0, 0, 64, 32], (3.0, 0.0), 2)]),
    ]
    plain = build_tracks(fields, options=PLAIN)
    assert plain.xy.tolist() == [[23.0, 12.0], [22.0, 12.0], [20.0, 12.0]]
    extended = build_tracks(fields, options=replace(PLAIN, extend=True))
    assert extended.xy.tolist() == [[23.0, 12.0], [22.0, 12.0], [20.0, 12.0], [17.0, 12.0]]


def test_fields_out_of_decode_order_are_refused():
    fields = translating(3, (1.0, 0.0))
    with pytest.raises(ValueError, match="decode order: 1 follows 2"):
        build_tracks([fields[0], fields[2], fields[1]])


def test_arrays_of_the_wrong_shape_are_refused_by_name():
    field = field_from_rows(1, [([0, 0, 8, 8], (1.0, 0.0), 0)])
    object.__setattr__(field, "mv", np.zeros((1, 3), np.float32))
    with pytest.raises(ValueError, match="mv must have the shape"):
        build_tracks([field])


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("tau", -1.0),
        ("cell", 0),
        ("window", 0),
        ("min_length", 0),
        ("num_neighbors", 40),
        ("max_error", -0.1),
        ("max_drift", -1.0),
    ],
)
def test_options_out_of_range_are_refused_by_name(option, value):
    with pytest.raises(ValueError, match=option):
        TrackOptions(**{option: value})


def test_an_unknown_preset_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match="default, dense, fast, paper"):
        TrackOptions.preset("slow")


def test_filling_changes_no_track_and_uses_cells_that_are_free():
    fields = translating(6, (1.5, 0.25))
    plain = build_tracks(fields)
    tracks, further = chain_fields(fields, options=TrackOptions(fill=2))
    np.testing.assert_array_equal(tracks.xy, plain.xy)
    np.testing.assert_array_equal(tracks.offsets, plain.offsets)
    assert len(further) > 2 * len(tracks)
    both = Tracks.concatenate(tracks, further)
    cells = np.column_stack([both.frame, np.floor(both.xy / 2)])[len(tracks.frame) :]
    taken = np.column_stack([tracks.frame, np.floor(tracks.xy / 2)])
    assert len(np.unique(cells, axis=0)) == len(cells)
    assert not {tuple(c) for c in cells.tolist()} & {tuple(c) for c in taken.tolist()}


def test_filling_starts_no_track_where_no_usable_block_is():
    block = [0, 0, 32, 32]
    rows = ([], [(block, (0.0, 0.0), 0)], [(block, (0.0, 0.0), 1)])
    fields = [field_from_rows(frame, each) for frame, each in enumerate(rows)]
    filled = replace(PLAIN, cell=8, fill=4, fill_error=None, fill_drift=None)
    tracks = build_tracks(fields, options=filled)
    assert len(tracks) == 64
    assert tracks.xy.max() < 32


def test_further_tracks_have_bounds_of_their_own(data):
    with open_video(data / "drive.ivf") as source:
        fields = list(source)
    own, further = [], []
    for bound in (0.05, 0.16, None):
        options = TrackOptions(fill=6, fill_error=bound, fill_drift=None)
        tracks, others = chain_fields(fields, options=options)
        own.append(tracks.num_observations)
        further.append(others.num_observations)
    assert own[0] == own[1] == own[2]
    assert further[0] < further[1] < further[2]
    ended = chain_fields(fields, options=TrackOptions(fill=6, fill_error=None, fill_drift=0.2))[1]
    assert ended.lengths.mean() < others.lengths.mean()


def test_bounds_of_further_tracks_do_not_judge_where_the_others_are_not_judged():
    fields = translating(6, (1.5, 0.25))
    plain = TrackOptions.preset("paper")
    tracks = build_tracks(fields, options=plain)
    filled, further = chain_fields(fields, options=replace(plain, fill=4))
    np.testing.assert_array_equal(filled.xy, tracks.xy)
    assert len(further)


def test_the_cap_holds_in_every_frame_and_what_it_removes_still_fills():
    fields = translating(6, (1.5, 0.25))
    tracks, _ = chain_fields(fields, options=TrackOptions(max_keypoints_per_image=10))
    assert np.bincount(tracks.frame).max() <= 10
    capped = TrackOptions(max_keypoints_per_image=10, fill=8)
    _, further = chain_fields(fields, options=capped)
    assert len(tracks) + len(further) >= len(build_tracks(fields))


def test_tracks_go_on_from_window_to_window():
    fields = translating(40, (0.0, 0.0))
    tracks = build_tracks(fields, options=TrackOptions(window=7, max_drift=None))
    assert tracks.lengths.tolist() == [40] * 32
    still = TrackOptions(window=7, max_drift=None, fill=4, fill_drift=None)
    further = chain_fields(fields, options=still)[1]
    assert further.lengths.tolist() == [40] * len(further) == [40] * 96


def test_a_window_as_long_as_the_video_changes_nothing():
    fields = translating(40, (1.5, 0.25))
    whole = build_tracks(fields, options=TrackOptions(window=None))
    same = build_tracks(fields, options=TrackOptions(window=40))
    np.testing.assert_array_equal(same.xy, whole.xy)
    np.testing.assert_array_equal(same.offsets, whole.offsets)
    shorter = build_tracks(fields, options=TrackOptions(window=10))
    assert shorter.num_observations > 0.9 * whole.num_observations
