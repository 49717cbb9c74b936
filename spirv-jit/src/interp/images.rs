//! Image operations: operand rows for [`execute_resident`], and the common samples, loads and
//! stores over a whole wave.

use std::marker::PhantomData;

use super::code::ImagePlan;
use super::machine::{Handler, Instr, Machine};
use super::operand::Operand;
use super::tier::{Kernel, Portable, Tier};
use crate::SUBGROUP_SIZE;
use crate::environment::Environment;
use crate::ir::op::AtomicOp;
use images::execute::execute_resident;
use images::fast::{self, Fast};
use images::format::block::each_lane;
use images::operands::{MAX_RESULT_ROWS, usable};
use images::plain::{self, Plain};
use images::residency::Residency;
use images::wave::{self, Rows, Wave};
use images::{ImageDescriptor, ImageOp, ImageOpKind, SamplerDescriptor};
use lanes::{LaneMask, Row, Tier as TierKind};

/// Most operand rows: coordinates, derivatives, offsets and texels of the widest operation, with
/// room.
const MAX_OPERAND_ROWS: usize = 32;

/// Whether the rows of an operation fit what [`image`] sets aside.
pub(super) fn fits(operand_rows: usize, result_rows: usize) -> bool {
    operand_rows <= MAX_OPERAND_ROWS && result_rows <= MAX_RESULT_ROWS
}

/// The handler of an operation in a tier.
pub(super) fn handler(tier: TierKind, op: &ImageOp) -> Handler {
    match tier {
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx2 => in_tier::<super::tier::Avx2>(op),
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx512 => in_tier::<super::tier::Avx512>(op),
        _ => in_tier::<Portable>(op),
    }
}

fn in_tier<T: Tier>(op: &ImageOp) -> Handler {
    if fast::may_apply(op) {
        T::handler::<Sample<T>>()
    } else if plain::may_apply(op) && op.kind == ImageOpKind::Write {
        T::handler::<PlainAccess<T, true>>()
    } else if plain::may_apply(op) {
        T::handler::<PlainAccess<T, false>>()
    } else if op.is_size_query() {
        query
    } else {
        image
    }
}

/// The image operation by plan `x`.
///
/// # Safety
/// The instruction was emitted for the program that the machine runs.
pub(super) unsafe fn image(m: &mut Machine<'_>, i: &Instr) {
    let plan = &m.code.images[i.x as usize];
    for &subgroup in m.listed() {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { block(m, plan, subgroup) };
    }
}

/// The query of an image's size by plan `x`: once for subgroups all of whose lanes ask for the
/// same.
///
/// # Safety
/// As [`image`].
unsafe fn query(m: &mut Machine<'_>, i: &Instr) {
    let plan = &m.code.images[i.x as usize];
    let is_uniform = (plan.operands.iter()).all(|(operand, _)| operand.is_uniform());
    let mut known = None;
    for &subgroup in m.listed() {
        let mask = m.active[subgroup as usize];
        // SAFETY: the caller guarantees that the instruction was emitted for the program that the
        // machine runs; such an operation's results are of 32 bits.
        unsafe {
            let asked = (m.common(plan.image, subgroup, mask)).filter(|_| is_uniform);
            match known {
                Some((image, from, lane)) if asked == Some(image) => {
                    for &(result, _) in &plan.results {
                        let answer = (*m.block::<u32>(result, from))[lane];
                        *m.block::<u32>(result, subgroup) = [answer; SUBGROUP_SIZE];
                    }
                }
                _ => {
                    block(m, plan, subgroup);
                    known = asked.map(|image| (image, subgroup, mask.first()));
                }
            }
        }
    }
}

/// The lanes of a subgroup that perform an operation: helper invocations change no texels.
#[inline(always)]
fn lanes(m: &Machine<'_>, plan: &ImagePlan, subgroup: u16) -> u16 {
    let lanes = match plan.op.kind {
        ImageOpKind::Atomic(AtomicOp::Load) => m.active[subgroup as usize],
        ImageOpKind::Write | ImageOpKind::Atomic(_) => m.effective(subgroup),
        _ => m.active[subgroup as usize],
    };
    lanes.bits()
}

