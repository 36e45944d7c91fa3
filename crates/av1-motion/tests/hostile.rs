//! Damaged streams: whatever the bytes, the parser returns frames or an error.
//!
//! `MUTATIONS=100000 cargo test --release --test hostile` runs longer and tells the slowest
//! file; `SEED` varies the damage.

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use av1_motion::{ContainerReader, Frame, Limits, Parser};

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

/// A small generator of reproducible damage (xorshift).
struct Random(u64);

impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        usize::try_from(self.0 >> 16).expect("48 bits") % bound.max(1)
    }
}

/// Flips bits, overwrites, removes, repeats or splices bytes.
fn mutate(bytes: &mut Vec<u8>, other: &[u8], random: &mut Random) {
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len());
        let span = random.below(64).min(bytes.len() - at);
        match random.below(6) {
            0 | 1 => bytes[at] ^= 1 << random.below(8),
            2 => bytes[at..at + span].fill([0, 0xff][random.below(2)]),
            3 => drop(bytes.drain(at..at + span)),
            4 => {
                let copy = bytes[at..at + span].to_vec();
                let to = random.below(bytes.len());
                bytes.splice(to..to, copy);
            }
            _ => {
                let from = random.below(other.len());
                let part = &other[from..other.len().min(from + 200)];
                let end = bytes.len().min(at + part.len());
                bytes.splice(at..end, part.iter().copied());
            }
        }
        if bytes.is_empty() {
            bytes.push(0);
        }
    }
}

fn variable(name: &str, default: u64) -> u64 {
    std::env::var(name)
        .ok()
        .and_then(|value| value.parse().ok())
        .unwrap_or(default)
}

#[test]
fn damaged_streams_never_panic() {
    let streams = streams();
    let mut random = Random(variable("SEED", 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
    let mut slowest = Duration::ZERO;
    for number in 0..variable("MUTATIONS", 400) {
        let (path, original) = &streams[random.below(streams.len())];
        let other = &streams[random.below(streams.len())].1;
        let mut bytes = original.clone();
        mutate(&mut bytes, other, &mut random);
        let start = Instant::now();
        let outcome = catch_unwind(AssertUnwindSafe(|| read(&bytes)));
        slowest = slowest.max(start.elapsed());
        if outcome.is_err() {
            let kept = std::env::temp_dir().join(format!("hostile-{number}.ivf"));
            fs::write(&kept, &bytes).expect("a place for the evidence");
            panic!(
                "mutation {number} of {}: see {}",
                path.display(),
                kept.display()
            );
        }
    }
}

#[test]
fn a_cut_stream_gives_the_frames_before_the_cut() {
    for (path, bytes) in streams().iter().filter(|(_, bytes)| bytes.len() < 12_000) {
        let (whole, errors) = read(bytes);
        assert_eq!(errors, 0, "{}", path.display());
        for end in (0..bytes.len()).step_by(97) {
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

/// Units of an IVF file as byte ranges of their data.
fn unit_ranges(bytes: &[u8]) -> Vec<std::ops::Range<usize>> {
    let (mut ranges, mut at) = (Vec::new(), 32);
    while let Some(size) = bytes.get(at..at + 4) {
        let size = u32::from_le_bytes(size.try_into().expect("four bytes")) as usize;
        ranges.push(at + 12..at + 12 + size);
        at += 12 + size;
    }
    ranges
}

#[test]
fn after_a_lost_frame_every_frame_is_exact_or_refused() {
    let mut resumed = 0;
    for (path, original) in streams() {
        let (whole, _) = read(&original);
        let units = unit_ranges(&original);
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
