//! `VK_NV_cooperative_vector`: small networks in every stage that has them, with matrices in every
//! layout, and the conversions that make those.

use std::ffi::CStr;

use bytemuck::Pod;
use half::f16;
use tuff_tests::newer as vk;
use tuff_tests::*;
use vk::ConvertCooperativeVectorMatrixInfoNV as Info;

const ROW_MAJOR: i32 = 0;
const COLUMN_MAJOR: i32 = 1;
const INFERENCING_OPTIMAL: i32 = 2;
const TRAINING_OPTIMAL: i32 = 3;

const F16: vk::ComponentTypeKHR = vk::ComponentTypeKHR::FLOAT16;
const F32: vk::ComponentTypeKHR = vk::ComponentTypeKHR::FLOAT32;
const S8: vk::ComponentTypeKHR = vk::ComponentTypeKHR::SINT8;
const S32: vk::ComponentTypeKHR = vk::ComponentTypeKHR::SINT32;
const U32: vk::ComponentTypeKHR = vk::ComponentTypeKHR::UINT32;
const PACKED_S8: vk::ComponentTypeKHR = vk::ComponentTypeKHR::from_raw(1_000_491_000);
const E4M3: vk::ComponentTypeKHR = vk::ComponentTypeKHR::from_raw(1_000_491_002);
const E5M2: vk::ComponentTypeKHR = vk::ComponentTypeKHR::from_raw(1_000_491_003);

/// Components before the first layer of the network, and behind each.
const WIDTHS: [usize; 4] = [9, 16, 21, 3];
const INVOCATIONS: usize = 75;

fn gpu_with_vectors() -> Option<Gpu> {
    Gpu::validated_since(vk::make_api_version(0, 1, 4, 309)).with(
        "cooperative vectors, replicated composites",
        |gpu| {
            gpu.optional.cooperative_vector.cooperative_vector != 0
                && gpu
                    .optional
                    .replicated_composites
                    .shader_replicated_composites
                    != 0
        },
    )
}

/// A function of the device by name, as a pointer of type `T`.
fn function<T: Copy>(gpu: &Gpu, name: &CStr) -> T {
    assert_eq!(size_of::<T>(), size_of::<vk::PFN_vkVoidFunction>());
    // SAFETY: the caller names the type of the function.
    unsafe {
        let found = gpu
            .instance
            .get_device_proc_addr(gpu.device.handle(), name.as_ptr());
        assert!(found.is_some(), "{name:?}");
        std::mem::transmute_copy(&found)
    }
}

fn convert(gpu: &Gpu, info: &Info) -> vk::Result {
    type Convert = unsafe extern "system" fn(vk::Device, *const Info) -> vk::Result;
    let convert: Convert = function(gpu, c"vkConvertCooperativeVectorMatrixNV");
    // SAFETY: the info names memory of the caller's.
    unsafe { convert(gpu.device.handle(), info) }
}

fn record_convert(gpu: &Gpu, commands: vk::CommandBuffer, infos: &[Info]) {
    type Convert = unsafe extern "system" fn(vk::CommandBuffer, u32, *const Info);
    let convert: Convert = function(gpu, c"vkCmdConvertCooperativeVectorMatrixNV");
    // SAFETY: the infos name buffers of the caller's.
    unsafe { convert(commands, infos.len() as u32, infos.as_ptr()) }
}

/// A matrix in memory: components, layout, and bytes from line to line.
#[derive(Clone, Copy, Debug)]
struct Form {
    component: vk::ComponentTypeKHR,
    layout: i32,
    stride: usize,
}

impl Form {
    fn new(component: vk::ComponentTypeKHR, layout: i32, [rows, columns]: [usize; 2]) -> Form {
        let bytes = match component {
            F32 => 4,
            F16 => 2,
            _ => 1,
        };
        let elements = if layout == COLUMN_MAJOR {
            rows
        } else {
            columns
        };
        Form {
            component,
            layout,
            stride: match layout {
                ROW_MAJOR | COLUMN_MAJOR => (elements * bytes).next_multiple_of(16),
                _ => 0,
            },
        }
    }
}

