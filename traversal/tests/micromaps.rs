//! Micromaps: closed meshes stay closed, and structures take their micromaps along.

use scenes::groups::Groups;
use scenes::*;
use traversal::*;

/// A sphere whose triangles all use triangle 0 of a micromap.
struct Sphere {
    mesh: Mesh,
    _micromap: Bytes,
    bottom: Bytes,
    top: Bytes,
}

/// A micromap of one triangle of two levels, with these states.
fn micromap(states: [u8; 16]) -> Bytes {
    let mut packed = [0u8; 4];
    for (part, state) in states.iter().enumerate() {
        packed[part / 4] |= state << (2 * (part % 4));
    }
    let record = [0u16, 0, 2, MicromapFormat::FourStates as u16];
    let size = micromap_size([MicromapUsage {
        count: 1,
        level: 2,
        format: MicromapFormat::FourStates,
    }]);
    let mut blob = Bytes::new(size.unwrap());
    let input = MicromapInput {
        triangles: memory(&record),
        stride_bytes: 8,
        count: 1,
        data: memory(&packed),
    };
    // SAFETY: both arrays are alive.
    let used = unsafe { build_micromap(&input, &mut blob) }.unwrap();
    assert!(used <= size.unwrap());
    blob
}

/// All triangles have the micromap's first.
fn geometry(mesh: &Mesh, micromap: &Bytes, listed: bool) -> TriangleGeometry {
    static FIRST: u32 = 0;
    TriangleGeometry {
        micromap: Some(GeometryMicromap {
            index_type: IndexType::U32,
            indices: memory(std::slice::from_ref(&FIRST)),
            index_stride_bytes: 0,
            base_triangle: 0,
            micromap: micromap.address(),
            listed,
        }),
        ..mesh.geometry()
    }
}

fn sphere(states: [u8; 16]) -> Sphere {
    sphere_of(states, false)
}

/// The same; its micromap may be listed in what it is serialized to.
fn sphere_of(states: [u8; 16], listed: bool) -> Sphere {
    let mesh = Mesh::icosphere(2, false, |p| p);
    let micromap = micromap(states);
    let geometry = geometry(&mesh, &micromap, listed);
    let input = BuildInput {
        flags: BuildFlags(BuildFlags::ALLOW_UPDATE),
        geometries: Geometries::Triangles(&[geometry]),
    };
    let count = mesh.indices.len() as u32;
    let sizes = build_sizes(Kind::Triangles, input.flags, &[count]);
    let mut bottom = Bytes::new(sizes.structure_bytes + micromap_bytes(&[count]));
    let mut scratch = Bytes::new(sizes.build_scratch_bytes);
    // SAFETY: the mesh is alive.
    unsafe { build(&input, &mut bottom, &mut scratch) }.unwrap();
    validate(&bottom).unwrap();
    let top = build_instances(&[InstanceRecord::new(&bottom, IDENTITY)], 0);
    Sphere {
        mesh,
        _micromap: micromap,
        bottom,
        top,
    }
}

/// Rays from inside, through vertices, edges and anywhere.
fn rays(mesh: &Mesh) -> Vec<Ray> {
    let mut random = Random(5);
    let mut directions: Vec<[f32; 3]> = mesh.vertices.clone();
    for triangle in &mesh.indices {
        let [a, b] = [0, 1].map(|i| wide(mesh.vertices[triangle[i] as usize]));
        let share = random.unit();
        directions.push(narrow(std::array::from_fn(|i| {
            a[i] + share * (b[i] - a[i])
        })));
    }
    directions.extend((0..500).map(|_| narrow(random.direction())));
    let mut all = Vec::new();
    for direction in directions {
        all.push(ray([0.0; 3], direction));
        all.push(ray([0.01, 0.02, -0.03], direction));
    }
    all
}

#[test]
fn opaque_parts_leave_no_holes() {
    let sphere = sphere([1; 16]);
    for ray in rays(&sphere.mesh) {
        let hit = closest(&sphere.top, &ray).expect("the sphere is closed");
        assert!(hit.opaque);
        assert!(candidates(&sphere.top, &ray).is_empty());
    }
}

#[test]
fn unknown_parts_are_asked_about_once() {
    for state in [2, 3] {
        let sphere = sphere([state; 16]);
        for ray in rays(&sphere.mesh) {
            assert_eq!(candidates(&sphere.top, &ray).len(), 1, "{ray:?}");
        }
    }
}

#[test]
fn transparent_parts_are_not_there() {
    let sphere = sphere([0; 16]);
    for ray in rays(&sphere.mesh) {
        assert_eq!(closest(&sphere.top, &ray), None);
    }
}

/// A structure from serialized data, and a top level over it.
fn deserialized(data: &[u8]) -> (Bytes, Bytes) {
    let size = Serialized::read(data).unwrap().deserialized_bytes;
    let mut bottom = Bytes::new(size);
    assert_eq!(deserialize(data, &mut bottom, &EVERYWHERE), Ok(size));
    let top = build_instances(&[InstanceRecord::new(&bottom, IDENTITY)], 0);
    (bottom, top)
}

