//! Scenes for tests: aligned memory, meshes, instances, and walking them to the end.

pub mod closed;
pub mod decisions;
pub mod exact;
pub mod groups;
pub mod hard;
pub mod odd;
mod shapes;
pub mod surface;
pub mod ways;

use std::alloc::Layout;
use std::ops::{Deref, DerefMut};

use glam::DVec4;
pub use glam::{DMat3, DVec3};
use traversal::*;

/// Memory at a 256-byte boundary of exactly some length: a sanitizer sees who leaves it.
pub struct Bytes {
    start: *mut u8,
    length: usize,
}

// SAFETY: it owns its memory.
unsafe impl Send for Bytes {}
// SAFETY: without a mutable reference it is only read.
unsafe impl Sync for Bytes {}

impl Bytes {
    pub fn new(length: u64) -> Bytes {
        let length = length as usize;
        // SAFETY: never empty.
        let start = unsafe { std::alloc::alloc(Bytes::layout(length)) };
        assert!(!start.is_null());
        // As an application's memory may be.
        // SAFETY: as long as that.
        unsafe { start.write_bytes(0xAA, length) };
        Bytes { start, length }
    }

    fn layout(length: usize) -> Layout {
        Layout::from_size_align(length.max(1), 256).unwrap()
    }

    pub fn address(&self) -> u64 {
        self.start.expose_provenance() as u64
    }
}

impl Drop for Bytes {
    fn drop(&mut self) {
        // SAFETY: allocated with that layout.
        unsafe { std::alloc::dealloc(self.start, Bytes::layout(self.length)) }
    }
}

impl Deref for Bytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        // SAFETY: as long as that, and written.
        unsafe { std::slice::from_raw_parts(self.start, self.length) }
    }
}

impl DerefMut for Bytes {
    fn deref_mut(&mut self) -> &mut [u8] {
        // SAFETY: as long as that, and written; this is the only reference.
        unsafe { std::slice::from_raw_parts_mut(self.start, self.length) }
    }
}

pub fn memory<T>(slice: &[T]) -> Memory {
    Memory {
        base: slice.as_ptr().cast(),
        bytes: size_of_val(slice),
    }
}

#[derive(Clone, Debug, Default)]
pub struct Mesh {
    pub vertices: Vec<[f32; 3]>,
    pub indices: Vec<[u32; 3]>,
    pub opaque: bool,
}

impl Mesh {
    /// An [`icosphere`] whose points are moved.
    pub fn icosphere(levels: u32, opaque: bool, place: impl Fn(DVec3) -> DVec3) -> Mesh {
        let (points, indices) = icosphere(levels);
        Mesh {
            vertices: points.into_iter().map(|p| narrow(place(p))).collect(),
            indices,
            opaque,
        }
    }

    pub fn geometry(&self) -> TriangleGeometry {
        TriangleGeometry {
            vertices: memory(&self.vertices),
            vertex_stride_bytes: 12,
            vertex_format: VertexFormat::F32x3,
            first_vertex: 0,
            index_type: IndexType::U32,
            indices: memory(&self.indices),
            transform: None,
            primitive_count: self.indices.len() as u32,
            // Tests count candidates.
            flags: GeometryFlags(match self.opaque {
                true => GeometryFlags::OPAQUE,
                false => GeometryFlags::NO_DUPLICATE_ANY_HIT_INVOCATION,
            }),
            micromap: None,
        }
    }

    pub fn triangle(&self, index: usize) -> [[f32; 3]; 3] {
        self.indices[index].map(|i| self.vertices[i as usize])
    }
}

/// The builds that differ in their trees.
pub const QUALITIES: [u32; 4] = [
    0,
    BuildFlags::PREFER_FAST_BUILD,
    BuildFlags::PREFER_FAST_TRACE,
    BuildFlags::LOW_MEMORY,
];

/// The memory that a build and a later update need.
pub fn sizes(input: &BuildInput<'_>) -> BuildSizes {
    fn counts<T>(list: &[T], count: impl Fn(&T) -> u32) -> Vec<u32> {
        list.iter().map(count).collect()
    }
    let (kind, counts) = match &input.geometries {
        Geometries::Triangles(list) => (Kind::Triangles, counts(list, |g| g.primitive_count)),
        Geometries::Aabbs(list) => (Kind::Aabbs, counts(list, |g| g.primitive_count)),
        Geometries::Swept(list) => (Kind::Swept, counts(list, |g| g.primitive_count)),
        Geometries::Motion(list) => (Kind::Motion, counts(list, |g| g.start.primitive_count)),
        Geometries::Instances(source) if source.array.is_motion() => {
            (Kind::MotionInstances, vec![source.count])
        }
        Geometries::Instances(source) => (Kind::Instances, vec![source.count]),
    };
    build_sizes(kind, input.flags, &counts)
}

