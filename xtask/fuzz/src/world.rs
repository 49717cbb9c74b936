//! A device and what cases use: buffers with margins, an image, a scene.

use std::sync::OnceLock;

use tuff_tests::*;

use crate::guard::{Guarded, MARGIN};

/// Bytes of the buffers that are bound.
pub const BYTES: u64 = 16384;

pub struct World {
    pub gpu: Gpu,
    /// A storage buffer at binding 0, a uniform buffer at binding 1.
    pub guarded: [Guarded; 2],
    pub set: Set,
    pub layout: vk::PipelineLayout,
    pub picture: Picture,
    pub sampler: vk::Sampler,
    /// The bottom level and the top level of a scene, and their words as they were built.
    pub levels: [Structure; 2],
    pub good: [Vec<u32>; 2],
    /// Ray queries, and the address of the structure in a push constant.
    query: Kernel,
    pub rays: Rays,
    pub regions: [vk::StridedDeviceAddressRegionKHR; 4],
}

/// The declarations that all shaders share.
pub const HEAD: &str = r"
    #extension GL_EXT_ray_query : require
    layout(set = 0, binding = 0, std430) buffer B { uint b[]; };
    layout(set = 0, binding = 1) uniform U { vec4 u[64]; };
    layout(set = 0, binding = 2) uniform sampler2D t;
    layout(set = 0, binding = 3, rgba8) uniform image2D p;
    layout(set = 0, binding = 4) uniform accelerationStructureEXT world;
";

const QUERY: &str = r"
    layout(local_size_x = 16) in;
    layout(push_constant) uniform P { uvec2 at; uint flags; };
    void main() {
        uint i = gl_LocalInvocationIndex;
        rayQueryEXT q;
        vec3 origin = vec3(0.01 * float(i), 0.01, i < 12u ? 0.0 : 3.0);
        vec3 direction = i < 12u ? vec3(0, 0, 1) : vec3(0.1 * float(i - 12u), 0.2, -1);
        rayQueryInitializeEXT(q, accelerationStructureEXT(at), flags, 0xff, origin, 0.0, direction, 1e9);
        int patience = 100;
        while (rayQueryProceedEXT(q) && patience-- > 0) {
            if ((patience & 1) != 0) rayQueryConfirmIntersectionEXT(q);
        }
        b[i] = rayQueryGetIntersectionTypeEXT(q, true);
        if (b[i] != 0u) {
            b[16 + i] = floatBitsToUint(rayQueryGetIntersectionTEXT(q, true));
            b[32 + i] = rayQueryGetIntersectionPrimitiveIndexEXT(q, true);
            b[48 + i] = floatBitsToUint(rayQueryGetIntersectionObjectToWorldEXT(q, true)[3][1]);
            b[64 + i] = uint(rayQueryGetIntersectionInstanceCustomIndexEXT(q, true));
        }
    }";

pub const RAYGEN: &str = r"
    layout(location = 0) rayPayloadEXT vec4 payload;
    void main() {
        vec3 direction = vec3(0.01 * float(gl_LaunchIDEXT.x), 0, 1);
        for (int k = 0; k < 3; k++) {
            payload = vec4(k);
            traceRayEXT(world, k == 1 ? 4u : 0u, 0xff, 0, 0, 0, vec3(0.01 * float(gl_LaunchIDEXT.x), 0.01, 0), 0.0, direction, 1e9, 0);
            if (payload.x > 2.0) break;
            direction = payload.yzw;
        }
        b[gl_LaunchIDEXT.x & 63u] = floatBitsToUint(payload.x);
    }";

pub const MISS: &str =
    "layout(location = 0) rayPayloadInEXT vec4 payload; void main() { payload.x = -1.0; }";

pub const HIT: &str = r"
    layout(location = 0) rayPayloadInEXT vec4 payload;
    hitAttributeEXT vec2 weights;
    void main() {
        payload = vec4(gl_HitTEXT, weights, gl_ObjectToWorldEXT[1][2]);
        b[64u + gl_LaunchIDEXT.x % 64u] = gl_PrimitiveID + gl_InstanceCustomIndexEXT;
    }";

pub const ANY_HIT: &str = r"
    layout(location = 0) rayPayloadInEXT vec4 payload;
    hitAttributeEXT vec2 weights;
    void main() { if (weights.x > 0.5) ignoreIntersectionEXT; payload.y += 1.0; }";

/// Shaders of the words of a source, compiled once.
pub fn compiled(stage: Stage, source: &str) -> Vec<u32> {
    glsl(stage, &format!("{HEAD}{source}"))
}

/// The words of the scene's shaders: ray generation, miss, closest hit, any hit.
pub fn shaders() -> &'static [(Stage, Vec<u32>); 4] {
    static SHADERS: OnceLock<[(Stage, Vec<u32>); 4]> = OnceLock::new();
    SHADERS.get_or_init(|| {
        [
            (Stage::RayGeneration, RAYGEN),
            (Stage::Miss, MISS),
            (Stage::ClosestHit, HIT),
            (Stage::AnyHit, ANY_HIT),
        ]
        .map(|(stage, source)| (stage, compiled(stage, source)))
    })
}

