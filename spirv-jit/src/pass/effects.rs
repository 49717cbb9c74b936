//! Memory effects of operations and constructs.

use crate::ir::{Body, Op, Space, Step};

/// The memory that may have changed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Effects {
    /// Per-lane memory.
    pub writes_private: bool,
    /// Shared memory, or a point at which others' writes become visible.
    pub writes_outer: bool,
    /// Suspends the wave.
    pub yields: bool,
}

impl Effects {
    /// The effects of one operation.
    pub fn of(op: &Op) -> Effects {
        let outer = Effects {
            writes_outer: true,
            ..Effects::default()
        };
        match op {
            Op::VarStore(..) => Effects {
                writes_private: true,
                ..Effects::default()
            },
            Op::Store(access) if access.space == Space::Private => Effects {
                writes_private: true,
                ..Effects::default()
            },
            // A volatile or atomic load may wait for another invocation's writes.
            Op::Load(access) if access.volatile => outer,
            Op::Store(_) | Op::Atomic(..) | Op::MemoryBarrier => outer,
            Op::Image(image) if !image.is_read() || image.volatile => outer,
            Op::Call(_) => Effects {
                writes_private: true,
                writes_outer: true,
                yields: true,
            },
            // Its object is per-lane memory; nothing else is synchronized there.
            Op::RayQueryProceed => Effects {
                writes_private: true,
                yields: true,
                ..Effects::default()
            },
            op if op.is_yield() => Effects {
                writes_outer: true,
                yields: true,
                ..Effects::default()
            },
            _ => Effects::default(),
        }
    }

    fn add(&mut self, other: Effects) {
        self.writes_private |= other.writes_private;
        self.writes_outer |= other.writes_outer;
        self.yields |= other.yields;
    }
}

/// The effects of each construct, by label.
pub fn find_effects(body: &Body, labels: u32) -> Vec<Effects> {
    let mut effects = vec![Effects::default(); labels as usize];
    let mut inside = Effects::default();
    let mut outside = Vec::new();
    for step in body.steps() {
        match step {
            Step::Inst(inst) => inside.add(Effects::of(&inst.op)),
            Step::Open(_) => outside.push(std::mem::take(&mut inside)),
            Step::Close(node) => {
                if let Some(label) = node.label() {
                    effects[label.index()] = inside;
                }
                inside.add(outside.pop().unwrap_or_default());
            }
            Step::Else(_) | Step::End(_) => {}
        }
    }
    effects
}
