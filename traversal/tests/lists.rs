//! Rays that are set up as a list find what each finds by itself without any shortcut, bit for bit,
//! on every instruction set.

use scenes::groups::{Groups, undecided};
use scenes::odd::{plain, rays, steps};
use scenes::*;
use traversal::*;

/// Walks rays in lists with one walker, and singly on the plainest way with another.
fn compare(scene: &Scene, tier: Tier) {
    let rays = rays();
    let top = &scene.top;
    let mut walker = Walker::with_tier(tier).unwrap();
    let mut plain = plain();
    let mut hits = 0;
    let groups = Groups::new(top, &rays, undecided);
    let mut groups = groups.with(|start| start.shows_first_hit = true);
    // SAFETY: the structures are alive.
    unsafe { groups.trace(&mut walker, 1) };
    for (ray, found) in rays.iter().zip(groups.found(rays.len())) {
        let expected = closest_with(&mut plain, top, ray);
        assert_eq!(found, expected, "{tier:?} {ray:?}");
        hits += usize::from(expected.is_some());
    }
    assert!(hits > 500, "{hits}");
}

#[test]
fn lists_find_what_plain_walks_find() {
    let turned = [
        0.0, 0.0, 2.0, 0.5, //
        -1.0, 0.0, 0.0, 0.0, //
        0.0, 3.0, 0.0, -1.0,
    ];
    for tier in Tier::ALL.into_iter().filter(|tier| tier.is_available()) {
        compare(&Scene::new(&[steps()], 0), tier);
        compare(&Scene::new(&[steps()], BuildFlags::LOW_MEMORY), tier);
        compare(&Scene::placed(&[steps()], 0, turned), tier);
    }
}
