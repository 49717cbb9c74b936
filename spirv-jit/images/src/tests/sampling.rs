//! Sampling and gathering.

use lanes::Tier;

use super::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(effort::rounds(2000)))]

    /// 1D, 2D and 3D sampling with every addressing, filter, level selection, reduction, offset and
    /// comparison, 16 different lanes.
    #[test]
    fn sampling_agrees_with_the_equations(
        format in any_format(), s in any_sampler(), axes in 1usize..4,
        size in prop::array::uniform3(1u32..13), level_count in 1u8..4, layers in 1u32..4, seed: u32,
        coordinates in prop::array::uniform16(prop::array::uniform3(-2.5f32..3.5)),
        layer_coordinates in prop::array::uniform16(-1.0f32..5.0),
        lods in prop::array::uniform16(-1.0f32..4.0), uniform_lod: bool,
        offsets in prop::option::of(prop::array::uniform3(-8i32..8)),
        compare in prop::option::of((any_compare(), 0.0f32..1.0)),
        swizzle in prop::option::of(prop::array::uniform4(0u8..6)),
        mask: u16,
    ) {
        let mut s = s;
        let dim = [Dim::D1, Dim::D2, Dim::D3][axes - 1];
        let layers = if axes == 3 { 1 } else { layers };
        let depth = [Format::D16_UNORM, Format::X8_D24_UNORM_PACK32][seed as usize % 2];
        let format = if compare.is_some() { depth } else { format };
        let mut image = Image::new(format, dim, size, level_count, layers, seed);
        if let (Some(swizzle), None) = (swizzle, compare) {
            image.descriptor.swizzle = swizzle;
        }
        s.compare = compare.map(|(op, _)| op);
        let op = ImageOp {
            arrayed: layers > 1,
            depth_compare: compare.is_some(),
            lod: LodMode::Lod,
            has_offset: offsets.is_some(),
            ..ImageOp::plain(ImageOpKind::Sample, dim)
        };
        let mut rows: Vec<Row> = (0..axes).map(|axis| coordinates.map(|c| c[axis].to_bits())).collect();
        if layers > 1 { rows.push(layer_coordinates.map(f32::to_bits)); }
        if let Some((_, reference)) = compare { rows.push(row(reference)); }
        let lods = if uniform_lod { [lods[0]; 16] } else { lods };
        rows.push(lods.map(f32::to_bits));
        if let Some(offsets) = offsets { rows.extend(offsets[..axes].iter().map(|&o| [o as u32; 16])); }
        let results = run(&op, &image.descriptor, Some(&s), mask, &rows);
        let reference = Reference { image: &image, sampler: &s, axes };
        for lane in (0..16).filter(|lane| mask >> lane & 1 == 1) {
            let q = Query {
                coordinates: coordinates[lane].map(|c| c as f64),
                layer: if layers > 1 { (layer_coordinates[lane].round_ties_even().max(0.0) as u32).min(layers - 1) } else { 0 },
                offsets: offsets.unwrap_or([0; 3]),
                lambda: lods[lane] as f64,
                reference: compare.map(|(_, reference)| reference as f64),
            };
            let Some(expected) = reference.sample(&q) else { continue };
            let expected = if compare.is_some() { expected } else {
                image.descriptor.swizzle.map(|from| match from {
                    0..=3 => expected[from as usize],
                    4 => 0.0,
                    _ => 1.0,
                })
            };
            for component in 0..op.result_rows() {
                let got = f32::from_bits(results[component][lane]) as f64;
                // Coordinates are rounded relative to the texel grid: 13 texels × 3.5 repeats ×
                // 2^-24, times the texels' range.
                prop_assert!((got - expected[component]).abs() < 4e-5, "lane {lane} component {component}: {got} {expected:?} {q:?}");
            }
        }
    }

    /// Gathers take the footprint of linear filtering at the base level, in the spec's order, from
    /// the component after the swizzle.
    #[test]
    fn gathers_take_the_footprint_in_order(
        format in any_format(), s in any_sampler(), size in prop::array::uniform2(1u32..9), seed: u32,
        coordinates in prop::array::uniform16(prop::array::uniform2(-1.5f32..2.5)), component in 0u8..4,
        offsets in prop::array::uniform8(-32i32..32), offset_kind in 0usize..3, swizzle in prop::array::uniform4(0u8..6), compare: bool,
    ) {
        let mut s = s;
        let format = if compare { Format::D32_SFLOAT } else { format };
        let mut image = Image::new(format, Dim::D2, [size[0], size[1], 1], 2, 1, seed);
        if compare { s.compare = Some(CompareOp::LessOrEqual); } else { image.descriptor.swizzle = swizzle; }
        let op = ImageOp {
            depth_compare: compare,
            has_offset: offset_kind == 1,
            has_offsets: offset_kind == 2,
            ..ImageOp::plain(ImageOpKind::Gather(component), Dim::D2)
        };
        let mut rows: Vec<Row> = (0..2).map(|axis| coordinates.map(|c| c[axis].to_bits())).collect();
        if compare { rows.push(row(0.5)); }
        let offset_rows = [0, 2, 8][offset_kind];
        rows.extend(offsets[..offset_rows].iter().map(|&o| [o as u32; 16]));
        let results = run(&op, &image.descriptor, Some(&s), 0xffff, &rows);
        let reference = Reference { image: &image, sampler: &s, axes: 2 };
        for lane in 0..16 {
            for result in 0..4 {
                let offset = match offset_kind {
                    0 => [0, 0],
                    1 => [offsets[0], offsets[1]],
                    _ => [offsets[2 * result], offsets[2 * result + 1]],
                };
                let corner = if offset_kind == 2 { [0, 0] } else { [[0, 1], [1, 1], [1, 0], [0, 0]][result] };
                let q = Query {
                    coordinates: [coordinates[lane][0] as f64, coordinates[lane][1] as f64, 0.0],
                    layer: 0, offsets: [offset[0], offset[1], 0], lambda: 0.0, reference: None,
                };
                let (texel, near) = reference.scaled(0, &q, 0.5);
                if near { continue; }
                let index = [texel[0].floor() as i64 + corner[0], texel[1].floor() as i64 + corner[1], 0];
                let texel = reference.fetch(0, 0, index, compare.then_some(0.5));
                let expected = match image.descriptor.swizzle[component as usize] {
                    _ if compare => texel[0],
                    4 => 0.0,
                    5 => 1.0,
                    from => texel[from as usize],
                };
                let got = f32::from_bits(results[result][lane]) as f64;
                prop_assert!((got - expected).abs() < 1e-6, "{got} {expected} {q:?}");
            }
        }
    }

    /// λ of derivatives, without and with anisotropy, against logarithms in f64; seen through a LOD
    /// query.
    #[test]
    fn derivatives_give_the_level(
        axes in 1usize..4, derivatives in prop::array::uniform6(-3.0f32..3.0), exponent in -12i32..3, bias in -2.0f32..2.0, linear: bool,
        anisotropy in prop::option::of(1.0f32..16.0),
    ) {
        let derivatives = derivatives.map(|d| d * 2f32.powi(exponent));
        let dim = [Dim::D1, Dim::D2, Dim::D3][axes - 1];
        let size = [32, if axes > 1 { 16 } else { 1 }, if axes > 2 { 8 } else { 1 }];
        let image = Image::new(Format::R8_UNORM, dim, size, 5, 1, 1);
        let s = SamplerDescriptor {
            mip_lod_bias: bias,
            mipmap_mode: if linear { Filter::Linear } else { Filter::Nearest },
            max_anisotropy: anisotropy.unwrap_or(0.0),
            ..sampler()
        };
        let op = ImageOp { lod: LodMode::Grad, ..ImageOp::plain(ImageOpKind::QueryLod, dim) };
        let mut rows = vec![row(0.3); axes];
        for screen in 0..2 { for axis in 0..axes { rows.push(row(derivatives[screen * 3 + axis])); } }
        let results = run(&op, &image.descriptor, Some(&s), 1, &rows);
        let length = |screen: usize| (0..axes)
            .map(|axis| (derivatives[screen * 3 + axis] as f64 * size[axis] as f64).powi(2)).sum::<f64>().sqrt();
        let (max, min) = (length(0).max(length(1)), length(0).min(length(1)));
        // η as a real number in 1..=maxAnisotropy.
        let eta = match anisotropy {
            Some(limit) => (max / min).min(limit as f64).max(1.0),
            None => 1.0,
        };
        let lambda = (max / eta).log2() + bias as f64;
        let got = f32::from_bits(results[1][0]) as f64;
        prop_assert!((got - lambda).abs() < 1e-4, "{got} {lambda}");
        let d = lambda.clamp(0.0, 4.0);
        let level = f32::from_bits(results[0][0]) as f64;
        if linear {
            prop_assert!((level - d).abs() < 1e-4);
        } else if (d.fract() - 0.5).abs() > 1e-3 {
            prop_assert_eq!(level, d.round());
        }
    }

    /// The common case has code of its own: the same bits as the general one.
    #[test]
    fn the_fast_path_is_the_same(
        format in any_format(), s in any_sampler(), size in prop::array::uniform2(1u32..40), level_count in 1u8..4, layers in 1u32..4, seed: u32,
        coordinates in prop::array::uniform16(prop::array::uniform3(-3.5f32..3.5)), special in prop::option::of((0usize..16, prop::sample::select(vec![f32::NAN, f32::INFINITY, -1e30, 1e30, 1.0, 0.0, -1e-9]))),
        lods in prop::array::uniform16(-1.0f32..4.0), uniform_lod: bool, mode in prop::sample::select(vec![LodMode::Bias, LodMode::Lod, LodMode::Grad]), mask in 1u16.., unnormalized: bool,
        offsets in prop::option::of(prop::array::uniform2(prop_oneof![-9i32..9, any::<i32>()])), is_cube: bool, compare in prop::option::of((any_compare(), 0.0f32..1.0)), anisotropy in prop_oneof![Just(1.0f32), 1.0f32..17.0],
        gather in prop::option::of(0u8..4), swizzle in prop_oneof![Just([0, 1, 2, 3]), prop::array::uniform4(0u8..6)],
        integer in prop::option::weighted(0.2, prop::sample::select(vec![41u32, 68, 75, 99, 104, 107])),
    ) {
        let mut s = s;
        let (mut compare, mut gather, mut anisotropy) = (compare, gather, anisotropy);
        if integer.is_some() {
            (s.mag_filter, s.mipmap_mode) = (Filter::Nearest, Filter::Nearest);
            (compare, gather, anisotropy) = (None, None, 1.0);
        }
        s.unnormalized_coordinates = unnormalized && !is_cube;
        s.non_seamless = false;
        s.compare = compare.map(|(op, _)| op);
        if s.unnormalized_coordinates { s.address_mode = [AddressMode::ClampToEdge; 3]; }
        s.min_filter = s.mag_filter;
        s.reduction = Reduction::WeightedAverage;
        for mode in &mut s.address_mode {
            if *mode == AddressMode::MirrorClampToEdge {
                *mode = AddressMode::ClampToEdge;
            }
        }
        let format = match integer {
            Some(number) => Format(number),
            None if compare.is_some() => {
                [Format::D16_UNORM, Format::X8_D24_UNORM_PACK32][seed as usize % 2]
            }
            None => format,
        };
        let (dim, size, faces) = match is_cube {
            true => (Dim::Cube, [size[0]; 2], 6),
            false => (Dim::D2, size, 1),
        };
        let mut image = Image::new(format, dim, [size[0], size[1], 1], level_count, layers * faces, seed);
        if compare.is_none() { image.descriptor.swizzle = swizzle; }
        let info = format.info().unwrap();
        let offsets = offsets.filter(|_| !is_cube);
        let (kind, mode) = match gather {
            Some(component) => (ImageOpKind::Gather(component), LodMode::Implicit),
            None => (ImageOpKind::Sample, mode),
        };
        let op = ImageOp {
            arrayed: layers > 1,
            depth_compare: compare.is_some(),
            lod: mode,
            has_offset: offsets.is_some(),
            ..ImageOp::plain(kind, dim)
        };
        let mut coordinates = coordinates;
        if s.unnormalized_coordinates {
            for c in &mut coordinates { (c[0], c[1]) = (c[0] * 10.0, c[1] * 10.0); }
        }
        if let Some((lane, value)) = special { coordinates[lane][1] = value; }
        let axes = op.spatial_count();
        let mut rows: Vec<Row> = (0..axes).map(|axis| coordinates.map(|c| c[axis].to_bits())).collect();
        if layers > 1 { rows.push(coordinates.map(|c| (c[0] + c[2]).to_bits())); }
        if let Some((_, reference)) = compare { rows.push([reference.to_bits(); 16]); }
        if mode == LodMode::Grad {
            s.max_anisotropy = anisotropy;
            for turn in 0..2 * axes {
                rows.push(std::array::from_fn(|lane| (coordinates[(lane + turn) % 16][turn % 2] * lods[lane] * 0.05).to_bits()));
            }
        } else if gather.is_none() {
            rows.push(if uniform_lod { [lods[0].to_bits(); 16] } else { lods.map(f32::to_bits) });
        }
        for offset in offsets.iter().flatten() { rows.push([*offset as u32; 16]); }
        let fast_sample = fast::Fast::new(&op, &image.descriptor, info, &s, 0xf).expect("applies");
        let rows: Vec<&Row> = rows.iter().collect();
        let operands = super::super::operands::Operands::new(&op, &rows);
        let (mut fast, mut portable, mut general) = ([[0; 16]; 8], [[0; 16]; 8], [[0; 16]; 8]);
        // SAFETY: the image's memory is alive.
        unsafe {
            sample::sample(Tier::best(), &op, &operands, &image.descriptor, info, &s, mask, &mut general);
            wave::of_one(&rows, mask, &mut fast[..op.result_rows()], |one| wave::sample(Tier::best(), &fast_sample, one));
            wave::of_one(&rows, mask, &mut portable[..op.result_rows()], |one| wave::sample(Tier::Portable, &fast_sample, one));
        }
        for lane in (0..16).filter(|lane| mask >> lane & 1 == 1) {
            for component in 0..op.result_rows() {
                let (a, b) = (fast[component][lane], general[component][lane]);
                let both_nan = integer.is_none() && f32::from_bits(a).is_nan() && f32::from_bits(b).is_nan();
                prop_assert!(a == b || both_nan, "{lane} {component} {a:x} {b:x}");
                let c = portable[component][lane];
                prop_assert!(c == b || both_nan, "{lane} {component} {c:x} {b:x}");
            }
        }
    }

    /// Coordinates that change evenly over a block of pixels, whose texels lie together, or of
    /// which each is a pixel's own: the same bits as the general way's.
    #[test]
    fn blocks_of_pixels_sample_the_same(
        number in prop::sample::select(vec![37u32, 44, 43, 100, 126]), s in any_sampler(), size in prop::array::uniform2(1u32..40), seed: u32,
        component in 0u8..4, swizzle in prop_oneof![Just([0, 1, 2, 3]), prop::array::uniform4(0u8..6)],
        from in prop::array::uniform2(-1.5f32..1.5), steps in prop::array::uniform4(-0.1f32..0.1), mask in 1u16.., all: bool, offset in prop::option::of(-9i32..9), own: bool,
    ) {
        let mut s = s;
        s.unnormalized_coordinates = false;
        s.min_filter = s.mag_filter;
        s.reduction = Reduction::WeightedAverage;
        let format = Format(number);
        let gathers = matches!(format, Format::R32_SFLOAT | Format::D32_SFLOAT);
        for mode in &mut s.address_mode {
            if *mode == AddressMode::MirrorClampToEdge || *mode == AddressMode::ClampToBorder && !gathers {
                *mode = AddressMode::Repeat;
            }
        }
        let info = format.info().unwrap();
        let mut image = Image::new(format, Dim::D2, [size[0], size[1], 1], 1, 1, seed);
        let (kind, lod) = match gathers {
            true => (ImageOpKind::Gather(component), LodMode::Implicit),
            false => (ImageOpKind::Sample, LodMode::Lod),
        };
        if gathers { image.descriptor.swizzle = swizzle; }
        let op = ImageOp {
            lod,
            has_offset: offset.is_some(),
            ..ImageOp::plain(kind, Dim::D2)
        };
        let steps = match own {
            true => [1.0 / size[0] as f32, 0.0, 0.0, 1.0 / size[1] as f32],
            false => steps,
        };
        let mut rows: Vec<Row> = (0..2)
            .map(|axis| {
                std::array::from_fn(|lane| {
                    let (x, y) = (lane % 2 + lane / 4 % 2 * 2, lane / 2 % 2 + lane / 8 * 2);
                    (from[axis] + steps[axis] * x as f32 + steps[2 + axis] * y as f32).to_bits()
                })
            })
            .collect();
        if !gathers { rows.push([0; 16]); }
        for _ in 0..if offset.is_some() { 2 } else { 0 } { rows.push([offset.unwrap_or(0) as u32; 16]); }
        let rows: Vec<&Row> = rows.iter().collect();
        let operands = super::super::operands::Operands::new(&op, &rows);
        let fast_sample = fast::Fast::new(&op, &image.descriptor, info, &s, 0xf).expect("applies");
        let mask = if all { u16::MAX } else { mask };
        let (mut fast, mut portable, mut general) = ([[0; 16]; 8], [[0; 16]; 8], [[0; 16]; 8]);
        // SAFETY: the image's memory is alive.
        unsafe {
            wave::of_one(&rows, mask, &mut fast[..op.result_rows()], |one| wave::sample(Tier::best(), &fast_sample, one));
            wave::of_one(&rows, mask, &mut portable[..op.result_rows()], |one| wave::sample(Tier::Portable, &fast_sample, one));
            sample::sample(Tier::best(), &op, &operands, &image.descriptor, info, &s, mask, &mut general);
        }
        for lane in (0..16).filter(|lane| mask >> lane & 1 == 1) {
            for component in 0..4 {
                prop_assert_eq!(fast[component][lane], general[component][lane]);
                prop_assert_eq!(portable[component][lane], general[component][lane]);
            }
        }
    }

    /// A cube's faces, nearest: the texel is where the direction, scaled to the face, points.
    #[test]
    fn cubes_select_faces(directions in prop::array::uniform16(prop::array::uniform3(-1.0f32..1.0)), cube in 0u32..2, seed: u32) {
        let image = Image::new(Format::R8G8B8A8_UNORM, Dim::Cube, [8, 8, 1], 1, 12, seed);
        let s = SamplerDescriptor { mag_filter: Filter::Nearest, min_filter: Filter::Nearest, ..sampler() };
        let op = ImageOp { arrayed: true, ..ImageOp::plain(ImageOpKind::Sample, Dim::Cube) };
        let mut rows: Vec<Row> = (0..3).map(|axis| directions.map(|d| d[axis].to_bits())).collect();
        rows.push(row(cube as f32));
        let results = run(&op, &image.descriptor, Some(&s), 0xffff, &rows);
        for lane in 0..16 {
            let [x, y, z] = directions[lane].map(|d| d as f64);
            let (ax, ay, az) = (x.abs(), y.abs(), z.abs());
            // The table of the chapter.
            let (face, sc, tc, rc) = if az >= ax && az >= ay {
                if z >= 0.0 { (4, x, -y, az) } else { (5, -x, -y, az) }
            } else if ay >= ax {
                if y >= 0.0 { (2, x, z, ay) } else { (3, x, -z, ay) }
            } else if x >= 0.0 { (0, -z, -y, ax) } else { (1, z, -y, ax) };
            let texel = [sc, tc].map(|c| (c / rc * 0.5 + 0.5) * 8.0);
            if texel.iter().any(|u| (u - u.round()).abs() < 1e-4) { continue; }
            let index = texel.map(|u| u.floor() as u32);
            let expected = image.words(0, cube * 6 + face, [index[0], index[1], 0]);
            prop_assert_eq!(std::array::from_fn::<u32, 4, _>(|c| results[c][lane]), expected);
        }
    }

    /// Linear filtering is continuous over a cube's edges and corners.
    #[test]
    fn cubes_are_seamless(direction in prop::array::uniform3(-1.0f32..1.0), edge in 0usize..3, seed: u32) {
        let image = Image::new(Format::R32_SFLOAT, Dim::Cube, [4, 4, 1], 1, 6, seed);
        let op = ImageOp::plain(ImageOpKind::Sample, Dim::Cube);
        let at = |d: [f32; 3]| {
            let rows = d.map(row);
            f32::from_bits(run(&op, &image.descriptor, Some(&sampler()), 1, &rows)[0][0])
        };
        // Two components equal in magnitude: an edge, if they are the largest.
        let mut d = direction;
        let other = (edge + 1) % 3;
        let largest = direction.iter().fold(0f32, |a, b| a.max(b.abs())).max(0.1);
        d[edge] = largest.copysign(d[edge]);
        d[other] = largest.copysign(d[other]);
        let (mut inside, mut outside) = (d, d);
        inside[edge] *= 1.00001;
        outside[edge] *= 0.99999;
        prop_assert!((at(inside) - at(outside)).abs() < 1e-3);
    }
}

