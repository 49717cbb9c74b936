//! Rays that are traced together or in turn find what each finds by itself, bit for bit.

use scenes::groups::Groups;
use scenes::*;
use traversal::*;

/// Traces rays together, in turn and one by one; returns whether the first could be done. Lanes
/// that take no part stay as they are.
fn compare(walker: &mut Walker, top: &Bytes, rays: &[Ray]) -> bool {
    // With few rays some lanes are left out, the first among them.
    let apart = if 2 * rays.len() < PACKET { 2 } else { 1 };
    let lane_of = |i: usize| (i * apart + apart - 1) % PACKET;
    let lanes: LaneMask = (0..rays.len()).map(lane_of).collect();
    let mut rows = RayRows::NONE;
    rows.origin[0] = [f32::NAN; PACKET];
    for (i, ray) in rays.iter().enumerate() {
        rows.set(lane_of(i), top.address(), ray, 0.0);
    }
    let other = Hit {
        t: 7.0,
        primitive_index: 77,
        ..Hit::default()
    };
    let mut trace = |in_turn: bool| {
        let (mut waits, before) = (false, walker.counts().together);
        let groups = vec![(rows.clone(), lanes)];
        let groups = Groups::of_rows(groups, |_: &RayRows, _: &mut GroupWalk| waits = true);
        let mut groups = groups.with(|start| {
            (start.shows_order, start.shows_first_hit) = (true, in_turn);
        });
        for lane in 0..PACKET {
            groups.group_walks[0].hits.set(lane, &other);
        }
        // SAFETY: the structures are alive.
        unsafe { groups.trace(walker, 1) };
        let hits = groups.group_walks.remove(0).hits;
        drop(groups);
        for lane in !lanes {
            assert_eq!(hits.get(lane), Some(other));
        }
        let done = walker.counts().together != before;
        for (i, ray) in rays.iter().enumerate().filter(|_| !waits) {
            let found = hits.get(lane_of(i));
            let expected = closest_with(walker, top, ray);
            if ray.flags & ray_flags::TERMINATE_ON_FIRST_HIT != 0 {
                // Which hit comes first is open.
                assert_eq!(found.is_some(), expected.is_some(), "{ray:?}");
                continue;
            }
            assert_eq!(found, expected, "{ray:?}");
            if found.is_none() {
                assert_eq!(hits.t[lane_of(i)], ray.t_max);
            }
        }
        done
    };
    assert!(!trace(true));
    trace(false)
}

/// A sphere with coincident triangles, so that rays meet edges, vertices and ties.
fn mesh() -> Mesh {
    let mut mesh = Mesh::icosphere(3, true, |p| p);
    let faces = mesh.indices.clone();
    let thirds = faces.iter().step_by(3);
    mesh.indices.extend(thirds.map(|&[a, b, c]| [b, c, a]));
    mesh
}

