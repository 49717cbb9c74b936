//! Operand and result types of every operation, as the verifier checks them.

use images::{Dim, ImageOp, ImageOpKind, LodMode};

use super::op::{
    Access, AtomicOp, Component, MAX_TABLE_RESULTS, MatrixProduct, Signature, Space, SubgroupOp,
    VectorProduct,
};
use super::{Function, FunctionId, Inst, Module, Op, Type, VariableId};
use crate::hit_object::{IDENTITY, TRACED, word};
use crate::printf::Message;

type Checked = Result<(), String>;

/// Checks one instruction's operands and results. The caller has checked that the values exist.
pub(super) fn check_operation(module: &Module, function: &Function, inst: &Inst) -> Checked {
    let args: Vec<Type> = inst.args.iter().map(|&value| function.ty(value)).collect();
    let results: Vec<Type> = inst
        .results
        .iter()
        .map(|&value| function.ty(value))
        .collect();
    check_descriptors(&inst.op, &args, &results)?;
    let signature = inst.op.signature();
    if signature != Signature::Other {
        return require(
            results.len() == 1 && signature.fits(&args, results[0]),
            "wrong operand or result types",
        );
    }
    let types = OperandTypes {
        module,
        function,
        args: &args,
        results: &results,
    };
    types.check(&inst.op)
}

/// Checks that exactly the operands and results that an operation declares as descriptors are ones.
/// The other checks need not look for stray descriptors.
fn check_descriptors(op: &Op, args: &[Type], results: &[Type]) -> Checked {
    let taken = op.descriptor_operands();
    for (index, &ty) in args.iter().enumerate() {
        match (index < taken, ty == Type::Descriptor) {
            (true, false) => return Err(format!("operand {index} is no descriptor")),
            (false, true) => return Err(format!("operand {index} is a descriptor")),
            _ => {}
        }
    }
    let given = op.gives_descriptor();
    require(
        results.iter().all(|&ty| (ty == Type::Descriptor) == given),
        if given {
            "gives a descriptor"
        } else {
            "does not give descriptors"
        },
    )
}

fn require(holds: bool, rule: &str) -> Checked {
    if holds { Ok(()) } else { Err(rule.into()) }
}

fn is_int(ty: Type) -> bool {
    !ty.is_float() && ty != Type::I1
}

fn is_word(ty: Type) -> bool {
    matches!(ty, Type::I32 | Type::F32)
}

fn all_equal(types: &[Type]) -> bool {
    types.windows(2).all(|pair| pair[0] == pair[1])
}

impl Signature {
    /// Whether a pure elementwise operation takes such operands to such a result.
    pub fn fits(self, args: &[Type], result: Type) -> bool {
        let (arity, family): (usize, fn(Type) -> bool) = match self {
            Signature::BitsUnary => (1, |ty| !ty.is_float()),
            Signature::BitsBinary | Signature::BitsCompare => (2, |ty| !ty.is_float()),
            Signature::IntUnary | Signature::IntToFloat | Signature::IntToInt => (1, is_int),
            Signature::IntBinary | Signature::IntCompare => (2, is_int),
            Signature::FloatBinary | Signature::FloatCompare => (2, Type::is_float),
            Signature::FloatTernary => (3, Type::is_float),
            Signature::Bitcast => (1, |ty| ty != Type::I1),
            Signature::Other => return false,
            _ => (1, Type::is_float),
        };
        let given = match self {
            Signature::BitsCompare
            | Signature::IntCompare
            | Signature::FloatCompare
            | Signature::FloatTest => result == Type::I1,
            Signature::FloatExponent => result == Type::I32,
            Signature::FloatToInt | Signature::IntToInt => is_int(result),
            Signature::IntToFloat | Signature::FloatToFloat => result.is_float(),
            Signature::Bitcast => args.first().map(|ty| ty.bits()) == Some(result.bits()),
            _ => args.first() == Some(&result),
        };
        args.len() == arity && all_equal(args) && family(args[0]) && given
    }
}

