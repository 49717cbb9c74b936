//! Vertices of a subgroup put on the screen together.

use lanes::{Row, Tier};
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::program::AlignedRow;

use super::outputs::OutputPlaces;
use super::screen::{Screen, ScreenVertex, Volume, project};
use crate::wave::Stopped;

/// A viewport for all vertices.
#[derive(Clone, Copy)]
pub struct Projection<'a> {
    pub screen: &'a Screen,
    pub volume: &'a Volume,
    pub places: &'a OutputPlaces,
}

lanes::vectors! {
    /// Puts the vertices of a subgroup on the screen, by their positions' rows.
    ///
    /// The compiler vectorizes the loop. All vector sizes compute the same bits, because no
    /// operations are fused or reordered.
    pub fn project_lanes<V>(_v, screen: &Screen, volume: &Volume, rows: [&Row; 4], vertices: &mut [ScreenVertex; SUBGROUP_SIZE]) {
        let mut x = [0; SUBGROUP_SIZE];
        let mut y = [0; SUBGROUP_SIZE];
        let mut code = [0; SUBGROUP_SIZE];
        let mut depth = [0.0; SUBGROUP_SIZE];
        let mut inverse_w = [0.0; SUBGROUP_SIZE];
        for lane in 0..SUBGROUP_SIZE {
            let number = |component: usize| f64::from(f32::from_bits(rows[component][lane]));
            let position = [number(0), number(1), number(2), number(3)];
            let vertex = project(screen, volume, &position);
            x[lane] = vertex.x;
            y[lane] = vertex.y;
            code[lane] = vertex.code;
            depth[lane] = vertex.depth;
            inverse_w[lane] = vertex.inverse_w;
        }
        for lane in 0..SUBGROUP_SIZE {
            vertices[lane] = ScreenVertex {
                x: x[lane],
                y: y[lane],
                code: code[lane],
                depth: depth[lane],
                inverse_w: inverse_w[lane],
            };
        }
    }
}

impl Projection<'_> {
    /// Adds the first `count` vertices of a subgroup, by its output rows.
    pub fn add(&self, outputs: &[AlignedRow], count: usize, on_screen: &mut Vec<ScreenVertex>) {
        let row = |component: usize| match self.places.position[component] {
            Some(place) => &outputs[usize::from(place)].0,
            None => &[0; SUBGROUP_SIZE],
        };
        let rows = [row(0), row(1), row(2), row(3)];
        let word = |place, lane: usize| outputs[usize::from(place)].0[lane];
        self.add_lanes(rows, count, word, on_screen);
    }

    /// Adds vertices by their words, one vertex behind the other.
    ///
    /// # Errors
    /// When there is no memory for them.
    pub fn add_all(&self, words: &[u32], on_screen: &mut Vec<ScreenVertex>) -> Result<(), Stopped> {
        if self.places.words == 0 {
            return Ok(());
        }
        let count = words.len() / self.places.words;
        (on_screen.try_reserve(count + SUBGROUP_SIZE)).map_err(|_| Stopped::OutOfMemory)?;
        for words in words.chunks(self.places.words * SUBGROUP_SIZE) {
            let count = words.len() / self.places.words;
            let word =
                |place: u16, lane: usize| words[lane * self.places.words + usize::from(place)];
            let rows = self.places.position.map(|place| {
                std::array::from_fn(|lane| match place {
                    Some(place) if lane < count => word(place, lane),
                    _ => 0,
                })
            });
            self.add_lanes(rows.each_ref(), count, word, on_screen);
        }
        Ok(())
    }

    /// Adds the first `count` vertices of sixteen, by their positions and by their other words.
    #[inline(always)]
    fn add_lanes(
        &self,
        rows: [&Row; 4],
        count: usize,
        word: impl Fn(u16, usize) -> u32,
        on_screen: &mut Vec<ScreenVertex>,
    ) {
        // In their place at once: words just written cannot be read in vectors without a stall.
        let first = on_screen.len();
        on_screen.resize(first + SUBGROUP_SIZE, ScreenVertex::default());
        let vertices = on_screen[first..].as_mut_array().expect("sixteen");
        project_lanes(Tier::best(), self.screen, self.volume, rows, vertices);
        if self.places.has_distances {
            for (lane, vertex) in vertices[..count].iter_mut().enumerate() {
                vertex.code |= self.places.distance_codes(|place| word(place, lane));
            }
        }
        on_screen.truncate(first + count);
    }
}
