//! Drawing: the current state of a command buffer, and the batch of draws of a submission's pass.
//!
//! A pass belongs to the submission: secondary command buffers continue it. State and bound buffers
//! belong to the command buffer.

use std::sync::Arc;

use ash::vk;
use smallvec::SmallVec;
use spirv_jit::Program;
use spirv_jit::environment::Environment;
use spirv_jit::program::Stage;

use super::bindings::{Bindings, Snapshot};
use super::engine::Engine;
use super::pass::Active;
use super::query::ActiveQuery;
use super::recorded::RecordedPass;
use super::samples::Samples;
use super::transform_feedback::{self, FeedbackBuffers};
use super::{Failure, check_aborted, prints, show_strays, spans};
use crate::capture as recording;
use crate::command::GraphicsCommand;
use crate::command::graphics::{
    BindVertexBuffers, DrawByteCount, DrawCall, DrawIndirect, DrawMulti, IndexBinding, Numbers,
};
use crate::command::pass::{AttachmentClears, Pass};
use crate::object::graphics_pipeline::{GraphicsPipeline, Stages};
use crate::object::graphics_state::{
    ColorLocations, GraphicsState, MAX_VERTEX_INPUTS, UsedAttachments, own_locations,
};
use crate::object::setting::Setting;
use crate::object::{QueryPool, ShaderObject};
use crate::raster::{
    BATCH_DRAWS, Batch, Clear, ClearValue, Context, Counters, Draw, IndexBuffer, TransformFeedback,
    VertexBuffer, Work,
};
use crate::timeline::{self, Kind, Stack};
use crate::wave::reachable;

/// Calls of a batch, at most. This bounds their memory.
const BATCH_CALLS: usize = 1 << 16;

/// The state of a command buffer other than descriptors.
pub struct Current {
    state: Arc<GraphicsState>,
    /// The programs of the bound pipeline, or of bound shader objects.
    stages: Arc<Stages>,
    /// Shader objects were bound last, not a pipeline.
    has_shaders: bool,
    /// Color locations that commands have set since the pass began. Shader objects use them; a
    /// pipeline has its own, which equal these in valid usage.
    locations: ColorLocations,
    vertex_buffers: Arc<[VertexBuffer; MAX_VERTEX_INPUTS]>,
    /// Vertex buffers use the strides that they were bound with, not the pipeline's.
    has_dynamic_strides: bool,
    strides: [Option<u64>; MAX_VERTEX_INPUTS],
    indices: IndexBuffer,
    feedback_buffers: FeedbackBuffers,
}

impl Default for Current {
    fn default() -> Self {
        Self {
            state: Arc::default(),
            stages: Arc::default(),
            has_shaders: false,
            locations: own_locations(),
            vertex_buffers: Arc::new([VertexBuffer::default(); MAX_VERTEX_INPUTS]),
            has_dynamic_strides: false,
            strides: [None; MAX_VERTEX_INPUTS],
            indices: IndexBuffer {
                address: 0,
                size_bytes: 0,
                ty: vk::IndexType::UINT32,
                restart: None,
            },
            feedback_buffers: FeedbackBuffers::default(),
        }
    }
}

impl Current {
    /// `vkCmdBindPipeline`.
    pub fn bind_pipeline(&mut self, pipeline: &GraphicsPipeline) {
        use vk::DynamicState as State;
        self.stages.clone_from(&pipeline.stages);
        self.has_shaders = false;
        Arc::make_mut(&mut self.state).take_static(&pipeline.state, pipeline.dynamic);
        let states = [State::VERTEX_INPUT_BINDING_STRIDE, State::VERTEX_INPUT_EXT];
        let is_dynamic = states.iter().any(|&state| pipeline.dynamic.contains(state));
        if is_dynamic != self.has_dynamic_strides {
            self.has_dynamic_strides = is_dynamic;
            self.place_strides();
        }
    }

