//! Texels in vectors against the formats' own code for one texel, in every instruction set that the
//! machine has.

use super::super::chunk;
use super::super::format::FormatInfo;
use super::super::format::block::Texels;
use super::super::plain::Plain;
use super::super::texels;
use super::super::wave::{self, Wave};
use super::*;
use effort::sparse::Sparse;
use lanes::Tier;

fn formats() -> impl Iterator<Item = Format> {
    Format::all().filter(|format| format.info().unwrap().in_vectors)
}

fn decoded_formats() -> impl Iterator<Item = Format> {
    Format::all().filter(|format| format.info().unwrap().decoded_in_vectors)
}

lanes::vectors! {
    /// [`texels::store`] of rows.
    ///
    /// # Safety
    /// As there.
    unsafe fn store_vectors<V>(
        v,
        info: &FormatInfo,
        base: *mut u8,
        offsets: &[u32; 16],
        mask: u16,
        texels: &Texels,
    ) {
        let texels = texels.each_ref().map(|row| v.load_i(row));
        // SAFETY: the caller keeps the contract of this function.
        unsafe { texels::store(v, info, base, v.load_i(offsets), mask, &texels) };
    }
}

/// Stores words as texels at places, in every tier.
fn store(format: Format, words: &Texels, places: &[u32; 16], mask: u16) {
    let info = format.info().unwrap();
    let size = info.size_bytes as usize;
    let before = vec![0xcdu8; 4096];
    let mut expected = before.clone();
    for lane in (0..16).filter(|lane| mask >> lane & 1 == 1) {
        let mut texel = [0; 32];
        info.encode(words.map(|row| row[lane]), &mut texel);
        expected[places[lane] as usize..][..size].copy_from_slice(&texel[..size]);
    }
    for &tier in Tier::available() {
        let mut memory = before.clone();
        // SAFETY: the places are in the memory, and the machine has the tier.
        unsafe { store_vectors(tier, info, memory.as_mut_ptr(), places, mask, words) };
        assert!(memory == expected, "{} of {words:x?}, {tier}", info.name);
    }
}

lanes::vectors! {
    /// Texels from places.
    ///
    /// # Safety
    /// They are readable.
    unsafe fn texels_at<V>(
        v,
        image: &ImageDescriptor,
        info: &FormatInfo,
        places: &[u32; 16],
    ) -> Texels {
        let mut results = [[0; 16]; 4];
        wave::of_one(&[], u16::MAX, &mut results, |one| {
            let mut texels = chunk::Texels::new();
            texels.offsets.put(v, 0, v.load_i(places));
            // SAFETY: the caller guarantees that the texels are readable; the wave has a row of
            // each result.
            unsafe { chunk::put(v, image, info, one, &mut texels) };
        });
        results
    }
}

/// Stores texels one behind the other, in every tier.
fn store_row(format: Format, sixteens: &[Texels], count: usize) {
    let info = format.info().unwrap();
    let size = info.size_bytes as usize;
    let before = vec![0xcdu8; 4096];
    let mut expected = before.clone();
    for (index, at) in expected[1..].chunks_exact_mut(size).take(count).enumerate() {
        let mut texel = [0; 32];
        let words = &sixteens[index / 16];
        info.encode(words.map(|row| row[index % 16]), &mut texel);
        at.copy_from_slice(&texel[..size]);
    }
    for &tier in Tier::available() {
        let mut memory = before.clone();
        let to = memory[1..].as_mut_ptr();
        // SAFETY: the row is in the memory, and the machine has the tier.
        unsafe { texels::store_row_in_vectors(tier, info, to, sixteens, count) };
        assert!(memory == expected, "{} {count}, {tier}", info.name);
    }
}

#[test]
fn rows_are_stored_without_their_neighbours() {
    for format in formats() {
        let sixteens = [words(1), words(2), words(3)];
        for count in [0, 1, 15, 16, 17, 31, 32, 40, 48] {
            store_row(format, &sixteens, count);
        }
    }
}

