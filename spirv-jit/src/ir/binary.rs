//! The binary form of the IR, for pipeline caches. [`encode`] and [`decode`] are inverse.
//!
//! ```text
//! header: the text form of the module without its functions
//! operations: the text form of each that occurs, once; 0 is `const`, whose bits follow at its instructions
//! functions: numbers of seven bits a byte; bodies by the tags below
//! ```
//!
//! Decoded modules are well-formed, but only [`verify`](super::verify::verify) checks their
//! validity.

use foldhash::HashMap;

use smallvec::SmallVec;

use super::build::{BodyBuilder, Ended};
use super::text::{parse_module, parse_op, print_head, print_op};
use super::{
    Body, Function, Inst, Label, Module, Node, Op, Step, Terminator, Type, Value, Variable,
};

const MAX_LABELS: u32 = 1 << 20;

/// The tag of the next item in a body. Terminators end the body.
const INST: u8 = 0;
const BLOCK: u8 = 1;
const IF: u8 = 2;
const LOOP: u8 = 3;
const BR: u8 = 4;
const RETURN: u8 = 5;
const END: u8 = 6;
const UNREACHABLE: u8 = 7;

/// Encodes a module.
pub fn encode(module: &Module) -> Vec<u8> {
    let mut encoder = Encoder::default();
    encoder.number(module.functions.len() as u64);
    for function in &module.functions {
        encoder.function(function);
    }
    let functions = std::mem::take(&mut encoder.bytes);
    let operations = std::mem::take(&mut encoder.texts);
    encoder.string(&print_head(module));
    encoder.number(operations.len() as u64);
    for text in &operations {
        encoder.string(text);
    }
    encoder.bytes.extend(functions);
    encoder.bytes
}

#[derive(Default)]
struct Encoder {
    bytes: Vec<u8>,
    operations: HashMap<Op, u64>,
    texts: Vec<String>,
}

impl Encoder {
    fn number(&mut self, mut number: u64) {
        while number >= 0x80 {
            self.bytes.push(number as u8 | 0x80);
            number >>= 7;
        }
        self.bytes.push(number as u8);
    }

    fn string(&mut self, text: &str) {
        self.number(text.len() as u64);
        self.bytes.extend_from_slice(text.as_bytes());
    }

    fn values(&mut self, values: &[Value]) {
        self.number(values.len() as u64);
        for value in values {
            self.number(value.0.into());
        }
    }

    fn types(&mut self, types: &[Type]) {
        self.number(types.len() as u64);
        let index = |ty: &Type| Type::ALL.iter().position(|other| other == ty).unwrap_or(0) as u8;
        self.bytes.extend(types.iter().map(index));
    }

    fn function(&mut self, function: &Function) {
        self.string(&function.name);
        self.values(&function.params);
        self.types(&function.results);
        self.types(&function.value_types);
        self.number(function.labels.into());
        self.number(function.variables.len() as u64);
        for variable in &function.variables {
            self.string(&variable.name);
            self.number(variable.rows.into());
            self.number(variable.zero.into());
        }
        self.number(function.tables.len() as u64);
        for table in &function.tables {
            self.number(table.len() as u64);
            table.iter().for_each(|&word| self.number(word.into()));
        }
        self.body(&function.body);
    }

    fn body(&mut self, body: &Body) {
        for step in body.steps() {
            match step {
                Step::Inst(inst) => self.inst(inst),
                Step::Open(node) => self.construct(node),
                Step::End(body) => self.terminator(&body.end),
                Step::Else(_) | Step::Close(_) => {}
            }
        }
    }

    fn terminator(&mut self, end: &Terminator) {
        match end {
            Terminator::Br(label, args) => {
                self.bytes.push(BR);
                self.number(label.0.into());
                self.values(args);
            }
            Terminator::Return(args) => {
                self.bytes.push(RETURN);
                self.values(args);
            }
            Terminator::End(args) => {
                self.bytes.push(END);
                self.values(args);
            }
            Terminator::Unreachable => self.bytes.push(UNREACHABLE),
        }
    }

    /// The head of a construct, before its bodies.
    fn construct(&mut self, node: &Node) {
        match node {
            Node::Inst(inst) => self.inst(inst),
            Node::Block { label, results, .. } => {
                self.bytes.push(BLOCK);
                self.number(label.0.into());
                self.values(results);
            }
            Node::If {
                condition,
                label,
                results,
                ..
            } => {
                self.bytes.push(IF);
                self.number(condition.0.into());
                self.number(label.0.into());
                self.values(results);
            }
            Node::Loop {
                label,
                params,
                init,
                ..
            } => {
                self.bytes.push(LOOP);
                self.number(label.0.into());
                self.values(params);
                self.values(init);
            }
        }
    }

    fn inst(&mut self, inst: &Inst) {
        self.bytes.push(INST);
        if let Op::Const(bits) = inst.op {
            self.number(0);
            self.number(bits);
        } else {
            let index = match self.operations.get(&inst.op) {
                Some(&index) => index,
                None => {
                    self.texts.push(print_op(&inst.op));
                    let index = self.texts.len() as u64;
                    self.operations.insert(inst.op, index);
                    index
                }
            };
            self.number(index);
        }
        self.values(&inst.results);
        self.values(&inst.args);
        self.number(inst.source.into());
    }
}

/// Decodes a module.
///
/// # Errors
/// Bytes that [`encode`] cannot produce. Never panics, and uses memory in proportion to the bytes.
pub fn decode(bytes: &[u8]) -> Result<Module, String> {
    let mut decoder = Decoder {
        rest: bytes,
        operations: Vec::new(),
    };
    let mut module = parse_module(decoder.string()?)?;
    for _ in 0..decoder.count()? {
        let op = parse_op(decoder.string()?)?;
        decoder.operations.push(op);
    }
    for _ in 0..decoder.count()? {
        let function = decoder.function()?;
        module.functions.push(function);
    }
    if !decoder.rest.is_empty() {
        return Err("bytes after the end".into());
    }
    Ok(module)
}

