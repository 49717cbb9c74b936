//! Builds one IR function: appends typed operations to the open body, and keeps the function's
//! head.

use foldhash::{HashMap, HashSet};

use smallvec::SmallVec;

use crate::Error;
use crate::environment::reference;
use crate::ir::op::{Access, DescriptorBinding, Signature};
use crate::ir::{
    Body, Function, Inst, Label, Node, Op, Terminator, Type, Value, Variable, VariableId,
};

pub(super) struct Builder {
    pub function: Function,
    /// Word offset of the SPIR-V instruction that is being lowered.
    pub source: u32,
    nodes: Vec<Node>,
    constants: HashMap<(Type, u64), Value>,
    references: HashMap<(DescriptorBinding, u32), Value>,
    /// The known descriptors of references, visible wherever the reference is.
    named: HashMap<Value, Value>,
    /// The head, visible everywhere: constants, and descriptors at constant indices with their
    /// references.
    head: Vec<Node>,
    /// The prologue after `head`: initial values of module variables.
    prologue: Vec<Node>,
    prologue_depth: u32,
    head_values: HashSet<Value>,
    emitted: usize,
    budget: usize,
}

/// A loop over a number, while its body is open.
pub(super) struct CountedLoop {
    done: Label,
    again: Label,
    check: Label,
    first: Value,
    pub number: Value,
    outside: Vec<Node>,
    around: Vec<Node>,
}

impl Builder {
    /// `budget`: operations that may be emitted.
    pub fn new(name: &str, budget: usize) -> Self {
        Self {
            function: Function {
                name: name.to_owned(),
                params: Vec::new(),
                results: Vec::new(),
                value_types: Vec::new(),
                labels: 0,
                variables: Vec::new(),
                tables: Vec::new(),
                body: Body {
                    nodes: Vec::new(),
                    end: Terminator::Unreachable,
                },
            },
            source: 0,
            nodes: Vec::new(),
            constants: HashMap::default(),
            references: HashMap::default(),
            named: HashMap::default(),
            head: Vec::new(),
            prologue: Vec::new(),
            prologue_depth: 0,
            head_values: HashSet::default(),
            emitted: 0,
            budget,
        }
    }

    /// The function, with its outermost body's terminator.
    pub fn finish(mut self, end: Terminator) -> Function {
        let mut nodes = self.head;
        nodes.append(&mut self.prologue);
        nodes.append(&mut self.nodes);
        self.function.body = Body { nodes, end };
        self.function
    }

    /// Operations that may still be emitted.
    pub fn remaining(&self) -> usize {
        self.budget.saturating_sub(self.emitted)
    }

    /// Counts operations that another builder has emitted.
    pub fn spend(&mut self, operations: usize) -> Result<(), Error> {
        self.emitted += operations;
        if self.emitted > self.budget {
            return Err(super::budget(
                "the shader is too large for its module's size",
            ));
        }
        Ok(())
    }

    pub fn ty(&self, value: Value) -> Type {
        self.function.ty(value)
    }

    /// An ill-typed instruction, at the current source.
    pub fn invalid(&self, message: impl Into<String>) -> Error {
        Error::invalid(self.source, message)
    }

    /// Whether a value is visible in the whole function.
    pub fn is_global(&self, value: Value) -> bool {
        self.head_values.contains(&value)
    }

    /// Opens a nested body. The outer one continues after [`Self::close`].
    pub fn open(&mut self) -> Vec<Node> {
        std::mem::take(&mut self.nodes)
    }

    /// Ends the nested body and returns to the outer one.
    pub fn close(&mut self, outer: Vec<Node>, end: Terminator) -> Box<Body> {
        let nodes = std::mem::replace(&mut self.nodes, outer);
        Box::new(Body { nodes, end })
    }

    pub fn push(&mut self, node: Node) {
        self.nodes.push(node);
    }

    /// Opens the body of a loop over a number that starts as `first`.
    pub fn open_loop(&mut self, first: Value) -> CountedLoop {
        let [done, again, check] = [self.new_label(), self.new_label(), self.new_label()];
        CountedLoop {
            done,
            again,
            check,
            first,
            number: self.function.new_value(Type::I32),
            outside: self.open(),
            around: self.open(),
        }
    }

