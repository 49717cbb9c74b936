//! The state of a function during lowering.

#![forbid(unsafe_code)]

use std::rc::Rc;

use foldhash::HashMap;

use super::builder::Builder;
use super::stage_interface::Evaluation;
use super::structure::{BodyIndex, LabelIndex, Plan};
use super::values::{Local, Pointer, Val};
use crate::ir::{Body, Label, Node, Value, VariableId};
use crate::parse::{Id, Instruction};

/// The values that a function of the IR returns after its result.
pub(super) struct ExtraResults {
    pub(super) pointers: Vec<Pointer>,
    pub(super) carried: Rc<[Id]>,
}

/// A function during its lowering.
pub(super) struct FunctionFrame {
    pub(super) function: usize,
    pub(super) plan: Rc<Plan>,
    /// The open body of the plan.
    pub(super) body: BodyIndex,
    pub(super) labels: Vec<Option<Label>>,
    /// Length of the table of values before this function's.
    pub(super) first_value: usize,
    pub(super) escaped: HashMap<Id, Escaped>,
    pub(super) phis: HashMap<Id, VariableId>,
    pub(super) large_phis: HashMap<Id, Pointer>,
    pub(super) return_to: ReturnTo,
}

/// A body of a plan during its emission.
pub(super) struct OpenBody {
    /// The body of the plan that continues after it.
    pub(super) outer: BodyIndex,
    /// The next step and the next instruction in it.
    pub(super) step: usize,
    pub(super) instruction: usize,
    /// The nodes before it in the body of the IR around it.
    pub(super) nodes: Vec<Node>,
    pub(super) after: After,
}

/// The action at the end of a body.
pub(super) enum After {
    /// The body of the entry.
    Entry,
    /// The body of a function of the IR.
    Outlined(Box<Outlining>),
    /// The body of an inlined function, which leaves the label.
    Inlined {
        label: Label,
        /// The memory of a large result.
        result: Option<Pointer>,
        call: Instruction,
    },
    Block(LabelIndex),
    Loop(LabelIndex),
    Then {
        condition: Value,
        label: LabelIndex,
        else_body: BodyIndex,
    },
    Else {
        condition: Value,
        label: LabelIndex,
        then_body: Box<Body>,
    },
}

/// A callee that becomes a function of the IR, and the interrupted state of its caller.
pub(super) struct Outlining {
    pub(super) callee: Id,
    pub(super) carried: Rc<[Id]>,
    pub(super) scope: Scope,
}

/// The state of lowering that belongs to one function of the IR.
pub(super) struct Scope {
    pub(super) builder: Builder,
    pub(super) frames: Vec<FunctionFrame>,
    pub(super) locals: Vec<Local>,
    pub(super) module_locals: HashMap<Id, usize>,
    pub(super) input_locals: HashMap<(Id, Evaluation), usize>,
    pub(super) helper_at_start: Option<Value>,
    pub(super) ray_tmax: Option<VariableId>,
}

/// The effect of a return.
#[derive(Clone)]
pub(super) enum ReturnTo {
    /// The entry's return ends the invocation.
    End,
    /// An inlined function leaves the block around it, with its result as values or in memory.
    Block(Label, Option<Pointer>),
    /// A function of the IR returns its result and the values that it took.
    Caller(Rc<ExtraResults>),
}

/// An id with uses outside of the body of its definition.
pub(super) struct Escaped {
    pub(super) value: Val,
    pub(super) body: BodyIndex,
    pub(super) variable: VariableId,
}
