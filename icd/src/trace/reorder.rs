//! Reordering (`OpReorderThread*`): the lanes of a batch that stand at one reorder instruction are
//! sorted, and form subgroups anew.
//!
//! Only lanes that execute the instruction move. Those that wait for them in an enclosing construct
//! stay where they are, as the specification has it ("Repacking"), and go on without them. Which
//! lanes meet follows from the batch alone.

use lanes::LaneMask;
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::hit_object::kind;
use spirv_jit::program::{AlignedRow, ResumePoint, Row, SiteKind, Stage, Trace};

use super::batch::Batch;
use super::grid::Launches;
use super::subgroup::{LaneRef, Subgroup, SubgroupIndex};
use crate::wave::Stopped;
use crate::wave::binding_table::ProgramIndex;

/// The sort key of lanes, most significant first: the shader that the hit object names, the hint's
/// bits, the shader's record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    /// Program index + 1; 0 without one.
    shader: u32,
    hint: u32,
    record: u64,
}

impl Batch<'_> {
    /// Reorders what waits for it; all of it is ready then.
    ///
    /// # Errors
    /// The batch would need too much memory.
    pub(super) fn reorder_threads(&mut self) -> Result<(), Stopped> {
        let mut waiting: Vec<_> = std::mem::take(&mut self.reordering)
            .into_iter()
            .map(|index| (self.place(index), index))
            .collect();
        waiting.sort_unstable();
        for group in waiting.chunk_by(|a, b| a.0 == b.0) {
            let indices: Vec<SubgroupIndex> = group.iter().map(|&(_, index)| index).collect();
            self.reorder_group(group[0].0.0, &indices)?;
        }
        Ok(())
    }

    fn place(&self, index: SubgroupIndex) -> (ProgramIndex, ResumePoint) {
        let subgroup = &self.worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        (subgroup.program, program.resume_point(&subgroup.rows))
    }

    /// Reorders subgroups that stand at one instruction.
    fn reorder_group(
        &mut self,
        program: ProgramIndex,
        indices: &[SubgroupIndex],
    ) -> Result<(), Stopped> {
        let compiled = &self.dispatch.shaders.programs[program as usize];
        let mut lanes: Vec<(Key, LaneRef)> = Vec::with_capacity(indices.len() * SUBGROUP_SIZE);
        // In the order of launches: that of places in the list is an accident.
        let mut in_order = indices.to_vec();
        in_order.sort_by_cached_key(|&index| self.first_launch(index));
        for index in in_order {
            self.worker.subgroups[index].pending = LaneMask::NONE;
            let rows = &self.worker.subgroups[index].rows;
            for lane in compiled.event_mask(rows) {
                let lane = LaneRef::new(index, lane);
                lanes.push((self.reorder_key(lane), lane));
            }
        }
        let needed = lanes.len().div_ceil(SUBGROUP_SIZE);
        let mut ready = indices.to_vec();
        if needed < indices.len() || !is_sorted(&lanes) {
            // Stable, so that neighbours stay neighbours where nothing speaks against it.
            lanes.sort_by_key(|lane| lane.0);
            let lanes: Vec<LaneRef> = lanes.into_iter().map(|(_, lane)| lane).collect();
            ready = self.move_lanes(program, indices, &lanes)?;
        }
        for index in ready {
            self.make_ready(index);
        }
        Ok(())
    }

    /// Where the launch of a subgroup's first active lane stands in the batch.
    fn first_launch(&self, index: SubgroupIndex) -> u32 {
        let subgroup = &self.worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let first = program.event_mask(&subgroup.rows).first();
        let launch = &subgroup.launch;
        self.grid.place(launch.x[first], launch.y[first])
    }

    /// Puts the lanes of ready ray generation shaders that stand behind one shader call into fewer
    /// subgroups, where many have ended.
    pub(super) fn compact(
        &mut self,
        program: ProgramIndex,
        point: ResumePoint,
        subgroups: &mut Vec<SubgroupIndex>,
    ) -> Result<(), Stopped> {
        let compiled = &self.dispatch.shaders.programs[program as usize];
        let may_move = matches!(
            compiled.site_of(point),
            Some(
                SiteKind::TraceRay {
                    trace: Trace {
                        to_hit_object: false,
                        ..
                    },
                    ..
                } | SiteKind::ExecuteCallable { .. }
            )
        );
        if !may_move || compiled.stage() != Stage::RayGeneration || subgroups.len() < 2 {
            return Ok(());
        }
        subgroups.sort_unstable();
        let mut sources = Vec::with_capacity(subgroups.len());
        let mut lanes = Vec::new();
        for &index in &*subgroups {
            let rows = &self.worker.subgroups[index].rows;
            let mask = compiled.event_mask(rows);
            let is_partial = !matches!(mask, LaneMask::NONE | LaneMask::ALL);
            if is_partial && !compiled.has_parked_lanes(rows) {
                lanes.extend(mask.iter().map(|lane| LaneRef::new(index, lane)));
                sources.push(index);
            }
        }
        // Moving costs about what it saves when a fourth of the subgroups goes.
        let needed = lanes.len().div_ceil(SUBGROUP_SIZE);
        if lanes.is_empty() || 4 * needed > 3 * sources.len() {
            return Ok(());
        }
        lanes.sort_by_cached_key(|lane| {
            let launch = &self.worker.subgroups[lane.index()].launch;
            self.grid
                .place(launch.x[lane.lane()], launch.y[lane.lane()])
        });
        let targets = self.move_lanes(program, &sources, &lanes)?;
        subgroups.retain(|index| sources.binary_search(index).is_err());
        subgroups.extend(targets);
        subgroups.sort_unstable();
        Ok(())
    }

    fn reorder_key(&mut self, lane: LaneRef) -> Key {
        let subgroup = &self.worker.subgroups[lane.index()];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let word = |row| subgroup.io(program, row, lane.lane());
        let mask = u32::MAX
            .checked_shr(32u32.saturating_sub(word(1)))
            .unwrap_or(0);
        let (hint, state, index) = (word(0) & mask, word(2), word(3));
        let tables = &self.dispatch.tables;
        let table = match state {
            kind::HIT => Some(&tables.hit),
            kind::MISS => Some(&tables.miss),
            _ => None,
        };
        let records = &mut self.worker.records;
        let found = table.and_then(|table| records.find(self.dispatch.shaders, table, index));
        let (shader, record) = match found {
            Some((group, record)) => {
                let shader = match state {
                    kind::HIT => group.closest_hit,
                    _ => group.general,
                };
                (shader.map_or(0, |program| program + 1), record)
            }
            None => (0, 0),
        };
        Key {
            shader,
            hint,
            record,
        }
    }

    /// Moves lanes, in this order, out of the `sources` that they all come from (ascending) into as
    /// few subgroups as will do. A source with lanes that wait for them stays, with those; the
    /// others are used again or given back. Returns what can go on.
    fn move_lanes(
        &mut self,
        program: ProgramIndex,
        sources: &[SubgroupIndex],
        lanes: &[LaneRef],
    ) -> Result<Vec<SubgroupIndex>, Stopped> {
        let compiled = &self.dispatch.shaders.programs[program as usize];
        let mut old: Vec<Subgroup> = sources
            .iter()
            .map(|&index| std::mem::take(&mut self.worker.subgroups[index]))
            .collect();
        let position = |lane: &LaneRef| {
            let found = sources.binary_search(&lane.index());
            (found.unwrap_or(0), lane.lane())
        };
        let stays = |subgroup: &Subgroup| compiled.has_parked_lanes(&subgroup.rows);
        let (mut staying, mut targets) = (Vec::new(), Vec::new());
        for (place, &index) in sources.iter().enumerate() {
            match stays(&old[place]) {
                true => staying.push((place, index)),
                false => targets.push(index),
            }
        }
        self.room_for(program, lanes.len().div_ceil(SUBGROUP_SIZE), &mut targets)?;
        for (&target, lanes) in targets.iter().zip(lanes.chunks(SUBGROUP_SIZE)) {
            let from: Vec<(usize, usize)> = lanes.iter().map(position).collect();
            let mut rows = self.worker.spare_rows.pop().unwrap_or_default();
            rows.resize(compiled.layout().rows, AlignedRow::default());
            let active = LaneMask::full(lanes.len());
            let pick = |lane: usize| from.get(lane).copied().unwrap_or(from[0]);
            let columns = std::array::from_fn(|to| {
                let (source, lane) = pick(to);
                (&old[source].rows[..], lane)
            });
            compiled.gather_lanes(&mut rows, active, &columns);
            let launches = |row: fn(&Launches) -> &Row| -> Row {
                std::array::from_fn(|to| {
                    let (source, lane) = pick(to);
                    row(&old[source].launch)[lane]
                })
            };
            let mut moved = Subgroup {
                program,
                role: old[0].role,
                rows,
                pending: LaneMask::NONE,
                lanes: active,
                data_words: old[0].data_words,
                launch: Launches {
                    x: launches(|launch| &launch.x),
                    y: launches(|launch| &launch.y),
                },
                ..Subgroup::default()
            };
            for (to, &(source, lane)) in from.iter().enumerate() {
                let from = (&mut old[source].queries, lane);
                let to = (&mut moved.queries, to);
                self.worker.queries.move_lane(from, to)?;
            }
            self.worker.subgroups[target] = moved;
        }
        for &(place, index) in &staying {
            compiled.leave_parked_lanes(&mut old[place].rows);
            self.worker.subgroups[index] = std::mem::take(&mut old[place]);
        }
        for subgroup in &mut old {
            self.worker.queries.release(&mut subgroup.queries);
        }
        let spare = old.into_iter().map(|subgroup| subgroup.rows);
        self.worker
            .spare_rows
            .extend(spare.filter(|rows| !rows.is_empty()));
        targets.extend(staying.into_iter().map(|(_, index)| index));
        Ok(targets)
    }

    /// Brings places for subgroups of a program to a count.
    fn room_for(
        &mut self,
        program: ProgramIndex,
        count: usize,
        places: &mut Vec<SubgroupIndex>,
    ) -> Result<(), Stopped> {
        let compiled = &self.dispatch.shaders.programs[program as usize];
        let bytes = compiled.layout().rows * size_of::<AlignedRow>();
        for index in places.drain(count.min(places.len())..) {
            self.memory.remove_state(bytes);
            self.worker.subgroups.remove(index);
        }
        while places.len() < count {
            self.take_state_bytes(bytes)?;
            places.push(self.worker.subgroups.take());
        }
        Ok(())
    }
}

fn is_sorted(lanes: &[(Key, LaneRef)]) -> bool {
    lanes.windows(2).all(|pair| pair[0].0 <= pair[1].0)
}
