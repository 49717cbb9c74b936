//! The table of operations: name, text, signature, effect. All other properties of operations are
//! derived from it.

use super::{FunctionId, VariableId};
use crate::facts::Fact;

pub use crate::types::{
    Component, MatrixProduct, Trace, Type, VectorProduct, optimal_stride_bytes,
};
pub use images::AtomicOp;

/// The memory of an access: see the table in the [module's prose](super).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Space {
    Private,
    Shared,
    Buffer,
    /// A buffer with offsets of 64 bits.
    Buffer64,
    Global,
}

impl Space {
    /// Number of address operands.
    pub const fn address_operands(self) -> usize {
        match self {
            Space::Buffer | Space::Buffer64 => 2,
            _ => 1,
        }
    }

    /// Whether a descriptor is the first address operand.
    pub const fn is_buffer(self) -> bool {
        matches!(self, Space::Buffer | Space::Buffer64)
    }
}

/// Largest number of words that one [`Op::Table`] returns.
pub const MAX_TABLE_RESULTS: usize = 16;

/// The shape of a pure operation's operands and result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signature {
    /// `(T) -> T`, T integer or i1.
    BitsUnary,
    /// `(T, T) -> T`, T integer or i1.
    BitsBinary,
    /// `(T, T) -> i1`, T integer or i1.
    BitsCompare,
    /// `(T) -> T`, T integer.
    IntUnary,
    /// `(T, T) -> T`, T integer.
    IntBinary,
    /// `(T, T) -> i1`, T integer.
    IntCompare,
    /// `(T) -> T`, T float.
    FloatUnary,
    /// `(T) -> T`, T float; of an f16, the f32's result rounded.
    FloatFunction,
    /// `(T, T) -> T`, T float.
    FloatBinary,
    /// `(T, T, T) -> T`, T float.
    FloatTernary,
    /// `(T, T) -> i1`, T float.
    FloatCompare,
    /// `(T) -> i1`, T float.
    FloatTest,
    /// `(T) -> i32`, T float.
    FloatExponent,
    /// `(A) -> B`: the kinds of the name, of any widths.
    FloatToInt,
    IntToFloat,
    FloatToFloat,
    IntToInt,
    /// `(A) -> B`, both of one width.
    Bitcast,
    /// Not in the list of pure, elementwise operations; described at the variant.
    Other,
}

