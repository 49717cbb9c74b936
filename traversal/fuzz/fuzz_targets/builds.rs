//! Geometries out of bytes: every build fits its sizes and is valid, and all of them give the same hits, on
//! any number of threads. Then positions change and the structure is updated.
#![no_main]

use std::sync::LazyLock;

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use traversal::*;
use traversal_fuzz::*;

#[derive(Arbitrary, Debug)]
struct Given {
    kind: u8,
    repeat: u8,
    parallel: bool,
    change: u8,
    transform: Option<[f32; 12]>,
    lists: Vec<GivenList>,
    rays: Vec<GivenRay>,
}

static POOL: LazyLock<rayon::ThreadPool> =
    LazyLock::new(|| rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap());

/// Calls `then` with the lists as geometries of one kind.
fn with<T>(kind: u8, lists: &[GivenList], then: impl FnOnce(Kind, Geometries<'_>, &[u32]) -> T) -> T {
    match kind % 8 {
        0..=3 => {
            let list: Vec<_> = lists.iter().map(GivenList::triangles).collect();
            let counts: Vec<_> = list.iter().map(|list| list.primitive_count).collect();
            then(Kind::Triangles, Geometries::Triangles(&list), &counts)
        }
        4 | 5 => {
            let list: Vec<_> = lists.iter().map(GivenList::boxes).collect();
            let counts: Vec<_> = list.iter().map(|list| list.primitive_count).collect();
            then(Kind::Aabbs, Geometries::Aabbs(&list), &counts)
        }
        6 => {
            let list: Vec<_> = lists.iter().map(GivenList::swept).collect();
            let counts: Vec<_> = list.iter().map(|list| list.primitive_count).collect();
            then(Kind::Swept, Geometries::Swept(&list), &counts)
        }
        _ => {
            let list: Vec<_> = lists.iter().map(GivenList::motion).collect();
            let counts: Vec<_> = list.iter().map(|list| list.start.primitive_count).collect();
            then(Kind::Motion, Geometries::Motion(&list), &counts)
        }
    }
}

/// No walk through so little takes more steps.
const FUEL: u64 = 10_000_000;

fuzz_target!(|given: Given| {
    let mut given = given;
    given.lists.truncate(3);
    given.rays.truncate(8);
    for list in &mut given.lists {
        list.repeat(given.repeat);
    }
    let transform = given.transform.unwrap_or(IDENTITY);
    let found = |flags: u32| {
        with(given.kind, &given.lists, |kind, geometries, counts| {
            let bottom = built(kind, flags, geometries, counts);
            if given.parallel {
                let other = POOL.install(|| built(kind, flags, geometries, counts));
                let size = compacted_size(&bottom).unwrap() as usize;
                assert!(bottom[..size] == other[..size], "threads show");
            }
            let top = over(&bottom, transform, flags);
            let rays = given.rays.iter();
            rays.map(|ray| {
                // Candidates that tie are met in any order; opaque ones have a least.
                let opaque = walked(&top, &ray.ray(ray_flags::OPAQUE), FUEL);
                let open = walked(&top, &ray.ray(ray_flags::NO_OPAQUE), FUEL);
                (opaque.0, open.1)
            })
            .collect::<Vec<_>>()
        })
    };
    let expected = found(0);
    for flags in [
        BuildFlags::PREFER_FAST_BUILD,
        BuildFlags::PREFER_FAST_TRACE,
        BuildFlags::LOW_MEMORY,
    ] {
        assert_eq!(found(flags), expected, "{flags:#x}");
    }

    let flags = BuildFlags::ALLOW_UPDATE;
    let mut bottom = with(given.kind, &given.lists, |kind, geometries, counts| {
        built(kind, flags, geometries, counts)
    });
    for list in &mut given.lists {
        list.move_by(given.change);
    }
    with(given.kind, &given.lists, |kind, geometries, counts| {
        let sizes = build_sizes(kind, BuildFlags(flags), counts);
        let mut scratch = Exact::new(sizes.update_scratch_bytes);
        let input = BuildInput {
            flags: BuildFlags(flags),
            geometries,
        };
        // SAFETY: the lists are alive.
        unsafe { update(&input, None, &mut bottom, &mut scratch) }.expect("of the same shape");
    });
    assert_eq!(validate(&bottom), Ok(()));
    let top = over(&bottom, transform, flags);
    for ray in &given.rays {
        walked(&top, &ray.ray(ray.flags()), FUEL);
    }
});
