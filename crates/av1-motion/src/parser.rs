//! §7.1 Decoding process: units in, frames out. Owns the eight reference slots.

use std::sync::Arc;

use crate::bits::BitReader;
use crate::display::DisplayOrder;
use crate::entropy::cdf::ResetCounters;
use crate::entropy::cdf_set::CdfSet;
use crate::error::{Error, Result};
use crate::frame::{FrameState, FrameStates};
use crate::limits::Limits;
use crate::motion::{Frame, Reference};
use crate::obu::frame_header::FrameHeader;
use crate::obu::header::{Obu, ObuHeader, ObuIterator, ObuType};
use crate::obu::sequence_header::SequenceHeader;
use crate::obu::tile_group::TileGroup;
use crate::refs::ReferenceSlots;
use crate::tile::{CoefficientStats, FrameContext, TileBounds, TileDecoder, TileOutput};

/// Reads the motion of an AV1 stream, frame by frame.
///
/// ```no_run
/// # fn main() -> av1_motion::Result<()> {
/// let limits = av1_motion::Limits::default();
/// let mut reader = av1_motion::ContainerReader::open("clip.ivf", &limits)?;
/// let mut parser = av1_motion::Parser::new(limits);
/// while let Some(unit) = reader.next_unit()? {
///     parser.push(unit.data, unit.byte_offset);
///     while let Some(frame) = parser.next_frame()? {
///         println!("{}: {} vectors", frame.display_index, frame.motion().count());
///     }
/// }
/// # Ok(()) }
/// ```
#[derive(Default)]
pub struct Parser {
    limits: Limits,
    sequence: Option<Arc<SequenceHeader>>,
    slots: ReferenceSlots,
    states: FrameStates,
    display: DisplayOrder,
    /// Frames decoded so far.
    num_decoded: u64,
    /// Units pushed so far.
    num_units: u64,
    unit: Unit,
    /// The frame whose tile groups are being read.
    current: Option<CurrentFrame>,
}

/// The bytes that are being read.
#[derive(Default)]
struct Unit {
    data: Vec<u8>,
    /// OBUs not read yet, last first.
    obus: Vec<Obu>,
    /// What stops the unit after the last of `obus`.
    error: Option<Error>,
}

/// A frame between its header and its last tile.
struct CurrentFrame {
    obu: ObuHeader,
    context: FrameContext,
    references: [Option<Reference>; 7],
    display_index: i64,
    /// Probabilities that every tile starts from.
    cdfs: Arc<CdfSet>,
    /// Those of the tile `context_update_tile_id` at its end.
    saved_cdfs: Option<Box<CdfSet>>,
    tiles: Vec<TileOutput>,
}

