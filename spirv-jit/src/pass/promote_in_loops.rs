//! Loop-local variables. If a loop accesses a variable at fixed rows only, these rows become a
//! separate variable, which `promote_variables` can promote to values, although code outside the
//! loop takes the address of the whole variable. The rows are copied in before the loop and out
//! after it.
//!
//! Loops that suspend the wave, except at a barrier, get no variables: rows in memory are free
//! across a suspension, while values would be saved and restored.

use std::collections::BTreeMap;

use smallvec::smallvec;

use super::edit::{Edit, Fate, edit_body};
use super::promote_variables::one_type;
use crate::ir::{
    Body, Function, Inst, Label, Node, Op, Space, Step, Terminator, Type, Value, Variable,
    VariableId,
};

/// Largest number of own rows of a loop.
const MAX_ROWS: usize = 256;

/// Largest number of outer labels that such a loop may branch to. Each gets a copy of the rows.
const MAX_EXITS: usize = 4;

/// Largest average number of visits of a node in the search for exits, since nested loops may each
/// have their own variables.
const MAX_LOOKS: usize = 8;

/// Creates loop-local variables, outer loops first. Returns whether it created any.
pub fn promote_in_loops(function: &mut Function) -> bool {
    let mut survey = Survey::new(function);
    survey.body(&function.body);
    let owned = survey.choose();
    if owned.is_empty() {
        return false;
    }
    let mut rewriter = LoopRewriter {
        looks: MAX_LOOKS * survey.position,
        around: vec![None; function.variables.len()],
        owned,
        function,
        open: Vec::new(),
        changed_end: None,
    };
    let mut body = std::mem::replace(&mut rewriter.function.body, unreachable());
    edit_body(&mut body, &mut rewriter);
    rewriter.function.body = body;
    true
}

fn unreachable() -> Body {
    Body {
        nodes: Vec::new(),
        end: Terminator::Unreachable,
    }
}

/// A loop as a range of positions: nodes are numbered in tree order.
struct Span {
    label: Label,
    begin: usize,
    end: usize,
}

/// An access to a fixed row.
struct RowAccess {
    variable: VariableId,
    row: u32,
    ty: Type,
    is_store: bool,
    position: usize,
}

/// The accesses of a function to its variables.
struct Survey<'f> {
    function: &'f Function,
    /// The number of nodes visited.
    position: usize,
    /// By value: the variable into which the value is an address, at any row.
    places: Vec<Option<VariableId>>,
    /// By variable: an address is taken.
    pinned: Vec<bool>,
    /// By variable: positions of accesses through an address, ascending.
    disturbed: Vec<Vec<usize>>,
    /// Positions of accesses that may be to any variable with an address, and of suspensions across
    /// which no loop-local variable may live; ascending.
    barred: Vec<usize>,
    accesses: Vec<RowAccess>,
    /// In ascending order of their beginnings.
    loops: Vec<Span>,
}

impl<'f> Survey<'f> {
    fn new(function: &'f Function) -> Self {
        Self {
            function,
            position: 0,
            places: vec![None; function.value_types.len()],
            pinned: vec![false; function.variables.len()],
            disturbed: vec![Vec::new(); function.variables.len()],
            barred: Vec::new(),
            accesses: Vec::new(),
            loops: Vec::new(),
        }
    }

    fn body(&mut self, body: &Body) {
        let mut open = Vec::new();
        for step in body.steps() {
            match step {
                Step::Inst(inst) => {
                    self.position += 1;
                    self.inst(inst);
                }
                Step::Open(node) => {
                    self.position += 1;
                    if let Node::Loop { label, .. } = node {
                        open.push(self.loops.len());
                        self.loops.push(Span {
                            label: *label,
                            begin: self.position,
                            end: self.position,
                        });
                    }
                }
                Step::Close(Node::Loop { .. }) => {
                    self.position += 1;
                    let index = open.pop().expect("the loop is open");
                    self.loops[index].end = self.position;
                }
                Step::Else(_) | Step::End(_) | Step::Close(_) => {}
            }
        }
    }

    fn inst(&mut self, inst: &Inst) {
        let (variable, row, value, is_store) = match inst.op {
            Op::VarLoad(variable, row) => (variable, row, inst.results[0], false),
            Op::VarStore(variable, row) => (variable, row, inst.args[0], true),
            Op::VarAddress(variable) => {
                self.pinned[variable.index()] = true;
                self.places[inst.results[0].index()] = Some(variable);
                return;
            }
            Op::IAdd => {
                // The sum of two addresses is no address.
                let place = match [0, 1].map(|k| self.places[inst.args[k].index()]) {
                    [place, None] | [None, place] => place,
                    _ => None,
                };
                self.places[inst.results[0].index()] = place;
                return;
            }
            Op::Load(access) | Op::Store(access) if access.space == Space::Private => {
                match self.places[inst.args[0].index()] {
                    Some(variable) => self.disturbed[variable.index()].push(self.position),
                    None => self.barred.push(self.position),
                }
                return;
            }
            Op::Barrier | Op::BarrierArrive | Op::BarrierWait => return,
            Op::Call(_) => return self.barred.push(self.position),
            op if op.is_yield() => return self.barred.push(self.position),
            _ => return,
        };
        self.accesses.push(RowAccess {
            variable,
            row,
            ty: self.function.ty(value),
            is_store,
            position: self.position,
        });
    }

