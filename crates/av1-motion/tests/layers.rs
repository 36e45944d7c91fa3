//! Scalable streams: what an operating point leaves out, and which frames are meant to be seen.

use std::path::{Path, PathBuf};

use av1_motion::{ContainerReader, Error, Frame, Limits, Parser};

fn stream(name: &str) -> PathBuf {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/corpus");
    corpus.join(format!("{name}.ivf"))
}

fn frames_of(path: &Path, operating_point: usize) -> Result<Vec<Frame>, Error> {
    let limits = Limits::default();
    let mut reader = ContainerReader::open(path, &limits)?;
    let mut parser = Parser::new(limits).with_operating_point(operating_point);
    let mut frames = Vec::new();
    while let Some(unit) = reader.next_unit()? {
        parser.push(unit.data, unit.byte_offset);
        while let Some(frame) = parser.next_frame()? {
            frames.push(frame);
        }
    }
    parser.finish()?;
    Ok(frames)
}

/// Every frame of the operating point is what the first operating point, compared with libaom by the
/// golden test, has for the same layers. The counts are those that dav1d and aomdec show.
fn check_subset(name: &str, operating_point: usize, num_frames: usize) {
    let all = frames_of(&stream(name), 0).unwrap();
    let some = frames_of(&stream(name), operating_point).unwrap();
    let idc = all[0].sequence_info().operating_point_idc[operating_point];
    let expected: Vec<&Frame> = all
        .iter()
        .filter(|frame| idc >> frame.temporal_id & 1 == 1)
        .filter(|frame| idc >> (8 + frame.spatial_id) & 1 == 1)
        .collect();
    assert_eq!(some.len(), num_frames);
    assert_eq!(expected.len(), num_frames);
    for (found, expected) in some.iter().zip(expected) {
        assert_eq!(found.blocks(), expected.blocks());
        assert_eq!(found.info().base_q_idx, expected.info().base_q_idx);
        assert_eq!(found.coefficient_stats(), expected.coefficient_stats());
    }
}

#[test]
fn an_operating_point_has_the_frames_of_its_temporal_layers_and_no_others() {
    check_subset("svc_L1T2_er", 1, 6);
    check_subset("svc_L1T3", 1, 8);
    check_subset("svc_L1T3", 2, 4);
}

#[test]
fn an_operating_point_without_the_upper_spatial_layer_has_small_pictures_only() {
    check_subset("svc_L2T1", 1, 10);
    let frames = frames_of(&stream("svc_L2T1"), 1).unwrap();
    assert!(
        frames
            .iter()
            .all(|frame| frame.info().upscaled_width == 160)
    );
    assert!(frames.iter().all(|frame| frame.is_output));
}

#[test]
fn of_the_layers_of_one_picture_the_highest_is_seen() {
    let frames = frames_of(&stream("svc_L2T1"), 0).unwrap();
    for (index, picture) in frames.chunks(2).enumerate() {
        let [below, above] = picture else {
            panic!("two layers");
        };
        assert_eq!((below.spatial_id, below.is_output), (0, false));
        assert_eq!((above.spatial_id, above.is_output), (1, true));
        assert_eq!(
            [below, above].map(|frame| frame.display_index),
            [i64::try_from(index).unwrap(); 2]
        );
    }
}

#[test]
fn no_vector_points_from_one_layer_of_a_picture_to_another() {
    for frame in frames_of(&stream("svc_L2T1"), 0).unwrap() {
        let mut references = frame.motion().map(|motion| motion.reference.display_index);
        assert!(references.all(|index| index != frame.display_index));
    }
}

#[test]
fn an_operating_point_that_the_stream_does_not_have_is_an_error_that_names_those_it_has() {
    let error = frames_of(&stream("svc_L2T1"), 2).unwrap_err();
    assert!(matches!(
        error,
        Error::OperatingPoint {
            chosen: 2,
            available: 2
        }
    ));
    assert_eq!(
        error.to_string(),
        "operating point 2 was chosen, but the stream has 2; choose one from 0 to 1"
    );
    assert!(frames_of(&stream("aom_8x8"), 1).is_err());
}
