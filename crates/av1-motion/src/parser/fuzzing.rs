//! Doors for the fuzz targets, open only under `--cfg fuzzing`; not part of the crate's interface.

use super::frames::CurrentFrame;
use super::{Limits, ObuType, Parser, tile_bounds};
use crate::container::ContainerReader;
use crate::obu::header::Obu;
use crate::tile::TileDecoder;

/// A frame of a stream, from its headers up to the point where its tiles would be read.
pub struct SavedFrame(CurrentFrame);

/// The frames of an undamaged stream.
///
/// # Panics
/// The stream is damaged after all.
#[must_use]
pub fn saved_frames(stream: &[u8], limits: &Limits) -> Vec<SavedFrame> {
    let mut reader = ContainerReader::new(stream, limits).expect("a container");
    let mut parser = Parser::new(limits.clone());
    let mut saved = Vec::new();
    while let Some(unit) = reader.next_unit().expect("an intact container") {
        parser.push(unit.data, unit.byte_offset);
        while let Some((obu, end)) = parser.unit.peek() {
            parser.unit.position = end;
            let obu = obu.expect("an OBU");
            let length = match obu.header.obu_type {
                ObuType::Frame | ObuType::FrameHeader if parser.current.is_none() => {
                    parser.read_frame_header(&obu).expect("a header").0
                }
                _ => {
                    parser.read_obu(&obu).expect("a conformant stream");
                    continue;
                }
            };
            saved.extend(parser.start_again(&obu));
            if obu.header.obu_type == ObuType::Frame {
                parser.read_tile_group(&obu, length).expect("tiles");
            }
        }
    }
    saved
}

impl Parser {
    /// Begins the current frame once more, for somebody else.
    fn start_again(&self, obu: &Obu) -> Option<SavedFrame> {
        let current = self.current.as_ref()?;
        let context = &current.context;
        self.start_frame(
            obu,
            &context.sequence,
            &context.header,
            current.display_index,
        )
        .ok()
        .map(SavedFrame)
    }
}

impl SavedFrame {
    /// Reads `data` as tile number `tile_num` (modulo the number of tiles), then does with the
    /// blocks what the parser does. Returns how many there are.
    ///
    /// # Panics
    /// The parser has a fault, or memory is used up.
    #[must_use]
    pub fn read_tile(&self, tile_num: u32, data: &[u8]) -> usize {
        let SavedFrame(frame) = self;
        let header = &frame.context.header;
        let bounds = tile_bounds(header, tile_num % header.tile_info.num_tiles());
        let cdfs = Box::new((*frame.cdfs).clone());
        let decoder = TileDecoder::new(&frame.context, bounds, data, cdfs).expect("memory");
        let tiles = [decoder.decode()];
        let map = frame.context.segment_map(&tiles).expect("memory");
        let motion = frame.context.saved_motion(&tiles).expect("memory");
        drop((map, motion));
        tiles[0].blocks.len()
    }
}