    /// Selects the rows of each loop: for each variable, the outermost loops that access it at
    /// fixed rows only.
    fn choose(&self) -> BTreeMap<Label, Vec<Owned>> {
        let mut uses: BTreeMap<(Label, VariableId), BTreeMap<u32, RowUse>> = BTreeMap::new();
        let mut coming = self.loops.iter().peekable();
        // The loops around the access, outermost first.
        let mut around: Vec<&Span> = Vec::new();
        for access in &self.accesses {
            let at = access.position;
            while let Some(span) = coming.next_if(|span| span.begin < at) {
                while around.last().is_some_and(|last| last.end < span.begin) {
                    around.pop();
                }
                around.push(span);
            }
            while around.last().is_some_and(|last| last.end < at) {
                around.pop();
            }
            let variable = access.variable.index();
            if !self.pinned[variable] {
                continue;
            }
            let (after, before) = free_range(&[&self.disturbed[variable], &self.barred], at);
            let is_disturbed = |span: &&Span| span.begin < after || span.end > before;
            let Some(span) = around.get(around.partition_point(is_disturbed)) else {
                continue;
            };
            let rows = uses.entry((span.label, access.variable)).or_default();
            let row = rows.entry(access.row).or_default();
            row.types |= 1 << access.ty as u8;
            row.is_stored |= access.is_store;
        }
        let mut owned: BTreeMap<Label, Vec<Owned>> = BTreeMap::new();
        let mut counts: BTreeMap<Label, usize> = BTreeMap::new();
        for ((label, variable), rows) in uses {
            let count = counts.entry(label).or_default();
            if *count + rows.len() > MAX_ROWS {
                continue;
            }
            if let Some(rows) = place_rows(&rows) {
                *count += rows.len();
                let own = Owned { variable, rows };
                owned.entry(label).or_default().push(own);
            }
        }
        owned
    }
}

/// The nearest positions before and after `at` in ascending lists.
fn free_range(lists: &[&[usize]], at: usize) -> (usize, usize) {
    let (mut after, mut before) = (0, usize::MAX);
    for list in lists {
        let next = list.partition_point(|&position| position < at);
        after = after.max(if next > 0 { list[next - 1] } else { 0 });
        before = before.min(list.get(next).copied().unwrap_or(usize::MAX));
    }
    (after, before)
}

/// The use of a row by a loop.
#[derive(Clone, Copy, Default)]
struct RowUse {
    /// A set of `1 << Type`.
    types: u8,
    is_stored: bool,
}

/// A row that a loop has as its own.
#[derive(Clone, Copy)]
struct OwnRow {
    /// The row in the loop's variable.
    row: u32,
    ty: Type,
    is_stored: bool,
}

/// The rows of a variable that a loop has as its own, by the variable's row.
struct Owned {
    variable: VariableId,
    rows: BTreeMap<u32, OwnRow>,
}

/// Numbers the rows; `None` if accesses to a row differ in width or overlap.
fn place_rows(rows: &BTreeMap<u32, RowUse>) -> Option<BTreeMap<u32, OwnRow>> {
    let mut next = 0;
    let place = |(&row, used): (&u32, &RowUse)| {
        let ty = one_type(used.types)?;
        if ty.rows() == 2 && rows.contains_key(&(row + 1)) {
            return None;
        }
        let own = OwnRow {
            row: next,
            ty,
            is_stored: used.is_stored,
        };
        next += ty.rows();
        Some((row, own))
    };
    rows.iter().map(place).collect()
}

/// The labels outside that a loop branches to, and the types of their arguments.
type Exits = Vec<(Label, Vec<Type>)>;

/// A loop during its rewrite.
struct OpenLoop {
    owned: Vec<Owned>,
    /// The loop's variables, by index in `owned`.
    own: Vec<VariableId>,
    exits: Exits,
}

struct LoopRewriter<'f> {
    function: &'f mut Function,
    owned: BTreeMap<Label, Vec<Owned>>,
    /// By variable: the variable and rows of an enclosing loop that replace it.
    around: Vec<Option<(VariableId, BTreeMap<u32, OwnRow>)>>,
    looks: usize,
    /// The loops around the current node; `None` for a loop without variables of its own.
    open: Vec<Option<OpenLoop>>,
    /// The end of the current body, if copies after a loop changed it.
    changed_end: Option<Terminator>,
}

