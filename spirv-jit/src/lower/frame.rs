//! The state of a function during lowering.

#![forbid(unsafe_code)]

use std::rc::Rc;

use foldhash::HashMap;

use super::structure::{BodyIndex, Plan};
use super::values::{Pointer, Val};
use crate::ir::{Label, VariableId};
use crate::parse::Id;

/// The values that a function of the IR returns after its result.
pub(super) struct GivenBack {
    pub(super) pointers: Vec<Pointer>,
    pub(super) carried: Rc<[Id]>,
}

/// A function that is being lowered.
pub(super) struct Frame {
    pub(super) function: usize,
    pub(super) plan: Rc<Plan>,
    /// The plan's body that is open.
    pub(super) body: BodyIndex,
    pub(super) labels: Vec<Option<Label>>,
    /// Length of the table of values before this function's.
    pub(super) first_value: usize,
    pub(super) escaped: HashMap<Id, Escaped>,
    pub(super) phis: HashMap<Id, VariableId>,
    pub(super) return_to: ReturnTo,
}

/// Where a return goes.
#[derive(Clone)]
pub(super) enum ReturnTo {
    /// The entry's return ends the invocation.
    End,
    /// A function lowered in place leaves the block around it.
    Block(Label),
    /// A function of the IR returns its result and what it took.
    Caller(Rc<GivenBack>),
}

/// An id that is used beyond the body of its definition.
pub(super) struct Escaped {
    pub(super) value: Val,
    pub(super) body: BodyIndex,
    pub(super) variable: VariableId,
}
