//! Descriptor heaps into which somebody has written, with mappings and pushed data that lead
//! anywhere.

use fastrand::Rng;
use tuff_tests::heaps::{
    HEAP_WITH_CONSTANT_OFFSET, HEAP_WITH_PUSH_INDEX, Heaps, PUSH_ADDRESS, PUSH_DATA, mapping,
    range_of,
};
use tuff_tests::newer as vk;
use tuff_tests::{Buffer, Stage};
use vk::DescriptorType as Ty;

use crate::case::{Case, wild};
use crate::world::{World, compiled};

const SOURCE: &str = r"
    layout(set = 0, binding = 5, std430) readonly buffer M { uint m[]; } many[4];
    layout(set = 0, binding = 6) uniform D { uvec4 d; };
    layout(local_size_x = 16) in;
    void main() {
        uint i = gl_LocalInvocationIndex;
        b[i] = b[i + 1u] + floatBitsToUint(u[i].x) + many[i & 3u].m[i] + d.x;
        vec4 c = texelFetch(t, ivec2(i & 7u), 0) + textureLod(t, vec2(i) * 0.1, 0.0);
        imageStore(p, ivec2(i, 1), c + imageLoad(p, ivec2(i)));
        rayQueryEXT q;
        rayQueryInitializeEXT(q, world, 0u, 0xff, vec3(0.01 * i, 0.01, 0), 0.0, vec3(0, 0, 1), 50.0);
        while (rayQueryProceedEXT(q)) {}
        b[64 + i] = rayQueryGetIntersectionTypeEXT(q, true);
    }";

/// Bindings, which have the places of their numbers; the array has the next ones, too.
const BINDINGS: u32 = 7;
const PLACES: u64 = 16;

/// Words that are pushed.
const WORDS: usize = 16;

/// A mapping of another source than the place itself, which sound data leads to the same place.
fn other(heaps: &Heaps<'_>, binding: u32, source: i32) -> vk::DescriptorSetAndBindingMappingEXT {
    let stride = heaps.stride as u32;
    let data = match source {
        HEAP_WITH_PUSH_INDEX => vk::DescriptorMappingSourceDataEXT {
            push_index: vk::PushIndex {
                heap_offset: heaps.at(0),
                push_offset: 4 * binding,
                heap_index_stride: stride,
                heap_array_stride: stride,
                p_embedded_sampler: std::ptr::null(),
                use_combined_image_sampler_index: 0,
                sampler_heap_offset: heaps.at(0),
                sampler_push_offset: 4 * binding,
                sampler_heap_index_stride: stride,
                sampler_heap_array_stride: stride,
            },
        },
        _ => vk::DescriptorMappingSourceDataEXT { words: [32, 0] },
    };
    mapping(binding, source, data)
}

/// Changes a number of a mapping.
fn spoil(it: &mut vk::DescriptorSetAndBindingMappingEXT, rng: &mut Rng) {
    let number = match rng.bool() {
        true => wild(rng) as u32,
        false => rng.u32(0..1024) & !3,
    };
    let which = rng.u32(0..4);
    match it.source {
        HEAP_WITH_PUSH_INDEX => {
            // SAFETY: the source says so; the member was written whole.
            let index = unsafe { &mut it.source_data.push_index };
            match which {
                0 => index.heap_offset = number,
                1 => index.push_offset = number % 256,
                2 => index.heap_index_stride = number,
                _ => index.use_combined_image_sampler_index = number & 1,
            }
        }
        HEAP_WITH_CONSTANT_OFFSET => {
            // SAFETY: the source says so; the member was written whole.
            let constant = unsafe { &mut it.source_data.constant_offset };
            match which {
                0 => constant.heap_offset = number,
                1 => constant.heap_array_stride = number,
                2 => constant.sampler_heap_offset = number,
                _ => constant.sampler_heap_array_stride = number,
            }
        }
        // SAFETY: the source says so; the member was written whole.
        _ => unsafe { it.source_data.words[0] = number % 256 },
    }
}