    /// Leaves a loop unless a condition holds.
    pub fn leave_unless(&mut self, counted: &CountedLoop, condition: Value) {
        let before = self.open();
        let then_body = self.close(before, Terminator::Br(counted.check, Vec::new()));
        let before = self.open();
        let else_body = self.close(before, Terminator::Br(counted.done, Vec::new()));
        self.push(Node::If {
            condition,
            label: counted.check,
            results: Vec::new(),
            then_body,
            else_body,
        });
    }

    /// Ends the body of a loop, whose number grows by `step`.
    pub fn close_loop(&mut self, counted: CountedLoop, step: Value) -> Result<(), Error> {
        let next = self.binary(Op::IAdd, counted.number, step)?;
        let body = self.close(counted.around, Terminator::Br(counted.again, vec![next]));
        self.push(Node::Loop {
            label: counted.again,
            params: vec![counted.number],
            init: vec![counted.first],
            body,
        });
        let body = self.close(counted.outside, Terminator::Unreachable);
        self.push(Node::Block {
            label: counted.done,
            results: Vec::new(),
            body,
        });
        Ok(())
    }

    /// Opens the function's prologue instead of the open body, to which [`Self::leave_prologue`]
    /// returns.
    pub fn enter_prologue(&mut self) -> Vec<Node> {
        self.prologue_depth += 1;
        if self.prologue_depth > 1 {
            return Vec::new();
        }
        let prologue = std::mem::take(&mut self.prologue);
        std::mem::replace(&mut self.nodes, prologue)
    }

    pub fn leave_prologue(&mut self, nodes: Vec<Node>) {
        self.prologue_depth -= 1;
        if self.prologue_depth > 0 {
            return;
        }
        self.prologue = std::mem::replace(&mut self.nodes, nodes);
    }

    /// A constant: its bits from the low end.
    pub fn constant(&mut self, ty: Type, bits: u64) -> Value {
        let bits = if ty.bits() == 64 {
            bits
        } else {
            bits & ((1 << ty.bits()) - 1)
        };
        if let Some(&value) = self.constants.get(&(ty, bits)) {
            return value;
        }
        let value = self.head_inst(Op::Const(bits), &[], ty);
        self.constants.insert((ty, bits), value);
        value
    }

    /// Whether a value is the constant with these bits.
    pub fn is_float(&self, value: Value, number: f64) -> bool {
        let ty = self.ty(value);
        let bits = float_bits(ty, number);
        self.constants.get(&(ty, bits)) == Some(&value)
    }

    pub fn i32(&mut self, value: u32) -> Value {
        self.constant(Type::I32, value as u64)
    }

    pub fn i64(&mut self, value: u64) -> Value {
        self.constant(Type::I64, value)
    }

    pub fn f32(&mut self, value: f32) -> Value {
        self.constant(Type::F32, value.to_bits() as u64)
    }

    pub fn bool(&mut self, value: bool) -> Value {
        self.constant(Type::I1, value as u64)
    }

    /// A float constant of any float type.
    pub fn float(&mut self, ty: Type, value: f64) -> Value {
        self.constant(ty, float_bits(ty, value))
    }

    fn head_inst(&mut self, op: Op, args: &[Value], ty: Type) -> Value {
        let value = self.function.new_value(ty);
        self.head.push(Node::Inst(Inst {
            op,
            args: SmallVec::from_slice(args),
            results: SmallVec::from_slice(&[value]),
            source: 0,
        }));
        self.head_values.insert(value);
        value
    }

    /// The reference to a descriptor at a constant index.
    pub fn constant_reference(&mut self, binding: DescriptorBinding, index: u32) -> Value {
        if let Some(&value) = self.references.get(&(binding, index)) {
            return value;
        }
        let at = self.i32(index);
        let value = self.head_inst(Op::DescriptorReference(binding), &[at], Type::I64);
        let named = self.head_inst(Op::Descriptor(binding), &[at], Type::Descriptor);
        self.references.insert((binding, index), value);
        self.named.insert(value, named);
        value
    }

