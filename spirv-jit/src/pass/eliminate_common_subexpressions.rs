//! Merges equal computations: pure operations, and reads of memory that nothing can have changed in
//! between. A value is reused where its definition is visible. Constants and uniform words move to
//! the function's head, where they are visible everywhere.

use std::hash::{BuildHasher, Hash, Hasher};

use foldhash::HashMap;
use foldhash::fast::RandomState;
use images::{ImageOpKind, LodMode};

use super::edit::{Edit, Fate, edit_body};
use super::effects::{Effects, find_effects};
use super::substitution::Substitution;
use crate::ir::{Body, Function, Inst, Node, Op, Space, Step, Type, Value};

/// Merges equal operations.
pub fn eliminate_common_subexpressions(function: &mut Function) {
    let mut body = std::mem::take(&mut function.body);
    let writes_images = body.steps().any(
        |step| matches!(step, Step::Inst(inst) if matches!(inst.op, Op::Image(op) if !op.is_read())),
    );
    let mut eliminator = Eliminator {
        effects: find_effects(&body, function.labels),
        substitution: Substitution::identity(function),
        push_constants: vec![false; function.value_types.len()],
        function,
        hasher: RandomState::default(),
        newest: vec![0; (function.value_types.len() / 2).next_power_of_two()],
        entries: Vec::new(),
        values: Vec::new(),
        head: Vec::new(),
        dispatch_wide: HashMap::default(),
        writes_images,
        memory: Epochs::default(),
        next_epoch: 1,
        scopes: Vec::new(),
    };
    edit_body(&mut body, &mut eliminator);
    body.nodes.splice(0..0, eliminator.head);
    function.body = body;
}

/// A visited operation that is visible here.
struct Entry {
    hash: u64,
    op: Op,
    /// The start of its operands and results, and their numbers.
    first: u32,
    args: u32,
    results: u32,
    /// The epoch of the memory that it read; 0 for none.
    epoch: u32,
    /// The previous entry in the same bucket, plus one.
    shadowed: u32,
}

/// The current epochs of memory: equal epochs mean equal contents.
#[derive(Clone, Copy, Default)]
struct Epochs {
    /// Per-lane memory.
    private: u32,
    /// All other memory.
    outer: u32,
}

struct Eliminator<'a> {
    function: &'a Function,
    effects: Vec<Effects>,
    substitution: Substitution,
    /// Values that are the descriptor of the push constants, which nothing writes.
    push_constants: Vec<bool>,
    hasher: RandomState,
    /// A hash table with chains: the newest entry by the hash's low bits, plus one.
    newest: Vec<u32>,
    entries: Vec<Entry>,
    /// Operands and results of the entries.
    values: Vec<Value>,
    /// Nodes that move to the head of the function.
    head: Vec<Node>,
    dispatch_wide: HashMap<(Op, Type), Value>,
    /// The function writes images, so reads of images may wait for another invocation's writes.
    writes_images: bool,
    memory: Epochs,
    next_epoch: u32,
    scopes: Vec<Scope>,
}

/// The values known before a construct.
struct Scope {
    /// The number of entries before the construct, whose definitions end with it.
    entries: usize,
    memory: Epochs,
}

impl Edit for Eliminator<'_> {
    fn inst(&mut self, inst: &mut Inst, _: &mut Vec<Node>) -> bool {
        if is_dispatch_wide(&inst.op) {
            self.move_to_head(inst);
            return false;
        }
        self.visit(inst)
    }

    fn open(&mut self, construct: &mut Node) {
        self.substitution.resolve_all(construct.operands_mut());
        if let Node::Loop { label, .. } = construct {
            // The body may run in a second iteration.
            self.disturb(self.effects[label.index()]);
        }
        self.scopes.push(Scope {
            entries: self.entries.len(),
            memory: self.memory,
        });
    }

    fn end(&mut self, body: &mut Body) {
        self.substitution.resolve_terminator(&mut body.end);
        if let Some(scope) = self.scopes.last() {
            self.end_definitions(scope.entries);
        }
    }

    fn between(&mut self) {
        if let Some(scope) = self.scopes.last() {
            self.memory = scope.memory;
        }
    }

    fn close(&mut self, construct: &mut Node, _: &mut Vec<Node>) -> Fate {
        if let (Some(scope), Node::If { .. }) = (self.scopes.pop(), &*construct) {
            self.memory = scope.memory;
        }
        if let Some(label) = construct.label() {
            self.disturb(self.effects[label.index()]);
        }
        Fate::Stays
    }
}

