//! Records and shapes of a draw's primitives: each is culled, clipped or drawn whole, by its kind
//! and the outcodes of its vertices.

use std::sync::atomic::Ordering;

use super::boxes::Boxes;
use super::chunk::{ChunkWorker, Round};
use super::facts::Facts;
use super::fetch::Common;
use super::outputs::DrawOutputs;
use super::screen::{ScreenVertex, code};
use super::set_up::{Corners, Primitive, SetUp};
use super::topology::{self, Assembled, PrimitiveKind};
use super::vertices::Shaded;
use crate::raster::{Chunk, Draw};
use crate::wave::Stopped;

/// The primitives of a draw in a chunk, before set-up.
struct DrawPrimitives<'a> {
    draw_index: u32,
    facts: &'a Facts,
    first_word: u32,
    first_of_primitives: u32,
    shaded: Shaded<'a>,
    commons: &'a [Common],
    /// Projected vertices, if all have one viewport.
    on_screen: Option<&'a [ScreenVertex]>,
    has_views: bool,
    kind: Option<PrimitiveKind>,
    /// Outcodes with which a filled triangle is not drawn whole.
    harmful: Option<u32>,
    /// Of all primitives, if nothing tells them apart.
    destination: Option<Destination>,
}

/// The layer, view and viewport of a primitive.
#[derive(Clone, Copy, Default)]
struct Destination {
    layer: u32,
    view_index: u32,
    viewport: u32,
}

impl DrawPrimitives<'_> {
    /// The destination of a primitive; none if there is no such layer.
    #[inline(always)]
    fn destination(&self, number: usize, assembled: &Assembled) -> Option<Destination> {
        if self.destination.is_some() {
            return self.destination;
        }
        let provoking = assembled.vertices[usize::from(assembled.provoking)];
        let common = &self.commons[assembled.common as usize];
        let (layer, layers) = match self.has_views {
            true => (common.view, u32::MAX),
            false => (
                self.shaded.layer(provoking, number),
                self.facts.layers.max(1),
            ),
        };
        let viewport = self.shaded.viewport(provoking, number);
        (layer < layers).then_some(Destination {
            layer,
            view_index: common.view,
            viewport,
        })
    }

    /// The vertices of a primitive on the screen; none without such a viewport. `own`: memory for
    /// vertices that are projected for this primitive alone.
    #[inline(always)]
    fn on_screen<'b>(
        &'b self,
        assembled: &Assembled,
        viewport: u32,
        own: &'b mut [ScreenVertex; 3],
    ) -> Option<[&'b ScreenVertex; 3]> {
        if let Some(projected) = self.on_screen {
            // Arrays are written out here and in functions it calls: closures of `map` would be
            // called, too.
            let [a, b, c] = assembled.vertices;
            return Some([
                &projected[a as usize],
                &projected[b as usize],
                &projected[c as usize],
            ]);
        }
        let view = self.facts.views.get(viewport as usize)?;
        let volume = &self.facts.volume;
        *own = assembled
            .vertices
            .map(|vertex| self.shaded.project(vertex, &view.screen, volume));
        Some(own.each_ref())
    }

    #[inline(always)]
    fn primitive(&self, number: usize, assembled: &Assembled, to: Destination) -> Primitive {
        let [a, b, c] = assembled.vertices;
        let places = &self.shaded.places;
        let words = places.words as u32;
        Primitive {
            draw: self.draw_index,
            primitive_id: assembled.primitive_id,
            layer: to.layer,
            view_index: to.view_index,
            viewport: to.viewport,
            vertices: [
                self.first_word + a * words,
                self.first_word + b * words,
                self.first_word + c * words,
            ],
            provoking: assembled.provoking,
            words: self.first_of_primitives + number as u32 * places.primitive_words as u32,
        }
    }

    /// Adds the shapes of a primitive.
    #[inline(always)]
    fn add(
        &self,
        (set_up, boxes): (&mut SetUp<'_>, &mut Boxes<'_>),
        (number, assembled): (usize, &Assembled),
        to: Destination,
        on_screen: [&ScreenVertex; 3],
    ) {
        // Made where it is needed: one place in memory for all would be written and read again in
        // pieces of other sizes.
        let primitive = || self.primitive(number, assembled, to);
        let [first, second, third] = [on_screen[0].code, on_screen[1].code, on_screen[2].code];
        let all = first | second | third;
        if first & second & third & code::REJECT != 0 {
            return;
        }
        if self.harmful.is_some_and(|harmful| all & harmful == 0) {
            set_up.clipped += 1;
            let (vertices, place) = (assembled.vertices, [to.layer, to.view_index, to.viewport]);
            if !boxes.join(
                vertices,
                place,
                on_screen,
                (&self.shaded, &mut *set_up.chunk),
            ) {
                let shapes = set_up.chunk.shapes.len();
                set_up.whole_triangle(&primitive(), on_screen);
                boxes.note(vertices, place, on_screen, (shapes, &*set_up.chunk));
            }
            return;
        }
        if self.kind == Some(PrimitiveKind::Line) && all & code::CUT == 0 {
            set_up.whole_line(&primitive(), [on_screen[0], on_screen[1]]);
            return;
        }
        let shaded = &self.shaded;
        if self.kind == Some(PrimitiveKind::Point) {
            let size = shaded.point_size(assembled.vertices[0]);
            set_up.point(&primitive(), on_screen[0], size, 0, (true, 0.0));
            return;
        }
        let vertices = assembled.vertices;
        let corners = Corners {
            screen: on_screen,
            positions: vertices.map(|vertex| shaded.position(vertex)),
            distances: vertices.map(|vertex| shaded.clip_distances(vertex)),
            point_sizes: vertices.map(|vertex| shaded.point_size(vertex)),
        };
        let primitive = primitive();
        match self.kind {
            Some(PrimitiveKind::Triangle) => set_up.triangle(&primitive, &corners),
            Some(PrimitiveKind::Line) => set_up.line(&primitive, &corners, [0, 1], true, 0.0),
            _ => {}
        }
    }
}

