//! Tuff: a Vulkan driver that traces rays on the CPU.

pub mod trace;
