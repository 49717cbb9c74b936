//! Rays in flight, sixteen at a time: those that the lanes of one subgroup have traced with one
//! instruction.

use lanes::{LaneMask, by_lane};
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::program::{AlignedRow, IO_DATA_ROW, ResumePoint, Row};
use traversal::{GroupWalk, HitRows, RayRows, ray_flags};

use super::Dispatch;
use super::slab::Slab;
use super::subgroup::{LaneRef, Role, Subgroup, SubgroupIndex, Turn};
use crate::wave::binding_table::ProgramIndex;
use crate::wave::rows::floats;

/// `maxRayHitAttributeSize` in words.
pub const MAX_ATTRIBUTE_WORDS: usize = 8;

/// The operands of a trace instruction, as a subgroup that stands there has them.
pub type Operands = [AlignedRow; IO_DATA_ROW];

/// Rows of [`Operands`].
pub mod operand {
    /// Device address of the top level, two words.
    pub const STRUCTURE: usize = 0;
    pub const FLAGS: usize = 2;
    pub const CULL_MASK: usize = 3;
    pub const SBT_OFFSET: usize = 4;
    pub const SBT_STRIDE: usize = 5;
    pub const MISS_INDEX: usize = 6;
    pub const ORIGIN: usize = 7;
    pub const T_MIN: usize = 10;
    pub const DIRECTION: usize = 11;
    pub const T_MAX: usize = 14;
    /// With motion only.
    pub const TIME: usize = 15;

    /// Bits of the structure, the flags and the mask.
    pub const SETTING: u16 = 0b11 << STRUCTURE | 1 << FLAGS | 1 << CULL_MASK;
}

/// A hit that an intersection shader reported and an any-hit shader is to decide on.
#[derive(Clone, Copy, Debug, Default)]
pub struct Report {
    pub t: f32,
    pub hit_kind: u8,
    pub attributes: [u32; MAX_ATTRIBUTE_WORDS],
    /// The intersection invocation that waits for the verdict.
    pub reporter: LaneRef,
}

/// The attributes of rays that meet boxes.
#[derive(Default)]
pub struct Procedural {
    /// The hit attributes of committed hits.
    pub attributes: [Row; MAX_ATTRIBUTE_WORDS],
    pub reports: [Report; SUBGROUP_SIZE],
}

/// Rays between their trace instruction and the end of their closest-hit or miss shaders, one a
/// lane. What they were asked for is where the subgroup that waits for them has it.
#[derive(Default)]
pub struct RayGroup {
    /// The subgroup that waits.
    pub caller: SubgroupIndex,
    /// Row of its state where the operands begin.
    pub io: usize,
    /// Lanes whose ray is not answered yet.
    pub in_flight: LaneMask,
    /// How far they are: what was found, and candidates.
    pub group_walk: GroupWalk,
    /// Lanes whose rays walked to their ends by themselves, once a capture has counted them.
    pub walked_alone: Option<LaneMask>,
    /// Lanes about whose candidates shaders have not decided yet.
    pub undecided: LaneMask,
    /// Stores hits in hit objects.
    pub fills_hit_object: bool,
    /// The instruction says when rays are cast.
    pub has_time: bool,
    /// The operands that are the same in all subgroups that stand where the caller does: a bit
    /// each.
    pub uniform_operands: u16,
    /// Where the caller stands, if rays of others there differ by their origins, directions and
    /// intervals alone.
    point: Option<(ProgramIndex, ResumePoint)>,
    /// They come from hit objects: nothing is walked, and the operands are here.
    is_recorded: bool,
    recorded: Option<Box<Operands>>,
    procedural: Option<Box<Procedural>>,
}

impl RayGroup {
    /// Uses the place for the rays of `lanes` of a subgroup.
    pub fn start(&mut self, caller: SubgroupIndex, io: usize, lanes: LaneMask) {
        self.caller = caller;
        self.io = io;
        self.in_flight = lanes;
        self.walked_alone = None;
        self.fills_hit_object = false;
        self.has_time = false;
        self.is_recorded = false;
        self.point = None;
    }

