//! Lines: waves of ray generation shaders that are taken on directly from a trace.
//!
//! A line is a wave of subgroups that stand at one trace instruction. Rays that go together are
//! walked. The any-hit, hit and miss shaders of many lanes run in place, without subgroups of their
//! own, and so do the callables that many of those lanes call. The members whose rays are all
//! answered go on, before the next line begins. Everything else waits where it waits without lines:
//! rays that go apart or meet boxes, calls of few lanes, shaders that trace or run out of fuel, and
//! waves that would be much shorter than the line.
//!
//! A line works ahead within a round of its [`Batch`], and never beyond: walks and callees are the
//! round's own, and the events that members come to are noted until shaders of their kind run in
//! that round. Calls of many lanes and full members share a subgroup with no others. So the
//! partners in subgroups are those of a batch without lines (`TUFF_DIRECT=0`), round by round.

use std::mem::{replace, take};
use std::ptr::null_mut;

use lanes::{LaneMask, by_lane};
use spirv_jit::Program;
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::program::{AlignedRow, Event, IO_DATA_ROW, MAX_SUBGROUPS, SiteKind, Trace};
use traversal::HitRows;

use super::batch::Batch;
use super::fill_plan::{FillPlan, Subject, fill_by_plan};
use super::inputs::{self, fill};
use super::line::{InPlace, Line, Nested, Noted};
use super::rays::alike;
use super::regroup::MANY;
use super::subgroup::{LaneRef, Role, SubgroupIndex, Turn};
use crate::wave::Stopped;
use crate::wave::binding_table::ProgramIndex;
use crate::wave::rows::copy_lanes;

/// The numbers of all states of a wave.
const NUMBERS: [usize; MAX_SUBGROUPS] = {
    let mut numbers = [0; MAX_SUBGROUPS];
    let mut number = 0;
    while number < MAX_SUBGROUPS {
        numbers[number] = number;
        number += 1;
    }
    numbers
};

