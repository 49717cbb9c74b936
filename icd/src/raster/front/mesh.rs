//! Task and mesh shaders: from the workgroups of a draw to primitives, in order of task workgroup,
//! mesh workgroup and index.
//!
//! Task programs run for all workgroups of a job. Their counts tell how many workgroups of the mesh
//! program follow, so that those are cut into jobs of bounded memory, one after the other, whatever
//! the counts are.

#![forbid(unsafe_code)]

use std::ops::Range;
use std::sync::Arc;

use ash::vk::PrimitiveTopology as Topology;
use spirv_jit::environment::Environment;
use spirv_jit::program::{AlignedRow, MeshFacts, PatchWord, Width};
use spirv_jit::{Program, SUBGROUP_SIZE};

use super::fetch::Common;
use super::outputs::OutputPlaces;
use super::patches::get;
use super::topology::{self, Assembled};
use super::vertices::SUBGROUPS;
use crate::raster::CHUNK_PRIMITIVES;
use crate::wave::runner::{Runner, Subgroups, subgroups_at_once};
use crate::wave::workgroups::{DrawParameters, STEP_SHARED_BYTES, Starter, workgroup_id};
use crate::wave::{Limits, Stopped};

/// Workgroups of a job, at most.
const JOB_WORKGROUPS: usize = 64;

/// Jobs that a draw of workgroups becomes, at least, where it has workgroups for them: work for
/// several workers. A job has this many at least, too.
const FEW_JOBS: u64 = 16;
const FEW_WORKGROUPS: u64 = 4;

/// Vertices that a job may have, at most, unless a single workgroup has more.
const JOB_VERTICES: u32 = 8192;

/// Words of payloads that a job of task workgroups leaves, at most, unless a single one leaves
/// more.
const JOB_WORDS: usize = 1 << 16;

/// Workgroups of a job, at most, of so many that a draw or a job of tasks has.
pub fn share(all: u64) -> u32 {
    (all / FEW_JOBS).clamp(FEW_WORKGROUPS, JOB_WORKGROUPS as u64) as u32
}

/// Workgroups of a mesh program in a job, at most. Those that may wait for others have a job each:
/// in a longer one, the workgroup that is waited for could come after the waiting one, and never
/// start.
pub fn longest(program: &Program, facts: &MeshFacts) -> u32 {
    if program.workgroups_may_wait() {
        return 1;
    }
    let primitives = CHUNK_PRIMITIVES as u32 / facts.max_primitives.max(1);
    let vertices = JOB_VERTICES / facts.max_vertices.max(1);
    primitives.min(vertices).clamp(1, JOB_WORKGROUPS as u32)
}

/// Workgroups of a task program in a job, at most: as [`longest`].
pub fn longest_of_tasks(program: &Program) -> u32 {
    let Some(facts) = program.mesh().filter(|_| !program.workgroups_may_wait()) else {
        return 1;
    };
    let words = facts.payload_bytes as usize / 4;
    (JOB_WORDS / words.max(1)).clamp(1, JOB_WORKGROUPS) as u32
}

/// The topology of the primitives that a mesh program makes.
pub fn made_topology(facts: &MeshFacts) -> Topology {
    match facts.corners {
        1 => Topology::POINT_LIST,
        2 => Topology::LINE_LIST,
        _ => Topology::TRIANGLE_LIST,
    }
}

/// Workgroups of a program that run together.
fn at_once(program: &Program, subgroups: usize) -> usize {
    if program.workgroups_may_wait() {
        return 1;
    }
    let in_cache = STEP_SHARED_BYTES / (program.shared_size_bytes() as usize).max(1);
    let in_wave = subgroups_at_once(program).min(SUBGROUPS) / subgroups;
    in_wave.min(in_cache).max(1)
}

/// Consecutive workgroups of one grid.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// Workgroups of the grid per dimension.
    pub grid: [u32; 3],
    /// By linear index, x fastest.
    pub workgroups: Range<u64>,
    /// Index of the values that all of a call's and a view's have.
    pub common: u32,
    /// The task workgroup that they come from.
    pub task: Option<u32>,
}

/// The result of a task workgroup, without its payload.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Emitted {
    grid: [u32; 3],
    common: u32,
}

impl Emitted {
    /// Mesh workgroups that it asks for.
    fn workgroups(&self) -> u64 {
        let counts = self.grid.iter().map(|&count| u64::from(count));
        counts.fold(1, u64::saturating_mul)
    }
}

/// Task workgroups of one draw, with their payloads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tasks {
    /// Index of the draw in the batch's work.
    pub draw: u32,
    pub commons: Vec<Common>,
    emitted: Vec<Emitted>,
    payloads: Vec<u32>,
    /// Words of a payload.
    payload_words: usize,
}

impl Tasks {
    /// The payload of a task workgroup.
    fn payload(&self, task: u32) -> &[u32] {
        let start = task as usize * self.payload_words;
        self.payloads
            .get(start..start + self.payload_words)
            .unwrap_or(&[])
    }
}

/// Workgroups of a mesh program that become a chunk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Workgroups {
    pub tasks: Arc<Tasks>,
    pub parts: Vec<Part>,
}

