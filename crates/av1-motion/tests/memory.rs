//! Files of a few bytes that promise gigabytes: no memory is taken on a promise.

use std::fs;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

use av1_motion::{ContainerReader, Error, Limits, Parser};

mod counting;

#[global_allocator]
static ALLOCATOR: counting::Counting = counting::Counting;

/// The allocator counts for the whole process: one test at a time.
fn alone() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The largest request for memory while `run` runs, and what it returns.
fn largest<T>(run: impl FnOnce() -> T) -> (usize, T) {
    let _turn = alone();
    let live = counting::start();
    let result = run();
    (counting::usage(live).largest, result)
}

/// The first error of a file.
fn first_error(bytes: &[u8], limits: &Limits) -> Option<Error> {
    let mut reader = match ContainerReader::new(bytes, limits) {
        Ok(reader) => reader,
        Err(error) => return Some(error),
    };
    let mut parser = Parser::new(limits.clone());
    loop {
        match reader.next_unit() {
            Ok(Some(unit)) => parser.push(unit.data, unit.byte_offset),
            Ok(None) => return parser.finish().err(),
            Err(error) => return Some(error),
        }
        loop {
            match parser.next_frame() {
                Ok(Some(_)) => {}
                Ok(None) => break,
                Err(error) => return Some(error),
            }
        }
    }
}

/// An IVF file with one packet header that claims `size` bytes, and three bytes.
fn ivf_promise(size: u32) -> Vec<u8> {
    let mut bytes = b"DKIF\0\0\x20\0AV01\x40\x01\xf0\0".to_vec();
    bytes.resize(32, 1);
    bytes.extend(size.to_le_bytes());
    bytes.extend([0; 8]);
    bytes.extend([0x12, 0, 0]);
    bytes
}

#[test]
fn the_sizes_of_containers_are_not_believed() {
    let annexb = [0xff, 0xff, 0xff, 0xff, 0x0f, 0x07, 0x01, 0x10];
    let section5 = [0x12, 0x00, 0x32, 0xff, 0xff, 0xff, 0xff, 0x0f, 0x00];
    let below_the_limit = [0x12, 0x00, 0x32, 0x80, 0x80, 0x80, 0x7f, 0x00];
    let limits = Limits::default();
    for bytes in [
        &ivf_promise(u32::MAX)[..],
        &ivf_promise(200 << 20)[..],
        &annexb[..],
        &section5[..],
        &below_the_limit[..],
    ] {
        let (largest, error) = largest(|| first_error(bytes, &limits));
        assert!(error.is_some(), "{bytes:?}");
        assert!(largest < 1 << 20, "{largest} bytes for {bytes:?}");
    }
}

#[test]
fn a_claim_above_the_limit_is_told_with_the_limit() {
    let error = first_error(&ivf_promise(u32::MAX), &Limits::default());
    assert!(
        matches!(
            error,
            Some(Error::LimitExceeded {
                limit: "max_unit_bytes",
                value: 0xffff_ffff,
                ..
            })
        ),
        "{error:?}"
    );
}

/// Writes the bits of headers.
#[derive(Default)]
struct Bits(Vec<bool>);

impl Bits {
    fn put(&mut self, value: u32, count: u32) -> &mut Self {
        self.0
            .extend((0..count).rev().map(|bit| value >> bit & 1 == 1));
        self
    }

    /// The bytes; the last one is filled with zeros.
    fn bytes(&self) -> Vec<u8> {
        let byte = |bits: &[bool]| {
            (0..8).fold(0, |byte, bit| {
                byte << 1 | u8::from(bits.get(bit) == Some(&true))
            })
        };
        self.0.chunks(8).map(byte).collect()
    }
}

/// An OBU with a size of one or two bytes.
fn obu(kind: u8, payload: &[u8]) -> Vec<u8> {
    let size = u8::try_from(payload.len() & 0x7f).expect("seven bits");
    let high = u8::try_from(payload.len() >> 7).expect("a short OBU");
    [&[kind << 3 | 2, size | 0x80, high][..], payload].concat()
}