    /// Takes note of the point where the caller stands, and of its uniform operands.
    pub fn stand_at(&mut self, point: (ProgramIndex, ResumePoint), uniform_operands: u16) {
        let setting = operand::SETTING | u16::from(self.has_time) << operand::TIME;
        self.uniform_operands = uniform_operands;
        self.point = (uniform_operands & setting == setting).then_some(point);
    }

    /// Makes the rays come from hit objects; hits and operands are to be filled in.
    pub fn record(&mut self) {
        self.is_recorded = true;
        self.has_time = true;
        self.group_walk.hits.found = LaneMask::NONE;
    }

    /// The rays, for reports.
    #[cold]
    pub fn rays(&self, operands: &Operands, dispatch: &Dispatch<'_>) -> RayRows {
        let mut rays = RayRows::NONE;
        load_rays(dispatch.tier, self, operands, dispatch, &mut rays);
        rays
    }

    /// The hits that shaders of a role are about: candidates, or the hits in the end.
    #[inline]
    pub fn hits_for(&self, role: Role) -> &HitRows {
        match role.turn() {
            Turn::Deciders => self.group_walk.candidates(),
            _ => &self.group_walk.hits,
        }
    }

    /// Whether nothing is walked.
    pub fn is_recorded(&self) -> bool {
        self.is_recorded
    }

    /// The operands of rays that come from hit objects.
    pub fn recorded_mut(&mut self) -> &mut Operands {
        self.recorded.get_or_insert_default()
    }

    /// The operands.
    #[inline]
    pub fn operands<'a>(&'a self, subgroups: &'a Slab<Subgroup>) -> &'a Operands {
        match &self.recorded {
            Some(recorded) if self.is_recorded => recorded,
            _ => subgroups[self.caller].rows[self.io..]
                .first_chunk()
                .expect("a state has a yield's operands"),
        }
    }

    /// The attributes of rays that meet boxes; arbitrary if nothing was written since the lane
    /// began.
    pub fn procedural_mut(&mut self) -> &mut Procedural {
        self.procedural.get_or_insert_default()
    }

    /// As [`Self::procedural_mut`]; `None` where nothing was ever written.
    pub fn procedural(&self) -> Option<&Procedural> {
        self.procedural.as_deref()
    }

    /// Whether rays differ from those of another group by their origins, directions and intervals
    /// alone, and their uniform operands are those of the other group.
    pub fn shares_setting(&self, other: &RayGroup) -> bool {
        self.point.is_some() && self.point == other.point
    }

    /// Reads the rays of a trace.
    #[inline(always)]
    fn load_here(&self, operands: &Operands, dispatch: &Dispatch<'_>, rays: &mut RayRows) {
        let floats = |row: usize| floats(&operands[row].0);
        for axis in 0..3 {
            rays.origin[axis] = floats(operand::ORIGIN + axis);
            rays.direction[axis] = floats(operand::DIRECTION + axis);
        }
        rays.t_min = floats(operand::T_MIN);
        rays.t_max = floats(operand::T_MAX);
        rays.time = match self.has_time {
            true => floats(operand::TIME),
            false => [0.0; SUBGROUP_SIZE],
        };
        let (flags, all) = (dispatch.pipeline_ray_flags, dispatch.takes_all_hits);
        rays.flags = by_lane(|lane| {
            let given = operands[operand::FLAGS].0[lane];
            let opaque = all && given & ray_flags::OPACITY == 0;
            given | flags | if opaque { ray_flags::OPAQUE } else { 0 }
        });
        rays.cull_mask = by_lane(|lane| operands[operand::CULL_MASK].0[lane] & 0xff);
        let [low, high] = [operand::STRUCTURE, operand::STRUCTURE + 1].map(|row| &operands[row].0);
        if alike(low, self.in_flight) & alike(high, self.in_flight) == self.in_flight {
            let first = self.in_flight.first();
            rays.top_level = [structure_in(operands, first); SUBGROUP_SIZE];
            return;
        }
        for lane in self.in_flight {
            rays.top_level[lane] = structure_in(operands, lane);
        }
    }
}