/// A conversion between two forms, without memory.
fn info([from, to]: [Form; 2], [rows, columns]: [usize; 2], size: &mut usize) -> Info {
    Info {
        p_dst_size: size,
        src_component_type: from.component,
        dst_component_type: to.component,
        num_rows: rows as u32,
        num_columns: columns as u32,
        src_layout: from.layout,
        src_stride: from.stride,
        dst_layout: to.layout,
        dst_stride: to.stride,
        ..Info::default()
    }
}

/// The bytes of a matrix in another form, as the host converts them.
fn converted(gpu: &Gpu, forms: [Form; 2], shape: [usize; 2], bytes: &[u8]) -> Vec<u8> {
    let mut size = 0;
    let query = info(forms, shape, &mut size);
    assert_eq!(convert(gpu, &query), vk::Result::SUCCESS);
    // More than that, to see what is written.
    let mut to = vec![0xa5u8; size + 64];
    let needed = size;
    size -= 1;
    let with_memory = |size: &mut usize, to: &mut Vec<u8>| Info {
        src_size: bytes.len(),
        src_data: bytes.as_ptr() as u64,
        dst_data: to.as_mut_ptr() as u64,
        ..info(forms, shape, size)
    };
    // Nothing is written to memory that is too small (`vkConvertCooperativeVectorMatrixNV`).
    let too_small = with_memory(&mut size, &mut to);
    assert_eq!(convert(gpu, &too_small), vk::Result::INCOMPLETE);
    assert!(to.iter().all(|&byte| byte == 0xa5));
    let mut size = needed + 5;
    let done = with_memory(&mut size, &mut to);
    assert_eq!(convert(gpu, &done), vk::Result::SUCCESS);
    assert_eq!(size, needed);
    assert!(to[needed..].iter().all(|&byte| byte == 0xa5));
    to.truncate(needed);
    to
}

/// The same, as the device converts them.
fn converted_on_device(gpu: &Gpu, forms: [Form; 2], shape: [usize; 2], bytes: &[u8]) -> Vec<u8> {
    let mut size = 0;
    let query = info(forms, shape, &mut size);
    assert_eq!(convert(gpu, &query), vk::Result::SUCCESS);
    let source = gpu.buffer(bytes.len() as u64);
    source.write(0, bytes);
    let target = gpu.buffer(size as u64);
    let one = Info {
        src_size: bytes.len(),
        src_data: source.address,
        dst_data: target.address,
        ..info(forms, shape, &mut size)
    };
    gpu.run(|commands| record_convert(gpu, commands, &[one]));
    target.read()
}

/// A weight of a layer, and a component of its bias.
fn weight(layer: usize, row: usize, column: usize) -> i32 {
    match (row * 5 + column * 3 + layer) % 7 {
        0 => 1,
        3 => -1,
        5 => 2,
        _ => 0,
    }
}

fn bias(layer: usize, row: usize) -> i32 {
    (row + layer) as i32 % 5 - 2
}

fn input(invocation: usize, k: usize) -> i32 {
    ((invocation * 3 + k * 5) % 9) as i32 - 4
}

/// The network's result for an invocation, in exact arithmetic.
fn network(invocation: usize) -> Vec<i32> {
    let mut vector: Vec<i32> = (0..WIDTHS[0]).map(|k| input(invocation, k)).collect();
    for layer in 0..3 {
        let row = |row: usize| {
            let products = vector
                .iter()
                .enumerate()
                .map(|(k, x)| weight(layer, row, k) * x);
            let sum = bias(layer, row) + products.sum::<i32>();
            // Every 16-bit float holds such.
            assert!(sum.abs() <= 2048);
            if layer < 2 { sum.max(0) } else { sum }
        };
        vector = (0..WIDTHS[layer + 1]).map(row).collect();
    }
    vector
}

/// The bits of numbers as 16-bit floats.
fn halves(numbers: impl IntoIterator<Item = i32>) -> Vec<u16> {
    let bits = |number: i32| f16::from_f32(number as f32).to_bits();
    numbers.into_iter().map(bits).collect()
}

fn bytes_of<T: Pod>(items: &[T]) -> Vec<u8> {
    bytemuck::cast_slice(items).to_vec()
}