/// §5.5.1: the sequence header of one still picture.
fn still_sequence(width: u32, height: u32) -> Vec<u8> {
    let mut bits = Bits::default();
    // seq_profile, still_picture, reduced_still_picture_header, seq_level_idx.
    bits.put(0, 3).put(1, 1).put(1, 1).put(31, 5);
    bits.put(15, 4)
        .put(15, 4)
        .put(width - 1, 16)
        .put(height - 1, 16);
    // Six tools off, 8 bit colour, no film grain; trailing bits.
    bits.put(0, 6).put(0, 8).put(0, 0).put(1, 1);
    obu(1, &bits.bytes())
}

/// §5.9.1, §5.11.1: its frame with the smallest tiles (`finest`) or the largest ones, and some data.
fn still_frame(width: u32, height: u32, finest: bool, data: &[u8]) -> Vec<u8> {
    let log2 = |block: u32, target: u32| (0..32).find(|&k| block << k >= target).expect("a power");
    let (cols, rows) = (width.div_ceil(64), height.div_ceil(64));
    let (min_cols, max_cols) = (log2(64, cols), log2(1, cols.min(64)));
    let min_tiles = min_cols.max(log2(2304, cols * rows));
    let mut bits = Bits::default();
    // disable_cdf_update, allow_screen_content_tools, render_and_frame_size_different, uniform.
    bits.put(0, 3).put(1, 1);
    let mut axis = |min: u32, max: u32| {
        if finest {
            bits.put((1 << (max - min)) - 1, max - min);
        } else if min < max {
            bits.put(0, 1);
        }
        if finest { max } else { min }
    };
    let cols_log2 = axis(min_cols, max_cols);
    let rows_log2 = axis(min_tiles.saturating_sub(cols_log2), log2(1, rows.min(64)));
    if cols_log2 + rows_log2 > 0 {
        bits.put(0, cols_log2 + rows_log2).put(0, 2);
    }
    // base_q_idx, no deltas, no matrices, no segments, no delta q, no loop filter, tx_mode, tx set.
    bits.put(100, 8).put(0, 4).put(0, 2).put(0, 16).put(0, 2);
    let mut payload = bits.bytes();
    if cols_log2 + rows_log2 > 0 {
        payload.push(0); // tile_start_and_end_present_flag
    }
    payload.extend(data);
    obu(6, &payload)
}

fn still(width: u32, height: u32, finest: bool, data: &[u8]) -> Vec<u8> {
    let frame = still_frame(width, height, finest, data);
    [obu(2, &[]), still_sequence(width, height), frame].concat()
}

/// The first error of a unit.
fn unit_error(unit: Vec<u8>, limits: Limits) -> Option<Error> {
    let mut parser = Parser::new(limits);
    parser.push(unit, 0);
    loop {
        match parser.next_frame() {
            Ok(Some(_)) => {}
            Ok(None) => return parser.finish().err(),
            Err(error) => return Some(error),
        }
    }
}

#[test]
fn the_largest_frame_of_the_syntax_exceeds_the_default_limit() {
    let unit = still(65_536, 65_536, false, &[0; 9]);
    let (largest, error) = largest(|| unit_error(unit, Limits::default()));
    assert!(
        matches!(
            error,
            Some(Error::LimitExceeded {
                limit: "max_frame_area",
                value: 0x1_0000_0000,
                ..
            })
        ),
        "{error:?}"
    );
    assert!(largest < 100_000, "{largest} bytes");
}

#[test]
fn the_largest_frame_costs_no_more_than_its_first_tile() {
    let limits = Limits {
        max_frame_area: u64::MAX,
        max_unit_samples: u64::MAX,
        ..Limits::default()
    };
    // 512 tiles of 4096x2048, of one byte each.
    let unit = still(65_536, 65_536, false, &[0; 1024]);
    let (largest, error) = largest(|| unit_error(unit, limits));
    assert!(matches!(error, Some(Error::Malformed { .. })), "{error:?}");
    assert!((1 << 20..4 << 20).contains(&largest), "{largest} bytes");
}

#[test]
fn thousands_of_tiles_in_a_few_bytes_are_malformed_or_too_many() {
    let unit = still(4096, 4096, true, &[0; 8192]);
    let (largest, error) = largest(|| unit_error(unit.clone(), Limits::default()));
    assert!(matches!(error, Some(Error::Malformed { .. })), "{error:?}");
    assert!(largest < 1 << 20, "{largest} bytes");
    let limits = Limits {
        max_tiles: 16,
        ..Limits::default()
    };
    let error = unit_error(unit, limits);
    assert!(
        matches!(
            error,
            Some(Error::LimitExceeded {
                limit: "max_tiles",
                value: 4096,
                ..
            })
        ),
        "{error:?}"
    );
}

