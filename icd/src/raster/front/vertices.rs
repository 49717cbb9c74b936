//! The vertices of a chunk: each of them once, their invocations in waves, their outputs by vertex.

use std::ops::Range;

use lanes::LaneMask;
use spirv_jit::environment::Environment;
use spirv_jit::program::AlignedRow;
use spirv_jit::{Program, SUBGROUP_SIZE};

use super::clip::MAX_CLIP_DISTANCES;
use super::outputs::OutputPlaces;
use super::project::Projection;
use super::screen::{Clip, Screen, ScreenVertex, Volume, project};
use super::transpose::copy_vertices;
use crate::wave::runner::{Runner, Subgroups, subgroups_at_once};
use crate::wave::{Limits, Stopped};

/// Subgroups that run together, at most: their states stay in a cache.
pub const SUBGROUPS: usize = 16;

/// Entries of [`Unique`]: more than twice the vertices of a chunk.
const ENTRIES: usize = 8192;

/// Bits of a place, behind which the generation and the index stand.
const PLACE_BITS: u32 = 20;
const GENERATIONS: u64 = 1 << (32 - PLACE_BITS);

/// Which vertices there are already, by index: an open hash table, emptied by counting up.
pub struct Unique {
    /// Index, generation, place, from the high bits on.
    entries: Box<[u64]>,
    generation: u64,
    used: usize,
}

impl Default for Unique {
    fn default() -> Self {
        Self {
            entries: vec![0; ENTRIES].into(),
            generation: 0,
            used: 0,
        }
    }
}

impl Unique {
    /// Empties it.
    pub fn clear(&mut self) {
        self.used = 0;
        self.generation = (self.generation + 1) % GENERATIONS;
        if self.generation == 0 {
            self.entries.fill(0);
            self.generation = 1;
        }
    }

    /// The place of a vertex, less than 2²⁰; `new` if there was none.
    #[inline(always)]
    pub fn place(&mut self, index: u32, new: u32) -> u32 {
        if self.used > ENTRIES / 2 {
            // Full: vertices from here on may come twice.
            self.clear();
        }
        let tag = u64::from(index) << (32 - PLACE_BITS) | self.generation;
        // Neighbours lie side by side, and what they push aside lies anywhere.
        let mut at = index as usize % ENTRIES;
        loop {
            let entry = self.entries[at];
            let is_its = entry >> PLACE_BITS == tag;
            let is_free = (entry >> PLACE_BITS) % GENERATIONS != self.generation;
            // Chosen without a branch: which vertices are new is hard to predict.
            if is_its | is_free {
                let place = match is_its {
                    true => (entry as u32) & ((1 << PLACE_BITS) - 1),
                    false => new,
                };
                self.entries[at] = tag << PLACE_BITS | u64::from(place);
                self.used += usize::from(is_free);
                return place;
            }
            let step = index.wrapping_mul(0x9E37_79B1) >> 19 | 1;
            at = (at + step as usize) % ENTRIES;
        }
    }
}

/// The shaded vertices of a run of primitives of one draw.
#[derive(Clone, Copy)]
pub struct Shaded<'a> {
    pub places: OutputPlaces,
    /// Outputs of the first vertex, then the others.
    pub words: &'a [u32],
    /// Words of the primitives of a mesh program, likewise.
    pub of_primitives: &'a [u32],
}

