//! Substitution of values, for passes that replace values and drop parameters of constructs.

use super::edit::{Edit, Fate, edit_body};
use crate::ir::{Body, Function, Inst, Label, Node, Terminator, Value};

/// The replacement of each value. A definition dominates its uses, and so does its replacement. So
/// a forward walk that adds replacements on the way finds only final values.
pub struct Substitution {
    replacements: Vec<Value>,
}

impl Substitution {
    /// Creates the identity.
    pub fn identity(function: &Function) -> Self {
        Self {
            replacements: (0..function.value_types.len() as u32).map(Value).collect(),
        }
    }

    /// The replacement of `value`; new values have none.
    pub fn resolve(&self, mut value: Value) -> Value {
        while let Some(&next) = self.replacements.get(value.index()) {
            if next == value {
                break;
            }
            value = next;
        }
        value
    }

    /// Replaces `value` with `replacement` from here on.
    pub fn replace(&mut self, value: Value, replacement: Value) {
        self.replacements[value.index()] = self.resolve(replacement);
    }

    pub fn is_replaced(&self, value: Value) -> bool {
        self.replacements
            .get(value.index())
            .is_some_and(|&next| next != value)
    }

    pub fn resolve_all(&self, values: &mut [Value]) {
        for value in values {
            *value = self.resolve(*value);
        }
    }

    pub fn resolve_terminator(&self, end: &mut Terminator) {
        self.resolve_all(end.operands_mut());
    }
}

/// Rewrites a function in one walk: resolves operands, drops the parameters and results of
/// constructs for which `is_dropped` holds with their arguments, and keeps the instructions for
/// which `keeps` holds.
pub fn rewrite_function(
    function: &mut Function,
    substitution: &Substitution,
    is_dropped: &dyn Fn(Value) -> bool,
    keeps: &dyn Fn(&Inst) -> bool,
) {
    let mut rewriter = SubstitutionRewriter {
        substitution,
        is_dropped,
        keeps,
        dropped: vec![Vec::new(); function.labels as usize],
    };
    edit_body(&mut function.body, &mut rewriter);
}

struct SubstitutionRewriter<'a> {
    substitution: &'a Substitution,
    is_dropped: &'a dyn Fn(Value) -> bool,
    keeps: &'a dyn Fn(&Inst) -> bool,
    /// Per label: whether each of its values is dropped; empty if none.
    dropped: Vec<Vec<bool>>,
}

impl Edit for SubstitutionRewriter<'_> {
    fn inst(&mut self, inst: &mut Inst, _: &mut Vec<Node>) -> bool {
        let stays = (self.keeps)(inst);
        if stays {
            self.substitution.resolve_all(&mut inst.args);
        }
        stays
    }

    fn open(&mut self, construct: &mut Node) {
        match construct {
            Node::Inst(_) => {}
            Node::Block { label, results, .. } | Node::If { label, results, .. } => {
                self.mark(label.index(), results);
            }
            Node::Loop {
                label,
                params,
                init,
                ..
            } => {
                self.mark(label.index(), params);
                drop_marked(init, &self.dropped[label.index()]);
            }
        }
        self.substitution.resolve_all(construct.operands_mut());
    }

    fn end(&mut self, body: &mut Body) {
        if let Terminator::Br(label, args) = &mut body.end {
            drop_marked(args, &self.dropped[label.index()]);
        }
        self.substitution.resolve_terminator(&mut body.end);
    }

    fn close(&mut self, construct: &mut Node, _: &mut Vec<Node>) -> Fate {
        let stays = match construct {
            Node::Inst(_) | Node::Loop { .. } => true,
            Node::Block { label, .. } | Node::If { label, .. } => {
                let label = *label;
                !construct.bodies().all(|body| does_nothing(body, label))
            }
        };
        match stays {
            true => Fate::Stays,
            false => Fate::Goes,
        }
    }
}

impl SubstitutionRewriter<'_> {
    fn mark(&mut self, label: usize, values: &mut Vec<Value>) {
        if values.iter().any(|&value| (self.is_dropped)(value)) {
            let marks: Vec<bool> = values
                .iter()
                .map(|&value| (self.is_dropped)(value))
                .collect();
            drop_marked(values, &marks);
            self.dropped[label] = marks;
        }
    }
}

/// An empty body that leaves its own construct without values.
fn does_nothing(body: &Body, own: Label) -> bool {
    body.nodes.is_empty()
        && matches!(&body.end, Terminator::Br(label, args) if *label == own && args.is_empty())
}

fn drop_marked(values: &mut Vec<Value>, marks: &[bool]) {
    if !marks.is_empty() {
        let mut marks = marks.iter();
        values.retain(|_| !marks.next().expect("as many marks as values"));
    }
}
