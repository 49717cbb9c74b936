//! Samples of the texels around places, blended, and gathers of these.

use lanes::vector::Vector;

use super::super::ImageOpKind;
use super::super::chunk::{ChunkRows, Decode, SUBGROUPS, Source};
use super::super::decode::Decoder;
use super::super::rows::Wave;
use super::Fast;
use super::blend::{
    self, Blend, BlendBytes, BlendNeighbours, BlendSlices, Finish, GatherCorners, Out, Take, To,
};
use super::footprints::{
    self, Combine, FetchBoth, FetchPairs, PlaceAcrossEdges, PlaceAlong, PlaceInBlocks, Taps,
};
use super::places::{At, Places};

/// Taps of the four results of a gather: (0, 1), (1, 1), (1, 0), (0, 0).
const GATHERED: [usize; 4] = [2, 3, 1, 0];

impl Fast<'_> {
    /// # Safety
    /// As [`Self::of_level`].
    #[inline(always)]
    pub(super) unsafe fn linear_of_level<V: Vector>(
        &self,
        v: V,
        wave: &Wave<'_>,
        at: At<'_>,
        out: Out<'_>,
    ) {
        let mut taps = Taps::new();
        // SAFETY: the caller keeps the contract of this function; texels of both axes are placed
        // inside the level.
        unsafe {
            self.place(v, wave, at, &mut taps);
            if self.blends_bytes() {
                macro_rules! blend {
                    ($is_srgb:literal) => {
                        v.apart(BlendBytes::<$is_srgb> {
                            fast: self,
                            wave,
                            taps: &taps,
                            out,
                        })
                    };
                }
                return match self.decoder {
                    Decoder::Srgb => blend!(true),
                    _ => blend!(false),
                };
            }
            // The constant alone decides: where it is false, nothing behind it is compiled.
            if V::BLENDS_NEIGHBOURS
                && let Some(kind) = self.four_of
                && taps.in_pairs(self).trailing_ones() as usize >= wave.subgroups.len()
            {
                return v.apart(BlendNeighbours {
                    fast: self,
                    wave,
                    kind,
                    taps: &taps,
                    out,
                });
            }
            self.fetch_taps(v, wave, self.words_of_components(), &mut taps);
            let mut own = [const { ChunkRows::new() }; 4];
            let (rows, near) = match out {
                Out::Results => return self.blend_results(v, wave, &taps),
                Out::Rows(rows) => (rows, None),
                Out::BehindNear(near) => (&mut own, Some(near)),
            };
            for (component, row) in rows.iter_mut().enumerate() {
                if self.computes(component) {
                    self.blend(v, wave, &taps, component, To::Rows(row));
                }
            }
            if near.is_some() {
                v.apart(Finish {
                    fast: self,
                    wave,
                    rows,
                    near,
                    counts: None,
                });
            }
        }
    }

    /// Blends the texels' components to results.
    ///
    /// # Safety
    /// As [`Self::blend`].
    #[inline(always)]
    unsafe fn blend_results<V: Vector>(&self, v: V, wave: &Wave<'_>, taps: &Taps) {
        for (result, from) in self.image.swizzle.into_iter().enumerate() {
            if wave.results[result].first.is_null() {
                continue;
            }
            let component = match self.op.depth_compare {
                true => 0,
                false => usize::from(from),
            };
            // SAFETY: the caller keeps the contract of this function.
            unsafe {
                if component < 4 && self.info.channels[component].bits != 0 {
                    self.blend(v, wave, taps, component, To::Result(result));
                    continue;
                }
                v.apart(Decode {
                    sources: &[Source::of_view(self.info, self.decoder, from); 4],
                    words: [&taps.words[0][0]; 4],
                    wave,
                    wanted: 1 << result,
                });
            }
        }
    }

    /// Blends a component of texels that the format has.
    ///
    /// # Safety
    /// As [`Self::of_level`]; words of the texels were fetched, and there is such a result.
    #[inline(always)]
    unsafe fn blend<V: Vector>(
        &self,
        v: V,
        wave: &Wave<'_>,
        taps: &Taps,
        component: usize,
        to: To<'_>,
    ) {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            if self.spatial < 3 {
                return self.blend_slice(v, wave, taps, (component, 0), to);
            }
            let mut slices = [ChunkRows::new(), ChunkRows::new()];
            for (slice, rows) in slices.iter_mut().enumerate() {
                self.blend_slice(v, wave, taps, (component, slice), To::Rows(rows));
            }
            v.apart(BlendSlices {
                fast: self,
                wave,
                slices: &slices,
                weight: &taps.weights[2],
                to,
            });
        }
    }

    /// # Safety
    /// As [`Self::blend`].
    #[inline(always)]
    unsafe fn blend_slice<V: Vector>(
        &self,
        v: V,
        wave: &Wave<'_>,
        taps: &Taps,
        (component, slice): (usize, usize),
        to: To<'_>,
    ) {
        macro_rules! blend {
            ($way:ident) => {
                v.apart(Blend::<{ blend::$way }> {
                    fast: self,
                    wave,
                    source: self.source(component),
                    component,
                    taps,
                    slice,
                    to,
                })
            };
        }
        let is_lean = !self.has_border && taps.corners == 0 && self.spatial >= 2;
        // SAFETY: the caller keeps the contract of `Self::blend`.
        unsafe {
            match self.op.depth_compare {
                _ if !is_lean => blend!(ANY),
                true => blend!(COMPARES),
                false => blend!(LEAN),
            }
        }
    }

    /// Places the texels around each lane.
    ///
    /// # Safety
    /// As [`Self::of_level`].
    #[inline(always)]
    unsafe fn place<V: Vector>(
        &self,
        v: V,
        wave: &Wave<'_>,
        (places, levels): At<'_>,
        taps: &mut Taps,
    ) {
        let fast = self;
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            let is_lean = !self.op.has_offset && !self.has_border && self.block_shift == 0;
            for axis in 0..self.spatial {
                macro_rules! place_along {
                    ($way:ident) => {
                        v.apart(PlaceAlong::<{ footprints::$way }> {
                            fast,
                            wave,
                            places,
                            levels,
                            axis,
                            taps: &mut *taps,
                        })
                    };
                }
                match (is_lean, levels) {
                    (true, None) => place_along!(LEAN),
                    (true, Some(_)) => place_along!(LEAN_OF_LEVELS),
                    _ => place_along!(ANY),
                }
            }
            macro_rules! combine {
                ($dimensions:literal) => {
                    v.apart(Combine::<$dimensions> {
                        fast,
                        wave,
                        places,
                        levels,
                        taps: &mut *taps,
                    })
                };
            }
            match self.spatial {
                1 => combine!(1),
                2 => combine!(2),
                _ => combine!(3),
            }
            if self.block_shift != 0 {
                let taps = &mut *taps;
                v.apart(PlaceInBlocks { fast, wave, taps });
            }
            if !self.is_cube {
                return;
            }
            let on_faces = taps.in_pairs(self);
            for index in 0..wave.subgroups.len() {
                if on_faces >> (index % SUBGROUPS) & 1 == 0 {
                    v.apart(PlaceAcrossEdges {
                        fast,
                        places,
                        levels,
                        taps: &mut *taps,
                        index,
                    });
                }
            }
        }
    }

    /// # Safety
    /// As [`Self::sample`]; places were put.
    #[inline(always)]
    pub(super) unsafe fn gather<V: Vector>(&self, v: V, wave: &Wave<'_>, places: &Places) {
        let fast = self;
        let from = match self.op.kind {
            ImageOpKind::Gather(component) if !self.op.depth_compare => {
                self.image.swizzle[component as usize & 3]
            }
            _ => 0,
        };
        let component = usize::from(from & 3);
        let is_read = from < 4 && self.info.channels[component].bits != 0;
        let is_taken =
            self.op.depth_compare || is_read && (self.has_border || self.decoder == Decoder::Each);
        let source = match is_taken {
            true => self.source(component),
            false => Source::of_view(self.info, self.decoder, from),
        };
        let mut taps = Taps::new();
        // SAFETY: the caller keeps the contract of this function; texels of both axes are placed
        // inside the level.
        unsafe {
            if let Some(word) = source.word() {
                self.place(v, wave, (places, None), &mut taps);
                self.fetch_taps(v, wave, 1 << word, &mut taps);
            }
            let words = &taps.words[source.word().unwrap_or(0)];
            let mut wanted = 0;
            for (result, tap) in GATHERED.into_iter().enumerate() {
                if wave.results[result].first.is_null() {
                    continue;
                }
                let words = &words[tap];
                if !is_taken {
                    wanted |= 1 << result;
                    continue;
                }
                let mut inside = [u16::MAX; SUBGROUPS];
                for (index, inside) in inside.iter_mut().enumerate() {
                    *inside = taps.inside(index, tap);
                }
                v.apart(Take {
                    fast,
                    wave,
                    source,
                    component,
                    words,
                    inside,
                    to: To::Result(result),
                });
            }
            if wanted != 0 {
                v.apart(Decode {
                    sources: &[source; 4],
                    words: GATHERED.map(|tap| &words[tap]),
                    wave,
                    wanted,
                });
            }
            if taps.corners != 0 {
                v.apart(GatherCorners {
                    fast,
                    wave,
                    source: self.source(component),
                    taps: &taps,
                    gathered: GATHERED,
                });
            }
        }
    }

    /// Fetches words of the texels around places.
    ///
    /// # Safety
    /// As [`Self::sample`]; the texels were placed.
    #[inline(always)]
    unsafe fn fetch_taps<V: Vector>(&self, v: V, wave: &Wave<'_>, wanted: u8, taps: &mut Taps) {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            if wanted == 0 {
                return;
            }
            let fast = self;
            if self.pairs && wanted.count_ones() == 1 {
                let word = wanted.trailing_zeros() as usize;
                return v.apart(FetchPairs {
                    fast,
                    wave,
                    word,
                    taps,
                });
            }
            if self.pairs && self.info.size_bytes == 8 {
                return v.apart(FetchBoth { fast, wave, taps });
            }
            for tap in 0..4 * self.slices() {
                self.fetch(v, wave.subgroups.len(), wanted, taps.tap(tap));
            }
        }
    }
}
