//! Rays that walk together and stop for candidates find what each finds by itself.

use scenes::decisions::{counts, inside};
use scenes::groups::Groups;
use scenes::*;
use traversal::*;

/// A top level, and the boxes of its instances that hold boxes.
struct PacketScene {
    top: Bytes,
    boxes: Vec<[f32; 6]>,
    /// Of so many boxes, one holds something.
    one_in: u32,
}

impl PacketScene {
    /// Where a ray is taken to meet what is in a box, if it does.
    fn reported(&self, ray: &Ray, hit: &Hit) -> Option<f32> {
        let bounds = &self.boxes[hit.primitive_index as usize];
        let holds = hit.primitive_index.is_multiple_of(self.one_in);
        holds.then(|| inside(&self.top, bounds, ray, 0.0, hit))?
    }
}

/// A ray by itself.
fn alone(walker: &mut Walker, world: &PacketScene, ray: &Ray) -> Option<Hit> {
    // SAFETY: the structures are alive.
    let mut walk = unsafe { Walk::new(world.top.address(), ray) };
    finish(&mut walk, walker, world);
    walk.committed().copied()
}

/// Takes a walk to its end.
fn finish(walk: &mut Walk, walker: &mut Walker, world: &PacketScene) {
    let mut verdict = Verdict::Continue;
    loop {
        verdict = match walk.resume(walker, verdict, &mut { u64::MAX }) {
            Event::Done => return,
            Event::AnyHitCandidate if counts(walk.candidate()) => Verdict::Accept,
            Event::ProceduralCandidate => {
                if let Some(t) = world.reported(walk.ray(), walk.candidate())
                    && (walk.t_min()..=walk.t_max()).contains(&t)
                {
                    walk.commit_procedural(t, 9);
                }
                Verdict::Continue
            }
            _ => Verdict::Continue,
        };
    }
}

/// How often what happened.
#[derive(Debug, Default)]
struct Tally {
    asked: usize,
    done: usize,
    split: usize,
    /// The candidates asked about, in order.
    seen: u64,
}

impl Tally {
    fn note(&mut self, lane: usize, candidate: &Hit) {
        for word in [
            lane as u32,
            candidate.primitive_index,
            candidate.t.to_bits(),
        ] {
            self.seen = (self.seen ^ u64::from(word)).wrapping_mul(0x0100_0000_01B3);
        }
    }
}

/// Rays together, as a scheduler would do it.
fn together(walker: &mut Walker, world: &PacketScene, rays: &[Ray], tally: &mut Tally) {
    let lanes = LaneMask::full(rays.len());
    let any = rays[0].flags & ray_flags::TERMINATE_ON_FIRST_HIT != 0;
    let before = walker.counts();
    let mut asked_now = 0;
    let decide = |_: &RayRows, group_walk: &mut GroupWalk| {
        asked_now += 1;
        let asked = group_walk.candidates().found;
        assert!(!asked.is_empty() && (asked - lanes).is_empty());
        // One by one, or all at once, as a scheduler may.
        let at_once = (tally.asked + asked_now).is_multiple_of(2);
        let [mut accepted, mut reported] = [LaneMask::NONE; 2];
        let (mut t_row, kinds) = ([0.0; PACKET], [9; PACKET]);
        for lane in asked {
            let candidate = group_walk.candidates().hit(lane);
            tally.note(lane, &candidate);
            assert!(
                !(any && group_walk.hits.get(lane).is_some()),
                "a ray goes on after its end"
            );
            if candidate.is_built_in() {
                assert!(!candidate.opaque && candidate.t < group_walk.t_max()[lane]);
                accepted.set(lane, counts(&candidate));
            } else if let Some(t) = world.reported(&rays[lane], &candidate) {
                let inside = (rays[lane].t_min..=group_walk.t_max()[lane]).contains(&t);
                t_row[lane] = t;
                let counts = group_walk.counts(LaneMask::of(lane), &t_row);
                assert_eq!(!counts.is_empty(), inside);
                reported.set(lane, inside);
            }
        }
        let parts: Vec<LaneMask> = match at_once {
            true => vec![LaneMask::ALL],
            false => (0..PACKET).map(LaneMask::of).collect(),
        };
        for part in parts {
            group_walk.accept(accepted & part);
            let reported = reported & part;
            if !reported.is_empty() {
                let over = group_walk.report(reported, &t_row, &kinds);
                assert_eq!(over, if any { reported } else { LaneMask::NONE });
            }
        }
    };
    let mut groups = Groups::new(&world.top, rays, decide);
    // SAFETY: the structures are alive.
    unsafe { groups.trace(walker, 1) };
    let all_found = groups.found(rays.len());
    drop(groups);
    tally.asked += asked_now;
    let (set_out, split) = (
        walker.counts().together - before.together,
        walker.counts().split - before.split,
    );
    tally.done += (set_out - split) as usize;
    tally.split += split as usize;
    for (ray, found) in rays.iter().zip(all_found) {
        let expected = alone(walker, world, ray);
        match any {
            // Which hit comes first is open.
            true => assert_eq!(found.is_some(), expected.is_some(), "{ray:?}"),
            false => assert_eq!(found, expected, "{ray:?}"),
        }
    }
}

