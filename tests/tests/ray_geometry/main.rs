//! Hits of rays on triangles, boxes and instances, against computations on the host.

mod instances;
mod reference;

use glam::{DVec3, Vec3};
use reference::{check_against_brute_force, intersect, random_rays, random_triangles};
use tuff_tests::*;

/// Rays of 8 floats (origin, t_min, direction, t_max) in; hits of 8 words out.
const RAYGEN: &str = r#"
layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
struct Ray { vec3 origin; float t_min; vec3 direction; float t_max; };
struct Hit { uint primitive; float t; vec2 weights; uint instance; uint geometry; uint kind; uint custom; };
layout(set = 0, binding = 1, std430) buffer Rays { Ray rays[]; };
layout(set = 0, binding = 2, std430) buffer Hits { Hit hits[]; };
layout(location = 0) rayPayloadEXT Hit hit;
layout(push_constant) uniform Push { uint flags; uint mask; };
void main() {
    uint i = gl_LaunchIDEXT.x;
    Ray ray = rays[i];
    hit.primitive = 0xdeadbeef;
    traceRayEXT(world, flags, mask, 0, 0, 0, ray.origin, ray.t_min, ray.direction, ray.t_max, 0);
    hits[i] = hit;
}
"#;

const HIT: &str = r#"
struct Hit { uint primitive; float t; vec2 weights; uint instance; uint geometry; uint kind; uint custom; };
layout(location = 0) rayPayloadInEXT Hit hit;
hitAttributeEXT vec2 weights;
void main() {
    hit = Hit(gl_PrimitiveID, gl_HitTEXT, weights, gl_InstanceID, gl_GeometryIndexEXT, gl_HitKindEXT,
        gl_InstanceCustomIndexEXT);
}
"#;

const MISS: &str = r#"
struct Hit { uint primitive; float t; vec2 weights; uint instance; uint geometry; uint kind; uint custom; };
layout(location = 0) rayPayloadInEXT Hit hit;
void main() { hit = Hit(0xffffffff, -1.0, vec2(0), 0, 0, 0, 0); }
"#;

/// A sphere of radius 0.5 around the middle of the primitive's box, boxes being unit cubes whose
/// corners are in a buffer.
const SPHERE: &str = r#"
layout(set = 0, binding = 3, std430) buffer Boxes { float boxes[]; };
hitAttributeEXT vec2 weights;
void main() {
    uint b = 6 * gl_PrimitiveID;
    vec3 centre = vec3(boxes[b], boxes[b + 1], boxes[b + 2]) + 0.5;
    vec3 f = gl_ObjectRayOriginEXT - centre;
    vec3 d = gl_ObjectRayDirectionEXT;
    float a = dot(d, d);
    float h = dot(f, d);
    float discriminant = h * h - a * (dot(f, f) - 0.25);
    if (discriminant >= 0.0) {
        weights = vec2(gl_PrimitiveID, 0.25);
        float root = sqrt(discriminant);
        if (!reportIntersectionEXT((-h - root) / a, 7u)) {
            reportIntersectionEXT((-h + root) / a, 9u);
        }
    }
}
"#;

#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Ray {
    origin: [f32; 3],
    t_min: f32,
    direction: [f32; 3],
    t_max: f32,
}

impl Ray {
    fn new(origin: [f32; 3], direction: [f32; 3]) -> Ray {
        Ray {
            origin,
            t_min: 0.0,
            direction,
            t_max: 1e30,
        }
    }

