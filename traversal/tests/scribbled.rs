//! Other threads write into structures while rays walk through them: whatever a walk reads, it
//! stays inside the live memory, and every walk ends.

use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

use scenes::groups::Groups;
use scenes::*;
use traversal::*;

/// How many rounds of walks and copies there are, while other threads write.
const ROUNDS: u32 = 100;

/// How many times the writers write at least meanwhile: where processors are few they take turns
/// with the walks.
const WRITES: u64 = 100;

/// Steps of a walk that may go in circles.
const FUEL: u64 = 5_000;

/// All structures of a scene in one piece of memory: what is live.
struct Arena {
    memory: Bytes,
    /// As it was built.
    pristine: Vec<u32>,
    /// Where each structure is, the top levels last.
    places: Vec<std::ops::Range<usize>>,
}

fn soup(random: &mut Random, opaque: bool) -> Mesh {
    let mut mesh = Mesh {
        opaque,
        ..Mesh::default()
    };
    for i in 0..400u32 {
        let centre = random.vector();
        for _ in 0..3 {
            let offset = random.vector();
            mesh.vertices.push(std::array::from_fn(|k| {
                (centre[k] + 0.3 * offset[k]) as f32
            }));
        }
        mesh.indices.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    mesh
}

fn swept(mesh: &Mesh) -> Bytes {
    let radii = vec![0.05f32; mesh.vertices.len()];
    build_blob(&BuildInput {
        flags: BuildFlags(0),
        geometries: Geometries::Swept(&[SweptGeometry {
            vertices: memory(&mesh.vertices),
            vertex_stride_bytes: 12,
            vertex_format: VertexFormat::F32x3,
            radii: memory(&radii),
            radius_stride_bytes: 4,
            radius_format: RadiusFormat::F32,
            first_vertex: 0,
            index_type: IndexType::None,
            indices: memory::<u32>(&[]),
            index_stride_bytes: 0,
            indexing: Indexing::Pairs,
            end_caps: EndCaps::Chained,
            primitive_count: 300,
            flags: GeometryFlags(0),
        }]),
    })
}

fn moving(mesh: &Mesh) -> Bytes {
    build_blob(&BuildInput {
        flags: BuildFlags(0),
        geometries: Geometries::Motion(&[MotionGeometry {
            start: mesh.geometry(),
            end_vertices: memory(&mesh.vertices[3..]),
        }]),
    })
}

/// Triangles whose opacity is in a micromap.
fn mapped(mesh: &Mesh, micromap: u64, indices: &[u32]) -> Bytes {
    let input = BuildInput {
        flags: BuildFlags(0),
        geometries: Geometries::Triangles(&[TriangleGeometry {
            micromap: Some(GeometryMicromap {
                index_type: IndexType::U32,
                indices: memory(indices),
                index_stride_bytes: 4,
                base_triangle: 0,
                micromap,
                listed: true,
            }),
            ..mesh.geometry()
        }]),
    };
    let sizes = build_sizes(Kind::Triangles, input.flags, &[400]);
    let mut blob = Bytes::new(sizes.structure_bytes + micromap_bytes(&[400]));
    let mut scratch = Bytes::new(sizes.build_scratch_bytes);
    // SAFETY: what the input names is alive.
    unsafe { build(&input, &mut blob, &mut scratch) }.expect("the build succeeds");
    blob
}

impl Arena {
    fn new() -> Arena {
        let mut random = Random(5);
        let (opaque, glass) = (soup(&mut random, true), soup(&mut random, false));
        let boxes: Vec<[f32; 6]> = (0..200)
            .map(|_| {
                let low = random.vector();
                std::array::from_fn(|i| low[i % 3] as f32 + if i < 3 { 0.0 } else { 0.1 })
            })
            .collect();
        let mut memory = Bytes::new(4 << 20);
        let mut end = 0;
        let (mut places, start) = (Vec::new(), memory.address());
        let mut put = |blob: &[u8], size: u64| {
            let place = end..end + size as usize;
            memory[place.clone()].copy_from_slice(&blob[..place.len()]);
            end = place.end.next_multiple_of(256);
            places.push(place.clone());
            start + place.start as u64
        };
        let states = vec![0b10_01_11_00u8; 64];
        let triangles: Vec<[u32; 2]> = (0..8).map(|i| [i, 3 | 2 << 16]).collect();
        let mut micromap = Bytes::new(4096);
        let input = MicromapInput {
            triangles: scenes::memory(&triangles),
            stride_bytes: 8,
            count: 8,
            data: scenes::memory(&states),
        };
        // SAFETY: what the input names is alive.
        let size = unsafe { build_micromap(&input, &mut micromap) }.unwrap();
        let micromap = put(&micromap, size);
        let indices: Vec<u32> = (0..400).map(|i| i % 9).collect();
        let flags = BuildFlags::ALLOW_UPDATE;
        let bottoms = [
            build_meshes(std::slice::from_ref(&opaque), flags),
            build_meshes(std::slice::from_ref(&opaque), BuildFlags::LOW_MEMORY),
            build_meshes(&[opaque.clone(), glass.clone()], BuildFlags::LOW_MEMORY),
            build_meshes(std::slice::from_ref(&glass), 0),
            build_boxes(&boxes, false, 0),
            swept(&opaque),
            moving(&glass),
            mapped(&opaque, micromap, &indices),
        ];
        let addresses: Vec<u64> = bottoms
            .iter()
            .map(|blob| put(blob, compacted_size(blob).unwrap()))
            .collect();
        let record = |i: usize, address: u64| {
            let mut transform = IDENTITY;
            transform[3] = (i / addresses.len()) as f32 * 0.1;
            InstanceRecord {
                reference: address,
                ..InstanceRecord::new(&bottoms[0], transform)
            }
        };
        let all: Vec<_> = (0..3 * addresses.len())
            .map(|i| record(i, addresses[i % addresses.len()]))
            .collect();
        let mut tops = vec![build_instances(&all, 0)];
        // Of one instance, which walks enter at once.
        tops.extend((0..8).map(|i| build_instances(&[record(0, addresses[i])], 0)));
        for top in &tops {
            put(top, compacted_size(top).unwrap());
        }
        let (words, _) = memory[..end].as_chunks::<4>();
        let pristine = words.iter().map(|word| u32::from_le_bytes(*word)).collect();
        Arena {
            memory,
            pristine,
            places,
        }
    }

    /// The live memory: only the structures.
    fn live(&self) -> Live {
        // SAFETY: the arena outlives its users.
        unsafe { Live::new([(self.memory.address(), 4 * self.pristine.len() as u64)]) }
    }

    fn tops(&self) -> impl Iterator<Item = u64> {
        let tops = &self.places[self.places.len() - 9..];
        tops.iter()
            .map(|place| self.memory.address() + place.start as u64)
    }

    fn words(&self) -> &[AtomicU32] {
        let words = std::ptr::with_exposed_provenance::<AtomicU32>(self.memory.address() as usize);
        // SAFETY: as long as that, and aligned; others only read it.
        unsafe { std::slice::from_raw_parts(words, self.pristine.len()) }
    }

    /// Writes until it is told to stop: nonsense, and now and then what was there.
    fn scribble(&self, seed: u64, writes: &AtomicU64, stop: &AtomicBool) {
        let mut random = Random(seed);
        let words = self.words();
        let mut below = |count: usize| (random.unit() * count as f64) as usize;
        while !stop.load(Ordering::Relaxed) {
            let place = &self.places[below(self.places.len())];
            let (start, length) = (place.start / 4, place.len() / 4);
            for _ in 0..64 {
                // Half of it in the header, where the others are found.
                let reach = [32.min(length), length][below(2)];
                let at = start + below(reach);
                let word = match below(6) {
                    0 => (below(1 << 16) << 16 | below(1 << 16)) as u32,
                    1 => below(64) as u32,
                    2 => 1 << below(32),
                    3 => self.pristine[at].wrapping_add(1),
                    4 => 0x8000_0000 | below(512) as u32,
                    _ => self.pristine[below(words.len())],
                };
                words[at].store(word, Ordering::Relaxed);
            }
            for at in start..start + length {
                words[at].store(self.pristine[at], Ordering::Relaxed);
            }
            writes.fetch_add(1, Ordering::Relaxed);
        }
    }
}

fn rays(random: &mut Random, top: u64) -> RayRows {
    let mut rows = RayRows::NONE;
    let (origin, direction) = (random.vector(), random.direction());
    let spread = [0.0, 0.02, 1.0][(random.unit() * 3.0) as usize];
    let flags = [0, 0, 4, 2][(random.unit() * 4.0) as usize];
    for lane in 0..PACKET {
        let offset = random.vector();
        let ray = Ray {
            flags,
            ..ray(
                origin.to_array().map(|c| 3.0 * c as f32),
                std::array::from_fn(|k| (-direction[k] + spread * offset[k]) as f32),
            )
        };
        rows.set(lane, top, &ray, 0.3);
    }
    rows
}

/// Walks in one way, and asks about what was hit.
fn walk(walker: &mut Walker, live: &Live, rows: &RayRows, (at_once, in_turn): (usize, bool)) {
    let mut round = 0;
    let decide = |_: &RayRows, group_walk: &mut GroupWalk| {
        round += 1;
        if in_turn && round % 3 != 0 {
            return;
        }
        group_walk.accept(group_walk.candidates().found);
    };
    let groups = Groups::of_rows(vec![(rows.clone(), LaneMask::ALL); at_once], decide);
    let mut groups = groups.with(|start| start.shows_first_hit = in_turn);
    (groups.refills, groups.rounds) = (at_once, 200);
    // SAFETY: the arena is alive, and where walks look.
    unsafe { groups.trace(walker, at_once) };
    let (top, hits) = (rows.top_level[0], &groups.group_walks[0].hits);
    for lane in hits.found {
        // SAFETY: the arena is alive, and where walks look.
        if let Some(structure) = unsafe { Structure::at(top, live) } {
            let mut hit = hits.hit(lane);
            structure.triangle_vertices_at(&hit, 0.5, live);
            structure.swept_ends(&hit, live);
            structure.object_to_world_at(hit.instance_index, 0.5);
            hit.slot = Hit::UNKNOWN_SLOT;
            structure.triangle_vertices(&hit, live);
        }
    }
}

/// Copies, and what else reads a structure whole.
fn transfer(arena: &Arena, live: &Live, place: &std::ops::Range<usize>, room: &mut Bytes) {
    let blob = &arena.memory[place.clone()];
    let _ = copy_into(blob, room);
    let _ = validate(room);
    let mut data = Bytes::new(1 << 20);
    // SAFETY: the arena is alive.
    if unsafe { serialize(blob, &[[7; 16]; 2], false, &mut data, live) }.is_ok() {
        let _ = deserialize(&data, room, live);
    }
}

fn scribbled(tier: Tier, seed: u64) {
    let options = Options {
        tier,
        fuel: FUEL,
        ..Options::default()
    };
    let Some(mut walker) = Walker::with(options) else {
        return;
    };
    let arena = Arena::new();
    let (arena, live) = (&arena, &arena.live());
    // SAFETY: the arena is alive.
    unsafe { walker.set_live(live) };
    let (writes, stop) = (AtomicU64::new(0), AtomicBool::new(false));
    std::thread::scope(|scope| {
        for writer in 0..2 {
            let (writes, stop) = (&writes, &stop);
            scope.spawn(move || arena.scribble(seed + writer, writes, stop));
        }
        let mut random = Random(seed + 9);
        let mut room = Bytes::new(1 << 20);
        let mut round = 0;
        while round < effort::rounds(ROUNDS) || writes.load(Ordering::Relaxed) < WRITES {
            round += 1;
            for top in arena.tops() {
                for _ in 0..4 {
                    let rays = rays(&mut random, top);
                    walk(&mut walker, live, &rays, (1, false));
                    walk(&mut walker, live, &rays, (1, true));
                }
                walk(&mut walker, live, &rays(&mut random, top), (8, true));
            }
            for place in &arena.places[1..] {
                transfer(arena, live, place, &mut room);
            }
        }
        stop.store(true, Ordering::Relaxed);
    });
}

#[test]
fn portable_walks_bear_writers() {
    scribbled(Tier::Portable, 1);
}

#[test]
fn avx2_walks_bear_writers() {
    scribbled(Tier::Avx2, 100);
}

#[test]
fn avx512_walks_bear_writers() {
    scribbled(Tier::Avx512, 1000);
}
