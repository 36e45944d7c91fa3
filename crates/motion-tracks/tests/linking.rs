//! What tracks do on fields small enough to follow by hand.
#![allow(clippy::float_cmp, reason = "expected values are exact in binary")]

use motion_tracks::{
    Carry, Cosine, Field, Fill, FitOptions, Follow, LinkOptions, Linked, Linker, Tracks,
};

const PLAIN: LinkOptions = LinkOptions {
    keep_zero: true,
    error_model: None,
    max_error: None,
    max_drift: None,
    fit: FitOptions {
        neighbors: 12,
        min_neighbors: 4,
        rounds: 3,
        ridge: 0.02,
    },
    carry: Carry::Translate,
    follow: Follow::Nearest,
    cosine: None,
    cell: None,
    extend: false,
    min_length: 3,
    fill: None,
    window: None,
};

/// A row: block, vector, reference.
type Row = ([i32; 4], [f32; 2], i32);

fn link(options: LinkOptions, frames: &[(i32, &[Row])]) -> Tracks {
    pushed(options, frames).finish().tracks
}

fn pushed(options: LinkOptions, frames: &[(i32, &[Row])]) -> Linker {
    let mut linker = Linker::new(options);
    for (frame, rows) in frames {
        let blocks: Vec<_> = rows.iter().map(|row| row.0).collect();
        let vectors: Vec<_> = rows.iter().map(|row| row.1).collect();
        let references: Vec<_> = rows.iter().map(|row| row.2).collect();
        let field = Field {
            frame: *frame,
            width: 64,
            height: 32,
            blocks: &blocks,
            vectors: &vectors,
            references: &references,
            energies: &[],
        };
        linker.push(&field).unwrap();
    }
    linker
}

fn points(tracks: &Tracks, track: usize) -> Vec<(i32, f32, f32)> {
    let bound = |at: usize| usize::try_from(tracks.offsets[at]).unwrap();
    let range = bound(track)..bound(track + 1);
    range
        .map(|i| (tracks.frames[i], tracks.points[i][0], tracks.points[i][1]))
        .collect()
}

const WHOLE: [i32; 4] = [0, 0, 64, 32];

#[test]
fn a_point_is_carried_through_the_covering_block_and_never_snapped_to_its_centre() {
    let tracks = link(
        PLAIN,
        &[
            (0, &[]),
            (1, &[(WHOLE, [2.5, 0.0], 0)]),
            (2, &[([8, 8, 8, 8], [3.0, 1.0], 1)]),
        ],
    );
    assert_eq!(tracks.len(), 1);
    assert_eq!(
        points(&tracks, 0),
        [(0, 17.5, 13.0), (1, 15.0, 13.0), (2, 12.0, 12.0)]
    );
}

#[test]
fn a_zero_vector_is_motion_or_absence_as_the_option_says() {
    let still: [(i32, &[Row]); 3] = [
        (0, &[]),
        (1, &[(WHOLE, [0.0, 0.0], 0)]),
        (2, &[(WHOLE, [0.0, 0.0], 1)]),
    ];
    assert_eq!(link(PLAIN, &still).len(), 1);
    assert!(
        link(
            LinkOptions {
                keep_zero: false,
                ..PLAIN
            },
            &still
        )
        .is_empty()
    );
}

#[test]
fn the_cosine_test_ends_a_track_at_the_middle_frame() {
    let turning: [(i32, &[Row]); 4] = [
        (0, &[]),
        (1, &[(WHOLE, [-4.0, 0.0], 0)]),
        (2, &[([16, 8, 16, 16], [4.0, 0.0], 1)]),
        (3, &[([16, 8, 8, 8], [4.0, 0.0], 2)]),
    ];
    let cosine = Some(Cosine {
        epsilon: 0.1,
        tau: 1.0,
    });
    let tracks = link(LinkOptions { cosine, ..PLAIN }, &turning);
    assert_eq!(tracks.len(), 1);
    assert_eq!(tracks.frames, [1, 2, 3]);
    assert_eq!(points(&link(PLAIN, &turning), 0)[0], (0, 24.0, 12.0));
}

