//! Spheres, linear swept spheres and triangles that move: structures of many find what each of them
//! alone does, after updates and moves too.

use scenes::*;
use traversal::*;

fn point(random: &mut Random) -> [f32; 3] {
    narrow(3.0 * random.vector())
}

/// Positions and radii.
fn ends(seed: u64, count: usize) -> Vec<[f32; 4]> {
    let mut random = Random(seed);
    (0..count)
        .map(|_| {
            let [x, y, z] = point(&mut random);
            [x, y, z, 0.05 + 0.3 * random.unit() as f32]
        })
        .collect()
}

fn swept(ends: &[[f32; 4]], indexing: Indexing) -> SweptGeometry {
    let all = memory(ends);
    SweptGeometry {
        vertices: all,
        vertex_stride_bytes: 16,
        vertex_format: VertexFormat::F32x3,
        radii: Memory {
            base: all.base.wrapping_add(12),
            bytes: all.bytes - 12,
        },
        radius_stride_bytes: 16,
        radius_format: RadiusFormat::F32,
        first_vertex: 0,
        index_type: IndexType::None,
        indices: memory::<u32>(&[]),
        index_stride_bytes: 0,
        indexing,
        end_caps: EndCaps::Chained,
        primitive_count: match indexing {
            Indexing::Pairs => ends.len() as u32 / 2,
            _ => ends.len() as u32,
        },
        flags: GeometryFlags(GeometryFlags::OPAQUE),
    }
}

fn rays(count: usize) -> Vec<Ray> {
    let mut random = Random(77);
    (0..count)
        .map(|_| {
            let origin = narrow(9.0 * random.direction());
            let target = point(&mut random);
            ray(origin, std::array::from_fn(|i| target[i] - origin[i]))
        })
        .collect()
}

fn top_of(bottom: &Bytes) -> Bytes {
    build_instances(&[InstanceRecord::new(bottom, IDENTITY)], 0)
}

fn closest_at(top: &Bytes, ray: &Ray, time: f32) -> Option<(f32, u32)> {
    // SAFETY: the structures are alive.
    let mut walk = unsafe { Walk::new(top.address(), ray) };
    walk.set_time(time);
    let event = walk.resume(&mut Walker::new(), Verdict::Continue, &mut u64::MAX.clone());
    assert_eq!(event, Event::Done);
    walk.committed().map(|hit| (hit.t, hit.primitive_index))
}

/// Builds all primitives of a geometry, and each alone; both must find the same, as must what
/// became of the whole by copies.
fn check<'g>(
    flags: u32,
    count: usize,
    whole: Geometries<'g>,
    alone: impl Fn(usize) -> Bytes,
    time: f32,
) -> Bytes {
    let bottom = build_blob(&BuildInput {
        flags: BuildFlags(flags),
        geometries: whole,
    });
    same_as_alone(&bottom, count, &alone, time);
    let mut compact = Bytes::new(compacted_size(&bottom).unwrap());
    compact_into(&bottom, &mut compact).unwrap();
    same_as_alone(&compact, count, &alone, time);
    // SAFETY: there are no micromaps.
    let stored = unsafe {
        let mut stored = vec![0; serialized_size(&bottom, &EVERYWHERE).unwrap() as usize];
        serialize(&bottom, &[[0; 16]; 2], false, &mut stored, &EVERYWHERE).unwrap();
        stored
    };
    let mut restored = Bytes::new(Serialized::read(&stored).unwrap().deserialized_bytes);
    deserialize(&stored, &mut restored, &EVERYWHERE).unwrap();
    same_as_alone(&restored, count, &alone, time);
    bottom
}

fn same_as_alone(bottom: &Bytes, count: usize, alone: &impl Fn(usize) -> Bytes, time: f32) {
    let singles: Vec<Bytes> = (0..count).map(alone).collect();
    let tops: Vec<Bytes> = singles.iter().map(top_of).collect();
    let top = top_of(bottom);
    let mut hits = 0;
    for ray in rays(60) {
        let nearest = tops
            .iter()
            .enumerate()
            .filter_map(|(i, top)| Some((closest_at(top, &ray, time)?.0, i as u32)))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        assert_eq!(closest_at(&top, &ray, time), nearest);
        hits += u32::from(nearest.is_some());
    }
    assert!(hits > 10, "{hits}");
}

