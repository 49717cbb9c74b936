//! Shared by both targets: geometries from bytes, and complete walks.

use arbitrary::Arbitrary;
use scenes::groups::Groups;
pub use scenes::{Bytes, IDENTITY, InstanceRecord, build_blob, build_instances, memory, sizes};
use traversal::*;

/// A geometry of any kind, out of bytes.
#[derive(Arbitrary, Clone, Debug)]
pub struct FuzzList {
    format: u8,
    index_type: u8,
    stride: u8,
    count: u16,
    first: u8,
    flags: u8,
    how: u8,
    transform: Option<[f32; 12]>,
    vertices: Vec<u8>,
    indices: Vec<u8>,
}

const FORMATS: [VertexFormat; 23] = {
    use VertexFormat::*;
    [
        F32x2,
        F32x3,
        F32x4,
        F16x2,
        F16x3,
        F16x4,
        F64x2,
        F64x3,
        F64x4,
        Snorm8x2,
        Snorm8x3,
        Snorm8x4,
        Unorm8x2,
        Unorm8x3,
        Unorm8x4,
        Snorm16x2,
        Snorm16x3,
        Snorm16x4,
        Unorm16x2,
        Unorm16x3,
        Unorm16x4,
        Unorm10x3A2,
        Snorm10x3A2,
    ]
};

impl FuzzList {
    /// Changes positions, and nothing that an update may not.
    pub fn move_by(&mut self, change: u8) {
        for byte in self.vertices.iter_mut().step_by(3) {
            *byte ^= change;
        }
    }

    /// Repeats what there is, a little changed, so that there are enough for the larger trees.
    pub fn repeat(&mut self, times: u8) {
        let once = self.vertices.clone();
        for i in 0..times % 16 {
            self.vertices
                .extend(once.iter().map(|byte| byte ^ i.wrapping_mul(37)));
        }
    }

    fn index_type(&self) -> IndexType {
        use IndexType::*;
        [None, U8, U16, U32][usize::from(self.index_type) % 4]
    }

    fn count(&self) -> u32 {
        u32::from(self.count) % 4096
    }

    pub fn triangles(&self) -> TriangleGeometry {
        TriangleGeometry {
            vertices: memory(&self.vertices),
            vertex_stride_bytes: self.stride.into(),
            vertex_format: FORMATS[usize::from(self.format) % FORMATS.len()],
            first_vertex: u32::from(self.first) % 4,
            index_type: self.index_type(),
            indices: memory(&self.indices),
            transform: self.transform,
            primitive_count: self.count(),
            flags: GeometryFlags(u32::from(self.flags) % 4),
            micromap: None,
        }
    }

    pub fn motion(&self) -> MotionGeometry {
        MotionGeometry {
            start: self.triangles(),
            end_vertices: memory(&self.indices),
        }
    }

    pub fn boxes(&self) -> AabbGeometry {
        AabbGeometry {
            boxes: memory(&self.vertices),
            stride_bytes: self.stride.into(),
            primitive_count: self.count(),
            flags: GeometryFlags(u32::from(self.flags) % 4),
        }
    }

    pub fn swept(&self) -> SweptGeometry {
        SweptGeometry {
            vertices: memory(&self.vertices),
            vertex_stride_bytes: self.stride.into(),
            vertex_format: FORMATS[usize::from(self.format) % FORMATS.len()],
            radii: memory(&self.indices),
            radius_stride_bytes: (self.how % 16).into(),
            radius_format: match self.how & 16 {
                0 => RadiusFormat::F32,
                _ => RadiusFormat::F16,
            },
            first_vertex: u32::from(self.first) % 4,
            index_type: self.index_type(),
            indices: memory(&self.indices),
            index_stride_bytes: (self.how / 16).into(),
            indexing: [Indexing::Spheres, Indexing::Pairs, Indexing::Successive]
                [usize::from(self.how / 32) % 3],
            end_caps: match self.how & 32 {
                0 => EndCaps::None,
                _ => EndCaps::Chained,
            },
            primitive_count: self.count(),
            flags: GeometryFlags(u32::from(self.flags) % 4),
        }
    }
}

