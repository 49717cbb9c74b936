//! One job, from its draws to a chunk.

use std::sync::atomic::Ordering;

use ash::vk::PrimitiveTopology as Topology;
use images::format::Numeric;
use spirv_jit::program::{Domain, TessellationModes};
use spirv_jit::reach::Reach;
use spirv_jit::{Program, SUBGROUP_SIZE};

use super::bins;
use super::facts::{DepthFormat, Facts};
use super::fetch::{Common, Fetch, Vertex};
use super::geometry::{Geometry, GeometryInput, emitted_topology};
use super::kept::KeptSpans;
use super::mesh::{self, Mesh, MeshOutput, Part, Tasks};
use super::outputs::{DrawOutputs, OutputPlaces};
use super::patches::{
    Control, ControlInput, DomainVertex, Evaluation, Patches, Pieces, Subdivided, control_points,
    list,
};
use super::project::Projection;
use super::screen::ScreenVertex;
use super::split::{Job, PrimitiveRange, parts_of_spans};
use super::streams;
use super::topology::Assembled;
use super::vertices::{Unique, shade};
use super::{Expanded, draw_of};
use crate::raster::primitive::Grid;
use crate::raster::{Chunk, Draw, Targets, Work};
use crate::wave::runner::Runner;
use crate::wave::{Limits, Stopped};

/// A worker's memory.
#[derive(Default)]
pub struct ChunkWorker {
    runner: Runner,
    pub(super) unique: Unique,
    pub(super) vertices: Vec<Vertex>,
    pub(super) commons: Vec<Common>,
    pub(super) primitives: Vec<Assembled>,
    pub(super) kept: KeptSpans,
    /// Of a draw with a geometry or control shader: the vertices of each input primitive, as many
    /// as it takes, the words of all vertices, and its input.
    pub(super) corners: Vec<u32>,
    words: Vec<u32>,
    inputs: Vec<Assembled>,
    /// Of a draw with patches.
    subdivided: Subdivided,
    domain_vertices: Vec<DomainVertex>,
    pub(super) on_screen: Vec<ScreenVertex>,
}

/// The source of a chunk's primitives.
enum ChunkSource<'a> {
    /// Consecutive spans of a draw.
    Spans(&'a [PrimitiveRange]),
    Pieces(&'a Pieces),
}

/// The topology of the primitives that a patch becomes.
fn domain_topology(modes: &TessellationModes) -> Topology {
    match modes.domain {
        _ if modes.point_mode => Topology::POINT_LIST,
        Some(Domain::Isolines) => Topology::LINE_LIST,
        _ => Topology::TRIANGLE_LIST,
    }
}

/// The topology of the primitives that the last stage before rasterization makes.
fn made_topology(draw: &Draw) -> Topology {
    let geometry = draw.stages.geometry().and_then(Program::geometry);
    match (geometry, draw.stages.tessellation()) {
        (Some(facts), _) => emitted_topology(facts),
        (None, Some((control, evaluation))) => {
            let facts = [control.tessellation(), evaluation.tessellation()];
            let modes = facts.map(|facts| facts.map(|it| it.modes).unwrap_or_default());
            domain_topology(&modes[0].or(modes[1]))
        }
        (None, None) => match draw.stages.mesh().and_then(Program::mesh) {
            Some(facts) => mesh::made_topology(facts),
            None => draw.state.topology,
        },
    }
}

/// One viewport for all vertices, unless they or their primitives choose.
fn project_all<'a>(facts: &'a Facts, places: &'a OutputPlaces) -> Option<Projection<'a>> {
    let first = facts.views.first();
    let view = first.filter(|_| !places.chooses_viewports())?;
    Some(Projection {
        screen: &view.screen,
        volume: &facts.volume,
        places,
    })
}

/// The state that all jobs of a round share.
#[derive(Clone, Copy)]
pub struct Round<'a> {
    /// Number of the batch, different from those of all others.
    pub batch: u64,
    pub work: &'a [Work],
    pub targets: &'a Targets,
    pub reach: &'a Reach,
    pub limits: &'a Limits,
    pub grid: Grid,
}

impl Round<'_> {
    fn facts(&self, draw: &Draw) -> Facts {
        let depth = match &self.targets.depth {
            None => DepthFormat::None,
            Some(target) if target.surface.format.numeric == Numeric::Sfloat => DepthFormat::Float,
            Some(target) => DepthFormat::Unorm(target.surface.format.channels[0].bits),
        };
        Facts::new(
            &draw.state,
            &self.targets.area,
            self.targets.samples,
            self.targets.layers,
            depth,
        )
    }
}

impl ChunkWorker {
    /// Ends its part of a round.
    pub fn rest(&mut self) {
        self.runner.rest();
    }