/// The operands and results of an instruction, by their types.
struct OperandTypes<'a> {
    module: &'a Module,
    function: &'a Function,
    args: &'a [Type],
    results: &'a [Type],
}

impl OperandTypes<'_> {
    /// Checks an operation that is not elementwise. The table of these: a row each.
    fn check(&self, op: &Op) -> Checked {
        use Type::{Descriptor, F32, I1, I32, I64};
        let (args, results) = (self.args, self.results);
        match op {
            Op::Const(bits) => self.check_constant(*bits),
            Op::Select => {
                self.has_one_result()?;
                self.takes(&[I1, results[0], results[0]])
            }
            Op::FLdexp => {
                self.has_one_float_result()?;
                self.takes(&[results[0], I32])
            }
            Op::BitfieldInsert => {
                self.has_one_integer_result()?;
                self.takes(&[results[0], results[0], I32, I32])
            }
            Op::BitfieldSExtract | Op::BitfieldUExtract => {
                self.has_one_integer_result()?;
                self.takes(&[results[0], I32, I32])
            }
            Op::Pack64 => self.check_pack(),
            Op::Unpack64 => self.check_unpack(),
            Op::VarLoad(variable, row) => self.check_variable_load(*variable, *row),
            Op::VarStore(variable, row) => self.check_variable_store(*variable, *row),
            Op::VarAddress(variable) => self.check_variable_address(*variable),
            Op::Table(index) => self.check_table(*index),
            Op::DebugPrintf(index) => self.check_printf(*index),
            Op::Load(access) => self.check_load(access),
            Op::Store(access) => self.check_store(access),
            Op::Atomic(kind, access) => {
                check_written(access)?;
                require(!access.is_strided, "an atomic is on one scalar")?;
                check_atomic(*kind, check_address(access, args)?, results)
            }
            Op::BufferSize => {
                self.takes(&[Descriptor])?;
                require(matches!(results, [I32 | I64]), "a size is an i32 or an i64")
            }
            Op::Descriptor(_) => self.maps(&[I32], &[Descriptor]),
            Op::DescriptorReference(_) => self.maps(&[I32], &[I64]),
            Op::DescriptorAt => self.maps(&[I64], &[Descriptor]),
            Op::PushConstants => self.maps(&[], &[Descriptor]),
            Op::ReadClock => self.maps(&[], &[I64]),
            Op::DescriptorAddress => self.maps(&[Descriptor], &[I64]),
            Op::Input(row) => self.check_input(*row),
            Op::Uniform(_) | Op::LaneIndex => self.maps(&[], &[I32]),
            Op::Image(image) => check_image(image, args, results),
            Op::Subgroup(kind) => check_subgroup(*kind, args, results),
            Op::MatrixProduct(product) => check_product(product, args, results),
            Op::VectorProduct(product, space) => {
                check_vector_product(product, *space, args, results)
            }
            Op::DerivativeX | Op::DerivativeY => {
                self.has_one_float_result()?;
                self.takes(results)
            }
            Op::Emit => self.check_emit(),
            Op::AbortMessage => self.maps(&[I32], &[I32]),
            Op::Abort => self.maps(&[I32], &[]),
            Op::IsHelper => self.maps(&[], &[I1]),
            Op::MemoryBarrier | Op::Barrier | Op::BarrierArrive | Op::BarrierWait | Op::Demote => {
                self.maps(&[], &[])
            }
            Op::RayQueryProceed => self.maps(&[I32], &[I1]),
            Op::Call(callee) => self.check_call(*callee),
            Op::TraceRay(trace) => {
                let traced = if trace.to_hit_object { TRACED.len() } else { 0 };
                self.passes_words(trace.words(), traced, "payload in and out differ")
            }
            Op::ReportIntersection => {
                require(args.starts_with(&[F32, I32]), "needs t and a hit kind")?;
                require(args.iter().all(|&ty| is_word(ty)), "attributes are words")?;
                self.gives(&[I1])
            }
            Op::ExecuteCallable => self.check_callable(),
            Op::HitObjectExecute => self.passes_words(word::COUNT, 0, "payload in and out differ"),
            Op::HitObjectGet(fact) => {
                words_only(args, results)?;
                let fits = args.len() == IDENTITY.len() && results.len() == fact.words();
                require(fits, "needs the words that name a hit")
            }
            Op::ReorderThread => {
                words_only(args, results)?;
                require(args.len() == 4 && results.is_empty(), "needs four words")
            }
            _ => Err("an operation without a signature".into()),
        }
    }

    fn takes(&self, expected: &[Type]) -> Checked {
        require(self.args == expected, "wrong operands")
    }

    fn gives(&self, expected: &[Type]) -> Checked {
        require(self.results == expected, "wrong results")
    }

    fn maps(&self, args: &[Type], results: &[Type]) -> Checked {
        self.takes(args)?;
        self.gives(results)
    }

    fn has_one_result(&self) -> Checked {
        require(self.results.len() == 1, "wrong number of results")
    }

    fn has_one_float_result(&self) -> Checked {
        self.has_one_result()?;
        require(self.results[0].is_float(), "not a float")
    }

    fn has_one_integer_result(&self) -> Checked {
        self.has_one_result()?;
        require(is_int(self.results[0]), "not an integer")
    }

    /// Words only, with as many words passed through as come back, except `extra_args` operands,
    /// which are not passed, and `extra_results` additional results.
    fn passes_words(&self, extra_args: usize, extra_results: usize, rule: &str) -> Checked {
        let (args, results) = (self.args, self.results);
        words_only(args, results)?;
        let passed = args.len().checked_sub(extra_args);
        require(
            passed.is_some_and(|passed| passed + extra_results == results.len()),
            rule,
        )
    }

    fn check_constant(&self, bits: u64) -> Checked {
        self.takes(&[])?;
        self.has_one_result()?;
        let width = self.results[0].bits();
        require(
            width == 64 || bits >> width == 0,
            "a constant with bits above its type's width",
        )
    }

    fn check_pack(&self) -> Checked {
        self.has_one_result()?;
        require(self.results[0].bits() == 64, "the result has not 64 bits")?;
        self.takes(&[Type::I32, Type::I32])
    }

    fn check_unpack(&self) -> Checked {
        let is_wide = matches!(self.args, [ty] if ty.bits() == 64);
        require(is_wide, "the operand has not 64 bits")?;
        self.gives(&[Type::I32, Type::I32])
    }

    fn check_variable_load(&self, variable: VariableId, row: u32) -> Checked {
        self.takes(&[])?;
        self.has_one_result()?;
        check_variable_row(self.function, variable, row, self.results[0])
    }

    fn check_variable_store(&self, variable: VariableId, row: u32) -> Checked {
        self.gives(&[])?;
        require(self.args.len() == 1, "wrong number of operands")?;
        check_variable_row(self.function, variable, row, self.args[0])
    }

    fn check_variable_address(&self, variable: VariableId) -> Checked {
        let exists = variable.index() < self.function.variables.len();
        require(exists, "no such variable")?;
        self.maps(&[], &[Type::I32])
    }

    fn check_table(&self, index: u32) -> Checked {
        let exists = (index as usize) < self.function.tables.len();
        require(exists, "no such table")?;
        self.takes(&[Type::I32])?;
        let some = (1..=MAX_TABLE_RESULTS).contains(&self.results.len());
        require(
            some && self.results.iter().all(|&ty| is_word(ty)),
            "a table holds words",
        )
    }

    fn check_printf(&self, index: u32) -> Checked {
        self.gives(&[])?;
        let table = self.function.tables.get(index as usize);
        let message = table.and_then(|words| Message::from_table(words));
        let message = message.ok_or("no such message")?;
        let words = self.module.stage.key().len() + message.words();
        let fits = self.args.len() == words && self.args.iter().all(|&ty| is_word(ty));
        require(fits, "operands do not match the message")
    }

    fn check_load(&self, access: &Access) -> Checked {
        let values = check_address(access, self.args)?;
        require(values.is_empty(), "wrong operands")?;
        require(
            !access.constant || access.space == Space::Buffer && !access.volatile,
            "only buffers hold uniform blocks",
        )?;
        check_scalars(access, self.results)
    }

    fn check_store(&self, access: &Access) -> Checked {
        self.gives(&[])?;
        check_written(access)?;
        check_scalars(access, check_address(access, self.args)?)
    }

    fn check_input(&self, row: u32) -> Checked {
        let exists = (row as usize) < self.module.inputs.len();
        require(exists, "no such input row")?;
        self.takes(&[])?;
        let is_one_word = matches!(self.results, [ty] if is_word(*ty));
        require(is_one_word, "an input is a word")
    }

    fn check_emit(&self) -> Checked {
        words_only(self.args, self.results)?;
        let is_vertex = self.args.first() == Some(&Type::I32)
            && self.args.len() == self.module.outputs.len() + 2;
        require(is_vertex, "needs a vertex and all of its words")?;
        self.gives(&[])
    }

    fn check_call(&self, callee: FunctionId) -> Checked {
        let callee = self.module.functions.get(callee.index());
        let callee = callee.ok_or("no such function")?;
        let params = callee.params.iter().map(|&param| callee.ty(param));
        require(
            params.eq(self.args.iter().copied()),
            "operands do not match the callee's parameters",
        )?;
        require(
            self.results == callee.results,
            "results do not match the callee's",
        )
    }

    fn check_callable(&self) -> Checked {
        let (args, results) = (self.args, self.results);
        require(args.first() == Some(&Type::I32), "needs an index")?;
        require(
            args.iter().chain(results).all(|&ty| is_word(ty)),
            "callable data are words",
        )?;
        require(
            args.len() - 1 == results.len(),
            "callable data in and out differ",
        )
    }
}

