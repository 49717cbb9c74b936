//! What getters read: words about a candidate or a committed hit.

use std::cell::OnceCell;

use spirv_jit::program::{AlignedRow, Row};
use spirv_jit::query::{QueryField, QueryWord, row};
use traversal::{Hit, HitRows, Ray, RayRows, Structure, Swept, Walk};

use super::super::Limits;
use super::super::rays::{primitive_of, to_object};
use super::super::subgroup::{copy_lanes, lanes_of};
use super::Object;

/// Writes what getters read of the candidates at which walks stand, a row at a time; `walks` has their lanes.
pub(super) fn describe_candidates(
    walks: &[(usize, &Walk)],
    object: &mut [AlignedRow],
    words: &[QueryWord],
    limits: &Limits,
) {
    let (words, _) = split(words);
    // Neighbours mostly meet the same instance.
    let mut last: Option<((u64, u32), [f32; 12])> = None;
    let mut to_object_space = |walk: &Walk, word: &QueryWord, vector: &[f32; 3], w: f32| {
        let asked = (walk.top_level(), walk.candidate().instance_index);
        let matrix = match &mut last {
            Some((known, matrix)) if *known == asked => matrix,
            _ => {
                let structure = limits.structure(asked.0);
                let matrix = structure.map_or([0.0; 12], |s| s.world_to_object(asked.1));
                &mut last.insert((asked, matrix)).1
            }
        };
        to_object(matrix, word.component as usize, vector, w).to_bits()
    };
    for (row, word) in object[row::WORDS..].iter_mut().zip(words) {
        let mut each = |fact: &mut dyn FnMut(&Walk, &Hit) -> u32| {
            for &(lane, walk) in walks {
                row.0[lane] = fact(walk, walk.candidate());
            }
        };
        match word.field {
            QueryField::IntersectionType => each(&mut |_, hit| u32::from(!hit.is_built_in())),
            QueryField::T => each(&mut |_, hit| hit.t.to_bits()),
            QueryField::InstanceCustomIndex => each(&mut |_, hit| hit.instance_custom_index),
            QueryField::InstanceId => each(&mut |_, hit| hit.instance_index),
            QueryField::InstanceSbtOffset => each(&mut |_, hit| hit.instance_sbt_offset),
            QueryField::GeometryIndex => each(&mut |_, hit| hit.geometry_index),
            QueryField::PrimitiveIndex => each(&mut |_, hit| hit.primitive_index),
            QueryField::Barycentrics => {
                each(&mut |_, hit| hit.barycentrics[word.component as usize].to_bits());
            }
            QueryField::ObjectRayOrigin => {
                each(&mut |walk, _| to_object_space(walk, word, &walk.ray().origin, 1.0));
            }
            QueryField::ObjectRayDirection => {
                each(&mut |walk, _| to_object_space(walk, word, &walk.ray().direction, 0.0));
            }
            _ => each(&mut |walk, hit| {
                let ty = u32::from(!hit.is_built_in());
                Facts::new(walk.ray(), walk.top_level(), (hit, ty), limits).word(*word)
            }),
        }
    }
}

/// Writes what getters read of a walk's committed hit, if there is one.
pub(super) fn describe_committed(
    walk: &Walk,
    query: &mut Object<'_>,
    words: &[QueryWord],
    limits: &Limits,
) {
    let (before, words) = split(words);
    if let Some(hit) = walk.committed() {
        let ty = type_of(hit.is_built_in());
        describe(walk, (hit, ty), query, before.len(), words, limits);
    }
}

fn describe(
    walk: &Walk,
    (hit, ty): (&Hit, u32),
    query: &mut Object<'_>,
    first: usize,
    words: &[QueryWord],
    limits: &Limits,
) {
    if words.is_empty() {
        return;
    }
    let facts = Facts::new(walk.ray(), walk.top_level(), (hit, ty), limits);
    for (index, word) in words.iter().enumerate() {
        query.set(row::WORDS + first + index, facts.word(*word));
    }
}

/// `OpRayQueryGetIntersectionTypeKHR` of a committed hit.
fn type_of(built_in: bool) -> u32 {
    if built_in { 1 } else { 2 }
}

/// The words about candidates, and those about committed hits.
fn split(words: &[QueryWord]) -> (&[QueryWord], &[QueryWord]) {
    words.split_at(words.partition_point(|word| !word.committed))
}

/// Whether getters read more of committed hits than whether there is one.
pub(super) fn shows_committed(words: &[QueryWord]) -> bool {
    let (_, committed) = split(words);
    (committed.iter()).any(|word| word.field != QueryField::IntersectionType)
}

/// Writes what getters read of the hits that `lanes` have: rows at once where they are rows already.
pub(super) fn describe_rows(
    rays: &RayRows,
    hits: &HitRows,
    lanes: u16,
    object: &mut [AlignedRow],
    words: &[QueryWord],
    limits: &Limits,
) {
    let lanes = lanes & hits.found;
    let (candidate, committed) = split(words);
    if lanes == 0 || committed.is_empty() {
        return;
    }
    let rows = &mut object[row::WORDS + candidate.len()..];
    let mut others = false;
    for (to, word) in rows.iter_mut().zip(committed) {
        match row_of(hits, *word) {
            Some(from) => copy_lanes(&mut to.0, &from, lanes),
            None => others = true,
        }
    }
    if !others {
        return;
    }
    for lane in lanes_of(lanes) {
        let (ray, hit) = (rays.ray(lane), hits.hit(lane));
        let hit = (&hit, type_of(hit.is_built_in()));
        let facts = Facts::new(&ray, rays.top_level[lane], hit, limits);
        for (to, word) in rows.iter_mut().zip(committed) {
            if row_of(hits, *word).is_none() {
                to.0[lane] = facts.word(*word);
            }
        }
    }
}

