//! Structures as memory: sizes, updates, copies, serialization, corruption, determinism.

use scenes::*;
use traversal::*;

fn sphere(levels: u32, scale: f64, opaque: bool) -> Mesh {
    Mesh::icosphere(levels, opaque, |p| p * scale)
}

/// A landscape: (n × n) squares of two triangles each.
fn landscape(n: u32) -> Mesh {
    let mut mesh = Mesh {
        opaque: true,
        ..Mesh::default()
    };
    for y in 0..=n {
        for x in 0..=n {
            let (fx, fy) = (f64::from(x) / f64::from(n), f64::from(y) / f64::from(n));
            let z = 0.1 * (20.0 * fx).sin() * (15.0 * fy).cos();
            mesh.vertices.push([fx as f32, fy as f32, z as f32]);
        }
    }
    for y in 0..n {
        for x in 0..n {
            let a = y * (n + 1) + x;
            let (b, c, d) = (a + 1, a + n + 1, a + n + 2);
            mesh.indices.push([a, b, c]);
            mesh.indices.push([b, d, c]);
        }
    }
    mesh
}

fn soup(count: u32, size: f64) -> Mesh {
    let mut random = Random(12345);
    let mut mesh = Mesh {
        opaque: true,
        ..Mesh::default()
    };
    for i in 0..count {
        let center = random.vector();
        for _ in 0..3 {
            let offset = random.vector();
            mesh.vertices.push(narrow(center + size * offset));
        }
        mesh.indices.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    mesh
}

fn rays(count: usize) -> Vec<Ray> {
    let mut random = Random(4242);
    (0..count)
        .map(|_| {
            let origin = 3.0 * random.direction();
            let target = 0.7 * random.vector();
            ray(narrow(origin), narrow(target - origin))
        })
        .collect()
}

fn hits(top: &Bytes) -> Vec<Option<Hit>> {
    let mut walker = Walker::new();
    rays(300)
        .iter()
        .map(|ray| closest_with(&mut walker, top, ray))
        .collect()
}

/// The parts of hits that do not depend on where in the blob a primitive lies.
fn without_slots(hits: &[Option<Hit>]) -> Vec<Option<Hit>> {
    hits.iter()
        .map(|hit| hit.map(|hit| Hit { slot: 0, ..hit }))
        .collect()
}

#[test]
fn sizes_are_what_was_promised() {
    for (name, mesh, compact, low) in [
        ("sphere", sphere(5, 1.0, true), 80, 50),
        ("landscape", landscape(100), 80, 50),
        ("soup of small", soup(20_000, 0.01), 80, 70),
        ("soup of large", soup(20_000, 0.5), 80, 70),
    ] {
        let n = mesh.indices.len() as u64;
        let sizes = build_sizes(Kind::Triangles, BuildFlags(0), &[n as u32]);
        assert!(sizes.structure_bytes <= 100 * n, "{name} {sizes:?}");
        assert!(sizes.build_scratch_bytes <= 150 * n, "{name} {sizes:?}");
        for (flags, most) in [(0, compact), (BuildFlags::LOW_MEMORY, low)] {
            let blob = build_meshes(std::slice::from_ref(&mesh), flags);
            let size = compacted_size(&blob).unwrap();
            println!("{name}: {:.1} bytes a triangle", size as f64 / n as f64);
            assert!(size <= most * n, "{name}: {}", size as f64 / n as f64);
        }
    }
}

#[test]
fn sizes_grow_with_counts_and_geometries() {
    for kind in [Kind::Triangles, Kind::Aabbs, Kind::Instances] {
        let mut last = BuildSizes::default();
        for count in (0..2000).chain([10_000, 1 << 20, (1 << 24) - 1]) {
            let sizes = build_sizes(kind, BuildFlags(0), &[count]);
            assert!(
                sizes.structure_bytes >= last.structure_bytes,
                "{kind:?} {count}"
            );
            assert!(sizes.build_scratch_bytes >= last.build_scratch_bytes);
            last = sizes;
        }
    }
    let one = build_sizes(Kind::Triangles, BuildFlags(0), &[100]);
    let two = build_sizes(Kind::Triangles, BuildFlags(0), &[50, 50]);
    assert!(two.structure_bytes >= one.structure_bytes);
}

#[test]
fn few_primitives_fit() {
    // Far apart, so that each wants a leaf of its own.
    for n in 0..200u32 {
        let mut mesh = soup(n, 1e-4);
        mesh.opaque = true;
        build_meshes(std::slice::from_ref(&mesh), 0);
        let boxes: Vec<[f32; 6]> = (0..n)
            .map(|i| {
                let at = (i * i) as f32;
                [at, -at, 0.0, at + 0.1, -at, 0.1]
            })
            .collect();
        let bottom = build_boxes(&boxes, true, 0);
        let records: Vec<_> = (0..n)
            .map(|i| {
                let mut transform = IDENTITY;
                transform[3] = (i * i) as f32;
                InstanceRecord::new(&bottom, transform)
            })
            .collect();
        build_instances(&records, 0);
    }
}

#[test]
fn memory_that_is_too_small_is_refused() {
    let mesh = sphere(2, 1.0, true);
    let geometry = [mesh.geometry()];
    let input = BuildInput {
        flags: BuildFlags(0),
        geometries: Geometries::Triangles(&geometry),
    };
    let sizes = build_sizes(Kind::Triangles, BuildFlags(0), &[mesh.indices.len() as u32]);
    let mut blob = Bytes::new(sizes.structure_bytes);
    let mut scratch = Bytes::new(sizes.build_scratch_bytes);
    let mut small = Bytes::new(sizes.structure_bytes - 1);
    let mut little = Bytes::new(sizes.build_scratch_bytes - 65);
    // SAFETY: the mesh is alive.
    unsafe {
        assert_eq!(
            build(&input, &mut small, &mut scratch),
            Err(BuildError::Destination)
        );
        assert_eq!(
            build(&input, &mut blob[64..], &mut scratch),
            Err(BuildError::Destination)
        );
        assert_eq!(
            build(&input, &mut blob, &mut little),
            Err(BuildError::Scratch)
        );
        assert!(build(&input, &mut blob, &mut scratch).is_ok());
    }
}

#[test]
fn updates_find_what_a_new_build_finds() {
    let before = sphere(4, 1.0, true);
    let mut after = before.clone();
    for (i, vertex) in after.vertices.iter_mut().enumerate() {
        let swell = 1.0 + 0.2 * (i as f32).sin();
        *vertex = vertex.map(|c| c * swell);
    }
    let flags = BuildFlags::ALLOW_UPDATE;
    let geometry = [after.geometry()];
    let input = BuildInput {
        flags: BuildFlags(flags),
        geometries: Geometries::Triangles(&geometry),
    };
    let old = build_meshes(std::slice::from_ref(&before), flags);
    let new = Scene::new(std::slice::from_ref(&after), flags);
    let expected = without_slots(&hits(&new.top));

    // Into other memory, then in place.
    let mut copy = Bytes::new(compacted_size(&old).unwrap());
    // SAFETY: the meshes are alive.
    unsafe { update(&input, Some(&old), &mut copy, &mut []) }.unwrap();
    validate(&copy).unwrap();
    let mut place = old;
    // SAFETY: the meshes are alive.
    unsafe { update(&input, None, &mut place, &mut []) }.unwrap();
    assert_eq!(copy[..], place[..copy.len()]);
    let top = build_instances(&[InstanceRecord::new(&copy, IDENTITY)], flags);
    assert_eq!(without_slots(&hits(&top)), expected);

    // Another shape is no source.
    let other = build_meshes(&[sphere(3, 1.0, true)], flags);
    let mut blob = Bytes::new(copy.len() as u64);
    // SAFETY: the meshes are alive.
    let result = unsafe { update(&input, Some(&other), &mut blob, &mut []) };
    assert_eq!(result, Err(BuildError::Source));
    let fixed = build_meshes(std::slice::from_ref(&before), 0);
    // SAFETY: the meshes are alive.
    let result = unsafe { update(&input, Some(&fixed), &mut blob, &mut []) };
    assert_eq!(result, Err(BuildError::Source));
}

/// Triangles that all change places with each other.
fn shuffled(mesh: &Mesh) -> Mesh {
    let mut after = mesh.clone();
    let count = mesh.indices.len();
    for i in 0..count {
        let from = mesh.triangle(i * 7919 % count);
        let to = mesh.indices[i];
        for (vertex, position) in to.into_iter().zip(from) {
            after.vertices[vertex as usize] = position;
        }
    }
    after
}

#[test]
fn worn_structures_are_built_anew_where_there_is_room() {
    let before = soup(6000, 0.02);
    let flags = BuildFlags::ALLOW_UPDATE;
    let sizes = build_sizes(Kind::Triangles, BuildFlags(flags), &[6000]);
    let built = build_meshes(std::slice::from_ref(&before), flags);
    let updated = |after: &Mesh, mut blob: Bytes, scratch: u64| {
        let geometry = [after.geometry()];
        let input = BuildInput {
            flags: BuildFlags(flags),
            geometries: Geometries::Triangles(&geometry),
        };
        let mut scratch = Bytes::new(scratch);
        // SAFETY: the mesh is alive.
        let used = unsafe { update(&input, Some(&built), &mut blob, &mut scratch) }.unwrap();
        validate(&blob).unwrap();
        blob[..used as usize].to_vec()
    };
    let full = || Bytes::new(sizes.structure_bytes);
    let new = |mesh: &Mesh| {
        let blob = build_meshes(std::slice::from_ref(mesh), flags);
        blob[..compacted_size(&blob).unwrap() as usize].to_vec()
    };
    // A small step: the tree stays.
    let mut moved = before.clone();
    for vertex in &mut moved.vertices {
        vertex[0] *= 1.01;
    }
    let step = updated(&moved, full(), sizes.update_scratch_bytes);
    assert!(step != new(&moved));
    // Nothing is where it was.
    let after = shuffled(&before);
    assert!(updated(&after, full(), sizes.update_scratch_bytes) == new(&after));
    // Without scratch memory or in a compacted place, it is refitted all the same.
    let place = Bytes::new(compacted_size(&built).unwrap());
    for worn in [
        updated(&after, full(), 0),
        updated(&after, place, sizes.update_scratch_bytes),
    ] {
        assert!(worn != new(&after));
        let mut blob = Bytes::new(worn.len() as u64);
        blob.copy_from_slice(&worn);
        let top = build_instances(&[InstanceRecord::new(&blob, IDENTITY)], 0);
        let expected = Scene::new(std::slice::from_ref(&after), 0);
        assert_eq!(
            without_slots(&hits(&top)),
            without_slots(&hits(&expected.top))
        );
    }
}

#[test]
fn threads_do_not_show_in_updates() {
    let before = [sphere(5, 0.9, true), soup(5000, 0.05)];
    let mut after = before.clone();
    for vertex in after.iter_mut().flat_map(|mesh| &mut mesh.vertices) {
        vertex[1] += 0.2 * (4.0 * vertex[0]).sin();
    }
    let flags = BuildFlags::ALLOW_UPDATE;
    let list: Vec<_> = after.iter().map(Mesh::geometry).collect();
    let input = BuildInput {
        flags: BuildFlags(flags),
        geometries: Geometries::Triangles(&list),
    };
    let blob = || {
        let mut blob = build_meshes(&before, flags);
        // SAFETY: the meshes are alive.
        unsafe { update(&input, None, &mut blob, &mut []) }.unwrap();
        blob[..compacted_size(&blob).unwrap() as usize].to_vec()
    };
    let serial = blob();
    for threads in [1, 2, 5] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        assert!(
            pool.build().unwrap().install(blob) == serial,
            "{threads} threads"
        );
    }
}

