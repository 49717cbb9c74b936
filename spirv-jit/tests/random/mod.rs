//! Makes programs that verify, end, and show what they computed.

mod flow;
mod lanes;
mod memory;
mod operations;
mod shared;

use fastrand::Rng;
use spirv_jit::ir::op::Trace;
use spirv_jit::ir::{
    Body, Function, FunctionId, InputRow, Inst, Label, Module, Node, Op, Terminator, Type, Value,
    Variable,
};
use spirv_jit::program::Stage;

const INPUTS: u32 = 6;
const OUTPUTS: u32 = 4;

/// Where a program's choices come from.
pub struct Random(Rng);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0.u64(..)
    }

    /// Below `bound`.
    pub fn below(&mut self, bound: usize) -> usize {
        self.0.usize(..bound)
    }

    /// True once in `n`.
    pub fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }
}

/// A module of one to three functions.
pub fn random_module(seed: u64) -> Module {
    let mut random = Random(Rng::with_seed(seed));
    // One has workgroup memory, the other one yields of its own.
    let stage = match random.one_in(2) {
        true => Stage::Compute,
        false => Stage::Miss,
    };
    let mut callees: Vec<Function> = Vec::new();
    let callee_count = random.below(3);
    // Made from the last to the first: a function calls only those after it.
    for index in (1..=callee_count).rev() {
        let mut function = generate(&mut random, index, stage, &callees);
        function.name = format!("callee {index}");
        callees.insert(0, function);
    }
    let entry = generate(&mut random, 0, stage, &callees);
    let mut functions = vec![entry];
    functions.extend(callees);
    Module {
        stage,
        functions,
        inputs: (0..INPUTS).map(InputRow::CallableData).collect(),
        output_rows: OUTPUTS,
        outputs: Vec::new(),
        tessellation: None,
        geometry: None,
        mesh: None,
        feedback: None,
        fragment: None,
        local_size: [1; 3],
        quads: false,
        query_words: Vec::new(),
        shared_size_bytes: match stage {
            Stage::Compute => shared::SIZE_BYTES,
            _ => 0,
        },
    }
}

/// `callees` are the functions after number `index`.
fn generate(random: &mut Random, index: usize, stage: Stage, callees: &[Function]) -> Function {
    const TYPES: [Type; 4] = [Type::I32, Type::F32, Type::I1, Type::I64];
    let mut function = Function {
        name: String::new(),
        params: Vec::new(),
        results: Vec::new(),
        value_types: Vec::new(),
        labels: 0,
        tables: Vec::new(),
        variables: Vec::new(),
        body: Body {
            nodes: Vec::new(),
            end: Terminator::Unreachable,
        },
    };
    let mut visible = Vec::new();
    if index > 0 {
        for _ in 0..random.below(4) {
            let param = function.new_value(TYPES[random.below(4)]);
            function.params.push(param);
            visible.push(param);
        }
        for _ in 0..random.below(3) {
            function.results.push(TYPES[random.below(4)]);
        }
    }
    for k in 0..1 + random.below(4) {
        function.variables.push(Variable {
            name: format!("x{k}"),
            rows: 1 + random.below(6) as u32,
            zero: true,
        });
    }
    let size = if index == 0 { 140 } else { 20 };
    let mut generator = Generator {
        random,
        index,
        stage,
        callees,
        function,
        visible,
        buffers: Vec::new(),
        labels: Vec::new(),
        budget: 10 + size,
        barriers: 0,
    };
    let body = generator.body(0, None);
    generator.function.body = *body;
    generator.function
}

/// An open construct.
#[derive(Clone)]
struct OpenConstruct {
    label: Label,
    types: Vec<Type>,
    /// A loop's first parameter, which counts.
    counter: Option<Value>,
}

