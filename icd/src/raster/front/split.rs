//! The work of a batch, cut into jobs: what becomes one chunk each.
//!
//! Jobs are cut in order by one thread, as many as a round takes; where they are cut follows from
//! the draws alone. With restart the indices are read here, once ahead of the chunks: only they
//! tell where segments end and which numbers primitives have.

use std::ops::Range;
use std::sync::atomic::Ordering;

use spirv_jit::Program;
use spirv_jit::reach::Reach;

use super::fetch::Common;
use super::geometry;
use super::indices::Indices;
use super::mesh::{self, Part, Workgroups};
use super::patches::{self, Pieces};
use super::topology::{self, is_line_strip};
use crate::command::graphics::DrawCall;
use crate::raster::{CHUNK_PRIMITIVES, Counters, Draw, Work};
use crate::wave::{Limits, Stopped};

/// The cost of a span besides its primitives, in primitives: state checks and partly filled waves.
const SPAN_COST: u32 = 4;

/// Primitives of Bresenham lines in a job: each has a list of its pixels.
const LISTED_PRIMITIVES: u32 = 128;

/// Primitives of one strip of stippled lines in a job. The pattern runs along a strip, so strips
/// are not cut up to this length; after it the pattern restarts.
const STIPPLED_PRIMITIVES: u32 = 1 << 16;

/// Indices that are looked at for restarts between two looks at the limits.
const SCAN: u64 = 1 << 20;

/// Consecutive primitives of a segment, in one instance of one call of a draw, for one view.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PrimitiveRange {
    /// Index of the draw in the batch's work.
    pub draw: u32,
    pub call: u32,
    /// From 0 on.
    pub instance: u32,
    pub view: u32,
    /// The segment's first vertex, counted from the call's.
    pub start: u32,
    /// Primitives of the segment, and how many it has.
    pub primitives: Range<u32>,
    pub of_segment: u32,
    /// `PrimitiveId` of the first of them.
    pub first_id: u32,
}

/// Input of a chunk.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Job {
    /// A clear: its index in the batch's work.
    pub clear: Option<u32>,
    pub spans: Vec<PrimitiveRange>,
    /// Primitives of all spans. Those of mesh draws are workgroups.
    pub primitives: u32,
    /// Some of them run a geometry or mesh shader, which may make many of each.
    pub amplifies: bool,
    /// Its primitives are patches, or workgroups of task shaders, of one draw. Their results are
    /// [`Self::pieces`] or [`Self::workgroups`] of other jobs.
    pub expands: bool,
    /// Primitives of patches in the place of spans.
    pub pieces: Option<Pieces>,
    /// Workgroups of mesh shaders that tasks ask for, in the place of spans.
    pub workgroups: Option<Workgroups>,
}

/// How far the cutting has come.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cursor {
    work: usize,
    call: usize,
    instance: u32,
    /// Index of the view among those that are drawn.
    view: u32,
    /// The current segment: its first vertex, and one past its last, if that is known.
    start: u64,
    end: Option<u64>,
    /// The next primitive of the segment, and its `PrimitiveId`.
    primitive: u32,
    id: u32,
}

/// The state that all divisions of a batch share.
pub struct Splitter<'a> {
    pub work: &'a [Work],
    pub view_mask: u32,
    pub reach: &'a Reach,
    pub limits: &'a Limits,
}

/// The number of the `index`th view of a mask; without views there is one, 0.
fn view_number(mask: u32, index: u32) -> u32 {
    let mut rest = mask;
    for _ in 0..index {
        rest &= rest.wrapping_sub(1);
    }
    if rest == 0 { 0 } else { rest.trailing_zeros() }
}