#[test]
fn top_levels_and_boxes_update() {
    let flags = BuildFlags::ALLOW_UPDATE;
    let bottom = build_meshes(&[sphere(2, 0.2, true)], 0);
    let mut records: Vec<_> = (0..20)
        .map(|i| {
            let mut transform = IDENTITY;
            transform[3] = i as f32 * 0.1;
            InstanceRecord::new(&bottom, transform)
        })
        .collect();
    let mut top = build_instances(&records, flags);
    for (i, record) in records.iter_mut().enumerate() {
        record.transform[3] = 0.0;
        record.transform[7] = i as f32 * 0.05 - 0.5;
        record.custom_index_and_mask = 0xFF00_0000 | i as u32;
    }
    let input = BuildInput {
        flags: BuildFlags(flags),
        geometries: Geometries::Instances(InstanceSource {
            memory: memory(&records),
            array: InstanceArray::Records,
            count: 20,
            flags: GeometryFlags(0),
            live: &EVERYWHERE,
        }),
    };
    // SAFETY: records and bottom levels are alive.
    unsafe { update(&input, None, &mut top, &mut []) }.unwrap();
    assert_eq!(hits(&top), hits(&build_instances(&records, flags)));

    let mut boxes: Vec<[f32; 6]> = (0..50)
        .map(|i| [i as f32, 0.0, 0.0, i as f32 + 0.5, 1.0, 1.0])
        .collect();
    let mut blob = build_boxes(&boxes, true, flags);
    for (i, bounds) in boxes.iter_mut().enumerate() {
        let i = (i * 7 % 50) as f32;
        *bounds = [0.0, i, 0.0, 1.0, i + 0.5, 1.0];
    }
    let geometry = [AabbGeometry {
        boxes: memory(&boxes),
        stride_bytes: 24,
        primitive_count: 50,
        flags: GeometryFlags(1),
    }];
    let input = BuildInput {
        flags: BuildFlags(flags),
        geometries: Geometries::Aabbs(&geometry),
    };
    // SAFETY: the boxes are alive.
    unsafe { update(&input, None, &mut blob, &mut []) }.unwrap();
    let top = build_instances(&[InstanceRecord::new(&blob, IDENTITY)], 0);
    for i in 0..50 {
        let y = (i * 7 % 50) as f32 + 0.25;
        let found = candidates(&top, &ray([-1.0, y, 0.5], [1.0, 0.0, 0.0]));
        let found: Vec<_> = found.iter().map(|hit| hit.primitive_index).collect();
        assert_eq!(found, [i]);
    }
}

