//! Image operations: operand rows for [`execute_resident`], and the common samples, loads and
//! stores over a whole wave.

use std::marker::PhantomData;

use lanes::vector::{self, Vector};
use lanes::{LaneMask, Row, Tier as TierKind, quad};

use super::code::ImagePlan;
use super::machine::{Handler, Instr, Machine};
use super::operand::Operand;
use super::tier::{Kernel, Portable, Tier};
use crate::SUBGROUP_SIZE;
use crate::environment::Environment;
use crate::image::execute::execute_resident;
use crate::image::fast::{self, Fast};
use crate::image::format::block::each_lane;
use crate::image::operands::{MAX_RESULT_ROWS, Operands, usable};
use crate::image::plain::{self, Plain};
use crate::image::residency::Residency;
use crate::image::{ImageDescriptor, ImageOp, ImageOpKind, SamplerDescriptor};
use crate::ir::op::AtomicOp;

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
        TierKind::Avx2 => in_tier::<super::tier::Avx2, vector::Avx2>(op),
        #[cfg(target_arch = "x86_64")]
        TierKind::Avx512 => in_tier::<super::tier::Avx512, vector::Avx512>(op),
        _ => in_tier::<Portable, vector::Portable>(op),
    }
}

fn in_tier<T: Tier, V: Vector + 'static>(op: &ImageOp) -> Handler {
    if fast::may_apply(op) {
        T::handler::<Sample<V>>()
    } else if plain::may_apply(op) && op.kind == ImageOpKind::Write {
        T::handler::<Access<V, true>>()
    } else if plain::may_apply(op) {
        T::handler::<Access<V, false>>()
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
        // SAFETY: as the caller promises.
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
        // SAFETY: as the caller promises; such an operation's results are of 32 bits.
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
pub(crate) unsafe fn execute(
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
            let residency = (op.residency).then(|| Residency::new(&environment.reach));
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
    // SAFETY: as the caller promises; active lanes hold addresses of descriptors, and rows of
    // results are apart from those of operands.
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
            derived = derivatives(
                vector::Portable,
                &plan.op,
                &rows,
                m.active[subgroup as usize].bits(),
            );
            put_derivatives(&plan.op, &derived, &mut rows);
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

/// The derivatives of a sample's coordinates, of which it has one to three: in x, then in y.
#[inline(always)]
pub(super) fn derivatives<V: Vector>(v: V, op: &ImageOp, rows: &[&Row], active: u16) -> [Row; 6] {
    let spatial = op.spatial_count().min(3);
    let mut derived = [[0; SUBGROUP_SIZE]; 6];
    for axis in 0..spatial {
        let coordinate = v.load(rows[axis]);
        v.store(
            v.derivative::<{ quad::X }>(coordinate, active),
            &mut derived[axis],
        );
        let y = v.derivative::<{ quad::Y }>(coordinate, active);
        v.store(y, &mut derived[spatial + axis]);
    }
    derived
}

/// Puts those in the place of operands.
#[inline(always)]
pub(super) fn put_derivatives<'r>(op: &ImageOp, derived: &'r [Row; 6], rows: &mut [&'r Row]) {
    let places = &mut rows[op.rows_before_lod()..];
    for (place, row) in places.iter_mut().zip(derived).take(2 * op.spatial_count()) {
        *place = row;
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
struct Sample<V>(PhantomData<V>);

impl<V: Vector> Kernel for Sample<V> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = &m.code.images[i.x as usize];
        // SAFETY: the tier is the token's; for the rest, as for `image`.
        unsafe {
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
                listed = match &sample {
                    Some(sample) if V::IS_MACHINES && !sample.has_more => {
                        let mut same = match plan.image.is_uniform() && plan.sampler.is_uniform() {
                            true => listed.len(),
                            false => 1,
                        };
                        while let Some(&next) = listed.get(same)
                            && both(m, plan, next) == Some(descriptors)
                        {
                            same += 1;
                        }
                        let (numbers, others) = listed.split_at(same);
                        let wave = OfWave { m, plan, numbers };
                        sample.planes(V::new(), wave);
                        others
                    }
                    Some(sample) => {
                        whole_block(V::new(), sample, m, plan, subgroup);
                        rest
                    }
                    None => {
                        block(m, plan, subgroup);
                        rest
                    }
                };
            }
        }
    }
}

/// The subgroups of a wave that sample an image with a sampler.
struct OfWave<'a, 'p> {
    m: &'a Machine<'p>,
    plan: &'a ImagePlan,
    /// Their numbers in the wave.
    numbers: &'a [u16],
}

impl OfWave<'_, '_> {
    /// # Safety
    /// As for `block`; all operands of such a sample are of 32 bits.
    #[inline(always)]
    unsafe fn row(&self, subgroup: usize, operand: usize) -> &Row {
        // SAFETY: as the caller promises.
        unsafe {
            let subgroup = *self.numbers.get_unchecked(subgroup);
            &*self.m.block::<u32>(self.plan.operands[operand].0, subgroup)
        }
    }
}

impl<V: Vector> fast::Subgroups<V> for OfWave<'_, '_> {
    const IS_WAVE: bool = true;

    #[inline(always)]
    fn count(&self) -> usize {
        self.numbers.len()
    }

    #[inline(always)]
    fn derives(&self) -> bool {
        self.plan.derives
    }

    #[inline(always)]
    unsafe fn mask(&self, subgroup: usize) -> u16 {
        self.m.active[self.numbers[subgroup] as usize].bits()
    }

    #[inline(always)]
    unsafe fn coordinate(&self, subgroup: usize, index: usize) -> &Row {
        // SAFETY: as the caller promises: the first operands.
        unsafe { self.row(subgroup, index) }
    }

    #[inline(always)]
    unsafe fn reference(&self, subgroup: usize) -> &Row {
        // SAFETY: as the caller promises: the operand after the coordinates.
        unsafe { self.row(subgroup, self.plan.op.coordinate_count()) }
    }

    #[inline(always)]
    unsafe fn lod(&self, subgroup: usize, index: usize) -> &Row {
        // SAFETY: as the caller promises.
        unsafe { self.row(subgroup, self.plan.op.rows_before_lod() + index) }
    }

    #[inline(always)]
    unsafe fn offset(&self, subgroup: usize, index: usize) -> &Row {
        let first = self.plan.operands.len() - self.plan.op.spatial_count();
        // SAFETY: as the caller promises: the last operands, one an axis.
        unsafe { self.row(subgroup, first + index) }
    }

    #[inline(always)]
    unsafe fn put(&mut self, v: V, subgroup: usize, values: [V::F; 4]) {
        // SAFETY: as for `block`.
        unsafe {
            let subgroup = *self.numbers.get_unchecked(subgroup);
            put_all(v, self.m, self.plan, subgroup, values);
        }
    }
}

/// The image's and the sampler's descriptor that all lanes of a subgroup have.
///
/// # Safety
/// As [`block`].
#[inline(always)]
unsafe fn both(m: &Machine<'_>, plan: &ImagePlan, subgroup: u16) -> Option<(u64, u64)> {
    let mask = m.active[subgroup as usize];
    // SAFETY: as the caller promises.
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
    // SAFETY: as the caller promises; what descriptors point to outlives the dispatch.
    let (image, sampler): (Option<&'p ImageDescriptor>, Option<&'p SamplerDescriptor>) = unsafe {
        (
            environment.descriptor(image).viewed_image().as_ref(),
            environment.descriptor(sampler).sampler.as_ref(),
        )
    };
    let (image, info) = usable(image)?;
    Fast::new(op, image, info, sampler?, wanted)
}

/// # Safety
/// As [`block`].
#[inline(always)]
unsafe fn whole_block<V: Vector>(
    v: V,
    sample: &Fast<'_>,
    m: &Machine<'_>,
    plan: &ImagePlan,
    subgroup: u16,
) {
    let mask = m.active[subgroup as usize].bits();
    let mut rows = [&[0; SUBGROUP_SIZE]; fast::MAX_OPERANDS];
    // SAFETY: as for `block`; all operands of such a sample are of 32 bits.
    unsafe {
        for (row, &(operand, _)) in rows.iter_mut().zip(&plan.operands) {
            *row = &*m.block::<u32>(operand, subgroup);
        }
        let derived;
        if plan.derives && sample.takes_derivatives() {
            derived = derivatives(v, &plan.op, &rows, mask);
            put_derivatives(&plan.op, &derived, &mut rows);
        }
        let count = plan.operands.len().min(fast::MAX_OPERANDS);
        let operands = Operands::new(&plan.op, &rows[..count]);
        put_all(v, m, plan, subgroup, sample.whole(v, &operands, mask));
    }
}

/// Writes the results of a sample, of 32 bits each.
///
/// # Safety
/// As [`block`].
#[inline(always)]
unsafe fn put_all<V: Vector>(
    v: V,
    m: &Machine<'_>,
    plan: &ImagePlan,
    subgroup: u16,
    values: [V::F; 4],
) {
    // SAFETY: as the caller promises. One by one: a loop would keep them in memory.
    unsafe {
        put(v, m, plan, subgroup, 0, v.bits_of(values[0]));
        put(v, m, plan, subgroup, 1, v.bits_of(values[1]));
        put(v, m, plan, subgroup, 2, v.bits_of(values[2]));
        put(v, m, plan, subgroup, 3, v.bits_of(values[3]));
    }
}

/// Writes a result of 32 bits, if it is wanted.
///
/// # Safety
/// As [`block`].
#[inline(always)]
unsafe fn put<V: Vector>(
    v: V,
    m: &Machine<'_>,
    plan: &ImagePlan,
    subgroup: u16,
    row: usize,
    value: V::I,
) {
    if let (Some(&(result, _)), 1) = (plan.results.get(row), plan.wanted >> row & 1) {
        // SAFETY: as the caller promises.
        unsafe { v.store_i(value, &mut *m.block::<u32>(result, subgroup)) };
    }
}

/// A load or store that [`plain::may_apply`] to: subgroups whose lanes share an image take the
/// short way, if that serves for it. Stores are functions of their own: beside the code of loads
/// they are slower.
struct Access<V, const WRITES: bool>(PhantomData<V>);

impl<V: Vector, const WRITES: bool> Kernel for Access<V, WRITES> {
    #[inline(always)]
    unsafe fn run(m: &mut Machine<'_>, i: &Instr) {
        let plan = &m.code.images[i.x as usize];
        // SAFETY: the tier is the token's; for the rest, as for `image`; what descriptors point to
        // outlives the dispatch.
        unsafe {
            let mut listed = m.listed();
            while let Some((&subgroup, rest)) = listed.split_first() {
                let mask = lanes(m, plan, subgroup);
                if mask == 0 {
                    listed = rest;
                    continue;
                }
                let Some(address) = m.common(plan.image, subgroup, LaneMask::from_bits(mask))
                else {
                    block(m, plan, subgroup);
                    listed = rest;
                    continue;
                };
                let descriptor = m.environment.descriptor(address);
                let held = m.environment.held_image(&descriptor);
                let image = match &held {
                    Some(image) => Some(image),
                    None => descriptor.viewed_image().as_ref(),
                };
                let access =
                    usable(image).and_then(|(image, info)| Plain::new(&plan.op, image, info));
                // This subgroup, and those behind it that share the image.
                while let Some((&subgroup, rest)) = listed.split_first() {
                    let mask = lanes(m, plan, subgroup);
                    if mask != 0 {
                        if m.common(plan.image, subgroup, LaneMask::from_bits(mask))
                            != Some(address)
                        {
                            break;
                        }
                        // No closure: it would not be compiled for the tier.
                        let done = match &access {
                            Some(access) => {
                                let v = V::new();
                                access_block::<V, WRITES>(v, access, m, plan, subgroup, mask)
                            }
                            None => false,
                        };
                        if !done {
                            block(m, plan, subgroup);
                        }
                    }
                    listed = rest;
                }
            }
        }
    }
}

/// # Safety
/// As [`block`].
#[inline(always)]
unsafe fn access_block<V: Vector, const WRITES: bool>(
    v: V,
    access: &Plain<'_>,
    m: &Machine<'_>,
    plan: &ImagePlan,
    subgroup: u16,
    mask: u16,
) -> bool {
    let mut rows = [&[0; SUBGROUP_SIZE]; MAX_OPERAND_ROWS];
    // SAFETY: as for `block`. All operands are of 32 bits, since texels are.
    unsafe {
        for (row, &(operand, _)) in rows.iter_mut().zip(&plan.operands) {
            *row = &*m.block::<u32>(operand, subgroup);
        }
        let operands = Operands::new(&plan.op, &rows[..plan.operands.len()]);
        if WRITES {
            return access.write(v, &operands, mask);
        }
        let Some(texel) = access.read(v, &operands, mask) else {
            return false;
        };
        // One by one: a loop would keep the components in memory.
        put(v, m, plan, subgroup, 0, texel[0]);
        put(v, m, plan, subgroup, 1, texel[1]);
        put(v, m, plan, subgroup, 2, texel[2]);
        put(v, m, plan, subgroup, 3, texel[3]);
        true
    }
}
