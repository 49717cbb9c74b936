//! Primitives and rays where methods fail: not numbers, infinite, coincident, degenerate, tiny.

use scenes::*;
use std::time::Duration;
use traversal::*;

const SQUARE: [[f32; 3]; 3] = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];

fn mesh_of(triangles: &[[[f32; 3]; 3]], opaque: bool) -> Mesh {
    Mesh {
        vertices: triangles.iter().flatten().copied().collect(),
        indices: (0..triangles.len() as u32)
            .map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
            .collect(),
        opaque,
    }
}

fn down(x: f32, y: f32) -> Ray {
    ray([x, y, 5.0], [0.0, 0.0, -1.0])
}

#[test]
fn inactive_and_infinite_triangles_are_not_there() {
    for flags in [0, BuildFlags::ALLOW_UPDATE] {
        let mut triangles = vec![SQUARE; 20];
        for (i, value) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY]
            .iter()
            .enumerate()
        {
            triangles[3 * i][0][0] = *value;
            triangles[3 * i + 1][1][1] = *value;
            triangles[3 * i + 2][2] = [*value; 3];
        }
        let mesh = mesh_of(&triangles, false);
        let scene = Scene::new(std::slice::from_ref(&mesh), flags);
        let found: Vec<u32> = candidates(&scene.top, &down(0.0, 0.0))
            .iter()
            .map(|hit| hit.primitive_index)
            .collect();
        let mut sorted = found.clone();
        sorted.sort();
        assert_eq!(sorted, (9..20).collect::<Vec<_>>());
    }
    let nothing = mesh_of(&[[[f32::NAN; 3]; 3]; 5], true);
    let scene = Scene::new(std::slice::from_ref(&nothing), 0);
    assert!(closest(&scene.top, &down(0.0, 0.0)).is_none());
}

#[test]
fn boxes_inactive_infinite_flat_and_from_inside() {
    let mut boxes = vec![[f32::NAN, 0.0, 0.0, 1.0, 1.0, 1.0]; 3];
    let infinity = f32::INFINITY;
    boxes.push([
        -infinity, -infinity, -infinity, infinity, infinity, infinity,
    ]);
    boxes.push([-1.0, -1.0, 2.0, 1.0, 1.0, 2.0]);
    boxes.push([0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    boxes.push([-9.0, -9.0, -9.0, 9.0, 9.0, 9.0]);
    boxes.push([5.0, 5.0, 5.0, 6.0, 6.0, 6.0]);
    let bottom = build_boxes(&boxes, false, 0);
    let top = build_instances(&[InstanceRecord::new(&bottom, IDENTITY)], 0);
    let found = |ray: &Ray| {
        let mut found: Vec<u32> = candidates(&top, ray)
            .iter()
            .map(|hit| hit.primitive_index)
            .collect();
        found.sort();
        found
    };
    assert_eq!(found(&down(0.0, 0.0)), [3, 4, 5, 6]);
    assert_eq!(found(&down(0.5, 0.5)), [3, 4, 6]);
    assert_eq!(found(&down(20.0, 0.0)), [3]);
    // The interval is closed for boxes: flat box 4 lies at t = 3.
    for (t_min, t_max) in [(3.0, 4.0), (2.0, 3.0), (3.0, 3.0)] {
        let ray = Ray {
            t_min,
            t_max,
            ..down(0.5, 0.5)
        };
        assert!(found(&ray).contains(&4), "{t_min} {t_max}");
    }
    // A direction of no length asks what the origin is in.
    let still = ray([5.5, 5.5, 5.5], [0.0; 3]);
    assert_eq!(found(&still), [3, 6, 7]);
}

#[test]
fn the_interval_is_open_for_triangles() {
    let scene = Scene::new(&[mesh_of(&[SQUARE], true)], 0);
    let hit = |t_min: f32, t_max: f32| {
        let ray = Ray {
            t_min,
            t_max,
            ..down(0.0, 0.0)
        };
        closest(&scene.top, &ray).is_some()
    };
    assert!(hit(0.0, f32::INFINITY));
    assert!(hit(5f32.next_down(), 5f32.next_up()));
    assert!(!hit(5.0, f32::INFINITY));
    assert!(!hit(0.0, 5.0));
    assert!(!hit(6.0, 4.0));
    // At the origin itself: t = 0 is not above t_min = 0.
    assert!(closest(&scene.top, &ray([0.0; 3], [0.0, 0.0, 1.0])).is_none());
    let tiny = f32::from_bits(1);
    let near = ray([0.0, 0.0, -tiny], [0.0, 0.0, 1.0]);
    assert_eq!(closest(&scene.top, &near).map(|hit| hit.t), Some(tiny));
}

#[test]
fn rays_that_are_no_rays_miss() {
    let scene = Scene::new(&[mesh_of(&[SQUARE], true)], 0);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let mut ray = down(0.0, 0.0);
            ray.origin[axis] = bad;
            assert!(closest(&scene.top, &ray).is_none());
            let mut ray = down(0.0, 0.0);
            ray.direction[axis] = bad;
            assert!(closest(&scene.top, &ray).is_none());
        }
    }
    for bad in [
        Ray {
            t_min: f32::NAN,
            ..down(0.0, 0.0)
        },
        Ray {
            t_max: f32::NAN,
            ..down(0.0, 0.0)
        },
        ray([0.0, 0.0, 5.0], [0.0; 3]),
    ] {
        assert!(closest(&scene.top, &bad).is_none());
    }
}