fn serialized(blob: &[u8]) -> Vec<u8> {
    // SAFETY: the micromaps are alive, or inside.
    unsafe {
        let mut data = vec![0; serialized_size(blob, &EVERYWHERE).unwrap() as usize];
        serialize(blob, &[[0; 16]; 2], false, &mut data, &EVERYWHERE).unwrap();
        data
    }
}

#[test]
fn serialized_structures_take_their_micromaps_along() {
    let states = std::array::from_fn(|part| (part % 4) as u8);
    let original = sphere(states);
    let rays = rays(&original.mesh);
    let found = |top: &Bytes| -> Vec<_> {
        let walk = |ray| (closest(top, ray), candidates(top, ray));
        rays.iter().map(walk).collect()
    };
    let expected = found(&original.top);
    let data = serialized(&original.bottom);
    drop(original);
    let (bottom, top) = deserialized(&data);
    assert!(found(&top) == expected);
    // Once more, from a structure that holds its micromap.
    let again = serialized(&bottom);
    assert_eq!(again.len(), data.len());
    drop((bottom, top));
    let (_bottom, top) = deserialized(&again);
    assert!(found(&top) == expected);
}

#[test]
fn an_update_replaces_what_was_taken_along() {
    let original = sphere([0; 16]);
    let (mut bottom, _) = deserialized(&serialized(&original.bottom));
    let opaque = micromap([1; 16]);
    let input = BuildInput {
        flags: BuildFlags(BuildFlags::ALLOW_UPDATE),
        geometries: Geometries::Triangles(&[geometry(&original.mesh, &opaque, false)]),
    };
    // Into memory as large as a new structure's, and in place.
    let mut copy = Bytes::new(original.bottom.len() as u64);
    // SAFETY: the mesh and the micromap are alive.
    unsafe {
        update(&input, Some(&bottom), &mut copy, &mut []).unwrap();
        update(&input, None, &mut bottom, &mut []).unwrap();
    }
    for blob in [&copy, &bottom] {
        validate(blob).unwrap();
        let top = build_instances(&[InstanceRecord::new(blob, IDENTITY)], 0);
        for ray in rays(&original.mesh) {
            assert!(closest(&top, &ray).is_some());
        }
    }
}

#[test]
fn serialized_data_names_no_addresses() {
    let original = sphere([1; 16]);
    let data = serialized(&original.bottom);
    let (bottom, _) = deserialized(&data);
    // The one word that says where the micromap is: an offset, and the lowest bit.
    let inside = (0..data.len() - 8).filter(|&place| {
        let word = u64::from_le_bytes(data[place..place + 8].try_into().unwrap());
        place % 8 == 0 && word % 256 == 1 && word > 1 && word < data.len() as u64
    });
    let mut refused = 0;
    for place in inside {
        let mut bad = data.clone();
        bad[place] ^= 1;
        let mut destination = Bytes::new(bottom.len() as u64);
        refused += u32::from(deserialize(&bad, &mut destination, &EVERYWHERE).is_err());
    }
    assert!(refused >= 1);
}

#[test]
fn corrupt_micromaps_are_walked_to_the_end() {
    let original = sphere([3; 16]);
    let data = serialized(&original.bottom);
    let rays = rays(&original.mesh);
    let mut random = Random(9);
    let (mut bottom, top) = deserialized(&data);
    let good = bottom.to_vec();
    let part = good.len() - 4096.min(good.len() / 4);
    let aside = |i: usize| {
        [
            0.3 + 0.01 * (i % 4) as f32,
            0.2 + 0.01 * (i / 4) as f32,
            1.0,
        ]
    };
    let together: Vec<_> = (0..64).map(|i| ray([0.0; 3], aside(i % 16))).collect();
    let mut walker = Walker::new();
    for _ in 0..300 {
        for _ in 0..4 {
            let place = part + (random.unit() * (good.len() - part) as f64) as usize;
            // References are addresses, or the lowest bit makes them offsets: these stay.
            let word: [u8; 8] = good[place / 8 * 8..][..8].try_into().unwrap();
            if u64::from_le_bytes(word) % 256 != 1 {
                bottom[place] = (random.unit() * 256.0) as u8;
            }
        }
        for ray in rays.iter().step_by(97) {
            closest(&top, ray);
        }
        // Those that go together, and those that do not.
        for rays in [&together, &rays] {
            let accept = |_: &RayRows, group_walk: &mut GroupWalk| {
                group_walk.accept(group_walk.candidates().found);
            };
            // SAFETY: the structures are alive.
            unsafe { Groups::new(&top, rays, accept).trace(&mut walker, usize::MAX) };
        }
        bottom.copy_from_slice(&good);
    }
    let counts = walker.counts();
    assert!(counts.together >= 4, "{counts:?}");
}