impl Splitter<'_> {
    /// The next job; `None` at the batch's end.
    ///
    /// # Errors
    /// When a limit was reached.
    pub fn next(&self, cursor: &mut Cursor) -> Result<Option<Job>, Stopped> {
        let mut job = Job::default();
        let mut cost = 0;
        loop {
            match self.work.get(cursor.work) {
                None => break,
                Some(Work::Clear(_)) => {
                    if job.spans.is_empty() {
                        job.clear = Some(cursor.work as u32);
                        cursor.work += 1;
                    }
                    break;
                }
                Some(Work::Draw(draw)) => {
                    if !self.add(draw, cursor, &mut job, &mut cost)? {
                        break;
                    }
                }
            }
        }
        Ok((job.clear.is_some() || !job.spans.is_empty()).then_some(job))
    }

    /// Adds what fits of a draw from the cursor on; false when the job is full.
    fn add(
        &self,
        draw: &Draw,
        cursor: &mut Cursor,
        job: &mut Job,
        cost: &mut u32,
    ) -> Result<bool, Stopped> {
        let state = &draw.state;
        let views = self.view_mask.count_ones().max(1);
        let longest = longest(draw);
        let indices = draw
            .indices
            .as_ref()
            .filter(|_| state.primitive_restart)
            .map(|buffer| Indices::new(buffer, self.reach));
        if !is_drawn(draw) {
            next_work(cursor);
            return Ok(true);
        }
        let expands = draw.stages.tessellation().is_some() || draw.stages.task().is_some();
        let is_other = job
            .spans
            .first()
            .is_some_and(|it| it.draw as usize != cursor.work);
        if is_other && (expands || job.expands) {
            return Ok(false);
        }
        let mut looks = 0;
        while let Some(call) = draw.calls.get(cursor.call) {
            looks += 1;
            if looks % 4096 == 0 {
                self.limits.check()?;
            }
            if cursor.carry(call, views) {
                continue;
            }
            let end = match cursor.end {
                Some(end) => end,
                None => self.end_of_segment(draw, call, indices.as_ref(), cursor)?,
            };
            let count = count(draw, (end - cursor.start) as u32);
            if cursor.primitive >= count {
                // Past the restart.
                cursor.start = end + 1;
                cursor.end = None;
                cursor.primitive = 0;
                continue;
            }
            let longest = match draw.stages.mesh() {
                Some(_) => longest.min(mesh::share(call.count.into())),
                None => longest,
            };
            let rest = count - cursor.primitive;
            let taken = match call.instances > 1 || views > 1 {
                true => fitting_of_instance(job, rest, count, longest, *cost),
                false => fitting(job, rest, longest, *cost),
            };
            if taken == 0 {
                return Ok(false);
            }
            job.spans.push(PrimitiveRange {
                draw: cursor.work as u32,
                call: cursor.call as u32,
                instance: cursor.instance,
                view: view_number(self.view_mask, cursor.view),
                start: cursor.start as u32,
                primitives: cursor.primitive..cursor.primitive + taken,
                of_segment: count,
                first_id: cursor.id,
            });
            job.amplifies |= draw.stages.amplifies();
            job.expands |= expands;
            cursor.primitive += taken;
            cursor.id = cursor.id.wrapping_add(taken);
            job.primitives += taken;
            *cost = cost.saturating_add(taken + SPAN_COST);
        }
        next_work(cursor);
        Ok(true)
    }

    /// Finds the end of the segment at the cursor, and counts its primitives.
    fn end_of_segment(
        &self,
        draw: &Draw,
        call: &DrawCall,
        indices: Option<&Indices>,
        cursor: &mut Cursor,
    ) -> Result<u64, Stopped> {
        let mut end = u64::from(call.count);
        if let Some(indices) = indices {
            let restart = indices.restart;
            let first = u64::from(call.first);
            let mut place = cursor.start;
            'scan: while place < end {
                for at in place..end.min(place + SCAN) {
                    if indices.at(first + at) == restart {
                        end = at;
                        break 'scan;
                    }
                }
                place += SCAN;
                self.limits.check()?;
            }
        }
        cursor.end = Some(end);
        let vertices = end - cursor.start;
        let primitives = count(draw, vertices as u32);
        if draw.stages.mesh().is_some() {
            return Ok(end);
        }
        for counters in &draw.counters {
            let Counters {
                input_vertices,
                input_primitives,
                ..
            } = &**counters;
            input_vertices.fetch_add(vertices, Ordering::Relaxed);
            input_primitives.fetch_add(primitives.into(), Ordering::Relaxed);
        }
        Ok(end)
    }
}

/// Primitives of a span that a job has room for, whose spans cost `cost` so far.
fn room(job: &Job, cost: u32) -> u32 {
    let cost = if job.spans.is_empty() {
        0
    } else {
        cost + SPAN_COST
    };
    (CHUNK_PRIMITIVES as u32).saturating_sub(cost)
}

/// How many of `rest` primitives fit in a job.
fn fitting(job: &Job, rest: u32, longest: u32, cost: u32) -> u32 {
    if longest <= CHUNK_PRIMITIVES as u32 {
        let room = room(job, cost);
        return rest.min(room).min(longest.saturating_sub(job.primitives));
    }
    // A strip that stays whole has a job of its own.
    match job.spans.is_empty() {
        true => rest.min(longest),
        false => 0,
    }
}

