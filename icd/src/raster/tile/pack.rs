//! Fragments gathered for a wave: quads of several primitives share a subgroup where they are
//! small, but never two at one pixel, and what comes later in primitive order comes later in the
//! wave. Where no lane looks at others, the pixels of a quad may be of several primitives, too:
//! those along the edges that primitives share.

use super::lanes::{lanes_of, quads_of};
use super::places::{Pattern, Places};
use super::samples::{MAX_SAMPLES, any, masks_of};
use crate::raster::primitive::Bounds;

/// Quads along a tile's side, and blocks.
const SIDE: usize = crate::raster::TILE as usize / 2;
const BLOCKS: usize = SIDE / 2;

/// Quads of a block from which on it takes a subgroup of its own.
pub const OWN: u32 = 3;

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
    /// Of all samples, what the program sees of them, if it does: before the tests (`SampleMask`,
    /// `Centroid`).
    pub coverage: [u16; MAX_SAMPLES],
    /// A bit a quad that is there.
    pub quads: u32,
    /// The first of its [`Joined`], plus one; 0: none.
    pub joined: u32,
}

/// Fragments that were added to a pack, in lanes that its own primitives leave free.
#[derive(Clone, Copy, Debug)]
pub struct Joined {
    pub origin: Origin,
    pub lanes: u16,
    /// The next one in the pack, plus one; 0: none.
    pub next: u32,
}

impl Pack {
    /// Lanes with a covered sample.
    pub fn covered(&self) -> u16 {
        any(&self.masks)
    }

    /// All of a 4×4 block in the render area.
    pub fn whole(origin: Origin, layer: u32, masks: &[u16; MAX_SAMPLES]) -> Self {
        Self {
            places: Places {
                layer: [layer; 4],
                pattern: Pattern::Block,
                ..Places::default()
            },
            origins: [origin; 4],
            is_uniform: true,
            masks: *masks,
            coverage: *masks,
            quads: 0xf,
            ..Self::default()
        }
    }

    /// Lanes of quads that are there.
    pub fn active(&self) -> u16 {
        lanes_of(self.quads)
    }
}

/// A block of fragments of one primitive.
pub struct Found<'a> {
    pub origin: Origin,
    /// The block's first pixel, in the attachments.
    pub place: [i32; 2],
    pub layer: u32,
    /// The render area.
    pub area: &'a Bounds,
    pub sample: u8,
    /// Lanes with a covered sample: there are some.
    pub lanes: u16,
    pub masks: &'a [u16; MAX_SAMPLES],
    pub coverage: &'a [u16; MAX_SAMPLES],
}

/// Where fragments of a block went.
pub struct Went {
    pub pack: usize,
    /// A quad of the block and its place in the pack; none: the pack is the block.
    pub quad: Option<(usize, usize)>,
}

/// The packs of a wave.
pub struct Packs {
    pub packs: Vec<Pack>,
    pub joined: Vec<Joined>,
    /// The pack that takes single quads.
    open: Option<usize>,
    /// By quad of the tile: the last pack that took a single quad there.
    quads: Box<[Last; SIDE * SIDE]>,
    /// By block: the last one that is all of it.
    blocks: Box<[Last; BLOCKS * BLOCKS]>,
    wave: u32,
}

/// The last pack of a wave with fragments at a place, plus one.
#[derive(Clone, Copy, Default)]
struct Last {
    wave: u32,
    pack: u32,
}

impl Default for Packs {
    fn default() -> Self {
        Self {
            packs: Vec::new(),
            joined: Vec::new(),
            open: None,
            quads: Box::new([Last::default(); SIDE * SIDE]),
            blocks: Box::new([Last::default(); BLOCKS * BLOCKS]),
            wave: 1,
        }
    }
}

/// The first pixel of a quad of the block at a place.
#[inline(always)]
pub fn quad_place([x, y]: [i32; 2], quad: usize) -> [i32; 2] {
    [x + 2 * (quad as i32 % 2), y + 2 * (quad as i32 / 2)]
}

/// A quad's index in its tile.
#[inline(always)]
fn cell([x, y]: [i32; 2]) -> usize {
    let (x, y) = (x as usize / 2, y as usize / 2);
    y % SIDE * SIDE + x % SIDE
}

/// A block's.
#[inline(always)]
fn block([x, y]: [i32; 2]) -> usize {
    let (x, y) = (x as usize / 4, y as usize / 4);
    y % BLOCKS * BLOCKS + x % BLOCKS
}

