//! The one walk over the tree of bodies: every analysis and pass that looks at instructions goes by
//! these.

use super::{Body, Inst, Label, Node, Terminator, Value};

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
    /// The values that it passes on.
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
    /// The nodes of this body and of those inside, each before what is in it.
    pub fn visit<'b>(&'b self, f: &mut impl FnMut(&'b Node)) {
        for node in &self.nodes {
            f(node);
            node.bodies().for_each(|body| body.visit(f));
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

    /// This body and those inside: each behind what is in it.
    pub fn visit_bodies<'b>(&'b self, f: &mut impl FnMut(&'b Body)) {
        for node in &self.nodes {
            node.bodies().for_each(|body| body.visit_bodies(f));
        }
        f(self);
    }

    /// As [`Self::visit_bodies`].
    pub fn visit_bodies_mut(&mut self, f: &mut impl FnMut(&mut Body)) {
        for node in &mut self.nodes {
            node.bodies_mut().for_each(|body| body.visit_bodies_mut(f));
        }
        f(self);
    }

    /// As [`Self::visit_insts`].
    pub fn visit_insts_mut(&mut self, f: &mut impl FnMut(&mut Inst)) {
        for node in &mut self.nodes {
            if let Node::Inst(inst) = node {
                f(inst);
            }
            node.bodies_mut().for_each(|body| body.visit_insts_mut(f));
        }
    }

    /// All operands of this body and of those inside: of nodes and of terminators.
    pub fn visit_operands(&self, f: &mut impl FnMut(Value)) {
        for node in &self.nodes {
            node.operands().iter().for_each(|&value| f(value));
            node.bodies().for_each(|body| body.visit_operands(f));
        }
        self.end.operands().iter().for_each(|&value| f(value));
    }

    /// As [`Self::visit_operands`].
    pub fn visit_operands_mut(&mut self, f: &mut impl FnMut(&mut Value)) {
        for node in &mut self.nodes {
            node.operands_mut().iter_mut().for_each(&mut *f);
            node.bodies_mut()
                .for_each(|body| body.visit_operands_mut(f));
        }
        self.end.operands_mut().iter_mut().for_each(f);
    }
}
