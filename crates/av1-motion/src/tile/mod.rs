//! §5.11.2 Decode tile: the syntax below the tile group, one file per syntax table.

mod block;
mod coefficients;
mod compound;
mod context;
mod delta;
mod inter_info;
mod intra_info;
mod levels;
mod loop_restoration;
mod motion_mode;
mod mv;
mod palette;
mod partition;
mod ref_frames;
mod residual;
mod segment_id;
mod tx_size;
mod tx_type;

use std::sync::Arc;

pub use block::Block;
pub(crate) use block::NO_WARP;
use context::{AboveContext, LeftContext, TileGrid};

use crate::entropy::cdf_set::CdfSet;
use crate::entropy::symbol::SymbolDecoder;
use crate::error::Error;
use crate::interrupt::Interrupt;
use crate::memory::{self, OutOfMemory};
use crate::mvpred::projection::ProjectedMotion;
use crate::obu::frame_header::FrameHeader;
use crate::obu::sequence_header::SequenceHeader;
use crate::tables::block_size::{BLOCK_64X64, BLOCK_128X128};
use crate::trace::TileTrace;
use levels::CoefficientScratch;
use loop_restoration::RestorationReferences;

/// Why the data of a tile cannot be what an encoder wrote.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TileError {
    pub(crate) section: &'static str,
    pub(crate) reason: &'static str,
}

/// Why a tile was not read to its end.
#[derive(Clone, Copy, Debug)]
pub(crate) enum TileStop {
    Damage(TileError),
    OutOfMemory(OutOfMemory),
    Interrupted,
}

impl From<TileError> for TileStop {
    fn from(error: TileError) -> Self {
        Self::Damage(error)
    }
}

impl From<OutOfMemory> for TileStop {
    fn from(error: OutOfMemory) -> Self {
        Self::OutOfMemory(error)
    }
}

impl TileStop {
    /// The same for the caller of the parser.
    pub(crate) fn into_error(self, tile_num: u32, byte_offset: u64) -> Error {
        match self {
            Self::Damage(TileError { section, reason }) => {
                Error::malformed(section, byte_offset, format!("{reason} (tile {tile_num})"))
            }
            Self::OutOfMemory(error) => error.into(),
            Self::Interrupted => Error::Interrupted,
        }
    }
}

/// Superblocks between two questions whether to stop.
const SUPERBLOCKS_PER_QUESTION: usize = 16;

pub(crate) type TileResult<T> = std::result::Result<T, TileError>;

/// What all tiles of a frame share.
pub(crate) struct FrameContext {
    pub(crate) sequence: Arc<SequenceHeader>,
    pub(crate) header: Arc<FrameHeader>,
    /// `PrevSegmentIds`, `MiRows * MiCols`; zeros when absent.
    pub(crate) prev_segment_ids: Option<Arc<Vec<u8>>>,
    /// §7.9: present when `use_ref_frame_mvs` is 1.
    pub(crate) projected_motion: Option<ProjectedMotion>,
    /// `is_scaled` by reference name.
    pub(crate) is_scaled: [bool; 8],
    /// `RefUpscaledWidth` and `RefFrameHeight`, by reference name.
    pub(crate) ref_size: [[u32; 2]; 8],
    /// `get_relative_dist( OrderHint, OrderHints[ name ] )`: positive for past references.
    pub(crate) ref_distance: [i32; 8],
    /// §7.19: whether a reference precedes the frame, by name.
    pub(crate) ref_is_past: [bool; 8],
    /// §5.11.47: whether `TxType` is coded, by segment.
    pub(crate) codes_tx_type: [bool; 8],
    /// Asked while tiles are read.
    pub(crate) interrupt: Interrupt,
}

/// Position of a tile in units of 4x4 luma samples.
#[derive(Clone, Copy, Debug)]
#[expect(clippy::struct_field_names, reason = "the specification's names")]
pub(crate) struct TileBounds {
    pub(crate) mi_row_start: u32,
    pub(crate) mi_row_end: u32,
    pub(crate) mi_col_start: u32,
    pub(crate) mi_col_end: u32,
}

impl TileBounds {
    /// §5.11.51 `is_inside`.
    #[inline]
    pub(crate) fn contains(&self, mi_row: i32, mi_col: i32) -> bool {
        mi_row >= self.mi_row_start as i32
            && mi_row < self.mi_row_end as i32
            && mi_col >= self.mi_col_start as i32
            && mi_col < self.mi_col_end as i32
    }

    /// Column relative to the tile.
    #[inline]
    pub(crate) fn col(&self, mi_col: u32) -> usize {
        (mi_col - self.mi_col_start) as usize
    }

    /// Height in units of 4 luma samples.
    pub(crate) fn rows(&self) -> usize {
        (self.mi_row_end - self.mi_row_start) as usize
    }

    /// Width in units of 4 luma samples.
    pub(crate) fn cols(&self) -> usize {
        (self.mi_col_end - self.mi_col_start) as usize
    }
}

/// Counts over the transform blocks of one plane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CoefficientStats {
    /// Transform blocks with `all_zero` equal to 0.
    pub coded_blocks: u64,
    /// Transform blocks with `all_zero` equal to 1.
    pub zero_blocks: u64,
    /// Sum of `eob`.
    pub end_of_block: u64,
    /// Sum of absolute quantised levels.
    pub level: u64,
    /// Negative levels.
    pub negative: u64,
}

impl CoefficientStats {
    pub(crate) fn plus(&self, other: &Self) -> Self {
        Self {
            coded_blocks: self.coded_blocks + other.coded_blocks,
            zero_blocks: self.zero_blocks + other.zero_blocks,
            end_of_block: self.end_of_block + other.end_of_block,
            level: self.level + other.level,
            negative: self.negative + other.negative,
        }
    }
}