/// Loads texels from places, in every tier.
fn load(format: Format, memory: &[u8], places: &[u32; 16]) {
    let info = format.info().unwrap();
    let size = info.size_bytes as usize;
    let image = ImageDescriptor {
        data: memory.as_ptr().cast_mut(),
        size_bytes: memory.len() as u64,
        format,
        ..ImageDescriptor::NULL
    };
    for &tier in Tier::available() {
        // SAFETY: the places are in the memory, and the machine has the tier.
        let texels = unsafe { texels_at(tier, &image, info, places) };
        for lane in 0..16 {
            let words = info.decode(&memory[places[lane] as usize..][..size]);
            assert_eq!(texels.map(|row| row[lane]), words, "{}, {tier}", info.name);
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

/// Places of sixteen texels: a row, a 4×4 block whose rows may overlap, upwards or downwards, parts
/// of two rows, or anywhere.
fn any_places() -> impl Strategy<Value = [u32; 16]> {
    let block = (0u32..21, 0u32..20, any::<bool>(), 0usize..16).prop_map(
        |(stride, first, downwards, moved)| {
            std::array::from_fn(|at| {
                let lane = at as u32;
                let x = (lane & 1) | (lane >> 2 & 1) << 1;
                let y = (lane >> 1 & 1) | (lane >> 3) << 1;
                let y = if downwards { 3 - y } else { y };
                // One lane may be elsewhere.
                first + x + y * stride + u32::from(at == moved && first % 2 == 0)
            })
        },
    );
    let steps = prop::collection::vec(0u32..2, 16);
    let two_rows = (8u32..30, 0u32..60, any::<bool>(), any::<bool>(), steps).prop_map(
        |(first, distance, is_backwards, in_quads, steps)| {
            let row = |lane: usize| if in_quads { lane >> 1 & 1 } else { lane >> 3 };
            let mut at = [first, first + distance];
            std::array::from_fn(|lane| {
                let at = &mut at[row(lane)];
                *at = match is_backwards {
                    true => at.saturating_sub(steps[lane]),
                    false => *at + steps[lane],
                };
                *at
            })
        },
    );
    prop_oneof![
        Just(std::array::from_fn(|lane| lane as u32)),
        block,
        two_rows,
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
            store(format, &words(seed), &places, mask);
        }
    }

    #[test]
    fn loads_decode_as_texels_alone(
        memory in prop::collection::vec(any::<u8>(), 1700),
        places in any_places(),
        spare in 0..100usize,
    ) {
        for format in decoded_formats() {
            let size = format.size_bytes() as u32;
            let places = places.map(|place| place * size + 3);
            // Nothing lies behind the last texel, or not much.
            let end = places.iter().max().unwrap() + size;
            let end = (end as usize + spare / 2 * (spare % 2)).min(memory.len());
            let memory = memory[..end].to_vec();
            load(format, &memory, &places);
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
        let places = std::array::from_fn(|lane| lane as u32 * 4);
        store(Format::R8G8B8A8_SRGB, &[row; 4], &places, u16::MAX);
    }
}

/// Performs an operation in a tier on one image, and in the general way on another of the same
/// contents.
fn operate(tier: Tier, op: &ImageOp, images: [&Image; 2], rows: &[&Row], mask: u16) {
    let [image, reference] = images.map(|image| &image.descriptor);
    let info = image.format.info().unwrap();
    let plain = Plain::new(op, image, info).expect("one for vectors");
    let mut results = [[0; 16]; 4];
    let mut expected = [[0; 16]; 8];
    let done = wave::of_one(rows, mask, &mut results, |one| {
        // SAFETY: the images' memory is there, and the machine has the tier.
        unsafe {
            execute_block(op, Some(reference), None, mask, rows, &mut expected);
            match op.kind {
                ImageOpKind::Write => wave::store(tier, &plain, one),
                _ => wave::load(tier, &plain, one),
            }
        }
    });
    // Lanes of different levels, or of none that there is, are not for vectors.
    assert!(done == 1 || op.lod == LodMode::Lod);
    if done == 0 {
        return;
    }
    if op.kind != ImageOpKind::Write {
        for lane in (0..16).filter(|lane| mask >> lane & 1 == 1) {
            let expected = [0, 1, 2, 3].map(|c: usize| expected[c][lane]);
            assert_eq!(
                results.map(|row| row[lane]),
                expected,
                "{}, {tier}",
                info.name
            );
        }
    }
    assert_eq!(
        images[0].bytes(),
        images[1].bytes(),
        "{}, {tier}",
        info.name
    );
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
            let texel = if info.numeric.is_integer() { TexelType::I32 } else { TexelType::F32 };
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
                // Mostly as they are: that is a way of its own.
                if kind != ImageOpKind::Write && seed % 4 == 0 { image.descriptor.swizzle = swizzle; }
                image
            };
            let rows: Vec<&Row> = rows.iter().collect();
            for &tier in Tier::available() {
                operate(tier, &op, [&image(), &image()], &rows, mask);
            }
        }
    }
}