fn words_only(args: &[Type], results: &[Type]) -> Checked {
    require(
        args.iter().chain(results).all(|&ty| is_word(ty)),
        "operands and results are words",
    )
}

fn check_variable_row(function: &Function, variable: VariableId, row: u32, ty: Type) -> Checked {
    let Some(variable) = function.variables.get(variable.index()) else {
        return Err("no such variable".into());
    };
    require(
        row.checked_add(ty.rows())
            .is_some_and(|end| end <= variable.rows),
        "past the end of the variable",
    )
}

fn address_types(space: Space) -> &'static [Type] {
    match space {
        Space::Private | Space::Shared => &[Type::I32],
        Space::Buffer => &[Type::Descriptor, Type::I32],
        Space::Buffer64 => &[Type::Descriptor, Type::I64],
        Space::Global => &[Type::I64],
    }
}

fn check_written(access: &Access) -> Checked {
    require(!access.constant, "uniform blocks are not written")?;
    require(
        access.alignment == 0 || access.space == Space::Global,
        "only device addresses have an alignment",
    )
}

/// Checks the leading operands, address and stride, and gives the rest.
fn check_address<'a>(access: &Access, args: &'a [Type]) -> Result<&'a [Type], String> {
    let rest = args.strip_prefix(address_types(access.space));
    let rest = rest.ok_or("wrong address operands")?;
    if !access.is_strided {
        return Ok(rest);
    }
    require(
        matches!(access.space, Space::Shared | Space::Buffer),
        "no stride in this memory",
    )?;
    let rest = rest.strip_prefix(&[Type::I32]);
    Ok(rest.ok_or("a strided access lacks its stride")?)
}