/// Rays from one place to places near each other, some of them vertices.
fn bundle(random: &mut Random, vertices: &[[f32; 3]], count: usize, flags: u32) -> Vec<Ray> {
    let from = 4.0 * random.direction();
    let at = random.vector();
    let spread = 0.4 * random.unit();
    (0..count)
        .map(|i| {
            let aside = random.vector();
            let mut target = at + spread * aside;
            if i % 4 == 0 {
                let place = (random.unit() * vertices.len() as f64) as usize;
                let vertex = wide(vertices[place]);
                target = 0.9 * target + 0.1 * vertex;
            }
            let mut ray = ray(narrow(from), narrow(target - from));
            ray.flags = flags;
            ray
        })
        .collect()
}

fn sphere(radius: f64, opaque: bool) -> Mesh {
    Mesh::icosphere(3, opaque, |p| radius * p)
}

fn boxes(random: &mut Random) -> Vec<[f32; 6]> {
    (0..200)
        .map(|_| {
            let middle = random.vector();
            std::array::from_fn(|i| middle[i % 3] as f32 + if i < 3 { -0.1 } else { 0.1 })
        })
        .collect()
}

fn check(world: &PacketScene, parts: bool) {
    // Shaders are asked about the same, in the same order, whatever the instruction set.
    let seen: Vec<u64> = (Tier::ALL.into_iter().filter_map(Walker::with_tier))
        .map(|walker| check_with(world, walker, parts))
        .collect();
    assert!(seen.iter().all(|other| *other == seen[0]), "{seen:?}");
}

fn check_with(world: &PacketScene, mut walker: Box<Walker>, parts: bool) -> u64 {
    let mut random = Random(0x0BAD_5EED_1357_2468);
    let vertices = sphere(1.0, true).vertices;
    let mut tally = Tally::default();
    for round in 0..effort::rounds(600) as usize {
        let flags = [
            0,
            ray_flags::TERMINATE_ON_FIRST_HIT,
            0,
            ray_flags::NO_OPAQUE,
        ][round % 4];
        let count = PACKET - round % 7;
        let rays = bundle(&mut random, &vertices, count, flags);
        together(&mut walker, world, &rays, &mut tally);
    }
    let enough = tally.asked > 200 && tally.done > 50 && (tally.split > 20) == parts;
    assert!(enough, "{tally:?}");
    tally.seen
}

#[test]
fn triangles_are_decided_on_in_one_instance() {
    for flags in [0, BuildFlags::LOW_MEMORY] {
        let scene = Scene::new(
            &[sphere(1.0, false), sphere(0.9, true), sphere(0.95, false)],
            flags,
        );
        let world = PacketScene {
            top: scene.top,
            boxes: Vec::new(),
            one_in: 1,
        };
        check(&world, false);
    }
}

#[test]
fn boxes_are_decided_on_in_one_instance() {
    let boxes = boxes(&mut Random(5));
    let blob = build_boxes(&boxes, true, 0);
    let top = build_instances(&[InstanceRecord::new(&blob, IDENTITY)], 0);
    let world = PacketScene {
        top,
        boxes,
        one_in: 1,
    };
    check(&world, false);
}

#[test]
fn rays_part_where_they_must() {
    let leaves = build_meshes(&[sphere(1.0, false)], 0);
    let rocks = build_meshes(&[sphere(1.0, true)], 0);
    let boxes = boxes(&mut Random(7));
    let blobs = build_boxes(&boxes, false, 0);
    let mut random = Random(99);
    let instances: Vec<_> = (0..24)
        .map(|i| {
            let x = random.direction();
            let y = normalize(x.cross(random.direction()));
            let z = x.cross(y);
            let (size, to) = (0.3 + 0.4 * random.unit(), random.vector());
            let axes = [x, y, z].map(|axis| axis * size);
            let mut transform = [0.0f32; 12];
            for row in 0..3 {
                for (column, axis) in axes.iter().enumerate() {
                    transform[4 * row + column] = axis[row] as f32;
                }
                transform[4 * row + 3] = to[row] as f32;
            }
            let blob = [&leaves, &rocks, &blobs][i % 3];
            InstanceRecord::new(blob, transform)
        })
        .collect();
    let top = build_instances(&instances, 0);
    let world = PacketScene {
        top,
        boxes,
        one_in: 1,
    };
    check(&world, true);
}

/// A journey of more steps than packets have patience for.
#[test]
fn rays_part_on_long_journeys() {
    let boxes: Vec<[f32; 6]> = (0..70_000u32)
        .map(|i| {
            let shift = i as f32 * 1e-5;
            [-1.0, -1.0, -1.0 + shift, 1.0, 1.0, 1.0 + shift]
        })
        .collect();
    let blob = build_boxes(&boxes, false, 0);
    let top = build_instances(&[InstanceRecord::new(&blob, IDENTITY)], 0);
    let world = PacketScene {
        top,
        boxes,
        one_in: 69_001,
    };
    let (mut walker, mut tally) = (Walker::new(), Tally::default());
    let rays: Vec<_> = (0..8)
        .map(|i| {
            let aside = 0.01 * i as f32;
            ray([aside, 0.1, -5.0], [0.02, 0.01, 1.0])
        })
        .collect();
    together(&mut walker, &world, &rays, &mut tally);
    assert!(tally.asked > 10_000 && tally.split == 1, "{tally:?}");
}
