//! Arbitrary words behind a valid header: what coverage makes of them, and of those of real
//! modules.
#![no_main]

use libfuzzer_sys::fuzz_target;
use shaders::corrupt::try_module;
use spirv_jit::program::Stage;

fuzz_target!(|data: &[u8]| {
    let mut words = vec![0x0723_0203, 0x0001_0600, 0, 1000, 0];
    let (given, _) = data.as_chunks::<4>();
    words.extend(given.iter().map(|word| u32::from_le_bytes(*word)));
    try_module(Stage::Compute, &words, 0);
});
