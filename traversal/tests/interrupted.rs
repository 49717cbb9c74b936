//! Walks that stop at any step (fuel that ends, candidates, rays that wait) and go on in any way
//! find what a walk finds that nothing stops.
//!
//! Expectations come from single walks of the portable tier without any shortcut, and from exact
//! arithmetic where that can say it.

use scenes::decisions::{counts, inside};
use scenes::groups::Groups;
use scenes::odd::plain;
use scenes::*;
use traversal::*;

/// The aim of rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Quest {
    /// The closest hit; what is not opaque is decided on.
    Closest,
    /// The closest hit, where all triangles are opaque.
    Opaque,
    /// The first hit.
    First,
    /// All candidates; none is accepted.
    Candidates,
}

impl Quest {
    const ALL: [Quest; 4] = [
        Quest::Closest,
        Quest::Opaque,
        Quest::First,
        Quest::Candidates,
    ];

    fn flags(self) -> u32 {
        match self {
            Quest::Closest => 0,
            Quest::Opaque => ray_flags::OPAQUE,
            Quest::First => ray_flags::TERMINATE_ON_FIRST_HIT,
            Quest::Candidates => ray_flags::NO_OPAQUE,
        }
    }
}

/// The contents of a bottom level.
enum Content {
    Triangles(Mesh),
    /// Its vertices are elsewhere at time 1.
    Moving,
    Boxes(Vec<[f32; 6]>),
}

/// A top level of a few instances, and rays.
struct InterruptedScene {
    top: Bytes,
    /// By instance.
    contents: Vec<Content>,
    /// Where each instance is, if it is not turned and does not move, so that its rays are moved
    /// without rounding.
    places: Option<Vec<DVec3>>,
    rays: Vec<(Ray, f32)>,
    quest: Quest,
    _bottoms: Vec<Bytes>,
}

/// The result of a ray, and the candidates at which it stood.
#[derive(Clone, Debug, Default, PartialEq)]
struct RayResult {
    hit: Option<Hit>,
    candidates: Vec<Hit>,
}

/// One of a few.
fn pick<T: Copy>(random: &mut Random, of: &[T]) -> T {
    of[(random.unit() * of.len() as f64) as usize % of.len()]
}

/// A number of few bits, so that sums and differences are not rounded.
fn coarse(v: DVec3) -> DVec3 {
    (v * 1024.0).round() / 1024.0
}

/// Triangles with random corners, so far from random centers.
fn heap(random: &mut Random, size: f64, count: usize) -> Mesh {
    let corners = |random: &mut Random| {
        let center = random.vector();
        [(); 3].map(|()| center + size * random.vector())
    };
    mesh(count, || corners(random))
}

/// Long triangles side by side: their boxes are nearly the same, so a ray finds them in no order.
fn slivers(random: &mut Random, count: usize) -> Mesh {
    let half = 5.0 * random.direction();
    let corners = |random: &mut Random| {
        let center = random.vector();
        let end = center + half;
        [center - half, end, end + 0.6 * random.vector()]
    };
    mesh(count, || corners(random))
}

fn mesh(count: usize, mut corners: impl FnMut() -> [DVec3; 3]) -> Mesh {
    Mesh {
        vertices: (0..count).flat_map(|_| corners().map(narrow)).collect(),
        indices: (0..count as u32)
            .map(|i| [0, 1, 2].map(|k| 3 * i + k))
            .collect(),
        opaque: true,
    }
}

/// Triangles of one kind or another.
fn triangles(random: &mut Random, count: usize, opaque: bool) -> Mesh {
    let mesh = match pick(random, &[0.0, 0.0, 0.2, 0.7, 3.0]) {
        0.0 => slivers(random, count),
        size => heap(random, size, count),
    };
    Mesh { opaque, ..mesh }
}

/// Turned, scaled and moved to a place.
fn turned(random: &mut Random, at: DVec3) -> [f32; 12] {
    let z = random.direction();
    let x = normalize(random.direction().cross(z));
    let y = z.cross(x);
    let size = 0.4 + random.unit();
    let mut matrix = [0.0; 12];
    for row in 0..3 {
        for (column, axis) in [x, y, z].iter().enumerate() {
            matrix[4 * row + column] = (size * axis[row]) as f32;
        }
        matrix[4 * row + 3] = at[row] as f32;
    }
    matrix
}

fn moved(at: DVec3) -> [f32; 12] {
    let mut matrix = IDENTITY;
    for row in 0..3 {
        matrix[4 * row + 3] = at[row] as f32;
    }
    matrix
}