#[test]
fn copies_and_serialized_structures_walk_the_same() {
    let bottom = build_meshes(&[sphere(4, 1.0, true), landscape(20)], 0);
    let mut far = IDENTITY;
    far[3] = 0.5;
    let top = build_instances(
        &[
            InstanceRecord::new(&bottom, IDENTITY),
            InstanceRecord::new(&bottom, far),
        ],
        0,
    );
    let expected = hits(&top);
    assert!(expected.iter().flatten().count() > 100);

    let mut compact = Bytes::new(compacted_size(&top).unwrap());
    compact_into(&top, &mut compact).unwrap();
    assert_eq!(hits(&compact), expected);
    let mut copy = Bytes::new(top.len() as u64);
    copy_into(&top, &mut copy).unwrap();
    assert_eq!(hits(&copy), expected);

    let uuids = [[7; 16], [9; 16]];
    let store = |blob: &Bytes, in_blocks: bool| {
        // SAFETY: there are no micromaps.
        let size = unsafe { serialized_size(blob, &EVERYWHERE) }.unwrap();
        let mut data = vec![0; size as usize];
        // SAFETY: there are no micromaps.
        let done = unsafe { serialize(blob, &uuids, in_blocks, &mut data, &EVERYWHERE) };
        assert_eq!(done, Ok(size));
        data
    };
    let stored_bottom = store(&bottom, false);
    let mut stored_top = store(&top, false);
    let head = Serialized::read(&stored_top).unwrap();
    assert_eq!(head.uuids, uuids);
    assert_eq!(head.serialized_bytes, stored_top.len() as u64);
    assert_eq!(head.reference_count, 2);
    assert_eq!(Serialized::read(&stored_bottom).unwrap().reference_count, 0);
    // The heads of bottom levels alone count blocks.
    assert_eq!(store(&top, true), stored_top);
    let in_blocks = store(&bottom, true);
    let count = Serialized::read(&in_blocks).unwrap().reference_count;
    assert_eq!(count, 0xFFFF_FFFF << 32);

    let restore = |data: &[u8]| {
        let size = Serialized::read(data).unwrap().deserialized_bytes;
        let mut blob = Bytes::new(size);
        assert_eq!(deserialize(data, &mut blob, &EVERYWHERE), Ok(size));
        blob
    };
    assert!(restore(&in_blocks)[..] == restore(&stored_bottom)[..]);
    let moved = restore(&stored_bottom);
    drop(bottom);
    for reference in stored_top[Serialized::HEAD_BYTES..][..16].chunks_exact_mut(8) {
        reference.copy_from_slice(&moved.address().to_le_bytes());
    }
    drop(top);
    let top = restore(&stored_top);
    assert_eq!(hits(&top), expected);
}

