//! What is known of hits ([`Fact`]), whoever asks: built-ins of hit shaders, ray queries, hit
//! objects. Hits hold most of it ([`take`]); the rest is in the structures ([`Told`]).

use std::cell::OnceCell;

use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::facts::Fact;
use spirv_jit::hit_object::primitive;
use spirv_jit::program::Row;
use traversal::ray::HIT_KIND_FRONT_FACING_TRIANGLE;
use traversal::{Hit, HitRows, Structure, Swept};

use crate::wave::Limits;

/// One of each lane.
pub type Lanes<T> = [T; SUBGROUP_SIZE];

/// Reads facts that hits hold.
pub trait Take {
    type Taken;

    /// `rows` reads a lane of rows of hits, `hit` one hit.
    fn take(self, rows: impl Fn(&HitRows, usize) -> u32, hit: impl Fn(&Hit) -> u32) -> Self::Taken;
}

/// Takes a word of a fact that hits hold; `None` of any other.
#[inline(always)]
pub fn take<T: Take>(fact: Fact, component: usize, by: T) -> Option<T::Taken> {
    Some(match fact {
        Fact::T => by.take(|rows, lane| rows.t[lane].to_bits(), |hit| hit.t.to_bits()),
        Fact::InstanceCustomIndex => by.take(
            |rows, lane| rows.instance_custom_index[lane],
            |hit| hit.instance_custom_index,
        ),
        Fact::InstanceId => by.take(
            |rows, lane| rows.instance_index[lane],
            |hit| hit.instance_index,
        ),
        Fact::InstanceSbtOffset => by.take(
            |rows, lane| rows.instance_sbt_offset[lane],
            |hit| hit.instance_sbt_offset,
        ),
        Fact::GeometryIndex => by.take(
            |rows, lane| rows.geometry_index[lane],
            |hit| hit.geometry_index,
        ),
        Fact::PrimitiveIndex => by.take(
            |rows, lane| rows.primitive_index[lane],
            |hit| hit.primitive_index,
        ),
        Fact::Barycentrics => by.take(
            |rows, lane| rows.barycentrics[component][lane].to_bits(),
            |hit| hit.barycentrics[component].to_bits(),
        ),
        Fact::LssHitValue => by.take(
            |rows, lane| rows.barycentrics[0][lane].to_bits(),
            |hit| hit.barycentrics[0].to_bits(),
        ),
        Fact::HitKind => by.take(
            |rows, lane| rows.hit_kind(lane) as u32,
            |hit| hit.hit_kind as u32,
        ),
        Fact::FrontFace => by.take(
            |rows, lane| u32::from(rows.hit_kind(lane) == HIT_KIND_FRONT_FACING_TRIANGLE),
            |hit| u32::from(hit.hit_kind == HIT_KIND_FRONT_FACING_TRIANGLE),
        ),
        Fact::AabbOpaque => by.take(
            |rows, lane| u32::from(rows.hit(lane).opaque),
            |hit| u32::from(hit.opaque),
        ),
        Fact::IsSphere => by.take(
            |rows, lane| u32::from(rows.swept(lane) == Swept::Sphere),
            |hit| u32::from(hit.swept == Swept::Sphere),
        ),
        Fact::IsLss => by.take(
            |rows, lane| u32::from(rows.swept(lane) == Swept::LinearSweptSphere),
            |hit| u32::from(hit.swept == Swept::LinearSweptSphere),
        ),
        Fact::HitWord => by.take(|rows, lane| hit_word(&rows.hit(lane)), hit_word),
        Fact::Slot => by.take(|rows, lane| rows.slot[lane], |hit| hit.slot),
        _ => return None,
    })
}

/// Kind and primitive of a hit, as a hit object has them.
pub fn hit_word(hit: &Hit) -> u32 {
    let primitive = match hit.swept {
        Swept::Sphere => primitive::SPHERE,
        Swept::LinearSweptSphere => primitive::LINEAR_SWEPT_SPHERE,
        Swept::No if hit.triangle => primitive::TRIANGLE,
        Swept::No => primitive::BOX,
    };
    hit.hit_kind as u32 | primitive << 8
}

/// Takes from one hit.
pub struct OfHit<'a>(pub &'a Hit);

impl Take for OfHit<'_> {
    type Taken = u32;

    fn take(self, _: impl Fn(&HitRows, usize) -> u32, hit: impl Fn(&Hit) -> u32) -> u32 {
        hit(self.0)
    }
}

/// The hits of some lanes.
pub trait Subjects {
    /// Lanes that have one.
    fn lanes(&self) -> u16;
    /// Address of the top level.
    fn structure(&self, lane: usize) -> u64;
    /// When the ray is cast.
    fn time(&self, lane: usize) -> f32;
    fn hit(&self, lane: usize) -> Hit;
    /// The ray's origin and direction.
    fn ray(&self, lane: usize) -> [[f32; 3]; 2];
}