/// Texels one behind another, of which the first or the last ones may be outside.
#[test]
fn rows_are_those_of_the_general_way() {
    let formats = [
        Format::R32_SFLOAT,
        Format::R32_UINT,
        Format::R8G8B8A8_UNORM,
        Format::R32G32_SFLOAT,
        Format::R32G32B32A32_SFLOAT,
    ];
    for format in formats {
        let info = format.info().unwrap();
        let texel = match info.numeric.is_integer() {
            true => TexelType::I32,
            false => TexelType::F32,
        };
        let op = ImageOp {
            texel,
            ..ImageOp::plain(ImageOpKind::Read, Dim::D2)
        };
        let image = || Image::new(format, Dim::D2, [40, 3, 1], 1, 1, 7);
        for start in -2..30 {
            let x: Row = std::array::from_fn(|lane| (start + lane as i32) as u32);
            for mask in [u16::MAX, 0x7fff, 0xfffe] {
                for &tier in Tier::available() {
                    operate(tier, &op, [&image(), &image()], &[&x, &[2; 16]], mask);
                }
            }
        }
    }
}

/// Reads and writes the last sixteen texels of a large buffer.
fn access_far(tier: Tier, memory: &Sparse, format: Format, size_bytes: u64) {
    let info = format.info().unwrap();
    let (data, texel_bytes) = (memory.as_mut_ptr(), u64::from(info.size_bytes));
    let image = ImageDescriptor::texel_buffer(data, size_bytes, format);
    let texels = size_bytes / texel_bytes;
    // Apart, and the last one last.
    let index = |lane: u64| texels - 1 - 3 * (15 - lane);
    let words: Texels = std::array::from_fn(|component| {
        std::array::from_fn(|lane| (component as u32 + 1) * (16 + lane as u32))
    });
    let op = |kind| ImageOp {
        texel: TexelType::I32,
        ..ImageOp::plain(kind, Dim::Buffer)
    };
    let (write, read) = (op(ImageOpKind::Write), op(ImageOpKind::Read));
    let place: Row = std::array::from_fn(|lane| index(lane as u64) as u32);
    let rows = [&place, &words[0], &words[1], &words[2], &words[3]];
    let plain = |op| Plain::new(op, &image, info);
    // Offsets in vectors have a sign.
    let is_small = size_bytes <= i32::MAX as u64;
    assert_eq!(plain(&read).is_some(), is_small);
    let mut results = [[0; 16]; 4];
    let mut no_results = [];
    // SAFETY: the memory is there, and the machine has the tier.
    unsafe {
        match plain(&write) {
            Some(plain) => {
                let store = |one: &Wave<'_>| wave::store(tier, &plain, one);
                assert_eq!(wave::of_one(&rows, u16::MAX, &mut no_results, store), 1);
            }
            None => execute_block(&write, Some(&image), None, u16::MAX, &rows, &mut no_results),
        }
        let rows = &rows[..1];
        match plain(&read) {
            Some(plain) => {
                let load = |one: &Wave<'_>| wave::load(tier, &plain, one);
                assert_eq!(wave::of_one(rows, u16::MAX, &mut results, load), 1);
            }
            None => execute_block(&read, Some(&image), None, u16::MAX, rows, &mut results),
        }
    }
    for lane in 0..16 {
        let mut texel = [0; 32];
        info.encode(words.map(|row| row[lane]), &mut texel);
        let stored: [u8; 16] = match texel_bytes {
            16 => memory.read(index(lane as u64) * texel_bytes),
            _ => {
                let first = index(lane as u64) * texel_bytes;
                std::array::from_fn(|k| match (k as u64) < texel_bytes {
                    true => memory.read::<1>(first + k as u64)[0],
                    false => 0,
                })
            }
        };
        assert_eq!(stored, texel[..16], "{} {}", info.name, size_bytes);
        let read: [u32; 4] = std::array::from_fn(|component| results[component][lane]);
        assert_eq!(
            read,
            info.decode(&texel[..texel_bytes as usize]),
            "{}",
            info.name
        );
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
            for &tier in Tier::available() {
                access_far(tier, &memory, format, size_bytes);
            }
        }
    }
}
