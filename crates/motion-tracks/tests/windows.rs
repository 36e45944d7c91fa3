//! Clips longer than a window: what is chained piece by piece.

use std::collections::HashSet;

use motion_tracks::{Carry, Field, Fill, FitOptions, Follow, LinkOptions, Linked, Linker, Tracks};

const CELL: u32 = 8;

const THINNED: LinkOptions = LinkOptions {
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
    carry: Carry::Fuse,
    follow: Follow::All,
    cosine: None,
    cell: Some(CELL),
    extend: true,
    min_length: 3,
    fill: Some(Fill {
        side: 4,
        max_error: Some(0.5),
        max_drift: Some(1.0),
    }),
    window: None,
};

/// One coded frame.
#[derive(Default)]
struct Coded {
    frame: i32,
    blocks: Vec<[i32; 4]>,
    vectors: Vec<[f32; 2]>,
    references: Vec<i32>,
}

fn push(linker: &mut Linker, coded: &Coded) {
    let field = Field {
        frame: coded.frame,
        width: 64,
        height: 32,
        blocks: &coded.blocks,
        vectors: &coded.vectors,
        references: &coded.references,
        energies: &[],
    };
    linker.push(&field).unwrap();
}

fn link(options: LinkOptions, clip: &[Coded]) -> Linked {
    let mut linker = Linker::new(options);
    for coded in clip {
        push(&mut linker, coded);
    }
    linker.finish()
}

fn in_windows(window: u32) -> LinkOptions {
    LinkOptions {
        window: Some(window),
        ..THINNED
    }
}

/// Blocks of 8 px with the vectors that `motion` gives, to one reference.
fn coded(frame: i32, reference: i32, mut motion: impl FnMut() -> Option<[f32; 2]>) -> Coded {
    let mut coded = Coded {
        frame,
        ..Coded::default()
    };
    for block in 0..32 {
        if let Some(vector) = motion() {
            coded.blocks.push([8 * (block % 8), 8 * (block / 8), 8, 8]);
            coded.vectors.push(vector);
            coded.references.push(reference);
        }
    }
    coded
}

/// Still pictures, each predicted from the one before.
fn still(num_frames: i32) -> Vec<Coded> {
    (0..num_frames)
        .map(|frame| coded(frame, frame - 1, || (frame > 0).then_some([0.0, 0.0])))
        .collect()
}

/// Motion all over the place, in a pyramid: every fourth picture is coded first, hidden, and again
/// when its turn comes.
fn restless(num_groups: i32) -> Vec<Coded> {
    let mut state = 1_u32;
    let mut random = move |count: u8| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8 % count
    };
    let mut clip = vec![Coded::default()];
    for group in 0..num_groups {
        let (first, last) = (4 * group, 4 * group + 4);
        let order = [
            (last, first),
            (first + 2, last),
            (first + 1, first),
            (first + 3, first + 2),
            (last, first + 3),
        ];
        for (frame, reference) in order {
            let motion = || {
                let vector = [0, 1].map(|_| f32::from(random(17)) / 8.0 - 1.0);
                (random(8) > 0).then_some(vector)
            };
            clip.push(coded(frame, reference, motion));
        }
    }
    clip
}

fn lengths(tracks: &Tracks) -> Vec<i64> {
    let ends = tracks.offsets.windows(2);
    ends.map(|bounds| bounds[1] - bounds[0]).collect()
}

fn frames_rise(tracks: &Tracks) -> bool {
    tracks.offsets.windows(2).all(|bounds| {
        let [start, end] = [bounds[0], bounds[1]].map(|end| usize::try_from(end).unwrap());
        tracks.frames[start..end].is_sorted_by(|a, b| a < b)
    })
}

fn no_cell_holds_two(tracks: &Tracks, side: f32) -> bool {
    let mut taken = HashSet::new();
    let mut seen = tracks.frames.iter().zip(&tracks.points);
    seen.all(|(&frame, xy)| taken.insert((frame, xy.map(|at| (at / side).floor().to_bits()))))
}

#[test]
fn a_window_that_holds_the_clip_changes_nothing() {
    let clip = restless(30);
    let whole = link(THINNED, &clip);
    assert!(whole.tracks.len() > 100 && whole.further.len() > 100);
    let exactly = u32::try_from(clip.len()).unwrap();
    for window in [exactly, exactly + 1, 1000] {
        assert!(whole == link(in_windows(window), &clip), "window {window}");
    }
}

#[test]
fn tracks_go_on_from_window_to_window() {
    for window in [1, 7, 50] {
        for extend in [true, false] {
            let options = LinkOptions {
                extend,
                ..in_windows(window)
            };
            let tracks = link(options, &still(200)).tracks;
            assert_eq!(lengths(&tracks), [200; 32]);
        }
    }
}

#[test]
fn frames_rise_and_no_cell_holds_two_tracks_whatever_the_window() {
    let clip = restless(60);
    let whole = link(THINNED, &clip).tracks.frames.len();
    for window in [1, 3, 10, 64, 100] {
        let Linked { tracks, further } = link(in_windows(window), &clip);
        assert!(frames_rise(&tracks) && frames_rise(&further));
        assert!(no_cell_holds_two(&tracks, 8.0) && no_cell_holds_two(&further, 4.0));
        assert!(lengths(&tracks).iter().all(|&length| length >= 3));
        let seen = tracks.frames.len();
        assert!(
            10 * seen > 9 * whole,
            "{seen} of {whole} observations in windows of {window}"
        );
    }
}

#[test]
fn filling_leaves_the_other_tracks_as_they_are() {
    let clip = restless(60);
    let options = in_windows(10);
    let unfilled = link(
        LinkOptions {
            fill: None,
            ..options
        },
        &clip,
    );
    assert!(unfilled.tracks == link(options, &clip).tracks);
    assert!(unfilled.further.is_empty());
}

#[test]
fn tracks_that_ended_can_be_taken_before_the_clip_ends() {
    let clip = restless(60);
    let mut linker = Linker::new(in_windows(10));
    let mut taken = Vec::new();
    for coded in &clip {
        push(&mut linker, coded);
        taken.push(linker.take().tracks);
    }
    let batches = taken.iter().filter(|tracks| !tracks.is_empty()).count();
    assert!(batches > 10);
    taken.push(linker.finish().tracks);
    let frames: Vec<i32> = taken.into_iter().flat_map(|tracks| tracks.frames).collect();
    assert_eq!(frames, link(in_windows(10), &clip).tracks.frames);
}

#[test]
fn a_frame_far_behind_is_left_out() {
    let mut clip = still(100);
    let without = link(in_windows(10), &clip);
    clip.insert(80, coded(3, 2, || Some([1.0, 0.0])));
    assert_eq!(link(in_windows(10), &clip), without);
}

#[test]
fn a_picture_coded_over_and_over_does_not_pile_up() {
    let mut clip = still(2);
    clip.extend((0..2_000).map(|_| coded(1, 0, || Some([0.0, 0.0]))));
    let options = LinkOptions {
        min_length: 2,
        ..in_windows(10)
    };
    assert_eq!(lengths(&link(options, &clip).tracks), [2; 32]);
}
