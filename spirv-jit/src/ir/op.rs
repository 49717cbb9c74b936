//! The table of operations: name, text, signature. Everything else about operations is derived from it.

use super::{FunctionId, VariableId};
use crate::hit_object::HitFact;

pub use crate::types::{AtomicOp, Type};

/// Where a memory access goes: see the table in the [module's prose](super).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Space {
    Private,
    Shared,
    Buffer,
    Global,
}

impl Space {
    /// Number of address operands.
    pub const fn address_operands(self) -> usize {
        match self {
            Space::Buffer => 2,
            _ => 1,
        }
    }
}

/// The shape of a pure operation's operands and result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signature {
    /// `(T) -> T`, T integer (or i1 where `not`).
    IntUnary,
    /// `(T, T) -> T`, T integer or i1.
    IntBinary,
    /// `(T, T) -> i1`, T integer or i1.
    IntCompare,
    /// `(T) -> T`, T float.
    FloatUnary,
    /// `(T, T) -> T`, T float.
    FloatBinary,
    /// `(T, T, T) -> T`, T float.
    FloatTernary,
    /// `(T, T) -> i1`, T float.
    FloatCompare,
    /// `(T) -> i1`, T float.
    FloatTest,
    /// `(A) -> B`: the result's type says what to convert to.
    Convert,
    /// Not in the list of pure, elementwise operations; described at the variant.
    Other,
}

