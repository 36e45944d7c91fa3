//! Chaining of motion fields into tracks, in reverse decode order.
//!
//! A reference always decodes before the frame that uses it. Going backwards, every point that can
//! reach a frame has therefore arrived when the frame's turn comes, whatever the prediction structure.

use crate::chain::Chain;
use crate::cover::Cover;
use crate::field::{Field, FieldError, center};
use crate::filter::{FitOptions, LocalFit, fit_neighbors};
use crate::motion::{Carry, Cosine, Follow, Motion};
use crate::tracks::Tracks;

/// Rules of chaining.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkOptions {
    /// Whether vectors of length zero count; without them such blocks are as if intra coded.
    pub keep_zero: bool,
    /// Vectors that disagree with their neighbours by more than this, in px, are not used.
    pub max_residual: Option<f32>,
    /// How neighbours are fitted, for `max_residual` and `carry`.
    pub fit: FitOptions,
    /// What moves points off the block centre.
    pub carry: Carry,
    /// Which references of a compound block a point follows.
    pub follow: Follow,
    /// Direction test between successive steps.
    pub cosine: Option<Cosine>,
    /// Side in px of the square cells that hold at most one track per frame, the longest.
    pub cell: Option<u32>,
    /// Shorter tracks, in observations, are dropped.
    pub min_length: u32,
}

/// The usable rows of one frame, compact: 20 bytes per row, 36 if points are carried off-centre.
pub(crate) struct Layer {
    pub(crate) frame: i32,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) blocks: Vec<[i32; 4]>,
    pub(crate) vectors: Vec<[f32; 2]>,
    pub(crate) references: Vec<i32>,
    /// Slopes of the motion; empty when points are translated.
    slopes: Vec<[f32; 4]>,
    /// Disagreement with the neighbours, px; empty when nothing was fitted.
    residuals: Vec<f32>,
}

impl Layer {
    pub(crate) fn motion(&self, row: usize) -> Motion {
        let linear = self.slopes.get(row).copied().unwrap_or_default();
        Motion {
            vector: self.vectors[row],
            linear,
        }
    }
}

/// Collects motion fields in decode order and turns them into tracks.
///
/// Keeps the compact rows of every frame until [`Linker::finish`]: the chain starts at the end.
pub struct Linker {
    options: LinkOptions,
    layers: Vec<Layer>,
}

impl Linker {
    /// An empty linker.
    #[must_use]
    pub fn new(options: LinkOptions) -> Self {
        Self {
            options,
            layers: Vec::new(),
        }
    }

    /// Adds the next frame in decode order, filtered; frames without vectors belong here as well.
    ///
    /// # Errors
    /// If the field is not valid; nothing is added then.
    pub fn push(&mut self, field: &Field<'_>) -> Result<(), FieldError> {
        field.validate()?;
        let needs_fit =
            self.options.max_residual.is_some() || self.options.carry != Carry::Translate;
        let fits = if needs_fit {
            fit_neighbors(field, &self.options.fit)
        } else {
            Vec::new()
        };
        self.layers.push(self.select(field, &fits));
        Ok(())
    }

    fn select(&self, field: &Field<'_>, fits: &[LocalFit]) -> Layer {
        let options = &self.options;
        let mut layer = Layer {
            frame: field.frame,
            width: field.width,
            height: field.height,
            blocks: Vec::new(),
            vectors: Vec::new(),
            references: Vec::new(),
            slopes: Vec::new(),
            residuals: Vec::new(),
        };
        for (row, &vector) in field.vectors.iter().enumerate() {
            let fit = fits.get(row);
            let agrees = options
                .max_residual
                .is_none_or(|limit| fit.is_some_and(|fit| fit.residual <= limit));
            let counts = options.keep_zero || vector != [0.0, 0.0];
            if !agrees || !counts || field.references[row] == field.frame {
                continue;
            }
            let motion = Motion::new(options.carry, vector, fit, field.warps.get(row));
            layer.blocks.push(field.blocks[row]);
            layer.vectors.push(motion.vector);
            layer.references.push(field.references[row]);
            if options.carry != Carry::Translate {
                layer.slopes.push(motion.linear);
            }
            layer.residuals.extend(fit.map(|fit| fit.residual));
        }
        layer
    }

    /// Chains everything pushed so far.
    #[must_use]
    pub fn finish(self) -> Tracks {
        let mut chain = Chain::new(self.options);
        for (index, layer) in self.layers.iter().enumerate().rev() {
            // A hidden frame and the overlay that is shown for it carry one display index.
            let again = self.layers[..index]
                .iter()
                .any(|earlier| earlier.frame == layer.frame);
            let cover = Cover::new(layer.width, layer.height, &layer.blocks);
            chain.visit(layer, &cover, &seeds(layer, &cover), again);
        }
        let (width, height) = self.layers.iter().fold((1, 1), |size, layer| {
            (size.0.max(layer.width), size.1.max(layer.height))
        });
        chain.finish(width, height)
    }
}

/// Block centres inside the picture that may start a track, the best confirmed first.
fn seeds(layer: &Layer, cover: &Cover) -> Vec<[f32; 2]> {
    let mut rows: Vec<usize> = (0..layer.blocks.len())
        .filter(|&row| cover.is_first(&layer.blocks[row], row))
        .collect();
    if !layer.residuals.is_empty() {
        rows.sort_by(|&a, &b| layer.residuals[a].total_cmp(&layer.residuals[b]));
    }
    rows.iter().map(|&row| center(layer.blocks[row])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: LinkOptions = LinkOptions {
        keep_zero: true,
        max_residual: None,
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
        min_length: 3,
    };

    /// A row: block, vector, reference.
    type Row = ([i32; 4], [f32; 2], i32);

    fn link(options: LinkOptions, frames: &[(i32, &[Row])]) -> Tracks {
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
                warps: &[],
            };
            linker.push(&field).unwrap();
        }
        linker.finish()
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
                track.windows(2).all(
                    |pair| f64::from(pair[0].1 - pair[1].1) == f64::from(pair[1].0 - pair[0].0)
                )
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
}
