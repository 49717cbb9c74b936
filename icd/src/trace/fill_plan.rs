//! Fill plans: the rows that the inputs of a hit, miss or any-hit shader are, if its invocations
//! run in the lanes of their rays; and those of ray generation shaders. Found once for a program
//! and a batch.

use lanes::{LaneMask, by_lane};
use spirv_jit::program::{AlignedRow, Builtin, InputRow, Row};
use spirv_jit::{Program, SUBGROUP_SIZE};
use traversal::HitRows;

use super::grid::{Grid, Launches};
use super::rays::{Operands, operand};
use crate::wave::binding_table::HANDLE_SIZE;
use crate::wave::rows::bits_of;

/// The row that an input is.
#[derive(Clone, Copy)]
enum Source {
    /// A word of the payload or the callable data.
    Data(usize),
    Operand(usize),
    CullMask,
    /// A weight of a triangle's corner.
    Weight(usize),
    T,
    Instance,
    CustomIndex,
    Geometry,
    Primitive,
    HitKind,
    LaunchColumn,
    LaunchRow,
    LaunchLayer,
    /// A word of the record's address.
    Record(u8),
}

/// The sources of a program's inputs.
pub struct FillPlan {
    sources: Vec<Source>,
    /// There are attributes, which are weights in triangles alone.
    has_weights: bool,
}

/// The subject of a fill: the rays, and where their caller is and keeps its payload.
pub struct Subject<'a> {
    /// The hits, or the candidates that an any-hit shader decides on.
    pub hits: &'a HitRows,
    pub operands: &'a Operands,
    /// The payload, or the callable data.
    pub data: &'a [AlignedRow],
    pub launch: &'a Launches,
    pub layer: u32,
    pub record: u64,
}

impl FillPlan {
    /// The plan of a ray generation, closest-hit, miss, any-hit or callable shader, if each of its
    /// inputs is a row that is there.
    pub fn new(program: &Program) -> Option<FillPlan> {
        let sources: Option<Vec<Source>> = program.inputs().iter().map(source).collect();
        let sources = sources?;
        let has_weights = sources
            .iter()
            .any(|source| matches!(source, Source::Weight(_)));
        Some(FillPlan {
            sources,
            has_weights,
        })
    }

    /// Whether it holds for these hits.
    #[inline]
    pub fn applies(&self, hits: &HitRows, lanes: LaneMask) -> bool {
        !self.has_weights || (lanes - hits.built_in()).is_empty()
    }

    /// Fills the inputs of a ray generation shader's invocations, whose plan this is.
    #[inline(always)]
    fn fill_launches(
        &self,
        launch: &Launches,
        (layer, record): (u32, u64),
        rows: &mut [AlignedRow],
    ) {
        for (row, &source) in rows.iter_mut().zip(&self.sources) {
            row.0 = match source {
                Source::LaunchColumn => launch.x,
                Source::LaunchRow => launch.y,
                Source::LaunchLayer => [layer; SUBGROUP_SIZE],
                Source::Record(word) => record_word(record, word),
                // Those of rays and callers: it has none.
                _ => [0; SUBGROUP_SIZE],
            };
        }
    }

    #[inline(always)]
    fn fill_rows(&self, subject: &Subject<'_>, rows: &mut [AlignedRow]) {
        let hits = subject.hits;
        for (row, &source) in rows.iter_mut().zip(&self.sources) {
            row.0 = match source {
                Source::Data(word) => match subject.data.get(word) {
                    Some(row) => row.0,
                    None => [0; SUBGROUP_SIZE],
                },
                Source::Operand(row) => subject.operands[row].0,
                Source::CullMask => {
                    let masks = &subject.operands[operand::CULL_MASK].0;
                    by_lane(|lane| masks[lane] & 0xff)
                }
                Source::Weight(corner) => bits_of(&hits.barycentrics[corner]),
                Source::T => bits_of(&hits.t),
                Source::Instance => hits.instance_index,
                Source::CustomIndex => hits.instance_custom_index,
                Source::Geometry => hits.geometry_index,
                Source::Primitive => hits.primitive_index,
                Source::HitKind => by_lane(|lane| u32::from(hits.hit_kind(lane))),
                Source::LaunchColumn => subject.launch.x,
                Source::LaunchRow => subject.launch.y,
                Source::LaunchLayer => [subject.layer; SUBGROUP_SIZE],
                Source::Record(word) => record_word(subject.record, word),
            };
        }
    }
}

/// A word of the address of a record's data.
fn record_word(record: u64, word: u8) -> Row {
    let data = record + HANDLE_SIZE as u64;
    [(data >> (32 * u32::from(word))) as u32; SUBGROUP_SIZE]
}

fn source(input: &InputRow) -> Option<Source> {
    Some(match *input {
        InputRow::Payload(word) | InputRow::CallableData(word) => Source::Data(word as usize),
        InputRow::HitAttribute(word @ 0..2) => Source::Weight(word as usize),
        InputRow::Builtin(builtin, component) => match (builtin, component as usize) {
            (Builtin::LaunchId, 0) => Source::LaunchColumn,
            (Builtin::LaunchId, 1) => Source::LaunchRow,
            (Builtin::LaunchId, _) => Source::LaunchLayer,
            (Builtin::ShaderRecordAddress, _) => Source::Record(component),
            (Builtin::WorldRayOrigin, axis) => Source::Operand(operand::ORIGIN + axis),
            (Builtin::WorldRayDirection, axis) => Source::Operand(operand::DIRECTION + axis),
            (Builtin::RayTmin, _) => Source::Operand(operand::T_MIN),
            (Builtin::IncomingRayFlags, _) => Source::Operand(operand::FLAGS),
            (Builtin::CullMask, _) => Source::CullMask,
            (Builtin::RayTmax, _) => Source::T,
            (Builtin::InstanceId, _) => Source::Instance,
            (Builtin::InstanceCustomIndex, _) => Source::CustomIndex,
            (Builtin::GeometryIndex, _) => Source::Geometry,
            (Builtin::PrimitiveId, _) => Source::Primitive,
            (Builtin::HitKind, _) => Source::HitKind,
            _ => return None,
        },
        _ => return None,
    })
}

lanes::vectors! {
    /// Fills the inputs of lanes for which the plan applies into `rows`, those of the inputs.
    pub fn fill_by_plan<V>(_v, plan: &FillPlan, subject: &Subject<'_>, rows: &mut [AlignedRow]) {
        plan.fill_rows(subject, rows);
    }
}

lanes::vectors! {
    /// Writes where the launches of a tile's lanes are, and into `rows` the inputs of their
    /// invocations, of this layer and record, if there is a plan for them. Returns which lanes are
    /// inside the grid.
    pub fn start_tile<V>(
        _v,
        grid: &Grid,
        place: [u32; 2],
        launch: &mut Launches,
        plan: Option<&FillPlan>,
        common: (u32, u64),
        rows: &mut [AlignedRow],
    ) -> LaneMask {
        let lanes = grid.write_tile(place, launch);
        if let Some(plan) = plan {
            plan.fill_launches(launch, common, rows);
        }
        lanes
    }
}
