//! The Slang compiler's output for the ray tracing examples of slangpy. `cargo xtask slang` fetches
//! both, and builds and runs this program, which needs the feature `slang`. Expectations are by
//! geometry: barycentric weights, and a plane in a white furnace.

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::path::PathBuf;

use libloading::{Library, Symbol};
use tuff_tests::*;

const WHY: &str = "needs the Slang compiler and the examples: cargo xtask slang";

/// Width and height of the pictures.
const SIZE: u32 = 64;

/// Slang's compiler, by its functions for C.
struct Slang {
    library: Library,
    session: *mut c_void,
    examples: PathBuf,
}

impl Slang {
    fn new() -> Slang {
        let variable = |name: &str| PathBuf::from(std::env::var_os(name).expect(WHY));
        // SAFETY: a compiler's library, which the person who runs this chose.
        let library = unsafe { Library::new(variable("TUFF_SLANG")) }.expect("Slang's library");
        // SAFETY: the function's type is as in slang.h.
        let session = unsafe {
            let create: Symbol<unsafe extern "C" fn(*const c_char) -> *mut c_void> =
                library.get(b"spCreateSession").expect("spCreateSession");
            create(std::ptr::null())
        };
        Slang {
            library,
            session,
            examples: variable("TUFF_SLANG_EXAMPLES"),
        }
    }

    /// Compiles an entry point of an example, and of nothing else, to SPIR-V.
    fn compile(&self, file: &str, entry: &str, stage: &str) -> Vec<u32> {
        let file = self.examples.join(file);
        let file = file.to_str().expect("UTF-8");
        // The name of the output asks for code of the entry point by itself; no file is written.
        self.run(&[
            file,
            "-target",
            "spirv",
            "-entry",
            entry,
            "-stage",
            stage,
            "-o",
            "entry.spv",
        ])
    }

    /// The ray generation, miss and closest-hit shader of an example, by their names there.
    fn stages(&self, file: &str, names: [&str; 3]) -> [(Stage, Vec<u32>); 3] {
        let [ray_generation, miss, closest_hit] = names;
        [
            (Stage::RayGeneration, ray_generation, "raygeneration"),
            (Stage::Miss, miss, "miss"),
            (Stage::ClosestHit, closest_hit, "closesthit"),
        ]
        .map(|(stage, name, called)| (stage, self.compile(file, name, called)))
    }

    /// Compiles as the command line says; the first entry point's code.
    fn run(&self, arguments: &[&str]) -> Vec<u32> {
        type Arguments = unsafe extern "C" fn(*mut c_void, *const *const c_char, c_int) -> c_int;
        type Code = unsafe extern "C" fn(*mut c_void, c_int, *mut usize) -> *const c_void;
        let arguments: Vec<CString> = (arguments.iter())
            .map(|argument| CString::new(*argument).expect("no zero"))
            .collect();
        let pointers: Vec<*const c_char> = arguments.iter().map(|text| text.as_ptr()).collect();
        let get = "slang.h has it";
        // SAFETY: the functions' types are as in slang.h; strings outlive the calls.
        unsafe {
            let create: Symbol<unsafe extern "C" fn(*mut c_void) -> *mut c_void> =
                self.library.get(b"spCreateCompileRequest").expect(get);
            let process: Symbol<Arguments> =
                (self.library.get(b"spProcessCommandLineArguments")).expect(get);
            let compile: Symbol<unsafe extern "C" fn(*mut c_void) -> c_int> =
                self.library.get(b"spCompile").expect(get);
            let output: Symbol<unsafe extern "C" fn(*mut c_void) -> *const c_char> =
                self.library.get(b"spGetDiagnosticOutput").expect(get);
            let code: Symbol<Code> = self.library.get(b"spGetEntryPointCode").expect(get);
            let destroy: Symbol<unsafe extern "C" fn(*mut c_void)> =
                self.library.get(b"spDestroyCompileRequest").expect(get);
            let request = create(self.session);
            let mut result = process(request, pointers.as_ptr(), pointers.len() as c_int);
            if result >= 0 {
                result = compile(request);
            }
            let said = CStr::from_ptr(output(request)).to_string_lossy();
            assert!(result >= 0, "Slang: {said}");
            let mut size = 0;
            let code = code(request, 0, &mut size);
            assert!(!code.is_null(), "Slang: {said}");
            let words = std::slice::from_raw_parts(code.cast::<u32>(), size / 4).to_vec();
            destroy(request);
            words
        }
    }
}

