//! Samples along footprints, of which a subgroup takes up to sixteen.

use lanes::vector::{Task, Vector};

use super::super::chunk::{ChunkRows, SUBGROUPS};
use super::super::rows::Wave;
use super::Fast;
use super::blend::{Accumulate, Finish, Near, Out};
use super::levels::{ChooseLods, LevelRows, Lods, PutLevels};
use super::places::Places;

impl Fast<'_> {
    /// Samples along footprints. Each is that of a subgroup of a chunk, which may have several.
    ///
    /// # Safety
    /// As [`Self::sample`]; places were put.
    #[inline(always)]
    pub(super) unsafe fn of_footprints<V: Vector>(&self, v: V, wave: &Wave<'_>, places: &Places) {
        let fast = self;
        let mut lods = Lods::new();
        let mut sums = [const { ChunkRows::new() }; 4];
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            v.apart(ChooseLods {
                fast,
                wave,
                lods: &mut lods,
            });
            let (mut samples, mut count) = ([(0, 0); SUBGROUPS], 0);
            let last = wave.subgroups.len() - 1;
            for subgroup in 0..=last {
                let passes = lods.passes[subgroup % SUBGROUPS];
                for pass in 0..passes {
                    samples[count] = (subgroup as u8, pass);
                    count += 1;
                    let is_last = subgroup == last && pass + 1 == passes;
                    if count == SUBGROUPS || is_last {
                        v.apart(AlongFootprints {
                            fast,
                            wave,
                            places,
                            lods: &lods,
                            samples: &samples[..count],
                            sums: &mut sums,
                        });
                        count = 0;
                    }
                }
            }
            v.apart(Finish {
                fast,
                wave,
                rows: &sums,
                near: None,
                counts: Some(&lods.counts),
            });
        }
    }
}

/// Up to sixteen samples along footprints.
struct AlongFootprints<'a, 'b> {
    fast: &'b Fast<'a>,
    wave: &'b Wave<'b>,
    places: &'b Places,
    lods: &'b Lods,
    /// The subgroup of each sample, and its number along the footprint.
    samples: &'b [(u8, u8)],
    sums: &'b mut [ChunkRows; 4],
}

impl<V: Vector> Task<V> for AlongFootprints<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let AlongFootprints {
            fast,
            wave,
            places,
            lods,
            samples,
            sums,
        } = self;
        let mut of_samples = Places::new(true);
        let [mut numbers, mut weights] = [const { ChunkRows::new() }; 2];
        let (mut subgroups, mut between) = ([0; SUBGROUPS], 0);
        // SAFETY: the caller keeps the contract of `Fast::of_footprints`: places and levels of
        // detail of all subgroups were put.
        unsafe {
            for (index, &(subgroup, pass)) in samples.iter().enumerate() {
                let subgroup = usize::from(subgroup);
                subgroups[index] = wave.subgroups[subgroup];
                let moved = lods.anisotropy(v, subgroup).place(v, u32::from(pass));
                for (axis, moved) in moved.into_iter().enumerate().take(fast.spatial) {
                    let at = v.add(v.load(places.coordinate(wave, subgroup, axis)), moved);
                    of_samples.coordinates[axis].put(v, index, v.bits_of(at));
                }
                if fast.has_layers() {
                    let layers = places.layers.get(v, subgroup);
                    of_samples.layers.put(v, index, layers);
                }
                numbers.put(v, index, lods.levels.get(v, subgroup));
                weights.put(v, index, lods.weights.get(v, subgroup));
                between |= (lods.between >> subgroup & 1) << index;
            }
            let wave = &Wave {
                subgroups: &subgroups[..samples.len()],
                ..*wave
            };
            let mut levels = LevelRows::new();
            let [mut rows, mut far] = [const { [const { ChunkRows::new() }; 4] }; 2];
            if fast.has_levels() {
                v.apart(PutLevels {
                    fast,
                    wave,
                    levels: &numbers,
                    is_next: false,
                    to: &mut levels,
                });
            }
            let at = (&of_samples, fast.has_levels().then_some(&levels));
            fast.of_level(v, wave, at, Out::Rows(&mut rows));
            let mut near = None;
            if between != 0 {
                near = Some(Near {
                    rows: &rows,
                    weights: &weights,
                    between,
                });
                v.apart(PutLevels {
                    fast,
                    wave,
                    levels: &numbers,
                    is_next: true,
                    to: &mut levels,
                });
                let at = (&of_samples, Some(&levels));
                fast.of_level(v, wave, at, Out::Rows(&mut far));
            }
            v.apart(Accumulate {
                fast,
                samples,
                lods,
                rows: if near.is_some() { &far } else { &rows },
                near,
                sums,
            });
        }
    }
}
