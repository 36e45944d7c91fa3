//! Motion fields in, tracks out: what is kept of a field, and until when.

use crate::chain::Chain;
use crate::confidence::ErrorModel;
use crate::field::{Field, FieldError};
use crate::filter::{FitOptions, LocalFit, fit_neighbors};
use crate::motion::{Carry, Cosine, Follow, Motion, length};
use crate::seeds::Seeds;
use crate::tracks::Tracks;
use crate::window::{REACH, chain_window};

/// Rules of chaining.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkOptions {
    /// Whether vectors of length zero count; without them such blocks are as if intra coded.
    pub keep_zero: bool,
    /// How far off vectors are expected to be; asked where a bound is set.
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
    /// Further tracks; none without.
    pub fill: Option<Fill>,
    /// Coded frames that are chained at once: tracks of longer clips go on from window to window.
    /// Without, all frames are held until the end.
    pub window: Option<u32>,
}

impl LinkOptions {
    fn needs_fit(&self) -> bool {
        self.error_model.is_some() || self.carry != Carry::Translate
    }
}

/// Rules of further tracks where they differ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fill {
    /// Side in px of the square cells in whose middle they start, where the other tracks leave the
    /// cell free and a usable block covers it.
    pub side: u32,
    /// As [`LinkOptions::max_error`].
    pub max_error: Option<f32>,
    /// As [`LinkOptions::max_drift`].
    pub max_drift: Option<f32>,
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
    pub(crate) errors: Vec<f32>,
}

impl Layer {
    /// What may be followed of a field.
    fn select(field: &Field<'_>, fits: &[LocalFit], options: &LinkOptions) -> Self {
        let mut layer = Self {
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

/// Tracks that will not grow any more.
#[derive(Clone, Debug, PartialEq)]
pub struct Linked {
    /// What is matched and mapped, the same for any `fill`.
    pub tracks: Tracks,
    /// Those of `fill`.
    pub further: Tracks,
}

/// Tracks of one kind: their rules, what they may follow, and how far they have come.
struct Walk {
    options: LinkOptions,
    seeds: Seeds,
    /// Frames that new points may still reach: those of the window, behind some that are chained.
    layers: Vec<Layer>,
    chain: Chain,
}

impl Walk {
    fn new(mut options: LinkOptions, seeds: Seeds) -> Self {
        if options.max_error.or(options.max_drift).is_none() {
            options.error_model = None;
        }
        Self {
            options,
            seeds,
            layers: Vec::new(),
            chain: Chain::new(options),
        }
    }

    fn chain(&mut self, num_chained: usize) {
        chain_window(&mut self.chain, &self.layers, num_chained, self.seeds);
    }

    /// Lets go of everything that later windows cannot reach, and returns the tracks that ended.
    fn close(&mut self, floor: i32, most: usize) -> Tracks {
        self.layers.retain(|layer| layer.frame >= floor);
        self.layers.drain(..self.layers.len().saturating_sub(most));
        self.chain.close(floor)
    }
}

/// Collects motion fields in decode order and turns them into tracks.
///
/// Keeps the compact rows of one window of frames and the tracks that reach its end: the walk over a
/// window starts at its end.
pub struct Linker {
    own: Walk,
    /// Those of `fill`.
    further: Option<Walk>,
    /// How many of the layers are chained.
    num_chained: usize,
    finished: Linked,
}

impl Linker {
    /// An empty linker.
    #[must_use]
    pub fn new(options: LinkOptions) -> Self {
        let further = options.fill.map(|fill| {
            let side = fill.side.max(1);
            let rules = LinkOptions {
                cell: Some(side),
                max_error: fill.max_error,
                max_drift: fill.max_drift,
                ..options
            };
            Walk::new(rules, Seeds::Cells { side })
        });
        Self {
            own: Walk::new(options, Seeds::in_blocks(&options)),
            further,
            num_chained: 0,
            finished: Linked::none(),
        }
    }

    /// Adds the next frame in decode order, filtered; frames without vectors belong here as well.
    ///
    /// A frame whose display index lies so far behind that its window is closed is left out.
    ///
    /// # Errors
    /// If the field is not valid; nothing is added then.
    pub fn push(&mut self, field: &Field<'_>) -> Result<(), FieldError> {
        field.validate()?;
        let options = self.own.options;
        let num_fresh = self.own.layers.len() - self.num_chained;
        if let Some(window) = options.window
            && num_fresh >= window.max(1) as usize
        {
            self.chain();
            self.close(window);
        }
        if self.own.chain.is_closed(field.frame) {
            return Ok(());
        }
        let mut walks: Vec<&mut Walk> = [Some(&mut self.own), self.further.as_mut()]
            .into_iter()
            .flatten()
            .collect();
        let fits = if walks.iter().any(|walk| walk.options.needs_fit()) {
            fit_neighbors(field, &options.fit)
        } else {
            Vec::new()
        };
        for walk in &mut walks {
            walk.layers.push(Layer::select(field, &fits, &walk.options));
        }
        Ok(())
    }

    /// Takes the tracks that have ended since the last time; there are some after each window.
    pub fn take(&mut self) -> Linked {
        std::mem::replace(&mut self.finished, Linked::none())
    }

    /// Chains the rest and returns all tracks that were not taken.
    #[must_use]
    pub fn finish(mut self) -> Linked {
        self.chain();
        let mut finished = self.finished;
        finished.tracks.append(&self.own.chain.finish());
        if let Some(further) = self.further {
            finished.further.append(&further.chain.finish());
        }
        finished
    }

    /// Chains the layers that are not yet.
    fn chain(&mut self) {
        if self.num_chained == self.own.layers.len() {
            return;
        }
        self.own.chain(self.num_chained);
        if let Some(further) = &mut self.further {
            self.own.chain.occupy(&mut further.chain);
            further.chain(self.num_chained);
        }
    }

    /// Lets go of everything that cannot be reached from later windows.
    fn close(&mut self, window: u32) {
        let newest = self.own.layers.iter().map(|layer| layer.frame).max();
        let floor = newest.unwrap_or_default().saturating_sub(REACH);
        // Streams that code one picture over and over must not pile up.
        let most = window.max(2 * REACH.unsigned_abs()) as usize;
        self.finished.tracks.append(&self.own.close(floor, most));
        if let Some(further) = &mut self.further {
            self.finished.further.append(&further.close(floor, most));
        }
        self.num_chained = self.own.layers.len();
    }
}

impl Linked {
    fn none() -> Self {
        Self {
            tracks: Tracks::empty(),
            further: Tracks::empty(),
        }
    }
}

/// Motion that doubles the error a vector may have, px.
const DOUBLING_MOTION: f32 = 20.0;

/// How many times as far off as a vector at rest this one may be.
fn tolerance(vector: [f32; 2]) -> f32 {
    1.0 + length(vector) / DOUBLING_MOTION
}