    /// `vkCmdBindShadersEXT`, one stage: all state is dynamic.
    fn bind_shader(&mut self, stage: Stage, shader: Option<&ShaderObject>) {
        let program = shader.map(|shader| Arc::clone(&shader.program));
        if !self.has_shaders {
            self.has_shaders = true;
            self.stages = Arc::default();
            let state = Arc::make_mut(&mut self.state);
            state.used_attachments = UsedAttachments::default();
            state.color_locations = self.locations;
        }
        Arc::make_mut(&mut self.stages).set(stage, program);
        if !self.has_dynamic_strides {
            self.has_dynamic_strides = true;
            self.place_strides();
        }
    }

    /// Takes the locations back to the attachments' own numbers
    /// (`vkCmdSetRenderingAttachmentLocations`).
    fn reset_locations(&mut self) {
        self.locations = own_locations();
        if self.has_shaders && self.state.color_locations != self.locations {
            Arc::make_mut(&mut self.state).color_locations = self.locations;
        }
    }

    fn set(&mut self, setting: &Setting) {
        Arc::make_mut(&mut self.state).set(setting);
        if let &Setting::ColorLocations(locations) = setting {
            self.locations = locations;
        }
        if let Setting::VertexInput(input) = setting {
            // The input's strides hold until buffers are bound with others.
            for binding in &input.bindings {
                if let Some(stride) = self.strides.get_mut(binding.binding as usize) {
                    *stride = None;
                }
            }
            self.place_strides();
        }
    }

    fn bind_vertex_buffers(&mut self, bind: &BindVertexBuffers) {
        let buffers = Arc::make_mut(&mut self.vertex_buffers);
        let first = bind.first as usize;
        let places = buffers.iter_mut().zip(&mut self.strides).skip(first);
        for ((place, stride), buffer) in places.zip(&bind.buffers) {
            if buffer.stride_bytes.is_some() {
                *stride = buffer.stride_bytes;
            }
            *place = VertexBuffer {
                address: buffer.address,
                size_bytes: buffer.size_bytes,
                stride_bytes: stride.filter(|_| self.has_dynamic_strides),
            };
        }
    }

    fn place_strides(&mut self) {
        let buffers = Arc::make_mut(&mut self.vertex_buffers);
        for (buffer, stride) in buffers.iter_mut().zip(&self.strides) {
            buffer.stride_bytes = stride.filter(|_| self.has_dynamic_strides);
        }
    }

    /// Shares the objects of the last draw that equal the current ones. Draws between which the
    /// same state was bound again then become one.
    fn share(&mut self, last: &Draw) {
        if !Arc::ptr_eq(&self.stages, &last.stages) && self.stages.is_same(&last.stages) {
            self.stages.clone_from(&last.stages);
        }
        if !Arc::ptr_eq(&self.state, &last.state) && self.state.is_same(&last.state) {
            self.state.clone_from(&last.state);
        }
        let (buffers, others) = (&mut self.vertex_buffers, &last.vertex_buffers);
        if !Arc::ptr_eq(buffers, others) && buffers == others {
            buffers.clone_from(others);
        }
    }

    fn bind_index_buffer(&mut self, binding: &IndexBinding) {
        self.indices = IndexBuffer {
            address: binding.address,
            size_bytes: binding.size_bytes,
            ty: binding.ty,
            restart: None,
        };
    }
}

/// The drawing state of a submission: its pass, pending work and queries.
#[derive(Default)]
pub struct Drawing<'a> {
    active: Option<Active<'a>>,
    batch: Batch,
    /// Calls in the batch.
    calls: usize,
    /// Counts the points after which programs must read memory again: barriers and flushes.
    epoch: u64,
    /// Programs of the batch print messages.
    prints: bool,
    /// Open spans of the timeline: command buffers, labels, passes.
    pub spans: Stack,
    pub queries: Vec<ActiveQuery<'a>>,
    /// A condition of conditional rendering does not hold: draws, dispatches and clears inside of
    /// passes are skipped.
    pub skips: bool,
    /// Transform feedback that has begun and not ended.
    feedback: Option<Arc<TransformFeedback>>,
    /// Samples of the suspended pass.
    kept_samples: Vec<Samples>,
    /// The pass, if it is captured.
    recorded: RecordedPass,
}

