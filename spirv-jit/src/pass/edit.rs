//! Edits the nodes of bodies in place, because nodes are large and most of them stay.

use crate::ir::{Body, Inst, Node, Terminator};

/// The outcome for a construct after an [`Edit`].
pub(super) enum Fate {
    Stays,
    Goes,
    /// The construct is removed and the body ends there, because the rest is unreachable.
    Ends,
}

/// The callbacks of a pass for a walk through a function, in textual order. A pass keeps the data
/// of open constructs on its own stack.
pub(super) trait Edit {
    /// Called for an instruction, with a list for nodes to insert before it. Returns whether it
    /// stays.
    fn inst(&mut self, inst: &mut Inst, before: &mut Vec<Node>) -> bool;

    /// A construct, before its first body.
    fn open(&mut self, _construct: &mut Node) {}

    /// The end of a body, whose nodes are final.
    fn end(&mut self, _body: &mut Body) {}

    /// An `if`, after the first body and before the second.
    fn between(&mut self) {}

    /// A construct, after its last body; and a list as in [`Self::inst`].
    fn close(&mut self, _construct: &mut Node, _before: &mut Vec<Node>) -> Fate {
        Fate::Stays
    }
}

/// A body during its edit: nodes before `kept` stay, nodes from `next` are pending.
#[derive(Default)]
struct EditedBody {
    body: Body,
    kept: usize,
    next: usize,
    /// Nodes to insert, with the index of the kept node before which they go.
    inserted: Vec<(usize, Vec<Node>)>,
    /// The second body of an `if` inside is open.
    is_second: bool,
}

impl EditedBody {
    fn new(body: Body) -> Self {
        Self {
            body,
            ..Self::default()
        }
    }

    /// The next node has been visited.
    fn pass(&mut self, stays: bool, before: &mut Vec<Node>) {
        if !before.is_empty() {
            self.inserted.push((self.kept, std::mem::take(before)));
        }
        if stays {
            if self.kept != self.next {
                self.body.nodes.swap(self.kept, self.next);
            }
            self.kept += 1;
        }
        self.next += 1;
    }

    /// All nodes have been visited.
    fn finish(&mut self) {
        let nodes = &mut self.body.nodes;
        nodes.truncate(self.kept);
        let inserted = std::mem::take(&mut self.inserted);
        if inserted.is_empty() {
            return;
        }
        let more: usize = inserted.iter().map(|(_, before)| before.len()).sum();
        let mut old = std::mem::replace(nodes, Vec::with_capacity(self.kept + more)).into_iter();
        let mut taken = 0;
        for (at, before) in inserted {
            nodes.extend(old.by_ref().take(at - taken));
            nodes.extend(before);
            taken = at;
        }
        nodes.extend(old);
    }
}

/// Edits a body and its nested bodies.
pub(super) fn edit_body(body: &mut Body, pass: &mut impl Edit) {
    let mut before = Vec::new();
    let mut open = EditedBody::new(std::mem::take(body));
    let mut outer: Vec<EditedBody> = Vec::new();
    loop {
        let mut inner = None;
        while let Some(node) = open.body.nodes.get_mut(open.next) {
            let Node::Inst(inst) = node else {
                pass.open(node);
                inner = node.bodies_mut().next().map(std::mem::take);
                break;
            };
            let stays = pass.inst(inst, &mut before);
            open.pass(stays, &mut before);
        }
        if let Some(inner) = inner {
            outer.push(std::mem::replace(&mut open, EditedBody::new(inner)));
            continue;
        }
        open.finish();
        pass.end(&mut open.body);
        let done = std::mem::take(&mut open.body);
        let Some(around) = outer.pop() else {
            *body = done;
            return;
        };
        open = around;
        let second = put_back(&mut open, done);
        if let Some(second) = second {
            pass.between();
            outer.push(std::mem::replace(&mut open, EditedBody::new(second)));
            continue;
        }
        let Some(construct) = open.body.nodes.get_mut(open.next) else {
            continue;
        };
        match pass.close(construct, &mut before) {
            Fate::Stays => open.pass(true, &mut before),
            Fate::Goes => open.pass(false, &mut before),
            Fate::Ends => {
                open.pass(false, &mut before);
                open.next = open.body.nodes.len();
                open.body.end = Terminator::Unreachable;
            }
        }
    }
}

/// Returns a taken body to the next construct, and takes the construct's next body, if there is
/// one.
fn put_back(open: &mut EditedBody, done: Body) -> Option<Body> {
    let construct = open.body.nodes.get_mut(open.next)?;
    let has_second = matches!(construct, Node::If { .. }) && !open.is_second;
    let place = construct.bodies_mut().nth(usize::from(open.is_second))?;
    *place = done;
    open.is_second = has_second;
    match has_second {
        true => construct.bodies_mut().nth(1).map(std::mem::take),
        false => None,
    }
}

/// Calls `edit` for each node of one body, as [`Edit::inst`].
pub(super) fn edit_nodes(
    nodes: &mut Vec<Node>,
    mut edit: impl FnMut(&mut Node, &mut Vec<Node>) -> bool,
) {
    let mut open = EditedBody::default();
    std::mem::swap(&mut open.body.nodes, nodes);
    let mut before = Vec::new();
    while let Some(node) = open.body.nodes.get_mut(open.next) {
        let stays = edit(node, &mut before);
        open.pass(stays, &mut before);
    }
    open.finish();
    std::mem::swap(&mut open.body.nodes, nodes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ir::{Inst, Op};

    fn node(bits: u64) -> Node {
        Node::Inst(Inst {
            op: Op::Const(bits),
            args: Default::default(),
            results: Default::default(),
            source: 0,
        })
    }

    #[test]
    fn nodes_go_stay_and_come() {
        let mut nodes: Vec<Node> = (0..6).map(node).collect();
        edit_nodes(&mut nodes, |at, before| {
            let number = (0..6).find(|&bits| *at == node(bits)).unwrap();
            if number % 3 == 1 {
                before.extend([node(10 + number), node(20 + number)]);
            }
            number % 2 == 0
        });
        let expected = [0, 11, 21, 2, 14, 24, 4].map(node);
        assert_eq!(nodes, expected);
    }
}
