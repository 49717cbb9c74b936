//! Prints a module.

use std::fmt::Write;

use half::f16;
use images::{ImageOp, ImageOpKind};

use super::names::*;
use crate::ir::op::{Access, DescriptorBinding};
use crate::ir::{
    Body, Function, InputRow, Inst, Label, Module, Node, Op, Step, Terminator, Type, Value,
};
use crate::query::QueryWord;

/// Largest indentation in levels, because otherwise the text would grow with the square of the
/// nesting.
const MAX_INDENT: usize = 40;

/// The text form of a module before its functions.
pub fn print_head(module: &Module) -> String {
    let mut text = format!("module {}\n", stage_text(module.stage));
    if !module.inputs.is_empty() {
        let rows: Vec<String> = module.inputs.iter().map(input_row_text).collect();
        text += &format!("inputs {}\n", rows.join(", "));
    }
    if !module.query_words.is_empty() {
        let words: Vec<String> = module.query_words.iter().map(query_word_text).collect();
        text += &format!("query_words {}\n", words.join(", "));
    }
    text += &format!("output_rows {}\n", module.output_rows);
    if !module.outputs.is_empty() {
        let rows: Vec<String> = module.outputs.iter().map(|row| row.to_string()).collect();
        text += &format!("outputs {}\n", rows.join(", "));
    }
    if let Some(facts) = &module.tessellation {
        text += &format!("tessellation {facts}\n");
    }
    if let Some(facts) = &module.geometry {
        text += &format!("geometry {facts}\n");
    }
    if let Some(facts) = &module.mesh {
        text += &format!("mesh {facts}\n");
    }
    if let Some(facts) = &module.feedback {
        text += &format!("capture {facts}\n");
    }
    if let Some(facts) = &module.fragment {
        text += &format!("fragment {facts}\n");
    }
    if module.local_size != [1; 3] {
        let [x, y, z] = module.local_size;
        text += &format!("local_size {x}, {y}, {z}\n");
    }
    if module.quads {
        text += "quads\n";
    }
    if module.shared_size_bytes != 0 {
        text += &format!("shared {}\n", module.shared_size_bytes);
    }
    text
}

/// The text form of a module.
pub fn print_module(module: &Module) -> String {
    let mut text = print_head(module);
    for (index, function) in module.functions.iter().enumerate() {
        let mut printer = Printer {
            function,
            text: &mut text,
            indent: 1,
            seen_values: vec![false; function.value_types.len()],
            label_count: 0,
        };
        printer.print_function(index);
    }
    text
}

fn input_row_text(row: &InputRow) -> String {
    match row {
        InputRow::Builtin(builtin, word) => format!("{}.{word}", builtin_text(*builtin)),
        InputRow::Payload(word) => format!("payload.{word}"),
        InputRow::HitAttribute(word) => format!("hit_attribute.{word}"),
        InputRow::CallableData(word) => format!("callable_data.{word}"),
        InputRow::Attribute {
            location,
            component,
        } => format!("attribute.{location}.{component}"),
        InputRow::Varying(varying) => varying.to_string(),
        InputRow::Barycentric(coordinate) => coordinate.to_string(),
    }
}

fn query_word_text(word: &QueryWord) -> String {
    let of = if word.committed {
        "committed"
    } else {
        "candidate"
    };
    format!("{of}.{}.{}", word.fact.text(), word.component)
}

/// A quoted string, with escapes for the characters that would end the string or the line.
fn quoted(name: &str) -> String {
    let mut text = String::from("\"");
    for character in name.chars() {
        match character {
            '"' | '\\' => text.extend(['\\', character]),
            '\n' => text += "\\n",
            _ => text.push(character),
        }
    }
    text + "\""
}

struct Printer<'a> {
    function: &'a Function,
    text: &'a mut String,
    indent: usize,
    seen_values: Vec<bool>,
    /// One more than the largest printed label.
    label_count: u32,
}