impl<'a> Drawing<'a> {
    /// Draws the batch.
    ///
    /// # Errors
    /// When a limit stopped it.
    pub fn flush(&mut self, engine: &Engine) -> Result<(), Failure> {
        self.calls = 0;
        if self.batch.work.is_empty() {
            return Ok(());
        }
        self.epoch += 1;
        let Some(active) = &self.active else {
            self.batch.work.clear();
            return Ok(());
        };
        let (limits, reach) = (engine.limits(), engine.memory.reach());
        if recording::takes_passes() {
            self.recorded.begin(&active.targets, &self.batch);
        }
        let context = Context {
            workers: &engine.workers,
            limits: &limits,
            reach: &reach,
            counts: self.recorded.counts(),
        };
        let prints = std::mem::take(&mut self.prints);
        let watched = match engine.wild.is_some() || engine.options.aborts.is_some() || prints {
            true => self.batch.watched(),
            false => Vec::new(),
        };
        let _span = timeline::span(Kind::Draws, || spans::draws(&self.batch));
        let drawn = engine
            .rasterizer
            .flush(context, &active.targets, &mut self.batch);
        if drawn.is_err() {
            self.recorded.finish(engine, true);
        }
        for (environment, stages) in &watched {
            if let Some((observer, strays)) =
                engine.wild_observer().zip(environment.strays.as_ref())
            {
                show_strays(observer, strays, stages.iter());
            }
            if let Some(prints) = &environment.prints {
                prints::print(engine, prints, stages.iter());
            }
        }
        check_aborted(engine, watched.iter().flat_map(|(_, stages)| stages.iter()))?;
        drawn.map_err(|why| limits.fault(why).into())
    }

    fn begin_pass(&mut self, engine: &Engine, pass: &'a Pass) -> Result<(), Failure> {
        self.flush(engine)?;
        self.feedback = None;
        self.spans.begin(Kind::Pass, || spans::pass(pass));
        let kept = std::mem::take(&mut self.kept_samples);
        let kept = if pass.resumes { kept } else { Vec::new() };
        let mut active = Active::new(pass, engine.options.clamps_to_one, kept)?;
        active.load_samples(&engine.workers);
        if !pass.resumes {
            active.load(&mut self.batch);
        }
        self.active = Some(active);
        Ok(())
    }

    fn end_pass(&mut self, engine: &Engine) -> Result<(), Failure> {
        self.flush(engine)?;
        self.recorded.finish(engine, false);
        match self.active.take() {
            Some(active) if active.pass.suspends => self.kept_samples = active.keep(),
            Some(active) => active.resolve(&engine.workers),
            None => {}
        }
        self.spans.end(Kind::Pass);
        Ok(())
    }

    /// `vkCmdClearAttachments`.
    fn clear(&mut self, clears: &AttachmentClears) {
        let Some(active) = &self.active else {
            return;
        };
        let rects: SmallVec<[vk::ClearRect; 1]> = clears
            .rects
            .iter()
            .flat_map(|rect| active.inside(rect))
            .collect();
        for clear in &clears.clears {
            let mut push = |value| {
                let rects = rects.clone();
                self.batch.work.push(Work::Clear(Clear { value, rects }));
            };
            // SAFETY: all members of the union are plain words, so each may be read; the aspect
            // says which one the application wrote.
            unsafe {
                if clear.aspects.contains(vk::ImageAspectFlags::COLOR) {
                    let index = clear.attachment as usize;
                    if active.pass.colors.get(index).is_some_and(Option::is_some) {
                        push(ClearValue::Color(index, clear.value.color));
                    }
                }
                let depth = active.pass.depth.is_some();
                if depth && clear.aspects.contains(vk::ImageAspectFlags::DEPTH) {
                    push(ClearValue::Depth(clear.value.depth_stencil.depth));
                }
                let stencil = active.pass.stencil.is_some();
                if stencil && clear.aspects.contains(vk::ImageAspectFlags::STENCIL) {
                    push(ClearValue::Stencil(clear.value.depth_stencil.stencil));
                }
            }
        }
    }

    fn begin_query(&mut self, pool: &'a QueryPool, query: u32, stream: u32) {
        self.queries.push(ActiveQuery::new(pool, query, stream));
    }

