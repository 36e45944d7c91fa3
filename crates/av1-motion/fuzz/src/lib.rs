//! What the fuzz targets share.

use std::fs;
use std::path::Path;
use std::sync::OnceLock;

use av1_motion::{ContainerReader, Frame, Limits, Parser};

#[path = "../../tests/damage/mod.rs"]
pub mod damage;

/// Small pictures: time goes into variety.
pub fn limits() -> Limits {
    Limits {
        max_frame_area: 1 << 20,
        max_unit_bytes: 1 << 24,
        max_unit_samples: 1 << 24,
        max_samples: Some(1 << 26),
        ..Limits::default()
    }
}

/// The golden corpus, in the order of the names.
pub fn corpus() -> &'static [Vec<u8>] {
    static STREAMS: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    STREAMS.get_or_init(|| {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../tests/data/corpus");
        let mut paths: Vec<_> = fs::read_dir(folder)
            .expect("the corpus")
            .map(|entry| entry.expect("an entry").path())
            .filter(|path| path.extension().is_some_and(|extension| extension == "ivf"))
            .collect();
        paths.sort();
        paths
            .iter()
            .map(|path| fs::read(path).expect("a stream"))
            .collect()
    })
}

/// Those streams of the corpus that are read quickly.
pub fn small_streams() -> &'static [&'static [u8]] {
    static SMALL: OnceLock<Vec<&[u8]>> = OnceLock::new();
    SMALL.get_or_init(|| {
        let streams = corpus().iter().map(Vec::as_slice);
        streams.filter(|stream| stream.len() < 16_000).collect()
    })
}

/// Reads a whole file and goes on after errors, as `errors="resume"` does.
pub fn read(bytes: &[u8]) -> Vec<Frame> {
    let limits = limits();
    let mut frames = Vec::new();
    let Ok(mut reader) = ContainerReader::new(bytes, &limits) else {
        return frames;
    };
    let mut parser = Parser::new(limits);
    while let Ok(Some(unit)) = reader.next_unit() {
        parser.push(unit.data, unit.byte_offset);
        drain(&mut parser, &mut frames);
    }
    let _ = parser.finish();
    frames
}

/// Takes all frames of the unit that was pushed, and looks at everything in them.
pub fn drain(parser: &mut Parser, frames: &mut Vec<Frame>) {
    loop {
        match parser.next_frame() {
            Ok(Some(frame)) => {
                for motion in frame.motion() {
                    assert!(motion.mv.iter().all(|component| component.is_finite()));
                }
                let _ = frame.info();
                frames.push(frame);
            }
            Ok(None) => return,
            Err(error) => drop(error.to_string()),
        }
    }
}
