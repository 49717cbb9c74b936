//! Closest hits against brute force in f64.

use scenes::*;
use traversal::*;

fn soup(random: &mut Random, count: usize, size: f64) -> Mesh {
    let mut mesh = Mesh {
        opaque: true,
        ..Mesh::default()
    };
    for i in 0..count as u32 {
        let center = random.vector();
        for _ in 0..3 {
            let offset = random.vector();
            mesh.vertices.push(std::array::from_fn(|k| {
                (center[k] + size * offset[k]) as f32
            }));
        }
        mesh.indices.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    mesh
}

/// The nearest triangle by brute force, and whether the answer is clear: no other triangle within
/// rounding of it, no ray along an edge.
fn brute_force(mesh: &Mesh, ray: &Ray) -> (Option<(usize, f64)>, bool) {
    let mut best: Option<(usize, f64)> = None;
    let mut clear = true;
    for i in 0..mesh.indices.len() {
        let (t, _, _, inside) = reference(ray, &mesh.triangle(i));
        if inside.abs() < 1e-5 && t > 0.0 {
            clear = false;
        }
        if inside >= 0.0 && t > f64::from(ray.t_min) && t < f64::from(ray.t_max) {
            if best.is_some_and(|(_, b)| (b - t).abs() < 1e-5 * t) {
                clear = false;
            }
            if best.is_none_or(|(_, b)| t < b) {
                best = Some((i, t));
            }
        }
    }
    (best, clear)
}

#[test]
fn soup_agrees_with_brute_force() {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let mut walker = Walker::new();
    for count in [1, 2, 3, 4, 5, 8, 9, 17, 64, 65, 300, 2000] {
        for size in [0.02, 0.3] {
            let mesh = soup(&mut random, count, size);
            let scene = Scene::new(std::slice::from_ref(&mesh), 0);
            let mut compared = 0;
            let mut hits = 0;
            for _ in 0..500 {
                let origin = narrow(2.0 * random.vector());
                let target = 0.8 * random.vector();
                let ray = ray(origin, narrow(target - wide(origin)));
                let (expected, clear) = brute_force(&mesh, &ray);
                if !clear {
                    continue;
                }
                compared += 1;
                let found = closest_with(&mut walker, &scene.top, &ray);
                match (expected, found) {
                    (None, None) => {}
                    (Some((index, t)), Some(hit)) => {
                        hits += 1;
                        assert_eq!(hit.primitive_index as usize, index);
                        // Errors count by the distance of the farthest vertex.
                        let (o, d) = (wide(ray.origin), wide(ray.direction));
                        let far = |v: [f32; 3]| {
                            let to = wide(v) - o;
                            (to.dot(to) / d.dot(d)).sqrt()
                        };
                        let reach = mesh
                            .triangle(index)
                            .map(far)
                            .into_iter()
                            .fold(0.0, f64::max);
                        assert!((f64::from(hit.t) - t).abs() < 1e-6 * reach, "{} {t}", hit.t);
                        let vertices = Structure::triangle_vertices(
                            // SAFETY: the structures are alive.
                            &unsafe { Structure::at(scene.top.address(), &EVERYWHERE) }.unwrap(),
                            &hit,
                            &EVERYWHERE,
                        );
                        assert_eq!(vertices, mesh.triangle(index));
                    }
                    other => panic!("{count} {ray:?}: {other:?}"),
                }
            }
            assert!(compared > 300, "{compared}");
            assert!(hits > 0 || count < 300);
        }
    }
}

#[test]
fn nothing_to_hit() {
    let down = ray([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]);
    // SAFETY: no structure at all.
    let mut walk = unsafe { Walk::new(0, &down) };
    let mut fuel = 10;
    assert_eq!(
        walk.resume(&mut Walker::new(), Verdict::Continue, &mut fuel),
        Event::Done
    );
    assert!(walk.committed().is_none());
    let empty = build_instances(&[], 0);
    assert!(closest(&empty, &down).is_none());
    let bottom = build_meshes(&[], 0);
    let top = build_instances(&[InstanceRecord::new(&bottom, IDENTITY)], 0);
    assert!(closest(&top, &down).is_none());
}