#[test]
fn a_unit_of_the_smallest_obus_takes_no_more_memory_than_its_bytes() {
    let unit = [0x7a, 0].repeat(1 << 20);
    let _turn = alone();
    let live = counting::start();
    assert!(unit_error(unit, Limits::default()).is_none());
    let peak = counting::usage(live).peak;
    assert!(peak < 1 << 20, "{peak} bytes");
}

#[test]
fn a_unit_of_empty_frame_headers_ends_at_its_budget() {
    let limits = Limits {
        max_unit_samples: 1 << 20,
        ..Limits::default()
    };
    let mut parser = Parser::new(limits);
    parser.push([0x32, 0].repeat(1000), 0);
    let mut over_budget = 0;
    for _ in 0..1000 {
        if let Err(Error::LimitExceeded { limit, .. }) = parser.next_frame() {
            assert_eq!(limit, "max_unit_samples");
            over_budget += 1;
        }
    }
    assert_eq!(over_budget, 1000 - (1 << 20) / (64 * 64));
}

#[test]
fn real_streams_stay_below_the_documented_memory() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/corpus");
    let _turn = alone();
    for entry in fs::read_dir(folder).expect("the corpus") {
        let path = entry.expect("an entry").path();
        if path.extension().is_none_or(|extension| extension != "ivf") {
            continue;
        }
        let bytes = fs::read(&path).expect("a stream");
        let (mut area, mut unit_bytes) = (0, 0);
        let live = counting::start();
        let mut reader = ContainerReader::new(&bytes[..], &Limits::default()).expect("IVF");
        let mut parser = Parser::new(Limits::default());
        while let Some(unit) = reader.next_unit().expect("an intact container") {
            unit_bytes = unit_bytes.max(unit.data.len());
            parser.push(unit.data, unit.byte_offset);
            while let Some(frame) = parser.next_frame().expect("a conformant stream") {
                let info = frame.info();
                // Frames are coded in whole superblocks.
                let padded = |length: u32| length.next_multiple_of(64) as usize;
                area = area.max(padded(info.upscaled_width) * padded(info.frame_height));
            }
        }
        let peak = counting::usage(live).peak;
        // 16 bytes per sample, the unit three times, and what does not depend on the stream: eight
        // sets of probabilities, the one in use, the window of the reader.
        let allowed = 16 * area + 3 * unit_bytes + 500_000;
        assert!(peak <= allowed, "{}: {peak} > {allowed}", path.display());
    }
}

#[test]
fn a_list_of_blocks_grows_by_no_more_than_nine_bytes_per_sample() {
    // One block for each 4x4 samples, and lists that double.
    assert!(2 * size_of::<av1_motion::Block>() <= 9 * 16);
}

#[test]
fn frames_that_wait_for_threads_hold_no_more_than_64_mb_of_their_units() {
    const UNITS: usize = 24;
    // 16 empty tiles of 4096x2048: slow to read, beside units that come fast.
    let tile = [&[0; 72][..], &[1]].concat();
    let sized = [&[72][..], &tile].concat();
    let picture = still(16_384, 8192, false, &[sized.repeat(15), tile].concat());
    let limits = Limits {
        max_frame_area: 1 << 27,
        ..Limits::default()
    };
    let _turn = alone();
    let live = counting::start();
    let mut parser = Parser::new(limits).with_threads(2);
    let mut frames = 0;
    for _ in 0..UNITS {
        // A padding OBU of 8 MB, with a size of four bytes.
        let mut unit = Vec::with_capacity((8 << 20) + 8192);
        unit.extend([0x7a, 0x80, 0x80, 0x80, 0x04]);
        unit.resize(unit.len() + (8 << 20), 0x80);
        unit.extend(&picture);
        parser.push(unit, 0);
        while let Some(_frame) = parser.next_frame().expect("a conformant stream") {
            frames += 1;
        }
    }
    parser.finish().expect("complete frames");
    while let Some(_frame) = parser.next_frame().expect("a conformant stream") {
        frames += 1;
    }
    assert_eq!(frames, UNITS);
    let peak = counting::usage(live).peak;
    assert!(peak < 120 << 20, "{peak} bytes");
}