/// One list of the pure elementwise operations; `$m!` is invoked with rows `(Variant, text,
/// Signature)`.
///
/// `eval::text` is the meaning of each. What takes them from here: the text form, signatures,
/// folding and the interpreter's kernels.
#[macro_export]
macro_rules! elementwise_ops {
    ($m:ident) => {
        $m! {
            // Integers. `*_hi` is the high half of the double-width product; bit positions count
            // from 0; `find_*` gives all ones where there is none (SPIR-V FindILsb, FindSMsb,
            // FindUMsb).
            (IAdd, iadd, IntBinary)
            (ISub, isub, IntBinary)
            (IMul, imul, IntBinary)
            (UMulHi, umul_hi, IntBinary)
            (SMulHi, smul_hi, IntBinary)
            (UDiv, udiv, IntBinary)
            (SDiv, sdiv, IntBinary)
            (URem, urem, IntBinary)
            (SRem, srem, IntBinary)
            (SMod, smod, IntBinary)
            (And, and, BitsBinary)
            (Or, or, BitsBinary)
            (Xor, xor, BitsBinary)
            (Shl, shl, IntBinary)
            (LShr, lshr, IntBinary)
            (AShr, ashr, IntBinary)
            (SMin, smin, IntBinary)
            (SMax, smax, IntBinary)
            (UMin, umin, IntBinary)
            (UMax, umax, IntBinary)
            (Not, not, BitsUnary)
            (INeg, ineg, IntUnary)
            (IAbs, iabs, IntUnary)
            (ISign, isign, IntUnary)
            (BitReverse, bit_reverse, IntUnary)
            (BitCount, bit_count, IntUnary)
            (FindLsb, find_lsb, IntUnary)
            (FindSMsb, find_smsb, IntUnary)
            (FindUMsb, find_umsb, IntUnary)
            (IEq, ieq, BitsCompare)
            (INe, ine, BitsCompare)
            (ULt, ult, IntCompare)
            (ULe, ule, IntCompare)
            (SLt, slt, IntCompare)
            (SLe, sle, IntCompare)
            // Floats. `frem` has the dividend's sign, `fmod` the divisor's; `fround` goes half away
            // from zero; `ffract` is x - floor(x); `fsign` is -1, ±0 or 1, +0 for NaN; ordered
            // comparisons are false with a NaN, unordered ones true.
            (FAdd, fadd, FloatBinary)
            (FSub, fsub, FloatBinary)
            (FMul, fmul, FloatBinary)
            (FDiv, fdiv, FloatBinary)
            (FRem, frem, FloatBinary)
            (FMod, fmod, FloatBinary)
            (FMin, fmin, FloatBinary)
            (FMax, fmax, FloatBinary)
            (FPow, fpow, FloatBinary)
            (FAtan2, fatan2, FloatBinary)
            (FFma, ffma, FloatTernary)
            (FNeg, fneg, FloatUnary)
            (FAbs, fabs, FloatUnary)
            (FSign, fsign, FloatUnary)
            (FFloor, ffloor, FloatUnary)
            (FCeil, fceil, FloatUnary)
            (FTrunc, ftrunc, FloatUnary)
            (FRoundEven, fround_even, FloatUnary)
            (FRound, fround, FloatUnary)
            (FFract, ffract, FloatUnary)
            (FSqrt, fsqrt, FloatUnary)
            (FInverseSqrt, finverse_sqrt, FloatUnary)
            (FSin, fsin, FloatFunction)
            (FCos, fcos, FloatFunction)
            (FTan, ftan, FloatFunction)
            (FAsin, fasin, FloatFunction)
            (FAcos, facos, FloatFunction)
            (FAtan, fatan, FloatFunction)
            (FSinh, fsinh, FloatFunction)
            (FCosh, fcosh, FloatFunction)
            (FTanh, ftanh, FloatFunction)
            (FAsinh, fasinh, FloatFunction)
            (FAcosh, facosh, FloatFunction)
            (FAtanh, fatanh, FloatFunction)
            (FExp, fexp, FloatFunction)
            (FLog, flog, FloatFunction)
            (FExp2, fexp2, FloatFunction)
            (FLog2, flog2, FloatFunction)
            (FQuantizeF16, fquantize_f16, FloatFunction)
            (FFrexpMantissa, ffrexp_mantissa, FloatFunction)
            // Zero of the same sign for a denormal, otherwise the operand.
            (FFlushDenormal, fflush_denormal, FloatFunction)
            // The same functions at less cost and with more error, as `eval::fast` bounds it for
            // f32.
            (FSinFast, fsin_fast, FloatFunction)
            (FCosFast, fcos_fast, FloatFunction)
            (FTanFast, ftan_fast, FloatFunction)
            (FAtanFast, fatan_fast, FloatFunction)
            (FExpFast, fexp_fast, FloatFunction)
            (FExp2Fast, fexp2_fast, FloatFunction)
            (FLogFast, flog_fast, FloatFunction)
            (FLog2Fast, flog2_fast, FloatFunction)
            (FInverseSqrtFast, finverse_sqrt_fast, FloatFunction)
            (FPowFast, fpow_fast, FloatBinary)
            (FAtan2Fast, fatan2_fast, FloatBinary)
            (FOEq, foeq, FloatCompare)
            (FONe, fone, FloatCompare)
            (FOLt, folt, FloatCompare)
            (FOLe, fole, FloatCompare)
            (FUEq, fueq, FloatCompare)
            (FUNe, fune, FloatCompare)
            (FULt, fult, FloatCompare)
            (FULe, fule, FloatCompare)
            (FIsNan, fis_nan, FloatTest)
            (FIsInf, fis_inf, FloatTest)
            // Conversions: the operand's and the result's types say from what to what. `bitcast`
            // keeps the width.
            (FToS, fto_s, FloatToInt)
            (FToU, fto_u, FloatToInt)
            (SToF, sto_f, IntToFloat)
            (UToF, uto_f, IntToFloat)
            (FConvert, fconvert, FloatToFloat)
            // Sign- or zero-extend, or truncate.
            (SConvert, sconvert, IntToInt)
            (UConvert, uconvert, IntToInt)
            (Bitcast, bitcast, Bitcast)
            // Exponent of frexp: float -> i32.
            (FFrexpExponent, ffrexp_exponent, FloatExponent)
        }
    };
}