impl Edit for LoopRewriter<'_> {
    fn inst(&mut self, inst: &mut Inst, _: &mut Vec<Node>) -> bool {
        if let Op::VarLoad(variable, row) | Op::VarStore(variable, row) = &mut inst.op
            && let Some((own, rows)) = self.around.get(variable.index()).and_then(Option::as_ref)
        {
            *row = rows[row].row;
            *variable = *own;
        }
        true
    }

    fn open(&mut self, construct: &mut Node) {
        if let Node::Loop { label, body, .. } = construct {
            let open = self.enter(*label, body);
            self.open.push(open);
        }
    }

    fn end(&mut self, body: &mut Body) {
        if let Some(end) = self.changed_end.take() {
            body.end = end;
        }
    }

    fn close(&mut self, construct: &mut Node, before: &mut Vec<Node>) -> Fate {
        if !matches!(construct, Node::Loop { .. }) {
            return Fate::Stays;
        }
        let Some(open) = self.open.pop().flatten() else {
            return Fate::Stays;
        };
        for owned in &open.owned {
            self.around[owned.variable.index()] = None;
        }
        let node = std::mem::replace(construct, nothing());
        self.surround(node, open, before);
        Fate::Ends
    }
}

/// A placeholder for a moved loop.
fn nothing() -> Node {
    Node::Inst(Inst {
        op: Op::Const(0),
        args: smallvec![],
        results: smallvec![],
        source: 0,
    })
}

impl LoopRewriter<'_> {
    /// Creates the variables of a loop.
    fn enter(&mut self, label: Label, body: &Body) -> Option<OpenLoop> {
        let owned = self.owned.remove(&label)?;
        let exits = self.find_exits(label, body)?;
        let own: Vec<VariableId> = owned.iter().map(|owned| self.own_variable(owned)).collect();
        for (owned, &own) in owned.iter().zip(&own) {
            self.around[owned.variable.index()] = Some((own, owned.rows.clone()));
        }
        Some(OpenLoop { owned, own, exits })
    }

    fn own_variable(&mut self, owned: &Owned) -> VariableId {
        let name = self.function.variables[owned.variable.index()].name.clone();
        self.function.new_variable(Variable {
            name,
            rows: owned.rows.values().map(|row| row.ty.rows()).sum(),
            zero: false,
        })
    }

    /// The exits of a loop; `None` if there are too many, or the budget of visits is spent.
    fn find_exits(&mut self, label: Label, body: &Body) -> Option<Exits> {
        let mut inside = vec![label];
        body.visit(&mut |node| {
            self.looks = self.looks.saturating_sub(1);
            inside.extend(node.label());
        });
        if self.looks == 0 {
            return None;
        }
        inside.sort_unstable();
        let mut exits = Exits::new();
        body.visit_bodies(&mut |body| {
            if let Terminator::Br(target, args) = &body.end
                && inside.binary_search(target).is_err()
                && exits.len() <= MAX_EXITS
                && !exits.iter().any(|(exit, _)| exit == target)
            {
                let types = args.iter().map(|&value| self.function.ty(value));
                exits.push((*target, types.collect()));
            }
        });
        (exits.len() <= MAX_EXITS).then_some(exits)
    }

    /// Surrounds a loop with copies. The body ends after it, since control never passes a loop's
    /// end.
    fn surround(&mut self, mut node: Node, open: OpenLoop, before: &mut Vec<Node>) {
        let OpenLoop { owned, own, exits } = open;
        let labels: Vec<(Label, Label)> = (exits.iter())
            .map(|&(exit, _)| (exit, self.function.new_label()))
            .collect();
        node.bodies_mut().for_each(|body| {
            body.visit_bodies_mut(&mut |body| {
                if let Terminator::Br(target, _) = &mut body.end
                    && let Some((_, label)) = labels.iter().find(|(exit, _)| exit == target)
                {
                    *target = *label;
                }
            });
        });
        let mut inner = unreachable();
        for (owned, &own) in owned.iter().zip(&own) {
            for (&row, of_own) in &owned.rows {
                let (from, to) = ((owned.variable, row), (own, of_own.row));
                self.copy(from, to, of_own.ty, &mut inner.nodes);
            }
        }
        inner.nodes.push(node);
        for ((exit, types), (_, label)) in exits.into_iter().zip(labels) {
            let results: Vec<Value> = types
                .iter()
                .map(|&ty| self.function.new_value(ty))
                .collect();
            let mut outer = Body {
                nodes: vec![Node::Block {
                    label,
                    results: results.clone(),
                    body: inner.into(),
                }],
                end: Terminator::Br(exit, results),
            };
            for (owned, &own) in owned.iter().zip(&own) {
                for (&row, of_own) in owned.rows.iter().filter(|(_, of_own)| of_own.is_stored) {
                    let (from, to) = ((own, of_own.row), (owned.variable, row));
                    self.copy(from, to, of_own.ty, &mut outer.nodes);
                }
            }
            inner = outer;
        }
        before.append(&mut inner.nodes);
        let end = std::mem::replace(&mut inner.end, Terminator::Unreachable);
        self.changed_end = Some(end);
    }

    fn copy(
        &mut self,
        from: (VariableId, u32),
        to: (VariableId, u32),
        ty: Type,
        nodes: &mut Vec<Node>,
    ) {
        let value = self.function.new_value(ty);
        nodes.push(Node::Inst(Inst {
            op: Op::VarLoad(from.0, from.1),
            args: smallvec![],
            results: smallvec![value],
            source: 0,
        }));
        nodes.push(Node::Inst(Inst {
            op: Op::VarStore(to.0, to.1),
            args: smallvec![value],
            results: smallvec![],
            source: 0,
        }));
    }
}