    /// Origin and direction in double precision.
    fn wide(&self) -> (DVec3, DVec3) {
        let [origin, direction] = [self.origin, self.direction].map(|v| Vec3::from(v).as_dvec3());
        (origin, direction)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Hit {
    primitive: u32,
    t: f32,
    weights: [f32; 2],
    instance: u32,
    geometry: u32,
    kind: u32,
    custom: u32,
}

const MISSED: u32 = u32::MAX;
const FRONT: u32 = 0xfe;
const BACK: u32 = 0xff;

fn shoot(gpu: &Gpu, world: Structure, rays: &[Ray], boxes: &[[f32; 6]]) -> Vec<Hit> {
    shoot_with(gpu, world, rays, boxes, 0, 0xff)
}

fn shoot_with(
    gpu: &Gpu,
    world: Structure,
    rays: &[Ray],
    boxes: &[[f32; 6]],
    flags: u32,
    mask: u32,
) -> Vec<Hit> {
    let input = gpu.buffer_with(rays);
    let output = gpu.buffer(32 * rays.len() as u64);
    let corners = gpu.buffer_with(if boxes.is_empty() { &[[0.0; 6]] } else { boxes });
    let mut case = Case::new(RAYGEN).miss(MISS).hit(HIT);
    if !boxes.is_empty() {
        case = case.intersection(SPHERE);
    }
    let case = case.bind(world).bind(input).bind(output).bind(corners);
    let pipeline = gpu.rays(&case);
    let regions = gpu.regions(&pipeline, &case.table());
    gpu.run(|commands| {
        gpu.push(commands, pipeline.layout, &[flags, mask]);
        gpu.record_trace(commands, &pipeline, &regions, [rays.len() as u32, 1, 1]);
    });
    output.read()
}

#[test]
fn a_grid_of_triangles() {
    let gpu = Gpu::new();
    let mut triangles = Vec::new();
    for y in 0..16 {
        for x in 0..16 {
            let at = |dx: i32, dy: i32| [(x + dx) as f32, (y + dy) as f32, 5.0];
            triangles.push([at(0, 0), at(1, 0), at(0, 1)]);
            triangles.push([at(1, 0), at(1, 1), at(0, 1)]);
        }
    }
    let world = gpu.scene(&[Geometry::opaque(triangles.as_flattened())]);
    let rays: Vec<Ray> = (0..64 * 64)
        .map(|i| {
            let (x, y) = ((i % 64) as f32 * 0.27 - 0.6, (i / 64) as f32 * 0.27 - 0.63);
            Ray::new([x, y, 0.0], [0.0, 0.0, 1.0])
        })
        .collect();
    let hits = shoot(&gpu, world, &rays, &[]);
    check_against_brute_force(&hits, &rays, &triangles);
    assert!(hits.iter().any(|hit| hit.primitive == MISSED));
}

#[test]
fn random_triangles_and_rays() {
    let gpu = Gpu::new();
    let mut random = Rng::with_seed(1);
    for (count, size) in [(1, 6.0), (3, 6.0), (40, 4.0), (3000, 0.8)] {
        let triangles = random_triangles(&mut random, count, size);
        let rays = random_rays(&mut random, 3000);
        let world = gpu.scene(&[Geometry::opaque(triangles.as_flattened())]);
        check_against_brute_force(&shoot(&gpu, world, &rays, &[]), &rays, &triangles);
    }
}

#[test]
fn build_flags_change_no_result() {
    let gpu = Gpu::new();
    let mut random = Rng::with_seed(2);
    let triangles = random_triangles(&mut random, 500, 1.5);
    let rays = random_rays(&mut random, 1000);
    use vk::BuildAccelerationStructureFlagsKHR as Flags;
    for flags in [
        Flags::PREFER_FAST_TRACE,
        Flags::PREFER_FAST_BUILD,
        Flags::LOW_MEMORY,
        Flags::ALLOW_UPDATE | Flags::ALLOW_COMPACTION,
    ] {
        let geometry = Geometry::opaque(triangles.as_flattened());
        let bottom = gpu.bottom_with(&[geometry], flags);
        let world = gpu.top(&[Instance::of(bottom)]);
        check_against_brute_force(&shoot(&gpu, world, &rays, &[]), &rays, &triangles);
    }
}

#[test]
fn indexed_triangles() {
    let gpu = Gpu::new();
    let mut random = Rng::with_seed(3);
    let corners: Vec<[f32; 3]> = (0..300)
        .map(|_| std::array::from_fn(|_| between(&mut random, -10.0, 10.0)))
        .collect();
    let indices: Vec<u32> = (0..3 * 60).map(|_| random.u32(..300)).collect();
    let triangles: Vec<[[f32; 3]; 3]> = indices
        .chunks(3)
        .map(|t| [0, 1, 2].map(|corner| corners[t[corner] as usize]))
        .collect();
    let flags = vk::GeometryFlagsKHR::OPAQUE;
    let world = gpu.scene(&[Geometry::Triangles {
        corners,
        indices,
        flags,
    }]);
    let rays = random_rays(&mut random, 2000);
    check_against_brute_force(&shoot(&gpu, world, &rays, &[]), &rays, &triangles);
}

#[test]
fn several_geometries_are_told_apart() {
    let gpu = Gpu::new();
    let geometries: Vec<Geometry> = (0..5)
        .map(|i| {
            let x = i as f32 * 3.0;
            Geometry::opaque(&[
                [x, 0.0, 1.0],
                [x + 1.0, 0.0, 1.0],
                [x, 1.0, 1.0],
                [x, 0.0, 2.0],
                [x + 2.0, 0.0, 2.0],
                [x, 2.0, 2.0],
            ])
        })
        .collect();
    let world = gpu.scene(&geometries);
    let rays: Vec<Ray> = (0..10)
        .map(|i| {
            let x = (i / 2) as f32 * 3.0 + if i % 2 == 0 { 0.2 } else { 1.3 };
            Ray::new([x, 0.2, 0.0], [0.0, 0.0, 1.0])
        })
        .collect();
    for (i, hit) in shoot(&gpu, world, &rays, &[]).iter().enumerate() {
        assert_eq!(hit.geometry, i as u32 / 2, "ray {i}");
        assert_eq!(hit.primitive, i as u32 % 2, "ray {i}");
    }
}

#[test]
fn the_range_of_a_ray_bounds_its_hits() {
    let gpu = Gpu::new();
    let layers: Vec<[[f32; 3]; 3]> = (1..=8)
        .map(|z| {
            let z = z as f32;
            [[-50.0, -50.0, z], [50.0, -50.0, z], [0.0, 50.0, z]]
        })
        .collect();
    let world = gpu.scene(&[Geometry::opaque(layers.as_flattened())]);
    let mut rays = Vec::new();
    let mut expected = Vec::new();
    for length in [1.0, 2.0, 0.25] {
        for (t_min, t_max, layer) in [
            (0.0, 100.0, 0),
            (1.5, 100.0, 1),
            (3.5, 100.0, 3),
            (7.5, 7.75, MISSED),
            (7.5, 8.5, 7),
            (8.5, 100.0, MISSED),
            (0.0, 0.5, MISSED),
            (0.0, 1.5, 0),
        ] {
            rays.push(Ray {
                origin: [0.1, 0.2, 0.0],
                t_min: t_min / length,
                direction: [0.0, 0.0, length],
                t_max: t_max / length,
            });
            expected.push((layer, (layer as f32 + 1.0) / length));
        }
    }
    for ((hit, ray), (layer, t)) in shoot(&gpu, world, &rays, &[])
        .iter()
        .zip(&rays)
        .zip(expected)
    {
        assert_eq!(hit.primitive, layer, "{ray:?}");
        if layer != MISSED {
            assert!((hit.t - t).abs() < 1e-5, "{ray:?}: {} is not {t}", hit.t);
        }
    }
}

/// No pipeline here has an any-hit shader, so what is not opaque is hit like all else; but flags
/// tell them apart.
#[test]
fn opacity_is_heeded_without_any_hit_shaders() {
    let gpu = Gpu::new();
    let layer = |z: f32| [[-50.0, -50.0, z], [50.0, -50.0, z], [0.0, 50.0, z]];
    let (clear, opaque) = (vk::GeometryFlagsKHR::empty(), vk::GeometryFlagsKHR::OPAQUE);
    let triangles = gpu.scene(&[
        Geometry::triangles(&layer(1.0), clear),
        Geometry::triangles(&layer(2.0), opaque),
    ]);
    let boxes = [[-0.5, -0.5, 0.5, 0.5, 0.5, 1.5]];
    let clear_box = gpu.scene(&[Geometry::boxes(&boxes, clear)]);
    let opaque_box = gpu.scene(&[Geometry::boxes(&boxes, opaque)]);
    const OPAQUE: u32 = 0x1;
    const NO_OPAQUE: u32 = 0x2;
    const CULL_OPAQUE: u32 = 0x40;
    const CULL_NO_OPAQUE: u32 = 0x80;
    let ray = [Ray::new([0.1, 0.2, 0.0], [0.0, 0.0, 1.0])];
    // The layer that is hit, and whether the clear and the opaque box are.
    let cases = [
        (0, 0, true, true),
        (OPAQUE, 0, true, true),
        (NO_OPAQUE, 0, true, true),
        (CULL_OPAQUE, 0, true, false),
        (CULL_NO_OPAQUE, 1, false, true),
    ];
    for (flags, layer, clear, opaque) in cases {
        let hit = shoot_with(&gpu, triangles, &ray, &[], flags, 0xff)[0];
        assert_eq!((hit.primitive, hit.geometry), (0, layer), "{flags:#x}");
        for (world, is_hit) in [(clear_box, clear), (opaque_box, opaque)] {
            let hit = shoot_with(&gpu, world, &ray, &boxes, flags, 0xff)[0];
            assert_eq!(hit.primitive != MISSED, is_hit, "{flags:#x}");
        }
    }
}

#[test]
fn spheres_in_boxes() {
    let gpu = Gpu::new();
    let mut random = Rng::with_seed(4);
    let boxes: Vec<[f32; 6]> = (0..200)
        .map(|_| {
            let low: [f32; 3] = std::array::from_fn(|_| between(&mut random, -8.0, 8.0));
            std::array::from_fn(|i| low[i % 3] + (i / 3) as f32)
        })
        .collect();
    let world = gpu.scene(&[Geometry::boxes(&boxes, vk::GeometryFlagsKHR::OPAQUE)]);
    let rays = random_rays(&mut random, 3000);
    let hits = shoot(&gpu, world, &rays, &boxes);
    let (mut decided, mut hit_count, mut attributes) = (0, 0, 0);
    for (i, (hit, ray)) in hits.iter().zip(&rays).enumerate() {
        let mut best: Option<(usize, f64, u32)> = None;
        let mut doubtful = false;
        for (sphere, corners) in boxes.iter().enumerate() {
            let (o, d) = ray.wide();
            let centre = Vec3::from_slice(corners).as_dvec3() + 0.5;
            let f = o - centre;
            let (a, h) = (d.dot(d), f.dot(d));
            let discriminant = h * h - a * (f.dot(f) - 0.25);
            doubtful |= discriminant.abs() < 1e-3;
            if discriminant < 0.0 {
                continue;
            }
            let root = discriminant.sqrt();
            let (near, far) = ((-h - root) / a, (-h + root) / a);
            doubtful |= near.abs() < 1e-3 || far.abs() < 1e-3;
            let (t, kind) = if near > 0.0 { (near, 7) } else { (far, 9) };
            if t <= 0.0 {
                continue;
            }
            doubtful |= best.is_some_and(|best| (best.1 - t).abs() < 1e-3);
            if best.is_none_or(|best| t < best.1) {
                best = Some((sphere, t, kind));
            }
        }
        if doubtful {
            continue;
        }
        decided += 1;
        match best {
            None => assert_eq!(hit.primitive, MISSED, "ray {i}"),
            Some((sphere, t, kind)) => {
                hit_count += 1;
                assert_eq!(hit.primitive, sphere as u32, "ray {i} t {t}");
                assert!(
                    (f64::from(hit.t) - t).abs() < 1e-3,
                    "ray {i}: {} is not {t}",
                    hit.t
                );
                assert_eq!(hit.kind, kind, "ray {i}");
                attributes += usize::from(hit.weights == [sphere as f32, 0.25]);
            }
        }
    }
    assert!(decided > 2000, "only {decided} rays could be decided");
    let why = "a reported hit that is too far away overwrites the attributes of the nearer one";
    unless_known(&gpu, "llvmpipe", why, || assert_eq!(attributes, hit_count));
}

const FACING: [[f32; 3]; 3] = [[-1.0, -1.0, 3.0], [1.0, -1.0, 3.0], [0.0, 1.0, 3.0]];
const AHEAD: Ray = Ray {
    origin: [0.1, 0.2, 0.0],
    t_min: 0.0,
    direction: [0.0, 0.0, 1.0],
    t_max: 1e30,
};

#[test]
fn triangles_with_nan_in_x_are_inactive_but_counted() {
    let gpu = Gpu::new();
    let nan = f32::NAN;
    let mut corners = vec![[nan, -1.0, 1.0], [1.0, -1.0, 1.0], [0.0, 1.0, 1.0]];
    corners.extend(FACING);
    corners.extend([[nan, 0.0, 2.0]; 3]);
    let world = gpu.scene(&[Geometry::opaque(&corners)]);
    let hit = shoot(&gpu, world, &[AHEAD], &[])[0];
    let why = "one triangle with NaN hides the others of its geometry";
    unless_known(&gpu, "llvmpipe", why, || {
        assert_eq!((hit.primitive, hit.t), (1, 3.0))
    });
}

#[test]
fn instances_of_no_structure_are_inactive_but_counted() {
    let gpu = Gpu::new();
    let bottom = gpu.bottom(&[Geometry::opaque(&FACING)]);
    let nothing = Structure {
        address: 0,
        ..bottom
    };
    let world = gpu.top(&[Instance::of(nothing), Instance::of(bottom)]);
    let hit = shoot(&gpu, world, &[AHEAD], &[])[0];
    let why = "an instance of nothing hides its neighbours";
    unless_known(&gpu, "llvmpipe", why, || {
        assert_eq!((hit.primitive, hit.instance, hit.t), (0, 1, 3.0));
    });
}

#[test]
fn instances_of_an_empty_structure_are_counted() {
    let gpu = Gpu::new();
    let bottom = gpu.bottom(&[Geometry::opaque(&FACING)]);
    let empty = gpu.bottom(&[Geometry::opaque(&[])]);
    let world = gpu.top(&[Instance::of(empty), Instance::of(bottom)]);
    let hit = shoot(&gpu, world, &[AHEAD], &[])[0];
    let why = "an instance of nothing hides its neighbours";
    unless_known(&gpu, "llvmpipe", why, || {
        assert_eq!((hit.primitive, hit.instance, hit.t), (0, 1, 3.0));
    });
}

#[test]
fn an_empty_world_is_missed() {
    let gpu = Gpu::new();
    let void = gpu.top(&[]);
    assert_eq!(shoot(&gpu, void, &[AHEAD], &[])[0].primitive, MISSED);
    let hollow = gpu.scene(&[Geometry::opaque(&[])]);
    assert_eq!(shoot(&gpu, hollow, &[AHEAD], &[])[0].primitive, MISSED);
}

#[test]
fn a_closed_mesh_lets_no_ray_through() {
    let gpu = Gpu::new();
    // A subdivided octahedron blown up to a sphere, and rays from its middle at its vertices and
    // at the middles of its edges.
    let mut triangles: Vec<[[f32; 3]; 3]> = Vec::new();
    for corner in 0..8 {
        let sign = |bit: usize| if corner >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let [a, b, c] = [
            [sign(0), 0.0, 0.0],
            [0.0, sign(1), 0.0],
            [0.0, 0.0, sign(2)],
        ];
        // All wind the same way around: only then is an edge shared in the spec's sense.
        let mirrored = sign(0) * sign(1) * sign(2) < 0.0;
        triangles.push(if mirrored { [a, c, b] } else { [a, b, c] });
    }
    let unit = |p: [f32; 3]| {
        let length = p.iter().map(|x| x * x).sum::<f32>().sqrt();
        p.map(|x| x / length)
    };
    let middle = |a: [f32; 3], b: [f32; 3]| unit(std::array::from_fn(|i| a[i] + b[i]));
    for _ in 0..4 {
        triangles = triangles
            .iter()
            .flat_map(|[a, b, c]| {
                let (ab, bc, ca) = (middle(*a, *b), middle(*b, *c), middle(*c, *a));
                [[*a, ab, ca], [ab, *b, bc], [ca, bc, *c], [ab, bc, ca]]
            })
            .collect();
    }
    for (scale, offset) in [(1.0, 0.0), (1e5, 0.0), (1.0, 1e3), (1e-3, 0.0)] {
        let placed: Vec<[[f32; 3]; 3]> = triangles
            .iter()
            .map(|triangle| triangle.map(|p| p.map(|x| x * scale + offset)))
            .collect();
        let world = gpu.scene(&[Geometry::opaque(placed.as_flattened())]);
        let origin = [offset; 3];
        let mut rays = Vec::new();
        for [a, b, c] in &placed {
            let aimed =
                |target: [f32; 3]| Ray::new(origin, std::array::from_fn(|i| target[i] - origin[i]));
            rays.push(aimed(*a));
            rays.push(aimed(std::array::from_fn(|i| 0.5 * (a[i] + b[i]))));
            rays.push(aimed(std::array::from_fn(|i| b[i] + 0.3 * (c[i] - b[i]))));
        }
        let through = shoot(&gpu, world, &rays, &[])
            .iter()
            .filter(|hit| hit.primitive == MISSED)
            .count();
        assert_eq!(
            through,
            0,
            "of {} rays, scale {scale}, offset {offset}",
            rays.len()
        );
    }
}