impl InterruptedScene {
    fn new(random: &mut Random, quest: Quest) -> InterruptedScene {
        let flags = pick(random, &QUALITIES);
        let count = 1 + (3.0 * random.unit()) as usize;
        // The kind of most: mixtures of all seldom walk in streams.
        let usual = pick(random, &[0, 0, 0, 0, 1, 2, 3]);
        let (mut bottoms, mut contents) = (Vec::new(), Vec::new());
        for _ in 0..count {
            let kind = if random.unit() < 0.7 {
                usual
            } else {
                pick(random, &[0, 1, 2, 3])
            };
            let size = pick(random, &[1, 5, 60, 60, 150]);
            let (bottom, content) = bottom_level(random, kind, size, flags);
            bottoms.push(bottom);
            contents.push(content);
        }
        let flags = pick(random, &QUALITIES);
        // In one another, or apart.
        let apart = pick(random, &[0.5, 3.0]);
        let places: Vec<_> = (0..count)
            .map(|_| coarse(apart * random.vector()))
            .collect();
        let each = bottoms.iter().zip(&places);
        let (top, is_exact) = match pick(random, &[0, 0, 1, 2]) {
            0 => {
                let records = each.map(|(bottom, &at)| InstanceRecord::new(bottom, moved(at)));
                (build_instances(&records.collect::<Vec<_>>(), flags), true)
            }
            1 => {
                let record =
                    |(bottom, &at): (_, _)| InstanceRecord::new(bottom, turned(random, at));
                let records: Vec<_> = each.map(record).collect();
                (build_instances(&records, flags), false)
            }
            _ => {
                let records = each.map(|(bottom, &at)| {
                    let start = turned(random, at);
                    let mut end = start;
                    (0..3).for_each(|row| end[4 * row + 3] += random.signed() as f32);
                    MotionRecord::new(bottom, [start, end])
                });
                let records: Vec<_> = records.collect();
                (build_moving_instances(&records, flags), false)
            }
        };
        InterruptedScene {
            rays: rays(random, quest.flags(), &places),
            top,
            contents,
            places: is_exact.then_some(places),
            quest,
            _bottoms: bottoms,
        }
    }

    /// The decision about a triangle.
    fn accepts(&self, candidate: &Hit) -> bool {
        self.quest != Quest::Candidates && counts(candidate)
    }

    /// Where something in a box is hit.
    fn reports(&self, ray: &Ray, time: f32, candidate: &Hit) -> Option<f32> {
        let Content::Boxes(boxes) = &self.contents[candidate.instance_index as usize] else {
            panic!("no box is there: {candidate:?}");
        };
        let bounds = &boxes[candidate.primitive_index as usize];
        let reported = inside(&self.top, bounds, ray, time, candidate)?;
        (self.quest != Quest::Candidates).then_some(reported)
    }

    /// Takes a ray to its end, so much fuel at a time; how often it ended.
    fn alone(
        &self,
        walker: &mut Walker,
        (ray, time): &(Ray, f32),
        fuel: u64,
    ) -> (RayResult, usize) {
        let mut found = RayResult::default();
        let (mut verdict, mut refills) = (Verdict::Continue, 0);
        // SAFETY: the structures are alive.
        let mut walk = unsafe { Walk::new(self.top.address(), ray) };
        walk.set_time(*time);
        loop {
            let event = walk.resume(walker, verdict, &mut { fuel });
            verdict = Verdict::Continue;
            match event {
                Event::Done => break,
                Event::OutOfFuel => {
                    refills += 1;
                    continue;
                }
                Event::AnyHitCandidate => {
                    if self.accepts(walk.candidate()) {
                        verdict = Verdict::Accept;
                    }
                }
                Event::ProceduralCandidate => {
                    if let Some(t) = self.reports(ray, *time, walk.candidate())
                        && (walk.t_min()..=walk.t_max()).contains(&t)
                    {
                        walk.commit_procedural(t, 9);
                    }
                }
            }
            found.candidates.push(*walk.candidate());
        }
        found.hit = walk.committed().copied();
        (found, refills)
    }

    /// The rays in groups.
    fn rows(&self) -> Vec<(RayRows, LaneMask)> {
        let group = |rays: &[(Ray, f32)]| {
            let mut rows = RayRows::NONE;
            for (lane, (ray, time)) in rays.iter().enumerate() {
                rows.set(lane, self.top.address(), ray, *time);
            }
            (rows, LaneMask::full(rays.len()))
        };
        self.rays.chunks(PACKET).map(group).collect()
    }