    /// The reference to a descriptor at a computed index.
    pub fn reference(&mut self, binding: DescriptorBinding, index: Value) -> Result<Value, Error> {
        if self.ty(index) != Type::I32 {
            return Err(self.invalid("an index of descriptors is no integer"));
        }
        let value = self.emit_one(Op::DescriptorReference(binding), &[index], Type::I64)?;
        let named = self.emit_one(Op::Descriptor(binding), &[index], Type::Descriptor)?;
        self.named.insert(value, named);
        Ok(value)
    }

    /// The reference to the descriptor of the push constants.
    pub fn push_constants(&mut self) -> Value {
        let value = self.i64(reference::of(reference::PUSH_CONSTANTS, 0));
        if !self.named.contains_key(&value) {
            let named = self.head_inst(Op::PushConstants, &[], Type::Descriptor);
            self.named.insert(value, named);
        }
        value
    }

    /// The descriptor that a reference names.
    pub fn descriptor(&mut self, reference: Value) -> Result<Value, Error> {
        if let Some(&named) = self.named.get(&reference) {
            return Ok(named);
        }
        if self.ty(reference) != Type::I64 {
            return Err(self.invalid("a descriptor is expected"));
        }
        self.emit_one(Op::DescriptorAt, &[reference], Type::Descriptor)
    }

    /// Increases the budget of operations.
    pub fn allow(&mut self, more: usize) {
        self.budget = self.budget.saturating_add(more);
    }

    pub fn new_label(&mut self) -> Label {
        self.function.new_label()
    }

    pub fn new_variable(&mut self, name: &str, rows: u32) -> VariableId {
        self.function.new_variable(Variable {
            name: name.to_owned(),
            rows,
            zero: false,
        })
    }

    /// Appends an operation. The caller guarantees its types.
    pub fn emit_unchecked(
        &mut self,
        op: Op,
        args: &[Value],
        results: &[Type],
    ) -> Result<SmallVec<[Value; 2]>, Error> {
        self.spend(1)?;
        let first = self.function.value_types.len() as u32;
        self.function.value_types.extend_from_slice(results);
        let mut values = SmallVec::with_capacity(results.len());
        for index in 0..results.len() as u32 {
            values.push(Value(first + index));
        }
        self.nodes.push(Node::Inst(Inst {
            op,
            args: SmallVec::from_slice(args),
            results: SmallVec::from_slice(&values),
            source: self.source,
        }));
        Ok(values)
    }

    /// Appends an operation with one result.
    pub fn emit_one(&mut self, op: Op, args: &[Value], result: Type) -> Result<Value, Error> {
        self.spend(1)?;
        let value = self.function.new_value(result);
        self.nodes.push(Node::Inst(Inst {
            op,
            args: SmallVec::from_slice(args),
            results: SmallVec::from_slice(&[value]),
            source: self.source,
        }));
        Ok(value)
    }

    /// Appends an operation without result.
    pub fn emit_effect(&mut self, op: Op, args: &[Value]) -> Result<(), Error> {
        self.emit_unchecked(op, args, &[]).map(drop)
    }

    /// Appends an elementwise operation. Operands of wrong types are an error of the module.
    pub fn emit(&mut self, op: Op, args: &[Value], result: Type) -> Result<Value, Error> {
        self.check(&op, args, result)?;
        self.emit_one(op, args, result)
    }

    fn check(&self, op: &Op, args: &[Value], result: Type) -> Result<(), Error> {
        let mut types = [Type::I1; 4];
        for (ty, &arg) in types.iter_mut().zip(args) {
            *ty = self.ty(arg);
        }
        let types = &types[..args.len().min(4)];
        let int = |ty: Type| !ty.is_float();
        let ok = match op.signature() {
            Signature::Other => match op {
                Op::Select => types[..] == [Type::I1, result, result],
                Op::FLdexp => types[..] == [result, Type::I32] && result.is_float(),
                Op::BitfieldInsert => {
                    types[..] == [result, result, Type::I32, Type::I32] && int(result)
                }
                Op::BitfieldSExtract | Op::BitfieldUExtract => {
                    types[..] == [result, Type::I32, Type::I32] && int(result)
                }
                Op::Pack64 => types[..] == [Type::I32, Type::I32] && result.bits() == 64,
                _ => true,
            },
            signature => signature.fits(types, result),
        };
        if ok {
            return Ok(());
        }
        let message = format!("{} cannot take {types:?} to {result}", op.text());
        Err(self.invalid(message))
    }

