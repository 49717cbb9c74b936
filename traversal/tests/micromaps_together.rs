//! Rays that walk together or in streams through triangles with micromaps find what each finds by
//! itself.

use std::collections::HashSet;

use scenes::decisions::counts;
use scenes::groups::Groups;
use scenes::odd::plain;
use scenes::*;
use traversal::*;

/// A number below another.
fn below(random: &mut Random, end: usize) -> usize {
    (random.unit() * end as f64) as usize % end
}

/// Triangles in a micromap.
const MAPS: u32 = 24;

/// A micromap whose triangles have all levels up to 5 and both formats. In some, neighbouring parts
/// are mostly alike.
fn micromap(random: &mut Random) -> Bytes {
    let (mut records, mut data, mut usages) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..MAPS {
        let level = i % 6;
        let format = match i / 6 % 2 {
            0 => MicromapFormat::FourStates,
            _ => MicromapFormat::TwoStates,
        };
        records.extend([data.len() as u32, level | (format as u32) << 16]);
        let mut byte = 0;
        for _ in 0..format.triangle_bytes(level) {
            if i < 12 || below(random, 4) == 0 {
                byte = below(random, 256) as u8;
            }
            data.push(byte);
        }
        usages.push(MicromapUsage {
            count: 1,
            level,
            format,
        });
    }
    let mut blob = Bytes::new(micromap_size(usages).unwrap());
    let input = MicromapInput {
        triangles: memory(&records),
        stride_bytes: 8,
        count: MAPS,
        data: memory(&data),
    };
    // SAFETY: both arrays are alive.
    unsafe { build_micromap(&input, &mut blob) }.unwrap();
    blob
}

/// Spheres in each other, some of them with micromaps, in instances with all flags.
struct World {
    top: Bytes,
    _bottoms: Vec<Bytes>,
    _micromap: Bytes,
}

/// A bottom level with geometries that have micromaps, and some that have none.
fn bottom(random: &mut Random, micromap: &Bytes, flags: u32) -> Bytes {
    let shells = [
        (1.0, false, true),
        (0.95, true, true),
        (0.9, false, false),
        (0.85, true, true),
        (0.8, true, false),
    ];
    // With and without the geometries whose candidates no micromap knows.
    let count = 1 + below(random, shells.len());
    let meshes: Vec<_> = shells[..count]
        .iter()
        .map(|&(radius, opaque, _)| Mesh::icosphere(2, opaque, |p| radius * p))
        .collect();
    let indices: Vec<Vec<u32>> = meshes
        .iter()
        .map(|mesh| {
            let mut index = || match below(random, 8) {
                // Special ones, and one that is not there.
                0 => !(below(random, 4) as u32),
                1 => MAPS + 3,
                _ => below(random, MAPS as usize) as u32,
            };
            mesh.indices.iter().map(|_| index()).collect()
        })
        .collect();
    let geometries: Vec<_> = (meshes.iter().zip(&indices).zip(shells))
        .map(|((mesh, indices), (_, _, has_micromap))| TriangleGeometry {
            micromap: has_micromap.then(|| GeometryMicromap {
                index_type: IndexType::U32,
                indices: memory(indices),
                index_stride_bytes: 4,
                base_triangle: 0,
                micromap: micromap.address(),
                // As in both extensions.
                listed: below(random, 2) == 0,
            }),
            ..mesh.geometry()
        })
        .collect();
    let input = BuildInput {
        flags: BuildFlags(flags),
        geometries: Geometries::Triangles(&geometries),
    };
    let counts: Vec<_> = meshes.iter().map(|m| m.indices.len() as u32).collect();
    let sizes = build_sizes(Kind::Triangles, input.flags, &counts);
    let mut blob = Bytes::new(sizes.structure_bytes + micromap_bytes(&counts));
    let mut scratch = Bytes::new(sizes.build_scratch_bytes);
    // SAFETY: meshes and indices are alive.
    unsafe { build(&input, &mut blob, &mut scratch) }.unwrap();
    validate(&blob).unwrap();
    blob
}

impl World {
    fn new(random: &mut Random, instances: usize, flags: u32) -> World {
        let micromap = micromap(random);
        let bottoms: Vec<_> = (0..3).map(|_| bottom(random, &micromap, flags)).collect();
        let records: Vec<_> = (0..instances)
            .map(|i| {
                let mut transform = IDENTITY;
                if instances > 1 {
                    let size = 0.5 + 0.5 * random.unit();
                    let to = random.vector();
                    for row in 0..3 {
                        transform[5 * row] = size as f32;
                        transform[4 * row + 3] = to[row] as f32;
                    }
                }
                let mut record = InstanceRecord::new(&bottoms[i % 3], transform);
                // TRIANGLE_FACING_CULL_DISABLE, TRIANGLE_FLIP_FACING, FORCE_OPAQUE,
                // FORCE_NO_OPAQUE, FORCE_OPACITY_MICROMAP_2_STATE, DISABLE_OPACITY_MICROMAPS
                let flags = [0, 0, 0x10, 0x4, 0x2, 0x8, 0x20, 0x14, 0x18, 0x1];
                let flags = flags[below(random, flags.len())];
                record.sbt_offset_and_flags = flags << 24;
                record
            })
            .collect();
        World {
            top: build_instances(&records, flags),
            _bottoms: bottoms,
            _micromap: micromap,
        }
    }
}

