//! Parses a module. The result is well-formed, but only [`verify`](crate::ir::verify::verify)
//! checks its validity.

use images::{Format, ImageOp, ImageOpKind};
use smallvec::SmallVec;

use super::names::*;
use crate::facts::Fact;
use crate::ir::build::{BodyBuilder, Ended};
use crate::ir::interface::OutputRow;
use crate::ir::op::{Access, DescriptorBinding};
use crate::ir::stage::Stage;
use crate::ir::{
    Body, Function, FunctionId, InputRow, Inst, Label, Module, Node, Op, Terminator, Type, Value,
    Variable, VariableId,
};
use crate::query::QueryWord;

/// Parses the text form of a module.
///
/// # Errors
/// The line, and the expected token.
pub fn parse_module(text: &str) -> Result<Module, String> {
    let mut parser = Parser::new(text)?;
    parser
        .module()
        .map_err(|message| format!("line {}: {message}", parser.line()))
}

/// Parses an operation other than a constant: the inverse of [`print_op`](super::print_op).
///
/// # Errors
/// As [`parse_module`].
pub fn parse_op(text: &str) -> Result<Op, String> {
    let mut parser = Parser::new(text)?;
    let name = parser.word("an operation")?;
    parser.op(name, &[])
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Token<'a> {
    /// A word or a number: letters, digits, `_`, `.`, a leading `-`.
    Word(&'a str),
    /// A quoted text, with its escapes.
    Quoted(&'a str),
    Sign(char),
}

struct Parser<'a> {
    /// Tokens with their lines.
    tokens: Vec<(Token<'a>, usize)>,
    next: usize,
    /// The types of the current function's values.
    types: Vec<Option<Type>>,
    labels: u32,
}

type Parsed<T> = Result<T, String>;

impl<'a> Parser<'a> {
    fn new(text: &'a str) -> Parsed<Self> {
        let mut tokens = Vec::new();
        for (index, line) in text.lines().enumerate() {
            tokenize(line, index + 1, &mut tokens)
                .map_err(|message| format!("line {}: {message}", index + 1))?;
        }
        Ok(Self {
            tokens,
            next: 0,
            types: Vec::new(),
            labels: 0,
        })
    }

    fn line(&self) -> usize {
        let index = self.next.saturating_sub(1);
        self.tokens.get(index).map_or(0, |&(_, line)| line)
    }

    fn peek(&self) -> Option<Token<'a>> {
        self.tokens.get(self.next).map(|&(token, _)| token)
    }

    fn take(&mut self) -> Option<Token<'a>> {
        let token = self.peek();
        self.next += 1;
        token
    }

    /// Takes this sign if it comes next.
    fn accept(&mut self, sign: char) -> bool {
        let found = self.peek() == Some(Token::Sign(sign));
        self.next += found as usize;
        found
    }

    fn accept_word(&mut self, word: &str) -> bool {
        let found = self.peek() == Some(Token::Word(word));
        self.next += found as usize;
        found
    }

    fn expect(&mut self, sign: char) -> Parsed<()> {
        if self.accept(sign) {
            return Ok(());
        }
        Err(format!("expected `{sign}`, found {}", self.found()))
    }

    fn found(&mut self) -> String {
        match self.take() {
            Some(Token::Word(word)) => format!("`{word}`"),
            Some(Token::Quoted(name)) => format!("\"{name}\""),
            Some(Token::Sign(sign)) => format!("`{sign}`"),
            None => "the end".into(),
        }
    }

    fn word(&mut self, what: &str) -> Parsed<&'a str> {
        if let Some(Token::Word(word)) = self.peek() {
            self.next += 1;
            return Ok(word);
        }
        Err(format!("expected {what}, found {}", self.found()))
    }

    fn number(&mut self) -> Parsed<u32> {
        let word = self.word("a number")?;
        word.parse()
            .map_err(|_| format!("`{word}` is not a number"))
    }

    fn quoted(&mut self) -> Option<String> {
        let Some(Token::Quoted(raw)) = self.peek() else {
            return None;
        };
        self.next += 1;
        let mut name = String::new();
        let mut characters = raw.chars();
        while let Some(character) = characters.next() {
            name.push(match character {
                '\\' => match characters.next() {
                    Some('n') => '\n',
                    Some(other) => other,
                    None => break,
                },
                other => other,
            });
        }
        Some(name)
    }

    fn entity(&mut self, prefix: &str) -> Parsed<u32> {
        let word = self.word(prefix)?;
        word.strip_prefix(prefix)
            .and_then(|digits| digits.parse().ok())
            .filter(|&index| index < 1 << 24)
            .ok_or_else(|| format!("expected {prefix} and a number, found `{word}`"))
    }

    fn value(&mut self) -> Parsed<Value> {
        self.entity("v").map(Value)
    }

    fn values_until(&mut self, end: char) -> Parsed<Vec<Value>> {
        let mut values = Vec::new();
        while !self.accept(end) {
            if !values.is_empty() {
                self.expect(',')?;
            }
            values.push(self.value()?);
        }
        Ok(values)
    }

    fn values_in_parentheses(&mut self) -> Parsed<Vec<Value>> {
        if self.accept('(') {
            return self.values_until(')');
        }
        Ok(Vec::new())
    }

    fn ty(&mut self) -> Parsed<Type> {
        let word = self.word("a type")?;
        type_from_text(word).ok_or_else(|| format!("`{word}` is not a type"))
    }

    /// `v1: i32`, which enters the table of types.
    fn definition(&mut self) -> Parsed<Value> {
        let value = self.value()?;
        self.expect(':')?;
        let ty = self.ty()?;
        if self.types.len() <= value.index() {
            self.types.resize(value.index() + 1, None);
        }
        self.types[value.index()] = Some(ty);
        Ok(value)
    }

    fn definitions(&mut self) -> Parsed<Vec<Value>> {
        self.list(Self::definition)
    }

    /// `-> (v1: i32)` if there.
    fn construct_results(&mut self) -> Parsed<Vec<Value>> {
        if !self.accept('>') {
            return Ok(Vec::new());
        }
        self.expect('(')?;
        let results = self.definitions()?;
        self.expect(')')?;
        Ok(results)
    }

    fn label(&mut self) -> Parsed<Label> {
        let label = Label(self.entity("L")?);
        self.labels = self.labels.max(label.0 + 1);
        Ok(label)
    }

    fn module(&mut self) -> Parsed<Module> {
        let mut module = Module {
            stage: Stage::Compute,
            functions: Vec::new(),
            inputs: Vec::new(),
            query_words: Vec::new(),
            output_rows: 0,
            outputs: Vec::new(),
            tessellation: None,
            geometry: None,
            mesh: None,
            feedback: None,
            fragment: None,
            local_size: [1; 3],
            quads: false,
            shared_size_bytes: 0,
        };
        while self.peek().is_some() {
            match self.word("a part of a module")? {
                "module" => {
                    let word = self.word("a stage")?;
                    module.stage =
                        stage_from_text(word).ok_or_else(|| format!("`{word}` is not a stage"))?;
                }
                "inputs" => module.inputs.extend(self.list(Self::input_row)?),
                "query_words" => module.query_words.extend(self.list(Self::query_word)?),
                "output_rows" => module.output_rows = self.number()?,
                "outputs" => module.outputs.extend(self.list(Self::output_row)?),
                "tessellation" => {
                    let facts = module.tessellation.get_or_insert_default();
                    self.facts("tessellation", |word| facts.set(word))?;
                }
                "geometry" => {
                    let facts = module.geometry.get_or_insert_default();
                    self.facts("geometry shaders", |word| facts.set(word))?;
                }
                "mesh" => {
                    let facts = module.mesh.get_or_insert_default();
                    self.facts("mesh shaders", |word| facts.set(word))?;
                }
                "capture" => {
                    // A shader with the mode may capture nothing.
                    let facts = module.feedback.get_or_insert_default();
                    while let Some(Token::Word(word)) = self.peek()
                        && facts.set(word)
                    {
                        self.next += 1;
                        if !self.accept(',') {
                            break;
                        }
                    }
                }
                "fragment" => {
                    let facts = module.fragment.get_or_insert_default();
                    self.facts("fragments", |word| facts.set(word))?;
                }
                "local_size" => module.local_size = self.local_size()?,
                "quads" => module.quads = true,
                "shared" => module.shared_size_bytes = self.number()?,
                "func" => {
                    let id = self.entity("f")?;
                    if id as usize != module.functions.len() {
                        return Err(format!("f{id} is out of order"));
                    }
                    module.functions.push(self.function()?);
                }
                word => return Err(format!("`{word}` is not a part of a module")),
            }
        }
        Ok(module)
    }

    /// One or more elements, with commas between them.
    fn list<T>(&mut self, element: fn(&mut Self) -> Parsed<T>) -> Parsed<Vec<T>> {
        let mut list = vec![element(self)?];
        while self.accept(',') {
            list.push(element(self)?);
        }
        Ok(list)
    }

    /// One or more facts, with commas between them. `set` stores one, and returns false for a word
    /// that is none.
    fn facts(&mut self, of: &str, mut set: impl FnMut(&str) -> bool) -> Parsed<()> {
        loop {
            let word = self.word("a fact")?;
            if !set(word) {
                return Err(format!("`{word}` is not a fact of {of}"));
            }
            if !self.accept(',') {
                return Ok(());
            }
        }
    }

    fn local_size(&mut self) -> Parsed<[u32; 3]> {
        let x = self.number()?;
        self.expect(',')?;
        let y = self.number()?;
        self.expect(',')?;
        Ok([x, y, self.number()?])
    }

    fn output_row(&mut self) -> Parsed<OutputRow> {
        let word = self.word("an output row")?;
        word.parse()
            .map_err(|()| format!("`{word}` is not an output row"))
    }

    fn input_row(&mut self) -> Parsed<InputRow> {
        let word = self.word("an input row")?;
        let row = word.split_once('.').and_then(|(name, index)| {
            Some(match name {
                "payload" => InputRow::Payload(index.parse().ok()?),
                "hit_attribute" => InputRow::HitAttribute(index.parse().ok()?),
                "callable_data" => InputRow::CallableData(index.parse().ok()?),
                "attribute" => {
                    let (location, component) = index.split_once('.')?;
                    InputRow::Attribute {
                        location: location.parse().ok()?,
                        component: component.parse().ok()?,
                    }
                }
                "varying" => InputRow::Varying(word.parse().ok()?),
                "barycentric" => InputRow::Barycentric(word.parse().ok()?),
                _ => InputRow::Builtin(builtin_from_text(name)?, index.parse().ok()?),
            })
        });
        row.ok_or_else(|| format!("`{word}` is not an input row"))
    }

    fn query_word(&mut self) -> Parsed<QueryWord> {
        let word = self.word("a query's word")?;
        let mut parts = word.split('.');
        let mut parsed = || {
            let committed = match parts.next()? {
                "candidate" => false,
                "committed" => true,
                _ => return None,
            };
            let fact = Fact::from_text(parts.next()?)?;
            let component = parts.next()?.parse().ok()?;
            let whole = parts.next().is_none() && usize::from(component) < fact.words();
            whole.then_some(QueryWord {
                committed,
                fact,
                component,
            })
        };
        parsed().ok_or_else(|| format!("`{word}` is not a query's word"))
    }

    fn function(&mut self) -> Parsed<Function> {
        self.types.clear();
        self.labels = 0;
        let mut params = Vec::new();
        if self.accept('(') && !self.accept(')') {
            params = self.definitions()?;
            self.expect(')')?;
        }
        let mut results = Vec::new();
        if self.accept('>') {
            self.expect('(')?;
            while !self.accept(')') {
                if !results.is_empty() {
                    self.expect(',')?;
                }
                results.push(self.ty()?);
            }
        }
        let name = self.quoted().unwrap_or_default();
        self.expect('{')?;
        let variables = self.variables()?;
        let tables = self.tables()?;
        if self.accept_word("unused") {
            self.definitions()?;
        }
        let mut labels = 0;
        if self.accept_word("labels") {
            labels = self.number()?;
        }
        let body = self.body()?;
        Ok(Function {
            name,
            params,
            results,
            // A skipped number belongs to a value without an instruction.
            value_types: self
                .types
                .iter()
                .map(|ty| ty.unwrap_or(Type::I32))
                .collect(),
            labels: labels.max(self.labels),
            variables,
            tables,
            body,
        })
    }

    fn variables(&mut self) -> Parsed<Vec<Variable>> {
        let mut variables = Vec::new();
        while let Some(Token::Word(word)) = self.peek() {
            let Some(digits) = word.strip_prefix("var") else {
                break;
            };
            if digits.parse() != Ok(variables.len()) {
                break;
            }
            self.next += 1;
            self.expect(':')?;
            let rows = self.number()?;
            if !self.accept_word("rows") {
                return Err(format!("expected `rows`, found {}", self.found()));
            }
            let zero = self.accept_word("zero");
            let name = self.quoted().unwrap_or_default();
            variables.push(Variable { name, rows, zero });
        }
        Ok(variables)
    }

    fn tables(&mut self) -> Parsed<Vec<Vec<u32>>> {
        let mut tables: Vec<Vec<u32>> = Vec::new();
        while self.accept_word(&format!("table{}", tables.len())) {
            self.expect(':')?;
            let mut words = vec![self.number()?];
            while self.accept(',') {
                words.push(self.number()?);
            }
            tables.push(words);
        }
        Ok(tables)
    }

    /// The nodes and the terminator, up to and with the closing brace.
    fn body(&mut self) -> Parsed<Body> {
        let mut builder = BodyBuilder::default();
        loop {
            if let Some(end) = self.terminator()? {
                self.expect('}')?;
                match builder.end(end) {
                    Ended::All(body) => return Ok(body),
                    Ended::Construct => {}
                    Ended::First if !self.accept_word("else") => {
                        return Err(format!("expected `else`, found {}", self.found()));
                    }
                    Ended::First => self.expect('{')?,
                }
            } else if let Some(construct) = self.construct()? {
                builder.open(construct);
            } else {
                builder.push(self.inst().map(Node::Inst)?);
            }
        }
    }

    fn terminator(&mut self) -> Parsed<Option<Terminator>> {
        Ok(Some(if self.accept_word("br") {
            let label = self.label()?;
            Terminator::Br(label, self.values_in_parentheses()?)
        } else if self.accept_word("return") {
            Terminator::Return(self.values_in_parentheses()?)
        } else if self.accept_word("end") {
            Terminator::End(self.values_in_parentheses()?)
        } else if self.accept_word("unreachable") {
            Terminator::Unreachable
        } else {
            return Ok(None);
        }))
    }

    /// The head of a construct, up to the brace that opens its first body; its bodies come later.
    fn construct(&mut self) -> Parsed<Option<Node>> {
        let construct = if self.accept_word("block") {
            Node::Block {
                label: self.label()?,
                results: self.construct_results()?,
                body: Box::default(),
            }
        } else if self.accept_word("if") {
            let condition = self.value()?;
            self.expect(',')?;
            Node::If {
                condition,
                label: self.label()?,
                results: self.construct_results()?,
                then_body: Box::default(),
                else_body: Box::default(),
            }
        } else if self.accept_word("loop") {
            let label = self.label()?;
            let (mut params, mut init) = (Vec::new(), Vec::new());
            if self.accept('(') {
                params = self.definitions()?;
                self.expect(')')?;
                self.expect('=')?;
                self.expect('(')?;
                init = self.values_until(')')?;
            }
            Node::Loop {
                label,
                params,
                init,
                body: Box::default(),
            }
        } else {
            return Ok(None);
        };
        self.expect('{')?;
        Ok(Some(construct))
    }

    fn inst(&mut self) -> Parsed<Inst> {
        let mut results = Vec::new();
        if matches!(self.tokens.get(self.next + 1), Some((Token::Sign(':'), _))) {
            results = self.definitions()?;
            self.expect('=')?;
        }
        let name = self.word("an operation")?;
        let op = self.op(name, &results)?;
        let mut args: SmallVec<[Value; 4]> = SmallVec::new();
        let line = self.line();
        let same_line = |parser: &Self| matches!(parser.tokens.get(parser.next), Some((Token::Word(_), at)) if *at == line);
        if same_line(self) {
            args.push(self.value()?);
            while self.accept(',') {
                args.push(self.value()?);
            }
        }
        let source = if self.accept('@') { self.number()? } else { 0 };
        Ok(Inst {
            op,
            args,
            results: results.into(),
            source,
        })
    }

    fn op(&mut self, name: &str, results: &[Value]) -> Parsed<Op> {
        if name == "const" {
            let ty = results
                .first()
                .and_then(|value| self.types[value.index()])
                .ok_or("a constant without a result")?;
            return self.constant(ty).map(Op::Const);
        }
        let words = self.bracketed()?;
        let (head, rest) = name.split_once('.').unwrap_or((name, ""));
        let op = match head {
            "var" => variable_op(rest, &words),
            "load" => access_from_text(rest).map(Op::Load),
            "store" => access_from_text(rest).map(Op::Store),
            "atomic" => rest.split_once('.').and_then(|(kind, access)| {
                Some(Op::Atomic(
                    atomic_from_text(kind)?,
                    access_from_text(access)?,
                ))
            }),
            "descriptor" => binding_from_text(&words).map(Op::Descriptor),
            "descriptor_reference" => binding_from_text(&words).map(Op::DescriptorReference),
            "table" => index_from_text("", &words).map(Op::Table),
            "debug_printf" => index_from_text("", &words).map(Op::DebugPrintf),
            "input" => index_from_text("", &words).map(Op::Input),
            "uniform" => index_from_text("", &words).map(Op::Uniform),
            "call" => index_from_text("f", &words).map(|id| Op::Call(FunctionId(id))),
            "image" => image_from_text(rest, &words).map(Op::Image),
            "subgroup" => subgroup_from_text(rest, &words).map(Op::Subgroup),
            "matrix_product" => product_from_text(&words).map(Op::MatrixProduct),
            "vector_product" => space_from_text(rest)
                .zip(vector_product_from_text(&words))
                .map(|(space, product)| Op::VectorProduct(product, space)),
            "hit_object_get" => Fact::from_text(rest).map(Op::HitObjectGet),
            _ if words.is_empty() => Op::from_text(name),
            _ => None,
        };
        op.ok_or_else(|| format!("`{name}` with [{}] is no operation", words.join(", ")))
    }

    /// The contents of brackets: at each comma a word, or two with a space.
    fn bracketed(&mut self) -> Parsed<Vec<&'a str>> {
        let mut words = Vec::new();
        if self.accept('[') {
            while !self.accept(']') {
                if !self.accept(',') {
                    words.push(self.word("a word in brackets")?);
                }
            }
        }
        Ok(words)
    }

    fn constant(&mut self, ty: Type) -> Parsed<u64> {
        let word = self.word("a constant")?;
        let bits = match word.strip_prefix("0x") {
            Some(digits) => u64::from_str_radix(digits, 16).ok(),
            None => word.parse::<i128>().ok().map(|number| {
                let unused = 64 - ty.bits();
                (number as u64) << unused >> unused
            }),
        };
        bits.ok_or_else(|| format!("`{word}` is not a constant"))
    }
}

