//! Fetches, stores, atomics and queries.

use super::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(effort::rounds(2000)))]

    /// Fetches, with levels, layers, offsets; what is outside is zero, with the missing components
    /// filled.
    #[test]
    fn fetches_give_texels_and_zero_outside(
        format in any_format(), axes in 1usize..4, size in prop::array::uniform3(1u32..9), layers in 1u32..3, seed: u32,
        coordinates in prop::array::uniform16(prop::array::uniform4(-2i32..10)), lods in prop::array::uniform16(-1i32..4),
        offset in prop::option::of(-3i32..4), mask: u16,
    ) {
        let dim = [Dim::D1, Dim::D2, Dim::D3][axes - 1];
        let size: [u32; 3] = std::array::from_fn(|axis| if axis < axes { size[axis] } else { 1 });
        let layers = if axes == 3 { 1 } else { layers };
        let image = Image::new(format, dim, size, 3, layers, seed);
        let op = ImageOp { arrayed: layers > 1, lod: LodMode::Lod, has_offset: offset.is_some(), ..ImageOp::plain(ImageOpKind::Fetch, dim) };
        let mut rows: Vec<Row> = (0..axes).map(|axis| coordinates.map(|c| c[axis] as u32)).collect();
        if layers > 1 { rows.push(coordinates.map(|c| c[3] as u32)); }
        rows.push(lods.map(|lod| lod as u32));
        if let Some(offset) = offset { rows.extend(vec![[offset as u32; 16]; axes]); }
        let results = run(&op, &image.descriptor, None, mask, &rows);
        let info = format.info().unwrap();
        for lane in (0..16).filter(|lane| mask >> lane & 1 == 1) {
            let at: [i32; 3] = std::array::from_fn(|axis| if axis < axes { coordinates[lane][axis] + offset.unwrap_or(0) } else { 0 });
            let layer = if layers > 1 { coordinates[lane][3] } else { 0 };
            let lod = lods[lane];
            let inside = (0..3).contains(&lod)
                && (0..layers as i32).contains(&layer)
                && (0..3).all(|axis| at[axis] >= 0 && at[axis] < (size[axis] >> lod).max(1) as i32);
            let expected = if inside {
                image.words(lod as usize, layer as u32, at.map(|i| i as u32))
            } else {
                std::array::from_fn(|c| if info.channels[c].bits == 0 && c == 3 { 1f32.to_bits() } else { 0 })
            };
            let got: [u32; 4] = std::array::from_fn(|c| results[c][lane]);
            prop_assert_eq!(got, expected);
        }
    }

    /// Written texels are read back, in every format that can hold the value; writes outside are
    /// dropped.
    #[test]
    fn writes_are_read_back(
        seed: u32, words in prop::array::uniform4(prop::array::uniform16(any::<u32>())), mask: u16,
        coordinates in prop::array::uniform16(prop::array::uniform2(-1i32..9)),
    ) {
        for format in Format::all() {
            let info = format.info().unwrap();
            if info.is_wide() || info.blocks().is_some() { continue; }
            let image = Image::new(format, Dim::D2, [8, 8, 1], 1, 1, seed);
            let texel = if info.numeric.is_integer() { TexelType::I32 } else { TexelType::F32 };
            let write = ImageOp { texel, ..ImageOp::plain(ImageOpKind::Write, Dim::D2) };
            let before: Vec<[u32; 4]> = (0..64).map(|i| image.words(0, 0, [i % 8, i / 8, 0])).collect();
            let mut expected = before.clone();
            for lane in (0..16).filter(|lane| mask >> lane & 1 == 1) {
                let [x, y] = coordinates[lane];
                if (0..8).contains(&x) && (0..8).contains(&y) {
                    let mut bytes = [0; 32];
                    info.encode(words.map(|row| row[lane]), &mut bytes);
                    expected[(y * 8 + x) as usize] = info.decode(&bytes);
                }
            }
            let mut rows: Vec<Row> = (0..2).map(|axis| coordinates.map(|c| c[axis] as u32)).collect();
            rows.extend(words);
            run(&write, &image.descriptor, None, mask, &rows);
            for i in 0..64u32 {
                prop_assert_eq!(image.words(0, 0, [i % 8, i / 8, 0]), expected[i as usize], "{}", info.name);
            }
        }
    }
}

#[test]
fn queries_of_the_image() {
    let image = Image::new(Format::R8_UNORM, Dim::D2, [10, 6, 1], 3, 4, 1);
    let size = ImageOp {
        arrayed: true,
        lod: LodMode::Lod,
        texel: TexelType::I32,
        ..ImageOp::plain(ImageOpKind::QuerySize, Dim::D2)
    };
    let results = run(&size, &image.descriptor, None, 1, &[[1; 16]]);
    assert_eq!([results[0][0], results[1][0], results[2][0]], [5, 3, 4]);
    let cube = Image::new(Format::R8_UNORM, Dim::Cube, [8, 8, 1], 1, 12, 1);
    let size = ImageOp {
        arrayed: true,
        ..ImageOp::plain(ImageOpKind::QuerySize, Dim::Cube)
    };
    let results = run(&size, &cube.descriptor, None, 1, &[]);
    assert_eq!([results[0][0], results[1][0], results[2][0]], [8, 8, 2]);
    let results = run(
        &ImageOp::plain(ImageOpKind::QueryLevels, Dim::D2),
        &image.descriptor,
        None,
        1,
        &[],
    );
    assert_eq!(results[0][0], 3);
    let results = run(
        &ImageOp::plain(ImageOpKind::QuerySamples, Dim::D2),
        &image.descriptor,
        None,
        1,
        &[],
    );
    assert_eq!(results[0][0], 1);
}