/// A layer's matrix, whose rows are padded, of 32-bit floats.
fn matrix(layer: usize) -> (Form, [usize; 2], Vec<u8>) {
    let shape = [WIDTHS[layer + 1], WIDTHS[layer]];
    let form = Form::new(F32, ROW_MAJOR, shape);
    let mut words = vec![0f32; shape[0] * form.stride / 4];
    for row in 0..shape[0] {
        for column in 0..shape[1] {
            words[row * form.stride / 4 + column] = weight(layer, row, column) as f32;
        }
    }
    (form, shape, bytes_of(&words))
}

const BIAS_BYTES: usize = 64;

/// Buffers of the network: matrices, biases and inputs.
struct Network {
    matrices: Buffer,
    biases: Buffer,
    inputs: Buffer,
    /// GLSL that declares them from a binding on, and `vec3 network(uint)`.
    source: String,
}

impl Network {
    fn new(gpu: &Gpu, component: vk::ComponentTypeKHR, layout: i32, on_device: bool) -> Network {
        let mut matrices = Vec::new();
        let mut layers = String::new();
        let name = match component {
            E4M3 => "gl_ComponentTypeFloatE4M3NV",
            E5M2 => "gl_ComponentTypeFloatE5M2NV",
            _ => "gl_ComponentTypeFloat16NV",
        };
        for layer in 0..3 {
            let (from, shape, bytes) = matrix(layer);
            let to = Form::new(component, layout, shape);
            matrices.resize(matrices.len().next_multiple_of(64), 0);
            let offset = matrices.len();
            let convert = if on_device {
                converted_on_device
            } else {
                converted
            };
            matrices.extend(convert(gpu, [from, to], shape, &bytes));
            let [rows, columns] = shape;
            layers += &format!(
                "coopvecNV<float16_t, {rows}> v{};
                coopVecMatMulAddNV(v{}, v{layer}, {name}, matrices, {offset}, {name}, biases, {},
                    gl_ComponentTypeFloat16NV, {rows}, {columns}, {layout}, false, {});\n",
                layer + 1,
                layer + 1,
                layer * BIAS_BYTES,
                to.stride,
            );
            if layer < 2 {
                layers += &format!(
                    "v{0} = max(v{0}, coopvecNV<float16_t, {rows}>(float16_t(0)));\n",
                    layer + 1
                );
            }
        }
        let mut biases = vec![0u8; 3 * BIAS_BYTES];
        for layer in 0..3 {
            let part = bytes_of(&halves((0..WIDTHS[layer + 1]).map(|row| bias(layer, row))));
            biases[layer * BIAS_BYTES..][..part.len()].copy_from_slice(&part);
        }
        let mut inputs = Vec::new();
        for invocation in 0..INVOCATIONS {
            inputs.extend(bytes_of(&halves(
                (0..WIDTHS[0]).map(|k| input(invocation, k)),
            )));
            inputs.resize(inputs.len().next_multiple_of(16), 0);
        }
        let source = format!(
            "#pragma use_vulkan_memory_model
            layout(set = 0, binding = 5) readonly buffer M {{ float16_t matrices[]; }};
            layout(set = 0, binding = 6) readonly buffer B {{ float16_t biases[]; }};
            layout(set = 0, binding = 7) readonly buffer I {{ float16_t inputs[]; }};
            vec3 network(uint i) {{
                coopvecNV<float16_t, {}> v0;
                coopVecLoadNV(v0, inputs, i * {});
                {layers}
                return vec3(v3[0], v3[1], v3[2]);
            }}\n",
            WIDTHS[0],
            (2 * WIDTHS[0]).next_multiple_of(16),
        );
        Network {
            matrices: gpu.buffer_with(&matrices),
            biases: gpu.buffer_with(&biases),
            inputs: gpu.buffer_with(&inputs),
            source,
        }
    }

    fn bound(&self) -> [Bound; 3] {
        [self.matrices.into(), self.biases.into(), self.inputs.into()]
    }
}

