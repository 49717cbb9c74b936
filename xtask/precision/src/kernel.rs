//! One operation of the IR as a program over columns of operands.

use std::fmt::Write;

use spirv_jit::environment::Environment;
use spirv_jit::ir::Type;
use spirv_jit::ir::text::parse_module;
use spirv_jit::program::{AlignedRow, Event, Frame, Program, Wave};

pub struct Kernel {
    program: Program,
    states: Vec<Vec<AlignedRow>>,
    frame: Frame,
}

impl Kernel {
    /// `operation` on `arity` operands of a type, given and returned as bits in words.
    pub fn new(operation: &str, arity: usize, ty: Type) -> Self {
        let program = Program::new(&parse_module(&text(operation, arity, ty)).unwrap()).unwrap();
        let rows = program.layout().rows;
        Self {
            states: vec![vec![AlignedRow::default(); rows]; program.max_wave_subgroups()],
            program,
            frame: Frame::default(),
        }
    }

    /// How many lanes one wave has.
    pub fn lanes(&self) -> usize {
        self.states.len() * 16
    }

    /// Runs one wave over columns of [`Self::lanes`] words.
    pub fn run(&mut self, columns: &[Vec<u32>], results: &mut [u32]) {
        let layout = self.program.layout();
        for (subgroup, state) in self.states.iter_mut().enumerate() {
            self.program.start(state, !0);
            for (row, column) in columns.iter().enumerate() {
                let words = &column[subgroup * 16..][..16];
                state[layout.inputs + row].0.copy_from_slice(words);
            }
        }
        let environment = Environment::unbound();
        let mut states: Vec<&mut [AlignedRow]> =
            self.states.iter_mut().map(|state| &mut state[..]).collect();
        let mut wave = Wave {
            states: &mut states,
            shared: std::ptr::null_mut(),
            environment: &environment,
        };
        let event = self.program.run(&mut self.frame, &mut wave, &mut 1000);
        assert_eq!(event, Event::End);
        for (state, results) in wave.states.iter().zip(results.chunks_exact_mut(16)) {
            results.copy_from_slice(&state[layout.io].0);
        }
    }
}

fn text(operation: &str, arity: usize, ty: Type) -> String {
    let inputs: Vec<String> = (0..arity).map(|k| format!("payload.{k}")).collect();
    let mut text = format!(
        "module closest_hit\ninputs {}\noutput_rows 1\nfunc f0 {{\n",
        inputs.join(", ")
    );
    let mut operands = Vec::new();
    for k in 0..arity {
        let (word, half, value) = (3 * k, 3 * k + 1, 3 * k + 2);
        let line = match ty {
            Type::F16 => {
                format!("v{half}: i16 = uconvert v{word}\nv{value}: f16 = bitcast v{half}")
            }
            _ => format!("v{value}: f32 = bitcast v{word}"),
        };
        writeln!(text, "v{word}: i32 = input[{k}]\n{line}").unwrap();
        operands.push(format!("v{value}"));
    }
    let operands = operands.join(", ");
    match ty {
        Type::F16 => write!(
            text,
            "v90: f16 = {operation} {operands}\nv91: i16 = bitcast v90\nv92: i32 = uconvert v91\nend(v92)\n}}\n"
        ),
        _ => write!(text, "v90: f32 = {operation} {operands}\nend(v90)\n}}\n"),
    }
    .unwrap();
    text
}
