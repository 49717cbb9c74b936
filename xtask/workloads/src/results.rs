//! The measurements of all drivers, as they are written and read.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::measure::Sample;
use crate::world::Scale;

/// One workload at one scale, on every driver.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Measurement {
    pub name: String,
    pub unit: String,
    /// The group of its speed: `traversal`, `shading`, `launching`, `building`, `programs`,
    /// `drawing`, `operations` or `driver`.
    pub bounds: String,
    pub scale: Scale,
    pub threads: Option<u32>,
    /// The samples of each driver, one a round; empty if it lacks a capability.
    pub samples: Vec<Vec<Sample>>,
    /// Why no time is given, where the drivers' pictures differ.
    pub disagreement: Option<String>,
}

/// All that one call measured.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Results {
    pub drivers: Vec<String>,
    pub machine: String,
    pub date: String,
    pub table: Vec<Measurement>,
    /// Curves: the measurements of each in order, by what varies.
    pub curves: BTreeMap<String, Vec<Measurement>>,
}
