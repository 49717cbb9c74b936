//! Vertex assembly: the primitives of spans, and each vertex that they need once.

use std::ops::Range;

use ash::vk::PrimitiveTopology as Topology;
use spirv_jit::Program;

use super::chunk::{ChunkWorker, Round};
use super::fetch::{Common, Vertex};
use super::indices::Indices;
use super::kept::{KEPT_PRIMITIVES, SpanSource};
use super::split::PrimitiveRange;
use super::topology::{self, Assembled};
use crate::command::graphics::DrawCall;
use crate::raster::Draw;

/// The vertices and primitives that a span of a draw was listed as.
struct Listed {
    source: SpanSource,
    /// Of the worker's vertices and primitives.
    vertices: Range<usize>,
    primitives: Range<usize>,
}

/// The segment of a span while its primitives are listed.
struct SegmentSource<'a> {
    topology: Topology,
    provoking_last: bool,
    call: &'a DrawCall,
    /// The place of the span's first index, or of its first vertex without indices.
    start: u64,
    indices: Option<&'a Indices>,
    /// Of vertices without indices: consecutive ones, the first of which is the worker's `base`.
    run: Option<Range<u32>>,
    base: u32,
    common: u32,
}

/// The inputs that all vertices of a span's instance share.
fn common_of(call: &DrawCall, span: &PrimitiveRange, is_indexed: bool) -> Common {
    Common {
        first_instance: call.first_instance,
        instance: span.instance,
        base_vertex: match is_indexed {
            true => call.vertex_offset as u32,
            false => call.first,
        },
        draw_index: call.draw_index,
        view: span.view,
    }
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
        let indices = draw
            .indices
            .as_ref()
            .map(|buffer| Indices::new(buffer, round.reach));
        let taken = points.or(geometry.map(|facts| facts.vertices as usize));
        let mut before: Option<(u32, u32, u32)> = None;
        let mut latest: Option<Listed> = None;
        for (number, span) in spans.iter().enumerate() {
            let call = &draw.calls[span.call as usize];
            let place = (span.call, span.instance, span.view);
            let is_new = before.replace(place) != Some(place);
            if is_new {
                self.unique.clear();
                self.commons.push(common_of(call, span, indices.is_some()));
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
            let segment = SegmentSource {
                topology,
                provoking_last: draw.state.rasterization.provoking_last,
                call,
                start,
                indices: indices.as_ref(),
                run: match &indices {
                    Some(_) => None,
                    None => topology::run(topology, &span.primitives),
                },
                base: self.vertices.len() as u32,
                common,
            };
            // A later span of the instance would look for its vertices.
            let is_alone = is_new
                && spans
                    .get(number + 1)
                    .is_none_or(|it| place != (it.call, it.instance, it.view));
            let repeats = call.instances > 1 || round.targets.view_mask.count_ones() > 1;
            let keeps = repeats
                && is_alone
                && taken.is_none()
                && indices.is_some()
                && span.of_segment <= KEPT_PRIMITIVES;
            let keep_of = keeps.then_some((round.batch, span.draw));
            self.list_span(keep_of, (&source, &segment, span), (points, taken));
            if is_new && self.corners.is_empty() {
                latest = Some(Listed {
                    source,
                    vertices: first[0]..self.vertices.len(),
                    primitives: first[1]..self.primitives.len(),
                });
            }
        }
    }

    /// Lists the vertices and primitives of a span: as they were kept of a batch and a draw, or
    /// from its indices.
    fn list_span(
        &mut self,
        keep_of: Option<(u64, u32)>,
        (source, segment, span): (&SpanSource, &SegmentSource<'_>, &PrimitiveRange),
        (points, taken): (Option<usize>, Option<usize>),
    ) {
        if keep_of.is_some_and(|of| self.list_kept(of, source, segment, span.first_id)) {
            return;
        }
        let first = [self.vertices.len(), self.primitives.len()];
        self.list_run(segment);
        match taken {
            Some(taken) => self.list_inputs(segment, span, points, taken),
            None => self.list_primitives(segment, span),
        }
        if let Some(of) = keep_of {
            self.keep(of, source.clone(), first);
        }
    }

    /// Lists the vertices of a run.
    fn list_run(&mut self, segment: &SegmentSource<'_>) {
        let &SegmentSource { start, common, .. } = segment;
        if let Some(run) = &segment.run {
            self.vertices.extend(run.clone().map(|place| Vertex {
                index: (start + u64::from(place)) as u32,
                common,
            }));
        }
    }

    /// Lists the input primitives of a geometry or control shader, which takes so many vertices of
    /// each; patches of so many points.
    fn list_inputs(
        &mut self,
        segment: &SegmentSource<'_>,
        span: &PrimitiveRange,
        points: Option<usize>,
        taken: usize,
    ) {
        let last = segment.provoking_last;
        for (primitive_id, primitive) in (span.first_id..).zip(span.primitives.clone()) {
            let (places, count) =
                topology::corners(segment.topology, primitive, span.of_segment, last);
            for corner in 0..taken {
                // A topology that does not fit the shader lacks vertices.
                let place = match points {
                    Some(points) => primitive * points as u32 + corner as u32,
                    None => places[corner.min(count - 1)],
                };
                let corner = match &segment.run {
                    Some(run) => segment.base + (place - run.start),
                    None => self.vertex(segment, place),
                };
                self.corners.push(corner);
            }
            self.primitives.push(Assembled {
                vertices: [0; 3],
                primitive_id,
                common: segment.common,
                provoking: 0,
                stream: 0,
            });
        }
    }

    /// Lists primitives that are rasterized as they are.
    fn list_primitives(&mut self, segment: &SegmentSource<'_>, span: &PrimitiveRange) {
        let last = segment.provoking_last;
        for (primitive_id, primitive) in (span.first_id..).zip(span.primitives.clone()) {
            let places = topology::vertices(segment.topology, primitive, last);
            let vertices = match &segment.run {
                Some(run) => places.map(|place| segment.base + (place - run.start)),
                None => {
                    // No closure: it would be called.
                    let mut vertices = places;
                    for vertex in &mut vertices {
                        *vertex = self.vertex(segment, *vertex);
                    }
                    vertices
                }
            };
            self.primitives.push(Assembled {
                vertices,
                primitive_id,
                common: segment.common,
                provoking: topology::provoking(segment.topology, last),
                stream: 0,
            });
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

    /// Lists the vertices and primitives of a span that is kept; else gives false.
    fn list_kept(
        &mut self,
        of: (u64, u32),
        source: &SpanSource,
        segment: &SegmentSource<'_>,
        first_id: u32,
    ) -> bool {
        let Some(kept) = self.kept.find(of, source) else {
            return false;
        };
        let &SegmentSource { base, common, .. } = segment;
        let vertex = |&index: &u32| Vertex { index, common };
        self.vertices.extend(kept.indices.iter().map(vertex));
        let provoking = topology::provoking(segment.topology, segment.provoking_last);
        let primitive = |(&[a, b, c], primitive_id): (&[u32; 3], u32)| Assembled {
            vertices: [base + a, base + b, base + c],
            primitive_id,
            common,
            provoking,
            stream: 0,
        };
        let primitives = kept.primitives.iter().zip(first_id..);
        self.primitives.extend(primitives.map(primitive));
        true
    }

    /// Keeps a span whose vertices and primitives were listed, from the first ones on.
    fn keep(&mut self, of: (u64, u32), source: SpanSource, [vertex, primitive]: [usize; 2]) {
        let kept = self.kept.replace(of, source);
        let indices = self.vertices[vertex..].iter().map(|it| it.index);
        kept.indices.extend(indices);
        let base = vertex as u32;
        let from_first = |it: &Assembled| {
            let [a, b, c] = it.vertices;
            [a - base, b - base, c - base]
        };
        let primitives = self.primitives[primitive..].iter();
        kept.primitives.extend(primitives.map(from_first));
    }

    /// The number of a segment's vertex among the worker's vertices.
    #[inline(always)]
    fn vertex(&mut self, segment: &SegmentSource<'_>, place: u32) -> u32 {
        let place = segment.start + u64::from(place);
        let index = match segment.indices {
            Some(indices) => {
                let offset = segment.call.vertex_offset as u32;
                indices.at(place).wrapping_add(offset)
            }
            None => place as u32,
        };
        let common = segment.common;
        let new = self.vertices.len() as u32;
        let found = self.unique.place(index, new);
        // Added and taken away again without a branch, which would be hard to predict.
        self.vertices.push(Vertex { index, common });
        (self.vertices).truncate(new as usize + usize::from(found == new));
        found
    }
}