/// A top level of one structure.
pub fn over(bottom: &Bytes, transform: [f32; 12], flags: u32) -> Bytes {
    build_instances(&[InstanceRecord::new(bottom, transform)], flags)
}

/// A ray out of numbers; every other one starts and goes where there may be something.
#[derive(Arbitrary, Clone, Copy, Debug)]
pub struct FuzzRay {
    numbers: [f32; 6],
    small: Option<[i8; 6]>,
    flags: u8,
}

impl FuzzRay {
    pub fn ray(&self, flags: u32) -> Ray {
        let numbers = match self.small {
            Some(small) => small.map(|number| f32::from(number) / 64.0),
            None => self.numbers,
        };
        let [a, b, c, d, e, f] = numbers;
        Ray {
            origin: [a, b, c],
            t_min: 0.0,
            direction: [d, e, f],
            t_max: f32::INFINITY,
            flags,
            cull_mask: 0xFF,
        }
    }

    pub fn flags(&self) -> u32 {
        self.flags.into()
    }
}

/// The walker of one of this machine's tiers, the best for 0.
pub fn walker(tier: u8) -> Box<Walker> {
    let tiers = [Tier::Avx512, Tier::Avx2, Tier::Portable];
    let mut available = tiers.into_iter().filter(|tier| tier.is_available()).cycle();
    let tier = available.nth(tier.into()).expect("one is always there");
    let options = Options {
        tier,
        ..Options::default()
    };
    Walker::with(options).expect("it is available")
}

/// Where a walk ends, by bits, and how many candidates there were, none of them accepted.
pub fn walked(
    walker: &mut Walker,
    top: &Bytes,
    ray: &Ray,
    fuel: u64,
) -> (Option<(u32, u32, u32)>, u32) {
    // SAFETY: the structures are alive.
    let mut walk = unsafe { Walk::new(top.address(), ray) };
    let (mut fuel, mut candidates) = (fuel, 0);
    loop {
        match walk.resume(walker, Verdict::Continue, &mut fuel) {
            Event::Done | Event::OutOfFuel => break,
            Event::AnyHitCandidate | Event::ProceduralCandidate => candidates += 1,
        }
    }
    let hit = walk.committed();
    let hit = hit.map(|hit| (hit.t.to_bits(), hit.geometry_index, hit.primitive_index));
    (hit, candidates)
}

/// Walks each ray with fifteen neighbours: as a packet that stops for candidates, all of which
/// count, and all in streams. To their ends or the end of fuel, of which each group has 65,536 to
/// begin with.
pub fn walked_together(walker: &mut Walker, top: &Bytes, rays: &[Ray], fuel: u64) {
    let with_neighbours = rays.iter().map(|ray| {
        let mut rows = RayRows::NONE;
        for lane in 0..PACKET {
            let mut ray = *ray;
            ray.origin[lane % 3] += lane as f32 / 512.0;
            rows.set(lane, top.address(), &ray, 0.0);
        }
        (rows, LaneMask::ALL)
    });
    let rows: Vec<_> = with_neighbours.collect();
    for in_streams in [false, true] {
        let decide = |_: &RayRows, group_walk: &mut GroupWalk| {
            let (found, built_in) = (
                group_walk.candidates().found,
                group_walk.candidates().built_in(),
            );
            group_walk.accept(built_in);
            let t = *group_walk.t_max();
            let counts = group_walk.counts(found - built_in, &t);
            group_walk.report(counts, &t, &[0; PACKET]);
        };
        let mut groups =
            Groups::of_rows(rows.clone(), decide).with(|start| start.shows_first_hit = in_streams);
        (groups.refills, groups.rounds) = ((fuel >> 16) as usize, 256);
        let at_once = if in_streams { rays.len().max(1) } else { 1 };
        // SAFETY: the structures are alive.
        unsafe { groups.trace(walker, at_once) };
    }
}