/// Adds a quad's lanes of all samples' masks to others, at another place. From copies, so that the
/// samples become one vector.
#[inline(always)]
pub fn move_quad(
    from: &[u16; MAX_SAMPLES],
    quad: usize,
    to: &mut [u16; MAX_SAMPLES],
    place: usize,
) {
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
        self.joined.clear();
        self.open = None;
        self.wave = self.wave.wrapping_add(1);
        if self.wave == 0 {
            // The numbers begin again: what was noted long ago must not look new.
            self.quads.fill(Last::default());
            self.blocks.fill(Last::default());
            self.wave = 1;
        }
    }

    /// The pack of a note, plus one; 0 if it is of an earlier wave.
    #[inline(always)]
    fn of_wave(&self, last: Last) -> usize {
        if last.wave == self.wave {
            last.pack as usize
        } else {
            0
        }
    }

    /// The last pack with a fragment in a quad, plus one; 0 if there is none.
    fn last(&self, place: [i32; 2]) -> usize {
        let quad = self.of_wave(self.quads[cell(place)]);
        quad.max(self.of_wave(self.blocks[block(place)]))
    }

    /// Records the last use of a pack.
    fn note(&self, pack: usize) -> Last {
        Last {
            wave: self.wave,
            pack: pack as u32 + 1,
        }
    }

    /// Whether fragments of a mask of the block at a place wait already.
    pub fn holds_any(&self, place: [i32; 2], mask: u16) -> bool {
        let quads = quads_of(mask);
        (0..4).any(|quad| quads >> quad & 1 != 0 && self.last(quad_place(place, quad)) != 0)
    }

    /// Adds the fragments of the block at a place; `whole`: see [`Pack::whole`].
    #[inline(always)]
    pub fn add_whole(&mut self, whole: &Pack, place: [i32; 2]) {
        self.blocks[block(place)] = self.note(self.packs.len());
        self.packs.push(*whole);
        if let Some(pack) = self.packs.last_mut() {
            let [x, y] = place;
            (pack.places.x, pack.places.y) = ([x, x + 2, x, x + 2], [y, y, y + 2, y + 2]);
        }
    }

    /// Adds the fragments of a block. `joins`: to quads of other primitives, too; a block with at
    /// least this many quads gets a separate subgroup.
    pub fn add(&mut self, found: &Found<'_>, joins: Option<u32>) {
        if found.lanes == u16::MAX {
            // Nothing can join with it, nor it with others.
            return self.add_block(found, 0xf);
        }
        let Some(own) = joins else {
            return self.add_with(found, |_| ());
        };
        if self.join_block(found) {
            return;
        }
        let quads = quads_of(found.lanes);
        if quads.count_ones() >= own {
            return self.add_block(found, quads);
        }
        for quad in 0..4 {
            if quads >> quad & 1 != 0 && !self.join_quad(found, quad) {
                self.add_quad(found, quad);
            }
        }
    }

    /// Adds the fragments of a block of two primitives, of which `of_first` are the first one's and
    /// the others the second one's; `found` is of both, with the first one's origin.
    pub fn add_halves(&mut self, found: &Found<'_>, of_first: u16, second: Origin) {
        let of_second = found.lanes & !of_first;
        if self.of_wave(self.blocks[block(found.place)]) == 0 {
            let origin = if of_first == 0 { second } else { found.origin };
            self.add_block(&Found { origin, ..*found }, quads_of(found.lanes));
            if of_first != 0 && of_second != 0 {
                self.join(self.packs.len() - 1, second, of_second, false);
            }
            return;
        }
        // One after the other, into the lanes that earlier primitives leave free.
        for (origin, lanes) in [(found.origin, of_first), (second, of_second)] {
            if lanes != 0 {
                let masks = &masks_of(lanes.into());
                let found = Found {
                    origin,
                    lanes,
                    masks,
                    coverage: masks,
                    ..*found
                };
                self.add(&found, Some(1));
            }
        }
    }

    /// Adds a block to the pack that is all of it, if its pixels are free there and nothing later
    /// lies over them. Else gives false.
    fn join_block(&mut self, found: &Found<'_>) -> bool {
        let last = self.of_wave(self.blocks[block(found.place)]);
        let quads = quads_of(found.lanes);
        let is_over = |quad: usize| {
            let later = self.quads[cell(quad_place(found.place, quad))];
            quads >> quad & 1 != 0 && self.of_wave(later) > last
        };
        if last == 0 || (0..4).any(is_over) {
            return false;
        }
        let pack = &mut self.packs[last - 1];
        if pack.covered() & found.lanes != 0 || pack.places.layer[0] != found.layer {
            return false;
        }
        for (mask, more) in pack.masks.iter_mut().zip(found.masks) {
            *mask |= more;
        }
        pack.quads |= quads;
        let is_same = pack.origins[0] == found.origin;
        self.join(last - 1, found.origin, found.lanes, is_same);
        true
    }

    /// Adds a quad of a block to the last pack with fragments there, if its pixels are free. Else
    /// gives false.
    fn join_quad(&mut self, found: &Found<'_>, quad: usize) -> bool {
        let at = quad_place(found.place, quad);
        let last = self.last(at);
        if last == 0 {
            return false;
        }
        let pack = &mut self.packs[last - 1];
        let is_there = |place: &usize| {
            [pack.places.x[*place], pack.places.y[*place]] == at && pack.quads >> place & 1 != 0
        };
        let Some(place) = (0..4).find(is_there) else {
            return false;
        };
        let lanes = (found.lanes >> (4 * quad) & 0xf) << (4 * place);
        if pack.covered() & lanes != 0 || pack.places.layer[place] != found.layer {
            return false;
        }
        move_quad(found.masks, quad, &mut pack.masks, place);
        let is_same = pack.origins[place] == found.origin;
        self.join(last - 1, found.origin, lanes, is_same);
        true
    }

    /// Notes the primitive of lanes that were added to a pack, unless theirs `is_same` anyway.
    fn join(&mut self, pack: usize, origin: Origin, lanes: u16, is_same: bool) {
        if is_same {
            return;
        }
        let first = &mut self.packs[pack].joined;
        let next = *first;
        match self.joined.get_mut((next as usize).wrapping_sub(1)) {
            Some(latest) if latest.origin == origin => latest.lanes |= lanes,
            _ => {
                self.joined.push(Joined {
                    origin,
                    lanes,
                    next,
                });
                *first = self.joined.len() as u32;
            }
        }
    }

    /// The same, and tells where they went.
    #[inline(always)]
    pub fn add_with(&mut self, found: &Found<'_>, mut went: impl FnMut(Went)) {
        let quads = quads_of(found.lanes);
        if quads.count_ones() >= OWN {
            went(Went {
                pack: self.packs.len(),
                quad: None,
            });
            return self.add_block(found, quads);
        }
        for quad in 0..4 {
            if quads >> quad & 1 != 0 {
                went(self.add_quad(found, quad));
            }
        }
    }

    /// Adds a pack that is all of a block, and has some of its quads.
    #[inline(always)]
    fn add_block(&mut self, found: &Found<'_>, quads: u32) {
        // All four quads, even if there are fewer: to come later than they must does no harm.
        self.blocks[block(found.place)] = self.note(self.packs.len());
        self.packs.push(Pack {
            places: Places::block(found.place, found.layer, found.area),
            origins: [found.origin; 4],
            is_uniform: true,
            sample: [found.sample; 4],
            masks: *found.masks,
            coverage: *found.coverage,
            quads,
            joined: 0,
        });
    }

    fn add_quad(&mut self, found: &Found<'_>, quad: usize) -> Went {
        let at = quad_place(found.place, quad);
        // Behind all packs that have fragments here.
        let open =
            (self.open).filter(|&open| self.packs[open].quads != 0xf && self.last(at) <= open);
        let index = open.unwrap_or_else(|| {
            self.packs.push(Pack {
                is_uniform: true,
                ..Pack::default()
            });
            self.packs.len() - 1
        });
        self.open = Some(index);
        self.quads[cell(at)] = self.note(index);
        let ([x, y], area) = (at, found.area);
        let pack = &mut self.packs[index];
        let place = pack.quads.trailing_ones() as usize;
        if place == 0 {
            // Quads that are not there look like the first one.
            pack.origins = [found.origin; 4];
            pack.places.layer = [found.layer; 4];
            pack.places.x = [x; 4];
            pack.places.y = [y; 4];
            pack.sample = [found.sample; 4];
            pack.places.pattern = Pattern::Inside;
        }
        if x < area.left || y < area.top || x + 2 > area.right || y + 2 > area.bottom {
            pack.places.pattern = Pattern::Quads;
        }
        pack.is_uniform &= pack.origins[0] == found.origin;
        pack.origins[place] = found.origin;
        pack.places.x[place] = x;
        pack.places.y[place] = y;
        pack.places.layer[place] = found.layer;
        pack.sample[place] = found.sample;
        move_quad(found.masks, quad, &mut pack.masks, place);
        move_quad(found.coverage, quad, &mut pack.coverage, place);
        pack.quads |= 1 << place;
        Went {
            pack: index,
            quad: Some((quad, place)),
        }
    }
}