/// Adds to the counters of a draw's queries.
fn count_clipping(draw: &Draw, invocations: u64, primitives: u64) {
    for counters in &draw.counters {
        (counters.clipping_invocations).fetch_add(invocations, Ordering::Relaxed);
        (counters.clipping_primitives).fetch_add(primitives, Ordering::Relaxed);
    }
}

impl ChunkWorker {
    /// Makes records and shapes of the primitives.
    pub(super) fn set_up(
        &mut self,
        round: &Round<'_>,
        (draw, draw_index): (&Draw, u32),
        facts: &Facts,
        outputs: DrawOutputs,
        chunk: &mut Chunk,
    ) -> Result<(), Stopped> {
        let count = self.primitives.len();
        if chunk.records.try_reserve(count).is_err() || chunk.shapes.try_reserve(count).is_err() {
            return Err(Stopped::OutOfMemory);
        }
        let DrawOutputs {
            first_word,
            first_of_primitives,
            places,
            topology,
        } = outputs;
        // Set-up writes all of a chunk but these.
        let words = std::mem::take(&mut chunk.outputs);
        let [records, shapes, pixels] =
            [chunk.records.len(), chunk.shapes.len(), chunk.pixels.len()];
        let kind = topology::kind(topology);
        let continues = topology::is_line_strip(topology);
        let has_views = round.targets.view_mask != 0;
        let is_projected = !places.chooses_viewports() && !facts.views.is_empty();
        let all = DrawPrimitives {
            draw_index,
            facts,
            first_word,
            first_of_primitives,
            shaded: Shaded {
                places,
                words: &words[first_word as usize..],
                of_primitives: &words[first_of_primitives as usize..],
            },
            commons: &self.commons,
            on_screen: is_projected.then_some(&self.on_screen[..]),
            has_views,
            kind,
            harmful: facts
                .harmless_codes()
                .filter(|_| kind == Some(PrimitiveKind::Triangle))
                .map(|harmless| !harmless),
            destination: (!has_views && places.layer.is_none() && places.viewport.is_none())
                .then_some(Destination::default()),
        };
        let mut set_up = SetUp {
            facts,
            chunk,
            stippled: 0.0,
            clipped: 0,
        };
        let mut boxes = Boxes::new(draw, all.harmful.is_some());
        let mut last = None;
        let mut own = [ScreenVertex::default(); 3];
        for (number, assembled) in self.primitives.iter().enumerate() {
            let Some(to) = all.destination(number, assembled) else {
                continue;
            };
            // A pattern starts anew with each line that does not continue the one before it.
            let first = Some((assembled.vertices[0], assembled.common));
            if last != first {
                set_up.stippled = 0.0;
            }
            last = continues.then_some((assembled.vertices[1], assembled.common));
            if let Some(on_screen) = all.on_screen(assembled, to.viewport, &mut own) {
                let to_chunk = (&mut set_up, &mut boxes);
                all.add(to_chunk, (number, assembled), to, on_screen);
            }
        }
        count_clipping(draw, count as u64, set_up.clipped);
        if facts.discard {
            chunk.records.truncate(records);
            chunk.shapes.truncate(shapes);
            chunk.pixels.truncate(pixels);
        }
        chunk.outputs = words;
        Ok(())
    }
}
