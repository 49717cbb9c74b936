//! # The intermediate representation
//!
//! A [`Module`](module::Module) is a list of functions, the first of which is the entry. A function
//! is a tree of structured control flow over scalar operations in SSA form, executed by all *lanes*
//! of a wave together.
//!
//! ## Values
//!
//! Every [`Value`] is a scalar (`i1`, `i8`, `i16`, `i32`, `i64`, `f16`, `f32`, `f64`) or a
//! `descriptor`. Integers have no signedness; operations do. Vectors, matrices and aggregates do
//! not exist: lowering takes them apart. A value has one definition, which dominates each use in
//! tree order: a definition in a body is visible to the nodes after it in that body and to the
//! bodies nested in them. **A value defined inside a construct (`block`, `loop`, `if`) is not
//! visible after the construct**; what must leave it goes through the arguments of `br`.
//!
//! ## Descriptors
//!
//! A `descriptor` is an entry of a bound set, the push constants, or the null descriptor. Only
//! `descriptor`, `descriptor_at` and `push_constants` produce one, and they check their operands.
//! Only buffer accesses, image operations, `buffer_size` and `descriptor_address` use one. A
//! descriptor is no scalar: it cannot be a constant, be computed, selected, converted, stored, sent
//! to another lane, be a parameter or a result, or leave a construct. So a module can only follow
//! real descriptors. A descriptor may be used after a yield. It is not saved, but looked up again
//! from its operands. A descriptor that must be an ordinary value (a pointer that is selected or
//! stored, an image argument) is a *reference*: an i64 that any arithmetic may produce, since
//! `descriptor_at` checks it (see [`environment::reference`](crate::environment::reference)).
//!
//! ## Control flow
//!
//! * `block L -> (r…) { … }` runs its body; `br L(v…)` leaves it, defining `r…` after it.
//! * `if c, L -> (r…) { … } else { … }` runs one body in the lanes where `c` holds and the other in
//!   the rest; both bodies leave by `br L(v…)` (or another terminator).
//! * `loop L(p… = v…) { … }` runs its body with the parameters `p…`; `br L(v…)` is the back-edge,
//!   which starts the next iteration. A loop is left only by a `br` to an enclosing label, or
//!   `return`/`end`.
//! * Each body ends in exactly one terminator: `br`, `return`, `end`, `unreachable`.
//!
//! ## Lanes and masks
//!
//! A lane that takes a `br` is *parked* at that label until every active lane of the wave has left
//! the construct; then all lanes parked there continue together. This is the merge point, and it is
//! explicit: reconvergence is maximal. `unreachable` parks lanes forever, like `end` with all
//! outputs zero. A loop's body runs again with the lanes that took the back-edge, until there are
//! none. `end(v…)` ends the invocation from any depth and any function; its operands are the
//! invocation's output words. Operations have effects only in active lanes; pure operations may be
//! computed in any lane.
//!
//! ## Quads and helper invocations
//!
//! Four consecutive lanes are a *quad*. In the fragment stage, and in compute shaders that request
//! it, these are two by two neighbors in the order (0, 0), (1, 0), (0, 1), (1, 1). `derivative_x`,
//! `derivative_y` and `subgroup.quad_shuffle` read the other lanes of the quad. An inactive lane
//! has no value and counts as equal to the reading lane. So these operations depend on their
//! position and are not pure.
//!
//! A lane of the fragment stage may be a *helper invocation*, from its start or after it executes
//! `demote`, which is permanent. A helper executes everything: it computes, loads, walks, suspends,
//! and has neighbors. But its stores (other than to `private` memory and variables), its atomics
//! and its image writes change nothing, and its atomics return 0 (except atomic loads). Subgroup
//! operations other than `quad_shuffle` ignore it, unless the module requires full quads or all
//! active lanes of the subgroup are helpers. Its outputs are unused. A killed lane executes
//! `demote`, then `unreachable`.
//!
//! ## Arithmetic
//!
//! Integers wrap. Shifts use the count modulo the width. Division by zero gives zero for
//! `udiv`/`sdiv` and the dividend for `urem`/`srem`/`smod`; `INT_MIN / -1` is `INT_MIN`, its
//! remainder 0. Floating point is IEEE 754 binary, round to nearest even, denormals kept, one
//! rounding per operation; `ffma` alone is fused. NaN payloads are unspecified. `fmin`/`fmax`
//! return the operand that is a number if one is NaN, and order −0 below +0. Float to integer
//! truncates, saturates, and NaN gives 0. Where a shader asks for flushed denormals, lowering puts
//! `fflush_denormal` behind the results that must be flushed (`lower/denormals.rs`); no other
//! operation flushes. The one definition of each is in [`crate::eval`].
//!
//! ## Memory
//!
//! [`Space`](op::Space) names the memory of an access and its address operands:
//!
//! | space | address operands | meaning |
//! |---|---|---|
//! | `private` | `row: i32` | per-lane memory, counted in 32-bit rows; 64-bit scalars take two rows (low first), narrower ones one row each |
//! | `shared` | `offset: i32` | workgroup memory, bytes; accesses outside it read zero and are dropped |
//! | `buffer` | `descriptor, offset: i32` | bytes (unsigned) from the descriptor's address, bounds-checked against its size per scalar: reads outside give zero, writes are dropped |
//! | `buffer64` | `descriptor, offset: i64` | as `buffer`, with offsets of 64 bits (unsigned) |
//! | `global` | `address: i64` | a device address, which is a host address: reads where the device has no memory give zero; each word of a load that is partly there may be zero |
//!
//! A load or store moves one or more consecutive scalars of one type, tightly packed (in `private`,
//! consecutive rows); `strided` ones in `shared` and `buffer` have a distance in bytes. Booleans
//! are not storable outside `private`. The row or offset of each scalar is computed modulo 2^32, in
//! `buffer64` modulo 2^64: an access of several scalars equals one access for each, at any address.
//!
//! A `constant` load is from a uniform block, which nothing writes during a dispatch: it may be
//! performed once for all invocations.
//!
//! *Variables* are named per-lane memory of a function ([`Variable`](module::Variable)).
//! `var.load`/`var.store` access a fixed row and are what promotion to SSA removes; `var.address`
//! gives the row for dynamic `private` accesses and pins the variable in memory. Variables of the
//! entry function marked `zero` start as zero; others start undefined (read as zero by promotion).
//!
//! ## Yields
//!
//! `trace_ray`, `report_intersection`, `execute_callable`, `hit_object_*`, `reorder_thread` and
//! `barrier`, `barrier_arrive` and `barrier_wait` suspend the wave: see
//! [`program::Event`](crate::state::Event). Their operands and
//! results are 32-bit words. After those that SPIR-V calls invocation repack instructions a lane
//! may be another one, of another subgroup.

pub mod binary;
mod build;
pub mod entities;
pub mod interface;
pub mod mesh;
pub mod modulate;
pub mod module;
pub mod op;
pub mod pass_through;
mod signature;
pub mod stage;
pub mod tessellation;
pub mod text;
pub mod transform_feedback;
pub mod verify;
mod visit;
pub mod workgroups;

pub use entities::{FunctionId, Label, Value, VariableId};
pub use module::{Body, Function, InputRow, Inst, Module, Node, Terminator, Variable};
pub use op::{Op, Space, Type};
pub use verify::{MAX_GEOMETRY_INVOCATIONS, MAX_INVOCATIONS, MAX_SHARED_BYTES, verify};
pub use visit::{Step, Steps};
