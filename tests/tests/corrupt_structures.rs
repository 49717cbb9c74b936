//! Structures that a shader overwrites through their addresses, or the host in their memory. Vulkan
//! leaves the effect open, so these tests look only at Tuff, which promises that rays through them
//! end and do no harm.

use ash::vk::AccelerationStructureTypeKHR as Level;
use tuff_tests::*;

/// Words of the part of a structure that says where the others are, and more.
const HEAD: usize = 64;

/// Triangles one behind the other, from z = 1 on.
fn stack(count: u32) -> Vec<[f32; 3]> {
    let triangle = |i: u32| {
        let z = 1.0 + i as f32 * 0.01;
        [[-9.0, -9.0, z], [9.0, -9.0, z], [0.0, 18.0, z]]
    };
    (0..count).flat_map(triangle).collect()
}

/// A scene, and how rays go through it.
struct World {
    gpu: Gpu,
    /// Of triangles and instances.
    counts: [u32; 2],
    /// The bottom level and the top level, and their words as they were built.
    levels: [Structure; 2],
    good: [Vec<u32>; 2],
    /// 16 ray queries of one compute workgroup, with all that they can tell: the structure is found
    /// by the address in a push constant.
    query: Kernel,
    queries: Set,
    /// Depths of the same rays by a ray tracing pipeline.
    rays: Rays,
    regions: [vk::StridedDeviceAddressRegionKHR; 4],
}

const QUERY: &str = r"
    #extension GL_EXT_ray_tracing_position_fetch : require
    #extension GL_EXT_buffer_reference_uvec2 : enable
    layout(local_size_x = 16) in;
    layout(push_constant) uniform P { uvec2 at; uint flags; };
    layout(set = 0, binding = 0) buffer R { float results[]; };
    void main() {
        uint i = gl_LocalInvocationIndex;
        rayQueryEXT q;
        vec3 origin = vec3(0.01 * float(i), 0.01, i < 12u ? 0.0 : 3.0);
        vec3 direction = i < 12u ? vec3(0, 0, 1) : vec3(0.1 * float(i - 12u), 0.2, -1);
        rayQueryInitializeEXT(q, accelerationStructureEXT(at), flags, 0xff, origin, 0.0, direction, 1e9);
        int patience = 100;
        while (rayQueryProceedEXT(q) && patience-- > 0) {
            rayQueryConfirmIntersectionEXT(q);
        }
        float t = -1.0;
        if (rayQueryGetIntersectionTypeEXT(q, true) != 0u) {
            t = rayQueryGetIntersectionTEXT(q, true);
            vec3 p[3];
            rayQueryGetIntersectionTriangleVertexPositionsEXT(q, true, p);
            t += 0.0 * (p[0].x + rayQueryGetIntersectionObjectToWorldEXT(q, true)[1][1]);
            t += 0.0 * float(rayQueryGetIntersectionInstanceCustomIndexEXT(q, true));
        }
        results[i] = t;
    }";

const RAYGEN: &str = r"
    layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
    layout(set = 0, binding = 1) buffer R { float results[]; };
    layout(location = 0) rayPayloadEXT float t;
    void main() {
        vec3 origin = vec3(0.01 * float(gl_LaunchIDEXT.x), 0.01, 0.0);
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, origin, 0.0, vec3(0, 0, 1), 1e9, 0);
        results[gl_LaunchIDEXT.x] = t;
    }";

const CLOSEST_HIT: &str = r"
    #extension GL_EXT_ray_tracing_position_fetch : require
    layout(location = 0) rayPayloadInEXT float t;
    void main() {
        t = gl_HitTEXT + 0.0 * (gl_HitTriangleVertexPositionsEXT[1].x + gl_ObjectToWorldEXT[0][0]);
    }";

impl World {
    fn new(triangles: u32, instances: u32) -> Option<World> {
        let gpu = Gpu::without_validation().with("a driver that promises this", |gpu| {
            gpu.is_tuff() && gpu.optional.ray_query.ray_query == vk::TRUE
        })?;
        let flags = vk::BuildAccelerationStructureFlagsKHR::ALLOW_UPDATE
            | vk::BuildAccelerationStructureFlagsKHR::ALLOW_DATA_ACCESS;
        let bottom = gpu.bottom_with(&[Geometry::opaque(&stack(triangles))], flags);
        let placed = |i: u32| Instance {
            transform: translated([0.0, 0.0, i as f32]),
            ..Instance::of(bottom)
        };
        let top = gpu.top(&(0..instances).map(placed).collect::<Vec<_>>());
        let results = gpu.buffer(4 * 64);
        let queries = gpu.set_of(&[results.into()]);
        let case = Case::new(RAYGEN)
            .miss("layout(location = 0) rayPayloadInEXT float t; void main() { t = -1.0; }")
            .hit(CLOSEST_HIT)
            .bind(top)
            .bind(results);
        let rays = gpu.rays(&case);
        let levels = [bottom, top];
        Some(World {
            counts: [triangles, instances],
            levels,
            good: levels.map(words),
            query: gpu.kernel(QUERY, &[queries.layout]),
            queries,
            regions: gpu.regions(&rays, &case.table()),
            rays,
            gpu,
        })
    }