fn tokenize<'a>(line: &'a str, number: usize, tokens: &mut Vec<(Token<'a>, usize)>) -> Parsed<()> {
    let mut rest = line.trim_start();
    while let Some(first) = rest.chars().next() {
        let length = match first {
            ';' => break,
            '"' => {
                let mut escaped = false;
                let end = rest[1..].find(|character| {
                    let ends = character == '"' && !escaped;
                    escaped = character == '\\' && !escaped;
                    ends
                });
                let end = end.ok_or("a string without an end")?;
                tokens.push((Token::Quoted(&rest[1..1 + end]), number));
                end + 2
            }
            '-' if rest.starts_with("->") => {
                tokens.push((Token::Sign('>'), number));
                2
            }
            _ if is_word_character(first) || first == '-' => {
                let end = rest[1..].find(|character| !is_word_character(character));
                let length = end.map_or(rest.len(), |end| end + 1);
                tokens.push((Token::Word(&rest[..length]), number));
                length
            }
            _ => {
                tokens.push((Token::Sign(first), number));
                first.len_utf8()
            }
        };
        rest = rest[length..].trim_start();
    }
    Ok(())
}

fn is_word_character(character: char) -> bool {
    character.is_ascii_alphanumeric() || character == '_' || character == '.'
}

fn access_from_text(text: &str) -> Option<Access> {
    let (space, volatile) = match text.strip_suffix(".volatile") {
        Some(space) => (space, true),
        None => (text, false),
    };
    let (space, constant) = match space.strip_suffix(".constant") {
        Some(space) => (space, true),
        None => (space, false),
    };
    let (space, alignment) = match space.split_once(".align") {
        Some((space, bytes)) => (space, log2(bytes.parse().ok()?)?),
        None => (space, 0),
    };
    let (space, is_strided) = match space.strip_suffix(".strided") {
        Some(space) => (space, true),
        None => (space, false),
    };
    Some(Access {
        space: space_from_text(space)?,
        volatile,
        constant,
        alignment,
        is_strided,
    })
}

