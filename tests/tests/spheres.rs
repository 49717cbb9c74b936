//! Spheres and linear swept spheres (`VK_NV_ray_tracing_linear_swept_spheres`), against distances
//! that geometry gives.

use tuff_tests::*;

/// A device that has both; `None` skips the test. The extension is newer than the validation layers
/// of some systems.
fn gpu() -> Option<Gpu> {
    let gpu = Gpu::without_validation();
    let features = gpu.optional.swept_spheres;
    let there = features.spheres * features.linear_swept_spheres == vk::TRUE;
    gpu.with("VK_NV_ray_tracing_linear_swept_spheres", |_| there)
}

const HEAD: &str = r"
#extension GL_NV_linear_swept_spheres : enable
layout(set = 0, binding = 0) uniform accelerationStructureEXT world;
layout(set = 0, binding = 1, std430) buffer Results { float results[]; };
layout(set = 0, binding = 2, scalar) buffer Rays { vec3 rays[]; };
";

/// The result of a ray: distance (or -1), primitive, attribute, sphere or swept, first position,
/// first and second radius.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Found {
    t: f32,
    primitive: f32,
    u: f32,
    is: [f32; 2],
    position: [f32; 3],
    radii: [f32; 2],
}

const WORDS: usize = 10;

/// Traces rays, given by origin and direction. Any-hit shaders ignore primitive `ignored`.
fn trace(
    gpu: &Gpu,
    world: Structure,
    flags: u32,
    ignored: Option<u32>,
    rays: &[[f32; 6]],
) -> Vec<Found> {
    let output = gpu.buffer((4 * WORDS * rays.len()) as u64);
    let input = gpu.buffer_with(rays);
    let raygen = format!(
        "{HEAD}
        layout(location = 0) rayPayloadEXT float payload[{WORDS}];
        void main() {{
            uint i = gl_LaunchIDEXT.x;
            traceRayEXT(world, {flags}u, 0xffu, 0u, 0u, 0u, rays[2u * i], 0.0, rays[2u * i + 1u], 1000.0, 0);
            for (int k = 0; k < {WORDS}; k++)
                results[{WORDS}u * i + uint(k)] = payload[k];
        }}"
    );
    let miss = format!(
        "layout(location = 0) rayPayloadInEXT float payload[{WORDS}]; void main() {{ payload[0] = -1.0; }}"
    );
    let hit = format!(
        "{HEAD}
        layout(location = 0) rayPayloadInEXT float payload[{WORDS}];
        hitAttributeEXT float u;
        void main() {{
            payload[0] = gl_HitTEXT;
            payload[1] = float(gl_PrimitiveID);
            payload[2] = u;
            payload[3] = float(gl_HitIsSphereNV);
            payload[4] = float(gl_HitIsLSSNV);
            vec3 position = gl_HitIsSphereNV ? gl_HitSpherePositionNV : gl_HitLSSPositionsNV[0];
            payload[5] = position.x;
            payload[6] = position.y;
            payload[7] = position.z;
            payload[8] = gl_HitIsSphereNV ? gl_HitSphereRadiusNV : gl_HitLSSRadiiNV[0];
            payload[9] = gl_HitIsSphereNV ? 0.0 : gl_HitLSSRadiiNV[1];
        }}"
    );
    let ignored = ignored.map_or(u32::MAX, |ignored| ignored);
    let any =
        format!("void main() {{ if (uint(gl_PrimitiveID) == {ignored}u) ignoreIntersectionEXT; }}");
    let case = Case::new(&raygen)
        .miss(&miss)
        .hit(&hit)
        .any_hit(&any)
        .bind(world)
        .bind(output)
        .bind(input);
    case.trace(gpu, [rays.len() as u32, 1, 1]);
    let words: Vec<f32> = output.read();
    words
        .chunks(WORDS)
        .map(|w| Found {
            t: w[0],
            primitive: w[1],
            u: w[2],
            is: [w[3], w[4]],
            position: [w[5], w[6], w[7]],
            radii: [w[8], w[9]],
        })
        .collect()
}

