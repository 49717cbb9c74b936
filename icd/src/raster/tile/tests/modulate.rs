//! Compares programs that sample and multiply with programs that multiply once more by a half and
//! by two, and so have to run: all bits, in every tier.

use ash::vk;
use images::{AddressMode, Filter, Format, ImageDescriptor, Level, SamplerDescriptor};
use lanes::Tier;
use spirv_jit::environment::{Descriptor, DescriptorSet, Environment};
use spirv_jit::program::Program;
use std::sync::Arc;

use super::direct::{Drawn, state};
use super::rectangle::halves;
use super::support::{Canvas, Random, chunk_of, draw, program, run, targets};
use crate::raster::Work;

/// Texels of a level's side, at most.
const SIDE: u32 = 16;

/// A program of a texel at the first two varyings, with its alpha or without: `is_direct` or with
/// some work.
fn sampling(is_direct: bool, alpha: &str) -> Arc<Program> {
    let work = match is_direct {
        true => "",
        false => {
            "v16: f32 = const 0x3f000000
            v17: f32 = const 0x40000000
            v18: f32 = fmul v14, v16
            v19: f32 = fmul v15, v16
            v20: f32 = fmul v12, v16
            v21: f32 = fmul v18, v17
            v22: f32 = fmul v19, v17
            v23: f32 = fmul v20, v17"
        }
    };
    let results = match is_direct {
        true => "v14, v15, v12",
        false => "v21, v22, v23",
    };
    program(&format!(
        "module fragment
        inputs varying.0.0.linear.center, varying.0.1.linear.center, varying.0.2.linear.center, varying.0.3.linear.center
        output_rows 4
        outputs location.0.0.0, location.0.1.0, location.0.2.0, location.0.3.0
        fragment colors.1
        func f0 {{
            v4: i32 = const 0
            v5: descriptor = descriptor[set 0, first 0, count 1] v4
            v0: f32 = input[0]
            v1: f32 = input[1]
            v2: f32 = input[2]
            v3: f32 = input[3]
            v6: f32 = derivative_x v0
            v7: f32 = derivative_x v1
            v8: f32 = derivative_y v0
            v9: f32 = derivative_y v1
            v10: f32, v11: f32, v12: f32, v13: f32 = image.sample[2d, f32, grad, format 0, signed] v5, v5, v0, v1, v6, v7, v8, v9
            v14: f32 = fmul v2, v10
            v15: f32 = fmul v11, v3
            {work}
            end({results}, {alpha})
        }}"
    ))
}

fn image(random: &mut Random, texels: &mut [u8]) -> ImageDescriptor {
    for texel in texels.iter_mut() {
        *texel = random.u8(..);
    }
    let formats = [
        vk::Format::R8G8B8A8_UNORM,
        vk::Format::B8G8R8A8_UNORM,
        vk::Format::R8G8B8A8_SRGB,
        vk::Format::R16G16_UNORM,
    ];
    let mut image = ImageDescriptor {
        data: texels.as_mut_ptr(),
        size_bytes: texels.len() as u64,
        format: Format(formats[random.i64(0..4) as usize].as_raw() as u32),
        level_count: random.i64(1..5) as u8,
        layer_count: 1,
        ..ImageDescriptor::NULL
    };
    let mut offset_bytes = 0;
    for (number, level) in image.levels[..4].iter_mut().enumerate() {
        let side = SIDE >> number;
        *level = Level {
            offset_bytes,
            row_stride_bytes: u64::from(4 * side),
            slice_stride_bytes: 0,
            width: side,
            height: side,
            depth: 1,
        };
        offset_bytes += u64::from(4 * side * side);
    }
    image
}

fn sampler(random: &mut Random) -> SamplerDescriptor {
    let modes = [
        AddressMode::Repeat,
        AddressMode::ClampToEdge,
        AddressMode::MirroredRepeat,
        AddressMode::ClampToBorder,
    ];
    let filters = [Filter::Linear, Filter::Nearest];
    let mut pick = |count| random.i64(0..count) as usize;
    let filter = filters[pick(2)];
    SamplerDescriptor {
        mag_filter: filter,
        min_filter: filter,
        mipmap_mode: filters[pick(2)],
        address_mode: [modes[pick(4)], modes[pick(4)], AddressMode::Repeat],
        max_lod: 1000.0,
        ..SamplerDescriptor::DEFAULT
    }
}

