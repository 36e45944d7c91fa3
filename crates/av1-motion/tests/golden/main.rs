//! Every block, header and transform of the corpus streams against libaom's inspection hook.
//!
//! `tests/data/corpus/expected.txt` is written by `tools/golden_digests.py` from libaom's output.
//! What only the feature `trace` tells is compared when the tests run with it.

mod blocks;
mod headers;
#[cfg(feature = "trace")]
mod transforms;

use std::fs;
use std::path::{Path, PathBuf};

use av1_motion::{ContainerReader, Frame, Limits, Parser};

/// Multiplier of the digest.
const PRIME: u64 = 0x100_0000_01b3;

fn corpus() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/corpus")
}

fn frames_of(stream: &Path) -> Vec<Frame> {
    let limits = Limits::default();
    let mut reader = ContainerReader::open(stream, &limits).expect("a readable stream");
    let mut parser = Parser::new(limits);
    let mut frames = Vec::new();
    while let Some(unit) = reader.next_unit().expect("an intact container") {
        parser.push(unit.data, unit.byte_offset);
        while let Some(frame) = parser.next_frame().expect("a conformant stream") {
            frames.push(frame);
        }
    }
    parser.finish().expect("a complete last frame");
    frames
}

/// `h = h * PRIME + value` modulo 2^64.
fn digest(values: &[i64]) -> u64 {
    values.iter().fold(0, |hash: u64, value| {
        hash.wrapping_mul(PRIME).wrapping_add(value.cast_unsigned())
    })
}

/// The line of a frame in `expected.txt`, without the stream's name.
fn line(record: usize, frame: &Frame) -> String {
    let info = frame.info();
    let facts = format!("{record} {} {}", frame.decode_index, info.order_hint);
    if info.show_existing_frame {
        return format!("{facts} shown");
    }
    let found = format!(
        "{facts} {} {:016x} {:016x}",
        frame.blocks().len(),
        digest(&blocks::values(frame)),
        digest(&headers::values(frame)),
    );
    #[cfg(feature = "trace")]
    let found = format!("{found} {:016x}", digest(&transforms::values(frame)));
    found
}

fn lines_of(stream: &Path) -> Vec<String> {
    frames_of(stream)
        .iter()
        .enumerate()
        .map(|(record, frame)| line(record, frame))
        .collect()
}

/// The expected lines of a stream, without what this build cannot tell.
fn expected_lines<'a>(expected: &'a str, stream: &str) -> Vec<&'a str> {
    expected
        .lines()
        .filter_map(|line| line.strip_prefix(stream)?.strip_prefix(' '))
        .map(|line| match line.rsplit_once(' ') {
            Some((rest, _)) if !cfg!(feature = "trace") && !line.ends_with("shown") => rest,
            _ => line,
        })
        .collect()
}

/// Streams whose frames are not what libaom decodes, with the first such frame.
fn different<'a>(streams: impl Iterator<Item = (&'a str, PathBuf)>) -> Vec<String> {
    let expected = fs::read_to_string(corpus().join("expected.txt")).expect("expected.txt");
    streams
        .filter_map(|(stream, path)| {
            let (found, wanted) = (lines_of(&path), expected_lines(&expected, stream));
            assert!(!wanted.is_empty(), "{stream} is expected");
            let pairs = || found.iter().zip(&wanted);
            let first = pairs().position(|(found, wanted)| found != wanted);
            (found != wanted).then(|| format!("{}: record {first:?}", path.display()))
        })
        .collect()
}

#[test]
fn every_frame_of_the_corpus_is_what_libaom_decodes() {
    let expected = fs::read_to_string(corpus().join("expected.txt")).expect("expected.txt");
    let mut streams: Vec<&str> = expected
        .lines()
        .filter_map(|line| line.split(' ').next())
        .collect();
    streams.dedup();
    assert!(streams.len() > 80, "the corpus is complete");
    let wrong = different(
        streams
            .iter()
            .map(|&stream| (stream, corpus().join(format!("{stream}.ivf")))),
    );
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn neither_containers_nor_strange_obus_nor_repeated_sequence_headers_change_a_frame() {
    let copies = [
        ("aom_good1_gm", "obu"),
        ("aom_good1_gm", "annexb.obu"),
        ("aom_good1_gm", "mixed.annexb.obu"),
        ("aom_fwdkf", "extra_obus.ivf"),
        ("aom_fwdkf", "rep_seqhdr.ivf"),
    ];
    let wrong = different(copies.iter().map(|&(stream, suffix)| {
        let name = format!("containers/{stream}.{suffix}");
        (stream, corpus().join(name))
    }));
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
