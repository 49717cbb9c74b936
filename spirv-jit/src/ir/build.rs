//! Builds a tree of bodies from its parts in textual order, without recursion.

#![forbid(unsafe_code)]

use super::{Body, Node, Terminator};

/// Collects the parts of a body in order.
#[derive(Default)]
pub(super) struct BodyBuilder {
    /// Nodes of the innermost open body.
    nodes: Vec<Node>,
    open: Vec<OpenConstruct>,
}

struct OpenConstruct {
    construct: Node,
    /// The preceding nodes of the enclosing body.
    nodes: Vec<Node>,
    is_second: bool,
}

/// The construct to which the end of a body belongs.
pub(super) enum Ended {
    /// The first body of an `if`, whose second body is open now.
    First,
    /// A construct.
    Construct,
    All(Body),
}

impl BodyBuilder {
    /// Appends a complete node.
    pub fn push(&mut self, node: Node) {
        self.nodes.push(node);
    }

    /// Begins a construct. Its bodies come next and replace those of `construct`.
    pub fn open(&mut self, construct: Node) {
        self.open.push(OpenConstruct {
            construct,
            nodes: std::mem::take(&mut self.nodes),
            is_second: false,
        });
    }

    /// Ends the innermost open body.
    pub fn end(&mut self, end: Terminator) -> Ended {
        let nodes = std::mem::take(&mut self.nodes);
        let body = Body { nodes, end };
        let Some(mut open) = self.open.pop() else {
            return Ended::All(body);
        };
        match &mut open.construct {
            Node::Inst(_) => {}
            Node::Block { body: inside, .. } | Node::Loop { body: inside, .. } => **inside = body,
            Node::If { then_body, .. } if !open.is_second => {
                **then_body = body;
                open.is_second = true;
                self.open.push(open);
                return Ended::First;
            }
            Node::If { else_body, .. } => **else_body = body,
        }
        self.nodes = open.nodes;
        self.nodes.push(open.construct);
        Ended::Construct
    }
}
