//! Vertex assembly: the primitives of spans, and each vertex that they need once.

use std::ops::Range;

use spirv_jit::Program;

use super::chunk::{ChunkWorker, Round};
use super::cut::PrimitiveRange;
use super::fetch::{Common, Vertex};
use super::indices::Indices;
use super::topology::{self, Assembled};
use crate::raster::{Draw, DrawCall};

/// The vertices and primitives that a span of a draw was listed as.
struct Listed {
    /// The place of its first index or vertex, what is added to indices, and its primitives.
    source: (u64, i32, Range<u32>),
    /// Of the worker's vertices and primitives.
    vertices: Range<usize>,
    primitives: Range<usize>,
}

impl ChunkWorker {
    /// Lists the primitives of spans, and the vertices that they need; patches of so many points.
    pub(super) fn assemble(
        &mut self,
        round: &Round<'_>,
        draw: &Draw,
        spans: &[PrimitiveRange],
        points: Option<usize>,
    ) {
        self.vertices.clear();
        self.commons.clear();
        self.primitives.clear();
        self.corners.clear();
        let topology = draw.state.topology;
        let geometry = draw.stages.geometry().and_then(Program::geometry);
        let last = draw.state.rasterization.provoking_last;
        let indices = draw
            .indices
            .as_ref()
            .map(|buffer| Indices::new(buffer, round.reach));
        let mut before: Option<(u32, u32, u32)> = None;
        let mut latest: Option<Listed> = None;
        for span in spans {
            let call = &draw.calls[span.call as usize];
            let place = (span.call, span.instance, span.view);
            let is_new = before.replace(place) != Some(place);
            if is_new {
                self.unique.clear();
                self.commons.push(Common {
                    first_instance: call.first_instance,
                    instance: span.instance,
                    base_vertex: match indices {
                        Some(_) => call.vertex_offset as u32,
                        None => call.first,
                    },
                    draw_index: call.draw_index,
                    view: span.view,
                });
            }
            let common = self.commons.len() as u32 - 1;
            let start = u64::from(call.first) + u64::from(span.start);
            let source = (start, call.vertex_offset, span.primitives.clone());
            if let Some(listed) = &latest
                && listed.source == source
                && is_new
            {
                latest = Some(self.list_again(listed, span.first_id, common));
                continue;
            }
            latest = None;
            let first = [self.vertices.len(), self.primitives.len()];
            let run = match &indices {
                Some(_) => None,
                None => topology::run(topology, &span.primitives),
            };
            let base = self.vertices.len() as u32;
            if let Some(run) = &run {
                self.vertices.extend(run.clone().map(|place| Vertex {
                    index: (start + u64::from(place)) as u32,
                    common,
                }));
            }
            let ids = (span.first_id..).zip(span.primitives.clone());
            for (primitive_id, primitive) in ids {
                let taken = points.or(geometry.map(|facts| facts.vertices as usize));
                if let Some(taken) = taken {
                    let of_segment = span.of_segment;
                    let (places, count) = topology::corners(topology, primitive, of_segment, last);
                    for corner in 0..taken {
                        // A topology that does not fit the shader lacks vertices.
                        let place = match points {
                            Some(points) => primitive * points as u32 + corner as u32,
                            None => places[corner.min(count - 1)],
                        };
                        let corner = match &run {
                            Some(run) => base + (place - run.start),
                            None => self.vertex(start, place, indices.as_ref(), call, common),
                        };
                        self.corners.push(corner);
                    }
                    self.primitives.push(Assembled {
                        vertices: [0; 3],
                        primitive_id,
                        common,
                        provoking: 0,
                        stream: 0,
                    });
                    continue;
                }
                let places = topology::vertices(topology, primitive, last);
                let vertices = match &run {
                    Some(run) => places.map(|place| base + (place - run.start)),
                    None => {
                        // No closure: it would be called.
                        let mut vertices = places;
                        for vertex in &mut vertices {
                            *vertex = self.vertex(start, *vertex, indices.as_ref(), call, common);
                        }
                        vertices
                    }
                };
                self.primitives.push(Assembled {
                    vertices,
                    primitive_id,
                    common,
                    provoking: topology::provoking(topology, last),
                    stream: 0,
                });
            }
            if is_new && self.corners.is_empty() {
                latest = Some(Listed {
                    source,
                    vertices: first[0]..self.vertices.len(),
                    primitives: first[1]..self.primitives.len(),
                });
            }
        }
    }

    /// Lists vertices and primitives of one instance for another.
    fn list_again(&mut self, listed: &Listed, first_id: u32, common: u32) -> Listed {
        let [vertices, primitives] = [self.vertices.len(), self.primitives.len()];
        let moved = (vertices - listed.vertices.start) as u32;
        self.vertices.extend_from_within(listed.vertices.clone());
        for vertex in &mut self.vertices[vertices..] {
            vertex.common = common;
        }
        self.primitives
            .extend_from_within(listed.primitives.clone());
        for (primitive, id) in self.primitives[primitives..].iter_mut().zip(first_id..) {
            let [a, b, c] = primitive.vertices;
            primitive.vertices = [a + moved, b + moved, c + moved];
            (primitive.primitive_id, primitive.common) = (id, common);
        }
        Listed {
            source: listed.source.clone(),
            vertices: vertices..self.vertices.len(),
            primitives: primitives..self.primitives.len(),
        }
    }

    /// The place in the run of a vertex of a segment.
    #[inline(always)]
    fn vertex(
        &mut self,
        start: u64,
        place: u32,
        indices: Option<&Indices>,
        call: &DrawCall,
        common: u32,
    ) -> u32 {
        let place = start + u64::from(place);
        let index = match indices {
            Some(indices) => indices.at(place).wrapping_add(call.vertex_offset as u32),
            None => place as u32,
        };
        let new = self.vertices.len() as u32;
        let found = self.unique.place(index, new);
        if found == new {
            self.vertices.push(Vertex { index, common });
        }
        found
    }
}