/// Older layers do not know the number of the language that modules are said to come from.
fn gpu() -> Gpu {
    Gpu::validated_since(vk::make_api_version(0, 1, 3, 283))
}

/// A picture of four floats a pixel.
fn canvas(gpu: &Gpu) -> Picture {
    let shape = Shape::flat(vk::Format::R32G32B32A32_SFLOAT, SIZE, SIZE);
    gpu.picture(
        shape,
        vk::ImageUsageFlags::STORAGE | vk::ImageUsageFlags::TRANSFER_SRC,
    )
}

/// The examples' triangle, in the plane z = 0.
const TRIANGLE: [[f32; 3]; 3] = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];

/// Weights of the second and third vertex in the colours of what is inside, black elsewhere.
fn check_triangle(gpu: &Gpu, picture: &Picture) {
    let pixels: Vec<[f32; 4]> = gpu.download(picture, 0, 16).read();
    let mut inside = 0;
    for (index, pixel) in pixels.iter().enumerate() {
        let (x, y) = (index as u32 % SIZE, index as u32 / SIZE);
        let [x, y] = [x, y].map(|c| f64::from(c) / f64::from(SIZE) * 2.0 - 1.0);
        let third = (y + 1.0) / 2.0;
        let second = (x + 1.0 - third) / 2.0;
        let weights = [1.0 - second - third, second, third];
        let least = weights.into_iter().fold(1.0, f64::min);
        if least.abs() < 1e-6 {
            continue;
        }
        let expected = match least > 0.0 {
            true => [second, third, 0.0, 1.0],
            false => [0.0, 0.0, 0.0, 1.0],
        };
        inside += usize::from(least > 0.0);
        for (found, expected) in pixel.iter().zip(expected) {
            let error = (f64::from(*found) - expected).abs();
            assert!(error < 1e-5, "at {x}, {y}: {pixel:?}");
        }
    }
    assert!(inside > 1000);
}

#[test]
fn a_triangle_by_a_ray_query() {
    let words = Slang::new().compile("raytracing/raytracing.slang", "main", "compute");
    let gpu = gpu();
    let world = gpu.scene(&[Geometry::opaque(&TRIANGLE)]);
    let picture = canvas(&gpu);
    let set = gpu.set_of(&[world.into(), Bound::StorageImage(picture.view)]);
    let kernel = gpu.kernel_of(&words, &[set.layout]);
    gpu.dispatch::<u32>(kernel, &[set], &[], [SIZE / 16, SIZE / 16, 1]);
    check_triangle(&gpu, &picture);
}

#[test]
fn a_triangle_by_a_pipeline() {
    let slang = Slang::new();
    let file = "raytracing_pipeline/raytracing_pipeline.slang";
    let shaders = slang.stages(file, ["ray_gen", "miss", "closest_hit"]);
    let gpu = gpu();
    let world = gpu.scene(&[Geometry::opaque(&TRIANGLE)]);
    let picture = canvas(&gpu);
    let set = gpu.set_of(&[world.into(), Bound::StorageImage(picture.view)]);
    let flags = vk::PipelineCreateFlags::empty();
    let rays = gpu.rays_of_words(&shaders, &groups(), 1, set, flags);
    gpu.trace(&rays, &Table::of(0, &[1], &[2]), [SIZE, SIZE, 1]);
    check_triangle(&gpu, &picture);
}

fn groups() -> [Group; 3] {
    [Group::general(0), Group::general(1), Group::hit(2)]
}

/// The colour of the square that the path tracer sees.
const COLOUR: [f32; 3] = [0.75, 0.5, 0.25];

