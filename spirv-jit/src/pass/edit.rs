//! Going over the nodes of a body in place: nodes are large, and most of them stay where they are.

use crate::ir::Node;

/// Calls `edit` for each node, with a list for nodes that go before it. The nodes for which it returns false go.
pub(super) fn edit_nodes(
    nodes: &mut Vec<Node>,
    mut edit: impl FnMut(&mut Node, &mut Vec<Node>) -> bool,
) {
    let mut before = Vec::new();
    let mut inserted = Vec::new();
    let mut kept = 0;
    nodes.retain_mut(|node| {
        let stays = edit(node, &mut before);
        if !before.is_empty() {
            inserted.push((kept, std::mem::take(&mut before)));
        }
        kept += usize::from(stays);
        stays
    });
    if inserted.is_empty() {
        return;
    }
    let more: usize = inserted.iter().map(|(_, before)| before.len()).sum();
    let mut old = std::mem::replace(nodes, Vec::with_capacity(kept + more)).into_iter();
    let mut taken = 0;
    for (at, before) in inserted {
        nodes.extend(old.by_ref().take(at - taken));
        nodes.extend(before);
        taken = at;
    }
    nodes.extend(old);
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
