//! §7.1 Decoding process: units in, frames out. Owns the eight reference slots.

mod frames;
#[cfg(fuzzing)]
pub mod fuzzing;

use std::sync::Arc;

use crate::bits::BitReader;
use crate::display::DisplayOrder;
use crate::error::{Error, Result};
use crate::frame::FrameStates;
use crate::interrupt::Interrupt;
use crate::limits::{Limits, Work};
use crate::motion::Frame;
use crate::obu::frame_header::FrameHeader;
use crate::obu::header::{Obu, ObuIterator, ObuType};
use crate::obu::sequence_header::SequenceHeader;
use crate::obu::tile_group::TileGroup;
use crate::refs::ReferenceSlots;
use crate::tile::{TileBounds, TileDecoder};
use crate::trace::FrameTraceState;
use frames::{CurrentFrame, LostFrame};

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
    /// §6.4.1 `operatingPoint`.
    operating_point: usize,
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
    /// The frame that an error on its way to the caller is about.
    lost: Option<LostFrame>,
    /// What was read so far, for the limits.
    work: Work,
    interrupt: Interrupt,
    /// Tile groups belong to a frame that is lost already.
    skips_tiles: bool,
    /// Of the frame that is being read.
    trace: FrameTraceState,
}

/// The bytes that are being read.
#[derive(Default)]
struct Unit {
    data: Vec<u8>,
    /// Bytes of `data` that were read.
    position: usize,
    /// Where `data` starts in the file.
    byte_offset: u64,
    /// OBUs read so far.
    num_obus: u64,
}

impl Unit {
    /// The next OBU, and the position behind it. Units are walked as they are read: a list of OBUs
    /// could be many times as large as the bytes.
    fn peek(&self) -> Option<(Result<Obu>, usize)> {
        let obus = ObuIterator::new(&self.data, self.byte_offset);
        let mut obus = obus.starting_at(self.position);
        let obu = obus.next()?;
        Some((obu, obus.position()))
    }
}

/// OBUs between two questions whether to stop.
const OBUS_PER_QUESTION: u64 = 1024;