/// Which shaders are called together.
pub fn groups() -> [Group; 3] {
    let hit = Group {
        any_hit: Some(3),
        ..Group::hit(2)
    };
    [Group::general(0), Group::general(1), hit]
}

/// Triangles one behind the other.
pub fn stack(count: u32) -> Vec<[f32; 3]> {
    let triangle = |i: u32| {
        let z = 1.0 + i as f32 * 0.01;
        [[-9.0, -9.0, z], [9.0, -9.0, z], [0.0, 18.0, z]]
    };
    (0..count).flat_map(triangle).collect()
}

impl World {
    pub fn open() -> World {
        let gpu = Gpu::without_validation();
        let guarded = [Guarded::new(&gpu, BYTES), Guarded::new(&gpu, 1024)];
        let picture = gpu.picture(
            Shape::flat(vk::Format::R8G8B8A8_UNORM, 8, 8),
            vk::ImageUsageFlags::SAMPLED
                | vk::ImageUsageFlags::STORAGE
                | vk::ImageUsageFlags::TRANSFER_SRC
                | vk::ImageUsageFlags::TRANSFER_DST,
        );
        let sampler = gpu.sampler(&vk::SamplerCreateInfo::default());
        let flags = vk::BuildAccelerationStructureFlagsKHR::ALLOW_UPDATE
            | vk::BuildAccelerationStructureFlagsKHR::ALLOW_DATA_ACCESS;
        let geometries = [
            Geometry::opaque(&stack(60)),
            Geometry::triangles(&stack(40), vk::GeometryFlagsKHR::empty()),
        ];
        let bottom = gpu.bottom_with(&geometries, flags);
        let placed = |i: u16| Instance {
            transform: translated([0.0, 0.0, f32::from(i)]),
            ..Instance::of(bottom)
        };
        let top = gpu.top(&(0..8).map(placed).collect::<Vec<_>>());
        let levels = [bottom, top];
        let set = gpu.set_of(&[
            Bound::Storage(guarded[0].buffer),
            Bound::Uniform(guarded[1].buffer),
            Bound::Sampled(picture.view, sampler),
            Bound::StorageImage(picture.view),
            top.into(),
        ]);
        bind_middle(&gpu, set, &guarded);
        let query = compiled(Stage::Compute, QUERY);
        let layout = gpu.layout(&[set.layout]);
        let pipeline = gpu
            .try_kernel(&query, c"main", layout, &vk::SpecializationInfo::default())
            .expect("the queries' pipeline");
        let no_flags = vk::PipelineCreateFlags::empty();
        let rays = gpu.rays_of_words(shaders(), &groups(), 1, set, no_flags);
        World {
            regions: gpu.regions(&rays, &Table::of(0, &[1], &[2])),
            good: levels.map(words),
            query: Kernel { pipeline, layout },
            gpu,
            guarded,
            set,
            layout,
            picture,
            sampler,
            levels,
            rays,
        }
    }

    /// Runs commands; a device that is lost by them is an answer. True if it is not.
    pub fn run(&self, record: impl FnOnce(vk::CommandBuffer)) -> bool {
        let done = self.gpu.try_run(record);
        if done.is_err() {
            // The next case opens another.
            panic!("{done:?}");
        }
        true
    }

    /// Ray queries through the structure at an address.
    pub fn query(&self, address: u64, flags: u32) {
        let push = [address as u32, (address >> 32) as u32, flags];
        self.run(|commands| {
            (self.gpu).record_dispatch(commands, self.query, &[self.set], &push, [1, 1, 1]);
        });
    }

    /// Rays of the pipeline through the scene.
    pub fn trace(&self) {
        self.run(|commands| {
            (self.gpu).record_trace(commands, &self.rays, &self.regions, [40, 2, 1]);
        });
    }

    /// Checks the memory that a case must not change.
    pub fn check(&self) {
        self.guarded.iter().for_each(Guarded::check);
    }
}

/// The words in the memory of a structure.
pub fn words(structure: Structure) -> Vec<u32> {
    structure.storage.expect("it is known").read()
}

/// Points the first two bindings to the middles of their buffers.
fn bind_middle(gpu: &Gpu, set: Set, guarded: &[Guarded; 2]) {
    let kinds = [
        vk::DescriptorType::STORAGE_BUFFER,
        vk::DescriptorType::UNIFORM_BUFFER,
    ];
    for (binding, (kind, guarded)) in kinds.into_iter().zip(guarded).enumerate() {
        let info = [vk::DescriptorBufferInfo::default()
            .buffer(guarded.buffer.handle)
            .offset(MARGIN)
            .range(guarded.size_bytes)];
        let write = vk::WriteDescriptorSet::default()
            .dst_set(set.handle)
            .dst_binding(binding as u32)
            .descriptor_type(kind)
            .buffer_info(&info);
        // SAFETY: the set and the buffer are of this device, and nothing uses the set.
        unsafe { gpu.device.update_descriptor_sets(&[write], &[]) };
    }
}
