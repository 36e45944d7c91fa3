//! Damaged streams: whatever the bytes, the parser returns frames or an error, and what it returns
//! from before the damage is what it returns without. `tests/mutations.rs` damages at random.
//!
//! `CUT_STEP=1` cuts short streams at every byte.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use av1_motion::{ContainerReader, Error, Frame, Limits, Parser};

use damage::stream::packet_ranges;

mod damage;

fn streams() -> Vec<(PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/corpus");
    let mut streams: Vec<_> = fs::read_dir(folder)
        .expect("the corpus")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "ivf"))
        .map(|path| (path.clone(), fs::read(path).expect("a stream")))
        .collect();
    streams.sort();
    streams
}

/// Frames read, and how many errors were met; goes on after errors, as `errors="resume"` would.
fn read(bytes: &[u8]) -> (Vec<Frame>, usize) {
    let limits = Limits {
        max_frame_area: 1 << 20,
        ..Limits::default()
    };
    let (mut frames, mut errors) = (Vec::new(), 0);
    let Ok(mut reader) = ContainerReader::new(bytes, &limits) else {
        return (frames, 1);
    };
    let mut parser = Parser::new(limits);
    loop {
        match reader.next_unit() {
            Ok(Some(unit)) => parser.push(unit.data, unit.byte_offset),
            Ok(None) => break,
            Err(_) => {
                errors += 1;
                break;
            }
        }
        loop {
            match parser.next_frame() {
                Ok(Some(frame)) => {
                    let _ = frame.motion().count();
                    frames.push(frame);
                }
                Ok(None) => break,
                Err(_) => errors += 1,
            }
        }
    }
    errors += usize::from(parser.finish().is_err());
    (frames, errors)
}

fn variable(name: &str, default: u64) -> u64 {
    std::env::var(name)
        .ok()
        .and_then(|value| value.parse().ok())
        .unwrap_or(default)
}

#[test]
fn a_cut_stream_gives_the_frames_before_the_cut() {
    let step = usize::try_from(variable("CUT_STEP", 97)).expect("a step");
    for (path, bytes) in streams().iter().filter(|(_, bytes)| bytes.len() < 12_000) {
        let (whole, errors) = read(bytes);
        assert_eq!(errors, 0, "{}", path.display());
        for end in (0..bytes.len()).step_by(step) {
            let (frames, _) = read(&bytes[..end]);
            let same = frames.iter().zip(&whole).all(|(cut, whole)| {
                cut.decode_index == whole.decode_index && cut.motion().eq(whole.motion())
            });
            assert!(
                frames.len() <= whole.len() && same,
                "{} cut at {end}",
                path.display()
            );
        }
    }
}

#[test]
fn after_a_lost_frame_every_frame_is_exact_or_refused() {
    let mut resumed = 0;
    for (path, original) in streams() {
        let (whole, _) = read(&original);
        let units = packet_ranges(&original);
        for (number, unit) in units.iter().enumerate().step_by(3) {
            let mut bytes = original.clone();
            bytes[unit.start + unit.len() / 2..unit.end].fill(0x5a);
            let (frames, errors) = read(&bytes);
            // A frame and its place in the stream; counts shift when a header is lost.
            let key = |frame: &Frame| (frame.unit_index, frame.info().order_hint, frame.spatial_id);
            let is_exact = |frame: &Frame| {
                let same =
                    |other: &&Frame| key(other) == key(frame) && other.blocks() == frame.blocks();
                whole.iter().any(|other| same(&other))
            };
            let (damaged, others): (Vec<&Frame>, Vec<&Frame>) = frames
                .iter()
                .partition(|frame| frame.unit_index == number as u64);
            if errors == 0 || !damaged.iter().all(|frame| is_exact(frame)) {
                continue; // The damage looks like a stream; nothing can tell.
            }
            for frame in &others {
                assert!(
                    is_exact(frame),
                    "{} unit {number}: {:?}",
                    path.display(),
                    key(frame)
                );
            }
            resumed += others
                .iter()
                .filter(|frame| frame.unit_index > number as u64)
                .count();
        }
    }
    assert!(
        resumed > 100,
        "only {resumed} frames were read after damage"
    );
}

#[test]
fn files_that_once_broke_the_parser_do_so_no_more() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/bugs");
    for entry in fs::read_dir(folder).expect("the folder") {
        let bytes = fs::read(entry.expect("an entry").path()).expect("a file");
        let _ = read(&bytes);
    }
}

#[test]
fn an_interrupted_frame_is_lost_and_the_next_key_frame_is_read() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/corpus");
    let bytes = fs::read(folder.join("svtnew_p4.ivf")).expect("the stream");
    let units = packet_ranges(&bytes);
    let mut parser = Parser::new(Limits::default());
    let asked = Arc::new(AtomicUsize::new(0));
    let count = asked.clone();
    parser.interrupt_when(move || count.fetch_add(1, Ordering::Relaxed) == 1);
    let mut read = |unit: usize| {
        parser.push(bytes[units[unit].clone()].to_vec(), 0);
        parser
            .next_frame()
            .map(|frame| frame.is_some_and(|frame| frame.is_intra()))
    };
    // The second question is answered with yes.
    assert!(matches!(read(0), Err(Error::Interrupted)));
    assert_eq!(asked.load(Ordering::Relaxed), 2);
    assert!(matches!(read(1), Err(Error::MissingReference { .. })));
    assert!(matches!(read(0), Ok(true)));
}