#[test]
fn directions_of_any_length() {
    let scene = Scene::new(&[mesh_of(&[SQUARE], true)], 0);
    let bottom = build_boxes(&[[-1.0, -1.0, -1.0, 1.0, 1.0, 1.0]], false, 0);
    let boxes = build_instances(&[InstanceRecord::new(&bottom, IDENTITY)], 0);
    for exponent in -37..=37 {
        let length = 10f64.powi(exponent) as f32;
        let ray = ray([0.25, 0.0, 5.0], [0.0, 0.0, -length]);
        let hit = closest(&scene.top, &ray).unwrap_or_else(|| panic!("{length:e}"));
        let t = 5.0 / f64::from(length);
        assert!((f64::from(hit.t) - t).abs() <= 1e-7 * t, "{length:e}");
        assert_eq!(candidates(&boxes, &ray).len(), 1, "{length:e}");
        let behind = Ray {
            t_max: (0.79 * t) as f32,
            ..ray
        };
        assert_eq!(candidates(&boxes, &behind).len(), 0, "{length:e}");
    }
    // Components that vanish beside the others, of both signs.
    for small in [0.0, -0.0, 1e-45, -1e-45, 1e-39, -1e-39, 1e-30, 1e-20] {
        for aslant in [
            [small, small, -1.0],
            [small, -1.0, small],
            [-1.0, small, small],
        ] {
            let origin = aslant.map(|c: f32| if c == -1.0 { 5.0 } else { 0.0 });
            let ray = ray(origin, aslant);
            assert_eq!(candidates(&boxes, &ray).len(), 1, "{aslant:?}");
        }
        let edge = ray([-1.0, 0.5, 5.0], [small.abs(), 0.0, -1.0]);
        assert_eq!(candidates(&boxes, &edge).len(), 1, "{small:e}");
    }
}

#[test]
fn degenerate_triangles_are_never_hit() {
    let point = [[0.0; 3]; 3];
    let line = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]];
    let edge_on = [[0.0, -1.0, -1.0], [0.0, 1.0, -1.0], [0.0, 0.0, 1.0]];
    for opaque in [true, false] {
        let scene = Scene::new(&[mesh_of(&[point, line, edge_on], opaque)], 0);
        assert!(closest(&scene.top, &down(0.0, 0.0)).is_none());
        assert!(candidates(&scene.top, &down(0.0, 0.0)).is_empty());
    }
}

#[test]
fn identical_triangles_build_fast_and_the_first_wins() {
    for flags in QUALITIES {
        let mesh = mesh_of(&vec![SQUARE; 20_000], true);
        let start = effort::processor_time();
        let scene = Scene::new(std::slice::from_ref(&mesh), flags);
        assert!(effort::processor_time() - start < Duration::from_secs(5));
        let hit = closest(&scene.top, &down(0.1, 0.1)).unwrap();
        assert_eq!((hit.t, hit.primitive_index), (5.0, 0));
        let open = Mesh {
            opaque: false,
            ..mesh
        };
        let open = Scene::new(&[open], flags);
        assert_eq!(candidates(&open.top, &down(0.1, 0.1)).len(), 20_000);
    }
}