fn swept(
    ends: &[[f32; 4]],
    indices: &[u32],
    sweep: Sweep,
    flags: vk::GeometryFlagsKHR,
) -> Geometry {
    Geometry::Swept {
        ends: ends.to_vec(),
        indices: indices.to_vec(),
        sweep,
        flags,
    }
}

/// Rays along +z from z = -20.
fn down(points: &[[f32; 2]]) -> Vec<[f32; 6]> {
    points
        .iter()
        .map(|&[x, y]| [x, y, -20.0, 0.0, 0.0, 1.0])
        .collect()
}

#[test]
fn spheres_are_hit_where_they_are() {
    let Some(gpu) = gpu() else { return };
    let mut random = Rng::with_seed(7);
    let spheres: Vec<[f32; 4]> = (0..500)
        .map(|_| {
            let mut c = || between(&mut random, -10.0, 10.0);
            [c(), c(), c(), (c() + 11.0) * 0.05]
        })
        .collect();
    let rays: Vec<[f32; 6]> = (0..1000)
        .map(|_| {
            let mut c = |r: f32| between(&mut random, -r, r);
            [c(10.0), c(10.0), -30.0, c(0.2), c(0.2), 1.0]
        })
        .collect();
    let opaque = vk::GeometryFlagsKHR::OPAQUE;
    let world = gpu.scene(&[swept(&spheres, &[], Sweep::Spheres, opaque)]);
    let found = trace(&gpu, world, 0, None, &rays);
    let mut hits = 0;
    for (ray, found) in rays.iter().zip(found) {
        let r = ray.map(f64::from);
        let nearest = spheres
            .iter()
            .enumerate()
            .filter_map(|(i, sphere)| {
                let s = sphere.map(f64::from);
                let o = [r[0] - s[0], r[1] - s[1], r[2] - s[2]];
                let a = r[3] * r[3] + r[4] * r[4] + r[5] * r[5];
                let b = o[0] * r[3] + o[1] * r[4] + o[2] * r[5];
                let c = o[0] * o[0] + o[1] * o[1] + o[2] * o[2] - s[3] * s[3];
                let d = b * b - a * c;
                (d >= 0.0).then(|| ((-b - d.sqrt()) / a, i))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0));
        match nearest {
            Some((t, index)) => {
                assert!((f64::from(found.t) - t).abs() < 1e-5, "{found:?} {t}");
                assert_eq!(found.primitive, index as f32);
                assert_eq!(found.is, [1.0, 0.0]);
                assert_eq!(found.u, 0.0);
                assert_eq!(found.position, spheres[index][..3]);
                assert_eq!(found.radii[0], spheres[index][3]);
                hits += 1;
            }
            None => assert_eq!(found.t, -1.0),
        }
    }
    assert!(hits > 200, "{hits}");
}

#[test]
fn swept_spheres_are_their_midsection_and_their_caps() {
    let Some(gpu) = gpu() else { return };
    let ends = [
        [2.0, 0.0, 0.0, 2.0],
        [6.0, 0.0, 0.0, 2.0],
        [10.0, 0.0, 0.0, 2.0],
    ];
    let points = [
        [0.8, 0.0],
        [4.0, 1.2],
        [7.0, 0.0],
        [9.0, 1.2],
        [11.2, 0.0],
        [13.0, 0.0],
    ];
    let opaque = vk::GeometryFlagsKHR::OPAQUE;
    let cases: [(Sweep, &[u32], [f32; 6]); 4] = [
        (
            Sweep::Pairs { caps: false },
            &[0, 1],
            [-1.0, 18.4, -1.0, -1.0, -1.0, -1.0],
        ),
        (
            Sweep::Pairs { caps: true },
            &[0, 1],
            [18.4, 18.4, 18.26795, -1.0, -1.0, -1.0],
        ),
        (
            Sweep::Successive { caps: false },
            &[0, 1],
            [-1.0, 18.4, 18.0, 18.4, -1.0, -1.0],
        ),
        (
            Sweep::Successive { caps: true },
            &[0, 1],
            [18.4, 18.4, 18.0, 18.4, 18.4, -1.0],
        ),
    ];
    for (sweep, indices, expected) in cases {
        let world = gpu.scene(&[swept(&ends, indices, sweep, opaque)]);
        let found = trace(&gpu, world, 0, None, &down(&points));
        for (found, expected) in found.iter().zip(expected) {
            assert!(
                (found.t - expected).abs() < 1e-4,
                "{sweep:?}: {found:?} {expected}"
            );
            if expected >= 0.0 {
                assert_eq!(found.is, [0.0, 1.0]);
                assert_eq!(found.radii, [2.0, 2.0]);
                assert!(found.position == [2.0, 0.0, 0.0] || found.primitive == 1.0);
            }
        }
        if sweep == (Sweep::Pairs { caps: true }) {
            assert_eq!((found[0].u, found[1].u, found[2].u), (0.0, 0.5, 1.0));
        }
    }
}