/// Performs `op` in the lanes of `mask`: as [`execute_resident`], with descriptors that lanes may
/// differ in. Those that are the same in all active lanes, the common case, are set up once; where
/// they differ, lanes are grouped by descriptor.
///
/// * `images`, `samplers`: per lane, the address of a descriptor in the `environment`, as
///   `Op::Descriptor` gives it; `samplers` is looked at only if [`ImageOp::has_sampler`]. Only
///   active lanes are looked at.
///
/// # Safety
/// Active lanes' descriptor addresses are those of live descriptors, whose images cover memory that
/// stays allocated during the call.
pub(super) unsafe fn execute(
    op: &ImageOp,
    environment: &Environment,
    images: &[u64; SUBGROUP_SIZE],
    samplers: &[u64; SUBGROUP_SIZE],
    mask: u16,
    operands: &[&Row],
    results: &mut [Row],
) {
    debug_assert_eq!(operands.len(), op.operand_rows());
    debug_assert!(results.len() >= op.result_rows());
    let has_sampler = op.has_sampler();
    let mut rest = mask;
    while rest != 0 {
        let first = rest.trailing_zeros() as usize;
        let mut group = 0u16;
        for lane in 0..SUBGROUP_SIZE {
            let same = images[lane] == images[first]
                && (!has_sampler || samplers[lane] == samplers[first]);
            group |= (same as u16) << lane;
        }
        group &= rest;
        rest &= !group;
        // SAFETY: the caller vouches for the descriptors of active lanes.
        unsafe {
            let descriptor = environment.descriptor(images[first]);
            let held = environment.held_image(&descriptor);
            let image = match &held {
                Some(image) => Some(image),
                None => descriptor.viewed_image().as_ref(),
            };
            let sampler = if has_sampler {
                environment.descriptor(samplers[first]).sampler.as_ref()
            } else {
                None
            };
            let is_bound = |address, size_bytes| environment.reach.is_bound(address, size_bytes);
            let residency = (op.residency).then(|| Residency::new(&is_bound));
            let residency = residency.as_ref();
            let put_codes = |results: &mut [Row]| {
                if let Some(residency) = residency {
                    results[op.result_rows() - 1] = residency.codes();
                }
            };
            if group == mask {
                execute_resident(op, image, sampler, group, operands, residency, results);
                return put_codes(results);
            }
            // A block writes whole rows: other groups' lanes must not be touched.
            let mut part = [[0; SUBGROUP_SIZE]; MAX_RESULT_ROWS];
            execute_resident(op, image, sampler, group, operands, residency, &mut part);
            put_codes(&mut part);
            for (row, part) in results.iter_mut().zip(&part[..op.result_rows()]) {
                each_lane(group, |lane| row[lane] = part[lane]);
            }
        }
    }
}

/// One subgroup's operation.
///
/// # Safety
/// As [`image`]; the subgroup is one of the wave's.
unsafe fn block(m: &Machine<'_>, plan: &ImagePlan, subgroup: u16) {
    let mask = lanes(m, plan, subgroup);
    let mut halves = [[0u32; SUBGROUP_SIZE]; MAX_RESULT_ROWS];
    let mut results = [[0u32; SUBGROUP_SIZE]; MAX_RESULT_ROWS];
    // SAFETY: the caller keeps the contract of `image`; the subgroup is one of the wave's; active
    // lanes hold addresses of descriptors, and rows of results are apart from those of operands.
    unsafe {
        let mut wide_rows = halves.chunks_exact_mut(2);
        let mut rows = [&[0; SUBGROUP_SIZE]; MAX_OPERAND_ROWS];
        let mut count = 0;
        for &(operand, wide) in &plan.operands {
            if wide {
                let [low, high] = wide_rows.next().expect("at most four wide operands") else {
                    unreachable!()
                };
                (*low, *high) = split(&*m.block::<u64>(operand, subgroup));
                (rows[count], rows[count + 1]) = (low, high);
                count += 2;
            } else {
                rows[count] = &*m.block::<u32>(operand, subgroup);
                count += 1;
            }
        }
        let images = &*m.block::<u64>(plan.image, subgroup);
        let derived;
        if plan.derives {
            derived = wave::derivatives_of(&plan.op, &rows, m.active[subgroup as usize]);
            wave::put_derivatives(&plan.op, &derived, &mut rows);
        }
        let samplers = match plan.sampler == Operand::NONE {
            true => &[0; SUBGROUP_SIZE],
            false => &*m.block::<u64>(plan.sampler, subgroup),
        };
        execute(
            &plan.op,
            m.environment,
            images,
            samplers,
            mask,
            &rows[..count],
            &mut results,
        );
        let mut row = 0;
        for &(result, wide) in &plan.results {
            if wide {
                *m.block::<u64>(result, subgroup) = join(&results[row], &results[row + 1]);
                row += 2;
            } else {
                *m.block::<u32>(result, subgroup) = results[row];
                row += 1;
            }
        }
    }
}