    /// Ends a query. In a pass with views it takes as many queries as there are views.
    fn end_query(
        &mut self,
        engine: &Engine,
        pool: &'a QueryPool,
        query: u32,
    ) -> Result<(), Failure> {
        self.flush(engine)?;
        let found = |it: &ActiveQuery<'_>| std::ptr::eq(it.pool, pool) && it.query == query;
        if let Some(place) = self.queries.iter().position(found) {
            let views = self
                .active
                .as_ref()
                .map_or(0, |it| it.pass.view_mask.count_ones());
            self.queries.remove(place).end(views);
        }
        Ok(())
    }

    /// Writes a timestamp; in a pass with views, one query for each view.
    pub fn write_timestamp(&self, pool: &QueryPool, query: u32, time_ns: u64) {
        let views = self
            .active
            .as_ref()
            .map_or(0, |it| it.pass.view_mask.count_ones());
        for view in 0..views.max(1) {
            pool.write(query.saturating_add(view), time_ns);
        }
    }

    fn counters(&self) -> SmallVec<[Arc<Counters>; 1]> {
        self.queries
            .iter()
            .map(|query| Arc::clone(&query.counters))
            .collect()
    }
}

/// The state of a command buffer and of its submission that commands read and change.
pub struct DrawContext<'p, 'a> {
    pub engine: &'p Engine,
    pub bindings: &'p mut Bindings<'a>,
    pub current: &'p mut Current,
    pub drawing: &'p mut Drawing<'a>,
}

