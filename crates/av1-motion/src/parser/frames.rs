//! §7.20, §7.21: what becomes of a frame in the reference slots once its header is read.

use std::sync::Arc;

use super::Parser;
use super::job::FrameJob;
use crate::error::{Error, Result};
use crate::frame::{FrameState, FrameStates};
use crate::motion::Frame;
use crate::obu::frame_header::FrameHeader;
use crate::obu::header::Obu;
use crate::obu::sequence_header::SequenceHeader;
use crate::tile::CoefficientStats;

impl Parser {
    /// A frame whose header was read, before its tiles are found.
    pub(super) fn new_job(
        &mut self,
        obu: &Obu,
        sequence: Arc<SequenceHeader>,
        header: Arc<FrameHeader>,
        display_index: i64,
    ) -> FrameJob {
        FrameJob {
            obu: obu.header,
            byte_offset: obu.byte_offset,
            unit_index: self.num_units - 1,
            is_output: header.show_frame && self.outputs_layer(obu.header.spatial_id),
            sequence,
            header,
            slots: self.slots.clone(),
            states: self.states.clone(),
            state: Arc::new(FrameState::new(self.num_decoded, display_index)),
            tiles: Vec::new(),
            interrupt: self.interrupt.clone(),
            trace: std::mem::take(&mut self.trace),
        }
    }

    /// §7.20 for a frame whose tiles are found: headers that come after it refer to it, whether or not
    /// the tiles can be read.
    pub(super) fn keep(&mut self, job: &FrameJob) {
        self.refresh(&job.header, &job.sequence, &job.state);
        self.num_decoded += 1;
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

    /// After an error before the tiles: keeps what is known of the frame that was lost. Without a whole
    /// header nothing is known of what it replaced, so that every slot has to be given up.
    pub(super) fn lose(&mut self) {
        self.skips_tiles = true;
        if let Some(job) = self.current.take() {
            job.state.settle(None);
            self.keep(&job);
        } else {
            self.slots.clear(u8::MAX);
            self.states = FrameStates::default();
        }
    }
}