/// Without seamless edges a face is a 2D image with the sampler's address modes.
#[test]
fn faces_that_are_not_seamless_end_at_their_edges() {
    let image = Image::new(Format::R32_SFLOAT, Dim::Cube, [4, 4, 1], 1, 6, 11);
    let op = ImageOp::plain(ImageOpKind::Sample, Dim::Cube);
    // Half a texel from the edge of +Z in x, at the middle between two rows: s = 1/16, t = 1/2.
    let rows = [row(-0.875), row(0.0), row(1.0)];
    let sample = |mode: AddressMode| {
        let s = SamplerDescriptor {
            non_seamless: true,
            address_mode: [mode; 3],
            border_color: [5f32.to_bits(); 4],
            ..sampler()
        };
        f64::from(f32::from_bits(
            run(&op, &image.descriptor, Some(&s), 1, &rows)[0][0],
        ))
    };
    let column = |x: u32| (image.texel(0, 4, [x, 1, 0])[0] + image.texel(0, 4, [x, 2, 0])[0]) / 2.0;
    for (mode, outside) in [
        (AddressMode::ClampToEdge, column(0)),
        (AddressMode::Repeat, column(3)),
        (AddressMode::ClampToBorder, 5.0),
    ] {
        let expected = 0.75 * column(0) + 0.25 * outside;
        assert!((sample(mode) - expected).abs() < 1e-5, "{mode:?}");
    }
}

