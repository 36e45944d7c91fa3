"""What holds for tracks of any motion fields."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mvmatch.filters import cosine_consistency, drop_uncertain, drop_zero, min_length, thin
from mvmatch.testing.fields import field_from_rows
from mvmatch.tracks import TrackOptions, build_tracks

if TYPE_CHECKING:
    from mvmatch.types import MotionField, Tracks

WIDTH, HEIGHT, SIDE = 96, 48, 8
BLOCKS = [[x, y, SIDE, SIDE] for y in range(0, HEIGHT, SIDE) for x in range(0, WIDTH, SIDE)]
PLAIN = TrackOptions(max_error=None, max_drift=None, carry="translate", epsilon=None, cell=None)


@st.composite
def videos(draw: st.DrawFn, *, reorder: bool = True) -> list[MotionField]:
    """A few frames in any decode order, each block intra, single or compound, vectors in 1/8 px."""
    num_frames = draw(st.integers(3, 6))
    frames = draw(st.permutations(range(num_frames))) if reorder else list(range(num_frames))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    spread = draw(st.sampled_from([0, 4, 40, 400]))
    common = random.integers(-spread - 8, spread + 9, 2)
    fields = [field_from_rows(frames[0], [], decode_index=0, width=WIDTH, height=HEIGHT)]
    for decode_index in range(1, num_frames):
        rows = []
        for block in BLOCKS:
            references = random.permutation(frames[:decode_index])[: random.integers(0, 3)]
            for reference in references:
                vector = (common + random.integers(-spread, spread + 1, 2)) / 8
                rows.append((block, vector, int(reference)))
        fields.append(
            field_from_rows(
                frames[decode_index], rows, decode_index=decode_index, width=WIDTH, height=HEIGHT
            )
        )
    return fields


OPTIONS = st.builds(
    TrackOptions,
    keep_zero=st.booleans(),
    max_error=st.sampled_from([None, 0.3]),
    carry=st.sampled_from(["translate", "fuse"]),
    follow=st.sampled_from(["nearest", "all"]),
    epsilon=st.sampled_from([None, 0.1]),
    cell=st.sampled_from([None, 8]),
    extend=st.booleans(),
)


def observations(tracks: Tracks) -> set[tuple[int, float, float]]:
    rows = np.column_stack([tracks.frame, tracks.xy])
    return {tuple(row) for row in rows.tolist()}


@given(fields=videos(), options=OPTIONS)
@settings(deadline=None, max_examples=40)
def test_tracks_of_any_structure_keep_their_rules(fields, options):
    tracks = build_tracks(fields, options=options)  # Tracks itself refuses frames that do not rise
    assert np.all(tracks.lengths >= options.min_length)
    assert np.all((tracks.xy >= 0) & (tracks.xy < [WIDTH, HEIGHT]))
    if options.cell is not None:
        cells = np.column_stack([tracks.frame, np.floor(tracks.xy / options.cell)])
        assert len(np.unique(cells, axis=0)) == len(cells)
    again = build_tracks(fields, options=options)
    np.testing.assert_array_equal(tracks.xy, again.xy)


@given(fields=videos(), options=OPTIONS)
@settings(deadline=None, max_examples=40)
def test_between_mirrors_itself_and_agrees_with_the_pairs(fields, options):
    tracks = build_tracks(fields, options=options)
    counts = {(i, j): count for i, j, count in tracks.adjacency().tolist()}
    pairs = 0
    for frame0, frame1, matches in tracks.pairs():
        forward, backward = tracks.between(frame0, frame1), tracks.between(frame1, frame0)
        np.testing.assert_array_equal(forward.xy0, backward.xy1)
        np.testing.assert_array_equal(forward.xy1, backward.xy0)
        np.testing.assert_array_equal(tracks.keypoints(frame0)[matches[:, 0]], forward.xy0)
        np.testing.assert_array_equal(tracks.keypoints(frame1)[matches[:, 1]], forward.xy1)
        assert counts[(frame0, frame1)] == len(matches) == len(forward)
        pairs += 1
    assert pairs == len(counts)


@given(fields=videos(), scale=st.sampled_from([2, 4]), follow=st.sampled_from(["nearest", "all"]))
@settings(deadline=None, max_examples=40)
def test_scaling_a_field_scales_its_tracks(fields, scale, follow):
    options = dataclasses.replace(PLAIN, epsilon=0.1, tau=0.0, cell=None, follow=follow)
    scaled = [
        field_from_rows(
            field.frame,
            list(zip(field.block * scale, field.mv * scale, field.ref_frame, strict=True)),
            decode_index=field.decode_index,
            width=WIDTH * scale,
            height=HEIGHT * scale,
        )
        for field in fields
    ]
    small, large = (build_tracks(video, options=options) for video in (fields, scaled))
    np.testing.assert_array_equal(small.offsets, large.offsets)
    np.testing.assert_array_equal(small.frame, large.frame)
    np.testing.assert_array_equal(small.xy * scale, large.xy)


@given(
    step=st.tuples(st.integers(-24, 24), st.integers(-24, 24)),
    num_frames=st.integers(3, 6),
    carry=st.sampled_from(["translate", "fuse"]),
)
@settings(deadline=None, max_examples=40)
def test_tracks_on_a_pure_translation_are_exact(step, num_frames, carry):
    vector = (step[0] / 8, step[1] / 8)
    size = {"width": WIDTH, "height": HEIGHT}
    fields = [field_from_rows(0, [], **size)]
    for frame in range(1, num_frames):
        rows = [(block, vector, frame - 1) for block in BLOCKS]
        fields.append(field_from_rows(frame, rows, **size))
    tracks = build_tracks(fields, options=TrackOptions(carry=carry))
    assert len(tracks) > 0
    first = tracks.offsets[:-1][tracks.track_index]
    distance = (tracks.frame - tracks.frame[first])[:, None]
    expected = tracks.xy[first] - distance * np.array(vector)
    np.testing.assert_allclose(tracks.xy, expected, atol=1e-3)


@given(fields=videos(reorder=False))
@settings(deadline=None, max_examples=40)
def test_a_cut_at_a_key_frame_splits_the_tracks_and_changes_none(fields):
    later = [
        field_from_rows(
            field.frame + len(fields),
            list(zip(field.block, field.mv, field.ref_frame + len(fields), strict=True)),
            width=WIDTH,
            height=HEIGHT,
        )
        for field in fields
    ]
    whole = build_tracks([*fields, *later], options=PLAIN)
    parts = [build_tracks(part, options=PLAIN) for part in (later, fields)]
    np.testing.assert_array_equal(whole.xy, np.concatenate([part.xy for part in parts]))
    np.testing.assert_array_equal(whole.frame, np.concatenate([part.frame for part in parts]))


@given(fields=videos())
@settings(deadline=None, max_examples=40)
def test_field_filters_only_remove(fields):
    for field in fields:
        rows = {(*b, *v, r) for b, v, r in columns(field)}
        for kept in (drop_zero(field), drop_uncertain(field)):
            assert {(*b, *v, r) for b, v, r in columns(kept)} <= rows
            assert kept.frame == field.frame


def columns(field: MotionField) -> zip[tuple[list[int], list[float], int]]:
    return zip(field.block.tolist(), field.mv.tolist(), field.ref_frame.tolist(), strict=True)


@given(fields=videos(), epsilon=st.floats(0, 1), cell=st.integers(1, 32))
@settings(deadline=None, max_examples=40)
def test_track_filters_only_remove_and_are_idempotent(fields, epsilon, cell):
    tracks = build_tracks(fields, options=PLAIN)
    for apply in (
        lambda tracks: cosine_consistency(tracks, epsilon=epsilon),
        lambda tracks: min_length(tracks, 4),
        lambda tracks: thin(tracks, cell=cell),
    ):
        kept = apply(tracks)
        assert observations(kept) <= observations(tracks)
        np.testing.assert_array_equal(apply(kept).xy, kept.xy)


@pytest.mark.parametrize("max_gap", [1, 2, 3])
@given(fields=videos())
@settings(deadline=None, max_examples=20)
def test_a_gap_limit_only_leaves_pairs_out(max_gap, fields):
    tracks = build_tracks(fields, options=PLAIN)
    everything = {(i, j): matches.tolist() for i, j, matches in tracks.pairs()}
    near = {(i, j): matches.tolist() for i, j, matches in tracks.pairs(max_gap)}
    assert near == {pair: m for pair, m in everything.items() if pair[1] - pair[0] <= max_gap}
