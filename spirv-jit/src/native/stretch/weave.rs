//! Stretches whose operations wait for each other.
//!
//! A processor overlaps the end of one half of a subgroup with the start of the next, as far as it
//! looks ahead. In a long chain of dependent operations this is not far enough. So the operations
//! of both halves alternate, and those of two subgroups if registers suffice. With AVX-512, which
//! has no halves, those of four or two subgroups do. The same goes for the turns of loops with
//! AVX2.

use super::{FRAMES, Stretch};
use crate::native::allocate::{Info, Step, TURNS_TOGETHER, Virtual, allocate};
use crate::native::encode::{Assembler, Base, CARRY, Encoding, Memory, NOT_CARRY, ZERO};
use crate::native::opcodes::*;

/// Steps that a processor looks ahead.
const STEPS_AHEAD: u32 = 128;

/// Steps that a processor starts in a cycle.
const STEPS_AT_ONCE: u32 = 3;

/// The same of steps of 512 bits.
const WIDE_STEPS_AT_ONCE: u32 = 2;

/// Steps of woven code, at most: more would not stay in the cache of instructions.
const MOST_STEPS: usize = 4096;

/// Steps, at least, for each value that leaves its register for its row.
const STEPS_OF_EVICTION: usize = 8;

/// Cycles until a step's result is available.
fn latency(step: &Step) -> u32 {
    match step.op {
        DIVPS | SQRTPS | DIVPD | SQRTPD => 12,
        ADDPS | SUBPS | MULPS | FMAPS | ADDPD | SUBPD | MULPD | FMAPD | ROUNDPS => 4,
        CVTDQ2PS | CVTTPS2DQ | CVTPH2PS | CVTPS2PH | PMULLD | PMULUDQ => 4,
        PERMQ | EXTRACT_128 | PMOVZXWD | PMOVZXDQ | PMOVSXDQ => 4,
        _ => 1,
    }
}

/// The number of chains of steps that keeps a processor busy, and the number it has anyway.
struct Need {
    /// Chains at once with which no unit waits.
    wanted: u32,
    /// Chains within the processor's reach if they stand one after another.
    overlapped: u32,
}

/// The need of steps that consist of so many equal chains, of which a processor starts so many at
/// once.
fn need(steps: &[Step], values: usize, chains: usize, at_once: u32) -> Need {
    let mut ready = vec![0u32; values];
    let mut longest = 0;
    for step in steps {
        let from = &step.from[..step.count];
        let start = from.iter().map(|&value| ready[value as usize]).max();
        let end = start.unwrap_or(0) + latency(step);
        ready[step.to as usize] = end;
        longest = longest.max(end);
    }
    let length = (steps.len() / chains).max(1) as u32;
    Need {
        wanted: (longest * at_once + length / 2) / length,
        overlapped: (STEPS_AHEAD / length).max(1),
    }
}

/// Whether a processor waits for results in a loop's turn that so many halves of subgroups take one
/// after another.
pub(super) fn waits(steps: &[Step], values: usize, halves: usize) -> bool {
    let need = need(steps, values, halves, STEPS_AT_ONCE);
    need.wanted > need.overlapped && halves as u32 > need.overlapped
}

/// The number of chains of steps that keeps a processor busy.
pub(super) fn chains(steps: &[Step], values: usize, halves: usize) -> u32 {
    need(steps, values, halves, STEPS_AT_ONCE).wanted
}

/// Steps of subgroups with the operations of all subgroups alternating; those of halves do. The
/// first one's code has operations for all of them, too.
pub(super) fn in_turn(of_subgroups: &[Vec<Step>]) -> Vec<Step> {
    let mut operations: Vec<_> = (of_subgroups.iter())
        .map(|steps| steps.split_inclusive(|step| step.ends))
        .collect();
    let count = of_subgroups.iter().map(Vec::len).sum();
    let mut woven = Vec::with_capacity(count);
    while woven.len() < count {
        for subgroup in 0..operations.len() {
            let mut next = operations[subgroup].next();
            while let Some(operation) = next {
                woven.extend_from_slice(operation);
                let is_for_all = operation[0].subgroup == TURNS_TOGETHER;
                next = is_for_all.then(|| operations[subgroup].next()).flatten();
            }
        }
    }
    woven
}

/// The halves of a subgroup.
fn halves(encoding: Encoding) -> &'static [Option<i32>] {
    match encoding {
        Encoding::Vex => &[Some(0), Some(1)],
        Encoding::Evex => &[None],
    }
}