lanes::vectors! {
    /// Reads the rays of a trace.
    pub fn load_rays<V>(
        _v,
        group: &RayGroup,
        operands: &Operands,
        dispatch: &Dispatch<'_>,
        rays: &mut RayRows,
    ) {
        group.load_here(operands, dispatch, rays);
    }
}

lanes::vectors! {
    /// Reads origins, directions and intervals of rays, but the operands that are uniform.
    pub fn load_varying_rays<V>(_v, operands: &Operands, uniform: u16, rays: &mut RayRows) {
        let rows = [
            (operand::ORIGIN, &mut rays.origin[..]),
            (operand::T_MIN, std::slice::from_mut(&mut rays.t_min)),
            (operand::DIRECTION, &mut rays.direction[..]),
            (operand::T_MAX, std::slice::from_mut(&mut rays.t_max)),
        ];
        for (first, rows) in rows {
            for (row, numbers) in (first..).zip(rows) {
                if uniform >> row & 1 == 0 {
                    *numbers = floats(&operands[row].0);
                }
            }
        }
    }
}

lanes::vectors! {
    /// Indices of the hit group records for hits (chapter Ray Tracing, "Hit Shaders"), and of the
    /// miss records where there is none.
    pub fn record_indices<V>(v, hits: &HitRows, operands: &Operands) -> Row {
        let load = |row: usize| v.load_i(&operands[row].0);
        let geometry = v.load_i(&hits.geometry_index);
        let in_instance = v.add_i(v.mul_i(geometry, load(operand::SBT_STRIDE)), load(operand::SBT_OFFSET));
        let hit = v.add_i(v.load_i(&hits.instance_sbt_offset), in_instance);
        let mut row = [0; SUBGROUP_SIZE];
        v.store_i(v.select(hits.found.bits(), hit, load(operand::MISS_INDEX)), &mut row);
        row
    }
}

/// Which of some lanes have the number of the first of them in a row.
pub fn alike(row: &Row, lanes: LaneMask) -> LaneMask {
    LaneMask::holding(row, row[lanes.first()]) & lanes
}

/// Whether which hit rays find first can be seen, where their first hit ends them.
pub fn shows_first_hit(operands: &Operands, lanes: LaneMask, fills_hit_object: bool) -> bool {
    let flags = &operands[operand::FLAGS].0;
    let ends = LaneMask::with_any(flags, ray_flags::TERMINATE_ON_FIRST_HIT) & lanes;
    // Rays without it are the most.
    !ends.is_empty() && (fills_hit_object || !(ends - skips_closest_hit(operands)).is_empty())
}

/// The address that a lane names for its top level.
#[inline]
pub fn structure_in(operands: &Operands, lane: usize) -> u64 {
    let word = |row: usize| u64::from(operands[row].0[lane]);
    word(operand::STRUCTURE) | word(operand::STRUCTURE + 1) << 32
}

/// The addresses that lanes name for their top levels: mostly one for all.
pub fn structures_in(operands: &Operands, lanes: LaneMask) -> impl Iterator<Item = u64> {
    let [low, high] = [operand::STRUCTURE, operand::STRUCTURE + 1].map(|row| &operands[row].0);
    let is_one = alike(low, lanes) & alike(high, lanes) == lanes;
    let named = if is_one {
        LaneMask::of(lanes.first())
    } else {
        lanes
    };
    named.iter().map(move |lane| structure_in(operands, lane))
}

/// Lanes whose hits no closest-hit shader is to see.
pub fn skips_closest_hit(operands: &Operands) -> LaneMask {
    LaneMask::with_any(
        &operands[operand::FLAGS].0,
        ray_flags::SKIP_CLOSEST_HIT_SHADER,
    )
}
