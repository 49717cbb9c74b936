//! Runs compute programs over plain memory.

use std::sync::Arc;

use spirv_jit::abort::Aborts;
use spirv_jit::environment::{Descriptor, DescriptorSet, Environment, uniform};
use spirv_jit::program::{AlignedRow, Builtin, Event, InputRow, Stage, Wave};
use spirv_jit::{CompileRequest, LaneMask, Program};

use crate::code_pages::allow_native_code;
use crate::{glsl, request};

/// Compiles a compute shader through all of the compiler.
pub fn compile(words: &[u32]) -> Arc<Program> {
    compile_as(&request(Stage::Compute, words))
}

/// The same, as asked for.
pub fn compile_as(request: &CompileRequest<'_>) -> Arc<Program> {
    allow_native_code();
    spirv_jit::compile(request).unwrap_or_else(|error| panic!("{error}"))
}

/// The memory that a dispatch accesses.
#[derive(Default)]
pub struct Memory {
    /// Buffers of set 0: descriptor index (16 × binding + array index) and contents.
    pub buffers: Vec<(usize, Vec<u32>)>,
    pub push_constants: Vec<u32>,
}

/// Runs `groups` workgroups along x, one after the other.
pub fn dispatch(program: &Program, groups: u32, memory: &mut Memory) {
    dispatch_over(program, groups, memory, &[]);
}

/// The same, with descriptors of other memory, by their index.
pub fn dispatch_over(
    program: &Program,
    groups: u32,
    memory: &mut Memory,
    others: &[(usize, Descriptor)],
) {
    dispatch_in(program, groups, memory, others, Environment::unbound());
}

/// The same as [`dispatch`], with room for messages of invocations that abort.
pub fn dispatch_until(program: &Program, groups: u32, memory: &mut Memory, aborts: &Arc<Aborts>) {
    let environment = Environment {
        aborts: Some(Arc::clone(aborts)),
        ..Environment::unbound()
    };
    dispatch_in(program, groups, memory, &[], environment);
}

fn dispatch_in(
    program: &Program,
    groups: u32,
    memory: &mut Memory,
    others: &[(usize, Descriptor)],
    environment: Environment,
) {
    let mut entries = vec![Descriptor::NULL; 256];
    for &(index, descriptor) in others {
        entries[index] = descriptor;
    }
    for (index, words) in &mut memory.buffers {
        entries[*index] = descriptor(words);
    }
    let mut environment = Environment {
        push_constants: descriptor(&mut memory.push_constants),
        ..environment
    };
    environment.sets[0] = DescriptorSet {
        entries: entries.as_ptr(),
        count: entries.len() as u32,
        ..DescriptorSet::NONE
    };
    environment.uniforms[uniform::NUM_WORKGROUPS as usize] = groups;
    for group in 0..groups {
        let mut shared = shared_memory(program);
        run_group(program, group, &environment, &mut shared);
    }
}