impl Eliminator<'_> {
    /// Removes the entries after this number.
    fn end_definitions(&mut self, begin: usize) {
        for entry in self.entries.drain(begin..).rev() {
            let place = entry.hash as usize & (self.newest.len() - 1);
            self.newest[place] = entry.shadowed;
            self.values.truncate(entry.first as usize);
        }
    }

    /// Starts new epochs for the memory that is written.
    fn disturb(&mut self, effects: Effects) {
        if effects.writes_private {
            self.memory.private = self.new_epoch();
        }
        if effects.writes_outer {
            self.memory.outer = self.new_epoch();
        }
    }

    fn new_epoch(&mut self) -> u32 {
        self.next_epoch += 1;
        self.next_epoch
    }

    fn move_to_head(&mut self, inst: &Inst) {
        let result = inst.results[0];
        let key = (inst.op, self.function.ty(result));
        match self.dispatch_wide.get(&key) {
            Some(&same) => self.substitution.replace(result, same),
            None => {
                self.dispatch_wide.insert(key, result);
                self.push_constants[result.index()] = inst.op == Op::PushConstants;
                self.head.push(Node::Inst(inst.clone()));
            }
        }
    }

    /// Whether the instruction stays.
    #[inline(never)]
    fn visit(&mut self, inst: &mut Inst) -> bool {
        self.substitution.resolve_all(&mut inst.args);
        let Some(epoch) = self.epoch_of(inst) else {
            self.disturb(Effects::of(&inst.op));
            return true;
        };
        let types = self.types(&inst.results);
        let hash = self.hash(inst, types, epoch);
        let place = hash as usize & (self.newest.len() - 1);
        let mut candidate = self.newest[place];
        while let Some(index) = candidate.checked_sub(1) {
            let entry = &self.entries[index as usize];
            let (args, results) = self.operands(entry);
            if entry.hash == hash
                && entry.epoch == epoch
                && entry.op == inst.op
                && args == &inst.args[..]
                && results.len() == inst.results.len()
                && self.types(results).eq(self.types(&inst.results))
            {
                let first = (entry.first + entry.args) as usize;
                for (index, &result) in inst.results.iter().enumerate() {
                    self.substitution
                        .replace(result, self.values[first + index]);
                }
                return false;
            }
            candidate = entry.shadowed;
        }
        self.entries.push(Entry {
            hash,
            op: inst.op,
            first: self.values.len() as u32,
            args: inst.args.len() as u32,
            results: inst.results.len() as u32,
            epoch,
            shadowed: self.newest[place],
        });
        self.newest[place] = self.entries.len() as u32;
        self.values.extend_from_slice(&inst.args);
        self.values.extend_from_slice(&inst.results);
        true
    }

    fn types(&self, values: &[Value]) -> impl Iterator<Item = Type> {
        values.iter().map(|&value| self.function.ty(value))
    }

    fn operands(&self, entry: &Entry) -> (&[Value], &[Value]) {
        let values = &self.values[entry.first as usize..][..(entry.args + entry.results) as usize];
        values.split_at(entry.args as usize)
    }

    fn hash(&self, inst: &Inst, types: impl Iterator<Item = Type>, epoch: u32) -> u64 {
        let mut hasher = self.hasher.build_hasher();
        inst.op.hash(&mut hasher);
        hasher.write_u32(epoch);
        for arg in &inst.args {
            hasher.write_u32(arg.0);
        }
        for ty in types {
            hasher.write_u8(ty as u8);
        }
        hasher.finish()
    }

    /// The epoch of the memory that an operation reads, 0 for none; `None` for operations that must
    /// not be merged.
    fn epoch_of(&self, inst: &Inst) -> Option<u32> {
        match inst.op {
            // Descriptors do not change while a dispatch uses them.
            Op::BufferSize | Op::DescriptorAddress => Some(0),
            Op::Load(access) if !access.volatile => Some(match access.space {
                Space::Private => self.memory.private + 1,
                Space::Buffer if self.push_constants[inst.args[0].index()] => 0,
                _ => self.memory.outer + 1,
            }),
            Op::Image(image) => match image.kind {
                ImageOpKind::QuerySize | ImageOpKind::QueryLevels | ImageOpKind::QuerySamples => {
                    Some(0)
                }
                // With an implicit level of detail the result depends on neighbors. Gathers take
                // the base level.
                ImageOpKind::Sample if matches!(image.lod, LodMode::Implicit | LodMode::Bias) => {
                    None
                }
                ImageOpKind::Sample | ImageOpKind::Gather(_) | ImageOpKind::Fetch => {
                    Some(self.memory.outer + 1)
                }
                ImageOpKind::Read if !image.volatile && !self.writes_images => {
                    Some(self.memory.outer + 1)
                }
                _ => None,
            },
            _ => inst.op.is_pure().then_some(0),
        }
    }
}

/// Uniform in the dispatch, without operands.
fn is_dispatch_wide(op: &Op) -> bool {
    matches!(op, Op::Const(_) | Op::Uniform(_) | Op::PushConstants)
}