/// The steps of so many subgroups, and of both halves of each where the encoding has halves,
/// alternating by operation.
fn weave(
    (steps, infos): (&[Step], &[Info]),
    subgroups: usize,
    encoding: Encoding,
) -> (Vec<Step>, Vec<Info>) {
    let is_shared = |info: &Info| {
        let is_constant = |home| matches!(home, Memory::Pool(_) | Memory::At(Base::Uniforms, _));
        info.is_home && info.home.is_some_and(is_constant)
    };
    let mut woven_infos = Vec::new();
    let shared: Vec<Option<Virtual>> = (infos.iter())
        .map(|info| {
            is_shared(info).then(|| {
                woven_infos.push(*info);
                woven_infos.len() as Virtual - 1
            })
        })
        .collect();
    let parts: Vec<(usize, Option<i32>)> = (0..subgroups)
        .flat_map(|subgroup| halves(encoding).iter().map(move |&half| (subgroup, half)))
        .collect();
    let mut numbers: Vec<Vec<Virtual>> = Vec::new();
    for &(subgroup, half) in &parts {
        let frame = FRAMES[subgroup];
        let half = half.unwrap_or(0);
        let own = |info: &Info| Info {
            home: info.home.map(|home| match (home, encoding) {
                (Memory::At(Base::Half, row), Encoding::Vex) => Memory::At(frame, row + 32 * half),
                (Memory::At(Base::WideHalf, row), Encoding::Vex) => {
                    Memory::At(frame, row + 64 * half)
                }
                (Memory::At(Base::Frame, row), Encoding::Evex) => Memory::At(frame, row),
                (other, _) => other,
            }),
            ..*info
        };
        let of_part = shared.iter().zip(infos).map(|(shared, info)| {
            shared.unwrap_or_else(|| {
                woven_infos.push(own(info));
                woven_infos.len() as Virtual - 1
            })
        });
        numbers.push(of_part.collect());
    }
    let mut woven = Vec::with_capacity(steps.len() * parts.len());
    for operation in steps.split_inclusive(|step| step.ends) {
        for (numbers, &(subgroup, half)) in numbers.iter().zip(&parts) {
            woven.extend(operation.iter().map(|step| Step {
                to: numbers[step.to as usize],
                from: step.from.map(|value| numbers[value as usize]),
                subgroup: subgroup as u8,
                half,
                ..*step
            }));
        }
    }
    (woven, woven_infos)
}

/// Points to the frames of the subgroups behind the first one, of so many that are taken together.
pub(super) fn emit_frames(a: &mut Assembler, subgroups: usize) {
    if subgroups > 1 {
        // lea r8, [rdi + rcx]
        a.bytes.extend([0x4c, 0x8d, 0x04, 0x0f]);
    }
    if subgroups > 2 {
        // lea r9, [rdi + 2 rcx]; lea rax, [r8 + 2 rcx]
        a.bytes.extend([0x4c, 0x8d, 0x0c, 0x4f]);
        a.bytes.extend([0x49, 0x8d, 0x04, 0x48]);
    }
}

impl Stretch {
    /// Writes woven code, if a processor waits without it and registers suffice. Gives whether
    /// code for one subgroup must follow, and the jump over that.
    pub(super) fn write_woven(&self, steps: &[Step], a: &mut Assembler) -> Option<Woven> {
        let (at_once, counts) = match self.encoding {
            Encoding::Vex => (STEPS_AT_ONCE, [2, 1]),
            Encoding::Evex => (WIDE_STEPS_AT_ONCE, [4, 2]),
        };
        let need = need(steps, self.infos.len(), 1, at_once);
        if need.wanted <= need.overlapped {
            return None;
        }
        let gains = |subgroups: &usize| {
            let chains = (halves(self.encoding).len() * *subgroups) as u32;
            chains > need.overlapped && (chains == 2 || need.wanted > 2)
        };
        counts.into_iter().filter(gains).find_map(|subgroups| {
            let mut attempt = a.clone();
            let woven = self.write_together(steps, subgroups, &mut attempt)?;
            *a = attempt;
            Some(woven)
        })
    }

    fn write_together(&self, steps: &[Step], subgroups: usize, a: &mut Assembler) -> Option<Woven> {
        let parts = subgroups * halves(self.encoding).len();
        if steps.len() * parts > MOST_STEPS {
            return None;
        }
        let (steps, infos) = weave((steps, &self.infos), subgroups, self.encoding);
        let count = subgroups as u8;
        let single = (subgroups > 1).then(|| {
            // cmp rdx, subgroups; jb
            a.bytes.extend([0x48, 0x83, 0xfa, count]);
            a.jump_ahead(CARRY)
        });
        let start = a.bytes.len();
        emit_frames(a, subgroups);
        let evictions = allocate(&steps, infos, a).ok()?;
        if evictions * STEPS_OF_EVICTION > steps.len() {
            return None;
        }
        if self.lanes.is_some() {
            // add r10, two bytes for each subgroup
            a.bytes.extend([0x49, 0x83, 0xc2, 2 * count]);
        }
        // lea rdi, [rdi + subgroups * rcx]; sub rdx, subgroups
        let scale = subgroups.trailing_zeros() as u8;
        a.bytes.extend([0x48, 0x8d, 0x3c, scale << 6 | 0x0f]);
        a.bytes.extend([0x48, 0x83, 0xea, count]);
        let Some(single) = single else {
            a.jump_if_not_zero(start);
            return Some(Woven::All);
        };
        // cmp rdx, subgroups
        a.bytes.extend([0x48, 0x83, 0xfa, count]);
        let again = a.jump_ahead(NOT_CARRY);
        a.land_at(again, start);
        // test rdx, rdx; jz
        a.bytes.extend([0x48, 0x85, 0xd2]);
        let done = a.jump_ahead(ZERO);
        a.land(single);
        Some(Woven::Several { done })
    }
}

/// Woven code that was written.
pub(super) enum Woven {
    /// For all subgroups.
    All,
    /// For several at once: code for one subgroup follows, over which a jump leads.
    Several { done: usize },
}
