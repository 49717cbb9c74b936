//! Native code for tools: its instructions as text, and counts.

#![forbid(unsafe_code)]

/// Counts of a program's native code.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NativeCounts {
    /// Stretches and loops.
    pub stretches: usize,
    /// Operations of the IR that those perform.
    pub operations: usize,
    /// Code and its constants.
    pub size_bytes: usize,
    /// The most vector registers that one function uses.
    pub vector_registers: usize,
}

/// Where the native code of one stretch or loop is, and the operations that it performs.
pub(crate) struct Listed {
    /// The distance of the first function from the start of the program's code, in bytes.
    pub start: usize,
    pub operations: usize,
    /// Loops: of the functions.
    pub turns: Option<ListedTurns>,
}

/// The functions of a loop.
#[derive(Clone, Copy)]
pub(crate) struct ListedTurns {
    /// Subgroups that the first function takes together.
    pub together: usize,
    /// The distance of the function for one subgroup from the first one, in bytes: 0 where there is
    /// no other.
    pub single: usize,
}

impl Listed {
    /// The functions: their headings, and where they begin.
    fn functions(&self) -> impl Iterator<Item = (String, usize)> {
        let operations = self.operations;
        let of_loop = |subgroups: &str| format!("loop of {operations} operations, {subgroups}");
        let first = match self.turns {
            None => format!("stretch of {operations} operations"),
            Some(ListedTurns { together: 1, .. }) => of_loop("one subgroup"),
            Some(ListedTurns { together, .. }) => of_loop(&format!("{together} subgroups at once")),
        };
        let single = self.turns.map_or(0, |turns| turns.single);
        let rest = (single != 0).then(|| (of_loop("one subgroup"), self.start + single));
        std::iter::once((first, self.start)).chain(rest)
    }
}

/// Counts of the native code that a program has.
pub(crate) fn count(code: &[u8], all: &[Listed]) -> NativeCounts {
    let functions = all.iter().flat_map(Listed::functions);
    NativeCounts {
        stretches: all.len(),
        operations: all.iter().map(|listed| listed.operations).sum(),
        size_bytes: code.len(),
        vector_registers: (functions.map(|(_, start)| vector_registers(&code[start..])))
            .max()
            .unwrap_or(0),
    }
}

/// The text of a program's native code: a heading for each function, then a line for each of its
/// instructions, with its distance from the function's start in hexadecimal digits. Constants
/// behind the code follow the instructions that read them, after a semicolon.
pub(crate) fn text(code: &[u8], all: &[Listed]) -> String {
    let mut text = String::new();
    for (heading, start) in all.iter().flat_map(Listed::functions) {
        text.push_str(&format!("{heading}\n"));
        write_function(&code[start..], &mut text);
        text.push('\n');
    }
    text
}

#[cfg(target_arch = "x86_64")]
mod instructions {
    use std::fmt::Write;

    use iced_x86::{
        Decoder, DecoderOptions, Formatter, Instruction, Mnemonic, NasmFormatter, Register,
    };

    /// The instructions of a function, to its end.
    fn function(code: &[u8]) -> impl Iterator<Item = Instruction> {
        let mut decoder = Decoder::with_ip(64, code, 0, DecoderOptions::NONE);
        let mut ended = false;
        std::iter::from_fn(move || {
            if ended || !decoder.can_decode() {
                return None;
            }
            let instruction = decoder.decode();
            ended = instruction.mnemonic() == Mnemonic::Ret;
            Some(instruction)
        })
    }

    /// The vector registers that an instruction names, a bit each. `ymm3` is the lower half of
    /// `zmm3`.
    fn named(instruction: &Instruction) -> u32 {
        let operands = (0..instruction.op_count()).map(|k| instruction.op_register(k));
        let all = operands.chain([instruction.memory_index()]);
        all.fold(0, |named, register| {
            let number = |first: Register| (register as u32).wrapping_sub(first as u32);
            let firsts = [Register::XMM0, Register::YMM0, Register::ZMM0];
            let number = firsts.map(number).into_iter().find(|&number| number < 32);
            number.map_or(named, |number| named | 1 << number)
        })
    }

    /// Different vector registers of a function.
    pub fn vector_registers(code: &[u8]) -> usize {
        let all = function(code).fold(0, |all, instruction| all | named(&instruction));
        all.count_ones() as usize
    }

    /// Appends the lines of a function to a text.
    pub fn write_function(code: &[u8], text: &mut String) {
        let mut formatter = NasmFormatter::new();
        let options = formatter.options_mut();
        options.set_show_branch_size(false);
        options.set_branch_leading_zeros(false);
        for instruction in function(code) {
            // Strings take all that is written.
            let _ = write!(text, "{:6x}: ", instruction.ip());
            formatter.format(&instruction, text);
            if instruction.is_ip_rel_memory_operand() {
                write_constant(code, &instruction, text);
            }
            text.push('\n');
        }
    }

    /// Appends the words that an instruction reads behind the code; one where all lanes are equal.
    fn write_constant(code: &[u8], instruction: &Instruction, text: &mut String) {
        let is_wide = (0..instruction.op_count())
            .any(|k| (Register::ZMM0..=Register::ZMM31).contains(&instruction.op_register(k)));
        let start = instruction.ip_rel_memory_address() as usize;
        let size = if is_wide { 64 } else { 32 };
        let Some(bytes) = code.get(start..start.saturating_add(size)) else {
            return;
        };
        let mut words: Vec<&[u8]> = bytes.chunks_exact(4).collect();
        if words.iter().all(|word| word == &words[0]) {
            words.truncate(1);
        }
        text.push_str(" ;");
        for word in words {
            let word = u32::from_le_bytes(word.try_into().expect("four bytes"));
            let _ = write!(text, " {word:08x}");
        }
    }
}

#[cfg(target_arch = "x86_64")]
use instructions::{vector_registers, write_function};

/// No program has native code here.
#[cfg(not(target_arch = "x86_64"))]
fn vector_registers(_: &[u8]) -> usize {
    0
}

/// As [`vector_registers`].
#[cfg(not(target_arch = "x86_64"))]
fn write_function(_: &[u8], _: &mut String) {}