impl Printer<'_> {
    fn print_function(&mut self, index: usize) {
        let function = self.function;
        let _ = write!(self.text, "\nfunc f{index}");
        if !function.params.is_empty() {
            let params = self.definitions(&function.params);
            let _ = write!(self.text, " ({params})");
        }
        if !function.results.is_empty() {
            let results: Vec<&str> = function.results.iter().map(|&ty| type_text(ty)).collect();
            let _ = write!(self.text, " -> ({})", results.join(", "));
        }
        if !function.name.is_empty() {
            let _ = write!(self.text, " {}", quoted(&function.name));
        }
        *self.text += " {\n";
        for (index, variable) in function.variables.iter().enumerate() {
            let zero = if variable.zero { " zero" } else { "" };
            let _ = write!(self.text, "  var{index}: {} rows{zero}", variable.rows);
            if !variable.name.is_empty() {
                let _ = write!(self.text, " {}", quoted(&variable.name));
            }
            self.text.push('\n');
        }
        for (index, table) in function.tables.iter().enumerate() {
            let words: Vec<String> = table.iter().map(u32::to_string).collect();
            let _ = writeln!(self.text, "  table{index}: {}", words.join(", "));
        }
        let head = self.text.len();
        self.print_body(&function.body);
        *self.text += "}\n";
        let unseen: Vec<Value> = (0..function.value_types.len())
            .filter(|&index| !self.seen_values[index])
            .map(|index| Value(index as u32))
            .collect();
        let mut unused = String::new();
        if !unseen.is_empty() {
            unused = format!("  unused {}\n", self.definitions(&unseen));
        }
        if self.label_count != function.labels {
            unused += &format!("  labels {}\n", function.labels);
        }
        self.text.insert_str(head, &unused);
    }

    fn line(&mut self, line: &str) {
        for _ in 0..self.indent.min(MAX_INDENT) {
            *self.text += "  ";
        }
        *self.text += line;
        self.text.push('\n');
    }

    /// `v1: i32, v2: f32`.
    fn definitions(&mut self, values: &[Value]) -> String {
        let mut text = String::new();
        for (index, &value) in values.iter().enumerate() {
            if index > 0 {
                text += ", ";
            }
            // A malformed module must still print.
            match self.function.value_types.get(value.index()) {
                Some(&ty) => {
                    self.seen_values[value.index()] = true;
                    let _ = write!(text, "{value}: {}", type_text(ty));
                }
                None => {
                    let _ = write!(text, "{value}: ?");
                }
            }
        }
        text
    }

    /// ` -> (v1: i32)` or nothing.
    fn construct_results(&mut self, results: &[Value]) -> String {
        if results.is_empty() {
            return String::new();
        }
        format!(" -> ({})", self.definitions(results))
    }

    fn see_label(&mut self, label: Label) {
        self.label_count = self.label_count.max(label.0 + 1);
    }

    fn print_body(&mut self, body: &Body) {
        for step in body.steps() {
            match step {
                Step::Inst(inst) => {
                    let line = self.inst_line(inst);
                    self.line(&line);
                }
                Step::Open(node) => {
                    let line = self.construct_line(node);
                    self.line(&line);
                    self.indent += 1;
                }
                Step::Else(_) => {
                    self.indent -= 1;
                    self.line("} else {");
                    self.indent += 1;
                }
                Step::End(body) => {
                    let end = match &body.end {
                        Terminator::Br(label, args) => {
                            format!("br {label}{}", in_parentheses(args))
                        }
                        Terminator::Return(args) => format!("return{}", in_parentheses(args)),
                        Terminator::End(args) => format!("end{}", in_parentheses(args)),
                        Terminator::Unreachable => "unreachable".into(),
                    };
                    self.line(&end);
                }
                Step::Close(_) => {
                    self.indent -= 1;
                    self.line("}");
                }
            }
        }
    }

    /// The line that a construct begins with.
    fn construct_line(&mut self, node: &Node) -> String {
        if let Some(label) = node.label() {
            self.see_label(label);
        }
        match node {
            Node::Inst(inst) => self.inst_line(inst),
            Node::Block { label, results, .. } => {
                format!("block {label}{} {{", self.construct_results(results))
            }
            Node::If {
                condition,
                label,
                results,
                ..
            } => format!(
                "if {condition}, {label}{} {{",
                self.construct_results(results)
            ),
            Node::Loop {
                label,
                params,
                init,
                ..
            } => {
                let mut params = self.definitions(params);
                if !params.is_empty() {
                    params = format!(" ({params}) = ({})", list(init));
                }
                format!("loop {label}{params} {{")
            }
        }
    }

    fn inst_line(&mut self, inst: &Inst) -> String {
        let mut line = self.definitions(&inst.results);
        if !line.is_empty() {
            line += " = ";
        }
        line += &print_op(&inst.op);
        let mut comment = String::new();
        if let Op::Const(bits) = inst.op {
            let ty = inst
                .results
                .first()
                .and_then(|value| self.function.value_types.get(value.index()));
            let (number, value) = constant_text(bits, ty.copied().unwrap_or(Type::I64));
            line += &format!(" {number}");
            comment = value;
        }
        if !inst.args.is_empty() {
            line += &format!(" {}", list(&inst.args));
        }
        if inst.source != 0 {
            line += &format!(" @{}", inst.source);
        }
        line + &comment
    }
}

fn list(values: &[Value]) -> String {
    let mut text = String::new();
    for (index, value) in values.iter().enumerate() {
        let comma = if index > 0 { ", " } else { "" };
        let _ = write!(text, "{comma}{value}");
    }
    text
}

fn in_parentheses(values: &[Value]) -> String {
    if values.is_empty() {
        return String::new();
    }
    format!("({})", list(values))
}

