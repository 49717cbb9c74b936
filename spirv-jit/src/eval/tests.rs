//! Expectations come from `std`'s f64 functions, Vulkan's precision table, and arithmetic done by hand.

mod precision;
