//! §7.4: from the headers of a frame to its motion. What is here needs no parser, so that it can be
//! done on any thread as soon as the frames it depends on are settled.

use std::ops::Range;
use std::sync::Arc;

use crate::entropy::cdf::ResetCounters;
use crate::entropy::cdf_set::CdfSet;
use crate::error::{Error, Result};
use crate::frame::{ContextError, FrameContent, FrameState, FrameStates};
use crate::interrupt::Interrupt;
use crate::memory;
use crate::motion::{Frame, Reference};
use crate::obu::frame_header::FrameHeader;
use crate::obu::header::ObuHeader;
use crate::obu::sequence_header::SequenceHeader;
use crate::refs::ReferenceSlots;
use crate::tile::{
    Block, CoefficientStats, FrameContext, TileBounds, TileDecoder, TileOutput, TileStop,
};
use crate::trace::FrameTraceState;

/// Where the bytes of a tile lie.
pub(crate) struct TileBytes {
    pub(super) unit: Arc<Vec<u8>>,
    pub(super) range: Range<usize>,
    /// Of the first one in the file.
    pub(super) byte_offset: u64,
}

/// A frame whose header is read and whose tiles are not.
pub(crate) struct FrameJob {
    pub(super) obu: ObuHeader,
    /// Of the header's OBU in the file.
    pub(super) byte_offset: u64,
    pub(super) unit_index: u64,
    pub(super) is_output: bool,
    pub(super) sequence: Arc<SequenceHeader>,
    pub(super) header: Arc<FrameHeader>,
    /// The reference slots that the header refers to.
    pub(super) slots: ReferenceSlots,
    pub(super) states: FrameStates,
    /// The frame as later ones see it.
    pub(super) state: Arc<FrameState>,
    /// The tiles found so far, in order.
    pub(super) tiles: Vec<TileBytes>,
    pub(super) interrupt: Interrupt,
    pub(super) trace: FrameTraceState,
}

/// A frame whose tiles are being read.
pub(crate) struct FrameReader {
    pub(super) context: FrameContext,
    /// Probabilities that every tile starts from.
    pub(super) cdfs: Arc<CdfSet>,
}

impl FrameJob {
    /// Whether every frame that has to come first is settled.
    pub(super) fn is_ready(&self) -> bool {
        let is_settled = |slot: usize| {
            let state = self.states[slot].as_ref();
            state.is_none_or(|state| state.is_settled())
        };
        self.header.primary_slot().is_none_or(is_settled)
            && (!self.header.use_ref_frame_mvs
                || self
                    .header
                    .ref_frame_idx
                    .iter()
                    .all(|&slot| is_settled(slot.into())))
    }

    /// Sets up everything that the tiles depend on.
    ///
    /// # Errors
    /// [`Error::MissingReference`] when a frame that has to come first is lost.
    pub(super) fn start(&self) -> Result<FrameReader> {
        let missing = |reason: &'static str, section: &'static str| Error::MissingReference {
            reason: reason.into(),
            section,
            byte_offset: self.byte_offset,
        };
        let primary = match self.header.primary_slot() {
            None => None,
            Some(slot) => {
                let content = self.states[slot].as_ref().and_then(|state| state.content());
                Some(content.ok_or_else(|| missing("the primary reference was lost", "6.8.2"))?)
            }
        };
        let cdfs = primary.map_or_else(
            || Arc::new(CdfSet::defaults(self.header.quantization.base_q_idx)),
            |content| content.cdfs.clone(),
        );
        let mut context = FrameContext::new(
            &self.sequence,
            &self.header,
            &self.slots,
            &self.states,
            primary,
        )
        .map_err(|error| match error {
            ContextError::LostMotion => missing("vectors of a lost frame are needed", "7.9.2"),
            ContextError::OutOfMemory(error) => error.into(),
        })?;
        context.interrupt = self.interrupt.clone();
        Ok(FrameReader { context, cdfs })
    }

    /// §5.11.1: reads one tile.
    pub(super) fn read_tile(&self, reader: &FrameReader, index: usize) -> Result<TileOutput> {
        let TileBytes {
            unit,
            range,
            byte_offset,
        } = &self.tiles[index];
        let tile_num = index as u32;
        let mut output = reader
            .read_tile(tile_num, &unit[range.clone()])
            .map_err(|stop| stop.into_error(tile_num, *byte_offset))?;
        // Only one tile's are kept: those of thousands of small tiles weigh more than the rest.
        if tile_num != self.header.tile_info.context_update_tile_id
            || self.header.disable_frame_end_update_cdf
        {
            output.cdfs = None;
        }
        Ok(output)
    }

