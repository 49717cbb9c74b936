//! `VK_KHR_shader_constant_data`: arrays of constants whose elements are data of one instruction.

use bytemuck::Pod;
use tuff_tests::spirv::{instructions, literal, put};
use tuff_tests::*;

const CAPABILITY: u32 = 17;
const EXTENSION: u32 = 10;
const TYPE_VOID: u32 = 19;
const TYPE_INT: u32 = 21;
const TYPE_ARRAY: u32 = 28;
const CONSTANT: u32 = 43;
const CONSTANT_COMPOSITE: u32 = 44;
const SPEC_CONSTANT: u32 = 50;
const DECORATE: u32 = 71;
const SPEC_ID: u32 = 1;
const UTF_ENCODED: u32 = 5145;
const CONSTANT_DATA_CAPABILITY: u32 = 5146;
const CONSTANT_DATA: u32 = 5147;
const SPEC_CONSTANT_DATA: u32 = 5148;

/// `SpecId` of an array's length and of its data.
const LENGTH_ID: u32 = 1;
const DATA_ID: u32 = 2;

/// Data in the place of each constant array of integers, specialized or not. What is left of a last
/// word is set, which changes nothing.
fn with_data(words: &[u32], specialized: bool) -> Vec<u32> {
    let all = instructions(words);
    let find = |opcode, place: usize, id: u32| {
        let mut found = all.iter().filter(|it| it.0 == opcode);
        found.find(|it| it.1[place] == id).map(|it| it.1)
    };
    let number = |id: u32| {
        let found = find(CONSTANT, 1, id)?;
        Some(bytemuck::pod_collect_to_vec::<u32, u8>(&found[2..]))
    };
    // Type and result, length, data and bytes of an element.
    let array = |opcode: u32, it: &[u32]| {
        if opcode != CONSTANT_COMPOSITE {
            return None;
        }
        let ty = find(TYPE_ARRAY, 0, it[0])?;
        let width = find(TYPE_INT, 0, ty[1])?[1] as usize / 8;
        let mut data = Vec::new();
        for &element in &it[2..] {
            data.extend(&number(element)?[..width]);
        }
        data.resize(data.len().next_multiple_of(4), 0xff);
        let data: Vec<u32> = bytemuck::pod_collect_to_vec(&data);
        Some(([it[0], it[1]], ty[2], data, width))
    };
    let arrays: Vec<_> = all.iter().filter_map(|it| array(it.0, it.1)).collect();
    assert!(!arrays.is_empty());
    let is_length = |id: u32| arrays.iter().any(|it| it.1 == id);

    let mut out = words[..5].to_vec();
    let (mut declared, mut annotated) = (false, false);
    for &(opcode, operands) in &all {
        if !declared && opcode != CAPABILITY {
            put(&mut out, CAPABILITY, &[CONSTANT_DATA_CAPABILITY]);
            put(&mut out, EXTENSION, &literal("SPV_KHR_constant_data"));
            declared = true;
        }
        if !annotated && opcode == TYPE_VOID {
            for ([ty, result], length, _, width) in &arrays {
                if *width == 1 {
                    put(&mut out, DECORATE, &[*ty, UTF_ENCODED]);
                }
                if specialized {
                    put(&mut out, DECORATE, &[*length, SPEC_ID, LENGTH_ID]);
                    put(&mut out, DECORATE, &[*result, SPEC_ID, DATA_ID]);
                }
            }
            annotated = true;
        }
        let (opcode, operands) = match array(opcode, operands) {
            Some((head, _, data, _)) if specialized => {
                (SPEC_CONSTANT_DATA, [&head[..], &data].concat())
            }
            Some((head, _, data, _)) => (CONSTANT_DATA, [&head[..], &data].concat()),
            None if specialized && opcode == CONSTANT && is_length(operands[1]) => {
                (SPEC_CONSTANT, operands.to_vec())
            }
            None => (opcode, operands.to_vec()),
        };
        put(&mut out, opcode, &operands);
    }
    out
}

/// A device with the extension, and with integers and buffers of all widths.
fn open() -> Option<Gpu> {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 4, 347));
    let gpu = gpu.with("VK_KHR_shader_constant_data", |gpu| {
        gpu.optional.constant_data.shader_constant_data != 0
    })?;
    gpu.with("integers of every width", |gpu| {
        let (narrow, wide) = (&gpu.features12, &gpu.features);
        narrow.shader_int8 & wide.shader_int16 & wide.shader_int64 != 0
    })
}

/// A shader that reads a constant array, with each invocation another element.
fn source(ty: &str, elements: &[u64]) -> String {
    let count = elements.len();
    let list: Vec<String> = elements.iter().map(|it| format!("{ty}({it}ul)")).collect();
    format!(
        "layout(local_size_x = 32) in;
        layout(set = 0, binding = 0, scalar) buffer O {{ uint64_t o[]; }};
        const {ty} table[{count}] = {ty}[]({});
        void main() {{
            uint i = gl_GlobalInvocationID.x;
            o[i] = uint64_t(table[i % {count}u]);
        }}",
        list.join(", ")
    )
}

