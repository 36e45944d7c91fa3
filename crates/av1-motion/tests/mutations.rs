//! Streams damaged at random: no panic, no memory beyond the limits, and exact up to the damage.
//!
//! `make fuzz-long` runs longer: `MUTATIONS` is the number of files, `SEED` varies the damage,
//! `STREAMS` names more folders of streams, separated by colons.
#![allow(clippy::print_stderr, reason = "the evidence is printed")]

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use av1_motion::{ContainerReader, Frame, Limits, Parser};

use damage::{Random, mutate_bytes, structure};

mod counting;
mod damage;

#[global_allocator]
static ALLOCATOR: counting::Counting = counting::Counting;

/// Bytes of one allocation for each luma sample of the largest frame, as `docs/reliability.md` says.
const BYTES_PER_SAMPLE: u64 = 9;

/// One undamaged stream and what it holds.
struct Original {
    path: PathBuf,
    bytes: Vec<u8>,
    /// First byte behind each unit.
    unit_ends: Vec<u64>,
    /// Unit and digest of each frame.
    frames: Vec<(u64, u64)>,
}

fn originals() -> Vec<Original> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/corpus");
    let more = std::env::var("STREAMS").unwrap_or_default();
    let folders = more.split(':').filter(|folder| !folder.is_empty());
    let folders = std::iter::once(corpus).chain(folders.map(PathBuf::from));
    let mut originals: Vec<_> = folders
        .flat_map(|folder| fs::read_dir(folder).expect("a folder of streams"))
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|e| e == "ivf" || e == "obu"))
        .map(|path| {
            let bytes = fs::read(&path).expect("a stream");
            let mut unit_ends = Vec::new();
            let frames = read(&bytes, &Limits::default(), 1, &mut unit_ends);
            Original {
                path,
                bytes,
                unit_ends,
                frames,
            }
        })
        .collect();
    originals.sort_by(|a, b| a.path.cmp(&b.path));
    originals
}

/// A number that two frames share only if they are the same.
fn digest(frame: &Frame) -> u64 {
    let mut digest = 0xcbf2_9ce4_8422_2325_u64;
    let mut add = |value: u64| digest = (digest ^ value).wrapping_mul(0x100_0000_01b3);
    for block in frame.blocks() {
        add(u64::from(block.mi_row) << 32 | u64::from(block.mi_col));
        add(u64::from(block.size) << 16 | u64::from(block.y_mode) << 8 | u64::from(block.tx_size));
        add(u64::from(block.luma_level) << 8 | u64::from(block.segment_id));
    }
    for motion in frame.motion() {
        add(u64::from(motion.mv[0].to_bits()) << 32 | u64::from(motion.mv[1].to_bits()));
        add(motion.reference.decode_index << 16 | u64::from(motion.flags));
    }
    digest
}

/// Unit and digest of every frame; goes on after errors.
fn read(
    bytes: &[u8],
    limits: &Limits,
    threads: usize,
    unit_ends: &mut Vec<u64>,
) -> Vec<(u64, u64)> {
    let mut frames = Vec::new();
    let Ok(mut reader) = ContainerReader::new(bytes, limits) else {
        return frames;
    };
    let mut parser = Parser::new(limits.clone()).with_threads(threads);
    while let Ok(Some(unit)) = reader.next_unit() {
        unit_ends.push(unit.byte_offset + unit.data.len() as u64);
        parser.push(unit.data, unit.byte_offset);
        drain(&mut parser, &mut frames);
    }
    let _ = parser.finish();
    drain(&mut parser, &mut frames);
    frames
}

/// Takes every frame there is.
fn drain(parser: &mut Parser, frames: &mut Vec<(u64, u64)>) {
    loop {
        match parser.next_frame() {
            Ok(Some(frame)) => frames.push((frame.unit_index, digest(&frame))),
            Ok(None) => return,
            Err(error) => drop(error.to_string()),
        }
    }
}