#[test]
fn corrupt_data_is_refused_and_corrupt_structures_are_walked_safely() {
    let bottom = build_meshes(&[sphere(3, 1.0, false)], 0);
    // SAFETY: there are no micromaps.
    let mut data = vec![0; unsafe { serialized_size(&bottom, &EVERYWHERE) }.unwrap() as usize];
    // SAFETY: there are no micromaps.
    unsafe { serialize(&bottom, &[[0; 16]; 2], false, &mut data, &EVERYWHERE) }.unwrap();
    let size = compacted_size(&bottom).unwrap();
    let mut random = Random(99);
    for length in [0, 8, 55, 56, 57, 200, 311, data.len() - 1] {
        let mut blob = Bytes::new(size);
        assert!(deserialize(&data[..length], &mut blob, &EVERYWHERE).is_err());
    }
    let mut walker = Walker::new();
    let rays = rays(20);
    for _ in 0..2000 {
        let mut bad = data.clone();
        for _ in 0..1 + (random.unit() * 4.0) as usize {
            let at = (random.unit() * bad.len() as f64) as usize;
            bad[at] = (random.unit() * 256.0) as u8;
        }
        let mut blob = Bytes::new(size);
        let _ = deserialize(&bad, &mut blob, &EVERYWHERE);

        // In place, without the driver's knowledge, except for the header.
        let mut blob = Bytes::new(size);
        compact_into(&bottom, &mut blob).unwrap();
        let body = 256;
        for _ in 0..20 {
            let at = body + (random.unit() * (blob.len() - body) as f64) as usize;
            blob[at] = (random.unit() * 256.0) as u8;
        }
        let top = build_instances(&[InstanceRecord::new(&blob, IDENTITY)], 0);
        for ray in &rays {
            // SAFETY: the structures are alive, and what is in them is checked as it is read.
            let mut walk = unsafe { Walk::new(top.address(), ray) };
            let mut fuel = 20_000;
            loop {
                match walk.resume(&mut walker, Verdict::Continue, &mut fuel) {
                    Event::Done | Event::OutOfFuel => break,
                    _ => {}
                }
            }
        }
    }
}