fn split(lanes: &[u64; SUBGROUP_SIZE]) -> (Row, Row) {
    (
        std::array::from_fn(|k| lanes[k] as u32),
        std::array::from_fn(|k| (lanes[k] >> 32) as u32),
    )
}

fn join(low: &Row, high: &Row) -> [u64; SUBGROUP_SIZE] {
    std::array::from_fn(|k| low[k] as u64 | (high[k] as u64) << 32)
}

/// A sample that [`fast::may_apply`] to: subgroups whose lanes share an image and a sampler take
/// the short way, if that serves for those.
struct Sample<T>(PhantomData<T>);

impl<T: Tier> Kernel for Sample<T> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = &m.code.images[i.x as usize];
        // SAFETY: as for `image`; what descriptors point to outlives the dispatch. All operands and
        // results of such a sample are of 32 bits.
        unsafe {
            let operands = operand_rows(m, plan);
            let wave = wave_of(m, plan, &m.active, &operands);
            let mut known = (0, 0);
            let mut sample = None;
            let mut listed = m.listed();
            while let Some((&subgroup, rest)) = listed.split_first() {
                let Some(descriptors) = both(m, plan, subgroup) else {
                    block(m, plan, subgroup);
                    listed = rest;
                    continue;
                };
                if descriptors != known {
                    known = descriptors;
                    sample = resolve(m.environment, &plan.op, plan.wanted, descriptors);
                }
                let Some(sample) = &sample else {
                    block(m, plan, subgroup);
                    listed = rest;
                    continue;
                };
                let mut same = match plan.image.is_uniform() && plan.sampler.is_uniform() {
                    true => listed.len(),
                    false => 1,
                };
                while let Some(&next) = listed.get(same)
                    && both(m, plan, next) == Some(descriptors)
                {
                    same += 1;
                }
                let (subgroups, others) = listed.split_at(same);
                wave::sample(T::KIND, sample, &Wave { subgroups, ..wave });
                listed = others;
            }
        }
    }
}

/// The rows of an operation's operands, all of 32 bits.
///
/// # Safety
/// As [`block`].
#[inline(always)]
unsafe fn operand_rows(m: &Machine<'_>, plan: &ImagePlan) -> [Rows; wave::MAX_OPERANDS] {
    let mut rows = [Rows::NONE; wave::MAX_OPERANDS];
    for (rows, &(operand, _)) in rows.iter_mut().zip(&plan.operands) {
        // SAFETY: the caller keeps the contract of this function.
        *rows = unsafe { rows_of(m, operand) };
    }
    rows
}

/// # Safety
/// As [`Machine::row`].
#[inline(always)]
unsafe fn rows_of(m: &Machine<'_>, operand: Operand) -> Rows {
    // SAFETY: the caller keeps the contract of this function.
    let (first, step_bytes) = unsafe { m.row(operand) };
    Rows {
        first: first.cast(),
        step_bytes,
    }
}

/// A wave without subgroups.
///
/// # Safety
/// As [`block`]; the results are of 32 bits.
#[inline(always)]
unsafe fn wave_of<'w>(
    m: &Machine<'_>,
    plan: &ImagePlan,
    lanes: &'w [LaneMask],
    operands: &'w [Rows],
) -> Wave<'w> {
    let mut results = [Rows::NONE; 4];
    for (index, rows) in results.iter_mut().enumerate() {
        if let (Some(&(result, _)), 1) = (plan.results.get(index), plan.wanted >> index & 1) {
            // SAFETY: the caller keeps the contract of this function.
            *rows = unsafe { rows_of(m, result) };
        }
    }
    Wave {
        subgroups: &[],
        lanes,
        operands: &operands[..plan.operands.len().min(operands.len())],
        results,
        derives: plan.derives,
    }
}

