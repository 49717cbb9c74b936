//! Entry points, by what they act on. Each decodes its C structures, calls one method and encodes the result.

pub mod instance;
