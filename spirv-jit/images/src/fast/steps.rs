//! Samples and gathers of the chunks of a wave from one level, in the steps of [`chunk`]: nearest
//! texels, and the four texels around places, gathered, compared or blended. Axis by axis, all
//! subgroups' texels are placed; an axis knows nothing of the others, so the code is the same for
//! each dimension.

use lanes::vector::{Task, Vector};

use super::super::chunk::{self, ChunkRows, Decode, Source, Texels};
use super::super::decode::Decoder;
use super::super::rows::Wave;
use super::super::{AddressMode, ImageOpKind};
use super::Fast;
use super::footprints::{
    AxisTexels, Blend, BlendNeighbours, BlendSlices, Combine, Compare, FetchTaps, Taps, coordinate,
};
use super::planes::coordinates;

/// Taps of the four results of a gather: (0, 1), (1, 1), (1, 0), (0, 0).
const GATHERED: [usize; 4] = [2, 3, 1, 0];

/// Ways of [`Chunk`].
const NEAREST: u8 = 0;
const GATHER: u8 = 1;
const LINEAR: u8 = 2;

/// Samples of a chunk. Each way has a stack frame of its own.
struct Chunk<'a, 'b, const WAY: u8> {
    fast: &'b Fast<'a>,
    wave: &'b Wave<'b>,
}

impl<V: Vector, const WAY: u8> Task<V> for Chunk<'_, '_, WAY> {
    type Output = u16;

    #[inline(always)]
    unsafe fn run(self, v: V) -> u16 {
        // SAFETY: the caller keeps the contract of `Fast::steps`.
        unsafe {
            match WAY {
                GATHER => self.fast.gather_in_steps(v, self.wave),
                NEAREST => {
                    self.fast.nearest_in_steps(v, self.wave);
                    0
                }
                _ => self.fast.linear_in_steps(v, self.wave),
            }
        }
    }
}

