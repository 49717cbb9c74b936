//! Acceleration structures for ray tracing on the CPU: build, lay out, intersect, walk.
//!
//! An acceleration structure is one contiguous, relocatable blob in memory that the caller owns
//! (see [`structure`]). A *bottom level* holds triangles or boxes, a *top level* holds instances:
//! a transform, a mask, and the address of a bottom level. [`build_sizes`] says how much memory a
//! build needs at most, [`build()`] fills it, and a [`Walk`] takes one ray through it.
//!
//! The crate knows no graphics API: addresses are host addresses, formats and flags are its own
//! types with the values and the meaning that Vulkan gives them.
//!
//! ```
//! use traversal::*;
//!
//! /// Memory at a 256-byte boundary.
//! #[repr(align(256))]
//! #[derive(Clone, Copy)]
//! struct Line([u8; 256]);
//! fn bytes(lines: &mut [Line]) -> &mut [u8] {
//!     unsafe { std::slice::from_raw_parts_mut(lines.as_mut_ptr().cast(), 256 * lines.len()) }
//! }
//! fn built(kind: Kind, count: u32, geometries: Geometries) -> Vec<Line> {
//!     let flags = BuildFlags(BuildFlags::PREFER_FAST_TRACE);
//!     let sizes = build_sizes(kind, flags, &[count]);
//!     let mut blob = vec![Line([0; 256]); sizes.structure_bytes.div_ceil(256) as usize];
//!     let mut scratch = vec![0; sizes.build_scratch_bytes as usize];
//!     let input = BuildInput { flags, geometries };
//!     unsafe { build(&input, bytes(&mut blob), &mut scratch) }.unwrap();
//!     blob
//! }
//!
//! let vertices = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
//! let triangles = [TriangleGeometry {
//!     vertices: Memory { base: vertices.as_ptr().cast(), bytes: 36 },
//!     vertex_stride_bytes: 12,
//!     vertex_format: VertexFormat::F32x3,
//!     first_vertex: 0,
//!     index_type: IndexType::None,
//!     indices: Memory { base: std::ptr::null(), bytes: 0 },
//!     transform: None,
//!     primitive_count: 1,
//!     flags: GeometryFlags(GeometryFlags::OPAQUE),
//!     micromap: None,
//! }];
//! let bottom = built(Kind::Triangles, 1, Geometries::Triangles(&triangles));
//!
//! // One instance, at x = 10: a transform, mask and custom index, offset and flags, reference.
//! let mut record = [0u8; 64];
//! let transform = [1.0f32, 0.0, 0.0, 10.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
//! for (place, element) in record.chunks_exact_mut(4).zip(transform) {
//!     place.copy_from_slice(&element.to_le_bytes());
//! }
//! record[51] = 0xFF;
//! let reference = bottom.as_ptr().expose_provenance() as u64;
//! record[56..].copy_from_slice(&reference.to_le_bytes());
//! let top = built(Kind::Instances, 1, Geometries::Instances(InstanceSource {
//!     memory: Memory { base: record.as_ptr(), bytes: 64 },
//!     array: InstanceArray::Records,
//!     count: 1,
//!     flags: GeometryFlags(0),
//!     live: &EVERYWHERE,
//! }));
//!
//! let ray = Ray {
//!     origin: [10.25, 0.5, 3.0],
//!     t_min: 0.0,
//!     direction: [0.0, 0.0, -1.0],
//!     t_max: f32::INFINITY,
//!     flags: 0,
//!     cull_mask: 0xFF,
//! };
//! let mut walk = unsafe { Walk::new(top.as_ptr().expose_provenance() as u64, &ray) };
//! let mut fuel = u64::MAX;
//! let event = walk.resume(&mut Walker::new(), Verdict::Continue, &mut fuel);
//! assert_eq!(event, Event::Done);
//! let hit = walk.committed().unwrap();
//! assert_eq!((hit.t, hit.barycentrics), (3.0, [0.25, 0.5]));
//! ```
//!
//! Builds run on the rayon pool that they are called from and are serial outside any pool; the
//! global pool is never started. The result does not depend on the number of threads.

pub mod build;
pub mod cost;
mod error;
pub mod input;
mod layout;
mod live;
mod memory;
pub mod micromap;
mod motion;
mod pool;
pub mod ray;
pub mod ray_report;
pub mod structure;
pub mod transfer;
pub mod walk;

pub use build::{BuildSizes, MAX_GEOMETRIES, build, build_sizes, micromap_bytes, update};
pub use cost::{RayCost, RayCosts};
pub use error::{BuildError, StructureError};
pub use input::{
    AabbGeometry, BuildFlags, BuildInput, EndCaps, Geometries, GeometryFlags, Indexing,
    InstanceArray, InstanceSource, MotionGeometry, RadiusFormat, SweptGeometry, TriangleGeometry,
    VertexFormat,
};
pub use lanes::{LaneMask, Tier};
pub use live::{EVERYWHERE, Live};
pub use memory::{IndexType, Memory};
pub use micromap::{
    GeometryMicromap, Micromap, MicromapFormat, MicromapInput, MicromapUsage, Opacity,
    build_micromap, copy_micromap, micromap_size,
};
pub use ray::{Hit, Ray, Swept, ray_flags};
pub use ray_report::{RayReport, Reason, ReportedPrimitive};
pub use structure::{
    BoxLevel, Content, InstanceContent, Kind, PrimitiveShape, Structure, StructureFacts, validate,
};
pub use transfer::{
    Serialized, compact_into, compacted_size, copy_into, deserialize, serialize, serialized_size,
};
pub use walk::{
    Accuracy, Counts, Event, GroupWalk, GroupWalks, HitRows, Lanes, Options, PACKET, RayRows,
    Specialisation, Start, Switches, TriangleTest, Verdict, Walk, Walker, Words,
};
