//! Meshes whose faces reach far: whatever the proportions, no ray leaves closed ones unseen, and
//! each meets what whole numbers say.
//!
//! `cargo xtask watertight` sends more rays at them.

use scenes::closed::{self, FAMILIES, LENGTHS, PLACEMENTS, cuboid, faults};
use scenes::surface::Surface;
use scenes::ways::all_ways;
use scenes::*;

/// Rays for each mesh, length, placement and side.
const COUNT: usize = 400;

fn assert_closed(families: impl Iterator<Item = &'static closed::Family>) {
    let mut wrong = Vec::new();
    for family in families {
        for length in LENGTHS {
            for placement in &PLACEMENTS {
                for inside in [true, false] {
                    let seed = 0x2545_F491_4F6C_DD1D;
                    let faults = faults(family, length, placement, inside, seed, COUNT);
                    // Some meshes have no place far enough from their faces at some lengths.
                    let is_exact = ["identity", "mirrored"].contains(&placement.name);
                    assert!(
                        faults.rays > 0 || !is_exact,
                        "{} {length}: no rays",
                        family.name
                    );
                    if !faults.none() {
                        let side = if inside { "inside" } else { "outside" };
                        let placement = placement.name;
                        wrong.push(format!(
                            "{} {length} {placement} {side}: {faults:?}",
                            family.name
                        ));
                    }
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn convex_meshes_are_closed() {
    assert_closed(FAMILIES.iter().take(8));
}

#[test]
fn other_meshes_are_closed() {
    assert_closed(FAMILIES.iter().skip(8));
}

/// The checks above are quick, as f64 answers if it is certain. Integer arithmetic agrees.
#[test]
fn quick_answers_are_exact() {
    for family in FAMILIES {
        for length in LENGTHS {
            for inside in [true, false] {
                let wrong = closed::misjudged(family, length, inside, 0x1234_5678_9ABC_DEF1, 12);
                assert_eq!(wrong, 0, "{} {length}", family.name);
            }
        }
    }
    // Triangles through rays and in their planes, as large and as small as numbers are.
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let [mut certain, mut asked] = [0; 2];
    for i in 0..3000 {
        let scale = 10f64.powf([0.0, 30.0, -30.0][i % 3] * random.unit());
        let mut point = |range: f64, scale: f64| -> [f32; 3] {
            [0; 3].map(|_| ((random.signed() * range).round() * scale) as f32)
        };
        let mut mesh = Mesh {
            vertices: (0..6).map(|_| point(6.0, scale)).collect(),
            indices: (0..4).map(|k| [k, (k + 1) % 6, (k + 2) % 6]).collect(),
            opaque: true,
        };
        let origin = point(6.0, scale);
        // At a vertex, at the middle of an edge, or anywhere.
        let [p, q] = [i, i + i / 3 % 2].map(|k| mesh.vertices[k % 6]);
        let aim: [f32; 3] = std::array::from_fn(|k| p[k] - origin[k] + (q[k] - origin[k]));
        let mut ray = ray(origin, if i % 4 < 3 { aim } else { point(4.0, 1.0) });
        if ray.direction == [0.0; 3] {
            continue;
        }
        // Off that by a few of the last bits.
        let numbers = mesh.vertices.iter_mut().flatten();
        for number in numbers.chain(&mut ray.origin).chain(&mut ray.direction) {
            if i % 2 == 0 && random.unit() < 0.3 {
                *number = f32::from_bits(number.to_bits() ^ (random.unit() * 4.0) as u32);
            }
        }
        let met = Surface::new(&mesh).intersect(&ray);
        assert!(
            closed::is_exactly(&met, &mesh, &ray),
            "{met:?} {mesh:?} {ray:?}"
        );
        certain += usize::from(met.asked == 0 && met.crossings > 0);
        asked += usize::from(met.asked > 0);
    }
    assert!(certain > 100 && asked > 500, "{certain} {asked}");
}

/// A ray in a cube 95 wide, less than one away from what it meets.
#[test]
fn a_wall_is_met_beside_its_edge() {
    let bits = f32::from_bits;
    let size = f64::from(bits(0x42bf_0062));
    let mesh = cuboid([size; 3]);
    let scene = Scene::new(std::slice::from_ref(&mesh), 0);
    let ray = ray(
        [0x424c_5180, 0x3eb5_b2f4, 0x3f16_268b].map(bits),
        [0x3fb8_ff35, 0xbeb5_b306, 0xbf16_2683].map(bits),
    );
    for (way, hits) in all_ways(&scene.top, &[ray; 16]) {
        for hit in hits {
            let hit = hit.unwrap_or_else(|| panic!("{way}: nothing is met"));
            assert_eq!(
                mesh.indices[hit.primitive_index as usize],
                [0, 1, 5],
                "{way}"
            );
            assert_eq!(hit.t, 0.999_998_5, "{way}");
        }
    }
}
