//! Arbitrary words behind a valid header.
#![no_main]

use libfuzzer_sys::fuzz_target;
use shaders::corrupt::try_module;
use spirv_jit::program::Stage;

fuzz_target!(|given: Vec<u32>| {
    let mut words = vec![0x0723_0203, 0x0001_0600, 0, 1000, 0];
    words.extend(given);
    try_module(Stage::Compute, &words, 0);
});
