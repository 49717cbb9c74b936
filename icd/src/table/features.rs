//! The table of features.
