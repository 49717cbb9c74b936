//! The cost of a ray by itself, expected from where primitives are.

use scenes::*;
use traversal::*;

fn cost(top: &Bytes, ray: &Ray, hit: Option<&Hit>) -> RayCost {
    // SAFETY: the structures are alive.
    unsafe { RayCosts::new(&mut Walker::new(), &EVERYWHERE).of(top.address(), ray, 0.0, hit) }
}

/// A triangle at a height, which rays along z at (0.25, 0.25) meet.
fn triangle(z: f32, opaque: bool) -> Mesh {
    Mesh {
        vertices: vec![[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]],
        indices: vec![[0, 1, 2]],
        opaque,
    }
}

fn up(x: f32) -> Ray {
    ray([x, 0.25, 0.0], [0.0, 0.0, 1.0])
}

#[test]
fn one_triangle_costs_a_node_and_a_leaf() {
    let scene = Scene::new(&[triangle(1.0, true)], 0);
    let hit = RayCost {
        steps: 2,
        box_tests: 1,
        primitive_tests: 1,
        ..RayCost::default()
    };
    assert_eq!(cost(&scene.top, &up(0.25), None), hit);
    // In the triangle's box, but not in the triangle.
    let ray = Ray {
        origin: [0.9, 0.9, 0.0],
        ..up(0.0)
    };
    assert_eq!(cost(&scene.top, &ray, None), hit);
    let beside = RayCost {
        steps: 1,
        box_tests: 1,
        ..RayCost::default()
    };
    assert_eq!(cost(&scene.top, &up(5.0), None), beside);
    let nowhere = [f32::NAN, f32::INFINITY].map(|x| cost(&scene.top, &up(x), None));
    assert_eq!(nowhere, [RayCost::default(); 2]);
}

