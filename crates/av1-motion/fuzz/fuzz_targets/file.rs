//! A whole file, going on after errors; reading it twice gives the same.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let frames = fuzz_support::read(data);
    if data.first().is_some_and(|byte| byte & 15 == 0) {
        let again = fuzz_support::read(data);
        assert_eq!(frames.len(), again.len());
        for (one, two) in frames.iter().zip(&again) {
            assert_eq!(one.blocks(), two.blocks());
        }
    }
});
