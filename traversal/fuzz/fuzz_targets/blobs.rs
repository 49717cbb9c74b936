//! Structures that somebody wrote into: serialized ones are refused or valid, and what lies in
//! memory is walked, updated and validated without leaving it.
#![no_main]

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use traversal::*;
use traversal_fuzz::*;

#[derive(Arbitrary, Debug)]
struct FuzzInput {
    kind: u8,
    list: FuzzList,
    copies: u8,
    tier: u8,
    /// Where, as a share of the length, and what.
    writes: Vec<(u16, u32, u8)>,
    rays: Vec<FuzzRay>,
}

/// Corrupts what comes after `start`.
fn corrupt(bytes: &mut [u8], start: usize, writes: &[(u16, u32, u8)]) {
    let length = bytes.len().saturating_sub(start + 4);
    if length == 0 {
        return;
    }
    for &(place, word, size) in writes {
        let at = start + usize::from(place) * length / 65536;
        match size % 4 {
            0 => bytes[at] = word as u8,
            1 => bytes[at] ^= 1 << (word % 8),
            _ => {
                let at = at & !3;
                bytes[at..at + 4].copy_from_slice(&word.to_le_bytes());
            }
        }
    }
}

/// Steps of a walk that may go in circles.
const FUEL: u64 = 20_000;
const HEADER: usize = 256;

fuzz_target!(|input: FuzzInput| {
    let mut input = input;
    input.rays.truncate(4);
    let walker = &mut walker(input.tier);
    input.writes.truncate(64);
    let rays: Vec<Ray> = input.rays.iter().map(|ray| ray.ray(ray.flags())).collect();
    // Updatable structures have no blocks.
    let flags = match input.kind / 4 % 2 {
        0 => BuildFlags::ALLOW_UPDATE,
        _ => BuildFlags::LOW_MEMORY,
    };
    let geometries = match input.kind % 4 {
        0 => Geometries::Triangles(&[input.list.triangles()]),
        1 => Geometries::Aabbs(&[input.list.boxes()]),
        2 => Geometries::Swept(&[input.list.swept()]),
        _ => Geometries::Motion(&[input.list.motion()]),
    };
    let input = BuildInput {
        flags: BuildFlags(flags),
        geometries,
    };
    let bottom = build_blob(&input);
    let records: Vec<_> = (0..1 + input.copies % 20)
        .map(|i| {
            let mut transform = IDENTITY;
            transform[3] = f32::from(i);
            InstanceRecord::new(&bottom, transform)
        })
        .collect();
    let top = build_instances(&records, flags);

    for (whole, is_top) in [(&bottom, false), (&top, true)] {
        // SAFETY: there are no micromaps.
        let size = unsafe { serialized_size(whole, &EVERYWHERE) }.unwrap();
        let mut data = Bytes::new(size);
        // SAFETY: there are no micromaps.
        unsafe { serialize(whole, &[[7; 16]; 2], false, &mut data, &EVERYWHERE) }.unwrap();
        corrupt(&mut data, 0, &input.writes);
        let mut place = Bytes::new(compacted_size(whole).unwrap());
        if deserialize(&data, &mut place, &EVERYWHERE).is_ok() {
            assert_eq!(validate(&place), Ok(()));
            if !is_top {
                let top = over(&place, IDENTITY, 0);
                for ray in &rays {
                    walked(walker, &top, ray, FUEL);
                }
                walked_together(walker, &top, &rays, FUEL);
            }
        }

        // In memory, with its header, which only validation has to bear.
        let mut place = Bytes::new(compacted_size(whole).unwrap());
        compact_into(whole, &mut place).unwrap();
        corrupt(&mut place, 0, &input.writes);
        let _ = validate(&place);
    }

    // The bottom level without its header, and the top level's nodes without its references.
    let mut place = Bytes::new(compacted_size(&bottom).unwrap());
    compact_into(&bottom, &mut place).unwrap();
    corrupt(&mut place, HEADER, &input.writes);
    let tops = over(&place, IDENTITY, 0);
    for ray in &rays {
        walked(walker, &tops, ray, FUEL);
    }
    walked_together(walker, &tops, &rays, FUEL);
    // SAFETY: the list is alive.
    if unsafe { update(&input, None, &mut place, &mut Bytes::new(64)) }.is_ok() {
        assert_eq!(validate(&place), Ok(()));
        for ray in &rays {
            walked(walker, &tops, ray, FUEL);
        }
        walked_together(walker, &tops, &rays, FUEL);
    }

    let mut place = Bytes::new(compacted_size(&top).unwrap());
    compact_into(&top, &mut place).unwrap();
    let references = HEADER + 256 + (8 * records.len()).next_multiple_of(256);
    corrupt(&mut place, references, &input.writes);
    for ray in &rays {
        walked(walker, &place, ray, FUEL);
    }
    walked_together(walker, &place, &rays, FUEL);
});