/// Runs one workgroup of a task or mesh program, whose memory starts with `payload`, and returns
/// that memory.
pub fn run_mesh(program: &Program, payload: &[u8]) -> Vec<u8> {
    let mut shared = shared_memory(program);
    let bytes = shared.iter().flat_map(|word| word.to_le_bytes());
    let bytes: Vec<u8> = payload
        .iter()
        .copied()
        .chain(bytes.skip(payload.len()))
        .collect();
    let words = bytes.as_chunks::<8>().0;
    shared = words.iter().map(|word| u64::from_le_bytes(*word)).collect();
    run_group(program, 0, &Environment::unbound(), &mut shared);
    shared.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// Memory of a workgroup, with any contents.
fn shared_memory(program: &Program) -> Vec<u64> {
    vec![0xdead_beef_dead_beef; program.shared_size_bytes() as usize / 8 + 1]
}

fn descriptor(words: &mut [u32]) -> Descriptor {
    Descriptor {
        address: words.as_mut_ptr() as u64,
        size_bytes: size_of_val(words) as u64,
        ..Descriptor::NULL
    }
}

/// The word of a built-in for an invocation of a workgroup.
fn word(row: InputRow, size: [u32; 3], group: u32, index: u32) -> u32 {
    let local = [
        index % size[0],
        index / size[0] % size[1],
        index / size[0] / size[1],
    ];
    let InputRow::Builtin(built_in, component) = row else {
        panic!("compute has no {row:?}");
    };
    let component = component as usize;
    let groups = [group, 0, 0];
    match built_in {
        Builtin::LocalInvocationIndex => index,
        Builtin::LocalInvocationId => local[component],
        Builtin::WorkgroupId => groups[component],
        Builtin::GlobalInvocationId => groups[component] * size[component] + local[component],
        Builtin::SubgroupId => index / 16,
        Builtin::NumSubgroups => size.iter().product::<u32>().div_ceil(16),
        Builtin::NumWorkgroups => [5, 6, 7][component],
        Builtin::DrawIndex => 9,
        other => panic!("compute has no {other:?}"),
    }
}

fn run_group(program: &Program, group: u32, environment: &Environment, shared: &mut [u64]) {
    let size = program.local_size();
    let invocations: u32 = size.iter().product();
    let layout = program.layout();
    let mut states = Vec::new();
    for subgroup in 0..invocations.div_ceil(16) {
        let mut state = vec![AlignedRow::default(); layout.rows];
        let lanes = (invocations - 16 * subgroup).min(16);
        program.start(&mut state, LaneMask::full(lanes as usize));
        for (index, &row) in program.inputs().iter().enumerate() {
            for lane in 0..lanes {
                let invocation = 16 * subgroup + lane;
                state[layout.inputs + index].0[lane as usize] = word(row, size, group, invocation);
            }
        }
        states.push(state);
    }
    let mut frame = Default::default();
    let mut running: Vec<usize> = (0..states.len()).collect();
    let mut fuel = 10_000_000;
    while !running.is_empty() {
        let mut waiting = Vec::new();
        for &index in &running {
            let mut one = [&mut states[index][..]];
            let mut wave = Wave {
                states: &mut one,
                shared: &[shared.as_mut_ptr().cast()],
                is_whole: false,
                outputs_to: &[],
                environment,
            };
            // SAFETY: the environment is of memory that outlives it, `shared` is large enough.
            let events = unsafe { program.run(&mut frame, &mut wave, &mut fuel) };
            match events.expect("the frame is small").iter().next().unwrap() {
                Event::End => {}
                Event::Yield(_) => waiting.push(index),
                Event::OutOfFuel => panic!("the shader does not end"),
            }
        }
        running = waiting;
    }
}

/// Runs a body that turns `x` (input word i) into `r` (output word i), for 64 invocations and 4
/// workgroups, and compares.
pub fn check(declarations: &str, body: &str, inputs: &[u32], reference: impl Fn(u32, u32) -> u32) {
    let source = format!(
        "layout(local_size_x = 16) in;
         layout(set = 0, binding = 0) buffer In {{ uint x_[]; }};
         layout(set = 0, binding = 1) buffer Out {{ uint r_[]; }};
         {declarations}
         void main() {{
             uint i = gl_GlobalInvocationID.x;
             uint x = x_[i];
             uint r = 0u;
             {body}
             r_[i] = r;
         }}"
    );
    let words = glsl(Stage::Compute, &source);
    let program = compile(&words);
    let count = inputs.len().next_multiple_of(16);
    let mut given = inputs.to_vec();
    given.resize(count, 0);
    let mut memory = Memory {
        buffers: vec![(0, given.clone()), (16, vec![0; count])],
        push_constants: Vec::new(),
    };
    dispatch(&program, count as u32 / 16, &mut memory);
    for (index, (&x, &result)) in given.iter().zip(&memory.buffers[1].1).enumerate() {
        let expected = reference(index as u32, x);
        assert_eq!(
            result, expected,
            "invocation {index}, x = {x:#x}: {result:#x} instead of {expected:#x}\n{body}"
        );
    }
}

#[cfg(all(test, feature = "glsl", target_arch = "x86_64"))]
mod tests {
    use spirv_jit::Tier;
    use spirv_jit::program::Stage;

    use super::compile;
    use crate::glsl;

    #[test]
    fn programs_of_tests_have_native_code() {
        let source = "
            layout(local_size_x = 16) in;
            layout(set = 0, binding = 0) buffer B { float x[]; };
            void main() {
                float y = x[gl_LocalInvocationIndex];
                x[gl_LocalInvocationIndex] = y * y + y;
            }";
        let program = compile(&glsl(Stage::Compute, source));
        assert_eq!(program.has_native_code(), Tier::best() != Tier::Portable);
    }
}
