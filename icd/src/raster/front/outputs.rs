//! Where the front end finds what vertices leave.

#![forbid(unsafe_code)]

use ash::vk::PrimitiveTopology as Topology;
use spirv_jit::Program;
use spirv_jit::program::OutputRow;

use super::clip::MAX_CLIP_DISTANCES;
use super::screen::code;

/// Where the outputs that the front end reads lie in a vertex's words.
#[derive(Clone, Copy, Debug, Default)]
pub struct OutputPlaces {
    /// Words of a vertex.
    pub words: usize,
    pub position: [Option<u16>; 4],
    pub point_size: Option<u16>,
    pub clip: [Option<u16>; MAX_CLIP_DISTANCES],
    pub cull: [Option<u16>; MAX_CLIP_DISTANCES],
    pub has_distances: bool,
    pub layer: Option<u16>,
    pub viewport: Option<u16>,
    pub primitive_id: Option<u16>,
    /// Of a mesh program: words of a primitive, in which layer, viewport and number lie, where its
    /// vertices stand, and whether it is discarded.
    pub primitive_words: usize,
    pub indices: [Option<u16>; 3],
    pub culled: Option<u16>,
}

/// The outputs of a draw in a chunk.
pub struct DrawOutputs {
    pub first_word: u32,
    /// First of the words that a mesh program gave to primitives.
    pub first_of_primitives: u32,
    pub places: OutputPlaces,
    /// Of the primitives that the outputs belong to.
    pub topology: Topology,
}

impl OutputPlaces {
    /// Of the last program before rasterization.
    pub fn new(program: &Program) -> Self {
        let mut places = Self {
            words: program.outputs().len(),
            ..Self::default()
        };
        if let Some(facts) = program.mesh() {
            places.words = facts.vertices.len();
            places.primitive_words = facts.primitives.len();
        }
        // Those of a mesh program's primitives are counted apart.
        let rows = (0..places.words as u16).chain(0..);
        for (row, output) in rows.zip(program.outputs()) {
            let distance = |places: &mut [Option<u16>; MAX_CLIP_DISTANCES], index: u8| {
                if let Some(place) = places.get_mut(usize::from(index)) {
                    *place = Some(row);
                }
            };
            match *output {
                OutputRow::Position(component) => {
                    if let Some(place) = places.position.get_mut(usize::from(component)) {
                        *place = Some(row);
                    }
                }
                OutputRow::PointSize => places.point_size = Some(row),
                OutputRow::ClipDistance(index) => distance(&mut places.clip, index),
                OutputRow::CullDistance(index) => distance(&mut places.cull, index),
                OutputRow::Layer => places.layer = Some(row),
                OutputRow::ViewportIndex => places.viewport = Some(row),
                OutputRow::PrimitiveId => places.primitive_id = Some(row),
                OutputRow::CullPrimitive => places.culled = Some(row),
                OutputRow::PrimitiveIndex(corner) => {
                    if let Some(place) = places.indices.get_mut(usize::from(corner)) {
                        *place = Some(row);
                    }
                }
                _ => {}
            }
        }
        places.has_distances = places
            .clip
            .iter()
            .chain(&places.cull)
            .any(|place| place.is_some());
        places
    }

    /// Bits of the distances that are negative, by the words of a vertex.
    pub fn distance_codes(&self, word: impl Fn(u16) -> u32) -> u32 {
        let mut codes = 0;
        for (places, first) in [(&self.clip, code::CLIP), (&self.cull, code::CULL)] {
            for (bit, place) in (first..).zip(places) {
                // NaN counts as outside.
                let is_outside = |place: u16| !(f32::from_bits(word(place)) >= 0.0);
                if place.is_some_and(is_outside) {
                    codes |= 1 << bit;
                }
            }
        }
        codes
    }

    /// Whether vertices choose viewports.
    pub fn chooses_viewports(&self) -> bool {
        self.viewport.is_some()
    }
}
