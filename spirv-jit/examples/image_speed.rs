//! Nanoseconds per lane of image operations: `cargo run --release -p spirv-jit --example image_speed`.
//!
//! The texture is 512², all levels; coordinates are random, or neighbouring as a wave's often are. Before a speed is printed, a texture of one colour must give
//! that colour.

use std::hint::black_box;
use std::time::Instant;

use spirv_jit::image::execute::execute_block;
use spirv_jit::image::{
    AddressMode, Dim, Filter, Format, ImageDescriptor, ImageOp, ImageOpKind, Level, LodMode,
    MAX_LEVELS, Reduction, SamplerDescriptor,
};
use spirv_jit::ir::Type;
use spirv_jit::program::Row;

const SIDE: u32 = 512;
const BLOCKS: usize = 1024;

fn image(format: Format, memory: &mut Vec<u8>, texel: &[u8]) -> ImageDescriptor {
    let mut levels = [Level::default(); MAX_LEVELS];
    let mut size = 0;
    for (index, level) in levels.iter_mut().enumerate().take(10) {
        let side = SIDE >> index;
        let row = side as u64 * texel.len() as u64;
        *level = Level {
            offset_bytes: size,
            row_stride_bytes: row,
            slice_stride_bytes: row * side as u64,
            width: side,
            height: side,
            depth: 1,
        };
        size += row * side as u64;
    }
    *memory = texel.repeat(size as usize / texel.len());
    ImageDescriptor {
        data: memory.as_mut_ptr(),
        size_bytes: size,
        format,
        dim: Dim::D2,
        arrayed: false,
        samples: 1,
        level_count: 10,
        layer_count: 1,
        layer_stride_bytes: size,
        sample_stride_bytes: size,
        swizzle: [0, 1, 2, 3],
        min_lod: 0.0,
        levels,
        conversion: None,
    }
}

fn sampler(filter: Filter, mipmap_mode: Filter) -> SamplerDescriptor {
    SamplerDescriptor {
        mag_filter: filter,
        min_filter: filter,
        mipmap_mode,
        address_mode: [AddressMode::Repeat; 3],
        mip_lod_bias: 0.0,
        min_lod: 0.0,
        max_lod: 1000.0,
        max_anisotropy: 1.0,
        compare: None,
        reduction: Reduction::WeightedAverage,
        border_color: [0; 4],
        unnormalized_coordinates: false,
        non_seamless: false,
    }
}

fn op(kind: ImageOpKind, lod: LodMode) -> ImageOp {
    ImageOp {
        kind,
        dim: Dim::D2,
        arrayed: false,
        multisampled: false,
        depth_compare: false,
        lod,
        has_min_lod: false,
        has_offset: false,
        has_offsets: false,
        texel: Type::F32,
        signed: false,
        format: Format::UNDEFINED,
    }
}