    fn bottom(&self) -> Structure {
        self.levels[0]
    }

    fn top(&self) -> Structure {
        self.levels[1]
    }

    /// Rays through whatever is at an address, and through the top level. What they find does not
    /// matter; that they end does, or that the device is lost by its time limit, as one is by a
    /// shader that goes in circles.
    fn trace_at(&mut self, address: u64) {
        let (gpu, queries) = (&self.gpu, [self.queries]);
        let mut traced = Ok(());
        // With and without candidates to confirm.
        for flags in [0, 2] {
            let push = [address as u32, (address >> 32) as u32, flags];
            traced = traced.and_then(|()| {
                gpu.try_run(|commands| {
                    gpu.record_dispatch(commands, self.query, &queries, &push, [1, 1, 1]);
                })
            });
        }
        let traced = traced.and_then(|()| {
            gpu.try_run(|commands| {
                gpu.record_trace(commands, &self.rays, &self.regions, [40, 2, 1]);
            })
        });
        match traced {
            Ok(()) => {}
            Err(vk::Result::ERROR_DEVICE_LOST) => {
                let [triangles, instances] = self.counts;
                *self = World::new(triangles, instances).expect("there was one before");
            }
            Err(error) => panic!("{error}"),
        }
    }

    fn trace(&mut self) {
        self.trace_at(self.top().address);
    }

    /// Writes words into the memory of a structure.
    fn put(&self, level: usize, words: &[u32]) {
        let storage = self.levels[level].storage.expect("it is known");
        storage.write(0, words);
    }

    fn restore(&self, level: usize) {
        self.put(level, &self.good[level]);
    }

    /// After all that, rays find what they should.
    fn is_well(&self) {
        let world = self.gpu.scene(&[Geometry::opaque(&stack(3))]);
        assert_eq!(self.gpu.depths(world, 2), [1.0, 1.0]);
    }
}

/// The words of a structure's memory.
fn words(structure: Structure) -> Vec<u32> {
    structure.storage.expect("it is known").read()
}

/// Whether this process is to go on with a test: one in which nothing runs for long, as corrupt
/// structures lead in circles.
fn goes_on(test: &str) -> bool {
    alone(test, &[("TUFF_TIMEOUT", "0.5")])
}

/// The values that replace counts and offsets.
const WILD: [u64; 7] = [
    0,
    1,
    0x7fff_ffff,
    u64::MAX,
    1 << 45,
    1 << 46,
    0x4141_4141_0000_0100,
];

#[test]
fn headers_that_lie() {
    if !goes_on("headers_that_lie") {
        return;
    }
    let Some(mut world) = World::new(40, 3) else {
        return;
    };
    let mut changes = Vec::new();
    for place in 0..HEAD - 1 {
        changes.extend(WILD.map(|word| vec![(place, word)]));
    }
    // Sizes that make room for parts far away.
    for first in (0..HEAD).step_by(2) {
        changes.extend(
            (0..32)
                .step_by(2)
                .map(|i| vec![(first, 1 << 46), (i, 1 << 45)]),
        );
        changes.push(vec![(first, 1 << 46), (10, 0x0fff_ffff_7fff_ffff)]);
    }
    for level in [0, 1] {
        for changes in &changes {
            let mut bad = world.good[level][..HEAD].to_vec();
            for &(place, word) in changes {
                (bad[place], bad[place + 1]) = (word as u32, (word >> 32) as u32);
            }
            world.put(level, &bad);
            world.trace();
            world.restore(level);
        }
    }
    world.is_well();
}

#[test]
fn nodes_and_leaves_of_nonsense() {
    if !goes_on("nodes_and_leaves_of_nonsense") {
        return;
    }
    let Some(mut world) = World::new(300, 20) else {
        return;
    };
    let mut random = Rng::with_seed(7);
    for level in [0, 1] {
        for _ in 0..200 {
            let mut bad = world.good[level].clone();
            for _ in 0..1 + random.u32(..12) {
                let place = HEAD as u32 + random.u32(..(bad.len() - HEAD) as u32);
                bad[place as usize] = match random.u32(..4) {
                    0 => random.u32(..),
                    1 => random.u32(..64),
                    2 => 0x8000_0000 | random.u32(..1 << 12),
                    _ => bad[random.usize(..bad.len())],
                };
            }
            world.put(level, &bad);
            world.trace();
            world.restore(level);
        }
    }
    world.is_well();
}

