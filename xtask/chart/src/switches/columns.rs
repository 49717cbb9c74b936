//! The workloads that switches are measured on.

use crate::workload::Scale;

/// A workload at a size.
pub struct Column {
    pub name: &'static str,
    pub workload: &'static str,
    /// Whose switches can make a difference.
    pub of: &'static [&'static str],
    pub turns: usize,
    /// Whether it is measured in a hurry.
    pub quick: bool,
    size: Size,
}

/// The difference from the usual scene.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Size {
    Usual,
    /// The ground and nothing else.
    OneInstance,
    /// A ground that no cache holds.
    Large,
    /// Leaves that no any-hit shader cuts out.
    NoAnyHit,
}

const WALKS: &[&str] = &["walks"];
const SCHEDULER: &[&str] = &["scheduler"];
const COMPILER: &[&str] = &["compiler"];
const BOTH: &[&str] = &["walks", "compiler"];

const fn column(workload: &'static str, of: &'static [&'static str]) -> Column {
    Column {
        name: workload,
        workload,
        of,
        turns: 3,
        quick: false,
        size: Size::Usual,
    }
}

const fn quick(column: Column) -> Column {
    Column {
        quick: true,
        ..column
    }
}

pub const COLUMNS: &[Column] = &[
    quick(column("primary", WALKS)),
    column("shadow", WALKS),
    quick(column("path", BOTH)),
    Column {
        name: "path, one instance",
        size: Size::OneInstance,
        ..column("path", WALKS)
    },
    Column {
        name: "path, 2 M triangles",
        size: Size::Large,
        ..column("path", WALKS)
    },
    Column {
        name: "foliage, no any-hit",
        size: Size::NoAnyHit,
        ..quick(column("foliage", SCHEDULER))
    },
    column("reflection", BOTH),
    column("foliage", BOTH),
    column("spheres", BOTH),
    column("materials", COMPILER),
    column("query", BOTH),
    quick(column("arithmetic", COMPILER)),
    quick(column("generated", COMPILER)),
    column("textures", COMPILER),
    Column {
        turns: 20,
        ..quick(column("pipeline cold", COMPILER))
    },
    Column {
        turns: 5,
        ..column("module cold", COMPILER)
    },
];

impl Column {
    pub fn scale(&self, quick: bool) -> Scale {
        let usual = Scale {
            width: if quick { 160 } else { 320 },
            height: if quick { 90 } else { 180 },
            triangles: 100_000,
            instances: 128,
            no_any_hit: false,
        };
        match self.size {
            Size::Usual => usual,
            Size::OneInstance => Scale {
                instances: 0,
                ..usual
            },
            Size::NoAnyHit => Scale {
                no_any_hit: true,
                ..usual
            },
            Size::Large => Scale {
                triangles: 2_000_000,
                ..usual
            },
        }
    }
}
