//! All that a structure holds, for reports. No walk needs this.

use super::{Kind, Structure};
use crate::input::BuildFlags;
use crate::layout::{Block, GROUP, MAX_DEPTH, WIDTH, child, geometry_word, instance_state};
use crate::live::Live;

/// Facts about a whole structure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StructureFacts {
    /// Those of its build.
    pub flags: BuildFlags,
    pub geometry_count: u32,
    /// Primitives or instances, active or not.
    pub primitive_count: u64,
    pub node_count: u32,
    /// Levels of nodes.
    pub depth: u32,
    pub size_bytes: u64,
    /// Least and greatest coordinates of everything active; `None` when there is nothing.
    pub bounds: Option<[[f32; 3]; 2]>,
}

/// A primitive of a bottom level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Content {
    pub geometry: u32,
    pub primitive: u32,
    pub shape: PrimitiveShape,
}

/// A primitive's place, in object space, of what moves at time 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PrimitiveShape {
    Triangle([[f32; 3]; 3]),
    /// Least and greatest coordinates: of a box, or around a round primitive.
    Box([[f32; 3]; 2]),
}

/// Boxes of nodes' children, so many levels below the root.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoxLevel {
    /// Least and greatest coordinates, for all times.
    pub boxes: Vec<[[f32; 3]; 2]>,
    /// The number of boxes; if it is more than requested, `boxes` has an even selection.
    pub count: u64,
}

/// An instance of a top level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InstanceContent {
    /// Position in the build's input.
    pub index: u32,
    /// Row-major 3 × 4, at time 0.
    pub object_to_world: [f32; 12],
    pub custom_index: u32,
    pub mask: u8,
    pub sbt_offset: u32,
    /// Vulkan's bits.
    pub flags: u8,
    /// The address of its bottom level.
    pub reference: u64,
}

impl Structure {
    /// The structure at an address with its facts; `None` as for [`Structure::at`].
    ///
    /// # Safety
    /// As for [`Structure::at`].
    pub unsafe fn described(address: u64, live: &Live) -> Option<(Structure, StructureFacts)> {
        // SAFETY: the caller keeps the contract of `Structure::at`.
        let found = unsafe { Structure::inside(address, live.bytes_from(address)) };
        let (structure, header) = found?;
        let bounds = [header.bounds.min, header.bounds.max];
        let facts = StructureFacts {
            flags: BuildFlags(header.flags),
            geometry_count: header.geometry_count,
            primitive_count: header.primitive_count,
            node_count: header.node_count,
            depth: header.depth,
            size_bytes: header.size_bytes,
            bounds: (0..3)
                .all(|axis| bounds[0][axis] <= bounds[1][axis])
                .then_some(bounds),
        };
        Some((structure, facts))
    }

    /// The primitives of a bottom level, in the order of its leaves.
    pub fn contents(&self) -> impl Iterator<Item = Content> + '_ {
        let nodes = match self.kind().is_top() {
            true => 0,
            false => self.node_count(),
        };
        let leaves = (0..nodes).flat_map(move |index| {
            let node = self.node(index);
            (0..WIDTH).filter_map(move |place| {
                let node = node?;
                let word = node.child(place);
                if word & child::LEAF == 0 || word == child::NONE {
                    return None;
                }
                let bound = |side: usize| [0, 1, 2].map(|axis| node.bound(2 * axis + side, place));
                Some((word, [bound(0), bound(1)]))
            })
        });
        leaves.flat_map(|(word, bounds)| self.leaf_contents(word, bounds))
    }

    /// The boxes of each level of nodes, at most `most` a level, in the space of the bottom level,
    /// or of the world for a top level.
    pub fn box_levels(&self, most: usize) -> Vec<BoxLevel> {
        let (mut nodes, mut levels) = (vec![0], Vec::new());
        // Corrupt nodes may lead back to each other.
        let mut left = self.node_count();
        while levels.len() < MAX_DEPTH as usize {
            let (mut below, mut boxes) = (Vec::new(), Vec::new());
            for index in nodes {
                let Some(node) = self.node(index).filter(|_| left > 0) else {
                    continue;
                };
                left -= 1;
                for place in 0..WIDTH {
                    let word = node.child(place);
                    if word == child::NONE {
                        continue;
                    }
                    let bound =
                        |side: usize| [0, 1, 2].map(|axis| node.bound(2 * axis + side, place));
                    boxes.push([bound(0), bound(1)]);
                    if word & child::LEAF == 0 {
                        below.push(word);
                    }
                }
            }
            if boxes.is_empty() {
                break;
            }
            let count = boxes.len();
            if count > most {
                let chosen = (0..most).map(|index| boxes[index * count / most]);
                boxes = chosen.collect();
            }
            levels.push(BoxLevel {
                boxes,
                count: count as u64,
            });
            nodes = below;
        }
        levels
    }

    fn leaf_contents(&self, word: u32, bounds: [[f32; 3]; 2]) -> Vec<Content> {
        let index = word & child::INDEX;
        let content = |geometry: u32, primitive: u32, shape| Content {
            geometry: geometry & geometry_word::INDEX,
            primitive,
            shape,
        };
        let one = |found: Option<Content>| Vec::from_iter(found);
        match self.kind() {
            Kind::Triangles => {
                let mut room = None;
                let expand = |block: &_, room: [&mut _; 2]| Block::expand(block, room);
                let Some((groups, lanes)) = self.leaf_groups(word, &mut room, expand) else {
                    return Vec::new();
                };
                let triangles = (0..2 * GROUP).filter(|lane| lanes >> lane & 1 != 0);
                let triangle = |lane: usize| {
                    let group = groups[lane / GROUP];
                    let slot = self.first_slot(index).wrapping_add(lane as u32);
                    let (geometry, primitive) = self.identity(slot);
                    let vertices = group.triangle(lane % GROUP);
                    content(geometry, primitive, PrimitiveShape::Triangle(vertices))
                };
                triangles.map(triangle).collect()
            }
            Kind::Aabbs => one((self.box_entry(index)).map(|entry| {
                content(entry.geometry, entry.primitive, PrimitiveShape::Box(bounds))
            })),
            Kind::Swept => one((self.swept_entry(index)).map(|entry| {
                content(entry.geometry, entry.primitive, PrimitiveShape::Box(bounds))
            })),
            Kind::Motion => one(self.motion_entry(index).map(|entry| {
                let triangle = PrimitiveShape::Triangle(entry.triangles[0]);
                content(entry.geometry, entry.primitive, triangle)
            })),
            Kind::Instances | Kind::MotionInstances => Vec::new(),
        }
    }

    /// The active instances of a top level.
    pub fn instances(&self) -> impl Iterator<Item = InstanceContent> + '_ {
        (0..self.reference_count() as u32).filter_map(|index| {
            let words = self.instance_words(index)?;
            (words.state & instance_state::ACTIVE != 0).then(|| InstanceContent {
                index,
                object_to_world: self.object_to_world(index),
                custom_index: words.custom_index_and_mask & 0xFF_FFFF,
                mask: (words.custom_index_and_mask >> 24) as u8,
                sbt_offset: words.sbt_offset_and_flags & 0xFF_FFFF,
                flags: (words.sbt_offset_and_flags >> 24) as u8,
                reference: self.reference(index),
            })
        })
    }
}
