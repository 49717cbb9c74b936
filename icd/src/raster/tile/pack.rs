//! Fragments gathered for a wave: quads of several primitives share a subgroup where they are small, but never two at one pixel, and what
//! comes later in primitive order comes later in the wave.

use super::lanes::{lanes_of, quads_of};
use super::samples::{MAX_SAMPLES, any};
use super::texels::{Pattern, Places};

/// Quads along a tile's side.
const SIDE: usize = crate::raster::TILE as usize / 2;

/// Quads of a block from which on it takes a subgroup of its own.
const OWN: u32 = 3;

/// Which primitive a quad is of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Origin {
    pub chunk: u32,
    pub record: u32,
}

/// The fragments of a subgroup.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pack {
    pub places: Places,
    pub origins: [Origin; 4],
    pub is_uniform: bool,
    /// Sample of each quad's invocations, where there is one for each sample.
    pub sample: [u8; 4],
    /// By sample: lanes whose sample is covered, and passed the tests if those were early.
    pub masks: [u16; MAX_SAMPLES],
    /// The same before the tests, of all samples: what the program sees (`SampleMask`, `Centroid`).
    pub coverage: [u16; MAX_SAMPLES],
    /// A bit a quad that is there.
    pub quads: u32,
}

impl Pack {
    /// Lanes with a covered sample.
    pub fn covered(&self) -> u16 {
        any(&self.masks)
    }

    /// Lanes of quads that are there.
    pub fn active(&self) -> u16 {
        lanes_of(self.quads)
    }
}

/// A block of fragments of one primitive.
pub struct Found<'a> {
    pub origin: Origin,
    pub places: &'a Places,
    pub sample: u8,
    pub masks: &'a [u16; MAX_SAMPLES],
    pub coverage: &'a [u16; MAX_SAMPLES],
}

/// The packs of a wave.
pub struct Packs {
    pub packs: Vec<Pack>,
    /// The pack that takes single quads.
    open: Option<usize>,
    /// By quad of the tile: the last pack with a fragment there, plus one, and the wave that it is of.
    last: Box<[u64; SIDE * SIDE]>,
    wave: u64,
}

impl Default for Packs {
    fn default() -> Self {
        Self {
            packs: Vec::new(),
            open: None,
            last: Box::new([0; SIDE * SIDE]),
            wave: 1,
        }
    }
}

/// A quad's index in its tile.
fn cell(places: &Places, quad: usize) -> usize {
    let (x, y) = (places.x[quad] as usize / 2, places.y[quad] as usize / 2);
    y % SIDE * SIDE + x % SIDE
}

/// Adds a quad's lanes of all samples' masks to others, at another place. From copies, so that the samples become one vector.
#[inline(always)]
fn move_quad(from: &[u16; MAX_SAMPLES], quad: usize, to: &mut [u16; MAX_SAMPLES], place: usize) {
    let (right, left) = (4 * quad as u32 % 16, 4 * place as u32 % 16);
    let (from, mut moved) = (*from, *to);
    for sample in 0..MAX_SAMPLES {
        moved[sample] |= (from[sample] >> right & 0xf) << left;
    }
    *to = moved;
}

impl Packs {
    /// Forgets all.
    pub fn clear(&mut self) {
        self.packs.clear();
        self.open = None;
        self.wave += 1;
    }

    /// The last pack with a fragment in a quad, plus one; 0 if there is none.
    fn last(&self, cell: usize) -> usize {
        let entry = self.last[cell];
        match entry >> 32 == self.wave {
            true => entry as u32 as usize,
            false => 0,
        }
    }

    fn note(&mut self, cell: usize, pack: usize) {
        self.last[cell] = self.wave << 32 | (pack as u64 + 1);
    }

    /// Whether fragments in the quads of a mask wait already.
    pub fn holds_any(&self, places: &Places, mask: u16) -> bool {
        let quads = quads_of(mask);
        (0..4).any(|quad| quads >> quad & 1 != 0 && self.last(cell(places, quad)) != 0)
    }

    /// Adds the fragments of a block: some lanes are covered.
    pub fn add(&mut self, found: &Found<'_>) {
        let quads = match found.masks[0] {
            u16::MAX => 0xf,
            _ => quads_of(any(found.masks)),
        };
        if quads.count_ones() >= OWN {
            let pack = self.packs.len();
            if found.places.pattern == Pattern::Block {
                // All four quads, even if there are three: to come later than they must does no harm.
                let first = cell(found.places, 0);
                for cell in [first, first + 1, first + SIDE, first + SIDE + 1] {
                    self.note(cell, pack);
                }
            } else {
                for quad in (0..4).filter(|quad| quads >> quad & 1 != 0) {
                    self.note(cell(found.places, quad), pack);
                }
            }
            self.packs.push(Pack {
                places: *found.places,
                origins: [found.origin; 4],
                is_uniform: true,
                sample: [found.sample; 4],
                masks: *found.masks,
                coverage: *found.coverage,
                quads,
            });
            return;
        }
        for quad in 0..4 {
            if quads >> quad & 1 != 0 {
                self.add_quad(found, quad);
            }
        }
    }

    fn add_quad(&mut self, found: &Found<'_>, quad: usize) {
        let cell = cell(found.places, quad);
        // Behind all packs that have fragments here.
        let open =
            (self.open).filter(|&open| self.packs[open].quads != 0xf && self.last(cell) <= open);
        let index = open.unwrap_or_else(|| {
            self.packs.push(Pack {
                is_uniform: true,
                ..Pack::default()
            });
            self.packs.len() - 1
        });
        self.open = Some(index);
        self.note(cell, index);
        let pack = &mut self.packs[index];
        let place = pack.quads.trailing_ones() as usize;
        if place == 0 {
            // Quads that are not there look like the first one.
            pack.origins = [found.origin; 4];
            pack.places.layer = [found.places.layer[quad]; 4];
            pack.places.x = [found.places.x[quad]; 4];
            pack.places.y = [found.places.y[quad]; 4];
            pack.sample = [found.sample; 4];
        }
        pack.is_uniform &= pack.origins[0] == found.origin;
        pack.origins[place] = found.origin;
        pack.places.x[place] = found.places.x[quad];
        pack.places.y[place] = found.places.y[quad];
        pack.places.layer[place] = found.places.layer[quad];
        pack.sample[place] = found.sample;
        move_quad(found.masks, quad, &mut pack.masks, place);
        move_quad(found.coverage, quad, &mut pack.coverage, place);
        pack.quads |= 1 << place;
    }
}
