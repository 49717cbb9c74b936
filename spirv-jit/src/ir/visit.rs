//! Walks over the tree of bodies, for every analysis and pass. None of them recurses, because a
//! module chooses the nesting depth and the stack of a thread is small.

use super::build::{BodyBuilder, Ended};
use super::{Body, Inst, Label, Node, Terminator, Value};

/// A step of the walk through a body and its nested bodies.
#[derive(Clone, Copy)]
pub enum Step<'b> {
    Inst(&'b Inst),
    /// A construct, before its first body.
    Open(&'b Node),
    /// An `if` between its bodies.
    Else(&'b Node),
    /// The end of a body, after all its nodes.
    End(&'b Body),
    /// A construct, after its last body.
    Close(&'b Node),
}

/// A walk in textual order. The caller keeps the data of open constructs on its own stack.
pub struct Steps<'b> {
    open: Vec<OpenBody<'b>>,
}

struct OpenBody<'b> {
    body: &'b Body,
    /// Index of the next node. At the number of nodes comes the end, and after that the construct
    /// continues.
    next: usize,
    /// The construct of the body; `None` at the root.
    construct: Option<&'b Node>,
    is_second: bool,
}

impl<'b> Steps<'b> {
    /// Skips the remaining steps of the construct whose [`Step::Open`] came last.
    pub fn skip_construct(&mut self) {
        self.open.pop();
    }

    /// Skips the rest of the innermost open body, with its [`Step::End`].
    pub fn skip_rest(&mut self) {
        if let Some(open) = self.open.last_mut() {
            open.next = open.body.nodes.len() + 1;
        }
    }

    fn enter(&mut self, construct: &'b Node, body: &'b Body, is_second: bool) {
        self.open.push(OpenBody {
            body,
            next: 0,
            construct: Some(construct),
            is_second,
        });
    }
}

impl<'b> Iterator for Steps<'b> {
    type Item = Step<'b>;

    fn next(&mut self) -> Option<Step<'b>> {
        let open = self.open.last_mut()?;
        let (body, next) = (open.body, open.next);
        open.next += 1;
        if let Some(node) = body.nodes.get(next) {
            return Some(match node {
                Node::Inst(inst) => Step::Inst(inst),
                Node::Block { body, .. }
                | Node::Loop { body, .. }
                | Node::If {
                    then_body: body, ..
                } => {
                    self.enter(node, body, false);
                    Step::Open(node)
                }
            });
        }
        if next == body.nodes.len() {
            return Some(Step::End(body));
        }
        let (construct, is_second) = (open.construct, open.is_second);
        self.open.pop();
        match construct? {
            node @ Node::If { else_body, .. } if !is_second => {
                self.enter(node, else_body, true);
                Some(Step::Else(node))
            }
            node => Some(Step::Close(node)),
        }
    }
}

impl Node {
    /// The bodies inside, in textual order.
    pub fn bodies(&self) -> impl Iterator<Item = &Body> {
        let (first, second) = match self {
            Node::Inst(_) => (None, None),
            Node::Block { body, .. } | Node::Loop { body, .. } => (Some(body), None),
            Node::If {
                then_body,
                else_body,
                ..
            } => (Some(then_body), Some(else_body)),
        };
        first.into_iter().chain(second).map(|body| &**body)
    }

    /// As [`Self::bodies`].
    pub fn bodies_mut(&mut self) -> impl Iterator<Item = &mut Body> {
        let (first, second) = match self {
            Node::Inst(_) => (None, None),
            Node::Block { body, .. } | Node::Loop { body, .. } => (Some(body), None),
            Node::If {
                then_body,
                else_body,
                ..
            } => (Some(then_body), Some(else_body)),
        };
        first.into_iter().chain(second).map(|body| &mut **body)
    }

    /// A copy with empty bodies.
    fn head(&self) -> Node {
        match self {
            Node::Inst(inst) => Node::Inst(inst.clone()),
            Node::Block { label, results, .. } => Node::Block {
                label: *label,
                results: results.clone(),
                body: Box::default(),
            },
            Node::If {
                condition,
                label,
                results,
                ..
            } => Node::If {
                condition: *condition,
                label: *label,
                results: results.clone(),
                then_body: Box::default(),
                else_body: Box::default(),
            },
            Node::Loop {
                label,
                params,
                init,
                ..
            } => Node::Loop {
                label: *label,
                params: params.clone(),
                init: init.clone(),
                body: Box::default(),
            },
        }
    }

    /// The values that the node itself uses: operands, a condition, or a loop's first parameters.
    pub fn operands(&self) -> &[Value] {
        match self {
            Node::Inst(inst) => &inst.args,
            Node::Block { .. } => &[],
            Node::If { condition, .. } => std::slice::from_ref(condition),
            Node::Loop { init, .. } => init,
        }
    }

    /// The values that it defines: results, or a loop's parameters.
    pub fn definitions(&self) -> &[Value] {
        match self {
            Node::Inst(inst) => &inst.results,
            Node::Block { results, .. } | Node::If { results, .. } => results,
            Node::Loop { params, .. } => params,
        }
    }

    /// A construct's label.
    pub fn label(&self) -> Option<Label> {
        match self {
            Node::Inst(_) => None,
            Node::Block { label, .. } | Node::If { label, .. } | Node::Loop { label, .. } => {
                Some(*label)
            }
        }
    }

    /// As [`Self::definitions`].
    pub fn definitions_mut(&mut self) -> &mut [Value] {
        match self {
            Node::Inst(inst) => &mut inst.results,
            Node::Block { results, .. } | Node::If { results, .. } => results,
            Node::Loop { params, .. } => params,
        }
    }

    /// As [`Self::label`].
    pub fn label_mut(&mut self) -> Option<&mut Label> {
        match self {
            Node::Inst(_) => None,
            Node::Block { label, .. } | Node::If { label, .. } | Node::Loop { label, .. } => {
                Some(label)
            }
        }
    }

    /// As [`Self::operands`].
    pub fn operands_mut(&mut self) -> &mut [Value] {
        match self {
            Node::Inst(inst) => &mut inst.args,
            Node::Block { .. } => &mut [],
            Node::If { condition, .. } => std::slice::from_mut(condition),
            Node::Loop { init, .. } => init,
        }
    }
}

impl Terminator {
    /// The values that the terminator passes.
    pub fn operands(&self) -> &[Value] {
        match self {
            Terminator::Br(_, args) | Terminator::Return(args) | Terminator::End(args) => args,
            Terminator::Unreachable => &[],
        }
    }

    /// As [`Self::operands`].
    pub fn operands_mut(&mut self) -> &mut [Value] {
        match self {
            Terminator::Br(_, args) | Terminator::Return(args) | Terminator::End(args) => args,
            Terminator::Unreachable => &mut [],
        }
    }
}

impl Body {
    /// The walk through this body and its nested bodies.
    pub fn steps(&self) -> Steps<'_> {
        Steps {
            open: vec![OpenBody {
                body: self,
                next: 0,
                construct: None,
                is_second: false,
            }],
        }
    }

    /// The nodes of this body and of nested ones, in pre-order.
    pub fn visit<'b>(&'b self, f: &mut impl FnMut(&'b Node)) {
        let mut open = vec![self.nodes.iter()];
        while let Some(nodes) = open.last_mut() {
            let Some(node) = nodes.next() else {
                open.pop();
                continue;
            };
            f(node);
            match node {
                Node::Inst(_) => {}
                Node::Block { body, .. } | Node::Loop { body, .. } => open.push(body.nodes.iter()),
                Node::If {
                    then_body,
                    else_body,
                    ..
                } => open.extend([else_body.nodes.iter(), then_body.nodes.iter()]),
            }
        }
    }

    /// The instructions of this body and of those inside, in order.
    pub fn visit_insts<'b>(&'b self, f: &mut impl FnMut(&'b Inst)) {
        self.visit(&mut |node| {
            if let Node::Inst(inst) = node {
                f(inst);
            }
        });
    }

    /// This body and those inside, in any order.
    pub fn visit_bodies<'b>(&'b self, f: &mut impl FnMut(&'b Body)) {
        let mut bodies = vec![self];
        while let Some(body) = bodies.pop() {
            f(body);
            bodies.extend(body.nodes.iter().flat_map(Node::bodies));
        }
    }

    /// As [`Self::visit_bodies`].
    pub fn visit_bodies_mut(&mut self, f: &mut impl FnMut(&mut Body)) {
        let mut bodies = vec![self];
        while let Some(body) = bodies.pop() {
            f(body);
            bodies.extend(body.nodes.iter_mut().flat_map(Node::bodies_mut));
        }
    }

    /// The instructions of this body and of those inside, in any order.
    pub fn visit_insts_mut(&mut self, f: &mut impl FnMut(&mut Inst)) {
        self.visit_bodies_mut(&mut |body| {
            for node in &mut body.nodes {
                if let Node::Inst(inst) = node {
                    f(inst);
                }
            }
        });
    }

    /// All operands of this body and of those inside, in any order: of nodes and of terminators.
    pub fn visit_operands(&self, f: &mut impl FnMut(Value)) {
        self.visit_bodies(&mut |body| {
            let of_nodes = body.nodes.iter().flat_map(Node::operands);
            of_nodes
                .chain(body.end.operands())
                .copied()
                .for_each(&mut *f);
        });
    }

    /// As [`Self::visit_operands`].
    pub fn visit_operands_mut(&mut self, f: &mut impl FnMut(&mut Value)) {
        self.visit_bodies_mut(&mut |body| {
            let of_nodes = body.nodes.iter_mut().flat_map(Node::operands_mut);
            of_nodes.chain(body.end.operands_mut()).for_each(&mut *f);
        });
    }
}