impl Fast<'_> {
    /// Whether [`Self::steps`] is for these samples.
    #[inline(always)]
    pub(in super::super) fn is_of_steps<V: Vector>(&self) -> bool {
        let has_fields = matches!(
            self.decoder,
            Decoder::Fields | Decoder::Halves | Decoder::Words | Decoder::Srgb
        );
        let has_footprints = has_fields && self.pairs && self.spatial >= 2;
        let is_read = match (self.is_gather(), self.is_nearest) {
            (true, _) => has_footprints && self.spatial == 2,
            (_, true) => self.decoder != Decoder::Each,
            // Planes of four bytes have a loop of their own.
            _ if (self.straight || self.srgb) && self.spatial == 2 && !self.is_cube => false,
            _ => {
                let is_blended = V::BLENDS_NEIGHBOURS && self.four_of.is_some();
                has_footprints && (self.info.size_bytes <= 8 || is_blended)
            }
        };
        let is_compared = has_fields && self.info.channels[0].bits != 0;
        let is_read = is_read && (is_compared || !self.op.depth_compare);
        let has_one_level = self.is_gather() || !self.has_levels();
        is_read && has_one_level && !self.has_border && !self.is_anisotropic
    }

    /// Samples of up to sixteen subgroups, each of which has lanes that sample. A bit for each one
    /// that is left: footprints that cross edges of faces, above all.
    ///
    /// # Safety
    /// As [`sample`](super::super::wave::sample).
    #[inline(always)]
    pub(in super::super) unsafe fn steps<V: Vector>(&self, v: V, wave: &Wave<'_>) -> u16 {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            let fast = self;
            match (self.is_gather(), self.is_nearest) {
                (true, _) => v.apart(Chunk::<GATHER> { fast, wave }),
                (_, true) => v.apart(Chunk::<NEAREST> { fast, wave }),
                _ => v.apart(Chunk::<LINEAR> { fast, wave }),
            }
        }
    }

    /// # Safety
    /// As [`Self::steps`].
    #[inline(always)]
    unsafe fn nearest_in_steps<V: Vector>(&self, v: V, wave: &Wave<'_>) {
        let mut texels = Texels::new();
        let mut on_face = [ChunkRows::new(), ChunkRows::new()];
        // SAFETY: the caller keeps the contract of this function; texels of all axes are placed
        // inside the level.
        unsafe {
            v.apart(Start {
                fast: self,
                wave,
                layers: &mut texels.offsets,
                on_face: &mut on_face,
            });
            for axis in 0..self.spatial {
                v.apart(Nearest {
                    fast: self,
                    wave,
                    axis,
                    on_face: on_face.get(axis).filter(|_| self.is_cube),
                    offsets: &mut texels.offsets,
                    index: &mut texels.index,
                });
            }
            let (info, base) = (self.info, self.base());
            if !self.op.depth_compare {
                return chunk::put(v, info, base, self.image.swizzle, wave, &mut texels);
            }
            if wave.results[0].first.is_null() {
                return;
            }
            let source = Source::of_view(info, 0);
            let word = source.word().unwrap_or(0);
            v.apart(chunk::Fetch {
                base,
                size_bytes: info.size_bytes,
                wanted: 1 << word,
                count: wave.subgroups.len(),
                texels: &mut texels,
            });
            v.apart(Compare {
                fast: self,
                wave,
                source,
                words: &texels.words[word],
                component: 0,
            });
        }
    }

    /// # Safety
    /// As [`Self::steps`].
    #[inline(always)]
    unsafe fn gather_in_steps<V: Vector>(&self, v: V, wave: &Wave<'_>) -> u16 {
        let from = match self.op.kind {
            ImageOpKind::Gather(component) if !self.op.depth_compare => {
                self.image.swizzle[component as usize & 3]
            }
            _ => 0,
        };
        let source = Source::of_view(self.info, from);
        let mut taps = Taps::new();
        let mut rest = 0;
        // SAFETY: the caller keeps the contract of this function; texels of both axes are placed
        // inside the level.
        unsafe {
            if let Some(word) = source.word() {
                let inner = self.place_footprints(v, wave, &mut taps);
                if self.is_cube {
                    rest = !(inner[0] & inner[1]);
                }
                v.apart(FetchTaps {
                    fast: self,
                    wave,
                    word: Some(word),
                    in_pairs: inner[0],
                    texels: &mut taps.texels[0],
                    seconds: &mut taps.seconds[0],
                });
            }
            for (result, tap) in GATHERED.into_iter().enumerate() {
                if wave.results[result].first.is_null() {
                    continue;
                }
                let words = &taps.texels[0][tap];
                match self.op.depth_compare {
                    true => v.apart(Compare {
                        fast: self,
                        wave,
                        source,
                        words,
                        component: result,
                    }),
                    false => v.apart(Decode {
                        source,
                        words,
                        wave,
                        component: result,
                    }),
                }
            }
        }
        rest
    }

    /// # Safety
    /// As [`Self::steps`].
    #[inline(always)]
    unsafe fn linear_in_steps<V: Vector>(&self, v: V, wave: &Wave<'_>) -> u16 {
        let mut taps = Taps::new();
        // SAFETY: the caller keeps the contract of this function; texels of both axes are placed
        // inside the level.
        unsafe {
            let inner = self.place_footprints(v, wave, &mut taps);
            let rest = match self.is_cube {
                true => !(inner[0] & inner[1]),
                false => 0,
            };
            // The constant alone decides: where it is false, nothing behind it is compiled.
            if V::BLENDS_NEIGHBOURS
                && let Some(kind) = self.four_of
            {
                v.apart(BlendNeighbours {
                    fast: self,
                    wave,
                    kind,
                    in_pairs: inner[0],
                    taps: &mut taps,
                });
                return rest | !inner[0];
            }
            let slices = self.spatial - 1;
            for slice in 0..slices {
                v.apart(FetchTaps {
                    fast: self,
                    wave,
                    word: (self.info.size_bytes != 8).then_some(0),
                    in_pairs: inner[0],
                    texels: &mut taps.texels[slice],
                    seconds: &mut taps.seconds[slice],
                });
            }
            for (component, from) in self.image.swizzle.into_iter().enumerate() {
                if !wave.results[component].first.is_null() {
                    self.blend_in_steps(v, wave, &taps, component, from);
                }
            }
            rest
        }
    }

    /// Blends a component of texels.
    ///
    /// # Safety
    /// As [`Self::steps`]; words of the texels were fetched, and there is such a result.
    #[inline(always)]
    unsafe fn blend_in_steps<V: Vector>(
        &self,
        v: V,
        wave: &Wave<'_>,
        taps: &Taps,
        component: usize,
        from: u8,
    ) {
        let source = match self.op.depth_compare {
            true => Source::of_view(self.info, 0),
            false => Source::units_of_view(self.info, from),
        };
        let mut slices = [ChunkRows::new(), ChunkRows::new()];
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            let Some(word) = source.word() else {
                let words = &taps.layers;
                return v.apart(Decode {
                    source,
                    words,
                    wave,
                    component,
                });
            };
            let words = if word == 0 {
                &taps.texels
            } else {
                &taps.seconds
            };
            for slice in 0..self.spatial - 1 {
                v.apart(Blend {
                    fast: self,
                    wave,
                    source,
                    words: &words[slice],
                    weights: &taps.weights,
                    component,
                    to: slices.get_mut(slice).filter(|_| self.spatial == 3),
                });
            }
            if self.spatial == 3 {
                v.apart(BlendSlices {
                    fast: self,
                    wave,
                    slices: &slices,
                    weight: &taps.weights[2],
                    component,
                });
            }
        }
    }

    /// Places the texels around each lane. A bit for each subgroup whose lanes have both texels
    /// inside, along each axis.
    ///
    /// # Safety
    /// As [`Self::steps`].
    #[inline(always)]
    unsafe fn place_footprints<V: Vector>(
        &self,
        v: V,
        wave: &Wave<'_>,
        taps: &mut Taps,
    ) -> [u16; 3] {
        let mut on_face = [ChunkRows::new(), ChunkRows::new()];
        let mut inner = [0; 3];
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            v.apart(Start {
                fast: self,
                wave,
                layers: &mut taps.layers,
                on_face: &mut on_face,
            });
            for axis in 0..self.spatial {
                inner[axis] = v.apart(AxisTexels {
                    fast: self,
                    wave,
                    axis,
                    on_face: on_face.get(axis).filter(|_| self.is_cube),
                    offsets: &mut taps.along[axis],
                    weight: &mut taps.weights[axis],
                });
            }
            v.apart(Combine {
                wave,
                spatial: self.spatial,
                taps,
            });
        }
        inner
    }
}