impl<'a> DrawContext<'_, 'a> {
    /// Performs a command.
    ///
    /// # Errors
    /// When a limit stopped it.
    pub fn perform(&mut self, command: &'a GraphicsCommand) -> Result<(), Failure> {
        match command {
            GraphicsCommand::BeginPass(pass) => {
                self.current.reset_locations();
                return self.drawing.begin_pass(self.engine, pass);
            }
            GraphicsCommand::EndPass => return self.drawing.end_pass(self.engine),
            GraphicsCommand::VertexBarrier => return self.drawing.flush(self.engine),
            // Tiles draw in order. Only copies of memory that are kept under the environment's
            // number are out of date.
            GraphicsCommand::FragmentBarrier => self.drawing.epoch += 1,
            GraphicsCommand::Set(setting) => self.current.set(setting),
            GraphicsCommand::BindShader(stage, shader) => {
                let shader = shader.as_ref().map(|shader| &***shader);
                self.current.bind_shader(*stage, shader);
            }
            GraphicsCommand::BindVertexBuffers(bind) => self.current.bind_vertex_buffers(bind),
            GraphicsCommand::BindIndexBuffer(binding) => self.current.bind_index_buffer(binding),
            &GraphicsCommand::RestartIndex(index) => self.current.indices.restart = Some(index),
            GraphicsCommand::ClearAttachments(_)
            | GraphicsCommand::Draw { .. }
            | GraphicsCommand::DrawMulti(_)
            | GraphicsCommand::DrawIndirect(_)
            | GraphicsCommand::DrawByteCount(_)
                if self.drawing.skips => {}
            GraphicsCommand::ClearAttachments(clears) => self.drawing.clear(clears),
            &GraphicsCommand::Draw { indexed, call } => return self.call(indexed, call),
            GraphicsCommand::DrawMulti(draws) => return self.draw_multi(draws),
            GraphicsCommand::DrawIndirect(draws) => return self.draw_indirect(draws),
            GraphicsCommand::DrawByteCount(draw) => return self.draw_byte_count(draw),
            GraphicsCommand::BindFeedbackBuffers(binding) => {
                transform_feedback::bind(&mut self.current.feedback_buffers, binding);
            }
            GraphicsCommand::BeginFeedback(first, counters) => {
                self.begin_feedback(*first, counters)
            }
            GraphicsCommand::EndFeedback(first, counters) => {
                return self.end_feedback(*first, counters);
            }
            &GraphicsCommand::BeginConditional { address, inverted } => {
                return self.begin_conditional(address, inverted);
            }
            GraphicsCommand::EndConditional => self.drawing.skips = false,
            GraphicsCommand::BeginQuery {
                pool,
                query,
                stream,
            } => self.drawing.begin_query(pool, *query, *stream),
            GraphicsCommand::EndQuery { pool, query } => {
                return self.drawing.end_query(self.engine, pool, *query);
            }
        }
        Ok(())
    }

    fn begin_feedback(&mut self, first: u32, counters: &[u64]) {
        let reach = self.engine.memory.reach();
        let buffers = &self.current.feedback_buffers;
        let begun = transform_feedback::begin(&reach, buffers, first, counters);
        self.drawing.feedback = Some(Arc::new(begun));
    }

    fn end_feedback(&mut self, first: u32, counters: &[u64]) -> Result<(), Failure> {
        self.drawing.flush(self.engine)?;
        if let Some(ended) = self.drawing.feedback.take() {
            transform_feedback::end(&self.engine.memory.reach(), &ended, first, counters);
        }
        Ok(())
    }

    fn begin_conditional(&mut self, address: u64, inverted: bool) -> Result<(), Failure> {
        // Pending draws may write the condition.
        self.drawing.flush(self.engine)?;
        // SAFETY: commands of a queue run one after the other, and the draws are flushed: nothing
        // writes the word now.
        let word = unsafe { reachable::read::<u32>(&self.engine.memory.reach(), address) };
        self.drawing.skips = (word.unwrap_or(0) == 0) != inverted;
        Ok(())
    }

    fn draw_multi(&mut self, multi: &DrawMulti) -> Result<(), Failure> {
        for (draw_index, &(first, count, vertex_offset)) in (0..).zip(&multi.draws) {
            let call = DrawCall {
                first,
                count,
                vertex_offset,
                first_instance: multi.first_instance,
                instances: multi.instances,
                draw_index,
                groups: [0; 3],
            };
            self.call(multi.indexed, call)?;
        }
        Ok(())
    }

    /// Draws with parameters in memory, which are read now. An earlier command wrote them, or a
    /// draw that the barrier in between has flushed.
    fn draw_indirect(&mut self, draw: &DrawIndirect) -> Result<(), Failure> {
        let reach = self.engine.memory.reach();
        let count = match draw.count {
            // SAFETY: any word is a valid count. The queue runs one command at a time, and the
            // application keeps other writers away.
            Some(address) => unsafe { reachable::read::<u32>(&reach, address) }.unwrap_or(0),
            None => u32::MAX,
        };
        let mut limits = None;
        for draw_index in 0..draw.draws.min(count) {
            let offset = u64::from(draw_index) * u64::from(draw.stride_bytes);
            let address = draw.address.wrapping_add(offset);
            let call = match draw.numbers {
                Numbers::Vertices => {
                    // SAFETY: as for the count; all members are numbers.
                    unsafe { reachable::read::<vk::DrawIndirectCommand>(&reach, address) }.map(
                        |it| DrawCall {
                            first: it.first_vertex,
                            count: it.vertex_count,
                            vertex_offset: 0,
                            first_instance: it.first_instance,
                            instances: it.instance_count,
                            draw_index,
                            groups: [0; 3],
                        },
                    )
                }
                Numbers::Indices => {
                    // SAFETY: as for the count; all members are numbers.
                    unsafe { reachable::read::<vk::DrawIndexedIndirectCommand>(&reach, address) }
                        .map(|it| DrawCall {
                            first: it.first_index,
                            count: it.index_count,
                            vertex_offset: it.vertex_offset,
                            first_instance: it.first_instance,
                            instances: it.instance_count,
                            draw_index,
                            groups: [0; 3],
                        })
                }
                // SAFETY: as for the count; all members are numbers.
                Numbers::Workgroups => unsafe { reachable::read::<[u32; 3]>(&reach, address) }
                    .map(|groups| DrawCall::of_groups(groups, draw_index)),
            };
            let Some(call) = call else {
                return Ok(());
            };
            if draw_index % 1024 == 1023 {
                (limits.get_or_insert_with(|| self.engine.limits())).check()?;
            }
            self.call(draw.numbers == Numbers::Indices, call)?;
        }
        Ok(())
    }

    fn draw_byte_count(&mut self, draw: &DrawByteCount) -> Result<(), Failure> {
        let count = transform_feedback::captured_vertices(&self.engine.memory.reach(), draw);
        let call = DrawCall {
            first: 0,
            count,
            vertex_offset: 0,
            first_instance: draw.first_instance,
            instances: draw.instances,
            draw_index: 0,
            groups: [0; 3],
        };
        self.call(false, call)
    }

    /// Adds a call to the batch, unless it draws nothing, and flushes a full batch first.
    fn call(&mut self, indexed: bool, call: DrawCall) -> Result<(), Failure> {
        let (current, drawing) = (&mut *self.current, &mut *self.drawing);
        if let Some(Work::Draw(last)) = drawing.batch.work.last() {
            current.share(last);
        }
        let Some(active) = &mut drawing.active else {
            return Ok(());
        };
        let stages = &current.stages;
        // Commands that draw workgroups do so with mesh shaders, all others without.
        let is_of_groups = call.groups != [0; 3];
        let has_stages = match stages.mesh() {
            Some(_) => is_of_groups,
            None => stages.vertex().is_some() && !is_of_groups,
        };
        if !has_stages || call.count == 0 || call.instances == 0 {
            return Ok(());
        }
        let samples = current.state.multisample.samples;
        let fits = active.takes_samples(samples);
        let is_full = drawing.batch.work.len() >= BATCH_DRAWS || drawing.calls >= BATCH_CALLS;
        if is_full || !fits {
            drawing.flush(self.engine)?;
        }
        if let Some(active) = &mut drawing.active {
            active.set_samples(samples);
        }
        drawing.calls += 1;
        let indices = indexed.then_some(current.indices);
        self.add(indices, call);
        Ok(())
    }

    /// The environment of the current stages, and what keeps it alive.
    fn environment(&mut self) -> Snapshot {
        let (engine, drawing, stages) = (self.engine, &mut *self.drawing, &self.current.stages);
        let Snapshot {
            mut environment,
            keep,
        } = (self.bindings).snapshot(drawing.epoch, engine);
        // The messages of each draw are its own.
        if let Some(prints) = prints::of(stages.iter()) {
            drawing.prints = true;
            environment = Arc::new(Environment {
                prints: Some(prints),
                ..(*environment).clone()
            });
        }
        let reads = |it: &Program| it.fragment().is_some_and(|it| it.reads_attachments);
        if let Some(active) = &drawing.active
            && stages.fragment().is_some_and(reads)
            && let Some(samples) = active.seen_samples()
        {
            environment = Arc::new(Environment {
                number: Environment::next_number(),
                samples: Some(samples),
                ..(*environment).clone()
            });
        }
        Snapshot { environment, keep }
    }

    /// Adds a call to the last draw of the batch if everything else is the same, or a draw for it.
    fn add(&mut self, indices: Option<IndexBuffer>, call: DrawCall) {
        let Snapshot { environment, keep } = self.environment();
        let (current, drawing) = (&*self.current, &mut *self.drawing);
        let is_captured = |_: &&Arc<TransformFeedback>| {
            (current.stages.last()).is_some_and(|it| it.transform_feedback().is_some())
        };
        let feedback = drawing.feedback.as_ref().filter(is_captured).cloned();
        if let Some(Work::Draw(last)) = drawing.batch.work.last_mut()
            && Arc::ptr_eq(&last.stages, &current.stages)
            && Arc::ptr_eq(&last.state, &current.state)
            && Arc::ptr_eq(&last.environment, &environment)
            && Arc::ptr_eq(&last.vertex_buffers, &current.vertex_buffers)
            && last.indices == indices
            && last.feedback.as_ref().map(Arc::as_ptr) == feedback.as_ref().map(Arc::as_ptr)
            && last.counters.len() == drawing.queries.len()
            && (last.counters.iter().zip(&drawing.queries))
                .all(|(counted, query)| Arc::ptr_eq(counted, &query.counters))
        {
            last.calls.push(call);
            return;
        }
        let draw = Draw {
            stages: Arc::clone(&current.stages),
            state: Arc::clone(&current.state),
            environment,
            keep,
            vertex_buffers: Arc::clone(&current.vertex_buffers),
            indices,
            calls: SmallVec::from_slice(&[call]),
            counters: drawing.counters(),
            feedback: feedback,
        };
        drawing.batch.work.push(Work::Draw(draw));
    }
}
