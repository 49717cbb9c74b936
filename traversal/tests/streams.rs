//! Rays that are traced in streams find what each finds by itself without any shortcut, bit for
//! bit.

use scenes::groups::{Groups, undecided};
use scenes::odd::{self, plain, rays, steps};
use scenes::*;
use traversal::*;

/// Whether streams are there at all.
fn has_streams() -> bool {
    Tier::Avx2.is_available()
}

/// Compares streams, each group with some fuel, with plain walks; returns how many rays went by
/// streams, and how often some stopped.
fn compare(top: &Bytes, rays: &[Ray], fuel: u64) -> (u64, usize) {
    let options = Options {
        fuel,
        ..Options::default()
    };
    let mut walker = Walker::with(options).expect("it is available");
    let mut stopped = 0;
    let accept = |_: &RayRows, group_walk: &mut GroupWalk| {
        stopped += 1;
        group_walk.accept(group_walk.candidates().built_in());
    };
    let mut groups = Groups::new(top, rays, accept).with(|start| start.shows_first_hit = true);
    // SAFETY: the structures are alive.
    unsafe { groups.trace(&mut walker, usize::MAX) };
    let refilled = usize::MAX - groups.refills;
    let group_walks = std::mem::take(&mut groups.group_walks);
    drop(groups);
    let mut plain = plain();
    for (i, ray) in rays.iter().enumerate() {
        let hits = &group_walks[i / PACKET].hits;
        let found = hits.get(i % PACKET);
        assert_eq!(found, closest_with(&mut plain, top, ray), "{i}: {ray:?}");
        if found.is_none() {
            assert_eq!(hits.t[i % PACKET].to_bits(), ray.t_max.to_bits());
        }
    }
    (walker.counts().streamed, stopped + refilled)
}

/// The same rays, but their first hits end them.
fn to_the_first_hit(rays: &[Ray]) -> Vec<Ray> {
    let flags = ray_flags::TERMINATE_ON_FIRST_HIT;
    rays.iter().map(|ray| Ray { flags, ..*ray }).collect()
}

#[test]
fn odd_rays_find_what_plain_walks_find() {
    let turned = [
        0.0, 0.0, 2.0, 0.5, //
        -1.0, 0.0, 0.0, 0.0, //
        0.0, 3.0, 0.0, -1.0,
    ];
    let rays = rays();
    for scene in [
        Scene::new(&[steps()], 0),
        Scene::new(&[steps()], BuildFlags::LOW_MEMORY),
        Scene::placed(&[steps()], 0, turned),
    ] {
        for rays in [rays.clone(), to_the_first_hit(&rays)] {
            let (streamed, stopped) = compare(&scene.top, &rays, u64::MAX);
            assert!(streamed > 2000 || !has_streams(), "{streamed}");
            assert_eq!(stopped, 0);
        }
    }
}

/// Triangles that overlap: no order of boxes parts them, and every ray meets most.
fn heap(count: usize, size: f64) -> Mesh {
    let mut random = Random(0x0F1E_2D3C_4B5A_6978);
    let mut mesh = Mesh {
        vertices: Vec::new(),
        indices: Vec::new(),
        opaque: true,
    };
    for i in 0..count as u32 {
        let center = random.vector();
        for _ in 0..3 {
            let corner = random.vector();
            let at = [0, 1, 2].map(|k: usize| center[k] + size * corner[k]);
            mesh.vertices.push(narrow(at));
        }
        mesh.indices.push([3 * i, 3 * i + 1, 3 * i + 2]);
        // The same once more: ties.
        if i % 5 == 0 {
            mesh.indices.push([3 * i + 1, 3 * i + 2, 3 * i]);
        }
    }
    mesh
}

/// Rays from anywhere to anywhere.
fn anywhere(count: usize) -> Vec<Ray> {
    let mut random = Random(0x1122_3344_5566_7788);
    let mut one = || {
        let origin = 2.0 * random.vector();
        ray(narrow(origin), narrow(random.direction()))
    };
    (0..count).map(|_| one()).collect()
}

#[test]
fn rays_that_meet_everything_find_what_plain_walks_find() {
    let rays = anywhere(5000);
    for (count, size) in [(40, 0.1), (3000, 0.05), (2000, 1.5)] {
        for flags in [0, BuildFlags::LOW_MEMORY] {
            let scene = Scene::new(&[heap(count, size)], flags);
            compare(&scene.top, &rays, u64::MAX);
            compare(&scene.top, &to_the_first_hit(&rays), u64::MAX);
        }
    }
}

#[test]
fn rays_that_run_out_of_fuel_go_on_where_they_were() {
    let rays = anywhere(3000);
    for (count, size) in [(3000, 0.05), (2000, 1.5)] {
        let scene = Scene::new(&[heap(count, size)], 0);
        for fuel in [1, 16, 48, 265, 1600] {
            for rays in [rays.clone(), to_the_first_hit(&rays)] {
                let (_, stopped) = compare(&scene.top, &rays, fuel);
                assert!(stopped > 0 || fuel > 48 || !has_streams());
            }
        }
    }
}