#[test]
fn a_cell_keeps_the_longest_track_and_seeds_only_where_it_is_free() {
    let merging: [(i32, &[Row]); 4] = [
        (0, &[]),
        (1, &[(WHOLE, [0.0, 0.0], 0)]),
        (
            2,
            &[([0, 0, 8, 8], [8.0, 0.0], 1), ([8, 0, 8, 8], [0.0, 0.0], 1)],
        ),
        (3, &[([0, 0, 8, 8], [8.0, 0.0], 2)]),
    ];
    let tracks = link(
        LinkOptions {
            cell: Some(8),
            min_length: 2,
            ..PLAIN
        },
        &merging,
    );
    // The track from frame 3 comes first in cell (1, 0) of frame 2 and stays to the end; the one
    // that starts at frame 2 in cell (0, 0) arrives in the same cell later and shorter.
    assert_eq!(
        points(&tracks, 0),
        [
            (0, 12.0, 4.0),
            (1, 12.0, 4.0),
            (2, 12.0, 4.0),
            (3, 4.0, 4.0)
        ]
    );
    assert!((1..tracks.len()).all(|track| points(&tracks, track).iter().all(|p| p.1 > 16.0)));
}

#[test]
fn every_structure_of_references_gives_tracks_with_rising_frames() {
    // Decode order 0 4 2 1 3: a pyramid with compound blocks.
    let pyramid: [(i32, &[Row]); 5] = [
        (0, &[]),
        (4, &[(WHOLE, [4.0, 0.0], 0)]),
        (2, &[(WHOLE, [2.0, 0.0], 0), (WHOLE, [-2.0, 0.0], 4)]),
        (1, &[(WHOLE, [1.0, 0.0], 0), (WHOLE, [-1.0, 0.0], 2)]),
        (3, &[(WHOLE, [1.0, 0.0], 2), (WHOLE, [-1.0, 0.0], 4)]),
    ];
    let tracks = link(
        LinkOptions {
            follow: Follow::All,
            ..PLAIN
        },
        &pyramid,
    );
    assert_eq!(points(&tracks, 0)[..2], [(0, 35.0, 16.0), (2, 33.0, 16.0)]);
    for track in 0..tracks.len() {
        let track = points(&tracks, track);
        assert!(track.windows(2).all(|pair| pair[0].0 < pair[1].0));
        // Every observation lies where the one true motion of 1 px per frame puts it.
        assert!(
            track
                .windows(2)
                .all(|pair| f64::from(pair[0].1 - pair[1].1) == f64::from(pair[1].0 - pair[0].0))
        );
    }
}

#[test]
fn an_overlay_hands_its_points_on_to_the_hidden_frame_it_repeats() {
    // Frame 2 is coded hidden first, then shown again by an overlay without vectors of its own.
    let frames: [(i32, &[Row]); 5] = [
        (0, &[]),
        (2, &[(WHOLE, [2.0, 0.0], 0)]),
        (1, &[(WHOLE, [1.0, 0.0], 0)]),
        (2, &[]),
        (3, &[(WHOLE, [1.0, 0.0], 2)]),
    ];
    let tracks = link(PLAIN, &frames);
    assert_eq!(tracks.len(), 1);
    assert_eq!(
        points(&tracks, 0),
        [(0, 35.0, 16.0), (2, 33.0, 16.0), (3, 32.0, 16.0)]
    );
}

#[test]
fn points_that_leave_the_picture_end_their_track() {
    let leaving: [(i32, &[Row]); 4] = [
        (0, &[]),
        (1, &[(WHOLE, [-20.0, 0.0], 0)]),
        (2, &[(WHOLE, [-20.0, 0.0], 1)]),
        (3, &[(WHOLE, [0.0, 1.0], 2)]),
    ];
    assert_eq!(link(PLAIN, &leaving).frames, [1, 2, 3]);
}

#[test]
fn tracks_reach_into_a_frame_that_refers_to_them_and_stop_at_taken_cells() {
    let frames: [(i32, &[Row]); 4] = [
        (0, &[]),
        (1, &[(WHOLE, [1.0, 0.0], 0)]),
        (
            2,
            &[
                ([16, 8, 8, 8], [2.0, 0.0], 1),
                ([24, 8, 8, 8], [2.0, 0.0], 1),
            ],
        ),
        (3, &[(WHOLE, [6.0, 0.0], 2)]),
    ];
    let extend = LinkOptions {
        extend: true,
        ..PLAIN
    };
    let tracks = link(extend, &frames);
    assert_eq!(points(&tracks, 0)[3], (3, 14.0, 12.0));
    assert_eq!(points(&tracks, 1)[3], (3, 22.0, 12.0));
    let one_per_cell = link(
        LinkOptions {
            cell: Some(16),
            ..extend
        },
        &frames,
    );
    assert_eq!(one_per_cell.len(), 1);
}