#[test]
fn atomics_return_the_old_value_in_lane_order() {
    let image = Image::new(Format::R32_UINT, Dim::D2, [4, 4, 1], 1, 1, 1);
    let old = image.words(0, 0, [1, 2, 0])[0];
    let op = ImageOp {
        texel: TexelType::I32,
        ..ImageOp::plain(ImageOpKind::Atomic(AtomicOp::IAdd), Dim::D2)
    };
    let results = run(
        &op,
        &image.descriptor,
        None,
        0b1011,
        &[[1; 16], [2; 16], [5; 16]],
    );
    assert_eq!(
        [results[0][0], results[0][1], results[0][3]],
        [old, old + 5, old + 10]
    );
    assert_eq!(image.words(0, 0, [1, 2, 0])[0], old + 15);

    let image = Image::new(Format::R64_SINT, Dim::D1, [4, 1, 1], 1, 1, 1);
    let op = ImageOp {
        texel: TexelType::I64,
        ..ImageOp::plain(ImageOpKind::Write, Dim::D1)
    };
    let zero = [0; 16];
    run(
        &op,
        &image.descriptor,
        None,
        1,
        &[
            [3; 16],
            [7; 16],
            [u32::MAX; 16],
            zero,
            zero,
            zero,
            zero,
            zero,
            zero,
        ],
    );
    let op = ImageOp {
        texel: TexelType::I64,
        ..ImageOp::plain(ImageOpKind::Atomic(AtomicOp::SMin), Dim::D1)
    };
    let results = run(
        &op,
        &image.descriptor,
        None,
        1,
        &[[3; 16], [0; 16], [0x8000_0000; 16]],
    );
    assert_eq!([results[0][0], results[1][0]], [7, u32::MAX]);
    let read = ImageOp {
        texel: TexelType::I64,
        ..ImageOp::plain(ImageOpKind::Read, Dim::D1)
    };
    let results = run(&read, &image.descriptor, None, 1, &[[3; 16]]);
    assert_eq!(
        results.map(|row| row[0]),
        [0, 0x8000_0000, 0, 0, 0, 0, 1, 0]
    );

    let image = Image::new(Format::R32_SFLOAT, Dim::Buffer, [4, 1, 1], 1, 1, 1);
    let op = ImageOp::plain(ImageOpKind::Atomic(AtomicOp::Exchange), Dim::Buffer);
    run(&op, &image.descriptor, None, 1, &[[0; 16], row(1.5)]);
    let op = ImageOp::plain(ImageOpKind::Atomic(AtomicOp::FAdd), Dim::Buffer);
    let results = run(&op, &image.descriptor, None, 0b11, &[[0; 16], row(0.25)]);
    assert_eq!(
        [results[0][0], results[0][1]].map(f32::from_bits),
        [1.5, 1.75]
    );
    // A denormal stays, or is flushed with its sign.
    let [first, less] = [f32::MIN_POSITIVE, -1.5 * f32::MIN_POSITIVE].map(row);
    let exchange = ImageOp::plain(ImageOpKind::Atomic(AtomicOp::Exchange), Dim::Buffer);
    for (kind, left) in [
        (AtomicOp::FAdd, 0x8040_0000),
        (AtomicOp::FAddFlushed, 0x8000_0000),
    ] {
        let op = ImageOp::plain(ImageOpKind::Atomic(kind), Dim::Buffer);
        run(&exchange, &image.descriptor, None, 1, &[[1; 16], first]);
        run(&op, &image.descriptor, None, 1, &[[1; 16], less]);
        assert_eq!(image.words(0, 0, [1, 0, 0])[0], left);
    }
    // Outside: dropped, and the old value is zero.
    let results = run(&op, &image.descriptor, None, 1, &[[4; 16], row(0.25)]);
    assert_eq!(results[0][0], 0);
}

#[test]
fn samples_of_multisampled_images_are_separate() {
    let mut image = Image::new(Format::R32_UINT, Dim::D2, [4, 4, 1], 1, 2, 5);
    // Two layers seen as two samples.
    image.descriptor.sample_stride_bytes = image.descriptor.layer_stride_bytes;
    image.descriptor.samples = 2;
    let expected = [0, 1].map(|layer| image.words(0, layer, [1, 2, 0])[0]);
    image.descriptor.layer_count = 1;
    let op = ImageOp {
        multisampled: true,
        texel: TexelType::I32,
        ..ImageOp::plain(ImageOpKind::Fetch, Dim::D2)
    };
    let mut samples = [0; 16];
    (samples[1], samples[2]) = (1, 2);
    let results = run(
        &op,
        &image.descriptor,
        None,
        7,
        &[[1; 16], [2; 16], samples],
    );
    assert_eq!(results[0][..3], [expected[0], expected[1], 0]);
}

#[test]
fn null_descriptors_read_zero() {
    let op = ImageOp::plain(ImageOpKind::Fetch, Dim::D2);
    let mut results = [[7; 16]; 8];
    // SAFETY: no image.
    unsafe { execute_block(&op, None, None, 1, &[&[0; 16], &[0; 16]], &mut results) };
    assert_eq!(results.map(|row| row[0])[..4], [0; 4]);
}
