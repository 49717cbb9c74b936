//! Our own structures, as an application of the driver has them: a bottom level under one identity
//! instance.

use std::convert::Infallible;

use anyhow::{Context, Result};
use scenes::{Bytes, IDENTITY, InstanceRecord, Mesh, build_instances};
use traversal::{
    BuildFlags, BuildInput, Geometries, GroupWalk, GroupWalks, Hit, Kind, LaneMask, PACKET, Ray,
    RayRows, Start, Verdict, Walk, Walker, build, build_sizes,
};

/// Memory for the bottom level of a mesh, taken before the clock starts, as applications do.
pub struct StructureMemory {
    flags: BuildFlags,
    blob: Bytes,
    scratch: Bytes,
}

impl StructureMemory {
    pub fn new(mesh: &Mesh, flags: u32) -> StructureMemory {
        let flags = BuildFlags(flags);
        let sizes = build_sizes(Kind::Triangles, flags, &[mesh.indices.len() as u32]);
        StructureMemory {
            flags,
            blob: Bytes::new(sizes.structure_bytes),
            scratch: Bytes::new(sizes.build_scratch_bytes),
        }
    }

    /// Bytes that were reported for structure and scratch.
    pub fn reported(&self) -> [usize; 2] {
        [self.blob.len(), self.scratch.len()]
    }

    /// Builds the bottom level; returns the bytes in use.
    pub fn build(&mut self, mesh: &Mesh) -> Result<u64> {
        let list = [mesh.geometry()];
        let input = BuildInput {
            flags: self.flags,
            geometries: Geometries::Triangles(&list),
        };
        // SAFETY: the mesh is borrowed.
        unsafe { build(&input, &mut self.blob, &mut self.scratch) }.context("building")
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

/// The rays of a batch, and their hits.
struct Batch<'a> {
    top_level: u64,
    rays: &'a [Ray],
    group_walks: Vec<GroupWalk>,
    in_turn: bool,
}

impl GroupWalks for Batch<'_> {
    type Stop = Infallible;

    fn rays(&self, group: u32, rows: &mut RayRows) -> Start {
        let rays = &self.rays[group as usize * PACKET..];
        let rays = &rays[..rays.len().min(PACKET)];
        for (lane, ray) in rays.iter().enumerate() {
            rows.set(lane, self.top_level, ray, 0.0);
        }
        Start {
            lanes: LaneMask::full(rays.len()),
            are_alike: false,
            shows_first_hit: self.in_turn,
            shows_order: false,
        }
    }

    fn group_walk(&mut self, group: u32) -> &mut GroupWalk {
        &mut self.group_walks[group as usize]
    }

    fn settled(&mut self, _: u32) -> Result<(), Infallible> {
        Ok(())
    }

    fn out_of_fuel(&mut self, _: u32) -> Result<(), Infallible> {
        Ok(())
    }
}

/// A structure of two levels.
pub struct Tuff {
    pub bytes: u64,
    pub reported: [usize; 2],
    _bottom: Bytes,
    top: Bytes,
}

impl Tuff {
    pub fn new(mesh: &Mesh, mut place: StructureMemory) -> Result<Tuff> {
        let bytes = place.build(mesh)?;
        let instance = InstanceRecord::new(&place.blob, IDENTITY);
        let top = build_instances(&[instance], place.flags.0);
        Ok(Tuff {
            bytes,
            reported: place.reported(),
            _bottom: place.blob,
            top,
        })
    }

    /// Walks rays to their ends in lists of one subgroup's, as many together as the driver has in
    /// one batch.
    fn walk(&self, rays: &[Ray], how: How, mut done: impl FnMut(Option<&Hit>)) {
        let mut walker = Walker::new();
        let mut batch = Batch {
            top_level: self.top.address(),
            rays: &[],
            group_walks: (0..BATCH).map(|_| GroupWalk::default()).collect(),
            in_turn: how != How::Packets,
        };
        let all: Vec<u32> = (0..BATCH as u32).collect();
        let at_once = if how == How::Lists { 1 } else { BATCH };
        for rays in rays.chunks(BATCH * PACKET) {
            batch.rays = rays;
            for groups in all[..rays.len().div_ceil(PACKET)].chunks(at_once) {
                // SAFETY: the structures are alive and stay as they are.
                let Ok(()) = unsafe { walker.trace(groups, &[], &mut batch) };
            }
            for i in 0..rays.len() {
                done(batch.group_walks[i / PACKET].hits.get(i % PACKET).as_ref());
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
            // SAFETY: the structures are alive and stay as they are.
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