/// Blocks at the edges of a level stand out over it; texels are found in them by any access.
#[test]
fn compressed_texels_are_found_in_their_blocks() {
    // 6×5 texels of EAC: two blocks by two, with a gap behind each row.
    let mut blocks = [0u64; 8];
    for (i, block) in blocks.iter_mut().enumerate() {
        *block = 0x9e37_79b9_7f4a_7c15u64.wrapping_mul(i as u64 + 1);
    }
    let format = Format::EAC_R11_UNORM_BLOCK;
    let mut image = ImageDescriptor {
        data: blocks.as_mut_ptr().cast(),
        size_bytes: 64,
        format,
        dim: Dim::D2,
        level_count: 1,
        layer_count: 1,
        ..ImageDescriptor::NULL
    };
    image.levels[0] = Level {
        row_stride_bytes: 24,
        slice_stride_bytes: 48,
        width: 6,
        height: 5,
        depth: 1,
        ..Level::default()
    };
    let layout = format.info().unwrap().blocks().unwrap();
    let fetch = ImageOp::plain(ImageOpKind::Fetch, Dim::D2);
    let sample = ImageOp::plain(ImageOpKind::Sample, Dim::D2);
    let s = SamplerDescriptor {
        mag_filter: Filter::Nearest,
        min_filter: Filter::Nearest,
        ..sampler()
    };
    let gather = ImageOp::plain(ImageOpKind::Gather(0), Dim::D2);
    let texel = |x: u32, y: u32| {
        let mut texels = [[0; 4]; 144];
        let block = blocks[(y / 4 * 3 + x / 4) as usize];
        layout.decode(u128::from(block), &mut texels);
        texels[(y % 4 * 4 + x % 4) as usize]
    };
    for y in 0..5u32 {
        for x in 0..6u32 {
            let lanes = |value: u32| [value; 16];
            let fetched = run(&fetch, &image, None, 1, &[lanes(x), lanes(y)]);
            assert_eq!([0, 1, 2, 3].map(|i| fetched[i][0]), texel(x, y));
            let centre = [row((x as f32 + 0.5) / 6.0), row((y as f32 + 0.5) / 5.0)];
            let sampled = run(&sample, &image, Some(&s), 1, &centre);
            assert_eq!([0, 1, 2, 3].map(|i| sampled[i][0]), texel(x, y));
        }
    }
    let corner = [row(4.0 / 6.0), row(4.0 / 5.0)];
    let gathered = run(&gather, &image, Some(&sampler()), 1, &corner);
    let four = [texel(3, 4), texel(4, 4), texel(4, 3), texel(3, 3)].map(|texel| texel[0]);
    assert_eq!([0, 1, 2, 3].map(|i| gathered[i][0]), four);
    // Nothing is written, whatever is asked for.
    let write = ImageOp::plain(ImageOpKind::Write, Dim::D2);
    let before = blocks;
    run(&write, &image, None, u16::MAX, &[[1; 16]; 6]);
    assert_eq!(blocks, before);
}

