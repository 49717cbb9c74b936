//! Closed meshes whose faces reach far: whatever the proportions, no ray leaves them unseen.
//!
//! `cargo xtask watertight` sends more rays at them.

use scenes::closed::{self, FAMILIES, LENGTHS, PLACEMENTS, cuboid, faults};
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
