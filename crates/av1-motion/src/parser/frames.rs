//! §7.4, §7.20, §7.21: the life of a frame between its header and the reference slots.

use std::sync::Arc;

use super::Parser;
use crate::entropy::cdf::ResetCounters;
use crate::entropy::cdf_set::CdfSet;
use crate::error::{Error, Result};
use crate::frame::{ContextError, FrameContent, FrameState, FrameStates};
use crate::memory;
use crate::motion::{Frame, Reference};
use crate::obu::frame_header::FrameHeader;
use crate::obu::header::{Obu, ObuHeader};
use crate::obu::sequence_header::SequenceHeader;
use crate::tile::{Block, CoefficientStats, FrameContext, TileOutput};

/// A frame whose header could be read, but not its tiles.
pub(super) struct LostFrame {
    pub(super) sequence: Arc<SequenceHeader>,
    pub(super) header: Arc<FrameHeader>,
    pub(super) display_index: i64,
}

/// A frame between its header and its last tile.
pub(super) struct CurrentFrame {
    pub(super) obu: ObuHeader,
    pub(super) context: FrameContext,
    pub(super) references: [Option<Reference>; 7],
    pub(super) display_index: i64,
    /// Probabilities that every tile starts from.
    pub(super) cdfs: Arc<CdfSet>,
    /// Those of the tile `context_update_tile_id` at its end.
    pub(super) saved_cdfs: Option<Box<CdfSet>>,
    pub(super) tiles: Vec<TileOutput>,
}

/// The blocks of a frame with their local models, and its coefficient statistics.
pub(super) struct FrameBlocks {
    blocks: Vec<Block>,
    warps: Vec<[i32; 6]>,
    stats: [CoefficientStats; 3],
}

impl CurrentFrame {
    /// §7.20: what the tiles leave in a reference slot.
    pub(super) fn content(&mut self) -> Result<FrameContent> {
        let cdfs = match self.saved_cdfs.take() {
            Some(mut cdfs) => {
                cdfs.reset_counters();
                Arc::from(cdfs)
            }
            None => self.cdfs.clone(),
        };
        Ok(FrameContent {
            cdfs,
            segment_ids: self.context.segment_map(&self.tiles)?,
            motion: self.context.saved_motion(&self.tiles)?,
        })
    }

    /// Takes the blocks out of the tiles.
    pub(super) fn join_tiles(&mut self) -> Result<FrameBlocks> {
        let (mut blocks, mut warps) = (Vec::new(), Vec::new());
        let mut stats = [CoefficientStats::default(); 3];
        if let [tile] = &mut self.tiles[..] {
            blocks = std::mem::take(&mut tile.blocks);
            warps = std::mem::take(&mut tile.warps);
        }
        memory::reserve(&mut blocks, self.tiles.iter().map(|t| t.blocks.len()).sum())?;
        memory::reserve(&mut warps, self.tiles.iter().map(|t| t.warps.len()).sum())?;
        for tile in &mut self.tiles {
            for block in &mut tile.blocks {
                block.offset_warp(warps.len() as u32);
            }
            warps.append(&mut tile.warps);
            blocks.append(&mut tile.blocks);
            for (sum, counts) in stats.iter_mut().zip(tile.stats) {
                *sum = sum.plus(&counts);
            }
        }
        Ok(FrameBlocks {
            blocks,
            warps,
            stats,
        })
    }
}

impl Parser {
    /// Sets up everything that the tiles of a frame depend on.
    pub(super) fn start_frame(
        &self,
        obu: &Obu,
        sequence: &Arc<SequenceHeader>,
        header: &Arc<FrameHeader>,
        display_index: i64,
    ) -> Result<CurrentFrame> {
        let missing = |reason: &'static str, section: &'static str| Error::MissingReference {
            reason: reason.into(),
            section,
            byte_offset: obu.byte_offset,
        };
        let primary = match header.primary_slot() {
            None => None,
            Some(slot) => {
                let content = self.states[slot]
                    .as_ref()
                    .and_then(|state| state.content.as_ref());
                Some(content.ok_or_else(|| missing("the primary reference was lost", "6.8.2"))?)
            }
        };
        let cdfs = primary.map_or_else(
            || Arc::new(CdfSet::defaults(header.quantization.base_q_idx)),
            |content| content.cdfs.clone(),
        );
        let mut context = FrameContext::new(sequence, header, &self.slots, &self.states, primary)
            .map_err(|error| match error {
            ContextError::LostMotion => missing("vectors of a lost frame are needed", "7.9.2"),
            ContextError::OutOfMemory(error) => error.into(),
        })?;
        context.interrupt = self.interrupt.clone();
        let references = if header.frame_is_intra {
            [None; 7]
        } else {
            header.ref_frame_idx.map(|slot| {
                self.states[usize::from(slot)]
                    .as_ref()
                    .map(|state| Reference {
                        decode_index: state.decode_index,
                        display_index: state.display_index,
                    })
            })
        };
        Ok(CurrentFrame {
            obu: obu.header,
            context,
            references,
            display_index,
            cdfs,
            saved_cdfs: None,
            tiles: Vec::new(),
        })
    }