/// One list of the pure elementwise operations; `$m!` is invoked with rows `(Variant, "text", Signature)`.
///
/// The meaning of each is `eval::<text>` (a keyword or clash gets a trailing underscore there).
#[macro_export]
macro_rules! elementwise_ops {
    ($m:ident) => {
        $m! {
            // Integers. `*_hi` is the high half of the double-width product; bit positions count from 0; `find_*` gives all ones where
            // there is none (SPIR-V FindILsb, FindSMsb, FindUMsb).
            (IAdd, "iadd", IntBinary)
            (ISub, "isub", IntBinary)
            (IMul, "imul", IntBinary)
            (UMulHi, "umul_hi", IntBinary)
            (SMulHi, "smul_hi", IntBinary)
            (UDiv, "udiv", IntBinary)
            (SDiv, "sdiv", IntBinary)
            (URem, "urem", IntBinary)
            (SRem, "srem", IntBinary)
            (SMod, "smod", IntBinary)
            (And, "and", IntBinary)
            (Or, "or", IntBinary)
            (Xor, "xor", IntBinary)
            (Shl, "shl", IntBinary)
            (LShr, "lshr", IntBinary)
            (AShr, "ashr", IntBinary)
            (SMin, "smin", IntBinary)
            (SMax, "smax", IntBinary)
            (UMin, "umin", IntBinary)
            (UMax, "umax", IntBinary)
            (Not, "not", IntUnary)
            (INeg, "ineg", IntUnary)
            (IAbs, "iabs", IntUnary)
            (ISign, "isign", IntUnary)
            (BitReverse, "bit_reverse", IntUnary)
            (BitCount, "bit_count", IntUnary)
            (FindLsb, "find_lsb", IntUnary)
            (FindSMsb, "find_smsb", IntUnary)
            (FindUMsb, "find_umsb", IntUnary)
            (IEq, "ieq", IntCompare)
            (INe, "ine", IntCompare)
            (ULt, "ult", IntCompare)
            (ULe, "ule", IntCompare)
            (SLt, "slt", IntCompare)
            (SLe, "sle", IntCompare)
            // Floats. `frem` has the dividend's sign, `fmod` the divisor's; `fround` goes half away from zero; `ffract` is x - floor(x);
            // `fsign` is -1, ±0 or 1; ordered comparisons are false with a NaN, unordered ones true.
            (FAdd, "fadd", FloatBinary)
            (FSub, "fsub", FloatBinary)
            (FMul, "fmul", FloatBinary)
            (FDiv, "fdiv", FloatBinary)
            (FRem, "frem", FloatBinary)
            (FMod, "fmod", FloatBinary)
            (FMin, "fmin", FloatBinary)
            (FMax, "fmax", FloatBinary)
            (FPow, "fpow", FloatBinary)
            (FAtan2, "fatan2", FloatBinary)
            (FFma, "ffma", FloatTernary)
            (FNeg, "fneg", FloatUnary)
            (FAbs, "fabs", FloatUnary)
            (FSign, "fsign", FloatUnary)
            (FFloor, "ffloor", FloatUnary)
            (FCeil, "fceil", FloatUnary)
            (FTrunc, "ftrunc", FloatUnary)
            (FRoundEven, "fround_even", FloatUnary)
            (FRound, "fround", FloatUnary)
            (FFract, "ffract", FloatUnary)
            (FSqrt, "fsqrt", FloatUnary)
            (FInverseSqrt, "finverse_sqrt", FloatUnary)
            (FSin, "fsin", FloatUnary)
            (FCos, "fcos", FloatUnary)
            (FTan, "ftan", FloatUnary)
            (FAsin, "fasin", FloatUnary)
            (FAcos, "facos", FloatUnary)
            (FAtan, "fatan", FloatUnary)
            (FSinh, "fsinh", FloatUnary)
            (FCosh, "fcosh", FloatUnary)
            (FTanh, "ftanh", FloatUnary)
            (FAsinh, "fasinh", FloatUnary)
            (FAcosh, "facosh", FloatUnary)
            (FAtanh, "fatanh", FloatUnary)
            (FExp, "fexp", FloatUnary)
            (FLog, "flog", FloatUnary)
            (FExp2, "fexp2", FloatUnary)
            (FLog2, "flog2", FloatUnary)
            (FQuantizeF16, "fquantize_f16", FloatUnary)
            (FFrexpMantissa, "ffrexp_mantissa", FloatUnary)
            // The same functions at less cost and with more error, as `eval::fast` bounds it for f32.
            (FSinFast, "fsin_fast", FloatUnary)
            (FCosFast, "fcos_fast", FloatUnary)
            (FTanFast, "ftan_fast", FloatUnary)
            (FAtanFast, "fatan_fast", FloatUnary)
            (FExpFast, "fexp_fast", FloatUnary)
            (FExp2Fast, "fexp2_fast", FloatUnary)
            (FLogFast, "flog_fast", FloatUnary)
            (FLog2Fast, "flog2_fast", FloatUnary)
            (FInverseSqrtFast, "finverse_sqrt_fast", FloatUnary)
            (FPowFast, "fpow_fast", FloatBinary)
            (FAtan2Fast, "fatan2_fast", FloatBinary)
            (FOEq, "foeq", FloatCompare)
            (FONe, "fone", FloatCompare)
            (FOLt, "folt", FloatCompare)
            (FOLe, "fole", FloatCompare)
            (FUEq, "fueq", FloatCompare)
            (FUNe, "fune", FloatCompare)
            (FULt, "fult", FloatCompare)
            (FULe, "fule", FloatCompare)
            (FIsNan, "fis_nan", FloatTest)
            (FIsInf, "fis_inf", FloatTest)
            // Conversions: the operand's and the result's types say from what to what. `bitcast` keeps the width.
            (FToS, "fto_s", Convert)
            (FToU, "fto_u", Convert)
            (SToF, "sto_f", Convert)
            (UToF, "uto_f", Convert)
            (FConvert, "fconvert", Convert)
            // Sign- or zero-extend, or truncate.
            (SConvert, "sconvert", Convert)
            (UConvert, "uconvert", Convert)
            (Bitcast, "bitcast", Convert)
            // Exponent of frexp: float -> i32.
            (FFrexpExponent, "ffrexp_exponent", Convert)
        }
    };
}