/// What structures tell of the hits of some lanes: looked up once, if asked for.
#[derive(Default)]
pub struct Told {
    object_to_world: OnceCell<Lanes<[f32; 12]>>,
    world_to_object: OnceCell<Lanes<[f32; 12]>>,
    vertices: OnceCell<Lanes<[[f32; 3]; 3]>>,
    ends: OnceCell<Lanes<([[f32; 3]; 2], [f32; 2])>>,
}

impl Told {
    /// A word of a fact that structures tell, of the same subjects each time; `None` of any other.
    pub fn row(
        &self,
        subjects: &impl Subjects,
        limits: &Limits,
        fact: Fact,
        component: usize,
    ) -> Option<Row> {
        let live = &limits.live;
        let object_to_world = || {
            self.object_to_world.get_or_init(|| {
                of_instances(subjects, limits, |s, index, time| {
                    s.object_to_world_at(index, time)
                })
            })
        };
        let world_to_object = || {
            self.world_to_object.get_or_init(|| {
                of_instances(subjects, limits, |s, index, time| {
                    s.world_to_object_at(index, time)
                })
            })
        };
        let ends = || {
            self.ends.get_or_init(|| {
                of_structures(subjects, limits, |s, hit, _| s.swept_ends(hit, live))
            })
        };
        Some(match fact {
            Fact::ObjectToWorld => column_major(object_to_world(), component),
            Fact::WorldToObject => column_major(world_to_object(), component),
            Fact::ObjectRayOrigin | Fact::ObjectRayDirection => {
                let matrices = world_to_object();
                let (which, w) = match fact {
                    Fact::ObjectRayOrigin => (0, 1.0),
                    _ => (1, 0.0),
                };
                std::array::from_fn(|lane| {
                    let vector = subjects.ray(lane)[which];
                    to_object(&matrices[lane], component, &vector, w).to_bits()
                })
            }
            Fact::TriangleVertexPositions => {
                let vertices = self.vertices.get_or_init(|| {
                    of_structures(subjects, limits, |s, hit, time| {
                        s.triangle_vertices_at(hit, time, live)
                    })
                });
                let coordinate = |v: &[[f32; 3]; 3]| v[component / 3][component % 3].to_bits();
                std::array::from_fn(|lane| coordinate(&vertices[lane]))
            }
            Fact::SweptPositions => {
                let ends = ends();
                std::array::from_fn(|lane| ends[lane].0.as_flattened()[component].to_bits())
            }
            Fact::SweptRadii => {
                let ends = ends();
                std::array::from_fn(|lane| ends[lane].1[component].to_bits())
            }
            _ => return None,
        })
    }
}

/// What structures say of hits at the rays' times.
fn of_structures<T: Default>(
    subjects: &impl Subjects,
    limits: &Limits,
    read: impl Fn(Structure, &Hit, f32) -> T,
) -> Lanes<T> {
    let mut last = (0, None);
    std::array::from_fn(|lane| {
        if subjects.lanes() >> lane & 1 == 0 {
            return T::default();
        }
        let named = subjects.structure(lane);
        if named != last.0 {
            last = (named, limits.structure(named));
        }
        let hit = subjects.hit(lane);
        last.1.map_or_else(T::default, |structure| {
            read(structure, &hit, subjects.time(lane))
        })
    })
}

/// What structures say of the instances that were hit. Neighbours mostly meet the same one.
fn of_instances(
    subjects: &impl Subjects,
    limits: &Limits,
    read: impl Fn(Structure, u32, f32) -> [f32; 12],
) -> Lanes<[f32; 12]> {
    let mut last: Option<((u64, u32, u32), [f32; 12])> = None;
    std::array::from_fn(|lane| {
        if subjects.lanes() >> lane & 1 == 0 {
            return [0.0; 12];
        }
        let named = subjects.structure(lane);
        let (index, time) = (subjects.hit(lane).instance_index, subjects.time(lane));
        let asked = (named, index, time.to_bits());
        if let Some((before, matrix)) = last
            && before == asked
        {
            return matrix;
        }
        let structure = limits.structure(named);
        let matrix = structure.map_or([0.0; 12], |structure| read(structure, index, time));
        last = Some((asked, matrix));
        matrix
    })
}

/// A component of a 4 × 3 column-major shader matrix, from row-major 3 × 4 ones.
fn column_major(matrices: &Lanes<[f32; 12]>, component: usize) -> Row {
    std::array::from_fn(|lane| matrices[lane][component % 3 * 4 + component / 3].to_bits())
}

/// A component of a point (`w` is 1) or a direction (0) in an instance's space, by its row-major
/// world-to-object matrix.
fn to_object(matrix: &[f32; 12], component: usize, vector: &[f32; 3], w: f32) -> f32 {
    let row = &matrix[component * 4..][..4];
    row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2] + row[3] * w
}
