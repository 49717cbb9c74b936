//! The same rays by every tier and in every way of walking.

use crate::groups::{Groups, undecided};
use crate::*;
use traversal::*;

/// The walkers of this machine: each tier, with what it specialises and without.
pub fn walkers() -> Vec<(String, Box<Walker>)> {
    let mut walkers = Vec::new();
    for tier in [Tier::Portable, Tier::Avx2, Tier::Avx512] {
        if !tier.is_available() {
            continue;
        }
        for plain in [false, true] {
            let without = Specialisation::ALL.into_iter().filter(|_| plain);
            let options = Options {
                tier,
                without: without.map(|(_, one)| one).collect(),
                ..Options::default()
            };
            let name = format!("{tier:?}{}", if plain { ", plain" } else { "" });
            walkers.push((name, Walker::with(options).expect("it is available")));
        }
    }
    walkers
}

/// Closest hits of opaque triangles, as each way of walking finds them; by the way's name.
pub fn all_ways(top: &Bytes, rays: &[Ray]) -> Vec<(String, Vec<Option<Hit>>)> {
    let mut ways = Vec::new();
    for (name, mut walker) in walkers() {
        let singly = rays.iter().map(|ray| closest_with(&mut walker, top, ray));
        ways.push((format!("{name}, singly"), singly.collect()));
        if name.ends_with("plain") {
            continue;
        }
        let mut trace = |way: &str, walker: &mut Walker, in_turn, at_once| {
            let groups = Groups::new(top, rays, undecided);
            let mut groups = groups.with(|start| start.shows_first_hit = in_turn);
            // SAFETY: the structures are alive.
            unsafe { groups.trace(walker, at_once) };
            ways.push((format!("{name}, {way}"), groups.found(rays.len())));
        };
        trace("in turn", &mut walker, true, 1);
        trace("in packets", &mut walker, false, 1);
        trace("in streams", &mut walker, true, usize::MAX);
    }
    ways
}
