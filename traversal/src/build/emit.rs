//! Writes nodes and leaves to the destination.

use super::Shape;
use super::collapse::{self, Children};
use super::head::Written;
use super::primitive::Primitive;
use super::swept_sphere::SweptPrimitive;
use super::target::Target;
use super::tree::BinaryNode;
use super::words::{triangle_word, word};
use crate::input::Geometries;
use crate::layout::{
    BLOCK_UNIT, Block, BoxEntry, Extent, Form, GROUP, LEAF_TRIANGLES, Node, Parts, TriangleGroup,
    WIDTH, child,
};
use crate::pool::in_pool;
use crate::structure::Kind;

/// Subtrees with more primitives than this are written in parallel.
const PARALLEL: u32 = 8192;
/// Subtrees of this many primitives have their vertices prefetched before they are written.
const NEAR: u32 = 64;

impl Target<'_> {
    /// Lays out the parts of the structure. A top level has one record for each instance, active or
    /// not.
    pub fn lay_out(&mut self, shape: &Shape, written: &mut Written) {
        if self.kind.is_top() {
            written.leaf_count = shape.primitives as u32;
        }
        self.parts = Parts::new(
            self.kind,
            self.form,
            shape.geometries,
            written.node_count.into(),
            written.leaf_count.into(),
        );
    }

    /// The number of leaves for the primitives of one child in the target's form.
    ///
    /// # Safety
    /// The memory of the geometries is readable.
    pub unsafe fn leaves_for(&self, primitives: &[Primitive]) -> u32 {
        match self.form {
            Form::Groups => self.leaves_of(primitives.len()),
            // SAFETY: the caller guarantees that the memory of the geometries is readable.
            Form::Blocks => unsafe { self.block(primitives) }.units(),
        }
    }

    /// The block of some triangles.
    ///
    /// # Safety
    /// The memory of the geometries is readable.
    unsafe fn block(&self, primitives: &[Primitive]) -> Block {
        let Geometries::Triangles(list) = self.geometries else {
            return Block::EMPTY;
        };
        Block::of(primitives.iter().map(|primitive| {
            let geometry = &list[primitive.geometry as usize];
            // SAFETY: the caller guarantees that the memory of the geometries is readable.
            let triangle = unsafe { geometry.triangle(primitive.index) };
            let word = triangle_word(primitive.geometry, geometry);
            (primitive.index, word, triangle.unwrap_or_default())
        }))
    }

    /// Fills the units from `start` to `end`, which reads past the last block may access.
    ///
    /// # Safety
    /// They are inside the part, and no other thread reads or writes them.
    pub unsafe fn end_blocks(&self, start: u32, end: u32) {
        if self.form == Form::Blocks {
            let first = self.leaf_at::<[u8; BLOCK_UNIT]>(start);
            // SAFETY: the caller guarantees that they are inside the part, and no other thread
            // reads or writes them.
            unsafe { first.write_bytes(0, (end - start) as usize) };
        }
    }

    /// The number of groups or other leaves for `count` primitives of one child.
    pub fn leaves_of(&self, count: usize) -> u32 {
        match self.kind {
            Kind::Triangles => count.div_ceil(GROUP) as u32,
            _ => count as u32,
        }
    }

    /// Largest number of primitives of one child.
    pub fn leaf_max(&self) -> usize {
        match self.kind {
            Kind::Triangles => LEAF_TRIANGLES,
            _ => 1,
        }
    }

    /// Writes one child's primitives from leaf `index`. Returns the word for the child and the
    /// number of leaves. (An instance's leaf is its record, at the instance's own index.)
    ///
    /// # Safety
    /// As for [`Self::write_leaf`]; the memory of the geometries is readable.
    pub unsafe fn write_primitives(&self, primitives: &[Primitive], index: u32) -> (u32, u32) {
        if self.form == Form::Blocks {
            // SAFETY: the caller keeps the promises of `Self::write_leaf`, and guarantees that the
            // memory of the geometries is readable.
            return unsafe { self.write_block(primitives, index) };
        }
        // SAFETY: the caller keeps the promises of `Self::write_leaf`, and guarantees that the
        // memory of the geometries is readable.
        let word = unsafe { self.write_leaves(primitives, index) };
        (word, self.leaves_of(primitives.len()))
    }

    /// # Safety
    /// As for [`Self::write_primitives`].
    unsafe fn write_block(&self, primitives: &[Primitive], index: u32) -> (u32, u32) {
        // SAFETY: the caller keeps the promises of `Self::write_primitives`.
        let block = unsafe { self.block(primitives) };
        let units = block.units();
        let from = std::ptr::from_ref(&block).cast::<[u8; BLOCK_UNIT]>();
        // SAFETY: so many units are this child's; a block is as long.
        unsafe { (self.leaf_at::<[u8; BLOCK_UNIT]>(index)).copy_from(from, units as usize) };
        (child::LEAF | index, units)
    }

    /// # Safety
    /// As for [`Self::write_primitives`].
    unsafe fn write_leaves(&self, primitives: &[Primitive], index: u32) -> u32 {
        match self.geometries {
            Geometries::Triangles(_) => {
                for (i, primitives) in primitives.chunks(GROUP).enumerate() {
                    // SAFETY: the caller keeps the promises of `Self::write_primitives`.
                    unsafe { self.write_group(primitives, index + i as u32) };
                }
                let two = if primitives.len() > GROUP {
                    child::TWO_GROUPS
                } else {
                    0
                };
                child::LEAF | two | index
            }
            Geometries::Aabbs(list) => {
                let primitive = primitives[0];
                let entry = BoxEntry {
                    primitive: primitive.index,
                    geometry: word(primitive.geometry, list[primitive.geometry as usize].flags),
                };
                // SAFETY: the caller keeps the promises of `Self::write_primitives`.
                unsafe { self.write_leaf(index, entry) };
                child::LEAF | index
            }
            Geometries::Swept(list) => {
                let primitive = primitives[0];
                let geometry = &list[primitive.geometry as usize];
                // SAFETY: the caller keeps the promises of `Self::write_primitives`.
                let read = unsafe { geometry.primitive(primitive.index) };
                let entry = read.unwrap_or(SweptPrimitive::NOTHING).entry(
                    primitive.index,
                    primitive.geometry,
                    geometry,
                );
                // SAFETY: the caller keeps the promises of `Self::write_primitives`.
                unsafe { self.write_leaf(index, entry) };
                child::LEAF | index
            }
            Geometries::Motion(list) => {
                let primitive = primitives[0];
                let geometry = &list[primitive.geometry as usize];
                // SAFETY: the caller keeps the promises of `Self::write_primitives`.
                unsafe {
                    let entry = geometry.entry(primitive.index, primitive.geometry);
                    self.write_leaf(index, entry);
                }
                child::LEAF | index
            }
            Geometries::Instances(_) => child::LEAF | primitives[0].index,
        }
    }

    /// # Safety
    /// As for [`Self::write_primitives`].
    unsafe fn write_group(&self, primitives: &[Primitive], index: u32) {
        // SAFETY: the caller keeps the promises of `Self::write_primitives`. It is filled in where
        // it is, as copies of what was just written number by number are slow.
        let group = unsafe {
            self.write_leaf(index, TriangleGroup::EMPTY);
            &mut *self.leaf_at::<TriangleGroup>(index)
        };
        let mut extent = Extent::default();
        for (lane, primitive) in primitives.iter().enumerate() {
            group.primitives[lane] = primitive.index;
            let Geometries::Triangles(list) = self.geometries else {
                continue;
            };
            let geometry = &list[primitive.geometry as usize];
            group.geometries[lane] = triangle_word(primitive.geometry, geometry);
            // SAFETY: the caller keeps the promises of `Self::write_primitives`.
            if let Some(triangle) = unsafe { geometry.triangle(primitive.index) } {
                group.set_triangle(lane, &triangle);
                extent.add(&triangle);
                group.lanes |= 1 << lane;
            }
        }
        group.margin = extent.margin();
    }

    /// Prefetches the vertices that are written next.
    ///
    /// # Safety
    /// The memory of the geometries is readable.
    unsafe fn prefetch(&self, primitives: &[Primitive]) {
        if let Geometries::Triangles(list) = self.geometries {
            for primitive in primitives {
                // SAFETY: the caller guarantees that the memory of the geometries is readable.
                unsafe { list[primitive.geometry as usize].prefetch(primitive.index) };
            }
        }
    }

    /// Writes the planned subtree whose wide root is node `node_index`; its nodes follow that one,
    /// its leaves start at `leaf_index`.
    ///
    /// # Safety
    /// As for [`Self::write_leaf`]; `primitives` are the subtree's.
    pub unsafe fn write_tree(
        &self,
        nodes: &[BinaryNode],
        primitives: &[Primitive],
        node_index: u32,
        leaf_index: u32,
    ) {
        let found = Children::of(nodes);
        let root_is_leaf = collapse::is_leaf(nodes);
        let mut node = Node::EMPTY;
        let mut next_leaf = leaf_index;
        for (lane, (subtree, first)) in found.iter().enumerate() {
            node.set_bounds(lane, subtree[0].bounds());
            if root_is_leaf || collapse::is_leaf(subtree) {
                let own = &primitives[first as usize..][..subtree[0].count as usize];
                // SAFETY: these leaves are this child's by the plan.
                let (word, leaves) = unsafe { self.write_primitives(own, next_leaf) };
                node.children[lane] = word;
                next_leaf += leaves;
            }
        }
        let mut tasks = [None; WIDTH];
        let mut next_node = node_index + 1;
        for (lane, (subtree, first)) in found.iter().enumerate() {
            if node.children[lane] == child::NONE {
                node.children[lane] = next_node;
                tasks[lane] = Some((subtree, first, next_node, next_leaf));
                next_node += subtree[0].wide_nodes;
                next_leaf += subtree[0].wide_leaves;
            }
        }
        // SAFETY: the caller keeps the promises of `Self::write_leaf`, and guarantees that
        // `primitives` are the subtree's.
        unsafe { self.write_node(node_index, &node) };
        let run = |(subtree, first, node_index, leaf_index): BinarySubtree<'_>| {
            let own = &primitives[first as usize..][..subtree[0].count as usize];
            if subtree[0].count <= NEAR && nodes[0].count > NEAR {
                // SAFETY: the caller keeps the promises of `Self::write_leaf`, and guarantees that
                // `primitives` are the subtree's.
                unsafe { self.prefetch(own) };
            }
            // SAFETY: the plan gave this subtree these nodes and leaves.
            unsafe { self.write_tree(subtree, own, node_index, leaf_index) };
        };
        if nodes[0].count > PARALLEL && in_pool() {
            rayon::scope(|scope| {
                for task in tasks.into_iter().flatten() {
                    scope.spawn(move |_| run(task));
                }
            });
        } else {
            tasks.into_iter().flatten().for_each(run);
        }
    }
}

type BinarySubtree<'a> = (&'a [BinaryNode], u32, u32, u32);