/// An empty body that ends in `unreachable`.
impl Default for Body {
    fn default() -> Self {
        Self {
            nodes: Vec::new(),
            end: Terminator::Unreachable,
        }
    }
}

/// Nested bodies are taken out before the drop, to avoid recursion.
impl Drop for Body {
    fn drop(&mut self) {
        let mut lists: Vec<Vec<Node>> = Vec::new();
        let empty = |nodes: &mut [Node], lists: &mut Vec<Vec<Node>>| {
            for node in nodes {
                for body in node.bodies_mut().filter(|body| !body.nodes.is_empty()) {
                    lists.push(std::mem::take(&mut body.nodes));
                }
            }
        };
        empty(&mut self.nodes, &mut lists);
        while let Some(mut nodes) = lists.pop() {
            empty(&mut nodes, &mut lists);
        }
    }
}

impl Clone for Body {
    fn clone(&self) -> Self {
        let mut copy = BodyBuilder::default();
        for step in self.steps() {
            match step {
                Step::Inst(inst) => copy.push(Node::Inst(inst.clone())),
                Step::Open(node) => copy.open(node.head()),
                Step::End(body) => {
                    if let Ended::All(body) = copy.end(body.end.clone()) {
                        return body;
                    }
                }
                Step::Else(_) | Step::Close(_) => {}
            }
        }
        unreachable!("the last step is the end of the whole body")
    }
}

