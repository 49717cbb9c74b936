//! Geometries out of bytes: every build fits its sizes and is valid, and all of them give the same
//! hits, on any number of threads and every tier. Then positions change and the structure is
//! updated.
#![no_main]

use std::sync::LazyLock;

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use traversal::*;
use traversal_fuzz::*;

#[derive(Arbitrary, Debug)]
struct FuzzInput {
    kind: u8,
    repeat: u8,
    parallel: bool,
    change: u8,
    tier: u8,
    transform: Option<[f32; 12]>,
    lists: Vec<FuzzList>,
    rays: Vec<FuzzRay>,
}

static POOL: LazyLock<rayon::ThreadPool> = LazyLock::new(|| {
    rayon::ThreadPoolBuilder::new()
        .num_threads(2)
        .build()
        .unwrap()
});

/// Calls `then` with the lists as geometries of one kind, to be built with `flags`.
fn with<T>(
    kind: u8,
    lists: &[FuzzList],
    flags: u32,
    then: impl FnOnce(&BuildInput<'_>) -> T,
) -> T {
    fn all<T>(lists: &[FuzzList], geometry: impl Fn(&FuzzList) -> T) -> Vec<T> {
        lists.iter().map(geometry).collect()
    }
    let geometries = match kind % 8 {
        0..=3 => Geometries::Triangles(&all(lists, FuzzList::triangles)),
        4 | 5 => Geometries::Aabbs(&all(lists, FuzzList::boxes)),
        6 => Geometries::Swept(&all(lists, FuzzList::swept)),
        _ => Geometries::Motion(&all(lists, FuzzList::motion)),
    };
    let flags = BuildFlags(flags);
    then(&BuildInput { flags, geometries })
}

/// No walk through so little takes more steps.
const FUEL: u64 = 10_000_000;

fuzz_target!(|given: FuzzInput| {
    let mut given = given;
    given.lists.truncate(3);
    given.rays.truncate(8);
    for list in &mut given.lists {
        list.repeat(given.repeat);
    }
    let transform = given.transform.unwrap_or(IDENTITY);
    let found = |tier: u8, flags: u32| {
        let walker = &mut walker(tier);
        with(given.kind, &given.lists, flags, |input| {
            let bottom = build_blob(input);
            if given.parallel {
                let other = POOL.install(|| build_blob(input));
                let size = compacted_size(&bottom).unwrap() as usize;
                assert!(bottom[..size] == other[..size], "threads show");
            }
            let top = over(&bottom, transform, flags);
            let rays = given.rays.iter();
            rays.map(|ray| {
                // Candidates that tie are met in any order; opaque ones have a least.
                let opaque = walked(walker, &top, &ray.ray(ray_flags::OPAQUE), FUEL);
                let open = walked(walker, &top, &ray.ray(ray_flags::NO_OPAQUE), FUEL);
                (opaque.0, open.1)
            })
            .collect::<Vec<_>>()
        })
    };
    let expected = found(given.tier, 0);
    for (flags, tier) in [
        BuildFlags::PREFER_FAST_BUILD,
        BuildFlags::PREFER_FAST_TRACE,
        BuildFlags::LOW_MEMORY,
    ]
    .into_iter()
    .zip(0..)
    {
        assert_eq!(found(tier, flags), expected, "{flags:#x}, tier {tier}");
    }

    let flags = BuildFlags::ALLOW_UPDATE;
    let mut bottom = with(given.kind, &given.lists, flags, build_blob);
    for list in &mut given.lists {
        list.move_by(given.change);
    }
    with(given.kind, &given.lists, flags, |input| {
        let mut scratch = Bytes::new(sizes(input).update_scratch_bytes);
        // SAFETY: the lists are alive.
        unsafe { update(input, None, &mut bottom, &mut scratch) }.expect("of the same shape");
    });
    assert_eq!(validate(&bottom), Ok(()));
    let top = over(&bottom, transform, flags);
    let walker = &mut walker(given.tier);
    for ray in &given.rays {
        walked(walker, &top, &ray.ray(ray.flags()), FUEL);
    }
});
