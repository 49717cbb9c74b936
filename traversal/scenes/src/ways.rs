//! The same rays by every tier and in every way of walking.

use crate::*;
use traversal::*;

/// Rays in groups of sixteen, and what became of them.
struct Groups {
    rows: Vec<RayRows>,
    hits: Vec<HitRows>,
}

impl Caller for Groups {
    fn hit(&mut self, group: u32, lane: usize, hit: &Hit) {
        self.hits[group as usize].set(lane, hit);
    }

    fn rays(&mut self, group: u32, rays: &mut RayRows) {
        *rays = self.rows[group as usize].clone();
    }

    fn suspend(&mut self, _: u32, _: usize, _: &mut Walk, event: Event) {
        panic!("{event:?}: there is fuel enough, and nothing is asked about");
    }
}

impl Groups {
    fn new(top: &Bytes, rays: &[Ray]) -> Groups {
        let rows: Vec<RayRows> = rays
            .chunks(PACKET)
            .map(|rays| {
                let mut rows = RayRows::NONE;
                for (lane, ray) in rays.iter().enumerate() {
                    rows.set(lane, top.address(), ray, 0.0);
                }
                rows
            })
            .collect();
        Groups {
            hits: vec![HitRows::default(); rows.len()],
            rows,
        }
    }

    fn found(&self, count: usize) -> Vec<Option<Hit>> {
        (0..count)
            .map(|i| self.hits[i / PACKET].get(i % PACKET))
            .collect()
    }
}

fn lanes(group: usize, count: usize) -> u16 {
    u16::MAX >> (PACKET - (count - group * PACKET).min(PACKET))
}

fn no_event(_: usize, _: &mut Walk, event: Event) {
    panic!("{event:?}: there is fuel enough, and nothing is asked about");
}

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
        for together in [false, true] {
            let mut groups = Groups::new(top, rays);
            for group in 0..groups.rows.len() {
                let lanes = lanes(group, rays.len());
                let (rows, hits) = (&groups.rows[group], &mut groups.hits[group]);
                let fuel = &mut { u64::MAX };
                // SAFETY: the structures are alive.
                unsafe {
                    match together {
                        true => walker.trace_rows(rows, lanes, hits, fuel, &mut no_event),
                        false => walker.trace_in_turn(rows, lanes, hits, fuel, &mut no_event),
                    }
                }
            }
            let way = if together { "in packets" } else { "in turn" };
            ways.push((format!("{name}, {way}"), groups.found(rays.len())));
        }
        let mut groups = Groups::new(top, rays);
        for group in 0..groups.rows.len() {
            let mut rest = lanes(group, rays.len());
            // SAFETY: the structures are alive.
            unsafe {
                for _ in 0..2 {
                    let (rows, hits) = (&groups.rows[group], &mut groups.hits[group]);
                    rest &= !walker.add_to_stream(rows, rest, hits, group as u32);
                    if rest != 0 {
                        walker.trace_streams(&mut { u64::MAX }, &mut groups);
                    }
                }
                let (rows, hits) = (&groups.rows[group], &mut groups.hits[group]);
                walker.trace_in_turn(rows, rest, hits, &mut { u64::MAX }, &mut no_event);
            }
        }
        // SAFETY: as above.
        unsafe { walker.trace_streams(&mut { u64::MAX }, &mut groups) };
        ways.push((format!("{name}, in streams"), groups.found(rays.len())));
    }
    ways
}
