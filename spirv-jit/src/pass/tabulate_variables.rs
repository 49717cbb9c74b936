//! Turns variables of constants into tables: `const vec2 disk[64] = vec2[](…)`, which shaders
//! initialize in each invocation and then only read by an index.

use smallvec::smallvec;

use super::edit::{Edit, edit_body};
use crate::ir::op::MAX_TABLE_RESULTS;
use crate::ir::{Body, Function, Inst, Node, Op, Space, Step, Type, Value, VariableId};

/// Largest variable that becomes a table.
const MAX_ROWS: u32 = 1 << 14;

/// Creates tables for the variables that qualify, and removes their stores.
pub fn tabulate_variables(function: &mut Function) {
    let contents = find(function);
    let mut tables = vec![None; contents.len()];
    for (table, words) in tables.iter_mut().zip(contents) {
        if let Some(words) = words {
            *table = Some(function.tables.len() as u32);
            function.tables.push(words);
        }
    }
    if tables.iter().all(Option::is_none) {
        return;
    }
    let mut rewriter = TableRewriter {
        tables: &tables,
        indices: vec![None; function.value_types.len()],
    };
    edit_body(&mut function.body, &mut rewriter);
}

/// The contents of each variable after its last store, if they are uniform and every other use is a
/// later load.
fn find(function: &Function) -> Vec<Option<Vec<u32>>> {
    let mut analysis = TableAnalysis {
        function,
        constants: vec![None; function.value_types.len()],
        places: vec![None; function.value_types.len()],
        contents: (function.variables.iter())
            .map(|v| (v.rows <= MAX_ROWS).then(|| vec![0; v.rows as usize]))
            .collect(),
        is_read: vec![false; function.variables.len()],
    };
    analysis.body(&function.body);
    let mut contents = analysis.contents;
    for (words, is_read) in contents.iter_mut().zip(analysis.is_read) {
        if !is_read {
            *words = None;
        }
    }
    contents
}

struct TableAnalysis<'f> {
    function: &'f Function,
    constants: Vec<Option<u32>>,
    /// By value: the variable into which it is an address, at any row.
    places: Vec<Option<VariableId>>,
    /// By variable: its rows; `None` if it is no table.
    contents: Vec<Option<Vec<u32>>>,
    /// By variable: there was a load by an address.
    is_read: Vec<bool>,
}

impl TableAnalysis<'_> {
    fn body(&mut self, body: &Body) {
        let mut depth = 0;
        for step in body.steps() {
            match step {
                // Every invocation runs the outermost body once.
                Step::Inst(inst) => self.inst(inst, depth == 0),
                Step::Open(node) => {
                    depth += 1;
                    node.operands()
                        .iter()
                        .for_each(|&value| self.give_up(value));
                }
                Step::Close(_) => depth -= 1,
                Step::Else(_) => {}
                Step::End(body) => {
                    let operands = body.end.operands().iter();
                    operands.for_each(|&value| self.give_up(value));
                }
            }
        }
    }

    /// The value has a use that is not analyzed.
    fn give_up(&mut self, value: Value) {
        if let Some(variable) = self.places[value.index()] {
            self.contents[variable.index()] = None;
        }
    }

    fn inst(&mut self, inst: &Inst, outermost: bool) {
        match inst.op {
            Op::Const(bits) if self.function.ty(inst.results[0]).bits() == 32 => {
                self.constants[inst.results[0].index()] = Some(bits as u32);
            }
            Op::VarAddress(variable) => self.places[inst.results[0].index()] = Some(variable),
            Op::IAdd => {
                let [a, b] = [0, 1].map(|k| self.places[inst.args[k].index()]);
                if a.is_some() && b.is_some() {
                    inst.args.iter().for_each(|&value| self.give_up(value));
                }
                self.places[inst.results[0].index()] = a.or(b);
            }
            Op::VarStore(variable, row) => {
                self.give_up(inst.args[0]);
                let constant = self.constants[inst.args[0].index()];
                let is_read = self.is_read[variable.index()];
                let contents = &mut self.contents[variable.index()];
                let word = contents
                    .as_mut()
                    .and_then(|words| words.get_mut(row as usize));
                match (constant, word) {
                    (Some(constant), Some(word)) if outermost && !is_read => *word = constant,
                    _ => *contents = None,
                }
            }
            // Promotion has already handled fixed rows.
            Op::VarLoad(variable, _) => self.contents[variable.index()] = None,
            Op::Load(access) if access.space == Space::Private => {
                let word =
                    |&value: &Value| matches!(self.function.ty(value), Type::I32 | Type::F32);
                let fits = inst.results.len() <= MAX_TABLE_RESULTS && inst.results.iter().all(word);
                match self.places[inst.args[0].index()] {
                    Some(variable) if fits && !access.volatile => {
                        self.is_read[variable.index()] = true;
                    }
                    _ => self.give_up(inst.args[0]),
                }
            }
            _ => inst.args.iter().for_each(|&value| self.give_up(value)),
        }
    }
}

struct TableRewriter<'f> {
    /// By variable.
    tables: &'f [Option<u32>],
    /// By value: the table that it is an index of.
    indices: Vec<Option<u32>>,
}

impl Edit for TableRewriter<'_> {
    fn inst(&mut self, inst: &mut Inst, before: &mut Vec<Node>) -> bool {
        match inst.op {
            Op::VarStore(variable, _) => return self.tables[variable.index()].is_none(),
            Op::VarAddress(variable) => {
                if let Some(table) = self.tables[variable.index()] {
                    // Its table's first word.
                    inst.op = Op::Const(0);
                    self.indices[inst.results[0].index()] = Some(table);
                }
            }
            Op::IAdd => {
                let table = inst
                    .args
                    .iter()
                    .find_map(|&value| self.indices[value.index()]);
                self.indices[inst.results[0].index()] = table;
            }
            Op::Load(access) if access.space == Space::Private => {
                if let Some(table) = self.indices[inst.args[0].index()] {
                    before.push(Node::Inst(Inst {
                        op: Op::Table(table),
                        args: smallvec![inst.args[0]],
                        results: std::mem::take(&mut inst.results),
                        source: inst.source,
                    }));
                    return false;
                }
            }
            _ => {}
        }
        true
    }
}
