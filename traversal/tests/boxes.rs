//! Rays of a group meet the boxes that each meets by itself, in the same order, whatever stops
//! them.

use scenes::decisions::inside;
use scenes::groups::Groups;
use scenes::*;
use traversal::*;

/// The result of a ray: its hit, and the boxes at which it stood.
type RayResult = (Option<Hit>, Vec<Hit>);

struct TestScene {
    top: Bytes,
    boxes: Vec<[f32; 6]>,
    _bottoms: [Bytes; 2],
}

impl TestScene {
    /// Boxes in one instance, or in several with a ball among them.
    fn new(random: &mut Random, transforms: &[[f32; 12]]) -> TestScene {
        let boxes: Vec<[f32; 6]> = (0..300)
            .map(|i| {
                // On whole numbers, so that rays start on planes; a few are flat or large.
                let low = (random.vector() * 8.0).round();
                let size = [1.0, 0.5, 0.0, 6.0][i % 4];
                std::array::from_fn(|k| low[k % 3] as f32 + if k < 3 { 0.0 } else { size })
            })
            .collect();
        let bottom = build_boxes(&boxes, true, 0);
        let ball = build_meshes(&[Mesh::icosphere(1, true, |place| 5.0 * place)], 0);
        let placed = transforms.iter();
        let mut instances: Vec<_> = placed.map(|it| InstanceRecord::new(&bottom, *it)).collect();
        if transforms.len() > 1 {
            instances.push(InstanceRecord::new(&ball, IDENTITY));
        }
        TestScene {
            top: build_instances(&instances, 0),
            boxes,
            _bottoms: [bottom, ball],
        }
    }

    /// Where a ray is taken to meet what is in a box, if it does.
    fn reported(&self, ray: &Ray, hit: &Hit) -> Option<f32> {
        inside(
            &self.top,
            &self.boxes[hit.primitive_index as usize],
            ray,
            0.0,
            hit,
        )
    }

    /// A ray by itself.
    fn alone(&self, walker: &mut Walker, ray: &Ray) -> RayResult {
        // SAFETY: the structures are alive.
        let mut walk = unsafe { Walk::new(self.top.address(), ray) };
        let mut met = Vec::new();
        loop {
            match walk.resume(walker, Verdict::Continue, &mut { u64::MAX }) {
                Event::ProceduralCandidate => {
                    met.push(*walk.candidate());
                    if let Some(t) = self.reported(ray, walk.candidate())
                        && (walk.t_min()..=walk.t_max()).contains(&t)
                    {
                        walk.commit_procedural(t, 9);
                    }
                }
                event => {
                    assert_eq!(event, Event::Done);
                    return (walk.committed().copied(), met);
                }
            }
        }
    }

    /// Decides on the candidates of some rays of a group.
    fn decide(&self, rows: &RayRows, group_walk: &mut GroupWalk, lanes: LaneMask) {
        let (mut reported, mut t) = (LaneMask::NONE, [0.0; PACKET]);
        for lane in lanes {
            let hit = group_walk.candidates().hit(lane);
            if let Some(found) = self.reported(&rows.ray(lane), &hit) {
                reported.insert(lane);
                t[lane] = found;
            }
        }
        let counts = group_walk.counts(reported, &t);
        group_walk.report(counts, &t, &[9; PACKET]);
    }

    /// Holds what groups found against each ray by itself.
    fn compare(&self, rays: &[Ray], found: &[RayResult]) {
        let mut walker = Walker::with_tier(Tier::Portable).expect("every machine has it");
        for (ray, found) in rays.iter().zip(found) {
            assert_eq!(*found, self.alone(&mut walker, ray), "{ray:?}");
        }
    }
}

/// Half of the rays have numbers as odd as they may be.
fn rays(random: &mut Random, count: usize, flags: u32) -> Vec<Ray> {
    let mut rays = odd_rays(random, count / 2, flags);
    // To one light, past the boxes or through them.
    let to_light = narrow(random.direction());
    while rays.len() < count {
        let at = 16.0 * random.vector();
        for _ in 0..PACKET.min(count - rays.len()) {
            let mut ray = ray(narrow(at + random.vector()), to_light);
            ray.flags = flags;
            ray.t_max = (20.0 * random.unit()) as f32;
            rays.push(ray);
        }
    }
    rays
}

fn odd_rays(random: &mut Random, count: usize, flags: u32) -> Vec<Ray> {
    let odd = [0.0, -0.0, 1e-42, -1e-42, 1e-30, 1.0, -1.0];
    let lengths = [1.0, 1.0, 1.0, 1e-12, 1e12, 3e37];
    let mut pick = |from: &[f32]| from[(random.unit() * from.len() as f64) as usize % from.len()];
    let mut lots: Vec<[f32; 5]> = Vec::new();
    for _ in 0..count {
        lots.push([
            pick(&odd),
            pick(&odd),
            pick(&odd),
            pick(&lengths),
            pick(&[0.0, 1.0, 2.0]),
        ]);
    }
    let rays = lots.into_iter().map(|[x, y, z, length, kind]| {
        let origin = (random.vector() * 10.0).round();
        let target = random.vector() * 8.0;
        let mut direction = narrow(target - origin);
        if kind == 0.0 {
            direction = [x, y, z];
        }
        let mut ray = ray(narrow(origin), direction.map(|d| d * length));
        ray.flags = flags;
        ray.t_min = if kind == 1.0 { -1.0 } else { 0.0 };
        ray
    });
    rays.collect()
}

