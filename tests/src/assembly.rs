//! Changes to modules of SPIR-V, for instructions that the GLSL compiler lacks.

const OP_EXTENSION: u32 = 10;
const OP_ENTRY_POINT: u32 = 15;
const OP_EXECUTION_MODE: u32 = 16;
const OP_CAPABILITY: u32 = 17;

/// The instructions of a module, behind its header.
pub fn instructions(words: &[u32]) -> impl Iterator<Item = &[u32]> {
    let mut rest = words.get(5..).unwrap_or_default();
    std::iter::from_fn(move || {
        let length = (*rest.first()? >> 16) as usize;
        let (instruction, tail) = rest.split_at_checked(length.max(1))?;
        rest = tail;
        Some(instruction)
    })
}

/// The opcode of an instruction.
pub fn opcode(instruction: &[u32]) -> u32 {
    instruction[0] & 0xFFFF
}

/// An instruction of an opcode and operands.
pub fn instruction(opcode: u32, operands: &[u32]) -> Vec<u32> {
    let head = (operands.len() as u32 + 1) << 16 | opcode;
    [&[head], operands].concat()
}

/// The words of a string, which end with a zero byte.
pub fn string(text: &str) -> Vec<u32> {
    let mut bytes = text.as_bytes().to_vec();
    bytes.resize(text.len() / 4 * 4 + 4, 0);
    let words = bytes.chunks_exact(4);
    words
        .map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]))
        .collect()
}

/// A module that declares a capability and its extension, too.
pub fn with_capability(words: &[u32], capability: u32, extension: &str) -> Vec<u32> {
    let mut out = words[..5].to_vec();
    out.extend(instruction(OP_CAPABILITY, &[capability]));
    let mut is_declared = false;
    for it in instructions(words) {
        if opcode(it) != OP_CAPABILITY && !is_declared {
            out.extend(instruction(OP_EXTENSION, &string(extension)));
            is_declared = true;
        }
        out.extend_from_slice(it);
    }
    out
}

/// A module whose entry points have an execution mode without operands, too.
pub fn with_execution_mode(words: &[u32], mode: u32) -> Vec<u32> {
    let mut out = words[..5].to_vec();
    let mut waiting = Vec::new();
    for it in instructions(words) {
        if opcode(it) == OP_ENTRY_POINT {
            waiting.push(it[2]);
        } else {
            for entry in waiting.drain(..) {
                out.extend(instruction(OP_EXECUTION_MODE, &[entry, mode]));
            }
        }
        out.extend_from_slice(it);
    }
    out
}