#[cfg(test)]
mod tests {
    use crate::ir::text::parse_module;
    use crate::ir::{Module, Op, verify};
    use crate::pass::run_pass;

    /// A sum at a fixed row in the inner of two loops, with more instructions in each; code behind
    /// the loops reads the variable through an address.
    fn nested(outer: &str, inner: &str) -> Module {
        let text = format!(
            "module compute
            inputs local_invocation_index.0
            output_rows 0
            func f0 {{
                var0: 8 rows zero
                var1: 8 rows zero
                v0: i32 = input[0]
                v1: i32 = const 0
                v2: i32 = const 1
                v3: i32 = const 9
                v4: descriptor = descriptor[set 0, first 0, count 1] v1
                v5: i32 = var.address[var0]
                v6: i32 = iadd v5, v0
                v7: i32 = var.address[var1]
                v8: i32 = iadd v7, v0
                block L0 {{
                    loop L1 (v10: i32) = (v1) {{
                        v11: i1 = ult v10, v3
                        if v11, L2 {{ br L2 }} else {{ br L0 }}
                        block L3 {{
                            loop L4 (v12: i32) = (v1) {{
                                v13: i1 = ult v12, v0
                                if v13, L5 {{ br L5 }} else {{ br L3 }}
                                v14: i32 = var.load[var0, 1]
                                v15: i32 = iadd v14, v12
                                var.store[var0, 1] v15
                                {inner}
                                v16: i32 = iadd v12, v2
                                br L4(v16)
                            }}
                            unreachable
                        }}
                        {outer}
                        v17: i32 = iadd v10, v2
                        br L1(v17)
                    }}
                    unreachable
                }}
                v18: i32 = load.private v6
                store.buffer v4, v1, v18
                end
            }}"
        );
        let mut module = parse_module(&text).unwrap();
        verify(&module).unwrap();
        assert!(run_pass("promote_in_loops", &mut module));
        module
    }

    /// The number of loads of the first variable's fixed rows in loops, and the number of
    /// variables.
    fn left(module: &Module) -> (usize, usize) {
        let function = &module.functions[0];
        let mut count = 0;
        function.body.visit(&mut |node| {
            if let crate::ir::Node::Loop { body, .. } = node {
                body.visit_insts(&mut |inst| {
                    count += usize::from(
                        matches!(inst.op, Op::VarLoad(variable, _) if variable.index() == 0),
                    );
                });
            }
        });
        (count, function.variables.len())
    }

    #[test]
    fn outer_loops_have_variables_of_their_own() {
        assert_eq!(left(&nested("", "")), (0, 3));
        assert_eq!(
            left(&nested("v20: i32 = load.private v8", "barrier")),
            (0, 3)
        );
    }

    /// The outer loop makes the inner loop's copies.
    #[test]
    fn what_an_outer_loop_indexes_an_inner_one_has() {
        assert_eq!(left(&nested("v20: i32 = load.private v6", "")), (1, 3));
        assert_eq!(left(&nested("v20: i32 = load.private v10", "")), (1, 3));
    }

    #[test]
    fn indexed_rows_and_suspended_loops_stay() {
        let (accesses, variables) = left(&nested("", "v20: i32 = load.private v6"));
        assert!(accesses > 0 && variables == 2);
        let (accesses, variables) = left(&nested("", "v20: i1 = ray_query_proceed v7"));
        assert!(accesses > 0 && variables == 2);
        let (accesses, variables) = left(&nested("", "v20: i64 = var.load[var0, 1]"));
        assert!(accesses > 0 && variables == 2);
    }
}
