//! A temporal unit that never came, in an error resilient stream: nothing but its own frame is lost.

use std::path::Path;

use av1_motion::{ContainerReader, Error, Frame, Limits, Parser};

/// Frames and errors of a stream without one of its units.
fn without_unit(name: &str, lost: usize) -> (Vec<Frame>, Vec<Error>) {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/corpus");
    let limits = Limits::default();
    let mut reader = ContainerReader::open(corpus.join(name), &limits).unwrap();
    let mut parser = Parser::new(limits);
    let (mut frames, mut errors, mut index) = (Vec::new(), Vec::new(), 0);
    while let Some(unit) = reader.next_unit().unwrap() {
        if index != lost {
            parser.push(unit.data, unit.byte_offset);
            loop {
                match parser.next_frame() {
                    Ok(Some(frame)) => frames.push(frame),
                    Ok(None) => break,
                    Err(error) => errors.push(error),
                }
            }
        }
        index += 1;
    }
    (frames, errors)
}

#[test]
fn an_error_resilient_stream_goes_on_without_vectors_to_the_lost_frame() {
    let (frames, errors) = without_unit("../aom_error_resilient.ivf", 3);
    let shown: Vec<i64> = frames.iter().map(|frame| frame.display_index).collect();
    let lost = 3;
    assert!(errors.is_empty(), "{errors:?}");
    assert_eq!(shown, [0, 1, 2, 4, 5, 6, 7, 8, 9]);
    for frame in &frames {
        assert!(
            frame
                .motion()
                .all(|motion| motion.reference.display_index != lost)
        );
    }
}
