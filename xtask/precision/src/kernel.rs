//! One operation of the IR as a program over columns of operands.

use std::fmt::Write;

use spirv_jit::ir::Type;
use waves::Waves;

pub struct Kernel(Waves);

impl Kernel {
    /// `operation` on `arity` operands of a type, given and returned as bits in words.
    pub fn new(operation: &str, arity: usize, ty: Type) -> Self {
        Self(Waves::new(&text(operation, arity, ty), None, 1).unwrap())
    }

    /// How many lanes one wave has.
    pub fn lanes(&self) -> usize {
        self.0.lanes()
    }

    /// Runs one wave over columns of [`Self::lanes`] words.
    pub fn run(&mut self, columns: &[Vec<u32>], results: &mut [u32]) {
        for (number, column) in columns.iter().enumerate() {
            self.0.set_input(number, |lane| column[lane]);
        }
        self.0.restart();
        self.0.run().unwrap();
        for (result, found) in results.iter_mut().zip(self.0.results()) {
            *result = found;
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