    /// Makes a chunk of a job.
    ///
    /// # Errors
    /// When a limit stopped it.
    pub fn run(&mut self, round: &Round<'_>, job: &Job, chunk: &mut Chunk) -> Result<(), Stopped> {
        chunk.clear();
        chunk.clear = job.clear;
        let draw_of = |index: u32| draw_of(round.work, index);
        if let Some(workgroups) = &job.workgroups {
            let index = workgroups.tasks.draw;
            if let Some(draw) = draw_of(index) {
                round.limits.check()?;
                let tasks = &*workgroups.tasks;
                let parts = (&workgroups.parts[..], &tasks.commons[..]);
                self.draw_meshes(round, draw, index, parts, Some(tasks), chunk)?;
            }
        }
        if let Some(pieces) = &job.pieces {
            let index = pieces.patches.draw;
            if let Some(draw) = draw_of(index) {
                round.limits.check()?;
                self.draw(round, draw, index, &ChunkSource::Pieces(pieces), chunk)?;
            }
        }
        for spans in job.spans.chunk_by(|a, b| a.draw == b.draw) {
            if let Some(draw) = draw_of(spans[0].draw) {
                round.limits.check()?;
                let index = spans[0].draw;
                if draw.stages.mesh().is_some() {
                    let (parts, commons) = parts_of_spans(spans, &draw.calls);
                    let parts = (&parts[..], &commons[..]);
                    self.draw_meshes(round, draw, index, parts, None, chunk)?;
                    continue;
                }
                self.draw(round, draw, index, &ChunkSource::Spans(spans), chunk)?;
            }
        }
        bins::fill(&round.grid, chunk)
    }

    /// Runs the control or task shader for the patches or workgroups of a job.
    ///
    /// # Errors
    /// When a limit stopped it.
    pub fn expand(&mut self, round: &Round<'_>, job: &Job) -> Result<Option<Expanded>, Stopped> {
        let first = job.spans.first();
        let Some(draw) = first.and_then(|it| draw_of(round.work, it.draw)) else {
            return Ok(None);
        };
        match draw.stages.task() {
            Some(task) => Ok(self.tasks(round, draw, task, job)?.map(Expanded::Tasks)),
            None => Ok(self.control(round, draw, job)?.map(Expanded::Patches)),
        }
    }

    /// Runs the task shader for the workgroups of a job.
    fn tasks(
        &mut self,
        round: &Round<'_>,
        draw: &Draw,
        program: &Program,
        job: &Job,
    ) -> Result<Option<Tasks>, Stopped> {
        let Some(facts) = program.mesh() else {
            return Ok(None);
        };
        round.limits.check()?;
        let (parts, commons) = parts_of_spans(&job.spans, &draw.calls);
        self.set_order_of(&parts);
        let index = job.spans[0].draw;
        let run_with = (&mut self.runner, &*draw.environment, round.limits);
        let tasks = mesh::run_tasks(program, facts, run_with, &parts, commons, index)?;
        for counters in &draw.counters {
            let invocations = mesh::invocations(program, &parts);
            (counters.task_invocations).fetch_add(invocations, Ordering::Relaxed);
        }
        Ok(Some(tasks))
    }

    /// Tells the messages of workgroups apart that have the same numbers.
    fn set_order_of(&mut self, parts: &[Part]) {
        let order = parts.first().map_or(0, |part| {
            u64::from(part.task.unwrap_or(0)) << 32 | part.workgroups.start
        });
        self.runner.set_order(order);
    }