/// How far the workgroups of tasks have been handed out.
pub struct TaskCursor {
    tasks: Arc<Tasks>,
    task: usize,
    /// The next workgroup of that task.
    workgroup: u64,
    /// Workgroups that a job takes, at most.
    most: u32,
}

impl TaskCursor {
    /// At the start of the first task.
    pub fn new(tasks: Tasks) -> Self {
        let all = tasks.emitted.iter().map(Emitted::workgroups);
        let all = all.fold(0, u64::saturating_add);
        Self {
            tasks: Arc::new(tasks),
            task: 0,
            workgroup: 0,
            most: share(all),
        }
    }

    /// Index of the draw in the batch's work.
    pub fn draw(&self) -> u32 {
        self.tasks.draw
    }

    /// The next workgroups, at most `most`, and their number; none at the end.
    pub fn next(&mut self, most: u32) -> Option<(Workgroups, u32)> {
        let mut parts = Vec::new();
        let most = most.min(self.most);
        let mut room = u64::from(most);
        while let Some(emitted) = self.tasks.emitted.get(self.task)
            && room > 0
        {
            let all = emitted.workgroups();
            let end = all.min(self.workgroup.saturating_add(room));
            if end > self.workgroup {
                room -= end - self.workgroup;
                parts.push(Part {
                    grid: emitted.grid,
                    workgroups: self.workgroup..end,
                    common: emitted.common,
                    task: Some(self.task as u32),
                });
            }
            self.workgroup = end;
            if end == all {
                self.task += 1;
                self.workgroup = 0;
            }
        }
        let tasks = Arc::clone(&self.tasks);
        let taken = u64::from(most) - room;
        (!parts.is_empty()).then_some((Workgroups { tasks, parts }, taken as u32))
    }
}

/// Appends the words of so many vertices or primitives, one behind the other.
fn append(
    memory: &[AlignedRow],
    words: &[PatchWord],
    count: u32,
    to: &mut Vec<u32>,
) -> Result<(), Stopped> {
    let (start, size) = (to.len(), words.len());
    let all = count as usize * size;
    to.try_reserve(all).map_err(|_| Stopped::OutOfMemory)?;
    to.resize(start + all, 0);
    for (column, from) in words.iter().enumerate() {
        let mut offset = from.offset_bytes;
        for word in to[start..].iter_mut().skip(column).step_by(size) {
            *word = get(memory, offset, from.width);
            offset += from.stride_bytes;
        }
    }
    Ok(())
}

/// Invocations of a program for the workgroups of parts.
pub fn invocations(program: &Program, parts: &[Part]) -> u64 {
    let workgroups = parts
        .iter()
        .map(|part| part.workgroups.end - part.workgroups.start);
    let size = program.local_size().map(u64::from);
    workgroups.sum::<u64>() * size.iter().product::<u64>()
}

/// Reads a word of the interface from a workgroup's memory.
fn word(memory: &[AlignedRow], offset: u32) -> u32 {
    get(memory, offset, Width::Word)
}

/// Runs a program for the workgroups of parts, some at a time. `fill` fills the memory of a
/// workgroup of a part, and `collect` takes its results from there.
fn run(
    program: &Program,
    (runner, environment, limits): (&mut Runner, &Environment, &Limits),
    (parts, commons): (&[Part], &[Common]),
    fill: &dyn Fn(&Part, &mut [AlignedRow]),
    collect: &mut dyn FnMut(&Part, &[AlignedRow]) -> Result<(), Stopped>,
) -> Result<(), Stopped> {
    let starter = Starter::new(program);
    let subgroups = starter.subgroups_per_workgroup;
    let at_once = at_once(program, subgroups);
    let mut all = parts
        .iter()
        .flat_map(|part| part.workgroups.clone().map(move |index| (part, index)));
    let mut chosen: Vec<(&Part, u64)> = Vec::new();
    loop {
        chosen.clear();
        chosen.extend(all.by_ref().take(at_once));
        if chosen.is_empty() {
            return Ok(());
        }
        let shape = Subgroups::of_workgroups(chosen.len(), subgroups);
        runner.begin(program, shape, limits)?;
        for (place, &(part, index)) in chosen.iter().enumerate() {
            let common = &commons[part.common as usize];
            let given = DrawParameters {
                num_workgroups: part.grid,
                draw_index: common.draw_index,
                view: common.view,
            };
            let id = workgroup_id(index, [0; 3], part.grid);
            for subgroup in 0..subgroups {
                let state = runner.state(place * subgroups + subgroup);
                starter.start(program, state, id, subgroup, &given);
            }
            fill(part, runner.shared(place));
        }
        runner.run(program, environment, limits)?;
        for (place, &(part, _)) in chosen.iter().enumerate() {
            collect(part, runner.shared(place))?;
        }
    }
}

