//! §7.1 Decoding process: units in, frames out. Owns the eight reference slots.

mod frames;
#[cfg(fuzzing)]
pub mod fuzzing;
mod job;
mod queue;
mod threads;

use std::sync::Arc;

use crate::bits::BitReader;
use crate::display::DisplayOrder;
use crate::error::{Error, Result};
use crate::frame::FrameStates;
use crate::interrupt::Interrupt;
use crate::limits::{Limits, Work};
use crate::memory;
use crate::motion::Frame;
use crate::obu::frame_header::FrameHeader;
use crate::obu::header::{Obu, ObuIterator, ObuType};
use crate::obu::sequence_header::SequenceHeader;
use crate::obu::tile_group::TileGroup;
use crate::refs::ReferenceSlots;
use crate::trace::FrameTraceState;
use job::{FrameJob, TileBytes};
use threads::Threads;

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
/// parser.finish()?;
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
    /// The frame whose tile groups are being collected.
    current: Option<FrameJob>,
    /// Where frames are read that are found; absent when the caller's thread does it.
    threads: Option<Threads>,
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
    data: Arc<Vec<u8>>,
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

    /// The same parser with `count` threads of its own; with 0 or 1 the caller's thread does all the work.
    ///
    /// Frames and errors come in the same order and are the same for any number. Key-frame segments,
    /// frames that do not depend on each other, and tiles are read at the same time; a stream in which
    /// every frame depends on the one before and has one tile gains nothing. Frames then come later:
    /// the parser takes units until it has a few dozen frames for each thread, and the last ones come
    /// after [`Parser::finish`].
    #[must_use]
    pub fn with_threads(self, count: usize) -> Self {
        Self {
            threads: (count > 1).then(|| Threads::new(count)).flatten(),
            ..self
        }
    }

    /// Hands over the OBUs of one temporal unit (or a part of one that holds whole OBUs), in the
    /// low-overhead format. `byte_offset` is where the bytes start in the file, for error messages.
    /// OBUs of the unit before that [`Parser::next_frame`] was not asked for are dropped.
    pub fn push(&mut self, data: Vec<u8>, byte_offset: u64) {
        self.unit = Unit {
            data: Arc::new(data),
            byte_offset,
            ..Unit::default()
        };
        self.num_units += 1;
        self.work.begin_unit();
        if let Some(threads) = &mut self.threads {
            threads.open();
        }
    }

    /// Lets `should_stop` end the reading of a frame with [`Error::Interrupted`]. It is asked every
    /// few superblocks, some thousand times a second, and has to be quick. An interrupted frame is
    /// lost as if it were damaged.
    pub fn interrupt_when(&mut self, should_stop: impl Fn() -> bool + Send + Sync + 'static) {
        self.interrupt = Interrupt::new(should_stop);
    }

    /// The next frame, or nothing when a further unit is needed (after [`Parser::finish`]: when there is
    /// none left).
    ///
    /// # Errors
    /// What is wrong with the stream. Frames returned before stay valid, and reading can go on, in
    /// this unit and in later ones: a frame is read as soon as everything it depends on (its header's
    /// references, probabilities, segments, saved vectors) is intact, and gives
    /// [`Error::MissingReference`] until then. Nothing is guessed.
    pub fn next_frame(&mut self) -> Result<Option<Frame>> {
        let Some(mut threads) = self.threads.take() else {
            return match self.find_frame()? {
                None => Ok(None),
                Some(Found::Shown(frame)) => Ok(Some(*frame)),
                Some(Found::Coded(job)) => job.run().map(Some),
            };
        };
        let frame = self.next_from(&mut threads);
        self.threads = Some(threads);
        frame
    }

    /// The same, with the work done elsewhere.
    fn next_from(&mut self, threads: &mut Threads) -> Result<Option<Frame>> {
        loop {
            if let Some(frame) = threads.next(&self.interrupt)? {
                return Ok(Some(frame));
            }
            match self.find_frame() {
                Ok(None) if threads.is_closed() => return threads.drain(&self.interrupt),
                Ok(None) => return Ok(None),
                Ok(Some(found)) => threads.push(found),
                Err(error) => threads.push_error(error),
            }
        }
    }

    /// To be called after the last unit; [`Parser::next_frame`] then gives what is left.
    ///
    /// # Errors
    /// [`Error::Malformed`] when tiles of the last frame are missing.
    pub fn finish(&mut self) -> Result<()> {
        let incomplete = self.incomplete(0);
        match (&mut self.threads, incomplete) {
            (None, None) => Ok(()),
            (None, Some(error)) => Err(error),
            (Some(threads), incomplete) => {
                threads.close(incomplete);
                Ok(())
            }
        }
    }

    /// Reads on in the unit up to the end of a frame.
    fn find_frame(&mut self) -> Result<Option<Found>> {
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
                Ok(found) => return Ok(found),
                Err(error) => {
                    self.lose();
                    return Err(error);
                }
            }
        }
        Ok(None)
    }

    /// Gives up a frame that ends before its last tile.
    fn incomplete(&mut self, byte_offset: u64) -> Option<Error> {
        let current = self.current.as_ref()?;
        let (found, total) = (current.tiles.len(), current.header.tile_info.num_tiles());
        self.lose();
        let reason = format!("a frame ends after {found} of its {total} tiles");
        Some(Error::malformed("7.5", byte_offset, reason))
    }

    fn read_obu(&mut self, obu: &Obu) -> Result<Option<Found>> {
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
            ObuType::FrameHeader => {
                let (_, shown) = self.read_frame_header(obu)?;
                Ok(shown.map(|frame| Found::Shown(Box::new(frame))))
            }
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
        self.current = Some(self.new_job(obu, sequence, header, display_index));
        Ok((length, None))
    }

    /// §5.11.1 `tile_group_obu`, whose data starts `offset` bytes into the payload: finds its tiles, and
    /// with the last one of the frame returns it.
    fn read_tile_group(&mut self, obu: &Obu, offset: usize) -> Result<Option<Found>> {
        let start = obu.payload.start + offset;
        let byte_offset = obu.byte_offset + offset as u64;
        let Some(current) = &mut self.current else {
            let reason = "a tile group comes without a frame header";
            return Err(Error::malformed("7.5", byte_offset, reason));
        };
        let tile_info = &current.header.tile_info;
        let num_found = current.tiles.len();
        let data = &self.unit.data[start..obu.payload.end];
        let group = TileGroup::parse(data, byte_offset, tile_info, num_found as u32)?;
        let is_last = group.is_last(tile_info);
        current.trace.tile_group(num_found);
        memory::reserve(&mut current.tiles, group.tiles.len())?;
        current
            .tiles
            .extend(group.tiles.iter().map(|tile| TileBytes {
                unit: self.unit.data.clone(),
                range: start + tile.range.start..start + tile.range.end,
                byte_offset: byte_offset + tile.range.start as u64,
            }));
        let complete = if is_last { self.current.take() } else { None };
        Ok(complete.map(|job| {
            self.keep(&job);
            Found::Coded(Box::new(job))
        }))
    }
}

/// What [`Parser::find_frame`] comes to.
enum Found {
    /// An earlier frame that is shown.
    Shown(Box<Frame>),
    /// A frame with all its tiles, none of them read.
    Coded(Box<FrameJob>),
}

/// Whether an OBU can only come between frames.
fn begins_anew(obu_type: ObuType) -> bool {
    matches!(
        obu_type,
        ObuType::TemporalDelimiter | ObuType::SequenceHeader | ObuType::Frame
    )
}