impl PartialEq for Body {
    fn eq(&self, other: &Self) -> bool {
        let mut pairs = vec![(self, other)];
        while let Some((a, b)) = pairs.pop() {
            if a.nodes.len() != b.nodes.len() || a.end != b.end {
                return false;
            }
            for (a, b) in a.nodes.iter().zip(&b.nodes) {
                let same = match (a, b) {
                    (Node::Inst(a), Node::Inst(b)) => a == b,
                    _ => std::mem::discriminant(a) == std::mem::discriminant(b),
                };
                let same_head = a.label() == b.label()
                    && a.operands() == b.operands()
                    && a.definitions() == b.definitions();
                if !same || !same_head {
                    return false;
                }
                pairs.extend(a.bodies().zip(b.bodies()));
            }
        }
        true
    }
}

/// The heads of the nodes, one after the other.
impl std::fmt::Debug for Body {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut list = f.debug_list();
        for step in self.steps() {
            match step {
                Step::Inst(inst) => list.entry(inst),
                Step::Open(node) => {
                    list.entry(&(node.label(), node.operands(), node.definitions()))
                }
                Step::Else(_) => list.entry(&"else"),
                Step::End(body) => list.entry(&body.end),
                Step::Close(_) => list.entry(&"end"),
            };
        }
        list.finish()
    }
}