/// Packets of all sizes, aimed at places on the mesh and at its vertices; how many could be done.
fn packets(scene: &Scene, mesh: &Mesh, place: impl Fn(DVec3) -> DVec3) -> usize {
    let mut random = Random(0x1357_9BDF_0246_8ACE);
    let mut walker = Walker::new();
    let mut done = 0;
    for round in 0..effort::rounds(600) as usize {
        let from = 4.0 * random.direction();
        let at = random.direction();
        let spread = 0.3 * random.unit();
        let count = 1 + round % PACKET;
        let rays: Vec<_> = (0..count)
            .map(|i| {
                let aside = random.vector();
                let mut target = at + spread * aside;
                if i % 3 == 0 {
                    // The vertex nearest to it.
                    let distance = |v: &[f32; 3]| (wide(*v) - target).length_squared();
                    let nearest = mesh
                        .vertices
                        .iter()
                        .min_by(|a, b| distance(a).total_cmp(&distance(b)));
                    target = wide(*nearest.expect("there are vertices"));
                }
                let origin = narrow(place(from));
                let mut ray = ray(origin, narrow(place(target) - wide(origin)));
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
    let place = |p| apply(&turned, p, 1.0);
    let small = BuildFlags::LOW_MEMORY;
    let done_turned = packets(&Scene::placed(meshes, 0, turned), &mesh, place).min(packets(
        &Scene::placed(meshes, small, turned),
        &mesh,
        place,
    ));
    if Tier::best() == Tier::Avx512 {
        assert!(done > 100 && done_turned > 100, "{done} {done_turned}");
    }
}

/// Instances turned in all ways, some in the same place; rays of one tile, some of them shadow
/// rays.
#[test]
fn packets_go_through_many_instances() {
    let mesh = mesh();
    let bottom = build_meshes(std::slice::from_ref(&mesh), 0);
    let mut random = Random(0x8ACE_1357_9BDF_0246);
    let mut instances = Vec::new();
    for i in 0..60 {
        let mut transform = IDENTITY;
        if i % 7 != 0 {
            let [x, y, z] = [0.4, 0.7, 0.3].map(|c: f64| c * random.signed());
            let columns = [[1.0, x, y], [-x, 0.8, z], [-y, -z, 1.2]];
            for (row, column) in columns.iter().enumerate() {
                for (i, c) in column.iter().enumerate() {
                    transform[4 * row + i] = (0.4 * c) as f32;
                }
            }
        }
        let at = random.vector();
        for (axis, at) in at.to_array().into_iter().enumerate() {
            transform[4 * axis + 3] = (5.0 * at) as f32;
        }
        instances.push(InstanceRecord::new(&bottom, transform));
        if i % 5 == 0 {
            instances.push(InstanceRecord::new(&bottom, transform));
        }
    }
    instances[3].custom_index_and_mask = 0x0100_0000;
    let top = build_instances(&instances, 0);
    let mut walker = Walker::new();
    let (mut done, mut hits) = (0, 0);
    for round in 0..effort::rounds(500) as usize {
        let from = 9.0 * random.direction();
        let at = 5.0 * random.vector();
        let spread = 0.5 * random.unit();
        let apart = [0.0, 0.05][round / 2 % 2];
        let rays: Vec<_> = (0..6 + round % 11)
            .map(|_| {
                let (aside, moved) = (random.vector(), random.vector());
                let origin = from + apart * moved;
                let target = at + spread * aside;
                let mut ray = ray(narrow(origin), narrow(target - origin));
                ray.cull_mask = [0xFF, 0xFE][round % 2];
                if round % 3 == 0 {
                    ray.flags = ray_flags::TERMINATE_ON_FIRST_HIT;
                    ray.t_max = 0.9;
                }
                ray
            })
            .collect();
        if compare(&mut walker, &top, &rays) {
            done += 1;
            hits += rays
                .iter()
                .filter(|ray| closest(&top, ray).is_some())
                .count();
        }
    }
    if Tier::best() == Tier::Avx512 {
        assert!(done > 200 && hits > 1000, "{done} {hits}");
    }
}

/// Where the axes of a tile's rays, or the signs of their directions, differ, each way is a packet
/// by itself: in a top level of one instance, turned or not, and of many.
#[test]
fn rays_of_a_tile_that_go_several_ways_walk_together() {
    let mesh = mesh();
    let bottom = build_meshes(std::slice::from_ref(&mesh), 0);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let turned = [0.8, -0.6, 0.0, 0.0, 0.6, 0.8, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let at = |transform: [f32; 12], x: f32| {
        let mut transform = transform;
        transform[3] = x;
        InstanceRecord::new(&bottom, transform)
    };
    let tops = [
        build_instances(&[at(IDENTITY, 0.0)], 0),
        build_instances(&[at(turned, 0.0)], 0),
        build_instances(&[-2.5, 0.0, 2.5].map(|x| at(IDENTITY, x)), 0),
    ];
    let mut walker = Walker::new();
    // In the middle of a picture; along a diagonal, where two components are as long.
    for (forward, right) in [
        ([0.0, 0.0, -1.0], [1.0, 0.0, 0.0]),
        ([-half, 0.013, -half], [half, 0.0, -half]),
    ] {
        let origin = forward.map(|c: f32| -4.0 * c);
        for lanes in [16, 7] {
            let rays: Vec<_> = (0..lanes)
                .map(|i| {
                    let [x, y] = [i % 4, i / 4].map(|place| (place as f32 - 1.5) * 0.02);
                    let mut direction = [0, 1, 2].map(|axis| forward[axis] + x * right[axis]);
                    direction[1] += y;
                    ray(origin, direction)
                })
                .collect();
            for (i, top) in tops.iter().enumerate() {
                assert!(compare(&mut walker, top, &rays), "{forward:?} {lanes} {i}");
            }
        }
    }
}

#[test]
fn what_is_unusual_is_left_alone() {
    let mesh = mesh();
    let scene = Scene::new(std::slice::from_ref(&mesh), 0);
    let non_opaque = Mesh {
        opaque: false,
        ..mesh
    };
    let open = Scene::new(std::slice::from_ref(&non_opaque), 0);
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

/// Every ray of a list stops where it stops by itself, whatever the rays before it were.
#[test]
fn rays_in_turn_are_rays_by_themselves() {
    let opaque = mesh();
    let non_opaque = Mesh {
        opaque: false,
        ..mesh()
    };
    let scenes = [&opaque, &non_opaque].map(|mesh| Scene::new(std::slice::from_ref(mesh), 0));
    // Many instances, opaque ones first; every fifth is not opaque.
    let bottoms = [&opaque, &non_opaque].map(|mesh| build_meshes(std::slice::from_ref(mesh), 0));
    let instances: Vec<_> = (0..40)
        .map(|i| {
            let mut transform = IDENTITY;
            for axis in 0..3 {
                transform[5 * axis] = 0.3;
                transform[4 * axis + 3] = ((i >> (2 * axis)) & 3) as f32 - 1.5;
            }
            InstanceRecord::new(&bottoms[usize::from(i % 5 == 4)], transform)
        })
        .collect();
    let many = build_instances(&instances, 0);
    let tops = [&scenes[0].top, &scenes[1].top, &many];
    let mut random = Random(0x0246_8ACE_1357_9BDF);
    let rays: Vec<_> = (0..400)
        .map(|i| {
            let from = 3.0 * random.direction();
            let mut ray = ray(narrow(from), narrow(random.vector() - from));
            ray.flags = [0, ray_flags::TERMINATE_ON_FIRST_HIT, ray_flags::OPAQUE][i % 3];
            ray.cull_mask = if i % 11 == 0 { 0 } else { 0xFF };
            (ray, i / 40 % 3)
        })
        .collect();
    for tier in Tier::ALL.into_iter().filter(|tier| tier.is_available()) {
        let options = Options {
            tier,
            fuel: 300,
            ..Options::default()
        };
        let mut walker = Walker::with(options).expect("it is available");
        for rays in rays.chunks(PACKET) {
            compare_in_turn(&mut walker, &tops, rays);
        }
    }
}

/// Candidates are ignored, then accepted, and so on, of every other ray at a time; rays run out of
/// fuel now and then.
fn compare_in_turn(walker: &mut Walker, tops: &[&Bytes], rays: &[(Ray, usize)]) {
    let mut rows = RayRows::NONE;
    for (lane, (ray, which)) in rays.iter().enumerate() {
        rows.set(lane, tops[*which].address(), ray, 0.0);
    }
    let lanes = LaneMask::full(rays.len());
    // SAFETY: the structures are alive.
    let mut alone = [0; PACKET].map(|_| unsafe { Walk::new(0, &Ray::default()) });
    for (walk, (ray, which)) in alone.iter_mut().zip(rays) {
        // SAFETY: the structures are alive.
        unsafe { walk.restart(tops[*which].address(), ray) };
    }
    let mut other = Walker::new();
    let mut verdicts = [Verdict::Continue; PACKET];
    let mut round = 0;
    let decide = |_: &RayRows, group_walk: &mut GroupWalk| {
        round += 1;
        let held = LaneMask::from_bits([0, 0x5555, 0, 0xAAAA][round % 4]);
        let held = held & group_walk.candidates().found;
        group_walk.hold(held);
        for lane in group_walk.candidates().found - held {
            let event = alone[lane].resume(&mut other, verdicts[lane], &mut { u64::MAX });
            assert_eq!(event, Event::AnyHitCandidate);
            assert_eq!(group_walk.candidates().hit(lane), *alone[lane].candidate());
            verdicts[lane] = match verdicts[lane] {
                Verdict::Continue => Verdict::Accept,
                _ => Verdict::Continue,
            };
            if verdicts[lane] == Verdict::Accept {
                group_walk.accept(LaneMask::of(lane));
            }
        }
    };
    let groups = Groups::of_rows(vec![(rows, lanes)], decide);
    let mut groups = groups.with(|start| start.shows_order = true);
    // SAFETY: the structures are alive.
    unsafe { groups.trace(walker, 1) };
    let found = groups.found(rays.len());
    drop(groups);
    for (lane, found) in found.into_iter().enumerate() {
        let event = alone[lane].resume(&mut other, verdicts[lane], &mut { u64::MAX });
        assert_eq!(event, Event::Done);
        let first_hits = rays[lane].0.flags & ray_flags::TERMINATE_ON_FIRST_HIT != 0;
        match first_hits {
            // Which hit comes first is open where rays walk together.
            true => assert_eq!(found.is_some(), alone[lane].committed().is_some()),
            false => assert_eq!(found, alone[lane].committed().copied()),
        }
    }
}
