//! A structure's facts about a hit.

use super::{Kind, Structure};
use crate::layout::{Form, GROUP, LEAF_TRIANGLES, geometry_word};
use crate::live::Live;
use crate::motion::triangle_at;
use crate::ray::Hit;

impl Structure {
    /// The object-space positions of a hit triangle's vertices, in order, after the geometry's
    /// transform. `self` is the top level, and the bottom level lies in `live`; zeros for what is
    /// no triangle.
    pub fn triangle_vertices(&self, hit: &Hit, live: &Live) -> [[f32; 3]; 3] {
        self.triangle_vertices_at(hit, 0.0, live)
    }

    /// As [`Self::triangle_vertices`], at a time in [0, 1].
    pub fn triangle_vertices_at(&self, hit: &Hit, time: f32, live: &Live) -> [[f32; 3]; 3] {
        let Some(bottom) = self.bottom_level(hit, live) else {
            return [[0.0; 3]; 3];
        };
        let slot = bottom.slot_of(hit);
        if let Some(entry) = bottom.motion_entry(slot) {
            return triangle_at(&entry.triangles, time);
        }
        match bottom.form {
            Form::Groups => (bottom.group(slot / GROUP as u32))
                .map(|group| group.triangle(slot as usize % GROUP)),
            Form::Blocks => (bottom.block(slot / LEAF_TRIANGLES as u32))
                .map(|block| block.triangle(slot as usize % LEAF_TRIANGLES)),
        }
        .unwrap_or_default()
    }

    fn bottom_level(&self, hit: &Hit, live: &Live) -> Option<Structure> {
        // SAFETY: the contract of `at`, by which `self` was found.
        unsafe { Structure::at(self.reference(hit.instance_index), live) }
    }

    /// Where a hit's primitive lies in this bottom level. A hit that no walk found does not know;
    /// then it is looked for.
    fn slot_of(&self, hit: &Hit) -> u32 {
        if hit.slot != Hit::UNKNOWN_SLOT {
            return hit.slot;
        }
        let is_it = |primitive: u32, geometry: u32| {
            primitive == hit.primitive_index
                && geometry & geometry_word::INDEX == hit.geometry_index
        };
        if self.form == Form::Blocks {
            return self.slot_in_blocks(is_it);
        }
        let found = (0..self.leaf_count).find_map(|index| match self.kind {
            Kind::Triangles => {
                let group = self.group(index)?;
                (0..4u32)
                    .find(|&lane| {
                        let k = lane as usize;
                        group.lanes >> lane & 1 != 0
                            && is_it(group.primitives[k], group.geometries[k])
                    })
                    .map(|lane| 4 * index + lane)
            }
            Kind::Swept => {
                let entry = self.swept_entry(index)?;
                is_it(entry.primitive, entry.geometry).then_some(index)
            }
            Kind::Motion => {
                let entry = self.motion_entry(index)?;
                is_it(entry.primitive, entry.geometry).then_some(index)
            }
            _ => None,
        });
        found.unwrap_or(Hit::UNKNOWN_SLOT)
    }

    /// The slot of the triangle with a certain primitive and geometry.
    fn slot_in_blocks(&self, is_it: impl Fn(u32, u32) -> bool) -> u32 {
        let mut index = 0;
        while let Some(block) = self.block(index) {
            let mut lanes = 0..block.triangles();
            if let Some(lane) = lanes.find(|&k| is_it(block.primitive(k), block.geometry(k))) {
                return self.first_slot(index) + lane as u32;
            }
            index += block.units();
        }
        Hit::UNKNOWN_SLOT
    }

    /// The object-space ends of a hit sphere or linear swept sphere, and their radii. `self` is the
    /// top level; zeros for what is none.
    pub fn swept_ends(&self, hit: &Hit, live: &Live) -> ([[f32; 3]; 2], [f32; 2]) {
        self.bottom_level(hit, live)
            .and_then(|bottom| bottom.swept_entry(bottom.slot_of(hit)))
            .map_or_else(Default::default, |entry| (entry.positions, entry.radii))
    }
}
