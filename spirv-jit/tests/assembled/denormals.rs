//! Modules that ask for denormals to be flushed to zero. Vulkan forbids them where
//! `shaderDenormFlushToZeroFloat32` is false, but vkd3d-proton makes them: they run, and denormals
//! are kept.

use rspirv::spirv::{Capability, ExecutionMode, Op};

use crate::assembler::Assembler;
use crate::expect;

#[test]
fn denormals_are_kept_where_flushing_is_asked_for() {
    let mut a = Assembler::new();
    a.capability(Capability::DenormFlushToZero);
    a.modes.push((ExecutionMode::DenormFlushToZero, &[32]));
    let float = a.global(Op::TypeFloat, &[32]);
    a.read();
    let number = a.make(float, Op::Bitcast, &[a.given]);
    let twice = a.make(float, Op::FAdd, &[number, number]);
    let result = a.make(a.word, Op::Bitcast, &[twice]);
    // The double of a denormal has the double of its bits.
    let cases = [
        (1, 2),
        (0x0040_0000, 0x0080_0000),
        (0x3f80_0000, 0x4000_0000),
    ];
    expect(&a.finish(result), &cases);
}