#[test]
fn unnormalized_coordinates_count_texels() {
    let image = Image::new(Format::R32_SFLOAT, Dim::D2, [5, 3, 1], 1, 1, 7);
    let s = SamplerDescriptor {
        unnormalized_coordinates: true,
        address_mode: [AddressMode::ClampToEdge; 3],
        ..sampler()
    };
    let results = run(
        &ImageOp::plain(ImageOpKind::Sample, Dim::D2),
        &image.descriptor,
        Some(&s),
        1,
        &[row(2.5), row(1.75)],
    );
    let expected = 0.75 * image.texel(0, 0, [2, 1, 0])[0] + 0.25 * image.texel(0, 0, [2, 2, 0])[0];
    assert!((f32::from_bits(results[0][0]) as f64 - expected).abs() < 1e-6);
}

#[test]
fn anisotropy_averages_along_the_longer_axis() {
    let image = Image::new(Format::R32_SFLOAT, Dim::D2, [64, 64, 1], 1, 1, 3);
    let s = SamplerDescriptor {
        max_anisotropy: 4.0,
        ..sampler()
    };
    let op = ImageOp {
        lod: LodMode::Grad,
        ..ImageOp::plain(ImageOpKind::Sample, Dim::D2)
    };
    // 4 texels along x, 1 along y: N = 4.
    let rows = [
        row(0.4),
        row(0.3),
        row(4.0 / 64.0),
        row(0.0),
        row(0.0),
        row(1.0 / 64.0),
    ];
    let results = run(&op, &image.descriptor, Some(&s), 1, &rows);
    let reference = Reference {
        image: &image,
        sampler: &s,
        axes: 2,
    };
    let mean = (1..=4)
        .map(|i| {
            let q = Query {
                coordinates: [0.4 + 4.0 / 64.0 * (i as f64 / 5.0 - 0.5), 0.3, 0.0],
                layer: 0,
                offsets: [0; 3],
                lambda: 0.0,
                reference: None,
            };
            reference.level(0, Filter::Linear, &q).unwrap()[0]
        })
        .sum::<f64>()
        / 4.0;
    assert!((f32::from_bits(results[0][0]) as f64 - mean).abs() < 1e-4);
}

