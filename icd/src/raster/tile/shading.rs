//! Sixteen fragments at a time: tests before the program, its inputs, tests after it and colours.

use lanes::LaneMask;
use lanes::vector::Vector;
use spirv_jit::Program;
use spirv_jit::program::AlignedRow;

use super::coverage::{Block, SmallBlocks};
use super::depth::{Plain, Tested};
use super::filling::{InputRows, WaveFragments};
use super::inputs::Inputs;
use super::interpolation::{clamp, depths};
use super::lanes::{IN_BLOCK, LANE_X, LANE_Y, Row, lanes_of};
use super::output::Output;
use super::pack::Pack;
use super::pixels::count_lanes;
use super::places::{Pattern, Places};
use super::plan::{Order, Plan};
use super::samples::{Counts, MAX_SAMPLES, any, count, from_center, masks_of};
use super::shares::{Shares, record_of};
use super::write::WaveOutputs;
use crate::raster::Chunk;
use crate::raster::primitive::{Bounds, Record};
use crate::wave::launch_counts::{Counter, LaunchCounts};
use crate::wave::runner::Runner;

lanes::vectors! {
    /// Does the tests of blocks that come before the program.
    ///
    /// # Safety
    /// The pixels of the masks lie in the render area and with it in all attachments, as does the
    /// layer; the tile belongs to the caller.
    pub unsafe fn test_blocks<V>(
        v,
        plan: &Plan<'_>,
        record: &Record,
        corner: [i32; 2],
        area: &Bounds,
        blocks: &mut [Block],
    ) {
        let front = if record.front { u16::MAX } else { 0 };
        let range = plan.depth_range(record);
        let locations = &plan.locations;
        let is_early = plan.order == Order::Early && plan.samples == 1;
        let plain = plan.tests.plain().filter(|_| is_early);
        for block in blocks {
            let place = block.place(corner);
            let places = Places::block(place, record.layer.into(), area);
            if let (Some(plain), Pattern::Block) = (plain, places.pattern) {
                let depths = depths(v, record, place, &IN_BLOCK, locations[0], range);
                // SAFETY: the caller keeps the contract of this function; the block lies in the
                // render area.
                let passed = unsafe { plain.run(v, &places, depths, block.masks[0]) };
                block.masks = masks_of(passed.into());
                continue;
            }
            for (sample, mask) in block.masks.iter_mut().enumerate().take(plan.samples as usize) {
                if *mask == 0 {
                    continue;
                }
                let depths = depths(v, record, place, &IN_BLOCK, locations[sample], range);
                // SAFETY: the caller guarantees that the pixels of the masks lie in the render area
                // and with it in all attachments, as does the layer; the tile belongs to the
                // caller.
                *mask = unsafe {
                    if plan.order == Order::Early {
                        let tested = Tested {
                            places: &places,
                            front,
                            depths,
                            references: None,
                        };
                        plan.tests.run(v, &tested, sample as u32, *mask)
                    } else {
                        plan.tests.may_pass(v, &places, depths, sample as u32, *mask)
                    }
                };
            }
        }
    }
}

lanes::vectors! {
    /// Does the only test of the blocks of a small triangle, which lie in the render area.
    ///
    /// # Safety
    /// As [`test_blocks`].
    pub unsafe fn test_small<V>(
        v,
        plan: &Plan<'_>,
        plain: Plain<'_>,
        record: &Record,
        corner: [i32; 2],
        area: &Bounds,
        blocks: &mut SmallBlocks,
    ) {
        let range = plan.depth_range(record);
        for block in blocks.covered_mut() {
            let place = [corner[0] + i32::from(block.x), corner[1] + i32::from(block.y)];
            let places = Places::block(place, record.layer.into(), area);
            let depths = depths(v, record, place, &IN_BLOCK, plan.locations[0], range);
            // SAFETY: the caller keeps the contract of `test_blocks`.
            block.lanes = unsafe { plain.run(v, &places, depths, block.lanes) };
        }
    }
}

lanes::vectors! {
    /// Puts a wave's subgroups at the program's entry, with their inputs. `shares`: those of the
    /// packs.
    pub fn start<V>(
        v,
        program: &Program,
        inputs: &Inputs,
        output: &Output,
        fragments: WaveFragments<'_>,
        shares: &Shares,
        runner: &mut Runner,
        counts: &mut Counts,
    ) {
        for (pack, state) in fragments.packs.iter().zip(runner.states()) {
            let (active, covered) = (pack.active(), pack.covered());
            let helpers = LaneMask::from_bits(active & !covered);
            program.start_fragments(state, LaneMask::from_bits(active), helpers);
            counts.invocations += u64::from(covered.count_ones());
            if fragments.spread.is_empty() {
                output.fetch(&pack.places);
            }
        }
        let (states, rows) = runner.all_states_mut();
        let first = program.layout().inputs;
        let mut rows = InputRows { states, rows, first };
        inputs.fill(v, fragments, shares, &mut rows);
    }
}

