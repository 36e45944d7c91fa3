//! §7.4 Decode frame wrapup: from the tiles of a frame to what later frames and the caller need.

use std::sync::{Arc, OnceLock};

use crate::entropy::cdf_set::CdfSet;
use crate::interrupt::Interrupt;
use crate::memory::{OutOfMemory, filled};
use crate::mvpred::projection::{ProjectedMotion, ProjectionSource};
use crate::mvpred::storage::{SavedMotionBands, SavedMotionBuilder};
use crate::obu::frame_header::FrameHeader;
use crate::obu::sequence_header::SequenceHeader;
use crate::refs::{ReferenceSlot, ReferenceSlots};
use crate::tile::{FrameContext, TileOutput};

/// The frame in a reference slot. It is there as soon as its header is read; what its tiles leave comes
/// when they are.
#[derive(Debug)]
pub(crate) struct FrameState {
    pub(crate) decode_index: u64,
    pub(crate) display_index: i64,
    /// Nothing inside when the tiles could not be read. Vectors may still point to such a frame; only
    /// what follows from its tiles is lost.
    content: OnceLock<Option<FrameContent>>,
}

impl FrameState {
    pub(crate) fn new(decode_index: u64, display_index: i64) -> Self {
        Self {
            decode_index,
            display_index,
            content: OnceLock::new(),
        }
    }

    /// What the tiles left; absent when they are lost, or not read yet.
    pub(crate) fn content(&self) -> Option<&FrameContent> {
        self.content.get()?.as_ref()
    }

    /// Whether the tiles were read or lost.
    pub(crate) fn is_settled(&self) -> bool {
        self.content.get().is_some()
    }

    /// Ends the reading of the tiles, with nothing when they are lost. Only the first call counts.
    pub(crate) fn settle(&self, content: Option<FrameContent>) {
        let _ = self.content.set(content);
    }
}

/// §7.20: what tile data leaves in a reference slot.
#[derive(Debug)]
pub(crate) struct FrameContent {
    /// Probabilities that a frame with this primary reference starts from; counters are 0.
    pub(crate) cdfs: Arc<CdfSet>,
    /// `SavedSegmentIds`; zeros when absent.
    pub(crate) segment_ids: Option<Arc<Vec<u8>>>,
    /// `SavedMvs` and `SavedRefFrames`, when a later frame may ask for them.
    pub(crate) motion: Option<SavedMotionBands>,
}

/// The decoded state behind each reference slot.
pub(crate) type FrameStates = [Option<Arc<FrameState>>; 8];

/// Why the tiles of a frame cannot be begun.
#[derive(Debug)]
pub(crate) enum ContextError {
    /// Vectors that have to be projected were lost with the tiles of their frame.
    LostMotion,
    OutOfMemory(OutOfMemory),
}

impl From<OutOfMemory> for ContextError {
    fn from(error: OutOfMemory) -> Self {
        Self::OutOfMemory(error)
    }
}