#[test]
fn instances_are_leaves_of_the_top_level() {
    let bottom = build_meshes(&[triangle(1.0, true)], 0);
    let place = |x: f32| {
        let transform = [1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        InstanceRecord::new(&bottom, transform)
    };
    let top = build_instances(&[place(0.0), place(10.0)], 0);
    let one = RayCost {
        steps: 4,
        box_tests: 3,
        primitive_tests: 1,
        ..RayCost::default()
    };
    assert_eq!(cost(&top, &up(0.25), None), one);
    assert_eq!(cost(&top, &up(10.25), None), one);
    let between = RayCost {
        steps: 1,
        box_tests: 2,
        ..RayCost::default()
    };
    assert_eq!(cost(&top, &up(5.0), None), between);
}

#[test]
fn candidates_are_counted_as_far_as_the_hit() {
    let heights = [1.0, 2.0, 3.0];
    let scene = Scene::new(&heights.map(|z| triangle(z, false)), 0);
    let all = cost(&scene.top, &up(0.25), None);
    assert_eq!((all.any_hit_candidates, all.box_candidates), (3, 0));
    assert_eq!(all.primitive_tests, 3);
    // The first is the hit: the walk stops there at the latest, and asks about none behind it then.
    let first = Hit {
        triangle: true,
        ..Hit::NONE
    };
    let asked = cost(&scene.top, &up(0.25), Some(&first)).any_hit_candidates;
    assert!((1..=3).contains(&asked), "{asked}");

    let boxes = [
        [0.0, 0.0, 1.0, 1.0, 1.0, 2.0],
        [0.0, 0.0, 3.0, 1.0, 1.0, 4.0],
        [5.0, 0.0, 3.0, 6.0, 1.0, 4.0],
    ];
    let bottom = build_boxes(&boxes, false, 0);
    let identity = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let top = build_instances(&[InstanceRecord::new(&bottom, identity)], 0);
    let all = cost(&top, &up(0.25), None);
    assert_eq!((all.any_hit_candidates, all.box_candidates), (0, 2));
    let near = Hit {
        t: 1.5,
        ..Hit::NONE
    };
    assert_eq!(cost(&top, &up(0.25), Some(&near)).box_candidates, 1);
}

/// Visits of a walk that counts depend neither on the instruction set of its walker, nor on
/// shortcuts through opaque triangles, nor on the rays before.
#[test]
fn costs_are_the_same_on_every_machine() {
    let mut random = Random(7);
    let ball = |size: f64, opaque| Mesh::icosphere(3, opaque, |point| point * size);
    let one = Scene::new(&[ball(1.0, true)], 0);
    let two = Scene::new(&[ball(0.8, true), ball(1.0, false)], 0);
    let place = |x: f32, scale: f32| {
        let transform = [
            scale, 0.0, 0.0, x, 0.0, scale, 0.0, 0.0, 0.0, 0.0, scale, 0.0,
        ];
        InstanceRecord::new(&one.bottom, transform)
    };
    let many = build_instances(&[place(-2.0, 1.0), place(0.5, 0.5), place(2.0, 3.0)], 0);
    for top in [&one.top, &two.top, &many] {
        let rays = (0..300).map(|index| Ray {
            flags: match index % 3 {
                0 => ray_flags::TERMINATE_ON_FIRST_HIT,
                _ => 0,
            },
            ..ray(narrow(random.vector() * 3.0), narrow(random.direction()))
        });
        let rays: Vec<Ray> = rays.collect();
        let hits: Vec<_> = rays.iter().map(|ray| closest(top, ray)).collect();
        let of = |options| {
            let mut walker = Walker::with(options)?;
            // SAFETY: the scene is alive.
            let mut costs = unsafe { RayCosts::new(&mut walker, &EVERYWHERE) };
            let cost = |(ray, hit): (&Ray, &Option<Hit>)| unsafe {
                costs.of(top.address(), ray, 0.0, hit.as_ref())
            };
            Some(rays.iter().zip(&hits).map(cost).collect::<Vec<_>>())
        };
        let best = of(Options::default()).expect("the best tier is there");
        let portable = Options {
            tier: Tier::Portable,
            ..Options::default()
        };
        assert_eq!(of(portable).as_ref(), Some(&best));
        let plain = Options {
            without: [Specialisation::Opaque].into_iter().collect(),
            ..Options::default()
        };
        assert_eq!(of(plain).as_ref(), Some(&best));
        let alone: Vec<RayCost> = (rays.iter().zip(&hits))
            .map(|(ray, hit)| cost(top, ray, hit.as_ref()))
            .collect();
        assert_eq!(alone, best);
        let is_met =
            |(hit, cost): (&Option<Hit>, &RayCost)| hit.is_none() || cost.primitive_tests > 0;
        assert!(hits.iter().zip(&best).all(is_met));
    }
}

/// Rays that walk to their ends while they are counted have the hits of other walks and the costs
/// of walks that are for these alone. Those that meet candidates are left.
#[test]
fn rays_are_counted_while_they_walk() {
    let mut random = Random(11);
    let ball = |size: f64, opaque| Mesh::icosphere(2, opaque, |point| point * size);
    let opaque = Scene::new(&[ball(1.0, true)], 0);
    let mixed = Scene::new(&[ball(0.5, true), ball(0.9, false)], 0);
    let place = |x: f32| {
        let transform = [1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        InstanceRecord::new(&opaque.bottom, transform)
    };
    let many = build_instances(&[place(-1.5), place(0.0), place(1.5)], 0);
    let (mut left, mut walked) = (0, 0);
    for top in [&opaque.top, &mixed.top, &many] {
        let mut walker = Walker::new();
        // SAFETY: the scene is alive, here and below.
        let mut costs = unsafe { RayCosts::new(&mut walker, &EVERYWHERE) };
        let mut group_walk = GroupWalk::default();
        for _ in 0..30 {
            let (mut rows, mut rays) = (RayRows::NONE, Vec::new());
            for lane in 0..PACKET {
                let origin = narrow(random.vector() * 3.0);
                let ray = ray(origin, narrow(random.direction()));
                rows.set(lane, top.address(), &ray, 0.0);
                rays.push(ray);
            }
            let mut found = [RayCost::default(); PACKET];
            let lanes = LaneMask::ALL - LaneMask::of(3);
            let over = unsafe { costs.walk_to_ends(&rows, lanes, &mut group_walk, &mut found) };
            assert!(!over.contains(3));
            for lane in lanes {
                let (ray, hit) = (&rays[lane], closest(top, &rays[lane]));
                let meets = cost(top, ray, None).any_hit_candidates > 0;
                assert_eq!(over.contains(lane), !meets);
                if meets {
                    left += 1;
                    continue;
                }
                walked += usize::from(hit.is_some());
                assert_eq!(found[lane], cost(top, ray, hit.as_ref()));
                let bits = |hit: Option<Hit>| hit.map(|hit| (hit.t.to_bits(), hit));
                assert_eq!(bits(group_walk.hits.get(lane)), bits(hit));
            }
        }
    }
    assert!(left > 20 && walked > 50, "{left} and {walked}");
}