/// Flags of rays: all that have to do with opacity, and ends.
fn flags(random: &mut Random) -> u32 {
    let culls = [
        ray_flags::CULL_OPAQUE,
        ray_flags::CULL_NO_OPAQUE,
        ray_flags::CULL_BACK_FACING_TRIANGLES,
        ray_flags::CULL_FRONT_FACING_TRIANGLES,
    ];
    let opacity = match below(random, 12) {
        0 => ray_flags::OPAQUE,
        1 => ray_flags::NO_OPAQUE,
        2 => culls[below(random, 4)],
        _ => 0,
    };
    let micromaps = match below(random, 6) {
        0 | 1 => ray_flags::FORCE_OPACITY_MICROMAP_2_STATE,
        2 => ray_flags::IGNORE_OPACITY_MICROMAPS,
        _ => 0,
    };
    let end = match below(random, 3) {
        0 => ray_flags::TERMINATE_ON_FIRST_HIT,
        _ => 0,
    };
    opacity | micromaps | end
}

/// A ray by itself, on the plainest walker.
fn alone(walker: &mut Walker, world: &World, ray: &Ray) -> Option<Hit> {
    // SAFETY: the structures are alive.
    let mut walk = unsafe { Walk::new(world.top.address(), ray) };
    let mut verdict = Verdict::Continue;
    loop {
        verdict = match walk.resume(walker, verdict, &mut { u64::MAX }) {
            Event::Done => return walk.committed().copied(),
            Event::AnyHitCandidate if counts(walk.candidate()) => Verdict::Accept,
            _ => Verdict::Continue,
        };
    }
}

/// How rays are taken.
#[derive(Clone, Copy)]
enum Together {
    /// As packets that ask.
    Packets,
    /// As packets whose order of candidates must not show, as ray queries have it.
    InOrder,
    Streams,
}

/// Compares rays together with each by itself; returns how many candidates were asked about.
fn compare(walker: &mut Walker, world: &World, rays: &[Ray], how: Together) -> usize {
    let mut asked = 0;
    let mut seen = HashSet::new();
    let any = rays[0].flags & ray_flags::TERMINATE_ON_FIRST_HIT != 0;
    let decide = |rows: &RayRows, group_walk: &mut GroupWalk| {
        let mut accepted = LaneMask::NONE;
        for lane in group_walk.candidates().found {
            let hit = group_walk.candidates().hit(lane);
            assert!(!hit.opaque && hit.t > rows.t_min[lane] && hit.t < group_walk.t_max()[lane]);
            let triangle = (hit.instance_index, hit.geometry_index, hit.primitive_index);
            let is_new = seen.insert((std::ptr::from_ref(rows), lane, triangle));
            assert!(is_new, "asked twice about {triangle:?}");
            accepted.set(lane, counts(&hit));
            asked += 1;
        }
        group_walk.accept(accepted);
    };
    let groups = Groups::new(&world.top, rays, decide);
    let mut groups = groups.with(|start| {
        start.shows_order = matches!(how, Together::InOrder);
        start.shows_first_hit = matches!(how, Together::Streams);
    });
    let at_once = match how {
        Together::Streams => usize::MAX,
        _ => 1,
    };
    // SAFETY: the structures are alive.
    unsafe { groups.trace(walker, at_once) };
    let all_found = groups.found(rays.len());
    drop(groups);
    let mut plain = plain();
    for (ray, found) in rays.iter().zip(all_found) {
        let expected = alone(&mut plain, world, ray);
        match any && !matches!(how, Together::Streams) {
            // Which hit comes first is open.
            true => assert_eq!(found.is_some(), expected.is_some(), "{ray:?}"),
            false => assert_eq!(found, expected, "{ray:?}"),
        }
    }
    asked
}

/// Rays from one place to places near each other, some of them on edges and vertices.
fn bundle(random: &mut Random, vertices: &[[f32; 3]], flags: u32) -> Vec<Ray> {
    let (from, at) = (4.0 * random.direction(), random.vector());
    let spread = 0.4 * random.unit();
    let count = PACKET - below(random, 7);
    (0..count)
        .map(|i| {
            let mut target = at + spread * random.vector();
            // The vertex nearest to it, or between that and another one.
            let distance = |v: &&[f32; 3]| (wide(**v) - target).length_squared();
            let nearest = vertices
                .iter()
                .min_by(|a, b| distance(a).total_cmp(&distance(b)));
            let nearest = wide(*nearest.expect("there are vertices"));
            match i % 8 {
                0 => target = 0.9 * target + 0.1 * nearest,
                1 => target = nearest,
                2 => target = 0.99 * nearest + 0.01 * wide(vertices[below(random, vertices.len())]),
                _ => {}
            }
            let mut ray = ray(narrow(from), narrow(target - from));
            ray.flags = flags;
            if i % 5 == 0 {
                (ray.t_min, ray.t_max) = (0.7, 1.1);
            }
            ray
        })
        .collect()
}