/// Builds with memory of exactly the promised sizes.
pub fn build_blob(input: &BuildInput<'_>) -> Bytes {
    let sizes = sizes(input);
    let mut blob = Bytes::new(sizes.structure_bytes);
    let mut scratch = Bytes::new(sizes.build_scratch_bytes);
    // SAFETY: the geometries' memory is borrowed by the caller.
    let used = unsafe { build(input, &mut blob, &mut scratch) }.expect("the build succeeds");
    assert!(used <= sizes.structure_bytes);
    validate(&blob).expect("what was built is valid");
    blob
}

pub fn build_meshes(meshes: &[Mesh], flags: u32) -> Bytes {
    let list: Vec<_> = meshes.iter().map(Mesh::geometry).collect();
    build_blob(&BuildInput {
        flags: BuildFlags(flags),
        geometries: Geometries::Triangles(&list),
    })
}

pub fn build_boxes(boxes: &[[f32; 6]], opaque: bool, flags: u32) -> Bytes {
    build_blob(&BuildInput {
        flags: BuildFlags(flags),
        geometries: Geometries::Aabbs(&[AabbGeometry {
            boxes: memory(boxes),
            stride_bytes: 24,
            primitive_count: boxes.len() as u32,
            flags: GeometryFlags(u32::from(opaque)),
        }]),
    })
}

#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct InstanceRecord {
    pub transform: [f32; 12],
    pub custom_index_and_mask: u32,
    pub sbt_offset_and_flags: u32,
    pub reference: u64,
}

pub const IDENTITY: [f32; 12] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];

impl InstanceRecord {
    pub fn new(blob: &Bytes, transform: [f32; 12]) -> InstanceRecord {
        InstanceRecord {
            transform,
            custom_index_and_mask: 0xFF00_0000,
            sbt_offset_and_flags: 0,
            reference: blob.address(),
        }
    }
}

pub fn build_instances(instances: &[InstanceRecord], flags: u32) -> Bytes {
    build_blob(&BuildInput {
        flags: BuildFlags(flags),
        geometries: Geometries::Instances(InstanceSource {
            memory: memory(instances),
            array: InstanceArray::Records,
            count: instances.len() as u32,
            flags: GeometryFlags(0),
            live: &EVERYWHERE,
        }),
    })
}

/// An instance whose transform is one matrix at time 0 and another at time 1:
/// `VkAccelerationStructureMotionInstanceNV`.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct MotionRecord {
    ty: u32,
    flags: u32,
    transforms: [[f32; 12]; 2],
    custom_index_and_mask: u32,
    sbt_offset_and_flags: u32,
    reference: u64,
    rest: [u64; 5],
}

const _: () = assert!(size_of::<MotionRecord>() == 160);

impl MotionRecord {
    pub fn new(blob: &Bytes, transforms: [[f32; 12]; 2]) -> MotionRecord {
        MotionRecord {
            // VK_ACCELERATION_STRUCTURE_MOTION_INSTANCE_TYPE_MATRIX_MOTION_NV
            ty: 1,
            flags: 0,
            transforms,
            custom_index_and_mask: 0xFF00_0000,
            sbt_offset_and_flags: 0,
            reference: blob.address(),
            rest: [0; 5],
        }
    }
}

pub fn build_moving_instances(instances: &[MotionRecord], flags: u32) -> Bytes {
    build_blob(&BuildInput {
        flags: BuildFlags(flags),
        geometries: Geometries::Instances(InstanceSource {
            memory: memory(instances),
            array: InstanceArray::MotionRecords,
            count: instances.len() as u32,
            flags: GeometryFlags(0),
            live: &EVERYWHERE,
        }),
    })
}

/// A bottom level under one identity instance.
pub struct Scene {
    pub bottom: Bytes,
    pub top: Bytes,
}

impl Scene {
    pub fn new(meshes: &[Mesh], flags: u32) -> Scene {
        Self::placed(meshes, flags, IDENTITY)
    }

    pub fn placed(meshes: &[Mesh], flags: u32, transform: [f32; 12]) -> Scene {
        let bottom = build_meshes(meshes, flags);
        let top = build_instances(&[InstanceRecord::new(&bottom, transform)], flags);
        Scene { bottom, top }
    }
}

pub fn ray(origin: [f32; 3], direction: [f32; 3]) -> Ray {
    Ray {
        origin,
        t_min: 0.0,
        direction,
        t_max: f32::INFINITY,
        flags: 0,
        cull_mask: 0xFF,
    }
}

/// The closest hit; every any-hit candidate is accepted, boxes are ignored.
pub fn closest(top: &Bytes, ray: &Ray) -> Option<Hit> {
    let mut walker = Walker::new();
    closest_with(&mut walker, top, ray)
}

pub fn closest_with(walker: &mut Walker, top: &Bytes, ray: &Ray) -> Option<Hit> {
    // SAFETY: the structures are alive.
    let mut walk = unsafe { Walk::new(top.address(), ray) };
    let mut verdict = Verdict::Continue;
    loop {
        verdict = match walk.resume(walker, verdict, &mut u64::MAX.clone()) {
            Event::Done => return walk.committed().copied(),
            Event::AnyHitCandidate => Verdict::Accept,
            Event::ProceduralCandidate => Verdict::Continue,
            Event::OutOfFuel => unreachable!("there is enough"),
        };
    }
}