fn check_scalars(access: &Access, scalars: &[Type]) -> Checked {
    require(!scalars.is_empty(), "accesses nothing")?;
    require(
        !access.is_strided || scalars[0].bits() <= 32,
        "only words and less are strided",
    )?;
    require(all_equal(scalars), "accesses scalars of different types")?;
    require(
        scalars[0] != Type::I1 || access.space == Space::Private,
        "booleans are not storable there",
    )
}

fn check_atomic(kind: AtomicOp, operands: &[Type], results: &[Type]) -> Checked {
    let (takes, gives) = match kind {
        AtomicOp::Load => (0, 1),
        AtomicOp::Store => (1, 0),
        AtomicOp::CompareExchange => (2, 1),
        _ => (1, 1),
    };
    require(
        operands.len() == takes && results.len() == gives,
        "wrong number of operands or results",
    )?;
    let mut types = operands.iter().chain(results);
    let first = *types.next().expect("an atomic has an operand or a result");
    require(
        types.all(|&ty| ty == first) && !matches!(first, Type::I1 | Type::I8),
        "wrong type for an atomic",
    )?;
    match kind {
        AtomicOp::FAdd | AtomicOp::FMin | AtomicOp::FMax => {
            require(first.is_float(), "not a float")
        }
        _ if kind.unflushed().is_some() => require(first == Type::F32, "not a 32-bit float"),
        AtomicOp::Load | AtomicOp::Store | AtomicOp::Exchange => Ok(()),
        _ => require(!first.is_float(), "not an integer"),
    }
}