/// The array's elements, over and over.
fn read(gpu: &Gpu, words: &[u32], constants: &vk::SpecializationInfo<'_>) -> Vec<u64> {
    let output = gpu.buffer(32 * 8);
    let set = gpu.set_of(&[output.into()]);
    let layout = gpu.layout(&[set.layout]);
    let pipeline = gpu.try_kernel(words, c"main", layout, constants);
    let pipeline = pipeline.expect("vkCreateComputePipelines");
    gpu.dispatch::<u32>(Kernel { pipeline, layout }, &[set], &[], [1, 1, 1]);
    output.read()
}

fn over_and_over(elements: &[u64]) -> Vec<u64> {
    elements.iter().copied().cycle().take(32).collect()
}

/// As many elements as leave room in a last word.
const ELEMENTS: [u64; 7] = [
    0x8182_8384_8586_8788,
    0x0001_0203_0405_0600,
    0xffff_ffff_ffff_ffff,
    0x4142_4344_4546_4748,
    0x7fff_ffff_ffff_fffe,
    0x0000_0000_8000_8081,
    0x1122_3344_5566_7701,
];

#[test]
fn arrays_may_be_data() {
    let Some(gpu) = open() else { return };
    for (ty, bits) in [
        ("uint8_t", 8),
        ("uint16_t", 16),
        ("uint", 32),
        ("uint64_t", 64),
    ] {
        let elements = ELEMENTS.map(|it| it & u64::MAX >> (64 - bits));
        let words = with_data(&glsl(Stage::Compute, &source(ty, &elements)), false);
        let got = read(&gpu, &words, &vk::SpecializationInfo::default());
        assert_eq!(got, over_and_over(&elements), "{ty}");
    }
}

/// Specialized data, and with the array's length another amount of them.
fn specialize<T: Pod + Into<u64>>(ty: &str, made: &[u64], given: &[T]) {
    let Some(gpu) = open() else { return };
    let words = with_data(&glsl(Stage::Compute, &source(ty, made)), true);
    let same = read(&gpu, &words, &vk::SpecializationInfo::default());
    assert_eq!(same, over_and_over(made), "{ty}");
    let mut bytes = (given.len() as u32).to_ne_bytes().to_vec();
    bytes.extend(bytemuck::cast_slice::<T, u8>(given));
    let entry = |id, offset: usize, size| vk::SpecializationMapEntry {
        constant_id: id,
        offset: offset as u32,
        size,
    };
    let entries = [entry(LENGTH_ID, 0, 4), entry(DATA_ID, 4, bytes.len() - 4)];
    let constants = vk::SpecializationInfo::default()
        .map_entries(&entries)
        .data(&bytes);
    let given: Vec<u64> = given.iter().map(|&it| it.into()).collect();
    let got = read(&gpu, &words, &constants);
    assert_eq!(got, over_and_over(&given), "{ty}");
}

#[test]
fn data_may_be_specialized() {
    specialize(
        "uint8_t",
        &[72, 101, 108],
        &b"other text, longer than before"[..],
    );
    specialize("uint16_t", &[9, 8, 65535, 6, 10], &[1_u16, 0xfffe, 3]);
    specialize("uint", &[7, 70, 700], &[0xdead_beef_u32, 1, 9, 17]);
    specialize("uint64_t", &[1 << 40, 5, 1 << 63], &[u64::MAX, 1 << 33]);
}

/// Data of a fragment shader, whose index differs from pixel to pixel.
#[test]
fn fragments_read_data() {
    let Some(gpu) = open() else { return };
    let Some(gpu) = gpu.with("a graphics queue", Gpu::has_graphics) else {
        return;
    };
    let fragment = r"
    layout(location = 0) out vec4 color;
    const uint table[5] = uint[](0, 51, 255, 102, 204);
    void main() {
        color = vec4(vec3(float(table[uint(gl_FragCoord.x) % 5u]) / 255.0), 1.0);
    }";
    let canvas = gpu.canvas(RGBA, 16, 16);
    let painting = Painting::new(&gpu, COVER, WHITE, RGBA);
    let stages = [
        (Stage::Vertex, glsl(Stage::Vertex, COVER)),
        (
            Stage::Fragment,
            with_data(&glsl(Stage::Fragment, fragment), false),
        ),
    ];
    let flags = vk::PipelineCreateFlags::empty();
    let pipeline = gpu
        .try_painting(&painting, &stages, flags, std::ptr::null())
        .expect("vkCreateGraphicsPipelines");
    gpu.run(|commands| {
        gpu.record_pass(commands, &Pass::black(&canvas), |commands| {
            gpu.look_at(commands, &canvas);
            gpu.bind(commands, pipeline);
            gpu.draw_vertices(commands, 3);
        });
    });
    for (at, color) in gpu.colors(&canvas).into_iter().enumerate() {
        let level = [0, 51, 255, 102, 204][at % 16 % 5];
        assert_eq!(color, [level, level, level, 255], "{at}");
    }
}