impl Parser {
    /// A parser at the start of a stream.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            ..Self::default()
        }
    }

    /// The same parser for another operating point of scalable streams: 0, the default, is the one
    /// that a stream recommends and usually has all layers; others leave layers out. A stream that
    /// does not have it gives [`Error::OperatingPoint`] at its first sequence header.
    #[must_use]
    pub fn with_operating_point(self, operating_point: usize) -> Self {
        Self {
            operating_point,
            ..self
        }
    }

    /// Hands over the OBUs of one temporal unit (or a part of one that holds whole OBUs), in the
    /// low-overhead format. `byte_offset` is where the bytes start in the file, for error messages.
    /// OBUs of the unit before that [`Parser::next_frame`] was not asked for are dropped.
    pub fn push(&mut self, data: Vec<u8>, byte_offset: u64) {
        self.unit = Unit {
            data,
            byte_offset,
            ..Unit::default()
        };
        self.num_units += 1;
        self.work.begin_unit();
    }

    /// Lets `should_stop` end the reading of a frame with [`Error::Interrupted`]. It is asked every
    /// few superblocks, some thousand times a second, and has to be quick. An interrupted frame is
    /// lost as if it were damaged.
    pub fn interrupt_when(&mut self, should_stop: impl Fn() -> bool + Send + Sync + 'static) {
        self.interrupt = Interrupt::new(should_stop);
    }

    /// The next frame of the unit, or nothing when a further unit is needed.
    ///
    /// # Errors
    /// What is wrong with the stream. Frames returned before stay valid, and reading can go on, in
    /// this unit and in later ones: a frame is read as soon as everything it depends on (its header's
    /// references, probabilities, segments, saved vectors) is intact, and gives
    /// [`Error::MissingReference`] until then. Nothing is guessed.
    pub fn next_frame(&mut self) -> Result<Option<Frame>> {
        while let Some((obu, end)) = self.unit.peek() {
            if let Ok(obu) = &obu
                && self.current.is_some()
                && begins_anew(obu.header.obu_type)
            {
                return self.incomplete(obu.byte_offset).map_or(Ok(None), Err);
            }
            self.unit.position = end;
            match obu.and_then(|obu| self.read_obu(&obu)) {
                Ok(None) => {}
                Ok(frame) => return Ok(frame),
                Err(error) => {
                    self.lose();
                    return Err(error);
                }
            }
        }
        Ok(None)
    }

    /// To be called after the last unit.
    ///
    /// # Errors
    /// [`Error::Malformed`] when tiles of the last frame are missing.
    pub fn finish(&mut self) -> Result<()> {
        self.incomplete(0).map_or(Ok(()), Err)
    }

    /// Gives up a frame that ends before its last tile.
    fn incomplete(&mut self, byte_offset: u64) -> Option<Error> {
        let current = self.current.as_ref()?;
        let (found, total) = (
            current.tiles.len(),
            current.context.header.tile_info.num_tiles(),
        );
        self.lose();
        let reason = format!("a frame ends after {found} of its {total} tiles");
        Some(Error::malformed("7.5", byte_offset, reason))
    }

    fn read_obu(&mut self, obu: &Obu) -> Result<Option<Frame>> {
        self.unit.num_obus += 1;
        if self.unit.num_obus.is_multiple_of(OBUS_PER_QUESTION) && self.interrupt.is_raised() {
            return Err(Error::Interrupted);
        }
        let header = obu.header;
        let is_layered = !matches!(
            header.obu_type,
            ObuType::SequenceHeader | ObuType::TemporalDelimiter
        );
        if is_layered && header.is_dropped(self.operating_point_idc()) {
            return Ok(None);
        }
        match header.obu_type {
            ObuType::SequenceHeader => {
                let payload = &self.unit.data[obu.payload.clone()];
                let mut reader = BitReader::new(payload, obu.byte_offset);
                let sequence = SequenceHeader::parse(&mut reader)?;
                let available = sequence.operating_points.len();
                if self.operating_point >= available {
                    return Err(Error::OperatingPoint {
                        chosen: self.operating_point,
                        available,
                    });
                }
                if self.sequence.as_deref() != Some(&sequence) {
                    self.sequence = Some(Arc::new(sequence));
                }
                Ok(None)
            }
            // `frame_header_copy`: the same bytes once more.
            ObuType::FrameHeader if self.current.is_some() => Ok(None),
            ObuType::FrameHeader => Ok(self.read_frame_header(obu)?.1),
            ObuType::Frame => {
                let (length, _) = self.read_frame_header(obu)?;
                self.read_tile_group(obu, length)
            }
            // The rest of a lost frame.
            ObuType::TileGroup if self.skips_tiles => Ok(None),
            ObuType::TileGroup => self.read_tile_group(obu, 0),
            ObuType::TileList => Err(Error::Unsupported {
                feature: "large scale tile decoding".into(),
                section: "5.12",
            }),
            ObuType::TemporalDelimiter => {
                self.display.begin_unit();
                Ok(None)
            }
            ObuType::RedundantFrameHeader
            | ObuType::Metadata
            | ObuType::Padding
            | ObuType::Reserved(_) => Ok(None),
        }
    }

    /// §6.4.1 `OperatingPointIdc`: 0 when every frame is read.
    fn operating_point_idc(&self) -> u16 {
        self.sequence
            .as_ref()
            .and_then(|sequence| sequence.operating_points.get(self.operating_point))
            .map_or(0, |point| point.idc)
    }

    /// §7.18.1: whether frames of a spatial layer are meant to be seen.
    fn outputs_layer(&self, spatial_id: u8) -> bool {
        let layers = self.operating_point_idc() >> 8;
        layers == 0 || u32::from(spatial_id) == layers.ilog2()
    }

    /// §5.9.1 `frame_header_obu`: the length of the header with its byte alignment, and the frame when
    /// an earlier one is shown.
    fn read_frame_header(&mut self, obu: &Obu) -> Result<(usize, Option<Frame>)> {
        self.skips_tiles = false;
        self.work.add_header(&self.limits)?;
        self.trace = FrameTraceState::begin(&self.slots, &self.states);
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
        let (width, height) = (header.size.upscaled_width, header.size.frame_height);
        self.work.add_frame(width, height, &self.limits)?;
        let length = reader.position() / 8;
        let display_index = self
            .display
            .place(&sequence, &header, obu.header.spatial_id);
        match self.start_frame(obu, &sequence, &header, display_index) {
            Ok(current) => {
                self.current = Some(current);
                Ok((length, None))
            }
            Err(error) => {
                self.lost = Some(LostFrame {
                    sequence,
                    header,
                    display_index,
                });
                Err(error)
            }
        }
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
        self.trace.tile_group(next_tile as usize);
        for tile in &group.tiles {
            let bounds = tile_bounds(&header, tile.tile_num);
            let cdfs = Box::new((*current.cdfs).clone());
            let start = byte_offset + tile.range.start as u64;
            let mut output =
                TileDecoder::new(&current.context, bounds, &data[tile.range.clone()], cdfs)?
                    .decode();
            if let Some(stop) = output.error {
                return Err(stop.into_error(tile.tile_num, start));
            }
            // Only one tile's are kept: those of thousands of small tiles weigh more than the rest.
            let cdfs = output.cdfs.take();
            if tile.tile_num == header.tile_info.context_update_tile_id
                && !header.disable_frame_end_update_cdf
            {
                current.saved_cdfs = cdfs;
            }
            current.tiles.push(output);
        }
        if !group.is_last(&header.tile_info) {
            return Ok(None);
        }
        let content = current.content()?;
        let blocks = current.join_tiles()?;
        let frame = self.current.take();
        Ok(frame.map(|current| self.finish_frame(current, content, blocks)))
    }
}

/// Whether an OBU can only come between frames.
fn begins_anew(obu_type: ObuType) -> bool {
    matches!(
        obu_type,
        ObuType::TemporalDelimiter | ObuType::SequenceHeader | ObuType::Frame
    )
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