/// The offsets of layers, or zeros; of cubes also the coordinates on faces.
struct Start<'a, 'b> {
    fast: &'b Fast<'a>,
    wave: &'b Wave<'b>,
    layers: &'b mut ChunkRows,
    on_face: &'b mut [ChunkRows; 2],
}

impl<V: Vector> Task<V> for Start<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave) = (&{ *self.fast }, &{ *self.wave });
        for index in 0..wave.subgroups.len() {
            // SAFETY: the caller keeps the contract of `Fast::steps`.
            unsafe {
                let layer = match (fast.is_cube, fast.op.arrayed) {
                    (true, _) => {
                        let (coordinates, count) = coordinates(fast, wave, index);
                        let place = fast.place(v, &coordinates[..count]);
                        let [s, t, _] = place.coordinates;
                        self.on_face[0].put(v, index, v.bits_of(s));
                        self.on_face[1].put(v, index, v.bits_of(t));
                        place.layer
                    }
                    (_, true) => fast.layer_offset(v, Some(wave.operand(index, fast.spatial))),
                    _ => v.splat_i(0),
                };
                self.layers.put(v, index, layer);
            }
        }
    }
}

/// Adds the offsets of nearest texels along an axis.
struct Nearest<'a, 'b> {
    fast: &'b Fast<'a>,
    wave: &'b Wave<'b>,
    axis: usize,
    on_face: Option<&'b ChunkRows>,
    offsets: &'b mut ChunkRows,
    /// Of texels in blocks.
    index: &'b mut ChunkRows,
}

impl<V: Vector> Task<V> for Nearest<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let Nearest {
            axis,
            on_face,
            offsets,
            index: in_blocks,
            ..
        } = self;
        let (fast, wave) = (&{ *self.fast }, &{ *self.wave });
        let (size, stride) = fast.extent(axis);
        let (size, stride) = (v.splat_i(size as i32), v.splat_i(stride as i32));
        let block_shift = if axis < 2 { fast.block_shift } else { 0 };
        macro_rules! each {
            ($mode:expr, $has_offset:expr) => {
                for index in 0..wave.subgroups.len() {
                    // SAFETY: the caller keeps the contract of `Fast::steps`; offsets of layers,
                    // and indices along x, were put.
                    unsafe {
                        let at = v.load(coordinate(wave, on_face, index, axis));
                        let offset = match $has_offset {
                            true => Some(v.load_i(wave.offset(fast.op, index, axis))),
                            false => None,
                        };
                        let mut texel = fast.nearest(v, $mode, (at, offset), size);
                        if block_shift != 0 {
                            let part = v.and_i(texel, v.splat_i(3));
                            let part = match axis {
                                0 => part,
                                _ => v.add_i(in_blocks.get(v, index), v.left_i(part, 2)),
                            };
                            in_blocks.put(v, index, part);
                            texel = v.right_u(texel, block_shift);
                        }
                        let offset = v.add_i(offsets.get(v, index), v.mul_i(texel, stride));
                        offsets.put(v, index, offset);
                    }
                }
            };
        }
        match fast.mode(axis) {
            AddressMode::Repeat if !fast.op.has_offset => each!(AddressMode::Repeat, false),
            AddressMode::ClampToEdge
                if !fast.op.has_offset && !fast.sampler.unnormalized_coordinates =>
            {
                each!(AddressMode::ClampToEdge, false);
            }
            mode => each!(mode, fast.op.has_offset),
        }
    }
}