fn check_subgroup(kind: SubgroupOp, args: &[Type], results: &[Type]) -> Checked {
    use Type::{I1, I32};
    let holds = match (kind, args, results) {
        (SubgroupOp::Elect, [], [I1]) => true,
        (SubgroupOp::All | SubgroupOp::Any, [I1], [I1]) => true,
        (SubgroupOp::AllEqual, [_], [I1]) => true,
        (SubgroupOp::Ballot, [I1], [I32]) => true,
        (SubgroupOp::Match, [_], [I32]) => true,
        (
            SubgroupOp::Shuffle
            | SubgroupOp::QuadShuffle
            | SubgroupOp::PartitionedReduce(_)
            | SubgroupOp::PartitionedInclusiveScan(_)
            | SubgroupOp::PartitionedExclusiveScan(_),
            [value, I32],
            [result],
        ) => value == result,
        (
            SubgroupOp::BroadcastFirst
            | SubgroupOp::Reduce { .. }
            | SubgroupOp::InclusiveScan(_)
            | SubgroupOp::ExclusiveScan(_),
            [value],
            [result],
        ) => value == result,
        _ => false,
    };
    require(holds, "wrong operands or results")
}

fn check_product(product: &MatrixProduct, args: &[Type], results: &[Type]) -> Checked {
    let are = |values: &[Type], component: Component| {
        values.len() == MatrixProduct::SIZE && values.iter().all(|&ty| ty == component.ty())
    };
    let mut matrices = args.chunks(MatrixProduct::SIZE);
    let mut next_are = |component| matrices.next().is_some_and(|values| are(values, component));
    let holds = product.is_valid()
        && [product.a, product.b, product.sum]
            .into_iter()
            .all(&mut next_are)
        && matrices.next().is_none()
        && are(results, product.sum);
    require(holds, "wrong operands or results of a product")
}

fn check_vector_product(
    product: &VectorProduct,
    space: Space,
    args: &[Type],
    results: &[Type],
) -> Checked {
    let has_matrices = matches!(space, Space::Buffer | Space::Buffer64 | Space::Global);
    require(has_matrices, "no matrix lies in that memory")?;
    let vectors = args.strip_prefix(address_types(space));
    let vectors = vectors.and_then(|rest| rest.strip_prefix(&[Type::I32]));
    let added = if product.adds { results.len() } else { 0 };
    let columns = vectors.map_or(0, |rest| rest.len().saturating_sub(added));
    let is_count = |count: usize| (1..=VectorProduct::MAX_COMPONENTS).contains(&count);
    let are = |values: &[Type], component: Component| values.iter().all(|&v| v == component.ty());
    let holds = product.is_valid()
        && is_count(columns)
        && is_count(results.len())
        && vectors.is_some_and(|rest| {
            are(&rest[..columns], product.vector) && are(&rest[columns..], product.sum)
        })
        && are(results, product.sum);
    require(holds, "wrong operands or results of a product")
}