/// log₂ of a power of two.
fn log2(number: u64) -> Option<u8> {
    number
        .is_power_of_two()
        .then_some(number.trailing_zeros() as u8)
}

fn index_from_text(prefix: &str, words: &[&str]) -> Option<u32> {
    match words {
        [word] => word.strip_prefix(prefix)?.parse().ok(),
        _ => None,
    }
}

fn variable_op(name: &str, words: &[&str]) -> Option<Op> {
    let (variable, row) = match words {
        [variable] => (variable, None),
        [variable, row] => (variable, Some(row.parse().ok()?)),
        _ => return None,
    };
    let variable = VariableId(variable.strip_prefix("var")?.parse().ok()?);
    match (name, row) {
        ("load", Some(row)) => Some(Op::VarLoad(variable, row)),
        ("store", Some(row)) => Some(Op::VarStore(variable, row)),
        ("address", None) => Some(Op::VarAddress(variable)),
        _ => None,
    }
}

fn binding_from_text(words: &[&str]) -> Option<DescriptorBinding> {
    let (words, dynamic) = match words {
        [words @ .., "dynamic"] => (words, true),
        words => (words, false),
    };
    let ["set", set, "first", first, "count", count] = words else {
        return None;
    };
    Some(DescriptorBinding {
        set: set.parse().ok()?,
        first: first.parse().ok()?,
        count: match *count {
            "variable" => u32::MAX,
            count => count.parse().ok()?,
        },
        dynamic,
    })
}