    /// §7.4 `decode_frame_wrapup` after all tiles, of which the first error counts.
    pub(super) fn finish(
        &self,
        reader: &FrameReader,
        tiles: impl Iterator<Item = Result<TileOutput>>,
    ) -> Result<Frame> {
        self.settle_with(
            tiles
                .collect::<Result<_>>()
                .and_then(|tiles| self.joined(reader, tiles)),
        )
    }

    /// All of it, on the calling thread.
    pub(super) fn run(&self) -> Result<Frame> {
        match self.start() {
            Ok(reader) => {
                let tiles = (0..self.tiles.len()).map(|index| self.read_tile(&reader, index));
                self.finish(&reader, tiles)
            }
            Err(error) => self.settle_with(Err(error)),
        }
    }

    /// Lets later frames go on without the tiles where the frame is lost.
    pub(super) fn settle_with<T>(&self, result: Result<T>) -> Result<T> {
        if result.is_err() {
            self.state.settle(None);
        }
        result
    }

    fn joined(&self, reader: &FrameReader, mut tiles: Vec<TileOutput>) -> Result<Frame> {
        let content = reader.content(&mut tiles)?;
        let trace = self.trace.clone().finish(&tiles);
        let joined = join_tiles(&mut tiles)?;
        self.state.settle(Some(content));
        Ok(Frame {
            decode_index: self.state.decode_index,
            display_index: self.state.display_index,
            unit_index: self.unit_index,
            temporal_id: self.obu.temporal_id,
            spatial_id: self.obu.spatial_id,
            is_output: self.is_output,
            references: self.references(),
            is_scaled: reader.context.is_scaled,
            ref_size: reader.context.ref_size,
            trace,
            header: self.header.clone(),
            sequence: self.sequence.clone(),
            blocks: joined.blocks,
            warps: joined.warps,
            stats: joined.stats,
        })
    }

    /// The frames behind LAST to ALTREF.
    fn references(&self) -> [Option<Reference>; 7] {
        if self.header.frame_is_intra {
            return [None; 7];
        }
        self.header.ref_frame_idx.map(|slot| {
            self.states[usize::from(slot)]
                .as_ref()
                .map(|state| Reference {
                    decode_index: state.decode_index,
                    display_index: state.display_index,
                })
        })
    }
}

impl FrameReader {
    /// §5.11.2: reads `data` as the tile of a number.
    pub(super) fn read_tile(
        &self,
        tile_num: u32,
        data: &[u8],
    ) -> std::result::Result<TileOutput, TileStop> {
        let bounds = tile_bounds(&self.context.header, tile_num);
        let cdfs = Box::new((*self.cdfs).clone());
        TileDecoder::new(&self.context, bounds, data, cdfs)?.decode()
    }

    /// §7.20: what the tiles leave in a reference slot.
    pub(super) fn content(&self, tiles: &mut [TileOutput]) -> Result<FrameContent> {
        let cdfs = match tiles.iter_mut().find_map(|tile| tile.cdfs.take()) {
            Some(mut cdfs) => {
                cdfs.reset_counters();
                Arc::from(cdfs)
            }
            None => self.cdfs.clone(),
        };
        Ok(FrameContent {
            cdfs,
            segment_ids: self.context.segment_map(tiles)?,
            motion: self.context.saved_motion(tiles)?,
        })
    }
}

/// The blocks of a frame with their local models, and its coefficient statistics.
struct FrameBlocks {
    blocks: Vec<Block>,
    warps: Vec<[i32; 6]>,
    stats: [CoefficientStats; 3],
}

/// Takes the blocks out of the tiles.
fn join_tiles(tiles: &mut [TileOutput]) -> Result<FrameBlocks> {
    let (mut blocks, mut warps) = (Vec::new(), Vec::new());
    let mut stats = [CoefficientStats::default(); 3];
    if let [tile] = tiles {
        blocks = std::mem::take(&mut tile.blocks);
        warps = std::mem::take(&mut tile.warps);
    }
    memory::reserve(&mut blocks, tiles.iter().map(|t| t.blocks.len()).sum())?;
    memory::reserve(&mut warps, tiles.iter().map(|t| t.warps.len()).sum())?;
    for tile in tiles {
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

/// Where a tile lies, from its number.
fn tile_bounds(header: &FrameHeader, tile_num: u32) -> TileBounds {
    let info = &header.tile_info;
    let row = (tile_num / info.tile_cols) as usize;
    let col = (tile_num % info.tile_cols) as usize;
    TileBounds {
        mi_row_start: info.mi_row_starts[row],
        mi_row_end: info.mi_row_starts[row + 1],
        mi_col_start: info.mi_col_starts[col],
        mi_col_end: info.mi_col_starts[col + 1],
    }
}
