//! How exactly functions are computed where Vulkan leaves it open (`TUFF_ACCURACY`).
//!
//! The choice is made once, when a module is lowered, and shows in the IR: nothing behind it has to
//! know.

use std::str::FromStr;

use crate::ir::Op;

/// A place on the way from speed to exactness.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Accuracy {
    /// Cheaper functions of `f32`, within the bounds at the head of `eval::fast`.
    Fast,
    /// A few units in the last place at most: inside what Vulkan asks for.
    #[default]
    Spec,
    /// Functions of `f32` are computed in `f64` and rounded once: correctly rounded except for
    /// about one result in 2^29.
    Exact,
}

impl Accuracy {
    /// All, by name.
    pub const ALL: [(&str, Accuracy); 3] = [
        ("fast", Accuracy::Fast),
        ("spec", Accuracy::Spec),
        ("exact", Accuracy::Exact),
    ];

    /// How it is spelled.
    pub fn name(self) -> &'static str {
        match self {
            Accuracy::Fast => "fast",
            Accuracy::Spec => "spec",
            Accuracy::Exact => "exact",
        }
    }
}

impl FromStr for Accuracy {
    type Err = String;

    fn from_str(text: &str) -> Result<Accuracy, String> {
        let found = Accuracy::ALL.iter().find(|(name, _)| *name == text);
        found
            .map(|&(_, accuracy)| accuracy)
            .ok_or_else(|| format!("\"{text}\" is not one of fast, spec and exact"))
    }
}

/// The cheaper operation that replaces the one of the same name, if there is one.
pub(crate) fn fast(op: &Op) -> Option<Op> {
    Some(match op {
        Op::FSin => Op::FSinFast,
        Op::FCos => Op::FCosFast,
        Op::FTan => Op::FTanFast,
        Op::FAtan => Op::FAtanFast,
        Op::FAtan2 => Op::FAtan2Fast,
        Op::FExp => Op::FExpFast,
        Op::FExp2 => Op::FExp2Fast,
        Op::FLog => Op::FLogFast,
        Op::FLog2 => Op::FLog2Fast,
        Op::FPow => Op::FPowFast,
        Op::FInverseSqrt => Op::FInverseSqrtFast,
        _ => return None,
    })
}

/// Whether an operation on `f32` rounds more than once, so that `f64` makes it more exact.
pub(crate) fn gains_from_f64(op: &Op) -> bool {
    matches!(
        op,
        Op::FSin
            | Op::FCos
            | Op::FTan
            | Op::FAsin
            | Op::FAcos
            | Op::FAtan
            | Op::FAtan2
            | Op::FSinh
            | Op::FCosh
            | Op::FTanh
            | Op::FAsinh
            | Op::FAcosh
            | Op::FAtanh
            | Op::FExp
            | Op::FExp2
            | Op::FLog
            | Op::FLog2
            | Op::FPow
            | Op::FInverseSqrt
    )
}
