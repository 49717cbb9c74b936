//! Structures of little memory, whose leaves share vertices, find what others find, bit for bit.

use scenes::*;
use traversal::*;

const FLAGS: [u32; 6] = [
    0,
    ray_flags::OPAQUE,
    ray_flags::NO_OPAQUE,
    ray_flags::CULL_BACK_FACING_TRIANGLES,
    ray_flags::CULL_OPAQUE,
    ray_flags::TERMINATE_ON_FIRST_HIT,
];

/// A sphere whose triangles share vertices, some twice, of two geometries that are mixed
/// everywhere.
fn shared(opaque: [bool; 2]) -> Vec<Mesh> {
    let (vertices, faces) = icosphere(3);
    let vertices: Vec<[f32; 3]> = vertices.into_iter().map(narrow).collect();
    let part = |start: usize, opaque| Mesh {
        vertices: vertices.clone(),
        indices: faces.iter().skip(start).step_by(2).copied().collect(),
        opaque,
    };
    let mut parts = vec![part(0, opaque[0]), part(1, opaque[1])];
    let twice: Vec<_> = faces
        .iter()
        .step_by(5)
        .map(|&[a, b, c]| [b, c, a])
        .collect();
    parts[0].indices.extend(twice);
    parts
}

/// Triangles that share nothing, and some that are points and lines.
fn apart() -> Vec<Mesh> {
    let mut random = Random(0x0F0F_1234_5678_9ABC);
    let vertices: Vec<[f32; 3]> = (0..900).map(|_| narrow(random.vector())).collect();
    let mut indices: Vec<[u32; 3]> = (0..300).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    indices.extend((0..20).map(|i| [i, i, 40 * i]));
    indices.extend([[7, 7, 7]; 20]);
    vec![Mesh {
        vertices,
        indices,
        opaque: false,
    }]
}

fn rays(meshes: &[Mesh]) -> Vec<Ray> {
    let mut random = Random(0x1357_9BDF_0246_8ACE);
    (0..1500)
        .map(|i| {
            let from = 3.0 * random.direction();
            // At vertices, and anywhere.
            let vertices = &meshes[i % meshes.len()].vertices;
            let at = match i % 3 {
                0 => wide(vertices[(random.unit() * vertices.len() as f64) as usize]),
                _ => 0.8 * random.vector(),
            };
            let mut ray = ray(narrow(from), narrow(at - from));
            ray.flags = FLAGS[i % FLAGS.len()];
            ray
        })
        .collect()
}

/// Clears the location of the primitive.
fn without_slot(hit: Hit) -> Hit {
    Hit { slot: 0, ..hit }
}

fn tiers() -> Vec<Tier> {
    let all = [Tier::Portable, Tier::Avx2, Tier::Avx512];
    let there = |&tier: &Tier| Walker::with_tier(tier).is_some();
    all.into_iter().filter(there).collect()
}

#[test]
fn hits_are_those_of_other_builds() {
    let opaque = [[true, true], [true, false], [false, false]];
    let scenes = opaque.map(shared).into_iter().chain([apart()]);
    for meshes in scenes {
        let rays = rays(&meshes);
        let full = Scene::new(&meshes, 0);
        let small = Scene::new(&meshes, BuildFlags::LOW_MEMORY);
        let size = |scene: &Scene| compacted_size(&scene.bottom).unwrap();
        assert!(size(&small) < size(&full));
        for tier in tiers() {
            let mut walker = Walker::with_tier(tier).unwrap();
            for ray in &rays {
                let expected = closest_with(&mut walker, &full.top, ray);
                let found = closest_with(&mut walker, &small.top, ray);
                if ray.flags & ray_flags::TERMINATE_ON_FIRST_HIT != 0 {
                    assert_eq!(found.is_some(), expected.is_some(), "{ray:?}");
                } else if [found, expected].iter().flatten().all(|hit| hit.opaque) {
                    assert_eq!(
                        found.map(without_slot),
                        expected.map(without_slot),
                        "{tier:?} {ray:?}"
                    );
                } else {
                    // Of coincident ones, any may be asked about first.
                    let t = |hit: Option<Hit>| hit.map(|hit| hit.t);
                    assert_eq!(t(found), t(expected), "{tier:?} {ray:?}");
                }
            }
        }
        for ray in &rays {
            let sorted = |top: &Bytes| {
                let mut found: Vec<_> = candidates(top, ray)
                    .iter()
                    .map(|hit| (hit.geometry_index, hit.primitive_index, hit.t.to_bits()))
                    .collect();
                found.sort_unstable();
                found
            };
            let plain = ray.flags & ray_flags::TERMINATE_ON_FIRST_HIT == 0;
            if plain && ray.flags & ray_flags::OPAQUE == 0 && !meshes.iter().any(|m| m.opaque) {
                assert_eq!(sorted(&small.top), sorted(&full.top), "{ray:?}");
            }
        }
    }
}

#[test]
fn vertices_of_hits_are_those_that_were_given() {
    let meshes = shared([true, false]);
    let small = Scene::new(&meshes, BuildFlags::LOW_MEMORY);
    // SAFETY: the structures are alive.
    let top = unsafe { Structure::at(small.top.address(), &EVERYWHERE) }.unwrap();
    let mut found = 0;
    for ray in rays(&meshes) {
        let Some(hit) = closest(&small.top, &ray) else {
            continue;
        };
        let triangle = meshes[hit.geometry_index as usize].triangle(hit.primitive_index as usize);
        assert_eq!(top.triangle_vertices(&hit, &EVERYWHERE), triangle);
        let unknown = Hit {
            slot: Hit::UNKNOWN_SLOT,
            ..hit
        };
        assert_eq!(top.triangle_vertices(&unknown, &EVERYWHERE), triangle);
        found += 1;
    }
    assert!(found > 500);
}

#[test]
fn corrupt_blocks_are_refused_or_walked_without_harm() {
    let meshes = shared([true, false]);
    let mut random = Random(0x1122_3344_5566_7788);
    let rays = rays(&meshes);
    let small = Scene::new(&meshes, BuildFlags::LOW_MEMORY);
    let good = small.bottom.to_vec();
    let mut scene = small;
    let mut refused = 0;
    for ray in &rays[..400] {
        scene.bottom.copy_from_slice(&good);
        for _ in 0..8 {
            // Behind the header, and rather in leaves than in nodes.
            let place = 256 + (random.unit().sqrt() * (good.len() - 256) as f64) as usize;
            scene.bottom[place] = (random.unit() * 256.0) as u8;
        }
        refused += usize::from(validate(&scene.bottom).is_err());
        for tier in tiers() {
            closest_with(&mut Walker::with_tier(tier).unwrap(), &scene.top, ray);
        }
    }
    assert!(refused > 0);
}