/// The image's and the sampler's descriptor that all lanes of a subgroup have.
///
/// # Safety
/// As [`block`].
#[inline(always)]
unsafe fn both(m: &Machine<'_>, plan: &ImagePlan, subgroup: u16) -> Option<(u64, u64)> {
    let mask = m.active[subgroup as usize];
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let image = m.common(plan.image, subgroup, mask);
        image.zip(m.common(plan.sampler, subgroup, mask))
    }
}

/// The combined description of two descriptors for a sample, if the fast path applies.
///
/// # Safety
/// As [`block`]: the addresses are an active lane's.
#[inline(always)]
pub(super) unsafe fn resolve<'p>(
    environment: &Environment,
    op: &'p ImageOp,
    wanted: u8,
    (image, sampler): (u64, u64),
) -> Option<Fast<'p>> {
    // SAFETY: the caller keeps the contract of `block`: the addresses are an active lane's; what
    // descriptors point to outlives the dispatch.
    let (image, sampler): (Option<&'p ImageDescriptor>, Option<&'p SamplerDescriptor>) = unsafe {
        (
            environment.descriptor(image).viewed_image().as_ref(),
            environment.descriptor(sampler).sampler.as_ref(),
        )
    };
    let (image, info) = usable(image)?;
    Fast::new(op, image, info, sampler?, wanted)
}

/// A load or store that [`plain::may_apply`] to: subgroups whose lanes share an image take the
/// short way, if that serves for it.
struct PlainAccess<T, const WRITES: bool>(PhantomData<T>);

impl<T: Tier, const WRITES: bool> Kernel for PlainAccess<T, WRITES> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = &m.code.images[i.x as usize];
        let effective;
        let masks = match WRITES {
            true => {
                effective = std::array::from_fn(|subgroup| m.effective(subgroup as u16));
                &effective
            }
            false => &m.active,
        };
        // SAFETY: as for `image`; what descriptors point to outlives the dispatch. All operands and
        // results are of 32 bits, since texels are.
        unsafe {
            let operands = operand_rows(m, plan);
            let wave = wave_of(m, plan, masks, &operands);
            let mut listed = m.listed();
            while let Some((&subgroup, rest)) = listed.split_first() {
                let mask = masks[subgroup as usize];
                if mask.is_empty() {
                    listed = rest;
                    continue;
                }
                let Some(address) = m.common(plan.image, subgroup, mask) else {
                    block(m, plan, subgroup);
                    listed = rest;
                    continue;
                };
                // This subgroup, and those behind it that share the image.
                let shares = |&next: &u16| {
                    let mask = masks[next as usize];
                    mask.is_empty() || m.common(plan.image, next, mask) == Some(address)
                };
                let same = match plan.image.is_uniform() {
                    true => listed.len(),
                    false => listed.iter().take_while(|next| shares(next)).count(),
                };
                let (subgroups, others) = listed.split_at(same);
                let descriptor = m.environment.descriptor(address);
                let held = m.environment.held_image(&descriptor);
                let image = match &held {
                    Some(image) => Some(image),
                    None => descriptor.viewed_image().as_ref(),
                };
                let plain =
                    usable(image).and_then(|(image, info)| Plain::new(&plan.op, image, info));
                access::<T, WRITES>(m, plan, plain.as_ref(), Wave { subgroups, ..wave });
                listed = others;
            }
        }
    }
}

/// Accesses of subgroups that share an image, one subgroup after the other.
///
/// # Safety
/// As [`block`]; the wave is the plan's.
#[inline(always)]
unsafe fn access<T: Tier, const WRITES: bool>(
    m: &Machine<'_>,
    plan: &ImagePlan,
    plain: Option<&Plain<'_>>,
    mut wave: Wave<'_>,
) {
    while !wave.subgroups.is_empty() {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            let done = match plain {
                Some(plain) if WRITES => wave::store(T::KIND, plain, &wave),
                Some(plain) => wave::load(T::KIND, plain, &wave),
                None => 0,
            };
            let Some((&subgroup, rest)) = wave.subgroups[done..].split_first() else {
                return;
            };
            if !wave.lanes[subgroup as usize].is_empty() {
                block(m, plan, subgroup);
            }
            wave.subgroups = rest;
        }
    }
}
