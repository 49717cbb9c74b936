//! Functions and the tree of nodes in them. The meaning is in the [module's prose](super).

use smallvec::SmallVec;

use super::interface::{Barycentric, FragmentFacts, GeometryFacts, OutputRow, Varying};
use super::mesh::MeshFacts;
use super::tessellation::TessellationFacts;
use super::transform_feedback::FeedbackFacts;
use super::{FunctionId, Label, Op, Type, Value, VariableId};
use crate::ir::stage::{Builtin, Stage};
use crate::query::QueryWord;

/// One operation: operands, results, and the SPIR-V it came from.
#[derive(Clone, Debug, PartialEq)]
pub struct Inst {
    pub op: Op,
    pub args: SmallVec<[Value; 4]>,
    pub results: SmallVec<[Value; 2]>,
    /// Word offset of the SPIR-V instruction this was lowered from; 0 where none.
    pub source: u32,
}

/// A step of a body. Passes move steps about; bodies stay behind boxes, so that a step is no larger
/// than an instruction.
#[derive(Clone, Debug, PartialEq)]
pub enum Node {
    Inst(Inst),
    Block {
        label: Label,
        results: Vec<Value>,
        body: Box<Body>,
    },
    If {
        condition: Value,
        label: Label,
        results: Vec<Value>,
        then_body: Box<Body>,
        else_body: Box<Body>,
    },
    Loop {
        label: Label,
        params: Vec<Value>,
        init: Vec<Value>,
        body: Box<Body>,
    },
}

/// The end of a body.
#[derive(Clone, Debug, PartialEq)]
pub enum Terminator {
    /// Leave the labelled block or `if`, or start the labelled loop's next iteration.
    Br(Label, Vec<Value>),
    /// Leave the function with its results.
    Return(Vec<Value>),
    /// End the invocation: operands are its output words ([`Module::output_rows`] of them, each i32
    /// or f32).
    End(Vec<Value>),
    Unreachable,
}

/// Nodes in order, then a terminator. A module chooses how deeply bodies are nested, so nothing
/// that goes through them recurses (see [`Body::steps`]).
pub struct Body {
    pub nodes: Vec<Node>,
    pub end: Terminator,
}

/// Named per-lane memory.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    /// The name in the shader, or empty.
    pub name: String,
    /// Size in 32-bit rows.
    pub rows: u32,
    /// Starts as zero each time the function is entered; otherwise its first contents are
    /// undefined.
    pub zero: bool,
}

/// A function: parameters and results are scalars.
#[derive(Clone, Debug, PartialEq)]
pub struct Function {
    pub name: String,
    pub params: Vec<Value>,
    pub results: Vec<Type>,
    /// Type of each value, indexed by [`Value`].
    pub value_types: Vec<Type>,
    pub labels: u32,
    pub variables: Vec<Variable>,
    /// Words that never change, by [`Op::Table`] index.
    pub tables: Vec<Vec<u32>>,
    pub body: Body,
}

/// The contents of one 32-bit row of an invocation's input record. `Builtin` components are counted
/// in 32-bit words: component `2 * i + 1` of a 64-bit builtin is the high half of its `i`th
/// element; matrix builtins count column-major.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum InputRow {
    Builtin(Builtin, u8),
    /// Word of the incoming payload.
    Payload(u32),
    /// Word of the hit attribute.
    HitAttribute(u32),
    /// Word of the incoming callable data.
    CallableData(u32),
    /// Vertex stage: a word of the attribute at a location, as a 32-bit number whatever its
    /// format's width. A component of 64 bits has two words, so that such an attribute, which takes
    /// two locations if it has more than two components, has up to eight words at its first one.
    Attribute {
        location: u16,
        component: u8,
    },
    /// Tessellation evaluation, geometry and fragment stage: a word that follows from the outputs
    /// of the stage before.
    Varying(Varying),
    /// Fragment stage: a barycentric coordinate.
    Barycentric(Barycentric),
}

/// A whole shader.
#[derive(Clone, Debug, PartialEq)]
pub struct Module {
    pub stage: Stage,
    /// `functions[0]` is the entry: it has no parameters and no results, and leaves by `end`.
    pub functions: Vec<Function>,
    /// Rows of the input record that the module reads, by [`Op::Input`] index.
    pub inputs: Vec<InputRow>,
    /// The contents of ray query objects after their fixed rows (see [`crate::query`]).
    pub query_words: Vec<QueryWord>,
    /// Words that `end` takes. By stage: any-hit: verdict (0 accept, 1 ignore, 2 accept and
    /// terminate the ray), then payload words; closest hit and miss: payload words; callable:
    /// callable data words; geometry: the number of emitted vertices; intersection, ray
    /// generation, tessellation control, task, mesh and compute: none.
    pub output_rows: u32,
    /// Vertex, tessellation evaluation and fragment: what each of those words is. Geometry: what
    /// each word of an emitted vertex is.
    pub outputs: Vec<OutputRow>,
    /// Tessellation: what the rasterizer must know.
    pub tessellation: Option<TessellationFacts>,
    /// Geometry: what the rasterizer must know.
    pub geometry: Option<GeometryFacts>,
    /// Task and mesh: what the rasterizer must know.
    pub mesh: Option<MeshFacts>,
    /// Vertex, evaluation and geometry: what transform feedback captures.
    pub feedback: Option<FeedbackFacts>,
    /// Fragment: what the rasterizer must know.
    pub fragment: Option<FragmentFacts>,
    /// Compute, task and mesh: the workgroup's size in invocations per dimension; otherwise ones.
    pub local_size: [u32; 3],
    /// Compute, task and mesh: four consecutive lanes are two by two invocations of the workgroup,
    /// instead of four in a row.
    pub quads: bool,
    /// Compute, tessellation control, task and mesh: workgroup memory in bytes.
    pub shared_size_bytes: u32,
}

impl Function {
    /// A new value of type `ty`.
    pub fn new_value(&mut self, ty: Type) -> Value {
        let value = Value(self.value_types.len() as u32);
        self.value_types.push(ty);
        value
    }

    /// A new label.
    pub fn new_label(&mut self) -> Label {
        self.labels += 1;
        Label(self.labels - 1)
    }

    /// A new variable.
    pub fn new_variable(&mut self, variable: Variable) -> VariableId {
        self.variables.push(variable);
        VariableId(self.variables.len() as u32 - 1)
    }

    /// The type of a value of this function.
    pub fn ty(&self, value: Value) -> Type {
        self.value_types[value.index()]
    }
}

impl Module {
    /// The function behind an id.
    pub fn function(&self, id: FunctionId) -> &Function {
        &self.functions[id.index()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Passes move nodes about: large kinds of them belong behind boxes.
    #[test]
    fn nodes_are_small() {
        assert!(size_of::<Op>() <= 24, "{}", size_of::<Op>());
        assert!(size_of::<Node>() <= 80, "{}", size_of::<Node>());
    }
}
