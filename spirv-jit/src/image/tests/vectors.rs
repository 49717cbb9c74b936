//! Texels in vectors against the formats' own code for one texel, in every instruction set that the
//! machine has.

use super::super::format::block::{self, Texels};
use super::super::operands::Operands;
use super::super::plain::Plain;
use super::super::texels;
use super::*;
use lanes::Tier;
use lanes::vector::{self, Vector};
use shaders::sparse::Sparse;

/// The test body for each instruction set.
pub(super) trait Case {
    /// # Safety
    /// The machine has the instruction set.
    unsafe fn run<V: Vector>(&mut self, v: V);
}

pub(super) fn in_every_tier(case: &mut impl Case) {
    for tier in Tier::available() {
        // SAFETY: the tier is present.
        unsafe {
            match tier {
                #[cfg(target_arch = "x86_64")]
                Tier::Avx2 => avx2(case),
                #[cfg(target_arch = "x86_64")]
                Tier::Avx512 => avx512(case),
                _ => case.run(vector::Portable::new()),
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,f16c")]
unsafe fn avx2(case: &mut impl Case) {
    // SAFETY: the function's features.
    unsafe { case.run(vector::Avx2::new()) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,f16c")]
unsafe fn avx512(case: &mut impl Case) {
    // SAFETY: the function's features.
    unsafe { case.run(vector::Avx512::new()) }
}

fn formats() -> impl Iterator<Item = Format> {
    Format::all().filter(|format| format.info().unwrap().in_vectors)
}

fn decoded_formats() -> impl Iterator<Item = Format> {
    Format::all().filter(|format| format.info().unwrap().decoded_in_vectors)
}

/// Stores words as texels at places.
struct Store {
    format: Format,
    words: Texels,
    places: [u32; 16],
    mask: u16,
}

impl Case for Store {
    #[inline(always)]
    unsafe fn run<V: Vector>(&mut self, v: V) {
        let info = self.format.info().unwrap();
        let size = info.size_bytes as usize;
        let mut memory = vec![0xcdu8; 4096];
        let mut expected = memory.clone();
        for lane in (0..16).filter(|lane| self.mask >> lane & 1 == 1) {
            let mut texel = [0; 32];
            info.encode(self.words.map(|row| row[lane]), &mut texel);
            expected[self.places[lane] as usize..][..size].copy_from_slice(&texel[..size]);
        }
        let texels = [
            v.load_i(&self.words[0]),
            v.load_i(&self.words[1]),
            v.load_i(&self.words[2]),
            v.load_i(&self.words[3]),
        ];
        // SAFETY: the places are in the memory.
        unsafe {
            let at = v.load_i(&self.places);
            texels::store(v, info, memory.as_mut_ptr(), at, self.mask, &texels);
        }
        assert!(memory == expected, "{} of {:x?}", info.name, self.words);
    }
}

/// Loads texels from places.
struct Load<'m> {
    format: Format,
    memory: &'m [u8],
    places: [u32; 16],
}

impl Case for Load<'_> {
    #[inline(always)]
    unsafe fn run<V: Vector>(&mut self, v: V) {
        let info = self.format.info().unwrap();
        let size = info.size_bytes as usize;
        let mut texels = [[0; 16]; 4];
        // SAFETY: the places are in the memory.
        let loaded = unsafe { texels::load(v, info, self.memory.as_ptr(), v.load_i(&self.places)) };
        for (row, words) in texels.iter_mut().zip(loaded) {
            v.store_i(words, row);
        }
        block::finish(info, &mut texels);
        for lane in 0..16 {
            let words = info.decode(&self.memory[self.places[lane] as usize..][..size]);
            assert_eq!(texels.map(|row| row[lane]), words, "{}", info.name);
        }
    }
}

/// Words of all kinds: numbers in and out of range, ties of 8 and 16 bits and their neighbours,
/// integers, any bits.
fn words(seed: u64) -> Texels {
    const SPECIAL: [f32; 10] = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        0.5,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
        -f32::NAN,
        f32::MIN_POSITIVE,
    ];
    let mut random = fastrand::Rng::with_seed(seed);
    let mut word = || {
        let (kind, any) = (random.u32(..), random.u32(..));
        let part = (any >> 8) as f32 / (1 << 24) as f32;
        let tie = |codes: u32| {
            let code = (any >> 8) % codes;
            let number = (code as f32 + 0.5) / codes as f32;
            number.to_bits().wrapping_add(any % 3).wrapping_sub(1)
        };
        match kind % 8 {
            0 => any,
            1 => (2.4 * part - 1.2).to_bits(),
            2 => (70_300.0 * part - 300.0).to_bits(),
            3 => (1e-4 * part).to_bits(),
            4 => tie(255),
            5 => tie(65535),
            6 => (any % 1024).wrapping_sub(512),
            _ => SPECIAL[any as usize % SPECIAL.len()].to_bits(),
        }
    };
    let mut texels = [[0; 16]; 4];
    for each in texels.iter_mut().flatten() {
        *each = word();
    }
    texels
}

/// Places of sixteen texels: a row, rows of a tile, or anywhere; no two overlap.
fn any_places() -> impl Strategy<Value = [u32; 16]> {
    prop_oneof![
        Just(std::array::from_fn(|lane| lane as u32)),
        Just(std::array::from_fn(|lane| {
            let lane = lane as u32;
            (lane & 1) | (lane >> 2 & 1) << 1 | (lane >> 1 & 1) << 4 | (lane >> 3) << 5
        })),
        Just((0u32..100).collect::<Vec<_>>())
            .prop_shuffle()
            .prop_map(|all| std::array::from_fn(|lane| all[lane])),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(effort::rounds(1000)))]

    #[test]
    fn stores_encode_as_texels_alone(
        seed: u64, places in any_places(), mask: u16, all: bool,
    ) {
        for format in formats() {
            let size = format.size_bytes() as u32;
            let places = places.map(|place| place * size + 3);
            let mask = if all { u16::MAX } else { mask };
            in_every_tier(&mut Store { format, words: words(seed), places, mask });
        }
    }

    #[test]
    fn loads_decode_as_texels_alone(memory in prop::collection::vec(any::<u8>(), 1700), places in any_places()) {
        for format in decoded_formats() {
            let size = format.size_bytes() as u32;
            let places = places.map(|place| place * size + 3);
            // Nothing lies behind the last texel.
            let end = places.iter().max().unwrap() + size;
            let memory = memory[..end as usize].to_vec();
            in_every_tier(&mut Load { format, memory: &memory, places });
        }
    }
}

/// Every sRGB code's threshold and its neighbours, and all around the ends of the pieces that the
/// vectors look codes up in.
#[test]
fn srgb_codes_are_the_same_at_every_threshold() {
    let info = Format::R8G8B8A8_SRGB.info().unwrap();
    let mut numbers: Vec<u32> = Vec::new();
    let code = |bits: u32| {
        let mut texel = [0; 4];
        info.encode([bits, 0, 0, 0], &mut texel);
        texel[0]
    };
    // Numbers between neighbours of different codes, found by halving.
    let mut low = 0u32;
    while code(low) < 255 {
        let (mut below, mut above) = (low, 1f32.to_bits());
        while above - below > 1 {
            let middle = below + (above - below) / 2;
            match code(middle) == code(low) {
                true => below = middle,
                false => above = middle,
            }
        }
        numbers.extend([below - 1, below, above, above + 1]);
        low = above;
    }
    assert_eq!(numbers.len(), 255 * 4);
    for piece in (110u32 << 23..128 << 23).step_by(1 << 16) {
        numbers.extend([piece - 1, piece, piece + 1]);
    }
    for chunk in numbers.chunks(16) {
        let row = std::array::from_fn(|lane| chunk[lane % chunk.len()]);
        in_every_tier(&mut Store {
            format: Format::R8G8B8A8_SRGB,
            words: [row; 4],
            places: std::array::from_fn(|lane| lane as u32 * 4),
            mask: u16::MAX,
        });
    }
}

/// A whole operation.
struct Operation<'o> {
    op: ImageOp,
    /// An image that is used, and one of the same contents whose operation is the reference.
    images: [&'o Image; 2],
    rows: Vec<Row>,
    mask: u16,
}

impl Case for Operation<'_> {
    #[inline(always)]
    unsafe fn run<V: Vector>(&mut self, v: V) {
        let rows: Vec<&Row> = self.rows.iter().collect();
        let [image, reference] = self.images.map(|image| &image.descriptor);
        let info = image.format.info().unwrap();
        let plain = Plain::new(&self.op, image, info).expect("one for vectors");
        let operands = Operands::new(&self.op, &rows);
        let mut results = [[0; 16]; 8];
        let mut expected = [[0; 16]; 8];
        // SAFETY: the images' memory is there; as the trait says.
        let done = unsafe {
            execute_block(
                &self.op,
                Some(reference),
                None,
                self.mask,
                &rows,
                &mut expected,
            );
            match self.op.kind {
                ImageOpKind::Write => plain.write(v, &operands, self.mask),
                _ => match plain.read(v, &operands, self.mask) {
                    Some(texel) => {
                        for (component, row) in texel.into_iter().zip(&mut results) {
                            v.store_i(component, row);
                        }
                        true
                    }
                    None => false,
                },
            }
        };
        // Lanes of different levels, or of none that there is, are not for vectors.
        let lods = self.op.lod == LodMode::Lod;
        assert!(done || lods);
        if !done {
            return;
        }
        for lane in (0..16).filter(|lane| self.mask >> lane & 1 == 1) {
            let of = |rows: &[Row; 8]| [0, 1, 2, 3].map(|c: usize| rows[c][lane]);
            assert_eq!(of(&results), of(&expected), "{}", info.name);
        }
        assert_eq!(
            self.images[0].bytes(),
            self.images[1].bytes(),
            "{}",
            info.name
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(effort::rounds(200)))]

    /// Reads, writes and fetches with layers, levels and offsets, inside and outside.
    #[test]
    fn operations_are_those_of_the_general_way(
        dim in 0usize..4, size in prop::array::uniform3(1u32..9), layers in 1u32..4, seed: u64, mask in 1u16..,
        coordinates in prop::array::uniform4(prop::array::uniform16(-1i32..9)), lod in -1i32..4, offset in prop::option::of(-2i32..3),
        swizzle in prop::array::uniform4(0u8..6), kind in 0usize..3,
    ) {
        let dim = [Dim::D1, Dim::D2, Dim::D3, Dim::Cube][dim];
        let axes = match dim { Dim::D1 => 1, Dim::D2 => 2, _ => 3 };
        let stored = match dim { Dim::D3 => 3, Dim::D1 => 1, _ => 2 };
        let size: [u32; 3] = std::array::from_fn(|axis| if axis < stored { size[axis] } else { 1 });
        let layers = match dim { Dim::D3 => 1, Dim::Cube => 6, _ => layers };
        let kind = [ImageOpKind::Fetch, ImageOpKind::Read, ImageOpKind::Write][kind];
        for format in formats() {
            let info = format.info().unwrap();
            let texel = if info.numeric.is_integer() { Type::I32 } else { Type::F32 };
            let is_fetch = kind == ImageOpKind::Fetch && dim != Dim::Cube;
            let op = ImageOp {
                arrayed: layers > 1 && dim != Dim::Cube,
                lod: if is_fetch { LodMode::Lod } else { LodMode::Implicit },
                has_offset: is_fetch && offset.is_some(),
                texel,
                ..ImageOp::plain(kind, dim)
            };
            let mut rows: Vec<Row> = (0..axes).map(|axis| coordinates[axis].map(|c| c as u32)).collect();
            if op.arrayed { rows.push(coordinates[3].map(|c| c as u32)); }
            if is_fetch { rows.push([lod as u32; 16]); }
            if op.has_offset { rows.extend(vec![[offset.unwrap() as u32; 16]; axes]); }
            if kind == ImageOpKind::Write { rows.extend(words(seed)); }
            let image = || {
                let mut image = Image::new(format, dim, size, 3, layers, seed as u32);
                if kind != ImageOpKind::Write { image.descriptor.swizzle = swizzle; }
                image
            };
            in_every_tier(&mut Operation { op, images: [&image(), &image()], rows, mask });
        }
    }
}

/// Reads and writes sixteen texels of a large buffer.
struct Far<'m> {
    memory: &'m Sparse,
    format: Format,
    /// Of the buffer, whose last texels these are.
    size_bytes: u64,
}