impl Batch<'_> {
    /// Whether a subgroup at a yield is to be answered in a line.
    pub(super) fn is_for_line(&self, index: SubgroupIndex, site: SiteKind) -> bool {
        let subgroup = &self.worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        self.lines.is_direct
            && line_trace(site).is_some()
            && subgroup.role == Role::RayGeneration
            && !program.event_mask(&subgroup.rows).is_empty()
    }

    /// Whether a shader that is called in a line runs there: it calls callables, if anything.
    pub(super) fn runs_in_line(&self, program: ProgramIndex, role: Role) -> bool {
        let sites = self.dispatch.shaders.programs[program as usize].sites();
        let calls = |site: &SiteKind| matches!(site, SiteKind::ExecuteCallable { .. });
        match role {
            Role::ClosestHit | Role::Miss => sites.iter().all(calls),
            Role::AnyHit => sites.is_empty(),
            _ => false,
        }
    }

    /// Whether a subgroup that is answered in a line goes on there: it is full. Others may be moved
    /// together with their like first.
    pub(super) fn goes_on_in_line(&self, index: SubgroupIndex) -> bool {
        let subgroup = &self.worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        self.lines.is_answered && program.event_mask(&subgroup.rows) == LaneMask::ALL
    }

    /// Runs new subgroups to their first events, and answers those at a trace as a line. Other
    /// events are noted in `others`.
    pub(super) fn start_line(
        &mut self,
        raygen: ProgramIndex,
        line: &mut Vec<SubgroupIndex>,
        others: &mut Vec<Noted>,
    ) -> Result<(), Stopped> {
        let compiled = &self.dispatch.shaders.programs[raygen as usize];
        let started = self.start_clock();
        let events = self.run_to_events(raygen, line)?;
        self.count_wave(started, line);
        let checked = self.look_at_limits(&events);
        checked.inspect_err(|_| self.note_stop(line[0]))?;
        let trace = match events.all() {
            Event::Yield(site) => line_trace(compiled.sites()[site.0 as usize]),
            _ => None,
        };
        if let Some((trace, payload_words)) = trace.filter(|_| self.are_for_line(compiled, line)) {
            self.answer_line(raygen, line, trace, payload_words)?;
            line.clear();
            return Ok(());
        }
        for (&index, event) in line.iter().zip(events.iter()) {
            match event {
                Event::End => self.end(index),
                Event::Yield(site)
                    if self.is_for_line(index, compiled.sites()[site.0 as usize]) =>
                {
                    self.lines.standing.push(index);
                }
                _ => others.push(Noted { index, event }),
            }
        }
        line.clear();
        self.answer_lines()
    }

    /// Whether lines are taken on, and each of these subgroups has lanes at its event.
    fn are_for_line(&self, program: &Program, line: &[SubgroupIndex]) -> bool {
        let has_lanes = |&index: &SubgroupIndex| {
            !program
                .event_mask(&self.worker.subgroups[index].rows)
                .is_empty()
        };
        self.lines.is_direct && line.iter().all(has_lanes)
    }

    /// Answers the subgroups that stand at traces, line by line.
    pub(super) fn answer_lines(&mut self) -> Result<(), Stopped> {
        let mut standing = take(&mut self.lines.standing);
        let Some(&first) = standing.first() else {
            return Ok(());
        };
        // There is one ray generation shader.
        let program = self.worker.subgroups[first].program;
        let compiled = &self.dispatch.shaders.programs[program as usize];
        let subgroups = &self.worker.subgroups;
        let point = |&index: &SubgroupIndex| compiled.resume_point(&subgroups[index].rows);
        if !standing.is_sorted_by_key(point) {
            standing.sort_by_key(point);
        }
        let width = self.wave_width(program);
        let mut rest = &standing[..];
        while let Some(&first) = rest.first() {
            let at =
                |index: &SubgroupIndex| compiled.resume_point(&self.worker.subgroups[*index].rows);
            let here = at(&first);
            let alike = rest
                .iter()
                .take(width)
                .take_while(|index| at(index) == here);
            let (line, others) = rest.split_at(alike.count());
            rest = others;
            if let Some((trace, payload_words)) = compiled.site_of(here).and_then(line_trace) {
                self.answer_line(program, line, trace, payload_words)?;
            }
        }
        standing.clear();
        self.lines.standing = standing;
        Ok(())
    }

    /// Answers a line, and takes the members that can go on to their next events.
    fn answer_line(
        &mut self,
        program: ProgramIndex,
        members: &[SubgroupIndex],
        trace: Trace,
        payload_words: u32,
    ) -> Result<(), Stopped> {
        let compiled = &self.dispatch.shaders.programs[program as usize];
        let mut groups = take(&mut self.worker.line.groups);
        let point = compiled.resume_point(&self.worker.subgroups[members[0]].rows);
        let uniform = compiled.uniform_operands(point);
        for &index in members {
            let subgroup = &mut self.worker.subgroups[index];
            let lanes = compiled.event_mask(&subgroup.rows);
            (subgroup.pending, subgroup.data_words) = (lanes, payload_words);
            groups.push(self.start_rays(index, lanes, trace, uniform));
        }
        self.lines.is_answered = true;
        self.walk_together(&mut groups)?;
        self.decide_in_place(members.len())?;
        self.run_calls_in_place(members.len())?;
        self.lines.is_answered = false;
        groups.clear();
        self.worker.line.groups = groups;
        let mut wave = [0; MAX_SUBGROUPS];
        let mut count = 0;
        for &index in members {
            let subgroup = &self.worker.subgroups[index];
            let is_full = compiled.event_mask(&subgroup.rows) == LaneMask::ALL;
            if subgroup.pending.is_empty() && is_full {
                wave[count] = index;
                count += 1;
            }
        }
        let wave = &wave[..count];
        if !is_worth_a_wave(count, members.len()) {
            for &index in wave {
                self.make_ready(index);
            }
            return Ok(());
        }
        let started = self.start_clock();
        let events = self.run_to_events(program, wave)?;
        self.count_wave(started, wave);
        for (&index, event) in wave.iter().zip(events.iter()) {
            match event {
                Event::End => self.end(index),
                _ => self.lines.noted.push(Noted { index, event }),
            }
        }
        let checked = self.look_at_limits(&events);
        checked.inspect_err(|_| self.note_stop(wave[0]))
    }

    /// Does what the events of hit and miss shaders that lines noted call for.
    pub(super) fn act_on_noted_callees(&mut self) -> Result<(), Stopped> {
        for Noted { index, event } in take(&mut self.lines.noted_callees) {
            self.act_on(index, event)?;
        }
        Ok(())
    }

    /// Finishes the step in which ray generation shaders start, before which lines have answered
    /// some in the round that follows: `others` are those that came to other events than a trace.
    pub(super) fn finish_start(&mut self, others: Vec<Noted>) -> Result<(), Stopped> {
        let noted = replace(&mut self.lines.noted, others);
        let answered = self.ready.take(Turn::Launches);
        self.run_launches()?;
        self.lines.noted = noted;
        self.ready.put_back(Turn::Launches, answered);
        Ok(())
    }

    /// Does what the events of ray generation shaders that lines noted call for.
    pub(super) fn act_on_noted(&mut self) -> Result<(), Stopped> {
        let mut noted = take(&mut self.lines.noted);
        for Noted { index, event } in noted.drain(..) {
            self.act_on(index, event)?;
        }
        self.lines.noted = noted;
        Ok(())
    }

    /// Decides on the candidates of a line's rays, until all have ended or wait for shaders that do
    /// not run in place.
    fn decide_in_place(&mut self, members: usize) -> Result<(), Stopped> {
        loop {
            let mut called = take(&mut self.worker.line.deciders);
            self.run_called(&mut called, members)?;
            self.worker.line.deciders = called;
            if self.walks.going_on.is_empty() {
                return Ok(());
            }
            self.resume_decided()?;
        }
    }

    /// Runs the hit and miss shaders that lanes of a line have called.
    fn run_calls_in_place(&mut self, members: usize) -> Result<(), Stopped> {
        let mut called = take(&mut self.worker.line.programs);
        self.run_called(&mut called, members)?;
        self.worker.line.programs = called;
        Ok(())
    }

    /// Runs the calls of some programs, whose list is then empty.
    fn run_called(
        &mut self,
        called: &mut Vec<ProgramIndex>,
        members: usize,
    ) -> Result<(), Stopped> {
        if called.is_empty() {
            return Ok(());
        }
        let mut line = take(&mut self.worker.line);
        for program in called.drain(..) {
            let mut calls = take(&mut line.calls[program as usize]);
            if is_worth_a_wave(calls.len(), members) {
                for calls in calls.chunks(self.wave_width(program)) {
                    self.run_in_place(program, calls, &mut line)?;
                }
            } else {
                for call in &calls {
                    let callee = (program, call.role, call.record);
                    self.form_in_place(callee, call.group, call.lanes)?;
                }
            }
            calls.clear();
            line.calls[program as usize] = calls;
        }
        self.worker.line = line;
        Ok(())
    }

    /// Runs a wave of hit, miss or any-hit shaders in place.
    fn run_in_place(
        &mut self,
        program: ProgramIndex,
        calls: &[InPlace],
        line: &mut Line,
    ) -> Result<(), Stopped> {
        let compiled = &self.dispatch.shaders.programs[program as usize];
        let layout = compiled.layout();
        let mut states = take(&mut line.states[0]);
        let room = self.make_line_room(0, layout.rows * calls.len(), &mut states);
        room.inspect_err(|_| self.note_call(calls[0].role, calls[0].of()))?;
        let plan = line.plan(program, compiled);
        let mut outputs_to = [null_mut(); MAX_SUBGROUPS];
        for (place, call) in calls.iter().enumerate() {
            let state = &mut states[place * layout.rows..][..layout.rows];
            outputs_to[place] = self.payload_rows(compiled, call);
            start_in_place(compiled, state, call.lanes, outputs_to[place]);
            self.fill_in_place(compiled, call, plan, state);
        }
        self.count_calls(calls);
        // Those that stand at one point, by their numbers.
        let mut running = NUMBERS;
        let mut count = calls.len();
        while count > 0 {
            let of = (&**compiled, program);
            let numbers = &running[..count];
            let started = self.start_clock();
            let event = self.run_numbered(of, &mut states, (numbers, &outputs_to), 1)?;
            let run = numbers.iter().map(|&number| &calls[number]);
            self.count_in_place(started, run.map(|call| (call.group, call.lanes)));
            let mut going_on = 0;
            for at in 0..count {
                let (place, call) = (running[at], &calls[running[at]]);
                let state = &mut states[place * layout.rows..][..layout.rows];
                match event {
                    Event::End if call.role == Role::AnyHit => {
                        let outputs = &state[layout.io..][..compiled.output_rows() as usize];
                        self.end_decider(outputs, (call.group, call.lanes));
                    }
                    Event::End => {
                        if outputs_to[place].is_null() {
                            let outputs = &state[layout.io..][..compiled.output_rows() as usize];
                            let caller = self.worker.ray_groups[call.group].caller;
                            self.copy_outputs(outputs, call.lanes, caller, None);
                        }
                        self.finish_rays(call.group, call.lanes);
                    }
                    Event::Yield(_) if self.nest(compiled, place, state, line) => {
                        running[going_on] = place;
                        going_on += 1;
                    }
                    Event::OutOfFuel => {
                        let index = self.leave_line(program, call, state)?;
                        self.make_ready(index);
                    }
                    Event::Yield(_) => {
                        let index = self.leave_line(program, call, state)?;
                        self.lines.noted_callees.push(Noted { index, event });
                    }
                }
            }
            let stay = self.run_nested((compiled, program), calls, &mut states, line)?;
            count = 0;
            for at in 0..going_on {
                if stay >> running[at] & 1 != 0 {
                    running[count] = running[at];
                    count += 1;
                }
            }
        }
        line.states[0] = states;
        Ok(())
    }

    /// Runs some of a list of states of a program to their next event, which is one for all.
    /// `numbers`: which ones, and where the outputs of all go ([`Wave::outputs_to`]); `depth`:
    /// calls around them.
    ///
    /// [`Wave::outputs_to`]: spirv_jit::program::Wave::outputs_to
    fn run_numbered(
        &mut self,
        (compiled, program): (&Program, ProgramIndex),
        states: &mut [AlignedRow],
        (numbers, all_outputs_to): (&[usize], &[*mut AlignedRow; MAX_SUBGROUPS]),
        depth: u32,
    ) -> Result<Event, Stopped> {
        let rows = compiled.layout().rows;
        let mut wave: [&mut [AlignedRow]; MAX_SUBGROUPS] = std::array::from_fn(|_| &mut [][..]);
        let mut outputs_to = [null_mut(); MAX_SUBGROUPS];
        let mut count = 0;
        for (number, state) in states.chunks_exact_mut(rows).enumerate() {
            if numbers.get(count) == Some(&number) {
                (wave[count], outputs_to[count]) = (state, all_outputs_to[number]);
                count += 1;
            }
        }
        let events = self.run_states(program, &mut wave[..count], &outputs_to[..count]);
        let first = &states[numbers[0] * rows..][..rows];
        let events = events.inspect_err(|_| self.note_in_line(compiled, first, depth))?;
        let checked = self.look_at_limits(&events);
        checked.inspect_err(|_| self.note_in_line(compiled, first, depth))?;
        // The interpreter keeps a wave together until its event.
        Ok(events.iter().next().unwrap_or(Event::End))
    }

    /// Adds the calls of a state that stands at a call of callables; false if not all of them run
    /// in place.
    fn nest(
        &mut self,
        caller: &Program,
        place: usize,
        state: &[AlignedRow],
        line: &mut Line,
    ) -> bool {
        let (shaders, table) = (self.dispatch.shaders, &self.dispatch.tables.callable);
        let callables = &state[caller.layout().io].0;
        let mut rest = caller.event_mask(state);
        let before = line.nested.len();
        while !rest.is_empty() {
            let callable = callables[rest.first()];
            let lanes = alike(callables, rest);
            rest -= lanes;
            let found = self.worker.records.find(shaders, table, callable);
            let Some((program, record)) =
                found.and_then(|(group, record)| Some((group.general?, record)))
            else {
                continue;
            };
            let compiled = &shaders.programs[program as usize];
            let runs = lanes.count() >= MANY
                && compiled.sites().is_empty()
                && line.plan(program, compiled).is_some();
            if !runs {
                line.nested.truncate(before);
                return false;
            }
            line.nested.push(Nested {
                program,
                record,
                caller: place,
                lanes,
            });
        }
        true
    }

    /// Runs the callables that callers in place have called. Returns the numbers of those that are
    /// answered, as a mask; callables that run out of fuel take their callers out of the line.
    fn run_nested(
        &mut self,
        (caller, caller_index): (&Program, ProgramIndex),
        calls: &[InPlace],
        states: &mut [AlignedRow],
        line: &mut Line,
    ) -> Result<u32, Stopped> {
        let mut answered = u32::MAX;
        if line.nested.is_empty() {
            return Ok(answered);
        }
        let mut nested = take(&mut line.nested);
        let mut inner = take(&mut line.states[1]);
        // Stable: callers in their order.
        nested.sort_by_key(|call| call.program);
        let layout = caller.layout();
        let mut late: Vec<(usize, Vec<AlignedRow>)> = Vec::new();
        let mut first = 0;
        for of_program in nested.chunk_by(|a, b| a.program == b.program) {
            let program = of_program[0].program;
            let compiled = &self.dispatch.shaders.programs[program as usize];
            let rows = compiled.layout().rows;
            for wave in of_program.chunks(self.wave_width(program)) {
                let room = self.make_line_room(1, rows * wave.len(), &mut inner);
                let outer = &states[wave[0].caller * layout.rows..][..layout.rows];
                room.inspect_err(|_| self.note_in_line(caller, outer, 1))?;
                // Callers stand at one call.
                let words = data_words(caller, outer);
                let fits = compiled.output_rows() as usize <= words;
                let mut outputs_to = [null_mut(); MAX_SUBGROUPS];
                for (to, call) in outputs_to.iter_mut().zip(wave).filter(|_| fits) {
                    let first = call.caller * layout.rows + layout.io + IO_DATA_ROW;
                    *to = states[first..][..words].as_mut_ptr();
                }
                for (at, call) in wave.iter().enumerate() {
                    let state = &mut inner[at * rows..][..rows];
                    start_in_place(compiled, state, call.lanes, outputs_to[at]);
                    let outer = &states[call.caller * layout.rows..][..layout.rows];
                    let data = &outer[layout.io + IO_DATA_ROW..][..words];
                    let Some(plan) = line.plan(program, compiled) else {
                        continue;
                    };
                    let inputs = &mut state[compiled.layout().inputs..];
                    let group = calls[call.caller].group;
                    let hits = &self.worker.ray_groups[group].group_walk.hits;
                    self.fill_by(plan, (group, hits), call.record, data, inputs);
                }
                let numbers = (&NUMBERS[..wave.len()], &outputs_to);
                let started = self.start_clock();
                let event = self.run_numbered((compiled, program), &mut inner, numbers, 2)?;
                self.count_nested(started, wave, calls);
                for (at, (call, state)) in wave.iter().zip(inner.chunks_exact(rows)).enumerate() {
                    let outer = &mut states[call.caller * layout.rows..][..layout.rows];
                    let data = &mut outer[layout.io + IO_DATA_ROW..][..words];
                    if event != Event::End {
                        answered &= !(1 << call.caller);
                        let mut state = state.to_vec();
                        if fits {
                            self.bring_outputs(compiled, &mut state, call.lanes, data);
                        }
                        late.push((first + at, state));
                        continue;
                    }
                    if fits {
                        continue;
                    }
                    let outputs = &state[compiled.layout().io..];
                    copy_lanes(self.dispatch.tier, data, &outputs[..words], call.lanes);
                }
                first += wave.len();
            }
        }
        late.sort_by_key(|(call, _)| nested[*call].caller);
        let late = late.into_iter().map(|(call, state)| (&nested[call], state));
        self.move_out_of_line((caller, caller_index), calls, states, late)?;
        nested.clear();
        line.nested = nested;
        line.states[1] = inner;
        Ok(answered)
    }

    /// Moves callables that ran out of fuel, with their states, to subgroups of their own. Their
    /// callers leave the line and wait for them.
    fn move_out_of_line<'c>(
        &mut self,
        (caller, caller_index): (&Program, ProgramIndex),
        calls: &[InPlace],
        states: &[AlignedRow],
        late: impl Iterator<Item = (&'c Nested, Vec<AlignedRow>)>,
    ) -> Result<(), Stopped> {
        let layout = caller.layout();
        let mut waiting: Option<(usize, SubgroupIndex)> = None;
        for (call, state) in late {
            let index = match waiting {
                Some((place, index)) if place == call.caller => index,
                _ => {
                    let outer = &states[call.caller * layout.rows..][..layout.rows];
                    let index = self.leave_line(caller_index, &calls[call.caller], outer)?;
                    self.worker.subgroups[index].data_words = data_words(caller, outer) as u32;
                    waiting = Some((call.caller, index));
                    index
                }
            };
            self.worker.subgroups[index].pending |= call.lanes;
            let launch = self.worker.subgroups[index].launch;
            let callee = self.new_subgroup(call.program, Role::Callable, call.lanes);
            let callee = callee.inspect_err(|_| self.note_stop(index))?;
            let subgroup = &mut self.worker.subgroups[callee];
            subgroup.rows[..state.len()].copy_from_slice(&state);
            subgroup.of = by_lane(|lane| LaneRef::new(index, lane));
            (subgroup.launch, subgroup.is_in_place) = (launch, true);
            self.make_ready(callee);
        }
        Ok(())
    }

    /// Fills the inputs of a hit or miss shader.
    fn fill_in_place(
        &self,
        compiled: &Program,
        call: &InPlace,
        plan: Option<&FillPlan>,
        state: &mut [AlignedRow],
    ) {
        let sources = self.sources();
        let group = &self.worker.ray_groups[call.group];
        let hits = group.hits_for(call.role);
        if let Some(plan) = plan.filter(|plan| plan.applies(hits, call.lanes)) {
            let inputs = &mut state[compiled.layout().inputs..];
            let payload = sources.data_of(group.caller);
            return self.fill_by(plan, (call.group, hits), call.record, payload, inputs);
        }
        let callee = inputs::Callee {
            role: call.role,
            lanes: call.lanes,
            launch: &self.worker.subgroups[group.caller].launch,
            of: &by_lane(|lane| LaneRef::new(call.group, lane)),
            is_in_place: true,
            records: &[call.record; SUBGROUP_SIZE],
        };
        fill(self.dispatch.tier, &sources, compiled, &callee, state);
    }

    /// Fills inputs by a plan.
    fn fill_by(
        &self,
        plan: &FillPlan,
        (group, hits): (u32, &HitRows),
        record: u64,
        data: &[AlignedRow],
        inputs: &mut [AlignedRow],
    ) {
        let group = &self.worker.ray_groups[group];
        let subject = Subject {
            hits,
            operands: group.operands(&self.worker.subgroups),
            data,
            launch: &self.worker.subgroups[group.caller].launch,
            layer: self.layer,
            record,
        };
        fill_by_plan(self.dispatch.tier, plan, &subject, inputs);
    }

    /// The rows of the payload of the caller of rays, if they take all outputs of a callee: null if
    /// they do not. The first output of an any-hit shader is its decision.
    fn payload_rows(&mut self, callee: &Program, call: &InPlace) -> *mut AlignedRow {
        let caller = self.worker.ray_groups[call.group].caller;
        let caller = &mut self.worker.subgroups[caller];
        if call.role == Role::AnyHit || callee.output_rows() > caller.data_words {
            return null_mut();
        }
        let program = &self.dispatch.shaders.programs[caller.program as usize];
        let first = program.layout().io + IO_DATA_ROW;
        caller.rows[first..][..caller.data_words as usize].as_mut_ptr()
    }

    /// Gives a state in place its own outputs, from the rows of the caller's data that have taken
    /// them: those of lanes that have ended.
    fn bring_outputs(
        &self,
        program: &Program,
        state: &mut [AlignedRow],
        lanes: LaneMask,
        data: &[AlignedRow],
    ) {
        let ended = lanes - program.event_mask(state);
        let outputs = &data[..program.output_rows() as usize];
        let to = &mut state[program.layout().io..];
        copy_lanes(self.dispatch.tier, to, outputs, ended);
    }

    /// Makes a subgroup of a hit, miss or any-hit shader that has not ended.
    fn leave_line(
        &mut self,
        program: ProgramIndex,
        call: &InPlace,
        state: &[AlignedRow],
    ) -> Result<SubgroupIndex, Stopped> {
        let index = self.new_subgroup(program, call.role, call.lanes);
        let index = index.inspect_err(|_| self.note_call(call.role, call.of()))?;
        let compiled = &self.dispatch.shaders.programs[program as usize];
        let caller = self.worker.ray_groups[call.group].caller;
        let launch = self.worker.subgroups[caller].launch;
        let mut state = state.to_vec();
        if !self.payload_rows(compiled, call).is_null() {
            let sources = self.sources();
            let payload = sources.data_of(caller);
            self.bring_outputs(compiled, &mut state, call.lanes, payload);
        }
        let subgroup = &mut self.worker.subgroups[index];
        subgroup.rows[..state.len()].copy_from_slice(&state);
        subgroup.of = by_lane(|lane| LaneRef::new(call.group, lane));
        (subgroup.launch, subgroup.is_in_place) = (launch, true);
        Ok(index)
    }
}

/// The trace of a site, and the words of its payload, if lines are answered there.
fn line_trace(site: SiteKind) -> Option<(Trace, u32)> {
    match site {
        SiteKind::TraceRay {
            trace,
            payload_words,
        } if !trace.to_hit_object => Some((trace, payload_words)),
        _ => None,
    }
}

/// Whether subgroups of one program in a line are a wave by themselves. Fewer run in longer waves
/// with others of the batch, in their step of the round.
fn is_worth_a_wave(subgroups: usize, members: usize) -> bool {
    subgroups > 0 && 4 * subgroups >= 3 * members
}

/// Starts a callee whose outputs go to these rows, or null: into its state.
fn start_in_place(
    program: &Program,
    state: &mut [AlignedRow],
    lanes: LaneMask,
    outputs_to: *mut AlignedRow,
) {
    match outputs_to.is_null() {
        true => program.start(state, lanes),
        false => program.start_without_outputs(state, lanes),
    }
}

/// Words of callable data of a state that stands at a call.
fn data_words(program: &Program, state: &[AlignedRow]) -> usize {
    match program.site_of(program.resume_point(state)) {
        Some(SiteKind::ExecuteCallable { data_words }) => data_words as usize,
        _ => 0,
    }
}
