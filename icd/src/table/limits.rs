//! The table of limits.