fn image_from_text(name: &str, words: &[&str]) -> Option<ImageOp> {
    let kind = match name.split_once('.') {
        Some(("gather", component)) => ImageOpKind::Gather(component.parse().ok()?),
        Some(("atomic", atomic)) => ImageOpKind::Atomic(atomic_from_text(atomic)?),
        Some(_) => return None,
        None => match name {
            "sample" => ImageOpKind::Sample,
            "fetch" => ImageOpKind::Fetch,
            "read" => ImageOpKind::Read,
            "write" => ImageOpKind::Write,
            "query_size" => ImageOpKind::QuerySize,
            "query_levels" => ImageOpKind::QueryLevels,
            "query_samples" => ImageOpKind::QuerySamples,
            "query_lod" => ImageOpKind::QueryLod,
            _ => return None,
        },
    };
    let [dim, texel, lod, "format", format, flags @ ..] = words else {
        return None;
    };
    let mut op = ImageOp {
        texel: type_from_text(texel)?.as_texel()?,
        lod: lod_from_text(lod)?,
        format: Format(format.parse().ok()?),
        ..ImageOp::plain(kind, dim_from_text(dim)?)
    };
    for flag in flags {
        *match *flag {
            "arrayed" => &mut op.arrayed,
            "multisampled" => &mut op.multisampled,
            "depth_compare" => &mut op.depth_compare,
            "min_lod" => &mut op.has_min_lod,
            "offset" => &mut op.has_offset,
            "offsets" => &mut op.has_offsets,
            "signed" => &mut op.signed,
            "volatile" => &mut op.volatile,
            "residency" => &mut op.residency,
            _ => return None,
        } = true;
    }
    Some(op)
}
