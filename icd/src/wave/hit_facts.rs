//! Facts about hits ([`Fact`]) for built-ins of hit shaders, ray queries and hit objects. Hits hold
//! most of them ([`take`]); the rest is in the structures ([`CachedFacts`]).

use std::cell::OnceCell;

use lanes::{LaneMask, by_lane};
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::facts::Fact;
use spirv_jit::hit_object::primitive;
use spirv_jit::program::Row;
use traversal::ray::HIT_KIND_FRONT_FACING_TRIANGLE;
use traversal::{Hit, HitRows, Structure, Swept};

use super::limits::Limits;
use super::rows::bits_of;

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

/// The hits of some lanes. Rows may have anything in other lanes.
pub trait Subjects {
    /// Lanes that have one.
    fn lanes(&self) -> LaneMask;
    /// Addresses of the top levels: their lower and upper words.
    fn structures(&self) -> [Row; 2];
    /// When the rays are cast.
    fn times(&self) -> Lanes<f32>;
    /// Indices of the instances that were hit.
    fn instances(&self) -> Row;
    fn hit(&self, lane: usize) -> Hit;
    /// Components of the rays' origins.
    fn origins(&self) -> [Lanes<f32>; 3];
    /// Components of the rays' directions.
    fn directions(&self) -> [Lanes<f32>; 3];
}

/// Row-major 3 × 4 matrices.
enum Matrices {
    /// One for all lanes.
    Same([f32; 12]),
    Each(Box<[Lanes<f32>; 12]>),
}

impl Matrices {
    #[inline(always)]
    fn row(&self, element: usize) -> Lanes<f32> {
        match self {
            Self::Same(matrix) => [matrix[element]; SUBGROUP_SIZE],
            Self::Each(rows) => rows[element],
        }
    }
}

/// Facts from structures about the hits of some lanes, looked up once, on demand.
#[derive(Default)]
pub struct CachedFacts {
    object_to_world: OnceCell<Matrices>,
    world_to_object: OnceCell<Matrices>,
    /// Rows of the rays in the instances' spaces.
    object_origins: OnceCell<[Row; 3]>,
    object_directions: OnceCell<[Row; 3]>,
    vertices: OnceCell<Lanes<[[f32; 3]; 3]>>,
    ends: OnceCell<Lanes<([[f32; 3]; 2], [f32; 2])>>,
}

impl CachedFacts {
    /// A word of a fact that structures tell: see [`Self::write_row`].
    pub fn row(
        &self,
        subjects: &impl Subjects,
        limits: &Limits,
        fact: Fact,
        component: usize,
    ) -> Row {
        let mut row = [0; SUBGROUP_SIZE];
        self.write_row(subjects, limits, fact, component, &mut row);
        row
    }

    /// Writes a word of a fact that structures tell, of the same subjects each time; zeros of any
    /// other.
    #[inline(always)]
    pub fn write_row(
        &self,
        subjects: &impl Subjects,
        limits: &Limits,
        fact: Fact,
        component: usize,
        to: &mut Row,
    ) {
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
        *to = match fact {
            Fact::ObjectToWorld => column_major(object_to_world(), component),
            Fact::WorldToObject => column_major(world_to_object(), component),
            Fact::ObjectRayOrigin => {
                let origins = || to_object(world_to_object(), &subjects.origins(), 1.0);
                self.object_origins.get_or_init(origins)[component]
            }
            Fact::ObjectRayDirection => {
                let directions = || to_object(world_to_object(), &subjects.directions(), 0.0);
                self.object_directions.get_or_init(directions)[component]
            }
            Fact::TriangleVertexPositions => {
                let vertices = self.vertices.get_or_init(|| {
                    of_structures(subjects, limits, |s, hit, time| {
                        s.triangle_vertices_at(hit, time, live)
                    })
                });
                let coordinate = |v: &[[f32; 3]; 3]| v[component / 3][component % 3].to_bits();
                by_lane(|lane| coordinate(&vertices[lane]))
            }
            Fact::SweptPositions => {
                let ends = ends();
                by_lane(|lane| ends[lane].0.as_flattened()[component].to_bits())
            }
            Fact::SweptRadii => {
                let ends = ends();
                by_lane(|lane| ends[lane].1[component].to_bits())
            }
            _ => [0; SUBGROUP_SIZE],
        };
    }
}