/// How many of the `rest` primitives of an instance, of `all`, fit in a job. All instances are cut
/// at the same places, into parts of one size, if that leaves no job half empty: then they are
/// assembled once.
fn fitting_of_instance(job: &Job, rest: u32, all: u32, longest: u32, cost: u32) -> u32 {
    let most = CHUNK_PRIMITIVES as u32;
    if longest != most {
        return fitting(job, rest, longest, cost);
    }
    let part = all.div_ceil(all.div_ceil(most));
    let before = (all - rest) % part;
    let wanted = rest.min(part - before);
    if before == 0 && wanted > room(job, cost) && cost >= most / 2 {
        return 0;
    }
    fitting(job, wanted, longest, cost)
}

/// Complete primitives of a segment of that many vertices.
fn count(draw: &Draw, vertices: u32) -> u32 {
    if draw.stages.mesh().is_some() {
        return vertices;
    }
    match patches::control_points(&draw.stages, &draw.state) {
        Some(points) => vertices / points,
        None => topology::count(draw.state.topology, vertices),
    }
}

/// Whether the draw's programs take the primitives of its topology.
fn is_drawn(draw: &Draw) -> bool {
    let topology = draw.state.topology;
    if draw.stages.mesh().is_some() {
        return true;
    }
    match draw.stages.tessellation() {
        Some(_) => {
            topology == ash::vk::PrimitiveTopology::PATCH_LIST
                && patches::control_points(&draw.stages, &draw.state).is_some()
        }
        None => topology::kind(topology).is_some() && !draw.stages.lacks_tessellation(),
    }
}

/// Primitives of a job with a draw, at most.
fn longest(draw: &Draw) -> u32 {
    match (draw.stages.tessellation(), draw.stages.task()) {
        (Some((control, _)), _) => patches::longest(control),
        (None, Some(task)) => mesh::longest_of_tasks(task),
        (None, None) => longest_chunk(draw),
    }
}

/// Primitives of a chunk with a draw, at most: without those that a geometry shader makes. Of a
/// mesh draw they are workgroups.
pub fn longest_chunk(draw: &Draw) -> u32 {
    let state = &draw.state;
    let rasterization = &state.rasterization;
    let bresenham = ash::vk::LineRasterizationModeEXT::BRESENHAM;
    let mesh = draw.stages.mesh();
    if let Some((program, facts)) = mesh.and_then(|it| Some((it, it.mesh()?))) {
        mesh::longest(program, facts)
    } else if let Some(facts) = draw.stages.geometry().and_then(Program::geometry) {
        geometry::longest(facts).min(CHUNK_PRIMITIVES as u32)
    } else if rasterization.line_stipple && is_line_strip(state.topology) {
        STIPPLED_PRIMITIVES
    } else if rasterization.line_mode == bresenham || rasterization.line_stipple {
        LISTED_PRIMITIVES
    } else {
        CHUNK_PRIMITIVES as u32
    }
}

impl Cursor {
    /// Goes to the next view, instance or call if it is past the end of the current one. Returns
    /// whether it did.
    fn carry(&mut self, call: &DrawCall, views: u32) -> bool {
        if call.count == 0 || self.instance >= call.instances {
            self.call += 1;
            self.instance = 0;
        } else if self.view >= views {
            self.instance += 1;
            self.view = 0;
        } else if self.start >= u64::from(call.count) {
            self.view += 1;
            (self.start, self.id) = (0, 0);
        } else {
            return false;
        }
        true
    }
}

fn next_work(cursor: &mut Cursor) {
    *cursor = Cursor {
        work: cursor.work + 1,
        ..Cursor::default()
    };
}

/// The workgroups of spans, and the values that those of a call and a view share.
pub fn parts_of_spans(spans: &[PrimitiveRange], calls: &[DrawCall]) -> (Vec<Part>, Vec<Common>) {
    let part = |(span, common): (&PrimitiveRange, u32)| Part {
        grid: calls[span.call as usize].groups,
        workgroups: span.primitives.start.into()..span.primitives.end.into(),
        common,
        task: None,
    };
    let common = |span: &PrimitiveRange| Common {
        draw_index: calls[span.call as usize].draw_index,
        view: span.view,
        ..Common::default()
    };
    let parts = spans.iter().zip(0..).map(part).collect();
    (parts, spans.iter().map(common).collect())
}
