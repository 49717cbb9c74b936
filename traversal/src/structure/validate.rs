//! Whether a structure is sound.

use rayon::prelude::*;

use super::{Kind, Structure, micromaps};
use crate::error::StructureError;
use crate::layout::{Form, MAX_DEPTH, WIDTH, child, geometry_word};
use crate::pool::in_pool;

/// Checks everything that a walk relies on, except that references of instances are alive: each
/// child is inside the blob, above its parent, in a tree no deeper than the walk's stack.
///
/// # Errors
/// The first error.
pub fn validate(blob: &[u8]) -> Result<(), StructureError> {
    let (structure, header) = Structure::of(blob)?;
    let check = |good: bool| good.then_some(()).ok_or(StructureError::Corrupt);
    check(structure.depth <= MAX_DEPTH)?;
    let nodes = structure.node_count();
    check(check_subtree(&structure, 0, nodes, 0) || check_range(&structure, 0, nodes, 0))?;
    micromaps::check(&structure, &header, blob)
}

/// Subtrees of fewer nodes are one task.
const FEW: u32 = 1024;

/// Checks the nodes from `start` up to `end`, a subtree in the order in which builds write it, side
/// by side with others. False if it is none, or not sound.
fn check_subtree(structure: &Structure, start: u32, end: u32, depth: u32) -> bool {
    if end - start < FEW || depth >= MAX_DEPTH {
        return check_range(structure, start, end, depth);
    }
    let Some(node) = structure.node(start) else {
        return false;
    };
    let mut parts = [(0, 0); WIDTH];
    let (mut length, mut next) = (0, start + 1);
    for word in node.children() {
        if word == child::NONE {
            continue;
        } else if word & child::LEAF != 0 {
            if !check_leaf(structure, word) {
                return false;
            }
            continue;
        }
        // Each one's nodes end where the next one's begin.
        if word < next || word >= end {
            return false;
        }
        if length > 0 {
            parts[length - 1].1 = word;
        }
        parts[length] = (word, end);
        (length, next) = (length + 1, word + 1);
    }
    let check = |&(start, end): &(u32, u32)| check_subtree(structure, start, end, depth + 1);
    match in_pool() {
        true => parts[..length].par_iter().all(check),
        false => parts[..length].iter().all(check),
    }
}

/// Checks what is below the node at `start`, all of it before `end`.
fn check_range(structure: &Structure, start: u32, end: u32, depth: u32) -> bool {
    // Depth first, each node at most once: a child's index is above its parent's, and the budget
    // stops a graph that shares children.
    let mut budget = end - start;
    let mut stack = [(0u32, 0u32); MAX_DEPTH as usize * WIDTH];
    stack[0] = (start, depth);
    let mut top = 1;
    while top > 0 {
        top -= 1;
        let (index, depth) = stack[top];
        let Some(node) = structure.node(index) else {
            return false;
        };
        if budget == 0 || depth >= MAX_DEPTH {
            return false;
        }
        budget -= 1;
        for word in node.children() {
            if word == child::NONE {
                continue;
            } else if word & child::LEAF != 0 {
                if !check_leaf(structure, word) {
                    return false;
                }
            } else if word > index && word < end && top < stack.len() {
                stack[top] = (word, depth + 1);
                top += 1;
            } else {
                return false;
            }
        }
    }
    true
}

/// Whether the leaf of a child's word is there, and holds primitives of the structure's geometries.
fn check_leaf(structure: &Structure, word: u32) -> bool {
    let index = word & child::INDEX;
    let count = if word & child::TWO_GROUPS != 0 { 2 } else { 1 };
    let primitive = |primitive: u32, geometry: u32| {
        structure
            .geometry(geometry & geometry_word::INDEX)
            .is_some_and(|entry| primitive < entry.primitive_count)
    };
    match structure.kind() {
        Kind::Triangles if structure.form() == Form::Blocks => {
            structure.block(index).is_some_and(|block| {
                block.is_sound()
                    && (0..block.triangles())
                        .all(|lane| primitive(block.primitive(lane), block.geometry(lane)))
            })
        }
        Kind::Triangles => (index..index + count).all(|index| {
            structure.group(index).is_some_and(|group| {
                group.lanes < 16
                    && (0..4)
                        .filter(|lane| group.lanes >> lane & 1 != 0)
                        .all(|lane| primitive(group.primitives[lane], group.geometries[lane]))
            })
        }),
        Kind::Aabbs => {
            count == 1
                && structure
                    .box_entry(index)
                    .is_some_and(|entry| primitive(entry.primitive, entry.geometry))
        }
        Kind::Swept => {
            count == 1
                && structure
                    .swept_entry(index)
                    .is_some_and(|entry| primitive(entry.primitive, entry.geometry))
        }
        Kind::Motion => {
            count == 1
                && structure
                    .motion_entry(index)
                    .is_some_and(|entry| primitive(entry.primitive, entry.geometry))
        }
        Kind::Instances | Kind::MotionInstances => {
            count == 1 && structure.instance(index).is_some()
        }
    }
}
