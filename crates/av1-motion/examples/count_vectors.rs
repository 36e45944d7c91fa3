//! Counts the frames, blocks and vectors of AV1 files: `count_vectors FILE [REPETITIONS [THREADS]]`.
#![allow(clippy::print_stdout, reason = "an example talks to its user")]

use av1_motion::{ContainerReader, Frame, Limits, Parser, Result};

/// Frames, blocks and vectors of one file.
fn count(path: &str, threads: usize) -> Result<[usize; 3]> {
    let limits = Limits::default();
    let mut reader = ContainerReader::open(path, &limits)?;
    let mut parser = Parser::new(limits).with_threads(threads);
    let mut totals = [0; 3];
    let mut add = |frame: &Frame| {
        totals[0] += 1;
        totals[1] += frame.blocks().len();
        totals[2] += frame.motion().count();
    };
    while let Some(unit) = reader.next_unit()? {
        parser.push(unit.data, unit.byte_offset);
        while let Some(frame) = parser.next_frame()? {
            add(&frame);
        }
    }
    parser.finish()?;
    while let Some(frame) = parser.next_frame()? {
        add(&frame);
    }
    Ok(totals)
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some(path) = arguments.first() else {
        println!("usage: count_vectors FILE [REPETITIONS [THREADS]]");
        return Ok(());
    };
    let number = |index: usize| arguments.get(index)?.parse().ok();
    let (repetitions, threads) = (number(1).unwrap_or(1), number(2).unwrap_or(1));
    for _ in 0..repetitions {
        let [frames, blocks, vectors] = count(path, threads)?;
        println!("{frames} frames, {blocks} blocks, {vectors} vectors");
    }
    Ok(())
}