impl Parser {
    /// A parser at the start of a stream.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            ..Self::default()
        }
    }

    /// Hands over the OBUs of one temporal unit (or a part of one that holds whole OBUs), in the
    /// low-overhead format. `byte_offset` is where the bytes start in the file, for error messages.
    /// What is left of the previous unit is dropped.
    pub fn push(&mut self, data: Vec<u8>, byte_offset: u64) {
        let mut unit = Unit::default();
        for obu in ObuIterator::new(&data, byte_offset) {
            match obu {
                Ok(obu) => unit.obus.push(obu),
                Err(error) => unit.error = Some(error),
            }
        }
        unit.obus.reverse();
        unit.data = data;
        self.unit = unit;
        self.num_units += 1;
    }

    /// The next frame of the unit, or nothing when a further unit is needed.
    ///
    /// # Errors
    /// What is wrong with the stream. Frames returned before stay valid; the rest of the unit is
    /// dropped, and a later unit can be pushed: frames that do not depend on the lost ones are read,
    /// others give [`Error::MissingReference`].
    pub fn next_frame(&mut self) -> Result<Option<Frame>> {
        while let Some(obu) = self.unit.obus.pop() {
            match self.read_obu(&obu) {
                Ok(None) => {}
                Ok(frame) => return Ok(frame),
                Err(error) => {
                    self.unit = Unit::default();
                    self.abandon_current();
                    return Err(error);
                }
            }
        }
        match self.unit.error.take() {
            Some(error) => {
                self.abandon_current();
                Err(error)
            }
            None => Ok(None),
        }
    }

    /// To be called after the last unit.
    ///
    /// # Errors
    /// [`Error::Malformed`] when tiles of the last frame are missing.
    pub fn finish(&mut self) -> Result<()> {
        self.check_complete(0)
    }

    fn read_obu(&mut self, obu: &Obu) -> Result<Option<Frame>> {
        let header = obu.header;
        let is_layered = !matches!(
            header.obu_type,
            ObuType::SequenceHeader | ObuType::TemporalDelimiter
        );
        let idc = self
            .sequence
            .as_ref()
            .map_or(0, |sequence| sequence.operating_points[0].idc);
        if is_layered && header.is_dropped(idc) {
            return Ok(None);
        }
        match header.obu_type {
            ObuType::TemporalDelimiter => {
                self.check_complete(obu.byte_offset)?;
                Ok(None)
            }
            ObuType::SequenceHeader => {
                let payload = &self.unit.data[obu.payload.clone()];
                let mut reader = BitReader::new(payload, obu.byte_offset);
                let sequence = SequenceHeader::parse(&mut reader)?;
                if self.sequence.as_deref() != Some(&sequence) {
                    self.sequence = Some(Arc::new(sequence));
                }
                Ok(None)
            }
            ObuType::FrameHeader | ObuType::RedundantFrameHeader if self.current.is_some() => {
                // `frame_header_copy`: the same bytes once more.
                Ok(None)
            }
            ObuType::FrameHeader | ObuType::RedundantFrameHeader => {
                Ok(self.read_frame_header(obu)?.1)
            }
            ObuType::Frame => {
                self.check_complete(obu.byte_offset)?;
                let (length, _) = self.read_frame_header(obu)?;
                self.read_tile_group(obu, length)
            }
            ObuType::TileGroup => self.read_tile_group(obu, 0),
            ObuType::TileList => Err(Error::Unsupported {
                feature: "large scale tile decoding".into(),
                section: "5.12",
            }),
            ObuType::Metadata | ObuType::Padding | ObuType::Reserved(_) => Ok(None),
        }
    }

    /// A frame must have all its tiles before something else begins.
    fn check_complete(&mut self, byte_offset: u64) -> Result<()> {
        let Some(current) = &self.current else {
            return Ok(());
        };
        let (found, total) = (
            current.tiles.len(),
            current.context.header.tile_info.num_tiles(),
        );
        self.abandon_current();
        let reason = format!("a frame ends after {found} of its {total} tiles");
        Err(Error::malformed("7.5", byte_offset, reason))
    }

    /// §5.9.1 `frame_header_obu`: the length of the header with its byte alignment, and the frame when
    /// an earlier one is shown.
    fn read_frame_header(&mut self, obu: &Obu) -> Result<(usize, Option<Frame>)> {
        let payload = &self.unit.data[obu.payload.clone()];
        let mut reader = BitReader::new(payload, obu.byte_offset);
        let Some(sequence) = self.sequence.clone() else {
            return Err(reader.malformed("7.5", "a frame comes before any sequence header"));
        };
        let mut slots = self.slots.clone();
        let header = FrameHeader::parse(
            &mut reader,
            &sequence,
            &mut slots,
            &obu.header,
            &self.limits,
        )?;
        for (index, state) in self.states.iter_mut().enumerate() {
            // A header can reveal that the frame of a slot was lost.
            if slots[index].state != self.slots[index].state {
                *state = None;
            }
        }
        self.slots = slots;
        let header = Arc::new(header);
        if header.show_existing_frame {
            return Ok((0, Some(self.show_existing_frame(obu, sequence, header)?)));
        }
        if obu.header.obu_type == ObuType::Frame {
            reader.byte_alignment()?;
        } else {
            reader.trailing_bits()?;
        }
        if self
            .limits
            .max_frames
            .is_some_and(|maximum| self.num_decoded >= maximum)
        {
            let (limit, maximum) = ("max_frames", self.limits.max_frames.unwrap_or(0));
            return Err(Error::LimitExceeded {
                limit,
                value: self.num_decoded + 1,
                maximum,
            });
        }
        let length = reader.position() / 8;
        self.current = Some(self.start_frame(obu, &sequence, &header)?);
        Ok((length, None))
    }

    /// Sets up everything that the tiles of a frame depend on.
    fn start_frame(
        &mut self,
        obu: &Obu,
        sequence: &Arc<SequenceHeader>,
        header: &Arc<FrameHeader>,
    ) -> Result<CurrentFrame> {
        let display_index = self.display.place(sequence, header);
        let primary = match header.primary_slot() {
            None => None,
            Some(slot) => {
                let state = self.states[slot].as_deref();
                Some(state.ok_or_else(|| Error::MissingReference {
                    reason: "the primary reference frame was lost".into(),
                    section: "6.8.2",
                    byte_offset: obu.byte_offset,
                })?)
            }
        };
        let cdfs = primary.map_or_else(
            || Arc::new(CdfSet::defaults(header.quantization.base_q_idx)),
            |state| state.cdfs.clone(),
        );
        let context = FrameContext::new(sequence, header, &self.slots, &self.states, primary);
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

    /// §5.11.1 `tile_group_obu`, whose data starts `offset` bytes into the payload.
    fn read_tile_group(&mut self, obu: &Obu, offset: usize) -> Result<Option<Frame>> {
        let data = &self.unit.data[obu.payload.clone()][offset..];
        let byte_offset = obu.byte_offset + offset as u64;
        let Some(current) = &mut self.current else {
            let reason = "a tile group comes without a frame header";
            return Err(Error::malformed("7.5", byte_offset, reason));
        };
        let header = current.context.header.clone();
        let next_tile = current.tiles.len() as u32;
        let group = TileGroup::parse(data, byte_offset, &header.tile_info, next_tile)?;
        for tile in &group.tiles {
            let bounds = tile_bounds(&header, tile.tile_num);
            let cdfs = Box::new((*current.cdfs).clone());
            let start = byte_offset + tile.range.start as u64;
            let output =
                TileDecoder::new(&current.context, bounds, &data[tile.range.clone()], cdfs)
                    .decode();
            if let Some(error) = output.error {
                let reason = format!("{} (tile {})", error.reason, tile.tile_num);
                return Err(Error::malformed(error.section, start, reason));
            }
            if tile.tile_num == header.tile_info.context_update_tile_id
                && !header.disable_frame_end_update_cdf
            {
                current.saved_cdfs = Some(output.cdfs.clone());
            }
            current.tiles.push(output);
        }
        if !group.is_last(&header.tile_info) {
            return Ok(None);
        }
        Ok(self
            .current
            .take()
            .map(|current| self.finish_frame(current)))
    }

    /// §7.4 `decode_frame_wrapup` of a decoded frame.
    fn finish_frame(&mut self, current: CurrentFrame) -> Frame {
        let CurrentFrame { context, .. } = current;
        let header = context.header.clone();
        let cdfs = match current.saved_cdfs {
            Some(mut cdfs) => {
                cdfs.reset_counters();
                Arc::from(cdfs)
            }
            None => current.cdfs,
        };
        let state = Arc::new(FrameState {
            decode_index: self.num_decoded,
            display_index: current.display_index,
            cdfs,
            segment_ids: context.segment_map(&current.tiles),
            motion: context.saved_motion(&current.tiles),
        });
        self.refresh(&header, &context.sequence, &state);
        self.num_decoded += 1;
        let (mut blocks, mut warps) = (Vec::new(), Vec::new());
        let mut totals = [CoefficientStats::default(); 3];
        for mut tile in current.tiles {
            for block in &mut tile.blocks {
                block.offset_warp(warps.len() as u32);
            }
            warps.append(&mut tile.warps);
            if blocks.is_empty() {
                blocks = tile.blocks;
            } else {
                blocks.append(&mut tile.blocks);
            }
            for (sum, counts) in totals.iter_mut().zip(tile.stats) {
                *sum = sum.plus(&counts);
            }
        }
        Frame {
            decode_index: state.decode_index,
            display_index: state.display_index,
            unit_index: self.num_units - 1,
            temporal_id: current.obu.temporal_id,
            spatial_id: current.obu.spatial_id,
            references: current.references,
            is_scaled: context.is_scaled,
            header,
            sequence: context.sequence,
            blocks,
            warps,
            stats: totals,
        }
    }

    /// §7.4, §7.21: shows a frame of a slot; a key frame is loaded and refreshes every slot.
    fn show_existing_frame(
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
            references: [None; 7],
            header,
            sequence,
            blocks: Vec::new(),
            warps: Vec::new(),
            stats: [CoefficientStats::default(); 3],
            is_scaled: [false; 8],
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

    /// Forgets an incomplete frame together with the slots it would have filled.
    fn abandon_current(&mut self) {
        let Some(current) = self.current.take() else {
            return;
        };
        let flags = current.context.header.refresh_frame_flags;
        self.slots.clear(flags);
        for (index, held) in self.states.iter_mut().enumerate() {
            if flags >> index & 1 == 1 {
                *held = None;
            }
        }
    }
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