#[test]
fn references_that_lead_elsewhere() {
    if !goes_on("references_that_lead_elsewhere") {
        return;
    }
    let Some(mut world) = World::new(40, 3) else {
        return;
    };
    for head in [0, 1] {
        for start in [0, (1 << 16) - 256, 1 << 15] {
            for which in 0..6 {
                // Where memory ends: a header there promises what there is not.
                let end = world.gpu.buffer(1 << 16);
                end.write(start, &world.good[head][..HEAD]);
                let wild = [
                    end.address + start as u64,
                    world.top().address,
                    world.bottom().address + 256,
                    0x4141_4141_4141_4100,
                    0x1000,
                    u64::MAX - 255,
                ][which];
                let address = world.bottom().address;
                let reference = [address as u32, (address >> 32) as u32];
                let mut bad = world.good[1].clone();
                let mut count = 0;
                for place in 0..bad.len() - 1 {
                    if bad[place..place + 2] == reference {
                        (bad[place], bad[place + 1]) = (wild as u32, (wild >> 32) as u32);
                        count += 1;
                    }
                }
                assert!(count > 0, "the top level names its bottom level");
                world.put(1, &bad);
                world.trace_at(end.address + start as u64);
                world.trace();
                world.restore(1);
            }
        }
    }
    world.is_well();
}

#[test]
fn a_header_that_a_shader_wrote() {
    let Some(world) = World::new(40, 3) else {
        return;
    };
    let gpu = &world.gpu;
    // As many words as a header has, found out by reading one; then with sizes and offsets of the
    // shader's own.
    let words = gpu.buffer_with(&world.good[1][..HEAD]);
    let forge = r"
        #extension GL_EXT_buffer_reference_uvec2 : enable
        layout(local_size_x = 1) in;
        layout(set = 0, binding = 0) buffer S { uint from[]; };
        layout(set = 0, binding = 1) buffer B { uint w[]; };
        layout(push_constant) uniform P { uvec2 at; uint changed; };
        void main() {
            for (int i = 0; i < 64; i++) w[i] = from[i];
            w[9] = 0x4000u;
            w[changed] = 0u;
            w[changed + 1] = 0x2000u;
            memoryBarrierBuffer();
            rayQueryEXT q;
            rayQueryInitializeEXT(q, accelerationStructureEXT(at), 0, 0xff, vec3(0.0, 0.01, 0.0), 0, vec3(0, 0, 1), 1e3);
            while (rayQueryProceedEXT(q)) {}
            w[70] = 1u + rayQueryGetIntersectionTypeEXT(q, true);
        }";
    let target = gpu.buffer(1 << 16);
    let set = gpu.set_of(&[words.into(), target.into()]);
    let kernel = gpu.kernel(forge, &[set.layout]);
    for changed in 0..32 {
        let push = [
            target.address as u32,
            (target.address >> 32) as u32,
            changed,
        ];
        gpu.dispatch(kernel, &[set], &push, [1, 1, 1]);
        assert_eq!(target.read::<u32>()[70], 1, "nothing is there to be hit");
    }
    world.is_well();
}

/// Serializes a structure; the bytes from the start of the head on.
fn serialized(gpu: &Gpu, structure: Structure, size_bytes: u64) -> Buffer {
    let buffer = gpu.buffer(size_bytes);
    let info = vk::CopyAccelerationStructureToMemoryInfoKHR::default()
        .src(structure.handle)
        .dst(vk::DeviceOrHostAddressKHR {
            device_address: buffer.address,
        })
        .mode(vk::CopyAccelerationStructureModeKHR::SERIALIZE);
    // SAFETY: the buffer is as large as its size, or the driver bears that it is not.
    gpu.run(|commands| unsafe {
        gpu.acceleration
            .cmd_copy_acceleration_structure_to_memory(commands, &info);
    });
    buffer
}

fn deserialized(gpu: &Gpu, from: &Buffer, size_bytes: u64, level: Level) -> Structure {
    let structure = gpu.empty_structure(level, size_bytes);
    let info = vk::CopyMemoryToAccelerationStructureInfoKHR::default()
        .src(from.at())
        .dst(structure.handle)
        .mode(vk::CopyAccelerationStructureModeKHR::DESERIALIZE);
    // SAFETY: the buffer is as large as its size, or the driver bears that it is not.
    gpu.run(|commands| unsafe {
        gpu.acceleration
            .cmd_copy_memory_to_acceleration_structure(commands, &info);
    });
    structure
}

