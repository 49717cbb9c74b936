//! Our own structures, as an application of the driver has them: a bottom level under one identity
//! instance.

use anyhow::{Context, Result};
use traversal::{
    BuildFlags, BuildInput, Caller, Event, Geometries, GeometryFlags, Hit, HitRows, IndexType,
    InstanceArray, InstanceSource, Kind, Memory, PACKET, Ray, RayRows, TriangleGeometry, Verdict,
    VertexFormat, Walk, Walker, build, build_sizes,
};

use super::mesh::Mesh;

/// A 256-byte line of a blob.
#[derive(Clone, Copy)]
#[repr(align(256))]
struct Line(#[allow(dead_code, reason = "written through pointers")] [u8; 256]);

/// Memory of a structure or for a build.
pub struct Blob(Vec<Line>);

impl Blob {
    fn new(bytes: u64) -> Blob {
        Blob(vec![Line([0; 256]); bytes.div_ceil(256) as usize])
    }

    fn bytes(&mut self) -> &mut [u8] {
        // SAFETY: as long as the lines.
        unsafe { std::slice::from_raw_parts_mut(self.0.as_mut_ptr().cast(), 256 * self.0.len()) }
    }

    fn address(&self) -> u64 {
        self.0.as_ptr().expose_provenance() as u64
    }
}

fn memory<T>(slice: &[T]) -> Memory {
    Memory {
        base: slice.as_ptr().cast(),
        bytes: size_of_val(slice),
    }
}

/// Memory for the bottom level of a mesh, taken before the clock starts, as applications do.
pub struct Place {
    flags: BuildFlags,
    blob: Blob,
    scratch: Blob,
}

impl Place {
    pub fn new(mesh: &Mesh, flags: u32) -> Place {
        let flags = BuildFlags(flags);
        let sizes = build_sizes(Kind::Triangles, flags, &[mesh.indices.len() as u32]);
        Place {
            flags,
            blob: Blob::new(sizes.structure_bytes),
            scratch: Blob::new(sizes.build_scratch_bytes),
        }
    }

    /// Bytes that were reported for structure and scratch.
    pub fn reported(&self) -> [usize; 2] {
        [256 * self.blob.0.len(), 256 * self.scratch.0.len()]
    }

    /// Builds the bottom level; returns the bytes in use.
    pub fn build(&mut self, mesh: &Mesh) -> Result<u64> {
        let list = [TriangleGeometry {
            vertices: memory(&mesh.vertices),
            vertex_stride_bytes: 12,
            vertex_format: VertexFormat::F32x3,
            first_vertex: 0,
            index_type: IndexType::U32,
            indices: memory(&mesh.indices),
            transform: None,
            primitive_count: mesh.indices.len() as u32,
            flags: GeometryFlags(GeometryFlags::OPAQUE),
            micromap: None,
        }];
        let input = BuildInput {
            flags: self.flags,
            geometries: Geometries::Triangles(&list),
        };
        // SAFETY: the mesh is borrowed.
        unsafe { build(&input, self.blob.bytes(), self.scratch.bytes()) }.context("building")
    }
}

/// Subgroups whose rays the driver has at one trace instruction, at most.
const BATCH: usize = 256;

/// How rays are walked.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum How {
    /// Coherent ones by sixteen, others in streams: what the driver does.
    Packets,
    /// All in streams.
    Streams,
    /// In turn.
    Lists,
}

/// The hits of a batch.
struct Found(Vec<HitRows>);

impl Caller for Found {
    fn hit(&mut self, group: u32, lane: usize, hit: &Hit) {
        self.0[group as usize].set(lane, hit);
    }

    fn rays(&mut self, _: u32, _: &mut RayRows) {}

    fn suspend(&mut self, _: u32, _: usize, _: &mut Walk, _: Event) {}
}

/// A structure of two levels.
pub struct Tuff {
    pub bytes: u64,
    pub reported: [usize; 2],
    _bottom: Blob,
    top: Blob,
}