lanes::vectors! {
    /// Late tests of a wave's fragments, and their colours. The masks become those of the samples
    /// that are written. `counted`: counts of each pixel, where
    /// a capture keeps them.
    ///
    /// # Safety
    /// As [`test_blocks`].
    pub unsafe fn finish<V>(
        v,
        chunks: &[Chunk],
        plan: &Plan<'_>,
        program: &Program,
        runner: &mut Runner,
        packs: &mut [Pack],
        counts: &mut Counts,
        counted: Option<&LaunchCounts>,
    ) {
        let io = program.layout().io;
        let output = &plan.output;
        for (pack, state) in packs.iter_mut().zip(runner.states()) {
            let live = !program.helpers(state).bits();
            for mask in &mut pack.masks {
                *mask &= live;
            }
        }
        if plan.order != Order::Early || output.drops_samples() || output.smooth_alpha.is_some() {
            for (pack, state) in packs.iter_mut().zip(runner.states()) {
                let mut masks = pack.masks;
                if let Some(row) = output.smooth_alpha {
                    fade(&fragments_of(chunks, pack), &mut state[io + row].0);
                }
                let rows = &state[io..];
                output.drop_samples(rows, &pack.places, &mut masks);
                if any(&masks) != 0 && plan.order != Order::Early {
                    // SAFETY: the caller keeps the contract of `test_blocks`.
                    unsafe {
                        let tested = any(&masks);
                        test_late(v, chunks, plan, rows, pack, &mut masks);
                        if let Some(counted) = counted {
                            let failed = tested & !any(&masks);
                            count_lanes(counted, Counter::FailedTests, &pack.places, failed);
                        }
                    }
                    counts.samples += count(&masks);
                }
                pack.masks = masks;
            }
        }
        let (states, rows) = runner.all_states();
        let outputs = WaveOutputs { states, rows, io };
        for color in &output.colors {
            // SAFETY: the caller keeps the contract of `test_blocks`.
            unsafe { color.write_wave(v, output, packs, outputs) };
        }
    }
}

/// # Safety
/// As [`test_blocks`].
#[inline(always)]
unsafe fn test_late<V: Vector>(
    v: V,
    chunks: &[Chunk],
    plan: &Plan<'_>,
    rows: &[AlignedRow],
    pack: &Pack,
    masks: &mut [u16; MAX_SAMPLES],
) {
    if plan.tests.is_empty() {
        return;
    }
    let fragments = fragments_of(chunks, pack);
    let front = (0..4).filter(|&quad| fragments.records[quad].front);
    let front = lanes_of(front.fold(0, |quads, quad| quads | 1 << quad));
    let written = plan.output.depth.map(|row| &rows[row].0);
    let references = plan.output.stencil.map(|row| &rows[row].0);
    for (sample, mask) in masks.iter_mut().enumerate().take(plan.samples as usize) {
        if *mask == 0 {
            continue;
        }
        let tested = Tested {
            places: &pack.places,
            front,
            depths: v.load(&depths_of_pack(plan, &fragments, sample, written)),
            references,
        };
        // SAFETY: the caller keeps the contract of `test_blocks`.
        *mask = unsafe { plan.tests.run(v, &tested, sample as u32, *mask) };
    }
}

/// Multiplies alpha by the part of each pixel that a smooth line covers (spec, "Smooth Lines"). The
/// pixel counts as a square of its size that is turned along the line.
fn fade(fragments: &Fragments<'_>, alpha: &mut Row) {
    for (lane, alpha) in alpha.iter_mut().enumerate() {
        let quad = lane / 4;
        let record = fragments.records[quad];
        let extra = fragments.chunks[quad].extra_of(record);
        if extra.half[0] == 0.0 {
            continue;
        }
        let [x, y] = [(fragments.x, LANE_X), (fragments.y, LANE_Y)]
            .map(|(first, step)| first[quad].wrapping_add(step[lane] & 1));
        let [x, y] =
            [(x, 0), (y, 1)].map(|(at, axis)| at.wrapping_sub(record.origin[axis].into()) as f32);
        let covered = |axis: usize| {
            let (plane, half) = (&extra.point_coord[axis], extra.half[axis]);
            let from = plane.at + plane.dx * x + plane.dy * y;
            let (least, most) = ((from - 0.5).max(-half), (from + 0.5).min(half));
            (most - least).max(0.0)
        };
        *alpha = (f32::from_bits(*alpha) * covered(0) * covered(1)).to_bits();
    }
}

/// Sixteen fragments: four quads of one or several primitives.
struct Fragments<'a> {
    records: [&'a Record; 4],
    /// Of each quad's record.
    chunks: [&'a Chunk; 4],
    /// First pixels of the quads.
    x: &'a [i32; 4],
    y: &'a [i32; 4],
}

/// The fragments of a subgroup.
#[inline(always)]
fn fragments_of<'a>(chunks: &'a [Chunk], pack: &'a Pack) -> Fragments<'a> {
    let (record, chunk) = record_of(chunks, pack.origins[0]);
    let mut fragments = Fragments {
        records: [record; 4],
        chunks: [chunk; 4],
        x: &pack.places.x,
        y: &pack.places.y,
    };
    if !pack.is_uniform {
        for (quad, &origin) in pack.origins.iter().enumerate().skip(1) {
            let (record, chunk) = record_of(chunks, origin);
            (fragments.records[quad], fragments.chunks[quad]) = (record, chunk);
        }
    }
    fragments
}

/// Depths of a subgroup's fragments at a sample: the program's output, or the planes' values.
#[inline(always)]
fn depths_of_pack(
    plan: &Plan<'_>,
    fragments: &Fragments<'_>,
    sample: usize,
    written: Option<&Row>,
) -> Row {
    let mut depths = [0; 16];
    let [inside_x, inside_y] = from_center(plan.locations[sample]);
    for lane in 0..16 {
        let quad = lane / 4;
        let record = fragments.records[quad];
        let from = |at: i32, origin: i16, step: i32| {
            at.wrapping_sub(origin.into()).wrapping_add(step & 1) as f32
        };
        let x = inside_x + from(fragments.x[quad], record.origin[0], LANE_X[lane]);
        let y = inside_y + from(fragments.y[quad], record.origin[1], LANE_Y[lane]);
        let plane = &record.depth;
        let value = match written {
            Some(written) => f32::from_bits(written[lane]),
            None => plane.at + plane.dx * x + plane.dy * y,
        };
        let range = plan.depth_range(record);
        depths[lane] = clamp(value, range).to_bits();
    }
    depths
}