/// See [`ImageOp`] for the order of operands.
fn check_image(op: &ImageOp, args: &[Type], results: &[Type]) -> Checked {
    use ImageOpKind as Kind;
    use Type::{Descriptor, F32, I32};
    let sampled = matches!(op.kind, Kind::Sample | Kind::Gather(_) | Kind::QueryLod);
    let query = matches!(
        op.kind,
        Kind::QuerySize | Kind::QueryLevels | Kind::QuerySamples
    );
    require(!matches!(op.kind, Kind::Gather(4..)), "no such texels")?;
    let mut expected = vec![Descriptor];
    if sampled {
        expected.push(Descriptor);
    }
    if !query {
        // SPIR-V gives a level-of-detail query no layer, and an application may ask for one all the
        // same.
        let coordinates = match op.kind {
            Kind::QueryLod if args.len() == 2 + op.spatial_count() => op.spatial_count(),
            _ => op.coordinate_count(),
        };
        let ty = if sampled { F32 } else { I32 };
        expected.extend(std::iter::repeat_n(ty, coordinates));
    }
    if op.depth_compare {
        expected.push(F32);
    }
    match op.lod {
        LodMode::Implicit => {}
        LodMode::Bias => expected.push(F32),
        LodMode::Lod => expected.push(if sampled { F32 } else { I32 }),
        LodMode::Grad => expected.extend(std::iter::repeat_n(F32, 2 * op.spatial_count())),
    }
    if op.has_min_lod {
        expected.push(F32);
    }
    if op.has_offset {
        expected.extend(std::iter::repeat_n(I32, op.spatial_count()));
    }
    if op.has_offsets {
        expected.extend(std::iter::repeat_n(I32, 4 * op.spatial_count()));
    }
    if op.multisampled && !sampled && !query {
        expected.push(I32);
    }
    let (texels, count) = match op.kind {
        Kind::Sample if op.depth_compare => (0, 1),
        Kind::Sample | Kind::Fetch | Kind::Gather(_) | Kind::Read => (0, 4),
        Kind::Write => (4, 0),
        Kind::Atomic(AtomicOp::Load) => (0, 1),
        Kind::Atomic(AtomicOp::Store) => (1, 0),
        Kind::Atomic(AtomicOp::CompareExchange) => (2, 1),
        Kind::Atomic(_) => (1, 1),
        Kind::QuerySize => (0, size_components(op)),
        Kind::QueryLevels | Kind::QuerySamples => (0, 1),
        Kind::QueryLod => (0, 2),
    };
    let result_type = match op.kind {
        Kind::QuerySize | Kind::QueryLevels | Kind::QuerySamples => I32,
        Kind::QueryLod => F32,
        _ => op.texel.into(),
    };
    expected.extend(std::iter::repeat_n(Type::from(op.texel), texels));
    require(args == expected, "wrong image operands")?;
    let tells = matches!(
        op.kind,
        Kind::Sample | Kind::Fetch | Kind::Gather(_) | Kind::Read
    );
    require(tells || !op.residency, "no residency of this operation")?;
    let (results, codes) = results.split_at(count.min(results.len()));
    let is_texel = results.iter().all(|&ty| ty == result_type);
    let is_code = codes == &[I32][..op.residency as usize];
    require(
        results.len() == count && is_texel && is_code,
        "wrong image results",
    )
}

/// Components of `OpImageQuerySize`.
fn size_components(op: &ImageOp) -> usize {
    let spatial = match op.dim {
        Dim::Cube => 2,
        _ => op.spatial_count(),
    };
    spatial + op.arrayed as usize
}