macro_rules! define_op {
    ($(($variant:ident, $text:literal, $signature:ident))*) => {
        /// An operation. The elementwise ones come from [`elementwise_ops!`](crate::elementwise_ops); the rest say what they take.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Op {
            $(#[doc = $text] $variant,)*
            /// `() -> T`: the bits, low end of the word.
            Const(u64),
            /// `(i1, T, T) -> T`.
            Select,
            /// `(T, i32) -> T`: ldexp, T float.
            FLdexp,
            /// `(base, insert, offset: i32, count: i32) -> T`, T integer; the bits above the width are never touched.
            BitfieldInsert,
            /// `(base, offset: i32, count: i32) -> T`.
            BitfieldSExtract,
            /// `(base, offset: i32, count: i32) -> T`.
            BitfieldUExtract,
            /// `(low: i32, high: i32) -> i64 | f64`.
            Pack64,
            /// `(i64 | f64) -> (low: i32, high: i32)`.
            Unpack64,
            /// `() -> T`: a scalar at a fixed row of a variable.
            VarLoad(VariableId, u32),
            /// `(T) -> ()`.
            VarStore(VariableId, u32),
            /// `() -> i32`: the variable's first row in private memory.
            VarAddress(VariableId),
            /// `(address…) -> (T, …)`: consecutive scalars of the results' type.
            Load(Access),
            /// `(address…, T, …) -> ()`.
            Store(Access),
            /// `(address…, operand…) -> T`: returns the old value. Operands: none for load (result only), one for most, (value, comparator)
            /// for compare-exchange; `Store` has one operand and no result.
            Atomic(AtomicOp, Access),
            /// `(descriptor) -> i32`: size in bytes of what a buffer descriptor covers, saturated.
            BufferSize,
            /// `(index: i32) -> descriptor`: an entry of a binding; an index past the binding's end gives the null descriptor.
            Descriptor(DescriptorBinding),
            /// `(index: i32) -> i64`: the [reference](crate::environment::reference) to what `Descriptor` gives.
            DescriptorReference(DescriptorBinding),
            /// `(reference: i64) -> descriptor`: what a reference names; the null descriptor for a number that is none.
            DescriptorAt,
            /// `() -> descriptor`: the descriptor that covers the push constants.
            PushConstants,
            /// `(descriptor) -> i64`: the descriptor's address field (an acceleration structure's device address).
            DescriptorAddress,
            /// `() -> i32 | f32`: a row of the invocation's input record ([`Module::inputs`](super::Module::inputs)).
            Input(u32),
            /// `() -> i32`: a word that is the same in the whole dispatch ([`Environment::uniforms`](crate::environment::Environment::uniforms)).
            Uniform(u32),
            /// Image operations: operands and results at [`ImageOp`](crate::image::ImageOp).
            Image(crate::image::ImageOp),
            /// Subgroup operations: at [`SubgroupOp`].
            Subgroup(SubgroupOp),
            /// `() -> i32`: the lane's index in its subgroup, 0..16.
            LaneIndex,
            /// `(T) -> T`, T float: the difference between the two lanes of the quad that are side by side, second less first; 0 unless both are
            /// active.
            DerivativeX,
            /// The same between the two lanes one above the other.
            DerivativeY,
            /// `() -> ()`: the lane becomes a helper invocation.
            Demote,
            /// `() -> i1`: whether the lane is a helper invocation now.
            IsHelper,
            /// `() -> i64`: a monotonic clock.
            ReadClock,
            /// `() -> ()`: orders memory between invocations (`OpMemoryBarrier`).
            MemoryBarrier,
            /// `(params…) -> (results…)`.
            Call(FunctionId),
            /// Yields. `(structure: 2 words, flags, cull_mask, sbt_offset, sbt_stride, miss_index, origin x y z, t_min, direction x y z, t_max,
            /// payload…) -> (payload…)`: 15 words, then the payload's; each i32 or f32.
            TraceRay,
            /// `(t: f32, hit_kind: i32, attribute words…) -> i1`: whether the hit was accepted.
            ReportIntersection,
            /// `(index: i32, data words…) -> (data words…)`.
            ExecuteCallable,
            /// As `TraceRay`, with the time as the sixteenth word.
            TraceRayMotion,
            /// As `TraceRay`, but no closest-hit or miss shader runs: `(15 words, payload…) -> (16 words, payload…)`, the words of the hit object
            /// that [`TRACED`](crate::hit_object::TRACED) lists.
            HitObjectTraceRay,
            /// As `HitObjectTraceRay`, with the time as the sixteenth word.
            HitObjectTraceRayMotion,
            /// Runs the closest-hit or miss shader of a hit object: `(hit object words, payload…) -> (payload…)`.
            HitObjectExecute,
            /// What the scheduler knows of a hit: `(9 words) -> (words…)`, see [`HitFact`](crate::hit_object::HitFact).
            HitObjectGet(HitFact),
            /// `(hint, bits, hit object's kind or ones, its record index) -> ()`: may move the lane to another subgroup.
            ReorderThread,
            /// `() -> ()`: waits for all invocations of the workgroup.
            Barrier,
            /// `(row: i32) -> i1`: advances the ray query whose object starts at that row of private memory, and rewrites the object; false
            /// when the walk is over.
            RayQueryProceed,
        }

        impl Op {
            /// The operation's name in the text form.
            pub fn text(&self) -> &'static str {
                match self {
                    $(Op::$variant => $text,)*
                    Op::Const(_) => "const",
                    Op::Select => "select",
                    Op::FLdexp => "fldexp",
                    Op::BitfieldInsert => "bitfield_insert",
                    Op::BitfieldSExtract => "bitfield_sextract",
                    Op::BitfieldUExtract => "bitfield_uextract",
                    Op::Pack64 => "pack64",
                    Op::Unpack64 => "unpack64",
                    Op::VarLoad(..) => "var.load",
                    Op::VarStore(..) => "var.store",
                    Op::VarAddress(_) => "var.address",
                    Op::Load(_) => "load",
                    Op::Store(_) => "store",
                    Op::Atomic(..) => "atomic",
                    Op::BufferSize => "buffer_size",
                    Op::Descriptor(_) => "descriptor",
                    Op::DescriptorReference(_) => "descriptor_reference",
                    Op::DescriptorAt => "descriptor_at",
                    Op::PushConstants => "push_constants",
                    Op::DescriptorAddress => "descriptor_address",
                    Op::Input(_) => "input",
                    Op::Uniform(_) => "uniform",
                    Op::Image(_) => "image",
                    Op::Subgroup(_) => "subgroup",
                    Op::LaneIndex => "lane_index",
                    Op::DerivativeX => "derivative_x",
                    Op::DerivativeY => "derivative_y",
                    Op::Demote => "demote",
                    Op::IsHelper => "is_helper",
                    Op::ReadClock => "read_clock",
                    Op::MemoryBarrier => "memory_barrier",
                    Op::Call(_) => "call",
                    Op::TraceRay => "trace_ray",
                    Op::ReportIntersection => "report_intersection",
                    Op::ExecuteCallable => "execute_callable",
                    Op::TraceRayMotion => "trace_ray_motion",
                    Op::HitObjectTraceRay => "hit_object_trace_ray",
                    Op::HitObjectTraceRayMotion => "hit_object_trace_ray_motion",
                    Op::HitObjectExecute => "hit_object_execute",
                    Op::HitObjectGet(fact) => fact.text(),
                    Op::ReorderThread => "reorder_thread",
                    Op::Barrier => "barrier",
                    Op::RayQueryProceed => "ray_query_proceed",
                }
            }

            /// The shape of operands and results.
            pub fn signature(&self) -> Signature {
                match self {
                    $(Op::$variant => Signature::$signature,)*
                    _ => Signature::Other,
                }
            }

            /// The elementwise operation of that name.
            pub fn elementwise_from_text(text: &str) -> Option<Op> {
                match text {
                    $($text => Some(Op::$variant),)*
                    _ => None,
                }
            }
        }
    };
}
elementwise_ops!(define_op);