    /// Decides on the candidates of a group, except those that wait.
    fn decide(&self, rows: &RayRows, group_walk: &mut GroupWalk, lanes: LaneMask) {
        let (mut accepted, mut reported) = (LaneMask::NONE, LaneMask::NONE);
        let mut distances = [0.0; PACKET];
        for lane in lanes {
            let candidate = group_walk.candidates().hit(lane);
            if candidate.is_built_in() {
                accepted.set(lane, self.accepts(&candidate));
            } else if let Some(t) = self.reports(&rows.ray(lane), rows.time[lane], &candidate) {
                distances[lane] = t;
                reported.insert(lane);
            }
        }
        group_walk.accept(accepted);
        let counting = group_walk.counts(reported, &distances);
        group_walk.report(counting, &distances, &[9; PACKET]);
    }

    /// Takes all rays to their ends.
    fn together(&self, walker: &mut Walker, way: &Way) -> (Vec<RayResult>, usize) {
        let mut turn = 0;
        let decide = |rows: &RayRows, group_walk: &mut GroupWalk| {
            let mut lanes = group_walk.candidates().found;
            turn += 1;
            if way.holds && turn % 3 == 0 {
                // Those on even lanes wait, if others do not.
                let odd = LaneMask::from_bits(0xAAAA) & lanes;
                if !odd.is_empty() {
                    group_walk.hold(lanes - odd);
                    lanes = odd;
                }
            }
            self.decide(rows, group_walk, lanes);
        };
        let groups = Groups::of_rows(self.rows(), decide);
        let mut groups = groups.with(|start| {
            (start.shows_first_hit, start.shows_order) = (way.shows_first_hit, way.shows_order);
        });
        // SAFETY: the structures are alive.
        unsafe { groups.trace(walker, way.at_once) };
        let refills = usize::MAX - groups.refills;
        let hits = groups.found(self.rays.len());
        let met = std::mem::take(&mut groups.met);
        let found = hits.into_iter().zip(met.into_iter().flatten());
        let found = found.map(|(hit, candidates)| RayResult { hit, candidates });
        (found.collect(), refills)
    }
}

/// A bottom level: 0, opaque triangles; 1, triangles that are not; 2, moving ones; 3, boxes.
fn bottom_level(random: &mut Random, kind: usize, size: usize, flags: u32) -> (Bytes, Content) {
    match kind {
        0 | 1 => {
            let mesh = triangles(random, size, kind == 0);
            let bottom = build_meshes(std::slice::from_ref(&mesh), flags);
            (bottom, Content::Triangles(mesh))
        }
        2 => {
            let opaque = random.unit() < 0.5;
            let start = triangles(random, size, opaque);
            let end = triangles(random, size, opaque);
            let geometry = MotionGeometry {
                start: start.geometry(),
                end_vertices: memory(&end.vertices),
            };
            let bottom = build_blob(&BuildInput {
                flags: BuildFlags(flags),
                geometries: Geometries::Motion(&[geometry]),
            });
            (bottom, Content::Moving)
        }
        _ => {
            let boxes: Vec<[f32; 6]> = (0..size)
                .map(|_| {
                    let (middle, half) = (random.vector(), 0.05 + 0.5 * random.unit());
                    let [min, max] = [middle - half, middle + half].map(narrow);
                    std::array::from_fn(|i| if i < 3 { min[i] } else { max[i - 3] })
                })
                .collect();
            let bottom = build_boxes(&boxes, random.unit() < 0.5, flags);
            (bottom, Content::Boxes(boxes))
        }
    }
}

/// Groups of rays: some go the same way. The last group has a few lanes.
fn rays(random: &mut Random, flags: u32, places: &[DVec3]) -> Vec<(Ray, f32)> {
    let mut rays = Vec::new();
    for group in 0..6 {
        let spread = pick(random, &[0.05, 0.3, 2.0]);
        let at = pick(random, places);
        let (from, to) = (at + 6.0 * random.direction(), at + 0.7 * random.vector());
        for _ in 0..if group == 5 { 7 } else { PACKET } {
            let origin = match spread > 1.0 {
                true => at + 4.0 * random.vector(),
                false => from + 0.01 * random.vector(),
            };
            let origin = coarse(origin);
            let target = to + spread * random.vector();
            let mut ray = ray(narrow(origin), narrow(target - origin));
            ray.flags = flags;
            if random.unit() < 0.1 {
                ray.t_max = (2.0 * random.unit()) as f32;
            }
            rays.push((ray, random.unit() as f32));
        }
    }
    rays
}

/// How groups walk.
struct Way {
    name: &'static str,
    at_once: usize,
    shows_first_hit: bool,
    shows_order: bool,
    /// Some rays wait while others of their group go on.
    holds: bool,
}