/// Addresses by lane, of their lower and upper words.
pub fn addresses([low, high]: &[Row; 2]) -> Lanes<u64> {
    by_lane(|lane| u64::from(low[lane]) | u64::from(high[lane]) << 32)
}

/// Facts from structures about hits at the rays' times.
fn of_structures<T: Copy + Default>(
    subjects: &impl Subjects,
    limits: &Limits,
    read: impl Fn(Structure, &Hit, f32) -> T,
) -> Lanes<T> {
    let (structures, times) = (addresses(&subjects.structures()), subjects.times());
    let mut last = (0, None);
    by_lane(|lane| {
        if !subjects.lanes().contains(lane) {
            return T::default();
        }
        let named = structures[lane];
        if named != last.0 {
            last = (named, limits.structure(named));
        }
        let hit = subjects.hit(lane);
        last.1
            .map_or_else(T::default, |structure| read(structure, &hit, times[lane]))
    })
}

/// Facts from structures about the instances that were hit, looked up once for lanes that hit the
/// same instance at the same time.
fn of_instances(
    subjects: &impl Subjects,
    limits: &Limits,
    read: impl Fn(Structure, u32, f32) -> [f32; 12],
) -> Matrices {
    let lanes = subjects.lanes();
    let (named, instances) = (subjects.structures(), subjects.instances());
    let times = subjects.times();
    let telling = [named[0], named[1], instances, bits_of(&times)];
    let structures = addresses(&named);
    let mut matrices: Option<Box<[Lanes<f32>; 12]>> = None;
    let mut rest = lanes;
    while let Some(first) = rest.iter().next() {
        let same = (telling.iter()).fold(LaneMask::ALL, |same, row| {
            same & LaneMask::holding(row, row[first])
        });
        let structure = limits.structure(structures[first]);
        let matrix = structure.map_or([0.0; 12], |structure| {
            read(structure, instances[first], times[first])
        });
        if (lanes - same).is_empty() {
            return Matrices::Same(matrix);
        }
        let matrices = matrices.get_or_insert_default();
        for lane in rest & same {
            for (row, number) in matrices.iter_mut().zip(matrix) {
                row[lane] = number;
            }
        }
        rest -= same;
    }
    matrices.map_or(Matrices::Same([0.0; 12]), Matrices::Each)
}

/// A component of 4 × 3 column-major shader matrices.
fn column_major(matrices: &Matrices, component: usize) -> Row {
    bits_of(&matrices.row(component % 3 * 4 + component / 3))
}

/// Points (`w` is 1) or directions (0) in instances' spaces, by their world-to-object matrices.
fn to_object(matrices: &Matrices, vectors: &[Lanes<f32>; 3], w: f32) -> [Row; 3] {
    match matrices {
        Matrices::Same(matrix) => times(|element, _| matrix[element], vectors, w),
        Matrices::Each(rows) => times(|element, lane| rows[element][lane], vectors, w),
    }
}

/// Matrices times vectors, lane by lane.
#[inline(always)]
fn times(matrix: impl Fn(usize, usize) -> f32, [x, y, z]: &[Lanes<f32>; 3], w: f32) -> [Row; 3] {
    let mut rows = [[0; SUBGROUP_SIZE]; 3];
    for (row, at) in rows.iter_mut().zip([0usize, 4, 8]) {
        for lane in 0..SUBGROUP_SIZE {
            let element = |k| matrix(at + k, lane);
            let sum = element(0) * x[lane] + element(1) * y[lane] + element(2) * z[lane];
            row[lane] = (sum + element(3) * w).to_bits();
        }
    }
    rows
}
