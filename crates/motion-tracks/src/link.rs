//! Chaining of motion fields into tracks, in reverse decode order.
//!
//! A reference always decodes before the frame that uses it. Going backwards, every point that can
//! reach a frame has therefore arrived when the frame's turn comes, whatever the prediction structure.

use std::collections::BTreeMap;

use crate::chain::{Cells, Chain, Occupied};
use crate::confidence::ErrorModel;
use crate::cover::Cover;
use crate::extend::Extension;
use crate::field::{Field, FieldError, center, half_sizes};
use crate::filter::{FitOptions, LocalFit, fit_neighbors};
use crate::motion::{Carry, Cosine, Follow, Motion, distance, length};
use crate::tracks::Tracks;

/// Rules of chaining.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkOptions {
    /// Whether vectors of length zero count; without them such blocks are as if intra coded.
    pub keep_zero: bool,
    /// How far off vectors are expected to be; without it they are all as good.
    pub error_model: Option<ErrorModel>,
    /// Vectors with a larger median error than this, px at rest, are not used. What moves faster may
    /// be off by more: near points move fast, and they carry the geometry.
    pub max_error: Option<f32>,
    /// Tracks end where their accumulated error exceeds this, px at rest: the errors of single steps
    /// are taken as independent.
    pub max_drift: Option<f32>,
    /// How neighbours are fitted, for `error_model` and `carry`.
    pub fit: FitOptions,
    /// What moves points off the block centre.
    pub carry: Carry,
    /// Which references of a compound block a point follows.
    pub follow: Follow,
    /// Direction test between successive steps.
    pub cosine: Option<Cosine>,
    /// Side in px of the square cells that hold at most one track per frame, the longest.
    pub cell: Option<u32>,
    /// Whether tracks reach on, in a second walk, into frames that refer to theirs.
    pub extend: bool,
    /// Shorter tracks, in observations, are dropped.
    pub min_length: u32,
}

/// The usable rows of one frame, compact: 20 bytes per row, 4 more with a filter and 16 more if points
/// are carried off-centre.
pub(crate) struct Layer {
    pub(crate) frame: i32,
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// `[x, y, w, h]`: a valid field has no coordinate beyond 16 bits.
    packed_blocks: Vec<[u16; 4]>,
    vectors: Vec<[f32; 2]>,
    pub(crate) references: Vec<i32>,
    /// Slopes of the motion; empty when points are translated.
    slopes: Vec<[f32; 4]>,
    /// Median errors, px at rest; empty without a model.
    errors: Vec<f32>,
}

impl Layer {
    /// Number of rows.
    pub(crate) fn len(&self) -> usize {
        self.packed_blocks.len()
    }

    /// Block of a row, px.
    pub(crate) fn block(&self, row: usize) -> [i32; 4] {
        self.packed_blocks[row].map(i32::from)
    }