#[test]
fn threads_and_tiers_do_not_show() {
    let meshes = [sphere(5, 0.9, true), landscape(60), soup(5000, 0.05)];
    let serial = build_meshes(&meshes, 0);
    for threads in [1, 2, 5] {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let parallel = pool.install(|| build_meshes(&meshes, 0));
        let size = compacted_size(&serial).unwrap() as usize;
        assert!(serial[..size] == parallel[..size], "{threads} threads");
    }
    let scene = Scene::placed(
        &meshes,
        0,
        [0.8, 0.1, 0.0, 0.1, -0.1, 0.8, 0.2, 0.0, 0.0, -0.2, 0.9, 0.0],
    );
    let tiers: Vec<_> = Tier::ALL
        .into_iter()
        .filter_map(Walker::with_tier)
        .map(|mut walker| {
            rays(2000)
                .iter()
                .map(|ray| closest_with(&mut walker, &scene.top, ray))
                .collect::<Vec<_>>()
        })
        .collect();
    for tier in &tiers {
        assert!(tier == &tiers[0]);
    }
}

#[test]
fn the_build_does_not_show_in_the_hits() {
    // Coplanar stacks and coincident meshes, so that distances are equal.
    let meshes = [
        sphere(3, 0.8, true),
        sphere(3, 0.8, true),
        landscape(30),
        landscape(15),
        soup(3000, 0.1),
    ];
    let good = Scene::new(&meshes, 0);
    let expected = without_slots(&hits(&good.top));
    for flags in [
        BuildFlags::LOW_MEMORY,
        BuildFlags::PREFER_FAST_BUILD,
        BuildFlags::PREFER_FAST_TRACE,
    ] {
        let other = Scene::new(&meshes, flags);
        assert_eq!(without_slots(&hits(&other.top)), expected, "{flags:#x}");
    }
}