const WAYS: [Way; 6] = [
    Way::new("in turn", 1, true, false, false),
    Way::new("in order", 1, true, true, false),
    Way::new("held", 1, false, true, true),
    Way::new("packets", 1, false, false, false),
    Way::new("streams", usize::MAX, true, false, false),
    Way::new("packets and streams", usize::MAX, false, false, false),
];

impl Way {
    const fn new(
        name: &'static str,
        at_once: usize,
        shows_first_hit: bool,
        shows_order: bool,
        holds: bool,
    ) -> Way {
        Way {
            name,
            at_once,
            shows_first_hit,
            shows_order,
            holds,
        }
    }
}

/// Candidates in an order of their own, each once for each time it was met. Where rays wait, they
/// are met again.
fn as_set(candidates: &[Hit], once: bool) -> Vec<(u32, u32, u32, u32)> {
    let key = |hit: &Hit| {
        let t = hit.t.to_bits();
        (
            hit.instance_index,
            hit.geometry_index,
            hit.primitive_index,
            t,
        )
    };
    let mut keys: Vec<_> = candidates.iter().map(key).collect();
    keys.sort_unstable();
    if once {
        keys.dedup();
    }
    keys
}

/// Holds what rays found in groups against what each finds by itself.
fn compare(
    world: &InterruptedScene,
    way: &Way,
    found: &[RayResult],
    expected: &[RayResult],
    case: &str,
) {
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        let case = || format!("{case}, {}, ray {i}: {:?}", way.name, world.rays[i]);
        match world.quest == Quest::First && !way.shows_first_hit {
            // Which hit comes first is open.
            true => assert_eq!(found.hit.is_some(), expected.hit.is_some(), "{}", case()),
            false => assert_eq!(found.hit, expected.hit, "{}", case()),
        }
        if way.shows_order && way.shows_first_hit {
            assert_eq!(found.candidates, expected.candidates, "{}", case());
        } else if world.quest == Quest::Candidates {
            let [found, expected] =
                [found, expected].map(|found| as_set(&found.candidates, way.holds));
            assert_eq!(found, expected, "{}", case());
        }
    }
}

/// Holds what rays find by themselves against exact arithmetic, where all is triangles in places
/// that need no rounding.
fn compare_exactly(world: &InterruptedScene, expected: &[RayResult], case: &str) -> bool {
    let Some(places) = &world.places else {
        return false;
    };
    if !matches!(world.quest, Quest::Opaque | Quest::Candidates) {
        return false;
    }
    let mut meshes = Vec::new();
    for content in &world.contents {
        let Content::Triangles(mesh) = content else {
            return false;
        };
        meshes.push(mesh);
    }
    for (i, (ray, _)) in world.rays.iter().enumerate() {
        let moved = |place: &DVec3| Ray {
            origin: narrow(wide(ray.origin) - *place),
            ..*ray
        };
        let each = || meshes.iter().zip(places).enumerate();
        if world.quest == Quest::Opaque {
            let nearest = each()
                .filter_map(|(_, (mesh, place))| exact::nearest(mesh, &moved(place)))
                .map(|(_, crossing)| crossing.t)
                .min_by(f64::total_cmp);
            let found = expected[i].hit.map(|hit| f64::from(hit.t));
            match (found, nearest) {
                (None, None) => {}
                (Some(found), Some(nearest)) => {
                    let difference = (found - nearest).abs();
                    assert!(
                        difference <= 2e-5 * nearest,
                        "{case}, {i}: {found} {nearest}"
                    );
                }
                _ => panic!("{case}, ray {i}, {ray:?}: found {found:?}, right is {nearest:?}"),
            }
        } else if world.quest == Quest::Candidates && ray.t_max == f32::INFINITY {
            let met = each().flat_map(|(instance, (mesh, place))| {
                let ray = moved(place);
                (0..mesh.indices.len())
                    .filter(move |&index| exact::crosses(&ray, &mesh.triangle(index)))
                    .map(move |index| (instance as u32, index as u32))
            });
            let met: Vec<_> = met.collect();
            let found = as_set(&expected[i].candidates, false);
            let found: Vec<_> = found.iter().map(|key| (key.0, key.2)).collect();
            assert_eq!(found, met, "{case}, ray {i}, {ray:?}");
        }
    }
    true
}

fn walker(tier: Tier, without: Option<Specialisation>, fuel: u64) -> Box<Walker> {
    let options = Options {
        tier,
        without: without.into_iter().collect(),
        fuel,
        ..Options::default()
    };
    Walker::with(options).expect("it is available")
}

