//! Vectors of each instruction set that the machine has, against the same on single lanes.

use super::*;
use crate::LANES;

/// The test body for each instruction set.
trait TierTest {
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn run<V: Vector>(&mut self, v: V);
}

fn in_every_tier(case: &mut impl TierTest) {
    for tier in Tier::available() {
        // SAFETY: the tier is present.
        unsafe {
            match tier {
                #[cfg(target_arch = "x86_64")]
                Tier::Avx2 => avx2(case),
                #[cfg(target_arch = "x86_64")]
                Tier::Avx512 => avx512(case),
                _ => case.run(Portable::new()),
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt,f16c")]
unsafe fn avx2(case: &mut impl TierTest) {
    // SAFETY: the function's features.
    unsafe { case.run(Avx2::new()) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(
    enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,bmi1,bmi2,lzcnt,popcnt,f16c"
)]
unsafe fn avx512(case: &mut impl TierTest) {
    // SAFETY: the function's features.
    unsafe { case.run(Avx512::new()) }
}

/// The difference of two lanes of each quad that are both in the mask, else zero.
fn derivative(numbers: &[f32; LANES], axis: usize, mask: u16) -> [f32; LANES] {
    std::array::from_fn(|lane| {
        let (first, second) = (lane & !axis, lane | axis);
        let are_active = mask >> first & mask >> second & 1 == 1;
        match are_active {
            true => numbers[second] - numbers[first],
            false => 0.0,
        }
    })
}

/// Numbers of all kinds, integers, any bits.
fn words(seed: u64) -> Row {
    let mut random = fastrand::Rng::with_seed(seed);
    std::array::from_fn(|_| match random.u32(..4) {
        0 => random.u32(..),
        1 => (2.4 * random.f32() - 1.2).to_bits(),
        2 => random.u32(..1024).wrapping_sub(512),
        _ => random
            .choice([0.0, -0.0, f32::INFINITY, f32::NAN, f32::MIN_POSITIVE])
            .unwrap()
            .to_bits(),
    })
}

/// Moves words between the lanes of quads.
struct Quads {
    words: Row,
    mask: u16,
}

impl TierTest for Quads {
    #[inline(always)]
    unsafe fn run<V: Vector>(&mut self, v: V) {
        let a = &self.words;
        let row = |words: V::I| {
            let mut row = [0; 16];
            v.store_i(words, &mut row);
            row
        };
        let four = [a[0], a[1], a[2], a[3]];
        let spread: [u32; 16] = std::array::from_fn(|lane| four[lane / 4]);
        assert_eq!(row(v.quads(&four)), spread);
        let numbers = a.map(f32::from_bits);
        let slopes = [
            v.derivative::<{ quad::X }>(v.load(a), self.mask),
            v.derivative::<{ quad::Y }>(v.load(a), self.mask),
        ];
        let expected = [
            derivative(&numbers, quad::X, self.mask),
            derivative(&numbers, quad::Y, self.mask),
        ];
        for (slope, expected) in slopes.into_iter().zip(expected) {
            for (word, number) in row(v.bits_of(slope)).into_iter().zip(expected) {
                let same = word == number.to_bits();
                assert!(same || f32::from_bits(word).is_nan() && number.is_nan());
            }
        }
    }
}

#[test]
fn lanes_of_quads_move_alike() {
    for seed in 0..64u64 {
        let mask = match seed {
            0 => u16::MAX,
            _ => (seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 48) as u16,
        };
        in_every_tier(&mut Quads {
            words: words(seed),
            mask,
        });
    }
}

/// Loads pairs of words as quads, and stores them elsewhere.
struct Pairs {
    stride: usize,
}

impl TierTest for Pairs {
    #[inline(always)]
    unsafe fn run<V: Vector>(&mut self, v: V) {
        let from: Vec<u8> = (0..3 * self.stride + 32)
            .map(|i| (i * 7 % 251) as u8)
            .collect();
        let mut to = vec![0; from.len()];
        let (mut first, mut second) = ([0; 16], [0; 16]);
        // SAFETY: four rows of 32 bytes are in the memory.
        unsafe {
            let (a, b) = v.load_quads_of_pairs(from.as_ptr(), self.stride);
            v.store_i(a, &mut first);
            v.store_i(b, &mut second);
            v.store_quads_of_pairs(a, b, to.as_mut_ptr(), self.stride);
        }
        for lane in 0..16 {
            // Quads of two by two: columns and rows by the bits of the lane's number.
            let column = lane & 1 | lane >> 1 & 2;
            let row = lane >> 1 & 1 | lane >> 2 & 2;
            let at = row * self.stride + 8 * column;
            let word = |at: usize| u32::from_le_bytes(from[at..at + 4].try_into().unwrap());
            assert_eq!([first[lane], second[lane]], [word(at), word(at + 4)]);
        }
        for row in 0..4 {
            let row = row * self.stride..row * self.stride + 32;
            assert_eq!(from[row.clone()], to[row]);
        }
    }
}

#[test]
fn pairs_of_words_are_quads_of_four_rows() {
    for stride in [32, 40, 129] {
        in_every_tier(&mut Pairs { stride });
    }
}

/// Loads numbers of 16 bits as quads, and stores them elsewhere.
struct Shorts {
    stride: usize,
}

impl TierTest for Shorts {
    #[inline(always)]
    unsafe fn run<V: Vector>(&mut self, v: V) {
        let from: Vec<u8> = (0..3 * self.stride + 8)
            .map(|i| (255 - i * 7 % 251) as u8)
            .collect();
        let mut to = vec![0; from.len()];
        let mut shorts = [0; 16];
        // SAFETY: four rows of eight bytes are in the memory.
        unsafe {
            let words = v.load_quads_of_shorts(from.as_ptr(), self.stride);
            v.store_i(words, &mut shorts);
            // The upper halves are not stored.
            let words = v.or_i(words, v.splat_i(-0x10000));
            v.store_quads_of_shorts(words, to.as_mut_ptr(), self.stride);
        }
        for lane in 0..16 {
            let column = lane & 1 | lane >> 1 & 2;
            let row = lane >> 1 & 1 | lane >> 2 & 2;
            let at = row * self.stride + 2 * column;
            let short = u16::from_le_bytes(from[at..at + 2].try_into().unwrap());
            assert_eq!(shorts[lane], u32::from(short));
        }
        for row in 0..4 {
            let row = row * self.stride..row * self.stride + 8;
            assert_eq!(from[row.clone()], to[row]);
        }
    }
}

#[test]
fn shorts_are_quads_of_four_rows() {
    for stride in [8, 10, 129] {
        in_every_tier(&mut Shorts { stride });
    }
}

struct Bytes;

impl TierTest for Bytes {
    #[inline(always)]
    unsafe fn run<V: Vector>(&mut self, v: V) {
        let bytes: [u8; 16] = std::array::from_fn(|lane| (250 - 17 * lane as i32) as u8);
        let [low, high] = [0, 8].map(|from| {
            let bytes = bytes[from..from + 8].try_into().unwrap();
            u64::from_le_bytes(bytes)
        });
        let mut row = [0; 16];
        let words = v.of_bytes([low, high]);
        v.store_i(words, &mut row);
        assert_eq!(row, bytes.map(u32::from));
        // The upper bits are not taken.
        let words = v.or_i(words, v.splat_i(-0x100));
        assert_eq!(v.to_bytes(words), [low, high]);
    }
}

#[test]
fn bytes_are_lanes_in_order() {
    in_every_tier(&mut Bytes);
}

/// Puts texels of so many words to quads anywhere.
struct EachQuad {
    words: usize,
    mask: u16,
}

impl TierTest for EachQuad {
    #[inline(always)]
    unsafe fn run<V: Vector>(&mut self, v: V) {
        let (stride, size) = (149, 4 * self.words);
        let before: Vec<u8> = (0..4 * stride).map(|i| (i * 7 % 251) as u8).collect();
        let starts = [5, 2 * stride + 70, 71, 2 * stride + 1];
        let mut after = before.clone();
        let rows: [[u32; 16]; 4] = std::array::from_fn(|index| {
            std::array::from_fn(|lane| 0x8765_0000 + 0x100 * index as u32 + lane as u32)
        });
        let texels = [0, 1, 2, 3].map(|index| v.load_i(&rows[index]));
        let mut loaded = [0; 16];
        // SAFETY: from all four places on two rows of 32 bytes are in the memory.
        unsafe {
            let at = starts.map(|start| after.as_mut_ptr().add(start));
            match self.words {
                1 => v.put_each_quad([texels[0]], self.mask, at, stride),
                2 => v.put_each_quad([texels[0], texels[1]], self.mask, at, stride),
                _ => v.put_each_quad(texels, self.mask, at, stride),
            }
            let at = at.map(|at| at.cast_const());
            v.store_i(v.load_each_quad(at, stride), &mut loaded);
        }
        let mut expected = before;
        for lane in 0..16 {
            let at = starts[lane / 4] + lane / 2 % 2 * stride + lane % 2 * size;
            if self.mask >> lane & 1 != 0 {
                for index in 0..self.words {
                    let place = at + 4 * index..at + 4 * index + 4;
                    expected[place].copy_from_slice(&rows[index][lane].to_le_bytes());
                }
            }
        }
        assert_eq!(after, expected);
        for lane in 0..16 {
            let at = starts[lane / 4] + lane / 2 % 2 * stride + lane % 2 * 4;
            let word = u32::from_le_bytes(expected[at..at + 4].try_into().unwrap());
            assert_eq!(loaded[lane], word);
        }
    }
}

#[test]
fn texels_of_masks_are_put_to_quads_anywhere() {
    for words in [1, 2, 4] {
        for mask in [0, 0xffff, 0x8421, 0x1248, 0x7bde, 0xf00f, 0x0550] {
            in_every_tier(&mut EachQuad { words, mask });
        }
    }
}

/// Blends texels of a kind, in so many lines.
struct Neighbours<const KIND: u8, const LINES: usize>;

impl<const KIND: u8, const LINES: usize> Neighbours<KIND, LINES> {
    /// A component of the texel at a place.
    fn component(memory: &[u8], at: usize, component: usize) -> f32 {
        let short = |at: usize| u16::from_le_bytes([memory[at], memory[at + 1]]);
        match KIND {
            FourOf::BYTES => f32::from(memory[at + component]),
            FourOf::SHORTS => f32::from(short(at + 2 * component)),
            FourOf::HALVES => crate::halves::half_to_f32(short(at + 2 * component)),
            _ => {
                let at = at + 4 * component;
                f32::from_le_bytes(memory[at..at + 4].try_into().unwrap())
            }
        }
    }
}

impl<const KIND: u8, const LINES: usize> TierTest for Neighbours<KIND, LINES> {
    #[inline(always)]
    unsafe fn run<V: Vector>(&mut self, v: V) {
        let mut random = fastrand::Rng::with_seed(u64::from(KIND));
        let mut memory = vec![0; 4096];
        // Finite numbers of each kind: a half's exponent is less than 31, a float's less than 255.
        for (index, byte) in memory.iter_mut().enumerate() {
            *byte = random.u8(..);
            let is_top = match KIND {
                FourOf::HALVES => index % 2 == 1,
                FourOf::WORDS => index % 4 == 3,
                _ => false,
            };
            *byte &= if is_top { 0x3b } else { 0xff };
        }
        let size = [4, 8, 8, 16][usize::from(KIND)];
        let offsets: [Row; LINES] =
            std::array::from_fn(|_| std::array::from_fn(|_| size * random.u32(..4096 / size - 1)));
        let weights: [[f32; 16]; 3] =
            std::array::from_fn(|_| std::array::from_fn(|_| random.f32()));
        let mut rows = [[0; 16]; 4];
        // SAFETY: two texels are in the memory from each offset on.
        unsafe {
            let offsets = offsets.map(|row| v.load_i(&row));
            let weights = weights.map(|row| v.load(&row.map(f32::to_bits)));
            let blended = v.blend_neighbours::<KIND, LINES>(memory.as_ptr(), offsets, weights);
            for (row, numbers) in rows.iter_mut().zip(blended) {
                v.store(numbers, row);
            }
        }
        let lerp = |a: f32, b: f32, weight: f32| a + weight * (b - a);
        for (component, row) in rows.iter().enumerate() {
            for lane in 0..16 {
                let [x, y, z] = weights.map(|row| row[lane]);
                let line = |line: usize| {
                    let at = offsets[line][lane] as usize;
                    let left = Self::component(&memory, at, component);
                    lerp(
                        left,
                        Self::component(&memory, at + size as usize, component),
                        x,
                    )
                };
                let mut expected = lerp(line(0), line(1), y);
                if LINES == 4 {
                    expected = lerp(expected, lerp(line(2), line(3), y), z);
                }
                assert_eq!(row[lane], expected.to_bits(), "{component} of lane {lane}");
            }
        }
    }
}

#[test]
fn neighbours_are_blended_in_lines_and_slices() {
    in_every_tier(&mut Neighbours::<{ FourOf::BYTES }, 2>);
    in_every_tier(&mut Neighbours::<{ FourOf::BYTES }, 4>);
    in_every_tier(&mut Neighbours::<{ FourOf::SHORTS }, 2>);
    in_every_tier(&mut Neighbours::<{ FourOf::SHORTS }, 4>);
    in_every_tier(&mut Neighbours::<{ FourOf::HALVES }, 2>);
    in_every_tier(&mut Neighbours::<{ FourOf::HALVES }, 4>);
    in_every_tier(&mut Neighbours::<{ FourOf::WORDS }, 2>);
    in_every_tier(&mut Neighbours::<{ FourOf::WORDS }, 4>);
}

/// Texels of each size at offsets in memory.
struct AtOffsets {
    bytes: Vec<u8>,
}

impl TierTest for AtOffsets {
    unsafe fn run<V: Vector>(&mut self, v: V) {
        let mut random = fastrand::Rng::with_seed(6);
        let bytes = &self.bytes;
        let base = bytes.as_ptr();
        let words = |a: V::I| {
            let mut row = [0; LANES];
            v.store_i(a, &mut row);
            row
        };
        for _ in 0..200 {
            let places: Row = std::array::from_fn(|_| random.u32(..bytes.len() as u32 - 15));
            let expected = |k: usize, size: usize| {
                places.map(|at| {
                    let at = at as usize + 4 * k;
                    let mut word = [0; 4];
                    word[..size].copy_from_slice(&bytes[at..at + size]);
                    u32::from_le_bytes(word)
                })
            };
            // SAFETY: sixteen bytes are readable at each place.
            unsafe {
                assert_eq!(words(v.scalars_at::<u8>(base, &places)), expected(0, 1));
                assert_eq!(words(v.scalars_at::<u16>(base, &places)), expected(0, 2));
                assert_eq!(words(v.words_at(base, &places)), expected(0, 4));
                let (a, b) = v.pairs_at(base, &places);
                assert_eq!([words(a), words(b)], [0, 1].map(|k| expected(k, 4)));
                let four = v.quads_at(base, &places).map(words);
                assert_eq!(four, [0, 1, 2, 3].map(|k| expected(k, 4)));
            }
        }
    }
}

#[test]
fn texels_are_found_at_offsets_in_memory() {
    let mut random = fastrand::Rng::with_seed(7);
    let bytes = (0..1024).map(|_| random.u8(..)).collect();
    in_every_tier(&mut AtOffsets { bytes });
}

/// Words of each size on two rows, which may lie in windows.
struct InWindows {
    bytes: Vec<u8>,
}

impl TierTest for InWindows {
    unsafe fn run<V: Vector>(&mut self, v: V) {
        let mut random = fastrand::Rng::with_seed(8);
        let (bytes, mut found) = (&self.bytes, 0);
        let readable = bytes.len() as u64;
        let words = |a: V::I| {
            let mut row = [0; LANES];
            v.store_i(a, &mut row);
            row
        };
        for _ in 0..2000 {
            let size = 1 << random.u32(..3);
            let starts = [(); 2].map(|()| random.u32(..bytes.len() as u32 - 80));
            let reach = random.u32(1..20);
            let places: Row = std::array::from_fn(|lane| {
                starts[lane >> 1 & 1] + size * random.u32(..reach).min(19 - 16 * (size / 4))
            });
            let expected = |behind: usize| {
                places.map(|at| {
                    let mut word = [0; 4];
                    let at = at as usize + behind;
                    word[..size as usize].copy_from_slice(&bytes[at..at + size as usize]);
                    u32::from_le_bytes(word)
                })
            };
            // SAFETY: all bytes are readable.
            unsafe {
                let base = bytes.as_ptr();
                let ones = u32::MAX >> (32 - 8 * size);
                let near = match size {
                    1 => v.words_in_windows::<1>(base, &places, readable),
                    2 => v.words_in_windows::<2>(base, &places, readable),
                    _ => v.words_in_windows::<4>(base, &places, readable),
                };
                if let Some(near) = near {
                    assert_eq!(words(near).map(|word| word & ones), expected(0));
                    found += 1;
                }
                if size == 4
                    && let Some((a, b)) = v.pairs_in_windows(base, &places, readable)
                {
                    assert_eq!([words(a), words(b)], [expected(0), expected(4)]);
                }
            }
        }
        assert_eq!(found > 500, V::HAS_WINDOWS, "{found} of {}", V::TIER);
    }
}

#[test]
fn words_are_found_in_windows() {
    let mut random = fastrand::Rng::with_seed(9);
    let bytes = (0..512).map(|_| random.u8(..)).collect();
    in_every_tier(&mut InWindows { bytes });
}