/// A texel is enough for a footprint that is no longer than one, however thin it is.
#[test]
fn short_footprints_are_sampled_once() {
    let image = Image::new(Format::R32_SFLOAT, Dim::D2, [64, 64, 1], 1, 1, 3);
    let s = SamplerDescriptor {
        max_anisotropy: 16.0,
        ..sampler()
    };
    let op = ImageOp {
        lod: LodMode::Grad,
        ..ImageOp::plain(ImageOpKind::Sample, Dim::D2)
    };
    let sampled = |along: f32, across: f32| {
        let rows = [
            row(0.4),
            row(0.3),
            row(0.0),
            row(across / 64.0),
            row(along / 64.0),
            row(0.0),
        ];
        run(&op, &image.descriptor, Some(&s), 1, &rows)[0][0]
    };
    assert_eq!(sampled(1.0, 0.1), sampled(1.0, 1.0));
    // Two of them two texels apart.
    assert_ne!(sampled(2.0, 0.1), sampled(1.0, 1.0));
}

/// Of two levels that are equally near, the smaller image is sampled: Direct3D 11 rounds levels of
/// detail up from a half on, and Vulkan allows it.
#[test]
fn ties_of_levels_go_to_the_smaller_image() {
    let image = Image::new(Format::R32_SFLOAT, Dim::D2, [4, 4, 1], 3, 1, 5);
    let s = SamplerDescriptor {
        mag_filter: Filter::Nearest,
        min_filter: Filter::Nearest,
        mipmap_mode: Filter::Nearest,
        ..sampler()
    };
    let op = ImageOp {
        lod: LodMode::Lod,
        ..ImageOp::plain(ImageOpKind::Sample, Dim::D2)
    };
    let cases = [
        (0.0, 0),
        (0.49, 0),
        (0.5, 1),
        (1.0, 1),
        (1.49, 1),
        (1.5, 2),
        (2.0, 2),
        (9.5, 2),
    ];
    let lods = std::array::from_fn(|lane| f32::to_bits(cases[lane % cases.len()].0));
    let rows = [row(0.1), row(0.1), lods];
    let results = run(&op, &image.descriptor, Some(&s), u16::MAX, &rows);
    for (lane, &word) in results[0].iter().enumerate() {
        let (lod, level) = cases[lane % cases.len()];
        let expected = image.texel(level, 0, [0; 3])[0];
        assert_eq!(f32::from_bits(word) as f64, expected, "{lod}");
    }
}
