//! A whole file that is changed by its structure: OBUs and units are swapped, repeated, dropped, cut
//! and spliced, header bits are flipped, and all sizes are right again.
#![no_main]

use fuzz_support::damage::{Random, structure};
use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};

fuzz_target!(|data: &[u8]| {
    let _ = fuzz_support::read(data);
});

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    let mut random = Random::new(seed.into());
    let streams = fuzz_support::small_streams();
    let other = streams[random.below(streams.len())];
    let changed = match random.below(8) {
        0 => None,
        1 => structure::mutate(other, &data[..size], &mut random),
        _ => structure::mutate(&data[..size], other, &mut random),
    };
    match changed.filter(|changed| changed.len() <= max_size) {
        Some(changed) => {
            data[..changed.len()].copy_from_slice(&changed);
            changed.len()
        }
        None => fuzzer_mutate(data, size, max_size),
    }
});