impl Tuff {
    pub fn new(mesh: &Mesh, mut place: Place) -> Result<Tuff> {
        let bytes = place.build(mesh)?;
        let mut record = [0u32; 16];
        for diagonal in [0, 5, 10] {
            record[diagonal] = 1f32.to_bits();
        }
        record[12] = 0xFF << 24;
        let reference = place.blob.address();
        (record[14], record[15]) = (reference as u32, (reference >> 32) as u32);
        let input = BuildInput {
            flags: place.flags,
            geometries: Geometries::Instances(InstanceSource {
                memory: memory(&record),
                array: InstanceArray::Records,
                count: 1,
                flags: GeometryFlags(0),
                live: &traversal::EVERYWHERE,
            }),
        };
        let sizes = build_sizes(Kind::Instances, place.flags, &[1]);
        let mut top = Blob::new(sizes.structure_bytes);
        let mut scratch = Blob::new(sizes.build_scratch_bytes);
        // SAFETY: the record is borrowed, and the bottom level is built.
        unsafe { build(&input, top.bytes(), scratch.bytes()) }.context("building the top level")?;
        Ok(Tuff {
            bytes,
            reported: place.reported(),
            _bottom: place.blob,
            top,
        })
    }

    /// Walks rays to their ends in lists of one subgroup's, as many together as the driver has in one batch.
    fn walk(&self, rays: &[Ray], how: How, mut done: impl FnMut(Option<&Hit>)) {
        let mut walker = Walker::new();
        let mut rows = RayRows::NONE;
        let mut found = Found(vec![HitRows::default(); BATCH]);
        for rays in rays.chunks(BATCH * PACKET) {
            for (group, rays) in rays.chunks(PACKET).enumerate() {
                for (lane, ray) in rays.iter().enumerate() {
                    rows.set(lane, self.top.address(), ray, 0.0);
                }
                let lanes = u16::MAX >> (PACKET - rays.len());
                let hits = &mut found.0[group];
                let group = group as u32;
                let fuel = &mut { u64::MAX };
                let never = &mut |_, _: &mut Walk, _| {};
                // SAFETY: the structures are alive and stay as they are.
                unsafe {
                    if how == How::Packets && walker.trace_together(&rows, lanes, hits) {
                        continue;
                    }
                    let streamed = match how {
                        How::Packets | How::Streams => {
                            walker.add_to_stream(&rows, lanes, hits, group)
                        }
                        How::Lists => 0,
                    };
                    if streamed != lanes {
                        walker.trace_in_turn(&rows, lanes & !streamed, hits, fuel, never);
                    }
                }
            }
            // SAFETY: as above.
            unsafe { walker.trace_streams(&mut { u64::MAX }, &mut found) };
            for i in 0..rays.len() {
                done(found.0[i / PACKET].get(i % PACKET).as_ref());
            }
        }
    }

    /// Walks each ray by itself; returns how many hit and the sum of their distances.
    pub fn trace_singly(&self, rays: &[Ray]) -> (usize, f64) {
        let mut walker = Walker::new();
        let (mut hits, mut sum) = (0, 0.0);
        // SAFETY: the structures are alive and stay as they are.
        let mut walk = unsafe { Walk::new(0, &Ray::default()) };
        for ray in rays {
            // SAFETY: as above.
            unsafe { walk.restart(self.top.address(), ray) };
            walk.resume(&mut walker, Verdict::Continue, &mut { u64::MAX });
            if let Some(hit) = walk.committed() {
                hits += 1;
                sum += f64::from(hit.t);
            }
        }
        (hits, sum)
    }

    /// The closest hit of each ray.
    pub fn hits(&self, rays: &[Ray]) -> Vec<Option<Hit>> {
        let mut hits = Vec::with_capacity(rays.len());
        self.walk(rays, How::Lists, |hit| hits.push(hit.copied()));
        hits
    }

    /// Walks rays; returns how many hit and the sum of their distances.
    pub fn trace(&self, rays: &[Ray], how: How) -> (usize, f64) {
        let (mut hits, mut sum) = (0, 0.0);
        self.walk(rays, how, |hit| {
            if let Some(hit) = hit {
                hits += 1;
                sum += f64::from(hit.t);
            }
        });
        (hits, sum)
    }
}