fn tiers() -> impl Iterator<Item = Tier> {
    Tier::ALL.into_iter().filter(|tier| tier.is_available())
}

/// The events in all worlds.
#[derive(Debug, Default)]
struct Tally {
    refills: usize,
    together: u64,
    split: u64,
    streamed: u64,
    candidates: usize,
    exact: usize,
}

#[test]
fn interrupted_walks_find_what_others_find() {
    let mut tally = Tally::default();
    let left_out = [
        None,
        None,
        Some(Specialisation::OneInstance),
        Some(Specialisation::Opaque),
    ];
    for seed in 0..160u64 {
        let mut random = Random(0x9E37_79B9_7F4A_7C15u64.wrapping_mul(seed + 1));
        let quest = Quest::ALL[seed as usize % 4];
        let world = InterruptedScene::new(&mut random, quest);
        let mut plain = plain();
        let alone = |ray| world.alone(&mut plain, ray, u64::MAX).0;
        let expected: Vec<RayResult> = world.rays.iter().map(alone).collect();
        tally.candidates += expected
            .iter()
            .map(|found| found.candidates.len())
            .sum::<usize>();
        tally.exact += usize::from(compare_exactly(&world, &expected, &format!("{seed}")));
        for tier in tiers() {
            // Each order of size as often.
            let fuel = 2f64.powf(10.0 * random.unit()) as u64;
            let without = pick(&mut random, &left_out);
            let case =
                format!("world {seed}, {quest:?}, {tier:?} without {without:?}, fuel {fuel}");
            let mut walker = walker(tier, without, fuel);
            for (i, (ray, expected)) in world.rays.iter().zip(&expected).enumerate() {
                let (found, refills) = world.alone(&mut walker, ray, fuel);
                tally.refills += refills;
                assert_eq!(&found, expected, "{case}, ray {i} by itself: {ray:?}");
            }
            for way in &WAYS {
                let (found, refills) = world.together(&mut walker, way);
                tally.refills += refills;
                compare(&world, way, &found, &expected, &case);
            }
            let counts = walker.counts();
            tally.together += counts.together;
            tally.split += counts.split;
            tally.streamed += counts.streamed;
        }
    }
    let happened = tally.refills > 1000
        && tally.together > 200
        && tally.split > 20
        && (tally.streamed > 5000 || !Tier::Avx2.is_available())
        && tally.candidates > 10_000
        && tally.exact > 10;
    assert!(happened, "{tally:?}");
}

/// Every step at which rays can run out of fuel, on every tier: two instances of triangles most of
/// which lie in the way of each ray.
#[test]
fn no_step_is_a_wrong_one_to_stop_at() {
    let mut random = Random(0x0123_4567_89AB_CDEF);
    let mut most = 0;
    for opaque in [true, false] {
        let mesh = Mesh {
            opaque,
            ..slivers(&mut random, 60)
        };
        let bottoms = [(); 2].map(|()| build_meshes(std::slice::from_ref(&mesh), 0));
        let places = [DVec3::ZERO, DVec3::new(2.0, 0.0, 0.5)];
        let records = bottoms.iter().zip(places);
        let records = records.map(|(bottom, at)| InstanceRecord::new(bottom, moved(at)));
        let records: Vec<_> = records.collect();
        let quests: &[Quest] = match opaque {
            true => &[Quest::Opaque, Quest::First],
            false => &[Quest::Closest],
        };
        for &quest in quests {
            let world = InterruptedScene {
                top: build_instances(&records, 0),
                contents: vec![
                    Content::Triangles(mesh.clone()),
                    Content::Triangles(mesh.clone()),
                ],
                places: Some(places.to_vec()),
                rays: rays(&mut random, quest.flags(), &places),
                quest,
                _bottoms: Vec::new(),
            };
            let mut plain = plain();
            let alone = |ray| world.alone(&mut plain, ray, u64::MAX).0;
            let expected: Vec<RayResult> = world.rays.iter().map(alone).collect();
            compare_exactly(&world, &expected, "all steps");
            for tier in tiers() {
                for way in WAYS.iter().filter(|way| !way.shows_order) {
                    let (mut fuel, mut refills) = (0, usize::MAX);
                    while refills > 0 {
                        fuel += 1;
                        let case = format!("all steps, {quest:?}, {tier:?}, fuel {fuel}");
                        let mut walker = walker(tier, None, fuel);
                        let found;
                        (found, refills) = world.together(&mut walker, way);
                        compare(&world, way, &found, &expected, &case);
                    }
                    most = most.max(fuel);
                }
            }
        }
    }
    assert!(most > 100, "{most}");
}
