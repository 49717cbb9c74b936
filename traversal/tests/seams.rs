//! A seam between two instances that coincides in world space: what rays lose there stays within a
//! bound.
//!
//! Rays by the count of the environment's RAYS, for each distance.

use scenes::*;

fn count() -> usize {
    let given = std::env::var("RAYS").ok();
    let usual = || effort::rounds(20_000) as usize;
    given.map_or_else(usual, |count| count.parse().expect("RAYS is a number"))
}

/// 2⁻²⁴.
const UNIT: f64 = 1.0 / (1 << 24) as f64;

/// Rigid transforms, except for a factor, of integers, with inverses that are not exact in f32:
/// rows.
const TURNS: [DMat3; 2] = [
    DMat3::from_cols_array_2d(&[[2.0, 1.0, 2.0], [-2.0, 2.0, 1.0], [-1.0, -2.0, 2.0]]),
    DMat3::from_cols_array_2d(&[[2.0, 3.0, 6.0], [3.0, -6.0, 2.0], [6.0, 2.0, -3.0]]),
];

/// Half a plane each: triangles in the space of an instance, placed so that one edge of both is the
/// same in the world.
fn halves() -> ([Bytes; 2], Bytes) {
    // Multiples of 9 and of 49, so that object space has whole numbers, too.
    let world = [[0.0, -882.0, 441.0], [0.0, 882.0, 441.0]];
    let mut bottoms = Vec::new();
    for (turn, side) in TURNS.into_iter().zip([-882.0, 882.0]) {
        // The inverse is the transpose over the square of the factor.
        let square = turn.x_axis.length_squared();
        let corners = [world[0], world[1], [side, 0.0, 441.0]].map(|corner| {
            let object = turn * DVec3::from(corner) / square;
            assert_eq!(turn.transpose() * object, corner.into());
            narrow(object)
        });
        bottoms.push(build_meshes(
            &[Mesh {
                vertices: corners.to_vec(),
                indices: vec![[0, 1, 2]],
                opaque: true,
            }],
            0,
        ));
    }
    let records: Vec<_> = bottoms
        .iter()
        .zip(TURNS)
        .map(|(bottom, turn)| {
            let rows = turn.to_cols_array_2d().map(|row| {
                let [x, y, z] = narrow(row);
                [x, y, z, 0.0]
            });
            InstanceRecord::new(bottom, rows.concat().try_into().expect("three of four"))
        })
        .collect();
    let top = build_instances(&records, 0);
    (bottoms.try_into().ok().expect("two"), top)
}

#[test]
fn what_a_seam_loses_is_bounded() {
    let (_bottoms, top) = halves();
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    for distance in [1.0, 30.0, 1000.0] {
        let (mut lost, mut lost_by_rounding, mut widest) = (0, 0, 0f64);
        for _ in 0..count() {
            let aim = DVec3::new(0.0, 400.0 * random.signed(), 441.0);
            let mut away = random.direction();
            away[2] = away[2].signum() * (0.3 + away[2].abs());
            let origin = narrow(aim + distance * away);
            let direction = narrow(aim - wide(origin));
            let ray = ray(origin, direction);
            // Where the ray that was given meets the plane.
            let (o, d) = (wide(origin), wide(direction));
            let t = (441.0 - o[2]) / d[2];
            let beside = (o[0] + t * d[0]).abs();
            if closest(&top, &ray).is_some() {
                continue;
            }
            lost += 1;
            lost_by_rounding += usize::from(beside > UNIT * UNIT);
            widest = widest.max(beside);
            let [far, long] = [o.length(), t * d.length()];
            // Seen along the plane, a move across the ray is longer.
            let slant = d.length() / d.z.abs();
            let bound = 3f64.sqrt() * UNIT * (5.0 * far + 4.0 * long) * slant;
            assert!(beside <= bound, "{beside} {bound} {ray:?}");
        }
        println!(
            "from {distance}: {lost} lost, {lost_by_rounding} of them beside the seam, by {widest:.1e} at most"
        );
    }
}
