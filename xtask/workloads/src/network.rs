//! A network of three layers for each hit: with cooperative vectors, and in plain loops.

use std::ffi::CStr;

use anyhow::{Result, ensure};
use half::f16;
use tuff_tests::newer::{self, ConvertCooperativeVectorMatrixInfoNV as Info};
use tuff_tests::{Bound, Buffer, Gpu, Rng, between, vk};

use crate::shader;
use crate::workload::{Parts, Prepared, launch, pipeline};
use crate::world::{Scale, World};

/// Components of the input, of each layer and of the result.
const WIDTH: usize = 64;
const LAYERS: usize = 3;

const ROW_MAJOR: i32 = 0;
const INFERENCING_OPTIMAL: i32 = 2;

const F16: newer::ComponentTypeKHR = newer::ComponentTypeKHR::FLOAT16;

/// Weights and biases.
struct Network {
    /// By layers, then by rows.
    weights: Vec<f16>,
    biases: Vec<f16>,
}

impl Network {
    fn new() -> Network {
        let mut random = Rng::with_seed(17);
        let mut numbers = |count: usize, reach: f32| -> Vec<f16> {
            let number = |_| f16::from_f32(between(&mut random, -reach, reach));
            (0..count).map(number).collect()
        };
        let weights = numbers(LAYERS * WIDTH * WIDTH, 0.3);
        let mut biases = numbers(LAYERS * WIDTH, 0.1);
        for bias in &mut biases[(LAYERS - 1) * WIDTH..] {
            *bias = f16::from_f32(bias.to_f32() + 0.5);
        }
        Network { weights, biases }
    }

    /// The first three components of the result at a spot, in 64-bit floats, and the variance that
    /// 16-bit floats add to each.
    ///
    /// A device may round inputs, products, sums and results, each to 16 bits, and either way: an
    /// error is less than 2⁻¹⁰ of the number. Errors add up as independent ones do.
    fn evaluate(&self, spot: &[f32]) -> [(f64, f64); 3] {
        let rounded = |number: f64| (number / 1024.0).powi(2);
        let mut vector: Vec<(f64, f64)> = (0..WIDTH)
            .map(|k| {
                let number = f64::from(f16::from_f32(hat(spot[k % 3], k)));
                (number, rounded(number))
            })
            .collect();
        for layer in 0..LAYERS {
            let row = |row: usize| {
                let line = layer * WIDTH + row;
                let (mut sum, mut variance) = (f64::from(self.biases[line]), 0.0);
                let weights = &self.weights[line * WIDTH..][..WIDTH];
                for (weight, (x, varies)) in weights.iter().zip(&vector) {
                    let weight = f64::from(*weight);
                    sum += weight * x;
                    variance += weight * weight * varies + rounded(weight * x) + rounded(sum);
                }
                let is_last = layer == LAYERS - 1;
                (if is_last { sum } else { sum.max(0.0) }, variance)
            };
            vector = (0..WIDTH).map(row).collect();
        }
        [vector[0], vector[1], vector[2]]
    }

    /// Checks the pixels of hits, whose spots a shader left: every fifth of them.
    fn check(&self, pixels: &[[f32; 4]], spots: &[[f32; 4]]) -> Result<()> {
        let hits = || pixels.iter().zip(spots).filter(|(_, spot)| spot[3] == 1.0);
        ensure!(hits().count() > pixels.len() / 8, "few rays hit anything");
        for (pixel, spot) in hits().step_by(5) {
            let expected = self.evaluate(spot);
            for (&found, (value, variance)) in pixel.iter().zip(expected) {
                let apart = (f64::from(found) - value).abs();
                let tolerance = 6.0 * variance.sqrt();
                ensure!(
                    apart <= tolerance,
                    "{pixel:?} at {spot:?} is {apart} from {value}: more than {tolerance}"
                );
            }
        }
        Ok(())
    }
}

/// A component of the input: how near a coordinate of the spot is to a place.
fn hat(coordinate: f32, k: usize) -> f32 {
    (1.0 - (coordinate - place(k)).abs()).max(0.0)
}

fn place(k: usize) -> f32 {
    (k / 3) as f32 * 0.25
}

/// GLSL that assigns the inputs to `x`. No product is among it: all devices have the same sums.
fn inputs() -> String {
    let input = |k: usize| {
        let (axis, place) = (["x", "y", "z"][k % 3], place(k));
        format!(" x[{k}] = float16_t(max(0.0, 1.0 - abs(spot.{axis} - {place:?})));")
    };
    let inputs: String = (0..WIDTH).map(input).collect();
    format!("#define INPUTS{inputs}\n")
}