#[test]
fn rays_from_inside_and_through_missing_caps_find_nothing() {
    let Some(gpu) = gpu() else { return };
    let ends = [[0.0, 0.0, 0.0, 2.0], [5.0, 0.0, 0.0, 1.0]];
    let opaque = vk::GeometryFlagsKHR::OPAQUE;
    let rays = [
        // From inside the midsection, the first end, and from outside along the axis.
        [2.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        [-1.0, 0.0, 0.0, -1.0, 0.0, 0.0],
        [-9.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        [9.0, 0.0, 0.0, -1.0, 0.0, 0.0],
    ];
    for (caps, expected) in [(true, [-1.0, -1.0, 7.0, 3.0]), (false, [-1.0; 4])] {
        let world = gpu.scene(&[swept(&ends, &[], Sweep::Pairs { caps }, opaque)]);
        let found = trace(&gpu, world, 0, None, &rays);
        let distances: Vec<f32> = found.iter().map(|found| found.t).collect();
        assert_eq!(distances, expected, "{caps}");
    }
}

#[test]
fn any_hit_shaders_decide_and_built_in_primitives_are_skipped() {
    const SKIP_BUILT_IN_PRIMITIVES: u32 = 0x100;
    const SKIP_AABBS: u32 = 0x200;
    const OPAQUE: u32 = 1;
    const CULL_NO_OPAQUE: u32 = 0x80;
    let Some(gpu) = gpu() else { return };
    let ends = [[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 5.0, 1.0]];
    let no_flags = vk::GeometryFlagsKHR::empty();
    let world = gpu.scene(&[swept(&ends, &[1, 0], Sweep::Spheres, no_flags)]);
    for (flags, ignored, t) in [
        (0, None, 19.0),
        (0, Some(1), 24.0),
        (0, Some(0), 19.0),
        (OPAQUE, Some(1), 19.0),
        (CULL_NO_OPAQUE, None, -1.0),
        (SKIP_BUILT_IN_PRIMITIVES, None, -1.0),
        (SKIP_AABBS, None, 19.0),
    ] {
        let found = trace(&gpu, world, flags, ignored, &down(&[[0.0, 0.0]]));
        assert_eq!(found[0].t, t, "{flags:#x} {ignored:?}");
    }
}

#[test]
fn inactive_and_degenerate_primitives_are_invisible() {
    let Some(gpu) = gpu() else { return };
    let nan = f32::NAN;
    let ends = [
        [nan, 0.0, 0.0, 1.0],
        [0.0, 0.0, 0.0, nan],
        [0.0, 0.0, 0.0, 0.0],
        [3.0, 0.0, 0.0, 1.0],
    ];
    let opaque = vk::GeometryFlagsKHR::OPAQUE;
    let world = gpu.scene(&[swept(&ends, &[], Sweep::Spheres, opaque)]);
    let found = trace(&gpu, world, 0, None, &down(&[[0.0, 0.0], [3.0, 0.0]]));
    assert_eq!(found[0].t, -1.0);
    assert_eq!((found[1].t, found[1].primitive), (19.0, 3.0));
}
