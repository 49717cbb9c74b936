//! Samples and gathers of the chunks of a wave, in the steps of [`chunk`](super::super::chunk):
//! where they are, the levels that they take, and for each of these nearest texels, or those around
//! places, gathered, compared or blended. Axis by axis, all subgroups' texels are placed; an axis
//! knows nothing of the others, so the code is the same for each dimension.

use lanes::vector::{Task, Vector};

use super::super::chunk::{ChunkRows, Expand, Fetch, WordRows};
use super::super::decode::Decoder;
use super::super::rows::Wave;
use super::Fast;
use super::blend::{Near, Out};
use super::footprints::{LoadEach, Tap};
use super::levels::{ChooseLods, LevelRows, Lods, PutLevels};
use super::places::{At, Places, PutPlaces};

/// Ways of [`Chunk`].
const GATHER: u8 = 0;
const ONE_LEVEL: u8 = 1;
const LEVELS: u8 = 2;
const ANISOTROPIC: u8 = 3;

/// Samples of a chunk. Each way has a stack frame of its own.
struct Chunk<'a, 'b, const WAY: u8> {
    fast: &'b Fast<'a>,
    wave: &'b Wave<'b>,
}

impl<V: Vector, const WAY: u8> Task<V> for Chunk<'_, '_, WAY> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let Chunk { fast, wave } = self;
        // SAFETY: the caller keeps the contract of `Fast::sample`.
        unsafe {
            let mut places = Places::new(fast.is_cube);
            if fast.has_layers() {
                v.apart(PutPlaces {
                    fast,
                    wave,
                    places: &mut places,
                });
            }
            match WAY {
                GATHER => fast.gather(v, wave, &places),
                ONE_LEVEL => fast.of_level(v, wave, (&places, None), Out::Results),
                LEVELS => fast.of_levels(v, wave, &places),
                _ => fast.of_footprints(v, wave, &places),
            }
        }
    }
}

/// Samples of one level a lane: results, or components in units.
struct OfLevel<'a, 'b, const IS_NEAREST: bool> {
    fast: &'b Fast<'a>,
    wave: &'b Wave<'b>,
    at: At<'b>,
    out: Out<'b>,
}

impl<V: Vector, const IS_NEAREST: bool> Task<V> for OfLevel<'_, '_, IS_NEAREST> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        // SAFETY: the caller keeps the contract of `Fast::of_level`.
        unsafe {
            match IS_NEAREST {
                true => self.fast.nearest_of_level(v, self.wave, self.at, self.out),
                false => self.fast.linear_of_level(v, self.wave, self.at, self.out),
            }
        }
    }
}

impl Fast<'_> {
    /// Slices around a place.
    #[inline(always)]
    pub(super) fn slices(&self) -> usize {
        if self.spatial == 3 { 2 } else { 1 }
    }

    /// Whether numbers of a component of the format are looked at.
    #[inline(always)]
    pub(super) fn computes(&self, component: usize) -> bool {
        match self.op.depth_compare {
            true => component == 0,
            false => self.takes(component),
        }
    }

    /// Samples or gathers of up to sixteen subgroups, each of which has lanes that sample.
    ///
    /// # Safety
    /// As [`sample`](super::super::wave::sample).
    #[inline(always)]
    pub(in super::super) unsafe fn sample<V: Vector>(&self, v: V, wave: &Wave<'_>) {
        let fast = self;
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            match (self.is_gather(), self.is_anisotropic, self.has_levels()) {
                (true, ..) => v.apart(Chunk::<GATHER> { fast, wave }),
                (_, true, _) => v.apart(Chunk::<ANISOTROPIC> { fast, wave }),
                (_, _, true) => v.apart(Chunk::<LEVELS> { fast, wave }),
                _ => v.apart(Chunk::<ONE_LEVEL> { fast, wave }),
            }
        }
    }

    /// Samples of one level a lane. Results are written, or components in units.
    ///
    /// # Safety
    /// As [`Self::sample`]; places were put, and levels if the image has several.
    #[inline(always)]
    pub(super) unsafe fn of_level<V: Vector>(
        &self,
        v: V,
        wave: &Wave<'_>,
        at: At<'_>,
        out: Out<'_>,
    ) {
        let fast = self;
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            match self.is_nearest {
                true => v.apart(OfLevel::<true> {
                    fast,
                    wave,
                    at,
                    out,
                }),
                false => v.apart(OfLevel::<false> {
                    fast,
                    wave,
                    at,
                    out,
                }),
            }
        }
    }

    /// Samples of one or two levels a lane.
    ///
    /// # Safety
    /// As [`Self::sample`]; places were put.
    #[inline(always)]
    unsafe fn of_levels<V: Vector>(&self, v: V, wave: &Wave<'_>, places: &Places) {
        let fast = self;
        let mut lods = Lods::new();
        let mut levels = LevelRows::new();
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            v.apart(ChooseLods {
                fast,
                wave,
                lods: &mut lods,
            });
            v.apart(PutLevels {
                fast,
                wave,
                levels: &lods.levels,
                is_next: false,
                to: &mut levels,
            });
            if lods.between == 0 {
                return self.of_level(v, wave, (places, Some(&levels)), Out::Results);
            }
            let mut near = [const { ChunkRows::new() }; 4];
            self.of_level(v, wave, (places, Some(&levels)), Out::Rows(&mut near));
            v.apart(PutLevels {
                fast,
                wave,
                levels: &lods.levels,
                is_next: true,
                to: &mut levels,
            });
            let near = Near {
                rows: &near,
                weights: &lods.weights,
                between: lods.between,
            };
            self.of_level(v, wave, (places, Some(&levels)), Out::BehindNear(near));
        }
    }

    /// A bit for each word that components are read from.
    #[inline(always)]
    pub(super) fn words_of_components(&self) -> u8 {
        let mut words = 0;
        for component in 0..4 {
            if self.computes(component)
                && let Some(word) = self.source(component).word()
            {
                words |= 1 << word;
            }
        }
        words
    }

    /// Fetches the wanted words of texels, or their components where these are not words' parts.
    ///
    /// # Safety
    /// As [`Self::sample`]; the texels were placed.
    #[inline(always)]
    pub(super) unsafe fn fetch<V: Vector>(&self, v: V, count: usize, wanted: u8, texel: Tap<'_>) {
        let (info, base) = (self.info, self.image.data.cast_const());
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            if wanted == 0 {
                return;
            }
            if self.decoder == Decoder::Each {
                return v.apart(LoadEach {
                    info,
                    base,
                    count,
                    texel,
                });
            }
            let is_expanded = self.decoder.is_expanded();
            let Tap {
                offsets,
                index,
                words: [a, b, c, d],
            } = texel;
            v.apart(Fetch {
                base,
                readable: self.image.size_bytes,
                size_bytes: info.size_bytes,
                wanted: if is_expanded { 0xf } else { wanted },
                offsets,
                words: WordRows::of_chunk([&mut *a, &mut *b, &mut *c, &mut *d], count),
            });
            if is_expanded {
                v.apart(Expand {
                    info,
                    count,
                    index,
                    words: [a, b, c, d],
                });
            }
        }
    }
}