#[test]
fn the_products_that_every_device_has_are_listed() {
    let Some(gpu) = gpu_with_vectors() else {
        return;
    };
    type List = unsafe extern "system" fn(
        vk::PhysicalDevice,
        *mut u32,
        *mut vk::CooperativeVectorPropertiesNV,
    ) -> vk::Result;
    let name = c"vkGetPhysicalDeviceCooperativeVectorPropertiesNV";
    // SAFETY: the instance is there, and the command has this type.
    let list: List = unsafe {
        let found =
            (gpu.entry.static_fn().get_instance_proc_addr)(gpu.instance.handle(), name.as_ptr());
        std::mem::transmute(found.expect("the command"))
    };
    let mut count = 0;
    // SAFETY: as many structures are there as the count says.
    let all = unsafe {
        assert_eq!(
            list(gpu.physical, &mut count, std::ptr::null_mut()),
            vk::Result::SUCCESS
        );
        let mut all = vec![vk::CooperativeVectorPropertiesNV::default(); count as usize];
        assert_eq!(
            list(gpu.physical, &mut count, all.as_mut_ptr()),
            vk::Result::SUCCESS
        );
        count = 1;
        let mut one = [vk::CooperativeVectorPropertiesNV::default()];
        assert_eq!(
            list(gpu.physical, &mut count, one.as_mut_ptr()),
            vk::Result::INCOMPLETE
        );
        all
    };
    for types in [
        [F16, F16, F16, F16, F16],
        [U32, PACKED_S8, S8, S32, S32],
        [S8, S8, S8, S32, S32],
        [F32, S8, S8, S32, S32],
        [F16, E4M3, E4M3, F16, F16],
        [F16, E5M2, E5M2, F16, F16],
    ] {
        assert!(
            all.iter().any(|product| product.types == types),
            "{types:?}"
        );
    }
    let mut properties = vk::PhysicalDeviceCooperativeVectorPropertiesNV::default();
    let mut both = vk::PhysicalDeviceProperties2 {
        p_next: (&raw mut properties).cast(),
        ..Default::default()
    };
    // SAFETY: the physical device is of the instance; the chain outlives the call.
    unsafe {
        gpu.instance
            .get_physical_device_properties2(gpu.physical, &mut both)
    };
    let stages = properties.cooperative_vector_supported_stages;
    assert!(stages.contains(vk::ShaderStageFlags::COMPUTE));
    assert!(properties.max_cooperative_vector_components >= 128);
}

#[test]
fn networks_with_matrices_in_every_layout() {
    let Some(gpu) = gpu_with_vectors() else {
        return;
    };
    let all = [
        ROW_MAJOR,
        COLUMN_MAJOR,
        INFERENCING_OPTIMAL,
        TRAINING_OPTIMAL,
    ];
    let halves = all.map(|layout| (F16, layout));
    // Matrices of 8-bit floats have the implementation's layouts.
    let eighths = [E4M3, E5M2].map(|component| (component, INFERENCING_OPTIMAL));
    for (component, layout) in halves.into_iter().chain(eighths) {
        for on_device in [false, true] {
            let network = Network::new(&gpu, component, layout, on_device);
            let output = gpu.buffer(16 * INVOCATIONS as u64);
            let [matrices, biases, inputs] = network.bound();
            // Lanes take part in turns, too.
            let source = format!(
                "{}
                layout(local_size_x = 25) in;
                layout(set = 0, binding = 0) buffer O {{ vec4 o[]; }};
                void main() {{
                    uint i = gl_GlobalInvocationID.x;
                    if (i % 3u == 0u) o[i] = vec4(network(i), 1);
                    else o[i] = vec4(network(i), 2);
                }}",
                network.source
            );
            let output_bound = [output.into()];
            let bindings: [(u32, &[Bound]); 4] = [
                (0, &output_bound),
                (5, &[matrices]),
                (6, &[biases]),
                (7, &[inputs]),
            ];
            gpu.compute_with(&source, &bindings, [3, 1, 1]);
            for (invocation, found) in output.read::<[f32; 4]>().into_iter().enumerate() {
                let expected = network_of(invocation);
                assert_eq!(
                    found[..3],
                    expected,
                    "{component:?} {layout} {on_device} {invocation}"
                );
            }
        }
    }
}

fn network_of(invocation: usize) -> [f32; 3] {
    let result = network(invocation);
    [0, 1, 2].map(|k| result[k] as f32)
}