#[test]
fn a_track_reaches_through_a_leaf_of_the_pyramid_into_later_frames() {
    // Decode order 0 2 1 4 3: nothing refers to the odd frames, whose blocks are too many to
    // start in a taken cell.
    let pyramid: [(i32, &[Row]); 5] = [
        (0, &[]),
        (2, &[(WHOLE, [2.0, 0.0], 0)]),
        (1, &[(WHOLE, [1.0, 0.0], 0), (WHOLE, [-1.0, 0.0], 2)]),
        (4, &[(WHOLE, [2.0, 0.0], 2)]),
        (3, &[(WHOLE, [1.0, 0.0], 2), (WHOLE, [-1.0, 0.0], 4)]),
    ];
    let options = LinkOptions {
        cell: Some(64),
        follow: Follow::All,
        ..PLAIN
    };
    assert_eq!(link(options, &pyramid).frames, [0, 2, 3, 4]);
    let extended = link(
        LinkOptions {
            extend: true,
            ..options
        },
        &pyramid,
    );
    assert_eq!(extended.frames, [0, 1, 2, 3, 4]);
    assert_eq!(points(&extended, 0)[1], (1, 34.0, 16.0));
}

#[test]
fn filling_seeds_every_covered_cell_that_no_given_track_passes() {
    let half: [i32; 4] = [0, 0, 32, 32];
    let still: [(i32, &[Row]); 3] = [
        (0, &[]),
        (1, &[(half, [0.0, 0.0], 0)]),
        (2, &[(half, [0.0, 0.0], 1)]),
    ];
    let options = LinkOptions {
        fill: Some(Fill {
            side: 8,
            max_error: None,
            max_drift: None,
        }),
        ..PLAIN
    };
    let Linked { tracks, further } = pushed(options, &still).finish();
    // One track from the middle of the block, and the 4 x 4 cells of it less the one that it passes.
    assert_eq!((tracks.len(), further.len()), (1, 15));
    assert!(further.points.iter().all(|&[x, y]| x < 32.0 && y < 32.0));
    assert!(!further.points.contains(&[20.0, 20.0]));
    assert_eq!(tracks, link(PLAIN, &still));
}

/// Two frames of one 64x32 block among 8 px blocks, all with the vectors of `motion`.
fn large_block(carry: Carry, motion: impl Fn(f32) -> [f32; 2]) -> Tracks {
    let rows: Vec<Row> = (0_i16..8)
        .map(|column| {
            let x = 8.0 * f32::from(column) - 28.0;
            ([8 * i32::from(column), 32, 8, 8], motion(x), 0)
        })
        .chain([(WHOLE, motion(0.0), 0)])
        .collect();
    let options = LinkOptions {
        carry,
        cell: Some(8),
        min_length: 2,
        ..PLAIN
    };
    let mut linker = Linker::new(options);
    let blocks: Vec<_> = rows.iter().map(|row| row.0).collect();
    let vectors: Vec<_> = rows.iter().map(|row| row.1).collect();
    for (frame, count) in [(0, 0), (1, rows.len())] {
        let field = Field {
            frame,
            width: 64,
            height: 40,
            blocks: &blocks[..count],
            vectors: &vectors[..count],
            references: &[0; 9][..count],
            energies: &[],
        };
        linker.push(&field).unwrap();
    }
    linker.finish().tracks
}

#[test]
fn a_large_block_starts_a_track_every_two_cells_if_it_moves_as_one() {
    let in_large = |tracks: &Tracks| {
        let starts = (0..tracks.len()).map(|track| points(tracks, track)[1]);
        starts.filter(|point| point.2 < 32.0).count()
    };
    assert_eq!(in_large(&large_block(Carry::Fuse, |_| [1.0, 0.0])), 8);
    assert_eq!(in_large(&large_block(Carry::Fuse, |x| [0.02 * x, 0.0])), 1);
    assert_eq!(in_large(&large_block(Carry::Translate, |_| [1.0, 0.0])), 1);
}