    /// Adds the primitives of workgroups of mesh shaders; `tasks` are those that they come from.
    fn draw_meshes(
        &mut self,
        round: &Round<'_>,
        draw: &Draw,
        index: u32,
        (parts, commons): (&[Part], &[Common]),
        tasks: Option<&Tasks>,
        chunk: &mut Chunk,
    ) -> Result<(), Stopped> {
        let Some(program) = draw.stages.mesh() else {
            return Ok(());
        };
        let Some(mesh_facts) = program.mesh() else {
            return Ok(());
        };
        let facts = round.facts(draw);
        let places = OutputPlaces::new(program);
        self.primitives.clear();
        self.on_screen.clear();
        self.words.clear();
        self.commons.clear();
        self.commons.extend_from_slice(commons);
        self.set_order_of(parts);
        let first_word = chunk.outputs.len();
        let mut made = MeshOutput {
            vertices: &mut chunk.outputs,
            primitives: &mut self.words,
            assembled: &mut self.primitives,
            generated: 0,
        };
        let mesh = Mesh {
            program,
            facts: mesh_facts,
            places: &places,
            last: draw.state.rasterization.provoking_last,
        };
        let run_with = (&mut self.runner, &*draw.environment, round.limits);
        mesh.run(run_with, parts, commons, tasks, &mut made)?;
        for counters in &draw.counters {
            let invocations = mesh::invocations(program, parts);
            (counters.mesh_invocations).fetch_add(invocations, Ordering::Relaxed);
            (counters.mesh_primitives).fetch_add(made.generated, Ordering::Relaxed);
        }
        if let Some(projection) = project_all(&facts, &places) {
            projection.add_all(&chunk.outputs[first_word..], &mut self.on_screen)?;
        }
        let first_of_primitives = chunk.outputs.len() as u32;
        let count = self.words.len();
        (chunk.outputs.try_reserve(count)).map_err(|_| Stopped::OutOfMemory)?;
        chunk.outputs.extend_from_slice(&self.words);
        let first = [first_word as u32, places.words as u32];
        let topology = made_topology(draw);
        streams::divide(draw, index, topology, first, &mut self.primitives, chunk)?;
        // Without any output of vertices there is no position.
        if places.words == 0 {
            self.primitives.clear();
        }
        if facts.discard && draw.counters.is_empty() {
            return Ok(());
        }
        let outputs = DrawOutputs {
            first_word: first_word as u32,
            first_of_primitives,
            places,
            topology,
        };
        self.set_up(round, (draw, index), &facts, outputs, chunk)
    }

    /// Runs the control shader for the patches of a job.
    fn control(
        &mut self,
        round: &Round<'_>,
        draw: &Draw,
        job: &Job,
    ) -> Result<Option<Patches>, Stopped> {
        let points = control_points(&draw.stages, &draw.state);
        let (Some(vertex), Some(points)) = (draw.stages.vertex(), points) else {
            return Ok(None);
        };
        let Some(control) = Control::new(&draw.stages, vertex, &draw.state) else {
            return Ok(None);
        };
        round.limits.check()?;
        self.assemble(round, draw, &job.spans, Some(points as usize));
        self.words.clear();
        let mut words = std::mem::take(&mut self.words);
        let shaded = self.shade(round, draw, vertex, &job.spans, None, &mut words);
        self.words = words;
        shaded?;
        let input = ControlInput {
            words: &self.words,
            corners: &self.corners,
            points,
            patches: &self.primitives,
            commons: &self.commons,
        };
        let (environment, index) = (&draw.environment, job.spans[0].draw);
        let made = control.run(&mut self.runner, environment, round.limits, &input, index)?;
        for counters in &draw.counters {
            let patches = self.primitives.len() as u64;
            counters
                .control_patches
                .fetch_add(patches, Ordering::Relaxed);
        }
        Ok(Some(made))
    }

    /// Runs the vertex shader for the assembled vertices of spans.
    fn shade(
        &mut self,
        round: &Round<'_>,
        draw: &Draw,
        vertex: &Program,
        spans: &[PrimitiveRange],
        projection: Option<Projection<'_>>,
        words: &mut Vec<u32>,
    ) -> Result<(), Stopped> {
        let fetch = Fetch::new(draw, vertex, round.reach);
        // Chunks of a draw may share vertices.
        let first = &spans[0];
        let order = u64::from(first.start) << 32 | u64::from(first.primitives.start);
        self.runner.set_order(order);
        let (vertices, commons) = (&self.vertices, &self.commons);
        shade(
            &mut self.runner,
            vertex,
            &draw.environment,
            round.limits,
            vertices.len(),
            &|state, lanes| fetch.fill(state, &vertices[lanes], commons),
            projection,
            words,
            &mut self.on_screen,
        )?;
        for counters in &draw.counters {
            let invocations = self.vertices.len() as u64;
            counters
                .vertex_invocations
                .fetch_add(invocations, Ordering::Relaxed);
        }
        Ok(())
    }

    /// Lists the primitives of patches' pieces.
    fn list_pieces(&mut self, draw: &Draw, pieces: &Pieces) {
        let last = draw.state.rasterization.provoking_last;
        let (vertices, primitives) = (&mut self.domain_vertices, &mut self.primitives);
        list(&mut self.subdivided, pieces, last, vertices, primitives);
        self.commons.clone_from(&pieces.patches.commons);
        self.corners.clear();
        if let Some(facts) = draw.stages.geometry().and_then(Program::geometry) {
            for primitive in &self.primitives {
                // A domain that does not fit the shader lacks vertices.
                let corners = (0..facts.vertices as usize).map(|it| primitive.vertices[it.min(2)]);
                self.corners.extend(corners);
            }
        }
    }