/// Units that the damage left alone, with the sizes that follow them.
fn whole_units(original: &Original, damaged: &[u8]) -> u64 {
    let pairs = original.bytes.iter().zip(damaged);
    let same = pairs.take_while(|(a, b)| a == b).count() as u64;
    let ends = original.unit_ends.iter();
    (ends.take_while(|&&end| end <= same).count() as u64).saturating_sub(1)
}

/// Limits of a small device, or the default ones with a bound on the time.
fn limits(random: &mut Random) -> Limits {
    let (area, unit) =
        [(1 << 20, 1 << 24), (35_651_584, 71_303_168)][usize::from(random.below(8) == 0)];
    Limits {
        max_frame_area: area,
        max_unit_samples: unit,
        max_samples: Some(4 * unit),
        ..Limits::default()
    }
}

fn variable(name: &str, default: u64) -> u64 {
    let value = std::env::var(name).ok();
    value
        .and_then(|value| value.parse().ok())
        .unwrap_or(default)
}

/// The most that was seen of something, and where.
#[derive(Default)]
struct Record<T>(T, String);

impl<T: PartialOrd> Record<T> {
    fn raise(&mut self, value: T, number: u64, path: &Path) {
        if value > self.0 {
            *self = Self(value, format!("file {number}, from {}", path.display()));
        }
    }
}

#[test]
fn damage_never_panics_nor_exceeds_the_limits_nor_changes_what_comes_before() {
    let originals = originals();
    let mut random = Random::new(variable("SEED", 1));
    let mut slowest = Record::<Duration>::default();
    let mut largest = Record::<usize>::default();
    let mut peak = Record::<usize>::default();
    let mut compared = 0;
    let count = variable("MUTATIONS", 400);
    for number in 0..count {
        let original = &originals[random.below(originals.len())];
        let other = &originals[random.below(originals.len())].bytes;
        let by_structure = (random.below(2) == 0)
            .then(|| structure::mutate(&original.bytes, other, &mut random))
            .flatten();
        let bytes = by_structure.unwrap_or_else(|| {
            let mut bytes = original.bytes.clone();
            mutate_bytes(&mut bytes, other, &mut random);
            bytes
        });
        let limits = limits(&mut random);
        let threads = 1 + usize::from(random.below(4) == 0);
        let live = counting::start();
        let start = Instant::now();
        let outcome = catch_unwind(AssertUnwindSafe(|| {
            read(&bytes, &limits, threads, &mut Vec::new())
        }));
        let usage = counting::usage(live);
        slowest.raise(start.elapsed(), number, &original.path);
        largest.raise(usage.largest, number, &original.path);
        peak.raise(usage.peak, number, &original.path);
        let whole = whole_units(original, &bytes);
        let before = |frames: &[(u64, u64)]| -> Vec<_> {
            frames
                .iter()
                .filter(|(unit, _)| *unit < whole)
                .copied()
                .collect()
        };
        let expected = before(&original.frames);
        compared += expected.len();
        let allowed = (limits.max_frame_area * BYTES_PER_SAMPLE).max(8 * bytes.len() as u64);
        let verdict = match outcome {
            Err(_) => "a panic",
            Ok(frames) if before(&frames) != expected => "other frames before the damage",
            Ok(_) if usage.largest as u64 > allowed => "too large an allocation",
            Ok(_) => continue,
        };
        let kept = std::env::temp_dir().join(format!("mutation-{number}.ivf"));
        fs::write(&kept, &bytes).expect("a place for the evidence");
        panic!(
            "{verdict}: {} of {}, {usage:?}",
            kept.display(),
            original.path.display()
        );
    }
    eprintln!("{count} files, {compared} frames before the damage compared");
    eprintln!("slowest: {:?}, {}", slowest.0, slowest.1);
    eprintln!("largest allocation: {} bytes, {}", largest.0, largest.1);
    eprintln!("most memory: {} bytes, {}", peak.0, peak.1);
}