fn main() {
    let mut state = 1u32;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let mut rows = |scale: f32| -> Vec<Row> {
        (0..BLOCKS)
            .map(|_| std::array::from_fn(|_| (random() * scale).to_bits()))
            .collect()
    };
    let (u, v, lods) = (rows(1.0), rows(1.0), rows(6.0));
    let near = |row: &Row, step: f32| -> Row {
        let first = f32::from_bits(row[0]);
        std::array::from_fn(|lane| (first + lane as f32 * step).to_bits())
    };
    let near_u: Vec<Row> = u.iter().map(|row| near(row, 1.0 / SIDE as f32)).collect();
    let near_v: Vec<Row> = v.iter().map(|row| near(row, 0.0)).collect();
    let uniform: Vec<Row> = lods.iter().map(|row| [row[0]; 16]).collect();
    let zero: Vec<Row> = vec![[0; 16]; BLOCKS];
    let to_index = |rows: &[Row]| -> Vec<Row> {
        rows.iter()
            .map(|row| row.map(|bits| (f32::from_bits(bits) * SIDE as f32) as u32))
            .collect()
    };
    let (i, j) = (to_index(&u), to_index(&v));

    let rgba8 = (Format::R8G8B8A8_UNORM, vec![51, 102, 153, 255]);
    let srgb = (Format::R8G8B8A8_SRGB, vec![51, 102, 153, 255]);
    let half = (
        Format::R16G16B16A16_SFLOAT,
        [0x3000u16, 0x3800, 0x3a00, 0x3c00]
            .iter()
            .flat_map(|h| h.to_le_bytes())
            .collect(),
    );
    let float = (
        Format::R32G32B32A32_SFLOAT,
        [0.25f32, 0.5, 0.75, 1.0]
            .iter()
            .flat_map(|f| f.to_le_bytes())
            .collect(),
    );
    let single = (Format::R32_SFLOAT, 0.25f32.to_le_bytes().to_vec());
    let (linear, nearest) = (Filter::Linear, Filter::Nearest);
    let sample = op(ImageOpKind::Sample, LodMode::Lod);
    let fetch = op(ImageOpKind::Fetch, LodMode::Lod);
    let write = op(ImageOpKind::Write, LodMode::Implicit);
    type Case<'a> = (
        &'a str,
        &'a (Format, Vec<u8>),
        ImageOp,
        Filter,
        Filter,
        Vec<&'a [Row]>,
    );
    let color: Vec<Vec<Row>> = (0..4).map(|_| vec![[1f32.to_bits(); 16]; BLOCKS]).collect();
    let mut write_rows: Vec<&[Row]> = vec![&i, &j];
    write_rows.extend(color.iter().map(Vec::as_slice));
    let only = std::env::args().nth(1).unwrap_or_default();
    let cases: Vec<Case<'_>> = vec![
        (
            "rgba8 nearest, level 0",
            &rgba8,
            sample,
            nearest,
            nearest,
            vec![&u, &v, &zero],
        ),
        (
            "rgba8 bilinear, level 0",
            &rgba8,
            sample,
            linear,
            nearest,
            vec![&u, &v, &zero],
        ),
        (
            "rgba8 bilinear, level 0, neighbours",
            &rgba8,
            sample,
            linear,
            nearest,
            vec![&near_u, &near_v, &zero],
        ),
        (
            "rgba8 trilinear, one lod a block",
            &rgba8,
            sample,
            linear,
            linear,
            vec![&u, &v, &uniform],
        ),
        (
            "rgba8 trilinear, a lod a lane",
            &rgba8,
            sample,
            linear,
            linear,
            vec![&u, &v, &lods],
        ),
        (
            "srgb8 bilinear, level 0",
            &srgb,
            sample,
            linear,
            nearest,
            vec![&u, &v, &zero],
        ),
        (
            "srgb8 trilinear, a lod a lane",
            &srgb,
            sample,
            linear,
            linear,
            vec![&u, &v, &lods],
        ),
        (
            "rgba16f bilinear, level 0",
            &half,
            sample,
            linear,
            nearest,
            vec![&u, &v, &zero],
        ),
        (
            "rgba32f bilinear, level 0",
            &float,
            sample,
            linear,
            nearest,
            vec![&u, &v, &zero],
        ),
        (
            "r32f bilinear, level 0",
            &single,
            sample,
            linear,
            nearest,
            vec![&u, &v, &zero],
        ),
        (
            "rgba8 fetch",
            &rgba8,
            fetch,
            nearest,
            nearest,
            vec![&i, &j, &zero],
        ),
        (
            "rgba32f fetch",
            &float,
            fetch,
            nearest,
            nearest,
            vec![&i, &j, &zero],
        ),
        (
            "rgba8 write",
            &rgba8,
            write,
            nearest,
            nearest,
            write_rows.clone(),
        ),
        ("rgba32f write", &float, write, nearest, nearest, write_rows),
    ];
    for (name, (format, texel), op, filter, mipmap_mode, rows) in cases {
        if !name.contains(&only) {
            continue;
        }
        let mut memory = Vec::new();
        let image = image(*format, &mut memory, texel);
        let sampler = sampler(filter, mipmap_mode);
        let operands: Vec<Vec<&Row>> = (0..BLOCKS)
            .map(|block| rows.iter().map(|rows| &rows[block]).collect())
            .collect();
        let run = |block: usize, results: &mut [Row; 8]| {
            // SAFETY: the image's memory is alive.
            unsafe {
                execute_block(
                    &op,
                    Some(&image),
                    Some(&sampler),
                    u16::MAX,
                    &operands[block],
                    results,
                );
            }
        };
        let mut results = [[0; 16]; 8];
        if op.is_read() {
            let expected = format.info().expect("a format of the table").decode(texel);
            for block in 0..BLOCKS {
                run(block, &mut results);
                for lane in 0..16 {
                    assert_eq!(
                        std::array::from_fn::<u32, 4, _>(|c| results[c][lane]),
                        expected,
                        "{name}"
                    );
                }
            }
        }
        let best = (0..200)
            .map(|_| {
                let start = Instant::now();
                for block in 0..BLOCKS {
                    run(black_box(block), &mut results);
                    black_box(&results);
                }
                start.elapsed().as_secs_f64()
            })
            .fold(f64::MAX, f64::min);
        println!("{:6.2} ns  {name}", best * 1e9 / (BLOCKS * 16) as f64);
    }
}
