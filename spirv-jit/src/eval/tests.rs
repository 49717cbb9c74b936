//! Expectations come from `std`'s f64 functions, Vulkan's precision table, wider arithmetic, and
//! the IR's prose.

mod arithmetic;
mod fast;
mod precision;