#[test]
fn round_primitives_are_found_after_builds_updates_and_moves() {
    for (indexing, count) in [(Indexing::Spheres, 120), (Indexing::Pairs, 60)] {
        let start = ends(1, 120);
        let moved = ends(2, 120);
        let alone = |all: &[[f32; 4]], i: usize| {
            let per = 120 / count;
            let own = &all[per * i..per * (i + 1)];
            build_blob(&BuildInput {
                flags: BuildFlags(0),
                geometries: Geometries::Swept(&[swept(own, indexing)]),
            })
        };
        for flags in [0, BuildFlags::LOW_MEMORY, BuildFlags::PREFER_FAST_BUILD] {
            let whole = [swept(&start, indexing)];
            let whole = Geometries::Swept(&whole);
            check(flags, count, whole, |i| alone(&start, i), 0.0);
        }
        let whole = [swept(&start, indexing)];
        let flags = BuildFlags::ALLOW_UPDATE;
        let mut bottom = check(
            flags,
            count,
            Geometries::Swept(&whole),
            |i| alone(&start, i),
            0.0,
        );
        let input = BuildInput {
            flags: BuildFlags(flags),
            geometries: Geometries::Swept(&[swept(&moved, indexing)]),
        };
        // SAFETY: the geometry's memory is borrowed here.
        unsafe { update(&input, None, &mut bottom, &mut [0; 256]) }.unwrap();
        same_as_alone(&bottom, count, &|i| alone(&moved, i), 0.0);
    }
}

fn corners(seed: u64, count: usize) -> Vec<[f32; 3]> {
    let mut random = Random(seed);
    (0..count)
        .flat_map(|_| {
            let center = point(&mut random);
            [(); 3].map(|()| {
                let offset = random.vector();
                std::array::from_fn(|k| center[k] + offset[k] as f32)
            })
        })
        .collect()
}

fn moving(start: &[[f32; 3]], end: &[[f32; 3]]) -> MotionGeometry {
    MotionGeometry {
        start: TriangleGeometry {
            vertices: memory(start),
            vertex_stride_bytes: 12,
            vertex_format: VertexFormat::F32x3,
            first_vertex: 0,
            index_type: IndexType::None,
            indices: memory::<u32>(&[]),
            transform: None,
            primitive_count: start.len() as u32 / 3,
            flags: GeometryFlags(GeometryFlags::OPAQUE),
            micromap: None,
        },
        end_vertices: memory(end),
    }
}

#[test]
fn moving_triangles_are_where_they_are_at_a_time() {
    let (start, end, other) = (corners(5, 100), corners(6, 100), corners(7, 100));
    let between = |end: &[[f32; 3]], time: f32, i: usize| {
        let own: Vec<[f32; 3]> = (3 * i..3 * i + 3)
            .map(|v| {
                std::array::from_fn(|axis| {
                    let (a, b) = (f64::from(start[v][axis]), f64::from(end[v][axis]));
                    (a * (1.0 - f64::from(time)) + b * f64::from(time)) as f32
                })
            })
            .collect();
        let mesh = Mesh {
            vertices: own,
            indices: vec![[0, 1, 2]],
            opaque: true,
        };
        build_meshes(&[mesh], 0)
    };
    let flags = BuildFlags::ALLOW_UPDATE;
    for time in [0.0, 0.3, 1.0] {
        let whole = [moving(&start, &end)];
        let alone = |i| between(&end, time, i);
        let mut bottom = check(flags, 100, Geometries::Motion(&whole), alone, time);
        let input = BuildInput {
            flags: BuildFlags(flags),
            geometries: Geometries::Motion(&[moving(&start, &other)]),
        };
        // SAFETY: the geometry's memory is borrowed here.
        unsafe { update(&input, None, &mut bottom, &mut [0; 256]) }.unwrap();
        same_as_alone(&bottom, 100, &|i| between(&other, time, i), time);
    }
}