/// Each lane has a matrix of its own: a row of what the others have.
#[test]
fn lanes_have_matrices_of_their_own() {
    let Some(gpu) = gpu_with_vectors() else {
        return;
    };
    let source = r"
    #pragma use_vulkan_memory_model
    layout(local_size_x = 32) in;
    layout(set = 0, binding = 0) readonly buffer M { float16_t matrices[]; };
    layout(set = 0, binding = 1) buffer O { float o[]; };
    void main() {
        uint i = gl_GlobalInvocationID.x;
        coopvecNV<float16_t, 8> v = coopvecNV<float16_t, 8>(float16_t(0));
        for (int k = 0; k < 8; k++) v[k] = float16_t(k + 1);
        coopvecNV<float16_t, 4> r;
        coopVecMatMulNV(r, v, gl_ComponentTypeFloat16NV, matrices, (i / 3u) * 64u,
            gl_ComponentTypeFloat16NV, 4, 8, gl_CooperativeVectorMatrixLayoutRowMajorNV, false, 16);
        for (int k = 0; k < 4; k++) o[4u * i + k] = float(r[k]);
    }";
    let number =
        |matrix: usize, row: usize, column: usize| ((matrix + row * 3 + column) % 7) as i32 - 3;
    let all = (0..11).flat_map(|m| (0..4).flat_map(move |r| (0..8).map(move |c| number(m, r, c))));
    let matrices = gpu.buffer_with(&bytes_of(&halves(all)));
    let output = gpu.buffer(4 * 4 * 32);
    gpu.compute(source, &[matrices, output], [1, 1, 1]);
    let found = output.read::<f32>();
    for (place, found) in found.into_iter().enumerate() {
        let (lane, row) = (place / 4, place % 4);
        let sum: i32 = (0..8)
            .map(|k| number(lane / 3, row, k) * (k as i32 + 1))
            .sum();
        assert_eq!(found, sum as f32, "row {row} of lane {lane}");
    }
}

/// Ray generation, intersection, any-hit, closest-hit, miss and callable shaders.
#[test]
fn networks_in_ray_tracing_shaders() {
    let Some(gpu) = gpu_with_vectors() else {
        return;
    };
    let network = Network::new(&gpu, F16, INFERENCING_OPTIMAL, false);
    let flags = vk::GeometryFlagsKHR::empty();
    let world = gpu.scene(&[Geometry::boxes(&[[-9.0, -9.0, 1.0, 9.0, 9.0, 2.0]], flags)]);
    let output = gpu.buffer(16 * 6 * INVOCATIONS as u64);
    let head = format!(
        "{}
        layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
        layout(set = 0, binding = 1) buffer O {{ vec4 o[]; }};
        void leave(uint stage) {{
            uint i = gl_LaunchIDEXT.x;
            o[6u * i + stage] = vec4(network(i), stage);
        }}\n",
        network.source
    );
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    layout(location = 1) callableDataEXT uint data;
    void main() {
        leave(0u);
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), 0.0, vec3(0, 0, 1), 100.0, 0);
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0), 0.0, vec3(0, 0, -1), 100.0, 0);
        executeCallableEXT(0, 1);
    }";
    let payload = "layout(location = 0) rayPayloadInEXT uint payload;\n";
    let case = Case::new(raygen)
        .miss(&format!("{payload} void main() {{ leave(1u); }}"))
        .hit(&format!("{payload} void main() {{ leave(2u); }}"))
        .any_hit(&format!("{payload} void main() {{ leave(3u); }}"))
        .intersection("void main() { leave(4u); reportIntersectionEXT(1.5, 0u); }")
        .callable("layout(location = 1) callableDataInEXT uint data; void main() { leave(5u); }")
        .head(&head);
    let [matrices, biases, inputs] = network.bound();
    // Bindings are numbered in order: the network's come after three that nothing uses.
    let case = case
        .bind(world)
        .bind(output)
        .bind(output)
        .bind(output)
        .bind(output);
    let case = case.bind(matrices).bind(biases).bind(inputs);
    case.trace(&gpu, [INVOCATIONS as u32, 1, 1]);
    for (place, found) in output.read::<[f32; 4]>().into_iter().enumerate() {
        let (invocation, stage) = (place / 6, place % 6);
        let [x, y, z] = network_of(invocation);
        assert_eq!(
            found,
            [x, y, z, stage as f32],
            "stage {stage} of {invocation}"
        );
    }
}