/// Where instances are: one, or several.
fn placements() -> [Vec<[f32; 12]>; 4] {
    let turned = [0.0, 2.0, 0.0, 3.0, -0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, -7.0];
    let mut small = IDENTITY;
    (small[0], small[5], small[10]) = (1e-3, 1e-3, 1e-3);
    let all = vec![IDENTITY, turned, small, turned];
    [vec![IDENTITY], vec![turned], vec![small], all]
}

#[test]
fn groups_meet_the_boxes_of_single_rays() {
    let mut random = Random(0x0B0E_5000);
    for (round, transforms) in placements().iter().cycle().take(12).enumerate() {
        let world = TestScene::new(&mut random, transforms);
        let flags = [0, ray_flags::TERMINATE_ON_FIRST_HIT, ray_flags::CULL_OPAQUE][round / 4];
        let rays = rays(&mut random, 16 * PACKET - 3, flags);
        for &tier in Tier::available() {
            for fuel in [u64::MAX, 3] {
                let options = Options {
                    tier,
                    fuel,
                    ..Options::default()
                };
                let mut walker = Walker::with(options).expect("the tier is available");
                let decide = |rows: &RayRows, group_walk: &mut GroupWalk| {
                    let lanes = group_walk.candidates().found;
                    world.decide(rows, group_walk, lanes);
                };
                let mut groups = Groups::new(&world.top, &rays, decide);
                for start in &mut groups.starts {
                    (start.shows_first_hit, start.shows_order) = (true, true);
                }
                // SAFETY: the structures are alive.
                unsafe { groups.trace(&mut walker, 1) };
                let hits = groups.found(rays.len());
                let met = std::mem::take(&mut groups.met).into_iter().flatten();
                let found: Vec<RayResult> = hits.into_iter().zip(met).collect();
                world.compare(&rays, &found);
            }
        }
    }
}

#[test]
fn moved_rays_go_on_where_they_stood() {
    let mut random = Random(0x0B0E_5001);
    for transforms in placements() {
        let world = TestScene::new(&mut random, &transforms);
        let rays = rays(&mut random, PACKET, 0);
        for &tier in Tier::available() {
            let mut walker = Walker::with_tier(tier).expect("the tier is available");
            let decide = |rows: &RayRows, group_walk: &mut GroupWalk| {
                let lanes = group_walk.candidates().found;
                world.decide(rows, group_walk, lanes);
            };
            // The second group starts without rays; each ray there has another lane.
            let moved: Vec<Ray> = (0..PACKET).map(|lane| rays[lane ^ 5]).collect();
            let both: Vec<Ray> = rays.iter().chain(&moved).copied().collect();
            let mut groups = Groups::new(&world.top, &both, decide);
            for start in &mut groups.starts {
                (start.shows_first_hit, start.shows_order) = (true, true);
            }
            groups.starts[1].lanes = LaneMask::NONE;
            groups.rounds = 0;
            // SAFETY: the structures are alive.
            unsafe { groups.trace(&mut walker, 1) };
            let (first, second) = groups.group_walks.split_at_mut(1);
            let mut places: Vec<usize> = (0..PACKET).collect();
            for lane in first[0]
                .candidates()
                .found
                .iter()
                .filter(|lane| lane % 3 != 0)
            {
                first[0].move_ray(lane, &mut second[0], lane ^ 5);
                places[lane] = PACKET + (lane ^ 5);
            }
            let lanes = second[0].candidates().found;
            world.decide(&groups.rows[1], &mut second[0], lanes);
            let waits = |groups: &mut Groups<_>| {
                let waits = |group: &u32| {
                    !groups.group_walks[*group as usize]
                        .candidates()
                        .found
                        .is_empty()
                };
                [0, 1].into_iter().filter(waits).collect::<Vec<u32>>()
            };
            loop {
                let waiting = waits(&mut groups);
                if waiting.is_empty() {
                    break;
                }
                // SAFETY: the structures are alive.
                let resumed = unsafe { walker.resume(&waiting, &mut groups) };
                assert!(resumed.is_ok());
            }
            let found: Vec<RayResult> = (0..PACKET)
                .map(|lane| {
                    let place = places[lane];
                    let group_walk = &groups.group_walks[place / PACKET];
                    let mut met = groups.met[0][lane].clone();
                    if place >= PACKET {
                        met.extend(&groups.met[1][place % PACKET]);
                    }
                    (group_walk.hits.get(place % PACKET), met)
                })
                .collect();
            world.compare(&rays, &found);
        }
    }
}