impl Case for Far<'_> {
    #[inline(always)]
    unsafe fn run<V: Vector>(&mut self, v: V) {
        let info = self.format.info().unwrap();
        let (data, texel_bytes) = (self.memory.as_mut_ptr(), u64::from(info.size_bytes));
        let image = ImageDescriptor::texel_buffer(data, self.size_bytes, self.format);
        let texels = self.size_bytes / texel_bytes;
        // Apart, and the last one last.
        let index = |lane: u64| texels - 1 - 3 * (15 - lane);
        let words: Texels = std::array::from_fn(|component| {
            std::array::from_fn(|lane| (component as u32 + 1) * (16 + lane as u32))
        });
        let op = |kind| ImageOp {
            texel: Type::I32,
            ..ImageOp::plain(kind, Dim::Buffer)
        };
        let (write, read) = (op(ImageOpKind::Write), op(ImageOpKind::Read));
        let place: Row = std::array::from_fn(|lane| index(lane as u64) as u32);
        let rows = [&place, &words[0], &words[1], &words[2], &words[3]];
        let plain = |op| Plain::new(op, &image, info);
        // Offsets in vectors have a sign.
        let is_small = self.size_bytes <= i32::MAX as u64;
        assert_eq!(plain(&read).is_some(), is_small);
        let mut results = [[0; 16]; 8];
        // SAFETY: the memory is there; as the trait says.
        unsafe {
            match plain(&write) {
                Some(plain) => assert!(plain.write(v, &Operands::new(&write, &rows), u16::MAX)),
                None => execute_block(&write, Some(&image), None, u16::MAX, &rows, &mut results),
            }
            match plain(&read) {
                Some(plain) => {
                    let texel = plain.read(v, &Operands::new(&read, &rows[..1]), u16::MAX);
                    for (component, row) in texel.unwrap().into_iter().zip(&mut results) {
                        v.store_i(component, row);
                    }
                }
                None => {
                    let rows = &rows[..1];
                    execute_block(&read, Some(&image), None, u16::MAX, rows, &mut results);
                }
            }
        }
        for lane in 0..16 {
            let mut texel = [0; 32];
            info.encode(words.map(|row| row[lane]), &mut texel);
            let stored: [u8; 16] = match texel_bytes {
                16 => self.memory.read(index(lane as u64) * texel_bytes),
                _ => {
                    let first = index(lane as u64) * texel_bytes;
                    std::array::from_fn(|k| match (k as u64) < texel_bytes {
                        true => self.memory.read::<1>(first + k as u64)[0],
                        false => 0,
                    })
                }
            };
            assert_eq!(stored, texel[..16], "{} {}", info.name, self.size_bytes);
            let read: [u32; 4] = std::array::from_fn(|component| results[component][lane]);
            assert_eq!(
                read,
                info.decode(&texel[..texel_bytes as usize]),
                "{}",
                info.name
            );
        }
    }
}

/// Texels at offsets of 31 and of 32 bits, and beyond.
#[test]
fn texels_of_large_buffers() {
    let memory = Sparse::new(5 << 30);
    for format in [
        Format::R8_UINT,
        Format::R16G16_UINT,
        Format::R32_UINT,
        Format::R32G32B32A32_UINT,
    ] {
        let texel_bytes = format.size_bytes() as u64;
        // Coordinates have 32 bits.
        let sizes = [(1 << 31) - 16, 1 << 31, (1 << 31) + 64, 4 << 30, 5 << 30];
        for size_bytes in sizes
            .into_iter()
            .filter(|size| size / texel_bytes < 1 << 32)
        {
            in_every_tier(&mut Far {
                memory: &memory,
                format,
                size_bytes,
            });
        }
    }
}