    /// Runs the evaluation shader for the listed vertices of pieces.
    fn evaluate(
        &mut self,
        round: &Round<'_>,
        draw: &Draw,
        pieces: &Pieces,
        projection: Option<Projection<'_>>,
        words: &mut Vec<u32>,
    ) -> Result<(), Stopped> {
        let (Some((_, program)), Some(evaluation)) =
            (draw.stages.tessellation(), Evaluation::new(&draw.stages))
        else {
            return Ok(());
        };
        let vertices = &self.domain_vertices;
        shade(
            &mut self.runner,
            program,
            &draw.environment,
            round.limits,
            vertices.len(),
            &|state, lanes| evaluation.fill(state, &vertices[lanes], &pieces.patches),
            projection,
            words,
            &mut self.on_screen,
        )?;
        for counters in &draw.counters {
            let invocations = vertices.len() as u64;
            (counters.evaluation_invocations).fetch_add(invocations, Ordering::Relaxed);
        }
        Ok(())
    }

    /// Adds primitives of one draw.
    fn draw(
        &mut self,
        round: &Round<'_>,
        draw: &Draw,
        index: u32,
        source: &ChunkSource<'_>,
        chunk: &mut Chunk,
    ) -> Result<(), Stopped> {
        let (Some(vertex), Some(last)) = (draw.stages.vertex(), draw.stages.last()) else {
            return Ok(());
        };
        // The program whose primitives a geometry shader takes.
        let before = match (source, draw.stages.tessellation()) {
            (ChunkSource::Pieces(pieces), Some((_, evaluation))) => {
                self.list_pieces(draw, pieces);
                evaluation
            }
            (ChunkSource::Pieces(_), None) => return Ok(()),
            (ChunkSource::Spans(spans), _) => {
                self.assemble(round, draw, spans, None);
                vertex
            }
        };
        let facts = round.facts(draw);
        let places = OutputPlaces::new(last);
        let is_set_up = !facts.discard || !draw.counters.is_empty();
        let projection = project_all(&facts, &places).filter(|_| is_set_up);
        let geometry = (last.geometry()).map(|it| {
            let provokes_last = draw.state.rasterization.provoking_last;
            Geometry::new(last, it, before, &places, provokes_last)
        });
        self.on_screen.clear();
        self.words.clear();
        let count = match source {
            ChunkSource::Spans(_) => self.vertices.len(),
            ChunkSource::Pieces(_) => self.domain_vertices.len(),
        };
        (self.on_screen.try_reserve(count + SUBGROUP_SIZE)).map_err(|_| Stopped::OutOfMemory)?;
        let first_word = chunk.outputs.len() as u32;
        let mut own = std::mem::take(&mut self.words);
        let (words, projected) = match &geometry {
            None => (&mut chunk.outputs, projection),
            Some(_) => (&mut own, None),
        };
        let shaded = match source {
            ChunkSource::Spans(spans) => self.shade(round, draw, vertex, spans, projected, words),
            ChunkSource::Pieces(pieces) => self.evaluate(round, draw, pieces, projected, words),
        };
        self.words = own;
        shaded?;
        if let Some(geometry) = &geometry {
            self.emit(round, draw, geometry, projection, &mut chunk.outputs)?;
        }
        let topology = made_topology(draw);
        let first = [first_word, places.words as u32];
        streams::divide(draw, index, topology, first, &mut self.primitives, chunk)?;
        // Without any output of a geometry shader there is no position.
        if geometry.is_some() && places.words == 0 {
            self.primitives.clear();
        }
        if !is_set_up {
            return Ok(());
        }
        let outputs = DrawOutputs {
            first_word,
            first_of_primitives: first_word,
            places,
            topology,
        };
        self.set_up(round, (draw, index), &facts, outputs, chunk)
    }

    /// Replaces the primitives by those that a geometry shader makes of them.
    fn emit(
        &mut self,
        round: &Round<'_>,
        draw: &Draw,
        geometry: &Geometry<'_>,
        projection: Option<Projection<'_>>,
        outputs: &mut Vec<u32>,
    ) -> Result<(), Stopped> {
        std::mem::swap(&mut self.primitives, &mut self.inputs);
        self.primitives.clear();
        let first_word = outputs.len();
        let input = GeometryInput {
            words: &self.words,
            corners: &self.corners,
            primitives: &self.inputs,
            commons: &self.commons,
        };
        geometry.run(
            &mut self.runner,
            &draw.environment,
            round.limits,
            &input,
            outputs,
            &mut self.primitives,
        )?;
        if let Some(projection) = projection {
            projection.add_all(&outputs[first_word..], &mut self.on_screen)?;
        }
        for counters in &draw.counters {
            counters
                .geometry_invocations
                .fetch_add(geometry.invocations(self.inputs.len()), Ordering::Relaxed);
            counters
                .geometry_primitives
                .fetch_add(self.primitives.len() as u64, Ordering::Relaxed);
        }
        Ok(())
    }
}
