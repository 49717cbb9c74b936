//! Runs one subgroup of a program of a stage of drawing.

use std::sync::Arc;

use spirv_jit::environment::{Descriptor, DescriptorSet, Environment};
use spirv_jit::ir;
use spirv_jit::program::{AlignedRow, Event, InputRow, OutputRow, Row, Stage, Wave, from_bytes};
use spirv_jit::{LaneMask, Program};

use crate::code_pages::allow_native_code;
use crate::{glsl, lower, request};

/// A program that went through the bytes of a pipeline cache.
pub fn program(stage: Stage, source: &str) -> Arc<Program> {
    program_of_words(stage, &glsl(stage, source))
}

/// The same of a module.
pub fn program_of_words(stage: Stage, words: &[u32]) -> Arc<Program> {
    allow_native_code();
    let mut module = lower(&request(stage, words)).unwrap_or_else(|error| panic!("{error}"));
    spirv_jit::pass::optimize(&mut module).unwrap_or_else(|error| panic!("{error}"));
    let bytes = ir::binary::encode(&module);
    assert_eq!(ir::binary::decode(&bytes).as_ref(), Ok(&module));
    from_bytes(&bytes).unwrap_or_else(|error| panic!("{error}"))
}

/// The results of an ended subgroup.
pub struct Ended {
    pub outputs: Vec<(OutputRow, Row)>,
    pub helpers: LaneMask,
}

impl Ended {
    /// The words of an output.
    pub fn words(&self, row: OutputRow) -> Row {
        let found = self.outputs.iter().find(|(is, _)| *is == row);
        found.unwrap_or_else(|| panic!("no output {row}")).1
    }

    /// The floats of a component at a location.
    pub fn floats(&self, location: u16, component: u8) -> [f32; 16] {
        let row = OutputRow::Location {
            location,
            component,
            index: 0,
        };
        self.words(row).map(f32::from_bits)
    }
}

/// Who runs, and on what.
pub struct ActiveLanes {
    pub active: LaneMask,
    pub helpers: LaneMask,
}

pub const ALL: ActiveLanes = ActiveLanes {
    active: LaneMask::ALL,
    helpers: LaneMask::NONE,
};

/// Runs a subgroup; `input` gives each row's word in a lane, `buffer` is the storage buffer of set
/// 0, binding 0. Little fuel at a time: the subgroup is suspended at back-edges again and again.
pub fn run(
    program: &Program,
    lanes: ActiveLanes,
    buffer: &mut [u32],
    input: impl Fn(InputRow, usize) -> u32,
) -> Ended {
    let state = run_to_end(program, lanes, buffer, input);
    let io = program.layout().io;
    let words = |(index, &row): (usize, &OutputRow)| (row, state[io + index].0);
    Ended {
        outputs: program.outputs().iter().enumerate().map(words).collect(),
        helpers: program.helpers(&state),
    }
}

/// A vertex that a geometry shader emitted.
#[derive(Clone, Debug, PartialEq)]
pub struct Emitted {
    /// It is the first one of a strip.
    pub starts: bool,
    pub stream: u32,
    /// In the order of [`Program::outputs`].
    pub words: Vec<u32>,
}

/// As [`run`], of a geometry program: the vertices that each lane emitted.
pub fn run_geometry(
    program: &Program,
    buffer: &mut [u32],
    input: impl Fn(InputRow, usize) -> u32,
) -> [Vec<Emitted>; 16] {
    let state = run_to_end(program, ALL, buffer, input);
    let counts = state[program.layout().io].0;
    let word =
        |word, vertex: usize, lane: usize| program.emitted_rows(&state, word)[vertex].0[lane];
    std::array::from_fn(|lane| {
        let vertices = (0..counts[lane] as usize).map(|vertex| Emitted {
            starts: word(0, vertex, lane) & 1 != 0,
            stream: word(0, vertex, lane) >> 1,
            words: (1..=program.outputs().len())
                .map(|of| word(of, vertex, lane))
                .collect(),
        });
        vertices.collect()
    })
}

fn run_to_end(
    program: &Program,
    lanes: ActiveLanes,
    buffer: &mut [u32],
    input: impl Fn(InputRow, usize) -> u32,
) -> Vec<AlignedRow> {
    let mut entries = vec![Descriptor::NULL; 256];
    entries[0] = Descriptor {
        address: buffer.as_mut_ptr() as u64,
        size_bytes: size_of_val(buffer) as u64,
        ..Descriptor::NULL
    };
    let mut environment = Environment::unbound();
    environment.sets[0] = DescriptorSet {
        entries: entries.as_ptr(),
        count: entries.len() as u32,
        ..DescriptorSet::NONE
    };
    let layout = program.layout();
    let mut state = vec![AlignedRow::default(); layout.rows];
    program.start_fragments(&mut state, lanes.active, lanes.helpers);
    for (index, &row) in program.inputs().iter().enumerate() {
        for lane in 0..16 {
            state[layout.inputs + index].0[lane] = input(row, lane);
        }
    }
    let mut frame = Default::default();
    for turn in 0.. {
        assert!(turn < 10_000, "the shader does not end");
        let mut fuel = 3;
        let mut wave = Wave {
            states: &mut [&mut state[..]],
            shared: &[],
            is_whole: false,
            outputs_to: &[],
            environment: &environment,
        };
        // SAFETY: the environment is of memory that outlives it, and there is no workgroup memory.
        let events = unsafe { program.run(&mut frame, &mut wave, &mut fuel) };
        match events.expect("the frame is small").iter().next().unwrap() {
            Event::End => break,
            Event::OutOfFuel => {}
            event => panic!("{event:?}"),
        }
    }
    state
}