/// The effect of an operation besides its results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Effect {
    /// No effect; the same operands give the same results anywhere in the invocation.
    Pure,
    /// Reads state that may change.
    Read,
    /// Changes state, or orders changes.
    Change,
    /// Suspends the wave.
    Yield,
}

/// The other operations: `Variant(payload) "text" Effect`. `plain` rows have no payload.
macro_rules! define_ops {
    ($(($variant:ident, $text:ident, $signature:ident))*) => {
        define_ops! {
            [$(($variant, $text, $signature))*]
            plain {
            /// `(i1, T, T) -> T`.
            Select "select" Pure;
            /// `(T, i32) -> T`: ldexp, T float.
            FLdexp "fldexp" Pure;
            /// `(base, insert, offset: i32, count: i32) -> T`, T integer; the bits above the width
            /// are never touched.
            BitfieldInsert "bitfield_insert" Pure;
            /// `(base, offset: i32, count: i32) -> T`.
            BitfieldSExtract "bitfield_sextract" Pure;
            /// `(base, offset: i32, count: i32) -> T`.
            BitfieldUExtract "bitfield_uextract" Pure;
            /// `(low: i32, high: i32) -> i64 | f64`.
            Pack64 "pack64" Pure;
            /// `(i64 | f64) -> (low: i32, high: i32)`.
            Unpack64 "unpack64" Pure;
            /// `(descriptor) -> i32 | i64`: size in bytes of a buffer descriptor's range,
            /// saturated.
            BufferSize "buffer_size" Read;
            /// `(reference: i64) -> descriptor`: the descriptor of a reference; the null descriptor
            /// for an invalid one.
            DescriptorAt "descriptor_at" Pure;
            /// `() -> descriptor`: the descriptor that covers the push constants.
            PushConstants "push_constants" Pure;
            /// `(descriptor) -> i64`: the descriptor's address field (an acceleration structure's
            /// device address).
            DescriptorAddress "descriptor_address" Read;
            /// `() -> i32`: the lane's index in its subgroup, 0..16.
            LaneIndex "lane_index" Read;
            /// `(T) -> T`, T float: the difference between the two horizontally adjacent lanes of
            /// the quad, second less first; 0 unless both are active.
            DerivativeX "derivative_x" Read;
            /// `(T) -> T`, T float: the same for the two vertically adjacent lanes.
            DerivativeY "derivative_y" Read;
            /// `() -> ()`: the lane becomes a helper invocation.
            Demote "demote" Change;
            /// `(size: i32) -> i32`: reserves an abort message of this size in bytes. Returns its
            /// offset in the buffer of [`ABORTS`](crate::environment::reference::ABORTS), or
            /// [`NO_PLACE`](crate::abort::NO_PLACE), also for helper invocations.
            AbortMessage "abort_message" Change;
            /// `(place: i32) -> ()`: the message at an offset is complete, and the device must
            /// stop.
            Abort "abort" Change;
            /// `(vertex: i32, starts: i32, words…) -> ()`: emits the outputs of a vertex, by its
            /// index from 0; each word is i32 or f32. `starts`: 1 for the first vertex of a strip,
            /// otherwise 0, plus twice the number of the stream. A vertex past the module's maximum
            /// is dropped.
            Emit "emit" Change;
            /// `() -> i1`: whether the lane is a helper invocation now.
            IsHelper "is_helper" Read;
            /// `() -> i64`: a monotonic clock.
            ReadClock "read_clock" Read;
            /// `() -> ()`: orders memory between invocations (`OpMemoryBarrier`).
            MemoryBarrier "memory_barrier" Change;
            /// `(t: f32, hit_kind: i32, attribute words…) -> i1`: whether the hit was accepted.
            ReportIntersection "report_intersection" Yield;
            /// `(index: i32, data words…) -> (data words…)`.
            ExecuteCallable "execute_callable" Yield;
            /// Runs the closest-hit or miss shader of a hit object: `(hit object words, payload…)
            /// -> (payload…)`.
            HitObjectExecute "hit_object_execute" Yield;
            /// `(hint, bits, hit object's kind or ones, its record index) -> ()`: may move the lane
            /// to another subgroup.
            ReorderThread "reorder_thread" Yield;
            /// `() -> ()`: waits for all invocations of the workgroup.
            Barrier "barrier" Yield;
            /// `() -> ()`: records the subgroup's arrival and continues.
            BarrierArrive "barrier_arrive" Yield;
            /// `() -> ()`: waits until each subgroup of the workgroup has arrived as often as this
            /// one, or has ended.
            BarrierWait "barrier_wait" Yield;
            /// `(row: i32) -> i1`: advances the ray query whose object starts at that row of
            /// private memory, and rewrites the object; false when the walk is over.
            RayQueryProceed "ray_query_proceed" Yield;
            }
            with {
            /// `() -> T`: the bits, low end of the word.
            Const(u64) "const" Pure;
            /// `() -> T`: a scalar at a fixed row of a variable.
            VarLoad(VariableId, u32) "var.load" Read;
            /// `(T) -> ()`.
            VarStore(VariableId, u32) "var.store" Change;
            /// `() -> i32`: the variable's first row in private memory.
            VarAddress(VariableId) "var.address" Pure;
            /// `(index: i32) -> (i32 | f32, …)`: consecutive words, at most [`MAX_TABLE_RESULTS`],
            /// of one of the function's [tables](super::Function::tables); zeros from its end on.
            Table(u32) "table" Pure;
            /// `(address…) -> (T, …)`: consecutive scalars of the results' type; `(address…,
            /// stride: i32)` if they are strided.
            Load(Access) "load" Read;
            /// `(address…, T, …) -> ()`, with a stride as for a load.
            Store(Access) "store" Change;
            /// `(address…, operand…) -> T`: returns the old value. Operands: none for load (result
            /// only), one for most, (value, comparator) for compare-exchange; `Store` has one
            /// operand and no result.
            Atomic(AtomicOp, Access) "atomic" Change;
            /// `(index: i32) -> descriptor`: an entry of a binding; an index past the binding's end
            /// gives the null descriptor.
            Descriptor(DescriptorBinding) "descriptor" Pure;
            /// `(index: i32) -> i64`: the [reference](crate::environment::reference) to the
            /// descriptor that `Descriptor` returns.
            DescriptorReference(DescriptorBinding) "descriptor_reference" Pure;
            /// `() -> i32 | f32`: a row of the invocation's input record
            /// ([`Module::inputs`](super::Module::inputs)).
            Input(u32) "input" Pure;
            /// `() -> i32`: a word that is the same in the whole dispatch
            /// ([`Environment::uniforms`](crate::environment::Environment::uniforms)).
            Uniform(u32) "uniform" Pure;
            /// Image operations: operands and results at [`ImageOp`](images::ImageOp).
            Image(images::ImageOp) "image" Read;
            /// Subgroup operations: at [`SubgroupOp`].
            Subgroup(SubgroupOp) "subgroup" Read;
            /// `(a…, b…, c…) -> (a·b + c…)`: a product of matrices, each value a row:
            /// see [`MatrixProduct`].
            MatrixProduct(MatrixProduct) "matrix_product" Read;
            /// `(address…, stride: i32, vector…, sums…) -> (sums…)`: the product of a matrix in
            /// memory, with a line stride in bytes, and a vector. Sums are operands if the product
            /// adds: see [`VectorProduct`].
            VectorProduct(VectorProduct, Space) "vector_product" Read;
            /// `(key words…, argument words…) -> ()`: adds a message to the dispatch's
            /// [`Prints`](crate::printf::Prints). The table holds the
            /// [`Message`](crate::printf::Message); the key is as [`key`](super::stage::Stage::key)
            /// lists it.
            DebugPrintf(u32) "debug_printf" Change;
            /// `(params…) -> (results…)`.
            Call(FunctionId) "call" Change;
            /// `(structure: 2 words, flags, cull_mask, sbt_offset, sbt_stride, miss_index, origin x
            /// y z, t_min, direction x y z, t_max, (time,) payload…) -> (payload…)`; each word i32
            /// or f32. To a hit object no closest-hit or miss shader runs, and the results begin
            /// with the words that [`TRACED`](crate::hit_object::TRACED) lists.
            TraceRay(Trace) "" Yield;
            /// A fact of the scheduler about a hit: `(9 words) -> (words…)`, see
            /// [`Fact`](crate::facts::Fact).
            HitObjectGet(Fact) "hit_object_get" Yield;
            }
        }
    };
    (
        [$(($variant:ident, $text:ident, $signature:ident))*]
        plain { $($(#[$plain_doc:meta])* $plain:ident $plain_text:literal $plain_effect:ident;)* }
        with {
            $($(#[$doc:meta])* $with:ident($($payload:ty),*) $with_text:literal $effect:ident;)*
        }
    ) => {
        /// An operation. The elementwise ones come from
        /// [`elementwise_ops!`](crate::elementwise_ops); the others document their operands.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Op {
            $(#[doc = stringify!($text)] $variant,)*
            $($(#[$plain_doc])* $plain,)*
            $($(#[$doc])* $with($($payload),*),)*
        }

        impl Op {
            /// The operation's name in the text form.
            pub fn text(&self) -> &'static str {
                if let Op::TraceRay(trace) = self {
                    return trace.text();
                }
                match self {
                    $(Op::$variant => stringify!($text),)*
                    $(Op::$plain => $plain_text,)*
                    $(Op::$with(..) => $with_text,)*
                }
            }

            /// The shape of operands and results.
            pub fn signature(&self) -> Signature {
                match self {
                    $(Op::$variant => Signature::$signature,)*
                    _ => Signature::Other,
                }
            }

            fn effect(&self) -> Effect {
                match self {
                    $(Op::$variant => Effect::Pure,)*
                    $(Op::$plain => Effect::$plain_effect,)*
                    $(Op::$with(..) => Effect::$effect,)*
                }
            }

            /// The operation of a name, if it has no payload.
            pub fn from_text(text: &str) -> Option<Op> {
                let mut traces = Trace::ALL.map(Op::TraceRay).into_iter();
                match text {
                    $(stringify!($text) => Some(Op::$variant),)*
                    $($plain_text => Some(Op::$plain),)*
                    _ => traces.find(|op| op.text() == text),
                }
            }
        }
    };
}
elementwise_ops!(define_ops);

/// The properties of a memory access besides its operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Access {
    pub space: Space,
    /// Must be performed as written, neither merged nor moved (`Volatile`, or atomic ordering with
    /// other invocations).
    pub volatile: bool,
    /// A load from a uniform block: nothing writes that during a dispatch, as it is read-only, and
    /// no other variable leads to it unless it is decorated with `Aliased` (SPIR-V, section
    /// 2.18.2).
    pub constant: bool,
    /// log₂ of the required alignment of a device address, if it is checked; otherwise 0.
    pub alignment: u8,
    /// The scalars are not consecutive: an i32 operand after the address is their distance in
    /// bytes. Only in buffers and workgroup memory.
    pub is_strided: bool,
}

impl Access {
    /// An access to private memory, without alignment.
    pub fn plain(space: Space) -> Self {
        Self {
            space,
            volatile: false,
            constant: false,
            alignment: 0,
            is_strided: false,
        }
    }

    /// Number of operands before the scalars: address and stride.
    pub const fn place_operands(&self) -> usize {
        self.space.address_operands() + self.is_strided as usize
    }
}

/// The descriptors that an [`Op::Descriptor`] or [`Op::DescriptorReference`] indexes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct DescriptorBinding {
    /// Set number.
    pub set: u32,
    /// First descriptor of the binding in the set (or, if `dynamic`, in the bind point's array of
    /// dynamic descriptors).
    pub first: u32,
    /// Descriptors in the binding; `u32::MAX` = the count is the set's own (variable descriptor
    /// count).
    pub count: u32,
    /// A dynamic uniform or storage buffer.
    pub dynamic: bool,
}

/// Operations across the 16 lanes of a subgroup; only active lanes take part, and helper
/// invocations as the [module's prose](super) says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SubgroupOp {
    /// `() -> i1`: true in the lowest active lane.
    Elect,
    /// `(i1) -> i1`.
    All,
    /// `(i1) -> i1`.
    Any,
    /// `(T) -> i1`: bitwise equality (numeric for floats).
    AllEqual,
    /// `(i1) -> i32`: bit per lane.
    Ballot,
    /// `(T, lane: i32) -> T`: the value of another lane; 0 if it is out of range.
    Shuffle,
    /// `(T, lane: i32) -> T`: the value of another lane of the quad, helper or not; the lane's own
    /// where that one is not active.
    QuadShuffle,
    /// `(T) -> T`: of the lowest active lane.
    BroadcastFirst,
    /// `(T) -> T` over clusters of `cluster` lanes (16 = all; 4 = quads).
    Reduce { op: ReduceOp, cluster: u8 },
    /// `(T) -> T`.
    InclusiveScan(ReduceOp),
    /// `(T) -> T`: the identity in the first lane.
    ExclusiveScan(ReduceOp),
    /// `(T) -> i32`: bit per active lane with the same bits.
    Match,
    /// `(T, lanes: i32) -> T` over the active lanes whose bit is set: each lane has the bits of its
    /// own part.
    PartitionedReduce(ReduceOp),
    /// `(T, lanes: i32) -> T`.
    PartitionedInclusiveScan(ReduceOp),
    /// `(T, lanes: i32) -> T`: the identity in a part's first lane.
    PartitionedExclusiveScan(ReduceOp),
}

/// The combining operation of a reduction or scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ReduceOp {
    IAdd,
    FAdd,
    IMul,
    FMul,
    SMin,
    UMin,
    FMin,
    SMax,
    UMax,
    FMax,
    And,
    Or,
    Xor,
}

impl Op {
    /// Suspends the wave.
    pub fn is_yield(&self) -> bool {
        self.effect() == Effect::Yield
    }

    /// Has no effect except its results, which depend only on the operands: it may be merged, moved
    /// to a dominating position, computed in inactive lanes, or removed.
    pub fn is_pure(&self) -> bool {
        self.effect() == Effect::Pure
    }

    /// May be removed when no result is used: pure, or a read.
    pub fn is_removable(&self) -> bool {
        match self {
            Op::Load(access) => !access.volatile,
            Op::Image(op) => op.is_read(),
            _ => matches!(self.effect(), Effect::Pure | Effect::Read),
        }
    }

    /// The number of descriptor operands, which come first.
    pub fn descriptor_operands(&self) -> usize {
        match self {
            Op::Load(access) | Op::Store(access) | Op::Atomic(_, access) => {
                access.space.is_buffer() as usize
            }
            Op::VectorProduct(_, space) => space.is_buffer() as usize,
            Op::BufferSize | Op::DescriptorAddress => 1,
            Op::Image(image) => 1 + image.has_sampler() as usize,
            _ => 0,
        }
    }

    /// Whether the operation returns a descriptor.
    pub fn gives_descriptor(&self) -> bool {
        matches!(
            self,
            Op::Descriptor(_) | Op::DescriptorAt | Op::PushConstants
        )
    }
}