/// A constant's number, with its value as a comment if the number is a bit pattern.
fn constant_text(bits: u64, ty: Type) -> (String, String) {
    let width = ty.bits();
    let unused = 64 - width;
    if bits << unused >> unused != bits {
        return (format!("{bits:#x}"), String::new());
    }
    match ty {
        Type::F16 => (
            format!("{bits:#06x}"),
            format!(" ; {:?}", f16::from_bits(bits as u16)),
        ),
        Type::F32 => (
            format!("{bits:#010x}"),
            format!(" ; {:?}", f32::from_bits(bits as u32)),
        ),
        Type::F64 => (
            format!("{bits:#018x}"),
            format!(" ; {:?}", f64::from_bits(bits)),
        ),
        Type::I1 => (bits.to_string(), String::new()),
        _ => (
            (((bits << unused) as i64) >> unused).to_string(),
            String::new(),
        ),
    }
}

fn access_text(access: &Access) -> String {
    let volatile = if access.volatile { ".volatile" } else { "" };
    let constant = if access.constant { ".constant" } else { "" };
    let aligned = match access.alignment {
        0 => String::new(),
        alignment => format!(".align{}", 1u64 << alignment.min(63)),
    };
    let strided = if access.is_strided { ".strided" } else { "" };
    let space = space_text(access.space);
    format!("{space}{strided}{aligned}{constant}{volatile}")
}

/// The text form of an operation with its brackets, but without operands and the bits of constants.
pub fn print_op(op: &Op) -> String {
    let name = op.text();
    match op {
        Op::VarLoad(variable, row) | Op::VarStore(variable, row) => {
            format!("{name}[{variable}, {row}]")
        }
        Op::VarAddress(variable) => format!("{name}[{variable}]"),
        Op::Load(access) | Op::Store(access) => format!("{name}.{}", access_text(access)),
        Op::Atomic(kind, access) => {
            format!("{name}.{}.{}", atomic_text(*kind), access_text(access))
        }
        Op::Descriptor(binding) | Op::DescriptorReference(binding) => {
            format!("{name}[{}]", binding_text(binding))
        }
        Op::Input(index) | Op::Uniform(index) | Op::Table(index) | Op::DebugPrintf(index) => {
            format!("{name}[{index}]")
        }
        Op::Call(callee) => format!("{name}[{callee}]"),
        Op::Image(image) => image_text(image),
        Op::Subgroup(kind) => match subgroup_text(*kind) {
            (kind, words) if words.is_empty() => format!("{name}.{kind}"),
            (kind, words) => format!("{name}.{kind}[{words}]"),
        },
        Op::MatrixProduct(product) => format!("{name}[{}]", product_text(product)),
        Op::VectorProduct(product, space) => {
            let (space, words) = (space_text(*space), vector_product_text(product));
            format!("{name}.{space}[{words}]")
        }
        Op::HitObjectGet(fact) => format!("{name}.{}", fact.text()),
        _ => name.into(),
    }
}

fn binding_text(binding: &DescriptorBinding) -> String {
    let mut text = format!("set {}, first {}", binding.set, binding.first);
    if binding.count == u32::MAX {
        text += ", count variable";
    } else {
        text += &format!(", count {}", binding.count);
    }
    if binding.dynamic {
        text += ", dynamic";
    }
    text
}

fn image_text(op: &ImageOp) -> String {
    let kind = match op.kind {
        ImageOpKind::Sample => "sample".into(),
        ImageOpKind::Fetch => "fetch".into(),
        ImageOpKind::Gather(component) => format!("gather.{component}"),
        ImageOpKind::Read => "read".into(),
        ImageOpKind::Write => "write".into(),
        ImageOpKind::Atomic(atomic) => format!("atomic.{}", atomic_text(atomic)),
        ImageOpKind::QuerySize => "query_size".into(),
        ImageOpKind::QueryLevels => "query_levels".into(),
        ImageOpKind::QuerySamples => "query_samples".into(),
        ImageOpKind::QueryLod => "query_lod".into(),
    };
    let mut words = vec![
        dim_text(op.dim).to_string(),
        type_text(op.texel.into()).to_string(),
        lod_text(op.lod).to_string(),
        format!("format {}", op.format.0),
    ];
    for (holds, word) in image_flags(op) {
        if holds {
            words.push(word.to_string());
        }
    }
    format!("image.{kind}[{}]", words.join(", "))
}

/// The flags of an image operation, with their words.
fn image_flags(op: &ImageOp) -> [(bool, &'static str); 9] {
    [
        (op.arrayed, "arrayed"),
        (op.multisampled, "multisampled"),
        (op.depth_compare, "depth_compare"),
        (op.has_min_lod, "min_lod"),
        (op.has_offset, "offset"),
        (op.has_offsets, "offsets"),
        (op.signed, "signed"),
        (op.volatile, "volatile"),
        (op.residency, "residency"),
    ]
}
