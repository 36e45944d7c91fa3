//! Feature `trace`: what a test compares with an oracle and no user needs.
//!
//! Without the feature every type here is empty and every method does nothing, so that the calls in
//! the decoder cost nothing.
#![cfg_attr(
    not(feature = "trace"),
    allow(
        dead_code,
        unused_imports,
        unused_mut,
        unused_variables,
        clippy::needless_pass_by_ref_mut,
        clippy::unused_self,
        reason = "without the feature the methods are empty"
    )
)]

use crate::frame::FrameStates;
use crate::motion::Frame;
use crate::refs::{ReferenceSlots, SlotState};
use crate::tile::TileOutput;

/// A transform block, in coding order (§5.11.35).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TransformBlock {
    /// 0 Y, 1 U, 2 V.
    pub plane: u8,
    /// Column in the plane, in units of 4 samples.
    pub x4: u32,
    /// Row in the plane, in units of 4 samples.
    pub y4: u32,
    /// `txSz`.
    pub tx_size: u8,
    /// `PlaneTxType`; `DCT_DCT` when `all_zero` is set.
    pub tx_type: u8,
    /// No coefficient was coded.
    pub all_zero: bool,
}

/// Values read by the symbol decoder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SymbolCounts {
    /// Symbols with more than two values.
    pub multi: u64,
    /// Symbols with two values and single bits, of literals as well.
    pub binary: u64,
}

/// Counts what a symbol decoder reads; goes with its copies.
#[derive(Clone, Copy, Default)]
pub(crate) struct SymbolCounter {
    #[cfg(feature = "trace")]
    counts: SymbolCounts,
}

impl SymbolCounter {
    /// A symbol of `num_values` values.
    #[inline]
    pub(crate) fn symbol(&mut self, num_values: usize) {
        #[cfg(feature = "trace")]
        if num_values > 2 {
            self.counts.multi += 1;
        } else {
            self.counts.binary += 1;
        }
    }
}

/// What one tile shows.
#[derive(Default)]
pub(crate) struct TileTrace {
    #[cfg(feature = "trace")]
    transform_blocks: Vec<TransformBlock>,
    #[cfg(feature = "trace")]
    counts: SymbolCounts,
}

impl TileTrace {
    /// A transform block was read; `tx_type` is absent when it is all zero.
    #[inline]
    pub(crate) fn transform_block(
        &mut self,
        plane: usize,
        (x4, y4): (u32, u32),
        tx_size: u8,
        tx_type: Option<u8>,
    ) {
        #[cfg(feature = "trace")]
        self.transform_blocks.push(TransformBlock {
            plane: plane as u8,
            x4,
            y4,
            tx_size,
            tx_type: tx_type.unwrap_or(crate::tables::symbols::DCT_DCT),
            all_zero: tx_type.is_none(),
        });
    }

    /// The tile ends.
    pub(crate) fn finish(mut self, counter: SymbolCounter) -> Self {
        #[cfg(feature = "trace")]
        {
            self.counts = counter.counts;
        }
        self
    }
}

/// What a slot held when a frame header arrived.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TracedSlot {
    /// `RefOrderHint`.
    pub order_hint: u32,
    /// Position in decode order.
    pub decode_index: u64,
}

/// What one frame shows; see [`Frame::trace`].
#[derive(Clone, Debug, Default)]
pub struct FrameTrace {
    /// The reference slots before the header was read; absent when never filled.
    pub slots: [Option<TracedSlot>; 8],
    /// OBUs that held the frame's tiles.
    pub num_tile_groups: u32,
    /// Transform blocks inside the frame, tile by tile.
    pub transform_blocks: Vec<TransformBlock>,
    /// Sums over the tiles of the last tile group, as libaom's accounting leaves them.
    pub symbols: SymbolCounts,
}

/// Kept by a frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct FrameTraceState {
    #[cfg(feature = "trace")]
    trace: FrameTrace,
    /// First tile of the last tile group.
    #[cfg(feature = "trace")]
    first_tile: usize,
}

impl FrameTraceState {
    /// A frame header arrives.
    pub(crate) fn begin(slots: &ReferenceSlots, states: &FrameStates) -> Self {
        let mut begun = Self::default();
        #[cfg(feature = "trace")]
        {
            begun.trace.slots = std::array::from_fn(|index| {
                let state = states[index].as_ref()?;
                (slots[index].state == SlotState::Filled).then_some(TracedSlot {
                    order_hint: slots[index].order_hint,
                    decode_index: state.decode_index,
                })
            });
        }
        begun
    }

    /// A tile group of the frame arrives, behind this many tiles.
    pub(crate) fn tile_group(&mut self, num_tiles: usize) {
        #[cfg(feature = "trace")]
        {
            self.trace.num_tile_groups += 1;
            self.first_tile = num_tiles;
        }
    }

    /// Every tile is read.
    pub(crate) fn finish(mut self, tiles: &[TileOutput]) -> Self {
        #[cfg(feature = "trace")]
        for (index, TileOutput { trace, .. }) in tiles.iter().enumerate() {
            self.trace
                .transform_blocks
                .extend_from_slice(&trace.transform_blocks);
            if index >= self.first_tile {
                self.trace.symbols.multi += trace.counts.multi;
                self.trace.symbols.binary += trace.counts.binary;
            }
        }
        self
    }
}

#[cfg(feature = "trace")]
impl Frame {
    /// What a test compares with an oracle.
    #[must_use]
    pub fn trace(&self) -> &FrameTrace {
        &self.trace.trace
    }
}
