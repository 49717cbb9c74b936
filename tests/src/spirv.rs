//! Instructions of SPIR-V modules, for tests that rewrite them.

/// A module's instructions: opcode and operands.
pub fn instructions(words: &[u32]) -> Vec<(u32, &[u32])> {
    let mut all = Vec::new();
    let mut rest = &words[5..];
    while let Some(&head) = rest.first() {
        let (instruction, tail) = rest.split_at((head >> 16) as usize);
        all.push((head & 0xffff, &instruction[1..]));
        rest = tail;
    }
    all
}

/// Adds an instruction.
pub fn put(words: &mut Vec<u32>, opcode: u32, operands: &[u32]) {
    words.push((operands.len() as u32 + 1) << 16 | opcode);
    words.extend_from_slice(operands);
}

/// A text as SPIR-V has it.
pub fn literal(text: &str) -> Vec<u32> {
    let mut bytes = text.as_bytes().to_vec();
    bytes.resize(text.len() / 4 * 4 + 4, 0);
    bytemuck::pod_collect_to_vec(&bytes)
}