#[test]
fn a_crowd_in_one_place_of_a_large_scene_builds_fast() {
    // 20,000 triangles in a billionth of what the others take.
    let mut random = Random(3);
    let triangles: Vec<_> = (0..20_100)
        .map(|i| {
            let size = if i < 20_000 { 1e-3 } else { 1e6 };
            let center = random.vector() * size;
            [(); 3].map(|()| {
                let offset = random.vector();
                narrow(center + 0.02 * size * offset)
            })
        })
        .collect();
    let mesh = mesh_of(&triangles, true);
    let rays: Vec<_> = (0..200)
        .map(|_| {
            let target = 5e-4 * random.vector();
            ray(
                [0.0, 0.0, 0.01],
                narrow(target - DVec3::new(0.0, 0.0, 0.01)),
            )
        })
        .collect();
    let hits = |flags| {
        let start = effort::processor_time();
        let scene = Scene::new(std::slice::from_ref(&mesh), flags);
        assert!(effort::processor_time() - start < Duration::from_secs(5));
        let hits = rays.iter().map(|ray| closest(&scene.top, ray));
        hits.map(|hit| hit.map(|hit| (hit.t.to_bits(), hit.primitive_index)))
            .collect::<Vec<_>>()
    };
    let expected = hits(0);
    assert!(expected.iter().flatten().count() > 50);
    for flags in QUALITIES {
        assert_eq!(hits(flags), expected, "{flags:#x}");
    }
}

#[test]
fn nested_triangles_of_all_sizes() {
    // Each twice as large as the one before and just above it: every split is lopsided.
    let triangles: Vec<_> = (0..200)
        .map(|i| {
            let size = 2f64.powi(i - 100);
            SQUARE.map(|v| [v[0], v[1], v[0]].map(|c| (f64::from(c) * size) as f32))
        })
        .collect();
    let mesh = mesh_of(&triangles, false);
    for flags in QUALITIES {
        let scene = Scene::new(std::slice::from_ref(&mesh), flags);
        let through = ray([0.0, -1e-33, 1.0], [0.0, 0.0, -1.0]);
        // From above, only those that contain the point below: all but the smallest few.
        let found = candidates(&scene.top, &through);
        let expected = triangles.iter().filter(|t| t[0][1] < -1e-33).count();
        assert_eq!(found.len(), expected);
    }
}

#[test]
fn aspect_of_a_billion_to_one() {
    // A strip of needles that closes the plane z = 0 around the origin.
    let n = 64;
    let triangles: Vec<_> = (0..n)
        .flat_map(|i| {
            let y0 = (i as f32 - 32.0) * 1e-6;
            let y1 = (i as f32 - 31.0) * 1e-6;
            let (a, b, c, d) = (
                [-1000.0, y0, 0.0],
                [1000.0, y0, 0.0],
                [1000.0, y1, 0.0],
                [-1000.0, y1, 0.0],
            );
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let solid = Scene::new(&[mesh_of(&triangles, true)], 0);
    let glass = Scene::new(&[mesh_of(&triangles, false)], 0);
    let mut random = Random(77);
    for _ in 0..2000 {
        let target = DVec3::new(random.signed() * 900.0, random.signed() * 2.9e-5, 0.0);
        let from = [
            target[0] + random.signed(),
            target[1] + random.signed() * 1e-3,
            1.0,
        ];
        let origin = narrow(from);
        let ray = ray(origin, narrow(target - wide(origin)));
        // The strip in exact arithmetic, where the ray meets z = 0.
        let y = f64::from(ray.origin[1])
            - f64::from(ray.origin[2]) * f64::from(ray.direction[1]) / f64::from(ray.direction[2]);
        if y.abs() < 3.0e-5 {
            let hit = closest(&solid.top, &ray).expect("the strip is closed");
            assert!((hit.t - 1.0).abs() < 1e-6);
            assert_eq!(candidates(&glass.top, &ray).len(), 1);
        }
    }
}

#[test]
fn inactive_instances() {
    let bottom = build_meshes(&[mesh_of(&[SQUARE], true)], 0);
    let good = InstanceRecord::new(&bottom, IDENTITY);
    let nowhere = InstanceRecord {
        reference: 0,
        ..good
    };
    let flat = InstanceRecord {
        transform: [0.0; 12],
        ..good
    };
    let unreal = InstanceRecord {
        transform: [f32::NAN; 12],
        ..good
    };
    let top = build_instances(&[nowhere, flat, unreal, good, nowhere], 0);
    assert_eq!(
        closest(&top, &down(0.0, 0.0)).map(|hit| hit.instance_index),
        Some(3)
    );
    let records = [nowhere, good];
    let pointers: Vec<u64> = records
        .iter()
        .map(|record| std::ptr::from_ref(record).expose_provenance() as u64)
        .collect();
    let top = build_blob(&BuildInput {
        flags: BuildFlags(0),
        geometries: Geometries::Instances(InstanceSource {
            memory: memory(&pointers),
            array: InstanceArray::Pointers,
            count: 2,
            flags: GeometryFlags(0),
            live: &EVERYWHERE,
        }),
    });
    assert_eq!(
        closest(&top, &down(0.0, 0.0)).map(|hit| hit.instance_index),
        Some(1)
    );
}
