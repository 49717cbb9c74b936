//! Walks that are finished together find what each finds by itself, bit for bit.

mod scene;

use scene::*;
use traversal::*;

/// Finishes walks together and one by one; returns whether the first could be done.
fn compare(walker: &mut Walker, top: &Bytes, rays: &[Ray]) -> bool {
    // SAFETY: the structures are alive.
    let walk = |ray: &Ray| unsafe { Walk::new(top.address(), ray) };
    let mut walks: Vec<_> = rays.iter().map(walk).collect();
    let mut together: Vec<_> = walks.iter_mut().collect();
    if !Walk::finish_together(&mut together, walker) {
        return false;
    }
    for (walk, ray) in walks.iter().zip(rays) {
        assert_eq!(
            walk.committed().copied(),
            closest_with(walker, top, ray),
            "{ray:?}"
        );
    }
    true
}

/// A sphere with coincident triangles, so that rays meet edges, vertices and ties.
fn mesh() -> Mesh {
    let (vertices, faces) = icosphere(3);
    let mut mesh = Mesh {
        vertices: vertices.into_iter().map(narrow).collect(),
        indices: faces.clone(),
        opaque: true,
    };
    mesh.indices
        .extend(faces.iter().step_by(3).map(|&[a, b, c]| [b, c, a]));
    mesh
}

/// Packets of all sizes, aimed at places on the mesh and at its vertices; how many could be done.
fn packets(scene: &Scene, mesh: &Mesh, place: impl Fn([f64; 3]) -> [f64; 3]) -> usize {
    let mut random = Random(0x1357_9BDF_0246_8ACE);
    let mut walker = Walker::new();
    let mut done = 0;
    for round in 0..600 {
        let from = random.direction().map(|c| 4.0 * c);
        let at = random.direction();
        let spread = 0.3 * random.next();
        let count = 1 + round % PACKET;
        let rays: Vec<_> = (0..count)
            .map(|i| {
                let aside = random.vector();
                let mut target: [f64; 3] =
                    std::array::from_fn(|axis| at[axis] + spread * aside[axis]);
                if i % 3 == 0 {
                    // The vertex nearest to it.
                    let distance = |v: &[f32; 3]| {
                        let away = sub(wide(*v), target);
                        dot(away, away)
                    };
                    let nearest = mesh
                        .vertices
                        .iter()
                        .min_by(|a, b| distance(a).total_cmp(&distance(b)));
                    target = wide(*nearest.expect("there are vertices"));
                }
                let origin = narrow(place(from));
                let mut ray = ray(origin, narrow(sub(place(target), wide(origin))));
                if i % 5 == 0 {
                    (ray.t_min, ray.t_max) = (0.8, 1.1);
                }
                ray
            })
            .collect();
        done += usize::from(compare(&mut walker, &scene.top, &rays));
    }
    done
}

#[test]
fn packets_find_what_single_walks_find() {
    let mesh = mesh();
    let meshes = std::slice::from_ref(&mesh);
    let done = packets(&Scene::new(meshes, 0), &mesh, |p| p);
    let turned = [
        0.0, -2.0, 0.0, 10.0, 1.5, 0.3, 0.0, -3.0, 0.0, 0.0, -0.7, 1.0,
    ];
    let place = |p: [f64; 3]| {
        std::array::from_fn(|row| {
            let m = &turned[4 * row..4 * row + 4];
            let turned = (0..3).map(|i| f64::from(m[i]) * p[i]).sum::<f64>();
            turned + f64::from(m[3])
        })
    };
    let done_turned = packets(&Scene::placed(meshes, 0, turned), &mesh, place);
    if Tier::best() == Tier::Avx512 {
        assert!(done > 100 && done_turned > 100, "{done} {done_turned}");
    }
}

#[test]
fn what_is_unusual_is_left_alone() {
    let mesh = mesh();
    let scene = Scene::new(std::slice::from_ref(&mesh), 0);
    let glass = Mesh {
        opaque: false,
        ..mesh
    };
    let open = Scene::new(std::slice::from_ref(&glass), 0);
    let mut walker = Walker::new();
    let down = ray([0.1, 0.2, 3.0], [0.01, 0.02, -1.0]);
    let mut apart = [down; PACKET];
    apart[3].direction = [0.5, 0.02, -1.0];
    assert!(!compare(&mut walker, &scene.top, &apart));
    let mut flagged = [down; PACKET];
    flagged[9].flags = ray_flags::CULL_BACK_FACING_TRIANGLES;
    assert!(!compare(&mut walker, &scene.top, &flagged));
    let mut endless = [down; PACKET];
    endless[15].direction[1] = f32::NAN;
    assert!(!compare(&mut walker, &scene.top, &endless));
    assert!(!compare(&mut walker, &open.top, &[down; PACKET]));
    assert!(!compare(&mut walker, &scene.top, &[]));
}