#[test]
fn unlike_rays_are_not_taken_up_together() {
    let mut rays = anywhere(320);
    for (i, ray) in rays.iter_mut().enumerate() {
        if i % 64 >= 32 {
            ray.flags = ray_flags::TERMINATE_ON_FIRST_HIT;
        }
        if i % 5 == 0 {
            ray.cull_mask = 0;
        }
        if i % 7 == 0 {
            ray.flags |= ray_flags::CULL_BACK_FACING_TRIANGLES;
        }
    }
    let scene = Scene::new(&[heap(500, 0.3)], 0);
    compare(&scene.top, &rays, u64::MAX);
    // Nothing of all that where glass or no structure is.
    let mut glass = heap(500, 0.3);
    glass.opaque = false;
    let glass = Scene::new(&[glass], 0);
    let rays = anywhere(64);
    let mut walker = Walker::new();
    for address in [glass.top.address(), glass.bottom.address(), 0] {
        let mut rows = RayRows::NONE;
        for (lane, ray) in rays[..PACKET].iter().enumerate() {
            rows.set(lane, address, ray, 0.0);
        }
        let groups = vec![(rows, LaneMask::ALL); 8];
        let mut groups = Groups::of_rows(groups, |_: &RayRows, _: &mut GroupWalk| {});
        // SAFETY: the structures are alive.
        unsafe { groups.trace(&mut walker, 8) };
        assert_eq!(walker.counts().streamed, 0);
    }
}

/// A turn around an axis, a scale, and a place.
fn placed(random: &mut Random) -> [f32; 12] {
    let z = random.direction();
    let x = normalize(random.direction().cross(z));
    let y = z.cross(x);
    let size = 0.2 + random.unit();
    let at = 1.5 * random.vector();
    let mut matrix = [0.0; 12];
    for row in 0..3 {
        for (column, axis) in [x, y, z].iter().enumerate() {
            matrix[4 * row + column] = (size * axis[row]) as f32;
        }
        matrix[4 * row + 3] = at[row] as f32;
    }
    matrix
}

#[test]
fn streams_go_through_many_instances() {
    let mut random = Random(0x6655_4433_2211_0099);
    let bottoms = [
        build_meshes(&[heap(300, 0.2)], 0),
        build_meshes(&[heap(2000, 1.5)], BuildFlags::LOW_MEMORY),
        build_meshes(&[steps()], 0),
    ];
    let mut glass = heap(100, 0.2);
    glass.opaque = false;
    let glass = build_meshes(&[glass], 0);
    let boxes = build_boxes(&[[-0.5, -0.5, -0.5, 0.5, 0.5, 0.5]], true, 0);
    let rays = anywhere(1500);
    let odd_rays: Vec<_> = odd::rays().into_iter().step_by(3).collect();
    for (count, unlike) in [(2, 0), (40, 0), (40, 3), (12, 12)] {
        let mut records: Vec<_> = (0..count)
            .map(|i| InstanceRecord::new(&bottoms[i % 3], placed(&mut random)))
            .collect();
        // Some twice, so that hits tie; with and without a transform.
        records.push(records[1]);
        for _ in 0..2 {
            records.push(InstanceRecord::new(&bottoms[0], IDENTITY));
        }
        for i in 0..unlike {
            let of = if i % 3 == 2 { &boxes } else { &glass };
            records.push(InstanceRecord::new(of, placed(&mut random)));
        }
        let top = build_instances(&records, 0);
        for rays in [rays.clone(), to_the_first_hit(&rays)] {
            let (streamed, stopped) = compare(&top, &rays, u64::MAX);
            assert!(streamed > 1000 || !has_streams(), "{streamed}");
            assert_eq!(stopped > 0, unlike > 0);
            compare(&top, &rays, 53);
            compare(&top, &rays, 530);
        }
        compare(&top, &odd_rays, u64::MAX);
    }
}

#[test]
fn corrupt_structures_are_walked_safely() {
    let mut random = Random(0x1D0C_0BA9_8765_4321);
    let rays = anywhere(100);
    let clean = build_meshes(&[heap(400, 0.3)], 0);
    let blocks = build_meshes(&[heap(400, 0.3)], BuildFlags::LOW_MEMORY);
    let mut walker = Walker::new();
    let mut damage = |blob: &Bytes| {
        let mut bad = Bytes::new(compacted_size(blob).unwrap());
        compact_into(blob, &mut bad).unwrap();
        // Behind the header.
        for _ in 0..1 + (random.unit() * 60.0) as usize {
            let at = 256 + (random.unit() * (bad.len() - 256) as f64) as usize;
            bad[at] = (random.unit() * 256.0) as u8;
        }
        bad
    };
    for i in 0..600 {
        let bottom = damage(if i % 2 == 0 { &clean } else { &blocks });
        let record = InstanceRecord::new(&bottom, IDENTITY);
        let records = vec![record; [1, 5][i / 2 % 2]];
        let top = build_instances(&records, 0);
        let mut groups = Groups::new(&top, &rays, undecided);
        groups.refills = 1;
        // SAFETY: the structures are alive, and what is in them is checked as it is read.
        unsafe { groups.trace(&mut walker, usize::MAX) };
    }
}