/// Walkers of all tiers.
fn tiers() -> impl Iterator<Item = (Tier, Box<Walker>)> {
    let walker = |tier| Some((tier, Walker::with_tier(tier)?));
    Tier::ALL.into_iter().filter_map(walker)
}

#[test]
fn packets_find_what_single_walks_find() {
    let vertices = Mesh::icosphere(2, true, |p| p).vertices;
    for (tier, mut walker) in tiers() {
        let mut random = Random(0x5EED_0B0E_1357_2468);
        let (mut asked, mut asked_in_order) = (0, 0);
        for round in 0..effort::rounds(40) {
            let instances = if round % 2 == 0 { 1 } else { 12 };
            let builds = [0, BuildFlags::LOW_MEMORY][round as usize / 2 % 2];
            let world = World::new(&mut random, instances, builds);
            for _ in 0..40 {
                let flags = flags(&mut random);
                let rays = bundle(&mut random, &vertices, flags);
                asked += compare(&mut walker, &world, &rays, Together::Packets);
                asked_in_order += compare(&mut walker, &world, &rays, Together::InOrder);
            }
        }
        let together = walker.counts().together;
        assert!(together > 500, "{tier:?}: {together}");
        assert!(
            asked > 2000 && asked_in_order > 2000,
            "{asked} {asked_in_order}"
        );
    }
}

/// Nothing is asked about where two states are all that there are, and packets and streams do it.
#[test]
fn two_states_ask_about_nothing() {
    let mut random = Random(0x1234_5678_9ABC_DEF0);
    let micromap = micromap(&mut random);
    let mesh = Mesh::icosphere(3, false, |p| p);
    let indices: Vec<u32> = (mesh.indices.iter())
        .map(|_| below(&mut random, MAPS as usize) as u32)
        .collect();
    let geometry = TriangleGeometry {
        micromap: Some(GeometryMicromap {
            index_type: IndexType::U32,
            indices: memory(&indices),
            index_stride_bytes: 4,
            base_triangle: 0,
            micromap: micromap.address(),
            listed: true,
        }),
        ..mesh.geometry()
    };
    let input = BuildInput {
        flags: BuildFlags(0),
        geometries: Geometries::Triangles(&[geometry]),
    };
    let counts = [mesh.indices.len() as u32];
    let sizes = build_sizes(Kind::Triangles, input.flags, &counts);
    let mut blob = Bytes::new(sizes.structure_bytes + micromap_bytes(&counts));
    let mut scratch = Bytes::new(sizes.build_scratch_bytes);
    // SAFETY: the mesh and the indices are alive.
    unsafe { build(&input, &mut blob, &mut scratch) }.unwrap();
    let world = World {
        top: build_instances(&[InstanceRecord::new(&blob, IDENTITY)], 0),
        _bottoms: vec![blob],
        _micromap: micromap,
    };
    for (tier, mut walker) in tiers() {
        let mut together = [0; 2];
        for round in 0..effort::rounds(100) {
            let flags = [
                ray_flags::FORCE_OPACITY_MICROMAP_2_STATE,
                ray_flags::OPAQUE,
                ray_flags::FORCE_OPACITY_MICROMAP_2_STATE | ray_flags::TERMINATE_ON_FIRST_HIT,
            ][round as usize % 3];
            let rays = bundle(&mut random, &mesh.vertices, flags);
            // So ray queries walk together, too.
            for how in [Together::Packets, Together::InOrder] {
                let before = walker.counts().together;
                assert_eq!(compare(&mut walker, &world, &rays, how), 0);
                together[how as usize] += walker.counts().together - before;
            }
        }
        assert!(together[0] > 30 && together[0] == together[1], "{tier:?}");
    }
}

#[test]
fn streams_find_what_single_walks_find() {
    for (tier, mut walker) in tiers() {
        let mut random = Random(0x0F0F_1357_2468_ACE1);
        let mut streamed = 0;
        for round in 0..effort::rounds(24) {
            let instances = if round % 2 == 0 { 1 } else { 12 };
            let world = World::new(&mut random, instances, 0);
            let flags = flags(&mut random);
            let rays: Vec<_> = (0..600)
                .map(|_| {
                    let origin = 2.0 * random.vector();
                    let mut ray = ray(narrow(origin), narrow(random.direction()));
                    ray.flags = flags;
                    ray
                })
                .collect();
            let before = walker.counts().streamed;
            compare(&mut walker, &world, &rays, Together::Streams);
            streamed += walker.counts().streamed - before;
        }
        assert!(
            tier == Tier::Portable || streamed > 1000,
            "{tier:?}: {streamed}"
        );
    }
}