impl Shaded<'_> {
    #[inline(always)]
    fn word(&self, vertex: u32, place: Option<u16>) -> Option<u32> {
        let at = vertex as usize * self.places.words + usize::from(place?);
        Some(self.words[at])
    }

    #[inline(always)]
    fn float(&self, vertex: u32, place: Option<u16>) -> f64 {
        f64::from(f32::from_bits(self.word(vertex, place).unwrap_or(0)))
    }

    /// `Position`.
    #[inline(always)]
    pub fn position(&self, vertex: u32) -> Clip {
        self.places.position.map(|place| self.float(vertex, place))
    }

    /// `PointSize`.
    pub fn point_size(&self, vertex: u32) -> f32 {
        self.word(vertex, self.places.point_size)
            .map_or(1.0, f32::from_bits)
    }

    /// A word that the provoking vertex chooses for a primitive, or a mesh program itself.
    #[inline(always)]
    fn chosen(&self, vertex: u32, primitive: usize, place: Option<u16>) -> u32 {
        match self.places.primitive_words {
            0 => self.word(vertex, place).unwrap_or(0),
            words => place.map_or(0, |place| {
                self.of_primitives[primitive * words + usize::from(place)]
            }),
        }
    }

    /// `Layer`.
    #[inline(always)]
    pub fn layer(&self, vertex: u32, primitive: usize) -> u32 {
        self.chosen(vertex, primitive, self.places.layer)
    }

    /// `ViewportIndex`.
    #[inline(always)]
    pub fn viewport(&self, vertex: u32, primitive: usize) -> u32 {
        self.chosen(vertex, primitive, self.places.viewport)
    }

    /// `ClipDistance`; those that are not written do not clip.
    pub fn clip_distances(&self, vertex: u32) -> [f64; MAX_CLIP_DISTANCES] {
        self.places.clip.map(|place| match place {
            Some(_) => self.float(vertex, place),
            None => 0.0,
        })
    }

    /// Puts a vertex on the screen.
    #[inline(always)]
    pub fn project(&self, vertex: u32, screen: &Screen, volume: &Volume) -> ScreenVertex {
        let mut projected = project(screen, volume, &self.position(vertex));
        if self.places.has_distances {
            let word = |place| self.word(vertex, Some(place)).unwrap_or(0);
            projected.code |= self.places.distance_codes(word);
        }
        projected
    }
}

/// Runs a program for each of `count` vertices, and appends their outputs; with a projection, their
/// places on the screen, too. `fill` fills the inputs of a subgroup's state for some of them.
///
/// # Errors
/// When a limit stopped it.
pub fn shade(
    runner: &mut Runner,
    program: &Program,
    environment: &Environment,
    limits: &Limits,
    count: usize,
    fill: &dyn Fn(&mut [AlignedRow], Range<usize>),
    projection: Option<Projection<'_>>,
    outputs: &mut Vec<u32>,
    on_screen: &mut Vec<ScreenVertex>,
) -> Result<(), Stopped> {
    let words = program.output_rows() as usize;
    let first = outputs.len();
    let size = count * words;
    outputs
        .try_reserve(size)
        .map_err(|_| Stopped::OutOfMemory)?;
    outputs.resize(first + size, 0);
    let mut rest = &mut outputs[first..];
    let io = program.layout().io;
    let at_once = subgroups_at_once(program).min(SUBGROUPS) * SUBGROUP_SIZE;
    for start in (0..count).step_by(at_once) {
        let end = count.min(start + at_once);
        let lanes_of = |first: usize| first..end.min(first + SUBGROUP_SIZE);
        let starts = (start..end).step_by(SUBGROUP_SIZE);
        runner.begin(program, Subgroups::apart(starts.len()), limits)?;
        for (state, first) in runner.states().zip(starts.clone()) {
            let lanes = lanes_of(first);
            program.start(state, LaneMask::full(lanes.len()));
            fill(state, lanes);
        }
        runner.run(program, environment, limits)?;
        for (state, first) in runner.states().zip(starts) {
            let lanes = lanes_of(first).len();
            let (here, after) = rest.split_at_mut(lanes * words);
            rest = after;
            if let Some(projection) = &projection {
                projection.add(&state[io..], lanes, on_screen);
            }
            if words == 0 {
                continue;
            }
            let rows = &state[io..];
            let starts: [usize; SUBGROUP_SIZE] = std::array::from_fn(|lane| lane * words);
            copy_vertices(words, |word| &rows[word].0, &starts[..lanes], here);
        }
    }
    Ok(())
}