    pub fn unary(&mut self, op: Op, a: Value) -> Result<Value, Error> {
        let ty = self.ty(a);
        self.emit(op, &[a], ty)
    }

    pub fn binary(&mut self, op: Op, a: Value, b: Value) -> Result<Value, Error> {
        let ty = self.ty(a);
        self.emit(op, &[a, b], ty)
    }

    pub fn compare(&mut self, op: Op, a: Value, b: Value) -> Result<Value, Error> {
        self.emit(op, &[a, b], Type::I1)
    }

    pub fn select(&mut self, condition: Value, a: Value, b: Value) -> Result<Value, Error> {
        let ty = self.ty(a);
        self.emit(Op::Select, &[condition, a, b], ty)
    }

    pub fn pack64(&mut self, low: Value, high: Value, ty: Type) -> Result<Value, Error> {
        self.emit(Op::Pack64, &[low, high], ty)
    }

    pub fn unpack64(&mut self, value: Value) -> Result<[Value; 2], Error> {
        if self.ty(value).bits() != 64 {
            return Err(self.invalid("a 64-bit value is expected"));
        }
        let words = self.emit_unchecked(Op::Unpack64, &[value], &[Type::I32, Type::I32])?;
        Ok([words[0], words[1]])
    }

    /// The bits of a value as an integer.
    pub fn as_integer(&mut self, value: Value) -> Result<Value, Error> {
        let ty = self.ty(value);
        if ty.is_float() {
            self.emit(Op::Bitcast, &[value], ty.as_integer())
        } else {
            Ok(value)
        }
    }

    /// An integer of any width as i32; booleans are refused.
    pub fn i32_of(&mut self, value: Value, signed: bool) -> Result<Value, Error> {
        let op = if signed { Op::SConvert } else { Op::UConvert };
        match self.ty(value) {
            Type::I32 => Ok(value),
            _ => self.emit(op, &[value], Type::I32),
        }
    }

    /// An integer of any width as i64.
    pub fn i64_of(&mut self, value: Value, signed: bool) -> Result<Value, Error> {
        let op = if signed { Op::SConvert } else { Op::UConvert };
        match self.ty(value) {
            Type::I64 => Ok(value),
            _ => self.emit(op, &[value], Type::I64),
        }
    }

    /// `a + b`; absent terms and 0 emit nothing.
    pub fn add_terms(&mut self, a: Option<Value>, b: u32) -> Result<Value, Error> {
        let constant = self.i32(b);
        match a {
            Some(a) if b != 0 => self.binary(Op::IAdd, a, constant),
            Some(a) => Ok(a),
            None => Ok(constant),
        }
    }

    /// [`Self::add_terms`] of i64.
    pub fn add_terms64(&mut self, a: Option<Value>, b: u64) -> Result<Value, Error> {
        let constant = self.i64(b);
        match a {
            Some(a) if b != 0 => self.binary(Op::IAdd, a, constant),
            Some(a) => Ok(a),
            None => Ok(constant),
        }
    }

    /// `a * factor`.
    pub fn scale(&mut self, a: Value, factor: u64) -> Result<Value, Error> {
        let ty = self.ty(a);
        if factor == 1 {
            return Ok(a);
        }
        if factor.is_power_of_two() {
            let count = self.constant(ty, factor.trailing_zeros() as u64);
            return self.binary(Op::Shl, a, count);
        }
        let factor = self.constant(ty, factor);
        self.binary(Op::IMul, a, factor)
    }

    pub fn load(
        &mut self,
        access: Access,
        address: &[Value],
        types: &[Type],
    ) -> Result<SmallVec<[Value; 2]>, Error> {
        self.emit_unchecked(Op::Load(access), address, types)
    }

    pub fn store(
        &mut self,
        access: Access,
        address: &[Value],
        values: &[Value],
    ) -> Result<(), Error> {
        let args: SmallVec<[Value; 8]> = address.iter().chain(values).copied().collect();
        self.emit_effect(Op::Store(access), &args)
    }
}

/// The bits of a number in a float type.
fn float_bits(ty: Type, value: f64) -> u64 {
    match ty {
        Type::F16 => half::f16::from_f64(value).to_bits() as u64,
        Type::F32 => (value as f32).to_bits() as u64,
        _ => value.to_bits(),
    }
}