/// The layers as cooperative vectors, with matrices in the layout for inference.
pub fn vectors(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    if !has_vectors(gpu) {
        return None;
    }
    let network = Network::new();
    let matrices: Vec<Vec<u8>> = network
        .weights
        .chunks(WIDTH * WIDTH)
        .map(|weights| optimal(gpu, weights))
        .collect();
    let layer_bytes = matrices[0].len().next_multiple_of(64);
    let weights = gpu.buffer((LAYERS * layer_bytes) as u64);
    for (layer, matrix) in matrices.iter().enumerate() {
        weights.write(layer * layer_bytes, matrix);
    }
    let source = format!(
        "#pragma use_vulkan_memory_model\nconst uint LAYER_BYTES = {layer_bytes}u;\n{}{}",
        inputs(),
        shader::NETWORK_VECTORS
    );
    Some(prepared(gpu, scale, network, weights, &source))
}

/// The same network as loops over its weights.
pub fn plain(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    let has_halves = gpu.features12.shader_float16 != vk::FALSE
        && gpu.features11.storage_buffer16_bit_access != vk::FALSE;
    if !has_halves {
        return None;
    }
    let network = Network::new();
    let weights = gpu.buffer_with(&bits(&network.weights));
    let source = inputs() + shader::NETWORK_PLAIN;
    Some(prepared(gpu, scale, network, weights, &source))
}

fn prepared(gpu: &Gpu, scale: &Scale, network: Network, weights: Buffer, source: &str) -> Prepared {
    let parts = Parts::new(
        shader::raygen(shader::NETWORK),
        shader::MISS,
        shader::network_hit(source),
    );
    let world = World::landscape(gpu, scale, 1);
    let biases = gpu.buffer_with(&bits(&network.biases));
    let spots = gpu.buffer_with(&vec![[0.0f32; 4]; scale.pixels() as usize]);
    let mut bindings = world.bindings();
    bindings.push((5, [Bound::Storage(weights)]));
    bindings.push((6, [Bound::Storage(biases)]));
    bindings.push((7, [Bound::Storage(spots)]));
    let rays = pipeline(gpu, &parts, &bindings);
    let turn = launch(gpu, scale, &rays, 1);
    let picture = world.out;
    Prepared {
        check: Some(Box::new(move |_| {
            network.check(&picture.read(), &spots.read())
        })),
        ..Prepared::picture(turn, &world)
    }
}

fn bits(numbers: &[f16]) -> Vec<u16> {
    numbers.iter().map(|number| number.to_bits()).collect()
}

/// Whether closest-hit shaders have cooperative vectors.
fn has_vectors(gpu: &Gpu) -> bool {
    let optional = &gpu.optional;
    if optional.cooperative_vector.cooperative_vector == vk::FALSE
        || optional.replicated_composites.shader_replicated_composites == vk::FALSE
    {
        return false;
    }
    let mut properties = newer::PhysicalDeviceCooperativeVectorPropertiesNV::default();
    let mut both = vk::PhysicalDeviceProperties2 {
        p_next: (&raw mut properties).cast(),
        ..Default::default()
    };
    // SAFETY: the physical device is of the instance; the chain outlives the call.
    unsafe {
        gpu.instance
            .get_physical_device_properties2(gpu.physical, &mut both);
    }
    properties
        .cooperative_vector_supported_stages
        .contains(vk::ShaderStageFlags::CLOSEST_HIT_KHR)
}

/// A matrix of one layer in the layout for inference.
fn optimal(gpu: &Gpu, weights: &[f16]) -> Vec<u8> {
    type Convert = unsafe extern "system" fn(vk::Device, *const Info) -> vk::Result;
    const NAME: &CStr = c"vkConvertCooperativeVectorMatrixNV";
    let source = bits(weights);
    let mut size = 0;
    let mut info = Info {
        src_size: size_of_val(&source[..]),
        src_data: source.as_ptr() as u64,
        p_dst_size: &raw mut size,
        src_component_type: F16,
        dst_component_type: F16,
        num_rows: WIDTH as u32,
        num_columns: WIDTH as u32,
        src_layout: ROW_MAJOR,
        src_stride: WIDTH * size_of::<f16>(),
        dst_layout: INFERENCING_OPTIMAL,
        ..Info::default()
    };
    // SAFETY: the command has this type; the infos name memory that is large enough.
    unsafe {
        let found = gpu
            .instance
            .get_device_proc_addr(gpu.device.handle(), NAME.as_ptr());
        let found: vk::PFN_vkVoidFunction = found;
        let convert: Convert = std::mem::transmute(found.expect("the command"));
        let device = gpu.device.handle();
        assert_eq!(convert(device, &raw const info), vk::Result::SUCCESS);
        let mut matrix = vec![0; info.p_dst_size.read()];
        info.dst_data = matrix.as_mut_ptr() as u64;
        assert_eq!(convert(device, &raw const info), vk::Result::SUCCESS);
        matrix
    }
}