/// How many rays hit, and how many meet candidates.
fn met(bottom: &Bytes, rays: &[Ray]) -> [usize; 2] {
    let top = build_instances(&[InstanceRecord::new(bottom, IDENTITY)], 0);
    let hits = rays.iter().filter(|ray| closest(&top, ray).is_some());
    let asked = rays.iter().filter(|ray| !candidates(&top, ray).is_empty());
    [hits.count(), asked.count()]
}

/// Places of the words for blocks, of the block's type and of its first address (chapter
/// Acceleration Structures, the header of serialized data).
const BLOCKS: usize = 48;
const TYPE: usize = 56;
const COUNT: usize = 64;
const ADDRESS: usize = 72;

fn put_word(data: &mut [u8], place: usize, word: u64) {
    data[place..place + 8].copy_from_slice(&word.to_le_bytes());
}

#[test]
fn listed_micromaps_are_where_the_list_says() {
    let original = sphere_of([1; 16], true);
    let rays = rays(&original.mesh);
    let all = rays.len();
    let mut data = serialized(&original.bottom);
    let word =
        |data: &[u8], place: usize| u64::from_le_bytes(data[place..place + 8].try_into().unwrap());
    let words = [BLOCKS, TYPE, COUNT, ADDRESS].map(|place| word(&data, place));
    let micromap_address = original._micromap.address();
    assert_eq!(words, [0xFFFF_FFFF_0000_0001, 0, 1, micromap_address]);
    assert_eq!(word(&data, 32), data.len() as u64);
    let (bottom, _) = deserialized(&data);
    assert_eq!(met(&bottom, &rays), [all, 0]);
    // Serialized again, it is the same.
    assert!(serialized(&bottom) == data);
    drop((bottom, original));

    let unknown = micromap([2; 16]);
    put_word(&mut data, ADDRESS, unknown.address());
    let (bottom, _) = deserialized(&data);
    assert_eq!(met(&bottom, &rays), [all, all]);
    // Nowhere: a shader is asked.
    for nowhere in [0, unknown.address() + 64, 256] {
        put_word(&mut data, ADDRESS, nowhere);
        let (bottom, _) = deserialized(&data);
        assert_eq!(met(&bottom, &rays), [all, all]);
    }
}

#[test]
fn wrong_lists_are_refused() {
    let original = sphere_of([1; 16], true);
    let data = serialized(&original.bottom);
    for (place, word) in [
        (BLOCKS, 0xFFFF_FFFF_0000_0002),
        (BLOCKS, 0xFFFF_FFFF_0000_0000),
        (BLOCKS, 0xFFFF_FFFE_0000_0001),
        (BLOCKS, 0),
        (TYPE, 1),
        (COUNT, 0),
        (COUNT, 2),
        (COUNT, u64::MAX),
        (COUNT, 1 << 61),
    ] {
        let mut bad = data.clone();
        put_word(&mut bad, place, word);
        let mut destination = Bytes::new(original.bottom.len() as u64);
        let done = deserialize(&bad, &mut destination, &EVERYWHERE);
        assert!(done.is_err(), "{place} {word:#x}");
    }
    for length in [BLOCKS + 4, TYPE, TYPE + 4, COUNT + 8, data.len() - 1] {
        let mut destination = Bytes::new(original.bottom.len() as u64);
        let done = deserialize(&data[..length], &mut destination, &EVERYWHERE);
        assert!(done.is_err(), "{length}");
    }
}

#[test]
fn a_map_of_the_last_level_needs_its_memory() {
    use micromap::MAX_LEVEL;
    let format = MicromapFormat::FourStates;
    let usage = MicromapUsage {
        count: 1,
        level: MAX_LEVEL,
        format,
    };
    assert_eq!(format.triangle_bytes(MAX_LEVEL), 256 << 20);
    assert_eq!(micromap_size([usage]), Some((256 << 20) + 256));
    let record = [0u16, 0, MAX_LEVEL as u16, format as u16];
    let build = |bytes: &[u8], room: u64| {
        let mut blob = Bytes::new(room);
        let input = MicromapInput {
            triangles: memory(&record),
            stride_bytes: 8,
            count: 1,
            data: memory(bytes),
        };
        // SAFETY: both arrays are alive.
        unsafe { build_micromap(&input, &mut blob) }
    };
    // States that are not there make a triangle that asks; so small a map fits.
    assert_eq!(build(&[0; 4096], 4096), Ok(256));
    let states = vec![0; 256 << 20];
    assert_eq!(build(&states, 4096), Err(BuildError::Destination));
    // The level after the last is none.
    let usage = MicromapUsage {
        level: MAX_LEVEL + 1,
        ..usage
    };
    assert_eq!(micromap_size([usage]), Some((256 << 20) + 256));
}
