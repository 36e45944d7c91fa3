//! Doors for the fuzz targets, open only under `--cfg fuzzing`; not part of the crate's interface.

use super::job::FrameReader;
use super::{Found, Limits, Parser};
use crate::container::ContainerReader;

/// A frame of a stream, from its headers up to the point where its tiles would be read.
pub struct SavedFrame(FrameReader);

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
            let found = parser.read_obu(&obu).expect("a conformant stream");
            if let Some(Found::Coded(job)) = found {
                saved.push(SavedFrame(job.start().expect("its references")));
                job.run().expect("tiles");
            }
        }
    }
    saved
}

impl SavedFrame {
    /// Reads `data` as tile number `tile_num` (modulo the number of tiles), then does with the
    /// blocks what the parser does. Returns how many there are.
    ///
    /// # Panics
    /// The parser has a fault, or memory is used up.
    #[must_use]
    pub fn read_tile(&self, tile_num: u32, data: &[u8]) -> usize {
        let SavedFrame(reader) = self;
        let tile_num = tile_num % reader.context.header.tile_info.num_tiles();
        let Ok(tile) = reader.read_tile(tile_num, data) else {
            return 0;
        };
        let mut tiles = [tile];
        drop(reader.content(&mut tiles).expect("memory"));
        tiles[0].blocks.len()
    }
}