/// State while one block is read.
pub(crate) struct BlockContext {
    /// The block that covers the cell above the upper left corner, if available (`AvailU`).
    pub(crate) above: Option<Block>,
    /// The block that covers the cell left of the upper left corner, if available (`AvailL`).
    pub(crate) left: Option<Block>,
    /// `Lossless`.
    lossless: bool,
}

/// What a tile leaves behind.
pub(crate) struct TileOutput {
    pub(crate) blocks: Vec<Block>,
    /// §7.11.3.8 `LocalWarpParams` of the blocks with a valid local model.
    pub(crate) warps: Vec<[i32; 6]>,
    pub(crate) stats: [CoefficientStats; 3],
    /// The probabilities at the end of the tile.
    pub(crate) cdfs: Option<Box<CdfSet>>,
    #[cfg_attr(not(feature = "trace"), expect(dead_code, reason = "empty"))]
    pub(crate) trace: TileTrace,
}

/// §5.11.2: the state of one tile.
pub(crate) struct TileDecoder<'a> {
    pub(crate) frame: &'a FrameContext,
    pub(crate) bounds: TileBounds,
    symbols: SymbolDecoder<'a>,
    cdfs: Box<CdfSet>,
    pub(crate) blocks: Vec<Block>,
    pub(crate) grid: TileGrid,
    warps: Vec<[i32; 6]>,
    above: AboveContext,
    left: LeftContext,
    /// `CurrentQIndex`.
    current_q_index: u8,
    /// `DeltaLF`.
    delta_lf: [i8; 4],
    /// `ReadDeltas`.
    read_deltas: bool,
    /// Which 64x64 quarters of the superblock have their `cdef_idx`.
    cdef_is_read: [bool; 4],
    restoration: RestorationReferences,
    stats: [CoefficientStats; 3],
    scratch: Box<CoefficientScratch>,
    palette: Box<palette::PaletteScratch>,
    trace: TileTrace,
}

impl<'a> TileDecoder<'a> {
    pub(crate) fn new(
        frame: &'a FrameContext,
        bounds: TileBounds,
        data: &'a [u8],
        cdfs: Box<CdfSet>,
    ) -> Result<Self, OutOfMemory> {
        Ok(Self {
            frame,
            bounds,
            symbols: SymbolDecoder::new(data, !frame.header.disable_cdf_update),
            cdfs,
            blocks: Vec::new(),
            grid: TileGrid::new(&bounds)?,
            warps: Vec::new(),
            above: AboveContext::new(bounds.cols())?,
            left: LeftContext::new(),
            current_q_index: frame.header.quantization.base_q_idx,
            delta_lf: [0; 4],
            read_deltas: false,
            cdef_is_read: [false; 4],
            restoration: RestorationReferences::new(),
            stats: [CoefficientStats::default(); 3],
            scratch: Box::default(),
            palette: Box::default(),
            trace: TileTrace::default(),
        })
    }

    /// §5.11.2 `decode_tile`, followed by §8.2.4 `exit_symbol`.
    pub(crate) fn decode(mut self) -> Result<TileOutput, TileStop> {
        self.decode_superblocks()?;
        Ok(TileOutput {
            blocks: self.blocks,
            warps: self.warps,
            stats: self.stats,
            cdfs: Some(self.cdfs),
            trace: self.trace.finish(self.symbols.counter),
        })
    }

    fn decode_superblocks(&mut self) -> Result<(), TileStop> {
        let is_128 = self.frame.sequence.use_128x128_superblock;
        let (size, step) = if is_128 {
            (BLOCK_128X128, 32)
        } else {
            (BLOCK_64X64, 16)
        };
        for mi_row in (self.bounds.mi_row_start..self.bounds.mi_row_end).step_by(step) {
            self.left.clear();
            for mi_col in (self.bounds.mi_col_start..self.bounds.mi_col_end).step_by(step) {
                self.prepare_superblock(mi_col, step)?;
                self.read_deltas = self.frame.header.delta_q_present;
                self.cdef_is_read = [false; 4];
                self.read_lr(mi_row, mi_col, size);
                self.decode_partition(mi_row, mi_col, size)?;
                if self.symbols.is_overrun() {
                    let reason = "a tile needs more bits than it has";
                    return Err(TileStop::Damage(TileError {
                        section: "8.2.4",
                        reason,
                    }));
                }
            }
        }
        self.symbols.finish().map_err(|reason| {
            TileStop::Damage(TileError {
                section: "8.2.4",
                reason,
            })
        })
    }

    /// Asks from time to time whether to stop, and makes room for all blocks of a superblock, so that
    /// none of them has to ask.
    #[inline]
    fn prepare_superblock(&mut self, mi_col: u32, step: usize) -> Result<(), TileStop> {
        let number = self.bounds.col(mi_col) / step;
        if number.is_multiple_of(SUPERBLOCKS_PER_QUESTION) && self.frame.interrupt.is_raised() {
            return Err(TileStop::Interrupted);
        }
        memory::reserve(&mut self.blocks, step * step)?;
        // §5.11.27: only blocks of at least 8x8 have a local model.
        memory::reserve(&mut self.warps, step * step / 4)?;
        Ok(())
    }

    /// The block that covers a cell of the tile that is already decoded.
    #[inline]
    pub(crate) fn block_at(&self, mi_row: u32, mi_col: u32) -> &Block {
        &self.blocks[self.grid.index(mi_row, mi_col) as usize]
    }
}