/// The path tracer's scene: a square in the plane z = 0, seen from z = 3 under a white sky.
fn square(gpu: &Gpu, world: Structure) -> Set {
    let camera: [[f32; 4]; 4] = [
        [0.0, 0.0, 3.0, 0.0],
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, -1.0, 0.0],
    ];
    let [red, green, blue] = COLOUR;
    let vertices: Vec<[f32; 12]> = CORNERS
        .iter()
        .map(|[x, y, z]| [*x, *y, *z, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        .collect();
    let mut identity = [0f32; 16];
    (0..4).for_each(|i| identity[5 * i] = 1.0);
    let storage = |words: &[u32]| Bound::Storage(gpu.buffer_with(words));
    let floats = |floats: &[f32]| storage(bytemuck::cast_slice(floats));
    gpu.set_of(&[
        Bound::Uniform(gpu.buffer_with(&camera)),
        world.into(),
        floats(&[red, green, blue, 0.0]),
        storage(&[4, 6, 0, 0]),
        storage(&[0, 0, 0]),
        floats(vertices.as_flattened()),
        storage(&INDICES),
        floats(&identity),
        floats(&identity),
    ])
}

const CORNERS: [[f32; 3]; 4] = [
    [-1.5, -1.5, 0.0],
    [1.5, -1.5, 0.0],
    [1.5, 1.5, 0.0],
    [-1.5, 1.5, 0.0],
];
const INDICES: [u32; 6] = [0, 1, 2, 0, 2, 3];

/// Paths that meet the square leave it for the white sky: its pixels have its colour whatever the
/// directions were.
fn check_square(gpu: &Gpu, picture: &Picture) {
    let pixels: Vec<[f32; 4]> = gpu.download(picture, 0, 16).read();
    let middle = f64::from(SIZE) / 2.0;
    for (index, pixel) in pixels.iter().enumerate() {
        let (x, y) = (index as u32 % SIZE, index as u32 / SIZE);
        // How far from the middle, in halves of the square's width on the screen.
        let away = [x, y].map(|c| (f64::from(c) + 0.5 - middle).abs() / (middle / 2.0));
        let most = away[0].max(away[1]);
        let expected = match most {
            ..0.95 => COLOUR,
            1.05.. => [1.0; 3],
            _ => continue,
        };
        for (found, expected) in pixel.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-4, "at {x}, {y}: {pixel:?}");
        }
    }
}

/// The path tracer by a ray query and by a pipeline that recurs.
#[test]
fn a_path_tracer_in_a_furnace() {
    let slang = Slang::new();
    let file = "pathtracer/pathtracer.slang";
    let compute = slang.compile(file, "compute_main", "compute");
    let shaders = slang.stages(file, ["rt_ray_gen", "rt_miss", "rt_closest_hit"]);
    let gpu = gpu();
    let corners: Vec<[f32; 3]> = INDICES.iter().map(|&i| CORNERS[i as usize]).collect();
    let world = gpu.scene(&[Geometry::opaque(&corners)]);
    let scene = square(&gpu, world);
    let frame = gpu.buffer_with(&[0u32; 4]);
    let set_for =
        |picture: &Picture| gpu.set_of(&[Bound::Uniform(frame), Bound::StorageImage(picture.view)]);

    let picture = canvas(&gpu);
    let set = set_for(&picture);
    let layout = gpu.layout(&[set.layout, scene.layout]);
    let constants = vk::SpecializationInfo::default();
    let made = gpu.try_kernel(&compute, c"main", layout, &constants);
    let pipeline = made.expect("vkCreateComputePipelines");
    let kernel = Kernel { pipeline, layout };
    gpu.dispatch::<u32>(kernel, &[set, scene], &[], [SIZE / 16, SIZE / 16, 1]);
    check_square(&gpu, &picture);

    let picture = canvas(&gpu);
    let set = set_for(&picture);
    let made = gpu.try_rays(&shaders, &groups(), 6, layout);
    let pipeline = made.expect("vkCreateRayTracingPipelinesKHR");
    let rays = gpu.rays_of(pipeline, layout, set, 3);
    let regions = gpu.regions(&rays, &Table::of(0, &[1], &[2]));
    gpu.run(|commands| {
        let point = vk::PipelineBindPoint::RAY_TRACING_KHR;
        // SAFETY: the command buffer is being recorded, and the set is of this device.
        unsafe {
            (gpu.device).cmd_bind_descriptor_sets(commands, point, layout, 1, &[scene.handle], &[]);
        }
        gpu.record_trace(commands, &rays, &regions, [SIZE, SIZE, 1]);
    });
    check_square(&gpu, &picture);
}