impl FrameContext {
    /// What the tiles of a frame start from; `primary` is the state of the primary reference frame.
    ///
    /// # Errors
    /// [`ContextError::LostMotion`] when vectors of a damaged frame would have to be projected.
    pub(crate) fn new(
        sequence: &Arc<SequenceHeader>,
        header: &Arc<FrameHeader>,
        slots: &ReferenceSlots,
        states: &FrameStates,
        primary: Option<&FrameContent>,
    ) -> Result<Self, ContextError> {
        let slot = |name: i8| &slots[header.ref_frame_idx[name as usize - 1].into()];
        let names = 1..=7_i8;
        let (mut is_scaled, mut ref_is_past, mut ref_distance) = ([false; 8], [false; 8], [0; 8]);
        let mut ref_size = [[0; 2]; 8];
        if !header.frame_is_intra {
            for name in names {
                let hint = header.order_hints[name as usize];
                is_scaled[name as usize] = is_reference_scaled(header, slot(name));
                ref_size[name as usize] = [slot(name).upscaled_width, slot(name).frame_height];
                ref_distance[name as usize] = sequence.relative_dist(header.order_hint, hint);
                ref_is_past[name as usize] = sequence.relative_dist(hint, header.order_hint) < 0;
            }
        }
        let source = |name: i8| {
            let index = usize::from(header.ref_frame_idx[name as usize - 1]);
            let slot = &slots[index];
            ProjectionSource {
                frame_type: slot.frame_type,
                mi_rows: slot.mi_rows,
                mi_cols: slot.mi_cols,
                order_hints: &slot.saved_order_hints,
                motion: states[index]
                    .as_ref()
                    .and_then(|state| state.content()?.motion.as_ref()),
            }
        };
        let projected_motion = header
            .use_ref_frame_mvs
            .then(|| ProjectedMotion::estimate(sequence, header, source))
            .transpose()?;
        let prev_segment_ids = primary
            .filter(|_| header.segmentation.enabled)
            .filter(|_| {
                let slot = header.primary_slot().map(|slot| &slots[slot]);
                slot.is_some_and(|slot| {
                    slot.mi_rows == header.size.mi_rows && slot.mi_cols == header.size.mi_cols
                })
            })
            .and_then(|state| state.segment_ids.clone());
        Ok(Self {
            sequence: sequence.clone(),
            header: header.clone(),
            prev_segment_ids,
            projected_motion,
            is_scaled,
            ref_size,
            ref_distance,
            ref_is_past,
            codes_tx_type: std::array::from_fn(|segment| header.qindex(segment as u8, None) > 0),
            interrupt: Interrupt::default(),
        })
    }

    /// §7.4, §7.19: the segmentation map that the frame leaves behind.
    pub(crate) fn segment_map(
        &self,
        tiles: &[TileOutput],
    ) -> Result<Option<Arc<Vec<u8>>>, OutOfMemory> {
        let segmentation = &self.header.segmentation;
        if !segmentation.enabled {
            return Ok(None);
        }
        if !segmentation.update_map {
            return Ok(self.prev_segment_ids.clone());
        }
        let size = &self.header.size;
        let (rows, cols) = (size.mi_rows as usize, size.mi_cols as usize);
        let mut map = filled(0, rows * cols)?;
        for block in tiles.iter().flat_map(|tile| &tile.blocks) {
            let (row, col) = (block.mi_row as usize, block.mi_col as usize);
            let col_end = cols.min(col + block.width4());
            for row in row..rows.min(row + block.height4()) {
                map[row * cols + col..row * cols + col_end].fill(block.segment_id);
            }
        }
        Ok(Some(Arc::new(map)))
    }

    /// §7.19: the motion that the frame leaves behind, if later frames can ask for it.
    pub(crate) fn saved_motion(
        &self,
        tiles: &[TileOutput],
    ) -> Result<Option<SavedMotionBands>, OutOfMemory> {
        if self.header.frame_is_intra || !self.sequence.enable_ref_frame_mvs {
            return Ok(None);
        }
        let mut builder = SavedMotionBuilder::new(self)?;
        for block in tiles.iter().flat_map(|tile| &tile.blocks) {
            builder.store(self, block);
        }
        builder.finish().map(Some)
    }
}

/// §5.11.27 `is_scaled`.
fn is_reference_scaled(header: &FrameHeader, slot: &ReferenceSlot) -> bool {
    const REF_SCALE_SHIFT: u32 = 14;
    let scale = |reference: u32, current: u32| {
        ((u64::from(reference) << REF_SCALE_SHIFT) + u64::from(current / 2)) / u64::from(current)
    };
    let size = &header.size;
    scale(slot.upscaled_width, size.frame_width) != 1 << REF_SCALE_SHIFT
        || scale(slot.frame_height, size.frame_height) != 1 << REF_SCALE_SHIFT
}
