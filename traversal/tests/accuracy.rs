//! How exact hits are: distances and weights against f64, in the middle of well-shaped triangles.

use scenes::exact;
use scenes::*;

/// The greatest errors of t, in units in its last place, and of the weights, in 2⁻²⁴, and the
/// number of hits they are of.
fn errors(scale: f64, offset: DVec3, rays: usize) -> (f64, f64, usize) {
    let mesh = Mesh::icosphere(4, true, |p| p * scale + offset);
    let scene = Scene::new(std::slice::from_ref(&mesh), 0);
    let mut walker = traversal::Walker::new();
    let mut random = Random(0x1234_5678_9ABC_DEF1);
    let (mut t_error, mut weight_error, mut count) = (0f64, 0f64, 0);
    for _ in 0..rays {
        let index = (random.unit() * mesh.indices.len() as f64) as usize;
        let triangle = mesh.triangle(index);
        let (mut u, mut v) = (0.02 + 0.96 * random.unit(), 0.02 + 0.96 * random.unit());
        if u + v > 0.98 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let [a, b, c] = triangle.map(wide);
        let target = a * (1.0 - u - v) + b * u + c * v;
        let normal = normalize(target - offset);
        let tilt = random.direction();
        let from = normalize(normal * 0.9 + tilt * 0.6);
        let origin = narrow(target + 2.0 * scale * from);
        let direction = target - wide(origin);
        // Hits far from t = 1 too, and directions that are not normalised.
        let length = 0.3 + random.unit();
        let ray = ray(origin, narrow(direction * length / scale));
        let (t, u, v, inside) = reference(&ray, &triangle);
        if inside < 0.01 {
            continue;
        }
        let hit = closest_with(&mut walker, &scene.top, &ray).expect("the sphere is closed");
        if hit.primitive_index as usize != index {
            continue;
        }
        count += 1;
        let unit = f64::from((t as f32).next_up()) - f64::from(t as f32);
        t_error = t_error.max((f64::from(hit.t) - t).abs() / unit);
        for (found, expected) in hit.barycentrics.into_iter().zip([u, v]) {
            let error = (f64::from(found) - expected).abs() * f64::from(1u32 << 24);
            weight_error = weight_error.max(error);
        }
    }
    (t_error, weight_error, count)
}

#[test]
fn interior_hits_are_within_few_units() {
    for (scale, translation) in [
        (1.0, 0.0),
        (1e-3, 0.0),
        (1e3, 0.0),
        (1e6, 0.0),
        (1.0, 1e4),
        (1e3, 1e4),
        (1e3, 1e7),
        (1e6, 1e7),
        (1e-30, 0.0),
        (1e30, 0.0),
    ] {
        let offset = translation * DVec3::new(1.0, 1.3, 0.7);
        let (t, weights, count) = errors(scale, offset, 20_000);
        println!("{scale:e} {translation:e}: t {t:.3} ULP, weights {weights:.3} of 2⁻²⁴, {count}");
        assert!(count > 10_000, "{scale:e} {translation:e}: {count}");
        assert!(t <= 2.5, "{scale:e} {translation:e}: {t} ULP");
        assert!(weights <= 50.0, "{scale:e} {translation:e}: {weights}");
    }
}

/// A triangle that is met at a small share of what its vertices are away, and nearly along its
/// plane.
#[test]
fn a_near_hit_of_a_far_triangle_is_exact() {
    let bits = |v: [u32; 3]| v.map(f32::from_bits);
    let triangle = [
        bits([0xbf74_0000, 0xbf1c_0000, 0xbf21_0000]),
        bits([0xbf60_0000, 0x3e80_0000, 0xbec0_0000]),
        bits([0x3e40_0000, 0, 0x3dc0_0000]),
    ];
    let ray = ray(
        bits([0x3c2e_45b7, 0xbda7_d818, 0xbcd6_3a75]),
        bits([0xc06b_8ce3, 0x409b_948e, 0x4014_daa4]),
    );
    let truth = exact::intersect(&ray, &triangle).expect("the line meets it");
    let mesh = Mesh {
        vertices: triangle.to_vec(),
        indices: vec![[0, 1, 2]],
        opaque: true,
    };
    let scene = Scene::new(std::slice::from_ref(&mesh), 0);
    let hit = closest(&scene.top, &ray).expect("it is hit");
    let unit = f64::from((truth.t as f32).next_up()) - f64::from(truth.t as f32);
    let off = (f64::from(hit.t) - truth.t).abs() / unit;
    assert!(off <= 3.5, "{off} ULP");
    for (found, expected) in hit.barycentrics.into_iter().zip(truth.weights) {
        let off = (f64::from(found) - expected).abs() * f64::from(1u32 << 24);
        assert!(off <= 75.0, "{off} of 2⁻²⁴");
    }
}