/// Every candidate that is not opaque, none accepted.
pub fn candidates(top: &Bytes, ray: &Ray) -> Vec<Hit> {
    candidates_with(&mut Walker::new(), top, ray)
}

/// As [`candidates`].
pub fn candidates_with(walker: &mut Walker, top: &Bytes, ray: &Ray) -> Vec<Hit> {
    // SAFETY: the structures are alive.
    let mut walk = unsafe { Walk::new(top.address(), ray) };
    let mut found = Vec::new();
    while walk.resume(walker, Verdict::Continue, &mut u64::MAX.clone()) != Event::Done {
        found.push(*walk.candidate());
    }
    found
}

/// xorshift: a sequence of numbers in [0, 1) that stays, since what is measured with it is on
/// record.
pub struct Random(pub u64);

impl Random {
    /// From 0 to below 1.
    pub fn unit(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.signed(), self.signed(), self.signed())
    }

    pub fn direction(&mut self) -> DVec3 {
        loop {
            let v = self.vector();
            if (1e-3..1.0).contains(&v.length_squared()) {
                return normalize(v);
            }
        }
    }
}

/// The corners of an icosahedron, not of unit length.
pub fn icosahedron() -> [[f64; 3]; 12] {
    let p = (1.0 + 5f64.sqrt()) / 2.0;
    [
        [-1.0, p, 0.0],
        [1.0, p, 0.0],
        [-1.0, -p, 0.0],
        [1.0, -p, 0.0],
        [0.0, -1.0, p],
        [0.0, 1.0, p],
        [0.0, -1.0, -p],
        [0.0, 1.0, -p],
        [p, 0.0, -1.0],
        [p, 0.0, 1.0],
        [-p, 0.0, -1.0],
        [-p, 0.0, 1.0],
    ]
}

/// Its faces.
pub const ICOSAHEDRON: [[u32; 3]; 20] = [
    [0, 11, 5],
    [0, 5, 1],
    [0, 1, 7],
    [0, 7, 10],
    [0, 10, 11],
    [1, 5, 9],
    [5, 11, 4],
    [11, 10, 2],
    [10, 7, 6],
    [7, 1, 8],
    [3, 9, 4],
    [3, 4, 2],
    [3, 2, 6],
    [3, 6, 8],
    [3, 8, 9],
    [4, 9, 5],
    [2, 4, 11],
    [6, 2, 10],
    [8, 6, 7],
    [9, 8, 1],
];

/// A closed sphere: an icosahedron whose faces are split `levels` times. Unit radius, f64.
pub fn icosphere(levels: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let mut vertices = icosahedron().map(normalize).to_vec();
    let mut faces = ICOSAHEDRON.to_vec();
    for _ in 0..levels {
        let mut middles = std::collections::HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let (p, q) = (vertices[a as usize], vertices[b as usize]);
                vertices.push(normalize(p + q));
                vertices.len() as u32 - 1
            })
        };
        faces = faces
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
            })
            .collect();
    }
    (vertices, faces)
}

/// Divided by the length, where glam multiplies by its inverse.
pub fn normalize(v: impl Into<DVec3>) -> DVec3 {
    let v = v.into();
    v / v.length()
}

pub fn wide(v: [f32; 3]) -> DVec3 {
    DVec3::from(v.map(f64::from))
}

pub fn narrow(v: impl Into<DVec3>) -> [f32; 3] {
    v.into().to_array().map(|c| c as f32)
}

/// A row-major 3 × 4 matrix applied to a place (w = 1) or a direction (w = 0), in f64.
pub fn apply(matrix: &[f32; 12], v: DVec3, w: f64) -> DVec3 {
    let row = |row: &[f32; 4]| DVec4::from(row.map(f64::from)).dot(v.extend(w));
    let (rows, _) = matrix.as_chunks::<4>();
    DVec3::new(row(&rows[0]), row(&rows[1]), row(&rows[2]))
}

/// Möller and Trumbore's intersection in f64: (t, u, v) of the plane's point, and how far inside
/// the triangle it is (the least weight).
pub fn reference(ray: &Ray, triangle: &[[f32; 3]; 3]) -> (f64, f64, f64, f64) {
    let [a, b, c] = triangle.map(wide);
    let (o, d) = (wide(ray.origin), wide(ray.direction));
    let (e1, e2) = (b - a, c - a);
    let p = d.cross(e2);
    let determinant = e1.dot(p);
    let s = o - a;
    let q = s.cross(e1);
    let (t, u, v) = (
        e2.dot(q) / determinant,
        s.dot(p) / determinant,
        d.dot(q) / determinant,
    );
    (t, u, v, u.min(v).min(1.0 - u - v))
}