/// Runs a task program for the workgroups of parts.
///
/// # Errors
/// When a limit stopped it.
pub fn run_tasks(
    program: &Program,
    facts: &MeshFacts,
    run_with: (&mut Runner, &Environment, &Limits),
    parts: &[Part],
    commons: Vec<Common>,
    draw: u32,
) -> Result<Tasks, Stopped> {
    let payload_words = facts.payload_bytes as usize / 4;
    let mut emitted = Vec::new();
    let mut payloads: Vec<u32> = Vec::new();
    let count = parts
        .iter()
        .map(|part| (part.workgroups.end - part.workgroups.start) as usize);
    (payloads.try_reserve(count.sum::<usize>() * payload_words))
        .map_err(|_| Stopped::OutOfMemory)?;
    let mut collect = |part: &Part, memory: &[AlignedRow]| {
        let count = |index: u32| word(memory, facts.counts_offset + 4 * index);
        emitted.push(Emitted {
            grid: [count(0), count(1), count(2)],
            common: part.common,
        });
        payloads.extend((0..payload_words).map(|index| word(memory, 4 * index as u32)));
        Ok(())
    };
    run(
        program,
        run_with,
        (parts, &commons),
        &|_, _| {},
        &mut collect,
    )?;
    Ok(Tasks {
        draw,
        commons,
        emitted,
        payloads,
        payload_words,
    })
}

/// Output of a mesh program: words of vertices and of primitives, one behind the other, and the
/// primitives, whose vertices are counted from the first one here.
pub struct MeshOutput<'a> {
    pub vertices: &'a mut Vec<u32>,
    pub primitives: &'a mut Vec<u32>,
    pub assembled: &'a mut Vec<Assembled>,
    /// Primitives that workgroups have, those that are discarded included.
    pub generated: u64,
}

/// A mesh program of a draw.
pub struct Mesh<'a> {
    pub program: &'a Program,
    pub facts: &'a MeshFacts,
    pub places: &'a OutputPlaces,
    /// The last vertex of a primitive is its provoking one.
    pub last: bool,
}

impl Mesh<'_> {
    /// Runs the workgroups of parts.
    ///
    /// # Errors
    /// When a limit stopped it.
    pub fn run(
        &self,
        run_with: (&mut Runner, &Environment, &Limits),
        parts: &[Part],
        commons: &[Common],
        tasks: Option<&Tasks>,
        made: &mut MeshOutput<'_>,
    ) -> Result<(), Stopped> {
        let room = self.facts.payload_bytes as usize / 4;
        let fill = |part: &Part, memory: &mut [AlignedRow]| {
            let payload = tasks.zip(part.task).map(|(it, task)| it.payload(task));
            let words = payload.unwrap_or(&[]).iter().take(room);
            for (at, &word) in words.enumerate() {
                memory[at / SUBGROUP_SIZE].0[at % SUBGROUP_SIZE] = word;
            }
        };
        let first_word = made.vertices.len();
        let mut collect =
            |part: &Part, memory: &[AlignedRow]| self.collect(part, memory, first_word, made);
        run(
            self.program,
            run_with,
            (parts, commons),
            &fill,
            &mut collect,
        )
    }

    /// Appends the vertices and the primitives of a workgroup. Counts and indices are held to their
    /// limits: a primitive with a vertex that is not there is left out.
    fn collect(
        &self,
        part: &Part,
        memory: &[AlignedRow],
        first_word: usize,
        made: &mut MeshOutput<'_>,
    ) -> Result<(), Stopped> {
        let facts = self.facts;
        let count = |index: u32| word(memory, facts.counts_offset + 4 * index);
        let vertices = count(0).min(facts.max_vertices);
        let primitives = count(1).min(facts.max_primitives);
        made.generated += u64::from(primitives);
        let out_of_memory = |_| Stopped::OutOfMemory;
        let stride = facts.vertices.len();
        (made.assembled.try_reserve(primitives as usize)).map_err(out_of_memory)?;
        let before = made.vertices.len() - first_word;
        let base = before.checked_div(stride).unwrap_or(0) as u32;
        append(memory, &facts.vertices, vertices, made.vertices)?;
        let start = made.primitives.len();
        append(memory, &facts.primitives, primitives, made.primitives)?;
        let size = facts.primitives.len();
        // The end of those that are kept.
        let mut end = start;
        let topology = made_topology(facts);
        let provoking = topology::provoking(topology, self.last);
        for primitive in 0..primitives as usize {
            let first = start + primitive * size;
            let words = &made.primitives[first..][..size];
            let at = |place: Option<u16>| place.map_or(0, |place| words[usize::from(place)]);
            // A line has its second vertex twice, a point one vertex three times.
            let last = facts.corners as usize - 1;
            let corners = [0, 1, 2].map(|corner: usize| at(self.places.indices[corner.min(last)]));
            let is_there = corners.iter().all(|&corner| corner < vertices);
            if at(self.places.culled) != 0 || !is_there {
                continue;
            }
            made.assembled.push(Assembled {
                vertices: corners.map(|corner| base + corner),
                primitive_id: at(self.places.primitive_id),
                common: part.common,
                provoking,
                stream: 0,
            });
            made.primitives.copy_within(first..first + size, end);
            end += size;
        }
        made.primitives.truncate(end);
        Ok(())
    }
}