/// A memory access beyond its operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Access {
    pub space: Space,
    /// Must be performed as written, neither merged nor moved (`Volatile`, or atomic ordering with other invocations).
    pub volatile: bool,
    /// log₂ of what a device address must be a multiple of, where that is to be checked; 0 asks nothing.
    pub alignment: u8,
}

impl Access {
    /// That nobody else looks at, and that needs no alignment.
    pub fn plain(space: Space) -> Self {
        Self {
            space,
            volatile: false,
            alignment: 0,
        }
    }
}

/// Which descriptors an [`Op::Descriptor`] or [`Op::DescriptorReference`] indexes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct DescriptorBinding {
    /// Set number.
    pub set: u32,
    /// First descriptor of the binding in the set (or, if `dynamic`, in the bind point's array of dynamic descriptors).
    pub first: u32,
    /// Descriptors in the binding; `u32::MAX` = the count is the set's own (variable descriptor count).
    pub count: u32,
    /// A dynamic uniform or storage buffer.
    pub dynamic: bool,
}

/// Operations across the 16 lanes of a subgroup; only active lanes take part, and helper invocations as the [module's prose](super) says.
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
    /// `(T, lane: i32) -> T`: the value of another lane of the quad, helper or not; the lane's own where that one is not active.
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
    /// `(T, lanes: i32) -> T` over the active lanes whose bit is set: each lane has the bits of its own part.
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
        matches!(
            self,
            Op::TraceRay
                | Op::ReportIntersection
                | Op::ExecuteCallable
                | Op::TraceRayMotion
                | Op::HitObjectTraceRay
                | Op::HitObjectTraceRayMotion
                | Op::HitObjectExecute
                | Op::HitObjectGet(_)
                | Op::ReorderThread
                | Op::Barrier
                | Op::RayQueryProceed
        )
    }

    /// Has no effect but its results and gives the same ones for the same operands anywhere in the invocation: may be
    /// merged, moved to a dominating place, computed in inactive lanes, or removed.
    pub fn is_pure(&self) -> bool {
        self.signature() != Signature::Other
            || matches!(
                self,
                Op::Const(_)
                    | Op::Select
                    | Op::FLdexp
                    | Op::BitfieldInsert
                    | Op::BitfieldSExtract
                    | Op::BitfieldUExtract
                    | Op::Pack64
                    | Op::Unpack64
                    | Op::VarAddress(_)
                    | Op::Descriptor(_)
                    | Op::DescriptorReference(_)
                    | Op::DescriptorAt
                    | Op::PushConstants
                    | Op::Input(_)
                    | Op::Uniform(_)
            )
    }

    /// May be removed when no result is used: pure, or a read.
    pub fn is_removable(&self) -> bool {
        self.is_pure()
            || match self {
                Op::VarLoad(..)
                | Op::BufferSize
                | Op::DescriptorAddress
                | Op::LaneIndex
                | Op::DerivativeX
                | Op::DerivativeY
                | Op::IsHelper
                | Op::ReadClock
                | Op::Subgroup(_) => true,
                Op::Load(access) => !access.volatile,
                Op::Image(op) => op.is_read(),
                _ => false,
            }
    }

    /// How many operands are descriptors: the first ones. No other operation takes any.
    pub fn descriptor_operands(&self) -> usize {
        match self {
            Op::Load(access) | Op::Store(access) | Op::Atomic(_, access) => {
                (access.space == Space::Buffer) as usize
            }
            Op::BufferSize | Op::DescriptorAddress => 1,
            Op::Image(image) => 1 + image.has_sampler() as usize,
            _ => 0,
        }
    }

    /// Gives a descriptor. No other operation does.
    pub fn gives_descriptor(&self) -> bool {
        matches!(
            self,
            Op::Descriptor(_) | Op::DescriptorAt | Op::PushConstants
        )
    }
}