    /// §7.4 `decode_frame_wrapup` of a decoded frame.
    pub(super) fn finish_frame(
        &mut self,
        current: CurrentFrame,
        content: FrameContent,
        joined: FrameBlocks,
    ) -> Frame {
        let CurrentFrame { context, .. } = current;
        let header = context.header.clone();
        let state = Arc::new(FrameState {
            decode_index: self.num_decoded,
            display_index: current.display_index,
            content: Some(content),
        });
        self.refresh(&header, &context.sequence, &state);
        self.num_decoded += 1;
        let trace = std::mem::take(&mut self.trace).finish(&current.tiles);
        let is_output = header.show_frame && self.outputs_layer(current.obu.spatial_id);
        Frame {
            decode_index: state.decode_index,
            display_index: state.display_index,
            unit_index: self.num_units - 1,
            temporal_id: current.obu.temporal_id,
            spatial_id: current.obu.spatial_id,
            is_output,
            references: current.references,
            is_scaled: context.is_scaled,
            ref_size: context.ref_size,
            trace,
            header,
            sequence: context.sequence,
            blocks: joined.blocks,
            warps: joined.warps,
            stats: joined.stats,
        }
    }

    /// §7.4, §7.21: shows a frame of a slot; a key frame is loaded and refreshes every slot.
    pub(super) fn show_existing_frame(
        &mut self,
        obu: &Obu,
        sequence: Arc<SequenceHeader>,
        header: Arc<FrameHeader>,
    ) -> Result<Frame> {
        let slot = usize::from(header.frame_to_show_map_idx);
        let Some(state) = self.states[slot].clone() else {
            return Err(Error::MissingReference {
                reason: "the frame to show was lost".into(),
                section: "6.8.2",
                byte_offset: obu.byte_offset,
            });
        };
        self.display.show(header.order_hint, state.display_index);
        self.refresh(&header, &sequence, &state);
        Ok(Frame {
            decode_index: state.decode_index,
            display_index: state.display_index,
            unit_index: self.num_units - 1,
            temporal_id: obu.header.temporal_id,
            spatial_id: obu.header.spatial_id,
            is_output: self.outputs_layer(obu.header.spatial_id),
            references: [None; 7],
            header,
            sequence,
            blocks: Vec::new(),
            warps: Vec::new(),
            stats: [CoefficientStats::default(); 3],
            is_scaled: [false; 8],
            ref_size: [[0; 2]; 8],
            trace: std::mem::take(&mut self.trace),
        })
    }

    /// §7.20 Reference frame update process.
    fn refresh(
        &mut self,
        header: &FrameHeader,
        sequence: &SequenceHeader,
        state: &Arc<FrameState>,
    ) {
        self.slots.update(header, sequence);
        for (index, held) in self.states.iter_mut().enumerate() {
            if header.refresh_frame_flags >> index & 1 == 1 {
                *held = Some(state.clone());
            }
        }
    }

    /// After an error: keeps what is known of the frame that was lost. Without a whole header nothing
    /// is known of what it replaced, so that every slot has to be given up.
    pub(super) fn lose(&mut self) {
        self.skips_tiles = true;
        let current = self.current.take().map(|current| LostFrame {
            sequence: current.context.sequence,
            header: current.context.header,
            display_index: current.display_index,
        });
        let Some(frame) = self.lost.take().or(current) else {
            self.slots.clear(u8::MAX);
            self.states = FrameStates::default();
            return;
        };
        let state = Arc::new(FrameState {
            decode_index: self.num_decoded,
            display_index: frame.display_index,
            content: None,
        });
        self.refresh(&frame.header, &frame.sequence, &state);
        self.num_decoded += 1;
    }
}