struct Decoder<'a> {
    rest: &'a [u8],
    operations: Vec<Op>,
}

type Decoded<T> = Result<T, String>;

impl<'a> Decoder<'a> {
    fn byte(&mut self) -> Decoded<u8> {
        let (&first, rest) = self.rest.split_first().ok_or("the bytes end early")?;
        self.rest = rest;
        Ok(first)
    }

    fn number(&mut self) -> Decoded<u64> {
        let mut number = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            number |= u64::from(byte & 0x7F) << shift;
            if byte < 0x80 {
                return Ok(number);
            }
        }
        Err("a number without an end".into())
    }

    fn small(&mut self) -> Decoded<u32> {
        u32::try_from(self.number()?).map_err(|_| "a number too large".into())
    }

    /// A count of items of at least one byte each.
    fn count(&mut self) -> Decoded<usize> {
        let count = self.small()? as usize;
        if count > self.rest.len() {
            return Err("more items than bytes".into());
        }
        Ok(count)
    }

    fn slice(&mut self) -> Decoded<&'a [u8]> {
        let count = self.count()?;
        let (slice, rest) = self.rest.split_at(count);
        self.rest = rest;
        Ok(slice)
    }

    fn string(&mut self) -> Decoded<&'a str> {
        std::str::from_utf8(self.slice()?).map_err(|_| "text that is not UTF-8".into())
    }

    fn value(&mut self) -> Decoded<Value> {
        self.small().map(Value)
    }

    fn label(&mut self) -> Decoded<Label> {
        self.small().map(Label)
    }

    fn values<C: FromIterator<Value>>(&mut self) -> Decoded<C> {
        (0..self.count()?).map(|_| self.value()).collect()
    }

    fn types(&mut self) -> Decoded<Vec<Type>> {
        let ty = |&index: &u8| Type::ALL.get(usize::from(index)).copied();
        let types = self.slice()?.iter().map(ty).collect::<Option<_>>();
        types.ok_or_else(|| "no such type".into())
    }

    fn function(&mut self) -> Decoded<Function> {
        let name = self.string()?.to_owned();
        let params = self.values()?;
        let results = self.types()?;
        let value_types = self.types()?;
        let labels = self.small()?;
        if labels > MAX_LABELS {
            return Err("too many labels".into());
        }
        let variables = (0..self.count()?).map(|_| {
            Ok(Variable {
                name: self.string()?.to_owned(),
                rows: self.small()?,
                zero: self.number()? != 0,
            })
        });
        let variables = variables.collect::<Decoded<_>>()?;
        let tables = (0..self.count()?).map(|_| (0..self.count()?).map(|_| self.small()).collect());
        let tables = tables.collect::<Decoded<_>>()?;
        let body = self.body()?;
        Ok(Function {
            name,
            params,
            results,
            value_types,
            labels,
            variables,
            tables,
            body,
        })
    }

    fn body(&mut self) -> Decoded<Body> {
        let mut builder = BodyBuilder::default();
        loop {
            let end = match self.byte()? {
                INST => {
                    builder.push(Node::Inst(self.inst()?));
                    continue;
                }
                BLOCK => {
                    builder.open(Node::Block {
                        label: self.label()?,
                        results: self.values()?,
                        body: Box::default(),
                    });
                    continue;
                }
                IF => {
                    builder.open(Node::If {
                        condition: self.value()?,
                        label: self.label()?,
                        results: self.values()?,
                        then_body: Box::default(),
                        else_body: Box::default(),
                    });
                    continue;
                }
                LOOP => {
                    builder.open(Node::Loop {
                        label: self.label()?,
                        params: self.values()?,
                        init: self.values()?,
                        body: Box::default(),
                    });
                    continue;
                }
                BR => Terminator::Br(self.label()?, self.values()?),
                RETURN => Terminator::Return(self.values()?),
                END => Terminator::End(self.values()?),
                UNREACHABLE => Terminator::Unreachable,
                _ => return Err("no such node".into()),
            };
            if let Ended::All(body) = builder.end(end) {
                return Ok(body);
            }
        }
    }

    fn inst(&mut self) -> Decoded<Inst> {
        let op = match self.number()? {
            0 => Op::Const(self.number()?),
            index => {
                let op = self.operations.get(index as usize - 1);
                *op.ok_or("no such operation")?
            }
        };
        let results: SmallVec<[Value; 2]> = self.values()?;
        let args: SmallVec<[Value; 4]> = self.values()?;
        Ok(Inst {
            op,
            args,
            results,
            source: self.small()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Program;
    use crate::ir::text::SAMPLE;
    use crate::ir::verify::verify;

    #[test]
    fn bytes_round_trip() {
        let module = parse_module(SAMPLE).unwrap();
        assert_eq!(decode(&encode(&module)).unwrap(), module);
    }

    /// Damaged bytes give an error or another module, which the verifier checks; never a panic.
    #[test]
    fn damage_is_survived() {
        let bytes = encode(&parse_module(SAMPLE).unwrap());
        for end in 0..bytes.len() {
            assert!(decode(&bytes[..end]).is_err());
        }
        for at in 0..bytes.len() {
            for flip in [0x01, 0x80, 0xFF] {
                let mut damaged = bytes.clone();
                damaged[at] ^= flip;
                if let Ok(module) = decode(&damaged)
                    && verify(&module).is_ok()
                {
                    let _ = Program::new(&module);
                }
            }
        }
    }
}