#[test]
fn serialized_ones_with_wild_references() {
    let Some(world) = World::new(40, 3) else {
        return;
    };
    let gpu = &world.gpu;
    let written = serialized(gpu, world.top(), 2 * world.top().size_bytes);
    let good = written.read::<u64>();
    let (size_bytes, count) = (good[5], good[6] as usize);
    assert_eq!(count, 3, "references behind the head");
    let end = gpu.buffer(1 << 16);
    end.write((1 << 16) - 256, &world.good[0][..HEAD]);
    for wild in [
        end.address + (1 << 16) - 256,
        0x4141_4141_4141_4100,
        world.bottom().address + 1,
        1,
    ] {
        for which in 0..8u32 {
            let mut words = good.clone();
            for i in (0..count).filter(|i| which >> i & 1 != 0) {
                words[7 + i] = wild;
            }
            written.write(0, &words);
            let top = deserialized(gpu, &written, size_bytes, Level::TOP_LEVEL);
            // The nearest instance that is left.
            let expected = (0..count).find(|i| which >> i & 1 == 0);
            let expected = expected.map_or(-1.0, |i| 1.0 + i as f32);
            assert_eq!(gpu.depths(top, 1), [expected], "{wild:#x} {which:b}");
        }
    }
    world.is_well();
}

#[test]
fn serialized_ones_with_nonsense_inside() {
    if !goes_on("serialized_ones_with_nonsense_inside") {
        return;
    }
    let Some(mut world) = World::new(100, 20) else {
        return;
    };
    let mut random = Rng::with_seed(11);
    for (level, kind) in [(0, Level::BOTTOM_LEVEL), (1, Level::TOP_LEVEL)] {
        for _ in 0..150 {
            let structure = world.levels[level];
            let written = serialized(&world.gpu, structure, 2 * structure.size_bytes);
            let mut bad = written.read::<u32>();
            let size_bytes = written.read::<u64>()[5];
            for _ in 0..1 + random.u32(..3) {
                // Heads are where it matters most.
                let reach = [64, bad.len() as u32][random.usize(..2)];
                let place = (8 + random.u32(..reach - 8)) as usize;
                bad[place] = WILD[random.usize(..7)] as u32 ^ random.u32(..3);
            }
            written.write(0, &bad);
            let copy = deserialized(&world.gpu, &written, size_bytes, kind);
            let above = world.gpu.top(&[Instance::of(copy)]);
            world.trace_at(copy.address);
            world.trace_at(above.address);
        }
    }
    world.is_well();
}

#[test]
fn copies_and_properties_of_headers_that_lie() {
    if !goes_on("copies_and_properties_of_headers_that_lie") {
        return;
    }
    let Some(mut world) = World::new(40, 3) else {
        return;
    };
    for level in [0, 1] {
        for place in 0..40 {
            for word in WILD {
                let mut bad = world.good[level].clone();
                (bad[place], bad[place + 1]) = (word as u32, (word >> 32) as u32);
                world.put(level, &bad);
                let structure = world.levels[level];
                let target = world
                    .gpu
                    .empty_structure(Level::GENERIC, structure.size_bytes);
                copy_and_ask(&world.gpu, structure, target);
                serialized(&world.gpu, structure, 64);
                world.restore(level);
                world.trace_at(target.address);
            }
        }
    }
    world.is_well();
}

/// Copies a structure in both ways, and has properties of it and of the copy written.
fn copy_and_ask(gpu: &Gpu, source: Structure, target: Structure) {
    let ty = vk::QueryType::ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR;
    let pool = gpu.queries(ty, 2);
    let modes = [
        vk::CopyAccelerationStructureModeKHR::CLONE,
        vk::CopyAccelerationStructureModeKHR::COMPACT,
    ];
    // SAFETY: the source was built, and the target is as large.
    gpu.run(|commands| unsafe {
        for mode in modes {
            let info = vk::CopyAccelerationStructureInfoKHR::default()
                .src(source.handle)
                .dst(target.handle)
                .mode(mode);
            gpu.acceleration
                .cmd_copy_acceleration_structure(commands, &info);
        }
        gpu.device.cmd_reset_query_pool(commands, pool, 0, 2);
        gpu.acceleration
            .cmd_write_acceleration_structures_properties(
                commands,
                &[source.handle, target.handle],
                ty,
                pool,
                0,
            );
    });
}