/// A row of hits as it is.
#[inline]
fn row_of(hits: &HitRows, word: QueryWord) -> Option<Row> {
    Some(match word.field {
        QueryField::IntersectionType => std::array::from_fn(|lane| type_of(hits.is_built_in(lane))),
        QueryField::T => hits.t.map(f32::to_bits),
        QueryField::Barycentrics => hits.barycentrics[word.component as usize].map(f32::to_bits),
        QueryField::InstanceCustomIndex => hits.instance_custom_index,
        QueryField::InstanceId => hits.instance_index,
        QueryField::InstanceSbtOffset => hits.instance_sbt_offset,
        QueryField::GeometryIndex => hits.geometry_index,
        QueryField::PrimitiveIndex => hits.primitive_index,
        QueryField::Slot => hits.slot,
        _ => return None,
    })
}

/// All about one intersection; what has to be looked up is, once, if asked for.
struct Facts<'a> {
    ray: &'a Ray,
    hit: &'a Hit,
    /// `OpRayQueryGetIntersectionTypeKHR`.
    ty: u32,
    structure: Option<Structure>,
    limits: &'a Limits,
    object_to_world: OnceCell<[f32; 12]>,
    world_to_object: OnceCell<[f32; 12]>,
    vertices: OnceCell<[[f32; 3]; 3]>,
    ends: OnceCell<([[f32; 3]; 2], [f32; 2])>,
}

impl<'a> Facts<'a> {
    /// `structure`: the address of the top level.
    fn new(ray: &'a Ray, structure: u64, (hit, ty): (&'a Hit, u32), limits: &'a Limits) -> Self {
        Self {
            ray,
            hit,
            ty,
            structure: limits.structure(structure),
            limits,
            object_to_world: OnceCell::new(),
            world_to_object: OnceCell::new(),
            vertices: OnceCell::new(),
            ends: OnceCell::new(),
        }
    }

    fn word(&self, word: QueryWord) -> u32 {
        let (hit, component) = (self.hit, word.component as usize);
        match word.field {
            QueryField::IntersectionType => self.ty,
            QueryField::T => hit.t.to_bits(),
            QueryField::InstanceCustomIndex => hit.instance_custom_index,
            QueryField::InstanceId => hit.instance_index,
            QueryField::InstanceSbtOffset => hit.instance_sbt_offset,
            QueryField::GeometryIndex => hit.geometry_index,
            QueryField::PrimitiveIndex => hit.primitive_index,
            QueryField::Barycentrics => hit.barycentrics[component].to_bits(),
            QueryField::FrontFace => {
                u32::from(hit.hit_kind == traversal::ray::HIT_KIND_FRONT_FACING_TRIANGLE)
            }
            QueryField::AabbOpaque => u32::from(hit.opaque),
            QueryField::IsSphere => u32::from(hit.swept == Swept::Sphere),
            QueryField::IsLss => u32::from(hit.swept == Swept::LinearSweptSphere),
            QueryField::LssHitValue => hit.barycentrics[0].to_bits(),
            QueryField::SweptPositions => self.ends().0.as_flattened()[component].to_bits(),
            QueryField::HitKind => hit.hit_kind as u32 | primitive_of(hit) << 8,
            QueryField::Slot => hit.slot,
            QueryField::SweptRadii => self.ends().1[component].to_bits(),
            QueryField::ObjectRayDirection => {
                to_object(self.world_to_object(), component, &self.ray.direction, 0.0).to_bits()
            }
            QueryField::ObjectRayOrigin => {
                to_object(self.world_to_object(), component, &self.ray.origin, 1.0).to_bits()
            }
            // Column-major 4 × 3 of a row-major 3 × 4.
            QueryField::ObjectToWorld => {
                self.object_to_world()[component % 3 * 4 + component / 3].to_bits()
            }
            QueryField::WorldToObject => {
                self.world_to_object()[component % 3 * 4 + component / 3].to_bits()
            }
            QueryField::TriangleVertexPositions => {
                let vertices = self.vertices.get_or_init(|| {
                    let structure = self.structure.as_ref();
                    structure.map_or_else(Default::default, |s| {
                        s.triangle_vertices(hit, &self.limits.live)
                    })
                });
                vertices[component / 3][component % 3].to_bits()
            }
        }
    }

    /// Ends and radii of a sphere or linear swept sphere.
    fn ends(&self) -> &([[f32; 3]; 2], [f32; 2]) {
        self.ends.get_or_init(|| {
            let structure = self.structure.as_ref();
            structure.map_or_else(Default::default, |s| {
                s.swept_ends(self.hit, &self.limits.live)
            })
        })
    }

    fn object_to_world(&self) -> &[f32; 12] {
        self.object_to_world.get_or_init(|| {
            let structure = self.structure.as_ref();
            structure.map_or([0.0; 12], |s| s.object_to_world(self.hit.instance_index))
        })
    }

    fn world_to_object(&self) -> &[f32; 12] {
        self.world_to_object.get_or_init(|| {
            let structure = self.structure.as_ref();
            structure.map_or([0.0; 12], |s| s.world_to_object(self.hit.instance_index))
        })
    }
}
