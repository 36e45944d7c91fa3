//! One tile's bytes under the headers of a real frame: any bytes are a tile, up to some point.
//!
//! Two bytes choose the frame, one the tile; the rest is its data.
#![no_main]

use std::sync::OnceLock;

use av1_motion::fuzzing::{SavedFrame, saved_frames};
use libfuzzer_sys::fuzz_target;

/// Frames of the golden corpus, of at most 20 from each stream.
fn frames() -> &'static [SavedFrame] {
    static FRAMES: OnceLock<Vec<SavedFrame>> = OnceLock::new();
    FRAMES.get_or_init(|| {
        let limits = fuzz_support::limits();
        let streams = fuzz_support::corpus().iter();
        streams
            .flat_map(|stream| saved_frames(stream, &limits).into_iter().take(20))
            .collect()
    })
}

// The frames are read before the clock of the first input runs.
fuzz_target!(init: { let _ = frames(); }, |data: &[u8]| {
    let [low, high, tile, data @ ..] = data else {
        return;
    };
    if data.is_empty() {
        return;
    }
    let frames = frames();
    let frame = &frames[usize::from(u16::from_le_bytes([*low, *high])) % frames.len()];
    let _ = frame.read_tile(u32::from(*tile), data);
});
