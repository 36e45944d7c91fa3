//! Probing and splitting: the units lie in the file one behind the other, and no bytes are invented.
#![no_main]

use av1_motion::ContainerReader;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Ok(mut reader) = ContainerReader::new(data, &fuzz_support::limits()) else {
        return;
    };
    let (mut end, mut total) = (0, 0);
    while let Ok(Some(unit)) = reader.next_unit() {
        assert!(unit.byte_offset >= end, "units overlap");
        end = unit.byte_offset + 1;
        total += unit.data.len();
    }
    assert!(total <= data.len(), "more bytes than the file has");
    assert!(matches!(reader.next_unit(), Ok(None)), "an end is an end");
});
