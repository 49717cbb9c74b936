//! SPIR-V as text, in the syntax of the disassemblers: `%sum = OpIAdd %uint %x %y`, an instruction
//! a line. Masks are numbers or `None`.

use std::collections::HashMap;
use std::str::FromStr;

use rspirv::grammar::{INSTRUCTION_TABLE, Instruction, OperandKind, OperandQuantifier};
use rspirv::spirv;

/// The words of a module.
pub fn assemble(text: &str) -> Result<Vec<u32>, String> {
    let mut ids = HashMap::new();
    let mut words = vec![spirv::MAGIC_NUMBER, 0x0001_0600, 0, 0, 0];
    for line in text.lines() {
        let line = line.split(';').next().unwrap_or_default().trim();
        if !line.is_empty() {
            put(line, &mut ids, &mut words).map_err(|fault| format!("{line}: {fault}"))?;
        }
    }
    words[3] = ids.len() as u32 + 1;
    Ok(words)
}

/// Adds the instruction in a line.
fn put<'t>(
    line: &'t str,
    ids: &mut HashMap<&'t str, u32>,
    words: &mut Vec<u32>,
) -> Result<(), String> {
    let (result, rest) = match line.split_once(" = ") {
        Some((result, rest)) => (Some(result.trim()), rest.trim()),
        None => (None, line),
    };
    let mut tokens = tokens(rest).into_iter().peekable();
    let name = tokens.next().ok_or("no instruction")?;
    let name = name.strip_prefix("Op").ok_or("no instruction")?;
    let grammar: &Instruction<'_> = INSTRUCTION_TABLE
        .iter()
        .find(|instruction| instruction.opname == name)
        .ok_or("no such instruction")?;
    let mut id = |name: &'t str| {
        let next = ids.len() as u32 + 1;
        *ids.entry(name).or_insert(next)
    };
    let start = words.len();
    words.push(0);
    for operand in grammar.operands {
        loop {
            if operand.kind == OperandKind::IdResult {
                words.push(id(result.ok_or("no result")?));
                break;
            }
            let Some(token) = tokens.next() else {
                match operand.quantifier {
                    OperandQuantifier::One => return Err("too few operands".into()),
                    _ => break,
                }
            };
            match token.strip_prefix('"') {
                Some(text) => words.extend(string(text.trim_end_matches('"'))),
                None if token.starts_with('%') => words.push(id(token)),
                None => words.push(number(operand.kind, token).ok_or(format!("what is {token}?"))?),
            }
            // Operands of an enumerant follow it.
            let has_parameters = matches!(
                operand.kind,
                OperandKind::Decoration | OperandKind::ExecutionMode | OperandKind::MemoryAccess
            );
            while has_parameters && let Some(token) = tokens.peek() {
                let builtin = spirv::BuiltIn::from_str(token).map(|it| it as u32).ok();
                words.push(builtin.or(parse(token)).ok_or("a parameter")?);
                tokens.next();
            }
            // A constant of 64 bits is two numbers, the lower one first.
            let has_more = operand.kind == OperandKind::LiteralContextDependentNumber
                && tokens.peek().is_some();
            if operand.quantifier != OperandQuantifier::ZeroOrMore && !has_more {
                break;
            }
        }
    }
    if let Some(rest) = tokens.next() {
        return Err(format!("{rest} is left"));
    }
    let count = (words.len() - start) as u32;
    words[start] = count << 16 | grammar.opcode as u32;
    Ok(())
}

/// The words of a line; a text between quotation marks is one.
fn tokens(line: &str) -> Vec<&str> {
    let mut tokens = Vec::new();
    let mut rest = line.trim();
    while !rest.is_empty() {
        let end = match rest.strip_prefix('"') {
            Some(text) => text.find('"').map_or(rest.len(), |end| end + 2),
            None => rest.find(' ').unwrap_or(rest.len()),
        };
        tokens.push(&rest[..end]);
        rest = rest[end..].trim_start();
    }
    tokens
}

/// A literal string: UTF-8 with a zero byte at the end, padded to words.
fn string(text: &str) -> Vec<u32> {
    let mut bytes = text.as_bytes().to_vec();
    bytes.resize((bytes.len() / 4 + 1) * 4, 0);
    let (words, _) = bytes.as_chunks();
    words.iter().map(|word| u32::from_le_bytes(*word)).collect()
}

/// A number, or a float with a point, as its bits.
fn parse(token: &str) -> Option<u32> {
    match token.strip_prefix("0x") {
        Some(digits) => u32::from_str_radix(digits, 16).ok(),
        None if token.contains('.') => token.parse().ok().map(f32::to_bits),
        None => token.parse().ok().map(|number: i64| number as u32),
    }
}

/// An enumerant of this kind, or a number.
fn number(kind: OperandKind, token: &str) -> Option<u32> {
    let named = match kind {
        OperandKind::Capability => spirv::Capability::from_str(token).map(|it| it as u32),
        OperandKind::AddressingModel => spirv::AddressingModel::from_str(token).map(|it| it as u32),
        OperandKind::MemoryModel => spirv::MemoryModel::from_str(token).map(|it| it as u32),
        OperandKind::ExecutionModel => spirv::ExecutionModel::from_str(token).map(|it| it as u32),
        OperandKind::ExecutionMode => spirv::ExecutionMode::from_str(token).map(|it| it as u32),
        OperandKind::StorageClass => spirv::StorageClass::from_str(token).map(|it| it as u32),
        OperandKind::Decoration => spirv::Decoration::from_str(token).map(|it| it as u32),
        OperandKind::GroupOperation => spirv::GroupOperation::from_str(token).map(|it| it as u32),
        OperandKind::LiteralExtInstInteger => glsl(token).ok_or(()),
        _ if token == "None" => return Some(0),
        _ => Err(()),
    };
    named.ok().or(parse(token))
}

/// The number of an instruction of `GLSL.std.450`.
fn glsl(name: &str) -> Option<u32> {
    let named =
        |number| spirv::GlslStd450Op::from_u32(number).is_some_and(|op| format!("{op:?}") == name);
    (1..=81).find(|&number| named(number))
}