/// Two triangles that are a rectangle.
fn boxed(random: &mut Random, extent: [u32; 2]) -> [Drawn; 2] {
    let mut drawn = [(); 2].map(|()| Drawn::new(random, extent));
    let reach = [12, 40, 150][random.i64(0..3) as usize] * 256;
    let least = extent.map(|it| random.i64(-2560..i64::from(it) * 256) as i32);
    let greatest = least.map(|it| it + random.i64(1..reach) as i32);
    let corners = halves(least, greatest, random.i64(0..2) == 0);
    for (drawn, corners) in drawn.iter_mut().zip(corners) {
        drawn.corners = corners;
    }
    if random.i64(0..3) == 0 {
        // One colour, one texel.
        drawn[0].colors = [drawn[0].colors[0]; 3];
        drawn[1].colors = drawn[0].colors;
    }
    drawn
}

fn check(random: &mut Random) {
    let extent = [(); 2].map(|()| random.i64(1..150) as u32);
    let samples = [1, 1, 1, 4][random.i64(0..4) as usize];
    let format = [
        vk::Format::R8G8B8A8_UNORM,
        vk::Format::B8G8R8A8_UNORM,
        vk::Format::R16G16B16A16_SFLOAT,
    ][random.i64(0..3) as usize];
    let mut state = state(random);
    state.multisample.samples = samples;
    let mut drawn: Vec<_> = (0..5).map(|_| Drawn::new(random, extent)).collect();
    if random.i64(0..2) == 0 {
        drawn = (0..4).flat_map(|_| boxed(random, extent)).collect();
        state.depth_stencil.depth_test &= random.i64(0..4) == 0;
    }
    for triangle in &mut drawn {
        // A few texels a pixel or a few pixels a texel.
        let scale = [0.25, 4.0][random.i64(0..2) as usize];
        for color in &mut triangle.colors {
            (color[0], color[1]) = (color[0] * scale, color[1] * scale);
        }
    }
    let mut texels = vec![0; 4 * (SIDE * SIDE * 2) as usize];
    let (image, sampler) = (image(random, &mut texels), sampler(random));
    let descriptor = Descriptor {
        image: &raw const image,
        sampler: &raw const sampler,
        ..Descriptor::NULL
    };
    let alpha = ["v3", "v13"][random.i64(0..2) as usize];
    // The varyings are linear one way or the other.
    let is_affine = random.i64(0..2) == 0;
    let mut wanted: Option<Vec<u8>> = None;
    for limit in Tier::ALL {
        limit.limit();
        for is_direct in [false, true] {
            let [width, height] = extent;
            let color = Canvas::new(format, width, height, 1, samples);
            let depth = Canvas::new(vk::Format::D32_SFLOAT, width, height, 1, samples);
            let targets = targets(Some(&color), Some(&depth));
            let shapes = drawn.iter().map(|it| {
                let colors = it.colors.map(|color| color.map(f32::to_bits));
                (it.corners, it.depth, it.linear, it.origin, colors)
            });
            let mut chunk = chunk_of(0, &targets, shapes);
            for record in chunk.records.iter_mut().filter(|_| is_affine) {
                record.perspective = chunk.linear[record.linear as usize];
                record.is_affine = true;
            }
            let program = sampling(is_direct, alpha);
            assert_eq!(program.modulated().is_some(), is_direct);
            let mut environment = Environment::unbound();
            environment.sets[0] = DescriptorSet {
                entries: &raw const descriptor,
                count: 1,
                ..DescriptorSet::NONE
            };
            let mut draw = draw(state.clone(), Some(program));
            draw.environment = Arc::new(environment);
            run(1, &targets, &[Work::Draw(draw)], &[chunk]);
            let wanted = wanted.get_or_insert_with(|| color.bytes().to_vec());
            assert!(
                wanted == color.bytes(),
                "{format:?} {extent:?} {samples} {sampler:?} {:?} {} {is_direct} {limit}",
                image.format,
                image.level_count
            );
        }
    }
}

#[test]
fn programs_that_run_sample_the_same() {
    // A program that is not optimized takes more than the two megabytes that threads have.
    let thread = std::thread::Builder::new().stack_size(8 << 20);
    let checks = thread.spawn(|| {
        let mut random = Random::with_seed(0x7a11_5eed_0bad_cafe);
        for _ in 0..200 {
            check(&mut random);
        }
    });
    checks.expect("a thread").join().expect("the checks pass");
}
