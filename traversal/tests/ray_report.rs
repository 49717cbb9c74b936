//! A report lists all that lies on a ray's line, and says of each primitive why the ray does not
//! take it.

use scenes::*;
use traversal::*;

/// A triangle at a height, which rays along z at (0.25, 0.25) meet with these weights.
fn triangle(z: f32, opaque: bool) -> Mesh {
    Mesh {
        vertices: vec![[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]],
        indices: vec![[0, 1, 2]],
        opaque,
    }
}

fn report(top: &Bytes, ray: &Ray, room: usize) -> RayReport {
    // SAFETY: the structures are alive.
    unsafe {
        RayReport::new(
            &mut Walker::new(),
            top.address(),
            ray,
            0.0,
            &EVERYWHERE,
            room,
        )
    }
}

fn up(flags: u32) -> Ray {
    Ray {
        flags,
        ..ray([0.25, 0.25, 0.0], [0.0, 0.0, 1.0])
    }
}

fn fates(report: &RayReport) -> Vec<Reason> {
    report.met.iter().map(|met| met.reason).collect()
}

#[test]
fn triangles_come_by_distance_with_their_fate() {
    let meshes = [
        triangle(3.0, true),
        triangle(1.0, false),
        triangle(2.0, true),
    ];
    let scene = Scene::new(&meshes, 0);
    let found = report(&scene.top, &up(0), 100);
    assert!(!found.is_cut);
    let places: Vec<(f32, u32, bool)> = (found.met.iter())
        .map(|met| (met.hit.t, met.hit.geometry_index, met.hit.opaque))
        .collect();
    assert_eq!(places, [(1.0, 1, false), (2.0, 2, true), (3.0, 0, true)]);
    assert!(
        found
            .met
            .iter()
            .all(|met| met.hit.barycentrics == [0.25; 2])
    );
    assert_eq!(fates(&found), [Reason::Candidate; 3]);

    let short = Ray {
        t_min: 1.5,
        t_max: 3.0,
        ..up(0)
    };
    let expected = [Reason::BeforeStart, Reason::Candidate, Reason::BeyondEnd];
    assert_eq!(fates(&report(&scene.top, &short, 100)), expected);

    let opaque = report(&scene.top, &up(ray_flags::CULL_OPAQUE), 100);
    let expected = [
        Reason::Candidate,
        Reason::OpaqueCulled,
        Reason::OpaqueCulled,
    ];
    assert_eq!(fates(&opaque), expected);
    let others = report(&scene.top, &up(ray_flags::CULL_NO_OPAQUE), 100);
    let expected = [Reason::NoOpaqueCulled, Reason::Candidate, Reason::Candidate];
    assert_eq!(fates(&others), expected);
    let skipped = report(&scene.top, &up(ray_flags::SKIP_TRIANGLES), 100);
    assert_eq!(fates(&skipped), [Reason::Skipped; 3]);

    let cut = report(&scene.top, &up(0), 2);
    assert!(cut.is_cut && cut.met.len() == 2);
}

#[test]
fn facing_and_masks_hide_instances() {
    // Seen from below: counterclockwise in a right-handed system, so from its back.
    let bottom = build_meshes(&[triangle(1.0, true)], 0);
    let instance = |mask: u32, flags: u32, z: f32| {
        let mut place = IDENTITY;
        place[11] = z;
        InstanceRecord {
            custom_index_and_mask: mask << 24 | 7,
            sbt_offset_and_flags: flags << 24 | 5,
            ..InstanceRecord::new(&bottom, place)
        }
    };
    // VK_GEOMETRY_INSTANCE_TRIANGLE_FLIP_FACING_BIT_KHR
    let records = [
        instance(0x01, 0, 0.0),
        instance(0x00, 0, 1.0),
        instance(0x02, 0, 2.0),
        instance(0x01, 2, 3.0),
    ];
    let top = build_instances(&records, 0);
    let hidden = Ray {
        cull_mask: 0x01,
        ..up(0)
    };
    let found = report(&top, &hidden, 100);
    let expected = [
        Reason::Candidate,
        Reason::Masked,
        Reason::Masked,
        Reason::Candidate,
    ];
    assert_eq!(fates(&found), expected);
    let places: Vec<(f32, u32, u8)> = (found.met.iter())
        .map(|met| (met.hit.t, met.hit.instance_index, met.mask))
        .collect();
    assert_eq!(places, [(1.0, 0, 1), (2.0, 1, 0), (3.0, 2, 2), (4.0, 3, 1)]);
    for met in &found.met {
        let hit = &met.hit;
        assert_eq!((hit.instance_custom_index, hit.instance_sbt_offset), (7, 5));
    }
    let kinds = [found.met[0].hit.hit_kind, found.met[3].hit.hit_kind];
    assert_ne!(kinds[0], kinds[1], "one of them is flipped");

    // Which of the two facings is culled is what walks say.
    for flags in [
        ray_flags::CULL_BACK_FACING_TRIANGLES,
        ray_flags::CULL_FRONT_FACING_TRIANGLES,
    ] {
        let culling = Ray {
            cull_mask: 0xFF,
            ..up(flags)
        };
        let found = report(&top, &culling, 100);
        let taken: Vec<u32> = (found.met.iter())
            .filter(|met| met.reason == Reason::Candidate)
            .map(|met| met.hit.instance_index)
            .collect();
        let closest = closest(&top, &culling).expect("one is not culled");
        assert_eq!(taken.first(), Some(&closest.instance_index), "{found:?}");
        let culled = found
            .met
            .iter()
            .filter(|met| matches!(met.reason, Reason::BackCulled | Reason::FrontCulled));
        assert_eq!(culled.count() + taken.len(), 3);
    }
}

#[test]
fn boxes_are_listed_within_the_interval() {
    let boxes = [
        [0.0, 0.0, 1.0, 1.0, 1.0, 2.0],
        [0.0, 0.0, 5.0, 1.0, 1.0, 6.0],
    ];
    let bottom = build_boxes(&boxes, false, 0);
    let top = build_instances(&[InstanceRecord::new(&bottom, IDENTITY)], 0);
    let primitives = |ray: &Ray| {
        let found = report(&top, ray, 100);
        let mut primitives: Vec<(u32, Reason)> = (found.met.iter())
            .map(|met| (met.hit.primitive_index, met.reason))
            .collect();
        primitives.sort_by_key(|it| it.0);
        primitives
    };
    assert_eq!(
        primitives(&up(0)),
        [(0, Reason::Candidate), (1, Reason::Candidate)]
    );
    let short = Ray {
        t_max: 3.0,
        ..up(0)
    };
    assert_eq!(primitives(&short), [(0, Reason::Candidate)]);
    let skipped = up(ray_flags::SKIP_AABBS);
    assert_eq!(
        primitives(&skipped),
        [(0, Reason::Skipped), (1, Reason::Skipped)]
    );
}

#[test]
fn rays_that_are_none_meet_nothing() {
    let scene = Scene::new(&[triangle(1.0, true)], 0);
    let broken = ray([f32::NAN, 0.25, 0.0], [0.0, 0.0, 1.0]);
    assert_eq!(report(&scene.top, &broken, 100), RayReport::default());
    assert_eq!(report(&scene.bottom, &up(0), 100), RayReport::default());
    // SAFETY: there is no structure.
    let nowhere = unsafe { RayReport::new(&mut Walker::new(), 0, &up(0), 0.0, &EVERYWHERE, 9) };
    assert_eq!(nowhere, RayReport::default());
}