    /// Squared error that following a row adds, px².
    pub(crate) fn variance(&self, row: usize) -> f32 {
        self.errors.get(row).map_or(0.0, |error| error * error)
    }

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
            self.options.error_model.is_some() || self.options.carry != Carry::Translate;
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
            packed_blocks: Vec::new(),
            vectors: Vec::new(),
            references: Vec::new(),
            slopes: Vec::new(),
            errors: Vec::new(),
        };
        for (row, &vector) in field.vectors.iter().enumerate() {
            let fit = fits.get(row);
            let error = match (&options.error_model, fit) {
                (Some(model), Some(fit)) => {
                    Some(model.median_error(fit, field.energy(row)) / tolerance(vector))
                }
                _ => None,
            };
            let agrees = options
                .max_error
                .is_none_or(|limit| error.is_none_or(|error| error <= limit));
            let counts = options.keep_zero || vector != [0.0, 0.0];
            if !agrees || !counts || field.references[row] == field.frame {
                continue;
            }
            let motion = Motion::new(options.carry, vector, fit);
            let packed = field.blocks[row].map(|side| u16::try_from(side).expect("validated"));
            layer.packed_blocks.push(packed);
            layer.vectors.push(motion.vector);
            layer.references.push(field.references[row]);
            if options.carry != Carry::Translate {
                layer.slopes.push(motion.linear);
            }
            layer.errors.extend(error);
        }
        layer
    }

    /// Chains everything pushed so far; tracks start at block centres.
    #[must_use]
    pub fn finish(&self) -> Tracks {
        // Points that are translated know no slope: nothing tells which blocks move as one.
        let spacing = match self.options.carry {
            Carry::Translate => None,
            Carry::Fuse => self.options.cell.map(|side| side.saturating_mul(2).max(1)),
        };
        self.chain(self.options, Occupied::new(), |layer, cover| {
            seeds(layer, cover, spacing)
        })
    }

    /// Further tracks in the cells, `cell` px wide, that given tracks leave free in each frame. They
    /// start at the middle of every free cell that a usable block covers.
    #[must_use]
    pub fn fill(&self, tracks: &Tracks, cell: u32) -> Tracks {
        let mut occupied = Occupied::new();
        for (&frame, &xy) in tracks.frames.iter().zip(&tracks.points) {
            occupied.entry(frame).or_default().push(xy);
        }
        let cell = cell.max(1);
        let options = LinkOptions {
            cell: Some(cell),
            ..self.options
        };
        self.chain(options, occupied, |layer, cover| {
            Cells::middles(cell, layer.width, layer.height)
                .filter(|&xy| cover.rows_at(xy).next().is_some())
                .collect()
        })
    }

    fn chain(
        &self,
        options: LinkOptions,
        occupied: Occupied,
        seeds: impl Fn(&Layer, &Cover) -> Vec<[f32; 2]>,
    ) -> Tracks {
        let mut chain = Chain::new(options, occupied);
        let mut codings: BTreeMap<i32, u32> = BTreeMap::new();
        for layer in &self.layers {
            *codings.entry(layer.frame).or_default() += 1;
        }
        for layer in self.layers.iter().rev() {
            // A hidden frame and the overlay that is shown for it carry one display index.
            let again = codings.get_mut(&layer.frame).is_some_and(|left| {
                *left -= 1;
                *left > 0
            });
            let blocks: Vec<[i32; 4]> = (0..layer.len()).map(|row| layer.block(row)).collect();
            let cover = Cover::new(layer.width, layer.height, &blocks);
            chain.visit(layer, &cover, &seeds(layer, &cover), again);
        }
        let (width, height) = self.layers.iter().fold((1, 1), |size, layer| {
            (size.0.max(layer.width), size.1.max(layer.height))
        });
        chain.settle_rest(width, height);
        if !options.extend {
            return chain.finish();
        }
        let mut extension = Extension::new(chain);
        for layer in &self.layers {
            extension.visit(layer);
        }
        extension.into_chain().finish()
    }
}

/// Where tracks may start, in the most accurate blocks first: at the centre of each, and in blocks
/// that move as one also at points `spacing` px apart.
fn seeds(layer: &Layer, cover: &Cover, spacing: Option<u32>) -> Vec<[f32; 2]> {
    let mut rows: Vec<usize> = (0..layer.len())
        .filter(|&row| cover.is_first(&layer.block(row), row))
        .collect();
    if !layer.errors.is_empty() {
        rows.sort_by(|&a, &b| layer.errors[a].total_cmp(&layer.errors[b]));
    }
    let mut points = Vec::with_capacity(rows.len());
    for row in rows {
        let block = layer.block(row);
        match spacing {
            Some(spacing) if moves_as_one(&layer.motion(row), block) => {
                points.extend(lattice(block, spacing));
            }
            _ => points.push(center(block)),
        }
    }
    points
}

/// Difference of the motion at a block's corner from that at its centre below which the block moves
/// as one, px: a quarter of the finest step of a vector. Elsewhere points off the centre lean.
const SAME_MOTION: f32 = 1.0 / 32.0;

fn moves_as_one(motion: &Motion, block: [i32; 4]) -> bool {
    let [x, y] = half_sizes(block);
    [[x, y], [x, -y]]
        .iter()
        .all(|&corner| distance(motion.at(corner), motion.vector) < SAME_MOTION)
}

/// Points of a block about `spacing` px apart, evenly and around the centre.
#[expect(clippy::cast_precision_loss, reason = "sides are below 2^16 px")]
fn lattice([x, y, w, h]: [i32; 4], spacing: u32) -> impl Iterator<Item = [f32; 2]> {
    let count = |side: i32| (side.unsigned_abs() / spacing).max(1);
    let at = |start: i32, side: i32, index: u32, count: u32| {
        start as f32 + side as f32 * (index as f32 + 0.5) / count as f32
    };
    let (columns, lines) = (count(w), count(h));
    (0..lines).flat_map(move |line| {
        (0..columns).map(move |column| [at(x, w, column, columns), at(y, h, line, lines)])
    })
}

/// Motion that doubles the error a vector may have, px.
const DOUBLING_MOTION: f32 = 20.0;

/// How many times as far off as a vector at rest this one may be.
fn tolerance(vector: [f32; 2]) -> f32 {
    1.0 + length(vector) / DOUBLING_MOTION
}