pub struct Generator<'a> {
    pub random: &'a mut Random,
    index: usize,
    stage: Stage,
    callees: &'a [Function],
    pub function: Function,
    visible: Vec<Value>,
    /// Descriptors: which buffer each is of, as [`Self::buffer_access`] numbers them.
    buffers: Vec<(Value, usize)>,
    labels: Vec<OpenConstruct>,
    /// Instructions that may still be made.
    budget: i32,
    /// Barriers so far.
    barriers: u32,
}

impl Generator<'_> {
    /// A body; it ends by leaving `own`, or the function.
    fn body(&mut self, depth: usize, own: Option<usize>) -> Box<Body> {
        let scope = self.visible.len();
        let mut nodes = Vec::new();
        let steps = if depth == 0 {
            30
        } else {
            2 + self.random.below(8)
        };
        for _ in 0..steps {
            if self.budget <= 0 {
                break;
            }
            self.budget -= 1;
            self.step(depth, &mut nodes);
        }
        let end = self.terminator(own, &mut nodes);
        self.visible.truncate(scope);
        Box::new(Body { nodes, end })
    }

    fn step(&mut self, depth: usize, nodes: &mut Vec<Node>) {
        match self.random.below(29) {
            0..11 => self.operation(nodes),
            11..15 => self.variable_access(nodes),
            15 | 16 => self.buffer_access(nodes),
            17 => self.private_access(nodes),
            18 => self.uncommon(nodes),
            19 => self.call(nodes),
            20 if depth < 6 => self.block(depth, nodes),
            21 | 22 if depth < 6 => self.branch(depth, nodes),
            23 if depth < 6 => self.counted_loop(depth, nodes),
            24 if depth < 6 => self.switch(depth, nodes),
            25 if depth > 0 => self.leave(nodes),
            // Where all lanes that have not ended are together.
            25 if self.index == 0 && self.stage == Stage::Compute => self.barrier(nodes),
            26 if self.index == 0 && self.stage == Stage::Compute => self.shared_access(nodes),
            27 => self.global_access(nodes),
            _ => self.operation(nodes),
        }
    }

    pub fn emit(
        &mut self,
        op: Op,
        args: &[Value],
        types: &[Type],
        nodes: &mut Vec<Node>,
    ) -> Vec<Value> {
        let results: Vec<Value> = types
            .iter()
            .map(|&ty| self.function.new_value(ty))
            .collect();
        nodes.push(Node::Inst(Inst {
            op,
            args: args.into(),
            results: results.clone().into(),
            source: 0,
        }));
        results
    }

    pub fn emit_one(&mut self, op: Op, args: &[Value], ty: Type, nodes: &mut Vec<Node>) -> Value {
        self.emit(op, args, &[ty], nodes)[0]
    }

    pub fn constant(&mut self, bits: u64, ty: Type, nodes: &mut Vec<Node>) -> Value {
        self.emit_one(Op::Const(bits), &[], ty, nodes)
    }

    pub fn show(&mut self, value: Value) {
        self.visible.push(value);
    }

    /// A visible value of a type, or a new one.
    pub fn pick(&mut self, ty: Type, nodes: &mut Vec<Node>) -> Value {
        let fitting: Vec<Value> = self
            .visible
            .iter()
            .copied()
            .filter(|&value| self.function.ty(value) == ty)
            .collect();
        // The newest are the likeliest, so that there are long chains.
        if !fitting.is_empty() && !self.random.one_in(6) {
            let near = fitting.len().saturating_sub(5);
            let at = if self.random.one_in(3) {
                self.random.below(fitting.len())
            } else {
                near + self.random.below(fitting.len() - near)
            };
            return fitting[at];
        }
        if matches!(ty, Type::I32 | Type::F32) && self.random.one_in(2) {
            let row = self.random.below(INPUTS as usize) as u32;
            let value = self.emit_one(Op::Input(row), &[], ty, nodes);
            self.visible.push(value);
            return value;
        }
        let bits = operations::random_constant(self.random, ty);
        let value = self.constant(bits, ty, nodes);
        self.visible.push(value);
        value
    }

    fn pick_all(&mut self, types: &[Type], nodes: &mut Vec<Node>) -> Vec<Value> {
        types.iter().map(|&ty| self.pick(ty, nodes)).collect()
    }

    fn terminator(&mut self, own: Option<usize>, nodes: &mut Vec<Node>) -> Terminator {
        let leaves_early = self.random.one_in(12);
        match own {
            Some(own) if !leaves_early => self.br(own, nodes),
            Some(_) if self.random.below(4) > 0 => {
                let label = self.random.below(self.labels.len());
                self.br(label, nodes)
            }
            Some(_) if self.random.one_in(8) => Terminator::Unreachable,
            _ => self.exit(nodes),
        }
    }

    /// Leaves the function, or ends the invocation.
    fn exit(&mut self, nodes: &mut Vec<Node>) -> Terminator {
        if self.index > 0 && !self.random.one_in(16) {
            let types = self.function.results.clone();
            return Terminator::Return(self.pick_all(&types, nodes));
        }
        let words = (0..OUTPUTS).map(|_| self.word(nodes)).collect();
        Terminator::End(words)
    }

    fn open_labels(&self) -> usize {
        self.labels.len()
    }

    /// The values visible now, for [`Self::leave_scope`].
    fn scope(&self) -> usize {
        self.visible.len()
    }

    fn leave_scope(&mut self, scope: usize) {
        self.visible.truncate(scope);
    }

    /// Leaves the open construct of that index, counting if it is a loop.
    fn br(&mut self, index: usize, nodes: &mut Vec<Node>) -> Terminator {
        let open = self.labels[index].clone();
        let mut args = self.pick_all(&open.types, nodes);
        if let Some(counter) = open.counter {
            let one = self.constant(1, Type::I32, nodes);
            args[0] = self.emit_one(Op::IAdd, &[counter, one], Type::I32, nodes);
        }
        Terminator::Br(open.label, args)
    }

    /// An i32 to show to the outside; NaNs have one form there.
    fn word(&mut self, nodes: &mut Vec<Node>) -> Value {
        if self.random.one_in(2) {
            return self.pick(Type::I32, nodes);
        }
        let float = self.pick(Type::F32, nodes);
        self.canonical_bits(float, nodes)
    }

    fn result_types(&mut self) -> Vec<Type> {
        const TYPES: [Type; 6] = [
            Type::I32,
            Type::F32,
            Type::I1,
            Type::I64,
            Type::I32,
            Type::F16,
        ];
        (0..self.random.below(3))
            .map(|_| TYPES[self.random.below(TYPES.len())])
            .collect()
    }

    fn open(&mut self, types: &[Type], counter: Option<Value>) -> Label {
        let label = self.function.new_label();
        self.labels.push(OpenConstruct {
            label,
            types: types.to_vec(),
            counter,
        });
        label
    }

    fn close(&mut self, types: &[Type]) -> Vec<Value> {
        self.labels.pop();
        let results: Vec<Value> = types
            .iter()
            .map(|&ty| self.function.new_value(ty))
            .collect();
        self.visible.extend(&results);
        results
    }

    fn block(&mut self, depth: usize, nodes: &mut Vec<Node>) {
        let types = self.result_types();
        let label = self.open(&types, None);
        let body = self.body(depth + 1, Some(self.labels.len() - 1));
        let results = self.close(&types);
        nodes.push(Node::Block {
            label,
            results,
            body,
        });
    }

    fn branch(&mut self, depth: usize, nodes: &mut Vec<Node>) {
        let condition = self.pick(Type::I1, nodes);
        let types = self.result_types();
        let label = self.open(&types, None);
        let own = Some(self.labels.len() - 1);
        let then_body = self.body(depth + 1, own);
        let else_body = self.body(depth + 1, own);
        let results = self.close(&types);
        nodes.push(Node::If {
            condition,
            label,
            results,
            then_body,
            else_body,
        });
    }

    /// A block around a loop that leaves it after a few iterations.
    fn counted_loop(&mut self, depth: usize, nodes: &mut Vec<Node>) {
        let types = self.result_types();
        let outer = self.open(&types, None);
        let outer_index = self.labels.len() - 1;
        let mut param_types = vec![Type::I32];
        param_types.extend(self.result_types());
        let mut inside = Vec::new();
        let scope = self.visible.len();
        let mut init = self.pick_all(&param_types, &mut inside);
        init[0] = self.constant(0, Type::I32, &mut inside);
        let params: Vec<Value> = param_types
            .iter()
            .map(|&ty| self.function.new_value(ty))
            .collect();
        let inner = self.open(&param_types, Some(params[0]));
        let loop_index = self.labels.len() - 1;
        self.visible.extend(&params);

        let mut head = Vec::new();
        let limit_bits = 1 + self.random.below(4) as u64;
        let limit = self.constant(limit_bits, Type::I32, &mut head);
        let goes_on = self.emit_one(Op::ULt, &[params[0], limit], Type::I1, &mut head);
        let check = self.function.new_label();
        let mut leaving = Vec::new();
        let before = self.visible.len();
        let end = self.br(outer_index, &mut leaving);
        self.visible.truncate(before);
        head.push(Node::If {
            condition: goes_on,
            label: check,
            results: Vec::new(),
            then_body: Box::new(Body {
                nodes: Vec::new(),
                end: Terminator::Br(check, Vec::new()),
            }),
            else_body: Box::new(Body {
                nodes: leaving,
                end,
            }),
        });
        let mut body = self.body(depth + 1, Some(loop_index));
        head.append(&mut body.nodes);
        body.nodes = head;
        self.labels.pop();
        inside.push(Node::Loop {
            label: inner,
            params,
            init,
            body,
        });
        self.visible.truncate(scope);
        let results = self.close(&types);
        nodes.push(Node::Block {
            label: outer,
            results,
            body: Box::new(Body {
                nodes: inside,
                end: Terminator::Unreachable,
            }),
        });
    }

    /// Yields, subgroup operations, dispatch-wide words.
    fn uncommon(&mut self, nodes: &mut Vec<Node>) {
        let kinds = if self.stage == Stage::Compute { 2 } else { 6 };
        match self.random.below(kinds) {
            0 => self.subgroup_operation(nodes),
            1 => {
                let value = self.emit_one(Op::Uniform(3), &[], Type::I32, nodes);
                self.visible.push(value);
            }
            2 | 3 => {
                let words: Vec<Value> = (0..2 + self.random.below(2))
                    .map(|_| self.word(nodes))
                    .collect();
                let types = vec![Type::I32; words.len() - 1];
                let values = self.emit(Op::ExecuteCallable, &words, &types, nodes);
                self.visible.extend(values);
            }
            _ => {
                let words: Vec<Value> = (0..17).map(|_| self.word(nodes)).collect();
                let values = self.emit(
                    Op::TraceRay(Trace::new(false, false)),
                    &words,
                    &[Type::I32, Type::F32],
                    nodes,
                );
                self.visible.extend(values);
            }
        }
    }

    fn call(&mut self, nodes: &mut Vec<Node>) {
        if self.callees.is_empty() {
            return self.operation(nodes);
        }
        let index = self.random.below(self.callees.len());
        let callee = &self.callees[index];
        let params: Vec<Type> = callee
            .params
            .iter()
            .map(|&param| callee.ty(param))
            .collect();
        let results = callee.results.clone();
        let id = FunctionId((self.index + 1 + index) as u32);
        let args = self.pick_all(&params, nodes);
        let values = self.emit(Op::Call(id), &args, &results, nodes);
        self.visible.extend(values);
    }
}
