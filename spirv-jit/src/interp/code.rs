//! What a program consists of once emitted.

use super::machine::{Instr, Operand};
use crate::image::ImageOp;
use crate::ir::op::{AtomicOp, DescriptorBinding, SubgroupOp};
use crate::ir::{Space, Type};
use crate::state::SiteId;

/// A memory access: its address operands come first at `operands`, then the scalars.
#[derive(Clone, Copy)]
pub(super) struct AccessPlan {
    pub space: Space,
    pub ty: Type,
    /// As [`Access`](crate::ir::op::Access) has it.
    pub alignment: u8,
    /// First of the operands: address, then results (load) or values (store).
    pub operands: u32,
    pub scalars: u32,
}

/// An atomic: address operands, value operands, result.
#[derive(Clone, Copy)]
pub(super) struct AtomicPlan {
    pub op: AtomicOp,
    pub space: Space,
    pub ty: Type,
    pub operands: u32,
}

/// A subgroup operation on values of one type.
#[derive(Clone, Copy)]
pub(super) struct SubgroupPlan {
    pub op: SubgroupOp,
    pub ty: Type,
    /// Helper invocations take part like all others.
    pub with_helpers: bool,
}

/// An image operation: descriptor operands, then the rest with their types, then results.
pub(super) struct ImagePlan {
    pub op: ImageOp,
    pub image: Operand,
    pub sampler: Operand,
    /// A sample at the derivatives of its coordinates, which it finds by itself: the coordinates stand in their place, too.
    pub derives: bool,
    /// With whether they are of 64 bits.
    pub operands: Vec<(Operand, bool)>,
    pub results: Vec<(Operand, bool)>,
    /// A bit per result that is used.
    pub wanted: u8,
}

/// A vector row that is saved, and where in the state.
#[derive(Clone, Copy)]
pub(super) struct Saved {
    pub operand: Operand,
    /// Row of the state.
    pub row: u32,
    /// 64 bits: two rows of the state.
    pub wide: bool,
    /// The row is an input's: it stands there already.
    pub input: bool,
}

/// What descriptors are made of.
#[derive(Clone, Copy)]
pub(super) enum DescriptorSource {
    /// Of an index, in a binding of the program's.
    Binding(u32),
    /// Of a reference.
    Reference,
}

/// A vector row of descriptors that is made again instead of being saved.
#[derive(Clone, Copy)]
pub(super) struct Remade {
    pub to: Operand,
    pub source: DescriptorSource,
    /// A row that is saved.
    pub from: Operand,
}

/// What lives across a place where a wave can be suspended.
#[derive(Default)]
pub(super) struct Live {
    pub saved: Vec<Saved>,
    pub remade: Vec<Remade>,
}

/// A place where a wave can be suspended.
pub(super) struct SavePoint {
    /// Where to go on.
    pub pc: u32,
    pub function: u32,
    /// Id of the point for call path 0; path `c` is `base + c`.
    pub base: u32,
    /// Parked and pending masks that are in use, from the program's first.
    pub masks: u32,
    pub live: Live,
    /// The event, or none for the entry, for back-edges and for where functions begin.
    pub site: Option<SiteId>,
}

/// A call: how to find it from a call path's number, and what its function needs afterwards.
pub(super) struct CallSite {
    pub caller: u32,
    pub callee: u32,
    /// Added to the caller's path number to give the callee's.
    pub context: u32,
    pub return_pc: u32,
    pub live: Live,
}

/// Instructions and the tables they refer to.
#[derive(Default)]
pub(super) struct Code {
    pub instrs: Vec<Instr>,
    pub operands: Vec<Operand>,
    pub accesses: Vec<AccessPlan>,
    pub atomics: Vec<AtomicPlan>,
    pub bindings: Vec<DescriptorBinding>,
    pub subgroups: Vec<SubgroupPlan>,
    pub images: Vec<ImagePlan>,
    /// By `base`.
    pub points: Vec<SavePoint>,
    pub calls: Vec<CallSite>,
    /// By function: its call sites, ascending by `context`.
    pub callers: Vec<Vec<u32>>,
    /// Constants: the first uniform rows.
    pub constants: Vec<crate::row::AlignedRow>,
    /// Behind the instructions that compute uniform rows.
    pub prologue_end: usize,
    /// Uniform rows.
    pub uniform_rows: usize,
    /// Vector rows.
    pub vector_rows: usize,
    pub masks: usize,
    pub end_of_points: u32,
}

impl Code {
    /// The save point of a resume id, and the call path's number.
    pub fn point_of(&self, id: u32) -> (&SavePoint, u32) {
        let index = self.points.partition_point(|point| point.base <= id);
        let point = &self.points[index.saturating_sub(1)];
        (point, id - point.base)
    }

    /// One past the last resume id.
    pub fn points_end(&self) -> u32 {
        self.end_of_points
    }

    /// The call sites on the path to `function`, innermost first.
    pub fn path(&self, function: u32, context: u32) -> Path<'_> {
        Path {
            code: self,
            function,
            context,
        }
    }
}

/// See [`Code::path`].
pub(super) struct Path<'c> {
    code: &'c Code,
    function: u32,
    context: u32,
}

impl<'c> Iterator for Path<'c> {
    type Item = &'c CallSite;

    fn next(&mut self) -> Option<&'c CallSite> {
        let sites = &self.code.callers[self.function as usize];
        let after = sites.partition_point(|&s| self.code.calls[s as usize].context <= self.context);
        let site = &self.code.calls[*sites.get(after.checked_sub(1)?)? as usize];
        self.context -= site.context;
        self.function = site.caller;
        Some(site)
    }
}