/// A matrix goes through every layout and comes back, on the host and on the device.
#[test]
fn matrices_are_converted_between_layouts() {
    let Some(gpu) = gpu_with_vectors() else {
        return;
    };
    let layouts = [
        ROW_MAJOR,
        COLUMN_MAJOR,
        INFERENCING_OPTIMAL,
        TRAINING_OPTIMAL,
    ];
    for shape in [[1, 1], [5, 19], [32, 16]] {
        let rows = Form::new(F16, ROW_MAJOR, shape);
        let mut bytes = vec![0; (shape[0] - 1) * rows.stride + 2 * shape[1]];
        let element = |row: usize, column: usize| (row * 7 + column) as i32 % 100 - 50;
        for row in 0..shape[0] {
            let line = bytes_of(&halves((0..shape[1]).map(|column| element(row, column))));
            bytes[row * rows.stride..][..line.len()].copy_from_slice(&line);
        }
        for [first, second] in layouts.iter().flat_map(|&a| layouts.map(|b| [a, b])) {
            for convert in [converted, converted_on_device] {
                let [a, b] = [first, second].map(|layout| Form::new(F16, layout, shape));
                let between = convert(&gpu, [rows, a], shape, &bytes);
                let between = convert(&gpu, [a, b], shape, &between);
                let back = convert(&gpu, [b, rows], shape, &between);
                for row in 0..shape[0] {
                    let line = row * rows.stride..row * rows.stride + 2 * shape[1];
                    assert_eq!(
                        back[line.clone()],
                        bytes[line],
                        "{shape:?} {first} {second}"
                    );
                }
                let columns = Form::new(F32, COLUMN_MAJOR, shape);
                let turned = convert(&gpu, [b, columns], shape, &between);
                for row in 0..shape[0] {
                    for column in 0..shape[1] {
                        let at = column * columns.stride + 4 * row;
                        let found: f32 = bytemuck::pod_read_unaligned(&turned[at..at + 4]);
                        assert_eq!(found, element(row, column) as f32);
                    }
                }
            }
        }
    }
}

/// Floats of 8 bits are the nearest to those of 32: the encodings' largest and least numbers, ties
/// and NaN.
#[test]
fn floats_of_eight_bits_are_rounded() {
    let Some(gpu) = gpu_with_vectors() else {
        return;
    };
    let numbers = [
        0.0f32,
        1.0,
        -1.0,
        1.0625,
        1.1875,
        448.0,
        57344.0,
        0.001_953_125,
        f32::NAN,
        -0.0,
    ];
    // Three and two bits of fraction; the least number of E4M3 is 2^-9, the largest 448, those
    // of E5M2 are 2^-16 and 57,344.
    let expected = [
        (
            E4M3,
            [
                0.0,
                1.0,
                -1.0,
                1.0,
                1.25,
                448.0,
                f32::NAN,
                0.001_953_125,
                f32::NAN,
                -0.0,
            ],
        ),
        (
            E5M2,
            [
                0.0,
                1.0,
                -1.0,
                1.0,
                1.25,
                448.0,
                57344.0,
                0.001_953_125,
                f32::NAN,
                -0.0,
            ],
        ),
    ];
    let shape = [1, numbers.len()];
    let rows = Form::new(F32, ROW_MAJOR, shape);
    for (component, expected) in expected {
        let optimal = Form::new(component, INFERENCING_OPTIMAL, shape);
        for convert in [converted, converted_on_device] {
            let narrow = convert(&gpu, [rows, optimal], shape, &bytes_of(&numbers));
            let wide = convert(&gpu, [optimal, rows], shape, &narrow);
            for (k, expected) in expected.into_iter().enumerate() {
                let found: f32 = bytemuck::pod_read_unaligned(&wide[4 * k..4 * k + 4]);
                let are_nan = found.is_nan() && expected.is_nan();
                assert!(
                    found == expected || are_nan,
                    "{} becomes {found}",
                    numbers[k]
                );
            }
        }
    }
}