/// Changes bytes of a heap.
fn scribble(world: &World, heap: &Buffer, rng: &mut Rng) {
    let mut bytes = heap.read::<u8>();
    let at = rng.usize(0..bytes.len());
    match rng.u32(0..4) {
        0 => bytes[at] = rng.u8(..),
        1 => bytes[at] ^= 1 << rng.u32(0..8),
        _ => {
            let at = at & !7;
            let word = match rng.bool() {
                true => wild(rng),
                false => world.guarded[0].buffer.address + rng.u64(0..65536),
            };
            let length = (bytes.len() - at).min(8);
            bytes[at..at + length].copy_from_slice(&word.to_le_bytes()[..length]);
        }
    }
    heap.write(0, &bytes);
}

pub fn run(world: &World, case: &Case) {
    let gpu = &world.gpu;
    if gpu.optional.heaps.descriptor_heap == vk::FALSE {
        return;
    }
    let heaps = Heaps::new(gpu, PLACES);
    let ranges = [0, 1].map(|index| vk::DeviceAddressRangeKHR {
        address: world.guarded[index].address(),
        size: world.guarded[index].size_bytes,
    });
    let put = |place, ty, range| {
        let bytes = heaps.resource(ty, range);
        heaps.resources.write(heaps.at(place) as usize, &bytes);
    };
    put(0, Ty::STORAGE_BUFFER, &ranges[0]);
    put(1, Ty::UNIFORM_BUFFER, &ranges[1]);
    heaps.put_picture(2, Ty::SAMPLED_IMAGE, &world.picture);
    heaps.put_sampler(2, &vk::SamplerCreateInfo::default());
    heaps.put_picture(3, Ty::STORAGE_IMAGE, &world.picture);
    heaps.put_structure(4, &world.levels[1]);
    for place in 5..9 {
        put(place, Ty::STORAGE_BUFFER, &ranges[0]);
    }
    put(6, Ty::UNIFORM_BUFFER, &ranges[1]);
    let mut rng = case.common();
    let mut mappings: Vec<_> = (0..BINDINGS)
        .map(|binding| {
            let source = match (binding, rng.u32(0..4)) {
                (_, 0) => HEAP_WITH_PUSH_INDEX,
                (0 | 1, 1) => PUSH_ADDRESS,
                (6, 1) => PUSH_DATA,
                _ => return heaps.constant(binding, binding.into()),
            };
            other(&heaps, binding, source)
        })
        .collect();
    let mut push: [u32; WORDS] = std::array::from_fn(|k| k as u32);
    let address = world.guarded[0].address();
    [push[8], push[9]] = [address as u32, (address >> 32) as u32];
    // The nonsense.
    for mut rng in case.steps() {
        match rng.u32(0..6) {
            0 => push[rng.usize(0..WORDS)] = wild(&mut rng) as u32,
            1 => {
                let index = rng.usize(0..mappings.len());
                spoil(&mut mappings[index], &mut rng);
            }
            2 => scribble(world, &heaps.samplers, &mut rng),
            _ => scribble(world, &heaps.resources, &mut rng),
        }
    }
    let words = compiled(Stage::Compute, SOURCE);
    let kernel = heaps.kernel_of(&words, &mappings);
    let bound = [&heaps.resources, &heaps.samplers].map(|heap| {
        let mut range = range_of(heap);
        match rng.u32(0..16) {
            0 => range.address = wild(&mut rng),
            1 => range.size = wild(&mut rng),
            _ => {}
        }
        range
    });
    world.run(|commands| {
        heaps.bind_ranges(commands, bound);
        heaps.push(commands, &push);
        heaps.dispatch(commands, kernel);
    });
    // SAFETY: nothing uses it any more.
    unsafe { gpu.device.destroy_pipeline(kernel, None) };
    // A descriptor may have pointed to the written memory.
    world.guarded.iter().for_each(crate::guard::Guarded::renew);
}
