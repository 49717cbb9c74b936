//! The IR's text form: [`print_module`] and [`parse_module`] are inverse to each other.
//!
//! ```text
//! module ray_generation
//! inputs launch_id.0, payload.2        ; rows of the input record, by index of `input`
//! output_rows 0
//!
//! func f0 "main" {
//!   var0: 4 rows zero "color"          ; a variable, with its size, whether it starts as zero, and its name
//!   v0: i32 = input[0] @17             ; `@17`: word offset of the SPIR-V instruction
//!   v1: i32 = const 7
//!   v2: i1 = ult v0, v1
//!   if v2, L0 -> (v3: i32) {
//!     br L0(v0)
//!   } else {
//!     br L0(v1)
//!   }
//!   store.private.volatile v3, v1
//!   end
//! }
//! func f1 (v0: i32) -> (i32) { return(v0) }
//! ```
//!
//! Data that is not an operand stands in brackets after the operation's name; floats are constants
//! in hexadecimal bits. A `;` starts a comment. Values or labels that are in a function's tables
//! but in none of its instructions are listed at its head (`unused v7: f32`, `labels 3`).

mod names;
mod parse;
mod print;

pub use parse::{parse_module, parse_op};
pub use print::{print_head, print_module, print_op};

#[cfg(test)]
mod tests;
#[cfg(test)]
pub use tests::SAMPLE;
