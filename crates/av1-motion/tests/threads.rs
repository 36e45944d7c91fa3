//! Any number of threads gives the same frames and the same errors in the same order.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use av1_motion::{ContainerReader, Error, Frame, Limits, Parser};

fn corpus() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/corpus");
    let mut streams: Vec<_> = fs::read_dir(folder)
        .expect("the corpus")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "ivf"))
        .collect();
    streams.sort();
    streams
}

/// What a caller can see of a frame.
fn facts(frame: &Frame) -> String {
    let sums = frame.motion().map(|motion| {
        i64::from(motion.block[0]) * 31
            + i64::from(motion.block[1]) * 17
            + i64::from(motion.mv[0].to_bits()) * 7
            + i64::from(motion.mv[1].to_bits())
            + motion.reference.display_index * 1009
    });
    format!(
        "{} {} {} {:?} {:?} {} {} {:?}",
        frame.decode_index,
        frame.display_index,
        frame.unit_index,
        frame.references,
        frame.info(),
        frame.blocks().len(),
        sums.fold(0_i64, |sum, value| sum.wrapping_mul(31).wrapping_add(value)),
        frame.coefficient_stats(),
    )
}

/// Takes what the parser has; goes on after errors.
fn take(parser: &mut Parser, seen: &mut Vec<String>) {
    loop {
        match parser.next_frame() {
            Ok(Some(frame)) => seen.push(facts(&frame)),
            Ok(None) => return,
            Err(error) => seen.push(error.to_string()),
        }
    }
}

/// Everything that comes of a file.
fn read(bytes: &[u8], threads: usize) -> Vec<String> {
    let mut seen = Vec::new();
    let mut reader = ContainerReader::new(bytes, &Limits::default()).expect("a container");
    let mut parser = Parser::new(Limits::default()).with_threads(threads);
    while let Ok(Some(unit)) = reader.next_unit() {
        parser.push(unit.data, unit.byte_offset);
        take(&mut parser, &mut seen);
    }
    if let Err(error) = parser.finish() {
        seen.push(error.to_string());
    }
    take(&mut parser, &mut seen);
    seen
}

/// An IVF file that holds the same stream several times.
fn repeated(bytes: &[u8], times: usize) -> Vec<u8> {
    let mut file = bytes[..32].to_vec();
    for _ in 0..times {
        file.extend_from_slice(&bytes[32..]);
    }
    file
}

#[test]
fn every_stream_is_the_same_for_any_number_of_threads() {
    for path in corpus() {
        let bytes = fs::read(&path).expect("a stream");
        let alone = read(&bytes, 1);
        assert!(!alone.is_empty());
        for threads in [2, 5] {
            assert_eq!(
                read(&bytes, threads),
                alone,
                "{} threads, {}",
                threads,
                path.display()
            );
        }
    }
}

#[test]
fn segments_are_read_together_and_come_in_order() {
    for path in corpus().iter().step_by(9) {
        let bytes = repeated(&fs::read(path).expect("a stream"), 12);
        assert_eq!(read(&bytes, 3), read(&bytes, 1), "{}", path.display());
    }
}

#[test]
fn damage_gives_the_same_errors_in_the_same_places() {
    for (number, path) in corpus().iter().enumerate() {
        let mut bytes = repeated(&fs::read(path).expect("a stream"), 2);
        for place in 1..6 {
            let at = 44 + (bytes.len() - 45) * place / 6 + number % 7;
            bytes[at] ^= 1 << (number % 8);
        }
        let alone = read(&bytes, 1);
        assert_eq!(read(&bytes, 2), alone, "{}", path.display());
        bytes.truncate(bytes.len() - 10 - number);
        assert_eq!(read(&bytes, 4), read(&bytes, 1), "{}", path.display());
    }
}

#[test]
fn an_interrupt_ends_what_was_begun_and_reading_can_go_on() {
    let path = corpus().pop().expect("a stream");
    let bytes = fs::read(path).expect("a stream");
    let stop = Arc::new(AtomicBool::new(true));
    let asked = stop.clone();
    let mut parser = Parser::new(Limits::default()).with_threads(2);
    parser.interrupt_when(move || asked.load(Ordering::Relaxed));
    let push_all = |parser: &mut Parser| {
        let mut reader = ContainerReader::new(&bytes[..], &Limits::default()).expect("a container");
        let (mut frames, mut interrupts) = (0, 0);
        while let Ok(Some(unit)) = reader.next_unit() {
            parser.push(unit.data, unit.byte_offset);
            loop {
                match parser.next_frame() {
                    Ok(Some(_)) => frames += 1,
                    Ok(None) => break,
                    Err(Error::Interrupted) => interrupts += 1,
                    Err(Error::MissingReference { .. }) => {}
                    Err(error) => panic!("{error}"),
                }
            }
        }
        (frames, interrupts)
    };
    push_all(&mut parser);
    parser.finish().expect("a whole stream");
    while matches!(parser.next_frame(), Ok(Some(_)) | Err(Error::Interrupted)) {}
    stop.store(false, Ordering::Relaxed);
    let (mut frames, interrupts) = push_all(&mut parser);
    parser.finish().expect("a whole stream");
    while let Ok(Some(_)) = parser.next_frame() {
        frames += 1;
    }
    assert_eq!(
        frames,
        read(&bytes, 1).len(),
        "all from the next key frame on"
    );
    assert_eq!(interrupts, 0);
}

#[test]
fn a_parser_that_is_dropped_waits_for_nobody() {
    let bytes = repeated(&fs::read(&corpus()[0]).expect("a stream"), 30);
    let mut reader = ContainerReader::new(&bytes[..], &Limits::default()).expect("a container");
    let mut parser = Parser::new(Limits::default()).with_threads(3);
    while let Ok(Some(unit)) = reader.next_unit() {
        parser.push(unit.data, unit.byte_offset);
        let _ = parser.next_frame();
    }
    drop(parser);
}
