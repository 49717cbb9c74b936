//! Instances: transforms, masks, facing.

use super::*;

#[test]
fn instances_move_scale_and_mirror() {
    let gpu = Gpu::new();
    let mut random = Rng::with_seed(5);
    let own = random_triangles(&mut random, 12, 4.0);
    let bottom = gpu.bottom(&[Geometry::opaque(own.as_flattened())]);
    let mut instances = Vec::new();
    let mut world_triangles = Vec::new();
    for i in 0..30u32 {
        // Any matrix whose determinant is not tiny; every third one mirrors.
        let mut m: [f32; 12] = std::array::from_fn(|k| match k % 4 {
            3 => between(&mut random, -8.0, 8.0),
            column if column == k / 4 => between(&mut random, 0.3, 0.8),
            _ => between(&mut random, -0.2, 0.2),
        });
        if i % 3 == 0 {
            for row in 0..3 {
                m[4 * row] = -m[4 * row];
            }
        }
        instances.push(Instance {
            transform: m,
            custom_index: 1000 + 7 * i,
            ..Instance::of(bottom)
        });
        for triangle in &own {
            world_triangles.push(triangle.map(|p| {
                std::array::from_fn(|row| {
                    let m = &m[4 * row..4 * row + 4];
                    m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3]
                })
            }));
        }
    }
    let world = gpu.top(&instances);
    let rays = random_rays(&mut random, 3000);
    let hits = shoot(&gpu, world, &rays, &[]);
    let flat: Vec<Hit> = hits
        .iter()
        .map(|hit| {
            let mut flat = *hit;
            if hit.primitive != MISSED {
                assert_eq!(hit.custom, 1000 + 7 * hit.instance);
                flat.primitive = hit.instance * own.len() as u32 + hit.primitive;
                // Facing is decided in object space: a mirroring instance turns it around.
                if hit.instance % 3 == 0 {
                    flat.kind = FRONT ^ BACK ^ hit.kind;
                }
            }
            flat
        })
        .collect();
    check_against_brute_force(&flat, &rays, &world_triangles);
}

#[test]
fn masks_choose_instances() {
    let gpu = Gpu::new();
    let bottom = gpu.bottom(&[Geometry::opaque(&[
        [-1.0, -1.0, 0.0],
        [1.0, -1.0, 0.0],
        [0.0, 1.0, 0.0],
    ])]);
    let masks = [0x01, 0x80, 0x18, 0x06, 0xff, 0x00, 0x20];
    let instances: Vec<Instance> = masks
        .iter()
        .enumerate()
        .map(|(i, mask)| Instance {
            transform: translated([0.0, 0.0, i as f32 + 1.0]),
            mask: *mask,
            ..Instance::of(bottom)
        })
        .collect();
    let world = gpu.top(&instances);
    let ray = Ray::new([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    for mask in [
        0x01u32, 0x02, 0x04, 0x08, 0x10, 0x40, 0x80, 0xff, 0x00, 0x60, 0x101,
    ] {
        let expected = masks
            .iter()
            .position(|own| u32::from(*own) & mask & 0xff != 0);
        let hit = shoot_with(&gpu, world, &[ray], &[], 0, mask)[0];
        match expected {
            Some(instance) => assert_eq!(hit.instance, instance as u32, "mask {mask:#x}"),
            None => assert_eq!(hit.primitive, MISSED, "mask {mask:#x}"),
        }
    }
}

#[test]
fn culling_by_facing() {
    use vk::GeometryInstanceFlagsKHR as Flags;
    const CULL_BACK: u32 = 0x10;
    const CULL_FRONT: u32 = 0x20;
    let gpu = Gpu::new();
    let corners = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];
    let bottom = gpu.bottom(&[Geometry::opaque(&corners)]);
    let rays = [
        Ray::new([0.0, 0.0, -1.0], [0.0, 0.0, 1.0]),
        Ray::new([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]),
    ];
    for flags in [
        Flags::empty(),
        Flags::TRIANGLE_FLIP_FACING,
        Flags::TRIANGLE_FACING_CULL_DISABLE,
        Flags::TRIANGLE_FLIP_FACING | Flags::TRIANGLE_FACING_CULL_DISABLE,
    ] {
        let world = gpu.top(&[Instance {
            flags,
            ..Instance::of(bottom)
        }]);
        for ray_flags in [0, CULL_BACK, CULL_FRONT] {
            let hits = shoot_with(&gpu, world, &rays, &[], ray_flags, 0xff);
            for (ray, hit) in rays.iter().zip(&hits) {
                let (_, _, _, mut front) = intersect(ray, corners).expect("the plane is hit");
                front ^= flags.contains(Flags::TRIANGLE_FLIP_FACING);
                let culled = !flags.contains(Flags::TRIANGLE_FACING_CULL_DISABLE)
                    && ray_flags == if front { CULL_FRONT } else { CULL_BACK };
                let what = format!("{ray:?} {flags:?} {ray_flags:#x}");
                assert_eq!(hit.primitive == MISSED, culled, "{what}");
                if !culled {
                    assert_eq!(hit.kind, if front { FRONT } else { BACK }, "{what}");
                }
            }
        }
    }
}
