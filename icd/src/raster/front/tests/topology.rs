//! Topologies against the specification's lists, written out.

use ash::vk::PrimitiveTopology as Topology;

use super::super::topology::*;

/// Primitives of five to seven vertices, as "Primitive Topologies" has them.
#[test]
fn vertices_are_as_written() {
    let all = |topology, length| {
        (0..count(topology, length))
            .map(|primitive| vertices(topology, primitive, false))
            .collect::<Vec<_>>()
    };
    assert_eq!(all(Topology::POINT_LIST, 2), [[0; 3], [1; 3]]);
    assert_eq!(all(Topology::LINE_LIST, 5), [[0, 1, 1], [2, 3, 3]]);
    assert_eq!(
        all(Topology::LINE_STRIP, 4),
        [[0, 1, 1], [1, 2, 2], [2, 3, 3]]
    );
    assert_eq!(all(Topology::TRIANGLE_LIST, 7), [[0, 1, 2], [3, 4, 5]]);
    assert_eq!(
        all(Topology::TRIANGLE_STRIP, 6),
        [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]]
    );
    assert_eq!(
        all(Topology::TRIANGLE_FAN, 5),
        [[1, 2, 0], [2, 3, 0], [3, 4, 0]]
    );
    assert_eq!(
        all(Topology::LINE_LIST_WITH_ADJACENCY, 9),
        [[1, 2, 2], [5, 6, 6]]
    );
    assert_eq!(
        all(Topology::LINE_STRIP_WITH_ADJACENCY, 5),
        [[1, 2, 2], [2, 3, 3]]
    );
    assert_eq!(
        all(Topology::TRIANGLE_LIST_WITH_ADJACENCY, 12),
        [[0, 2, 4], [6, 8, 10]]
    );
    assert_eq!(
        all(Topology::TRIANGLE_STRIP_WITH_ADJACENCY, 10),
        [[0, 2, 4], [2, 6, 4], [4, 6, 8]]
    );
    for topology in [
        Topology::POINT_LIST,
        Topology::LINE_LIST,
        Topology::LINE_STRIP,
        Topology::TRIANGLE_STRIP,
        Topology::TRIANGLE_FAN,
        Topology::LINE_STRIP_WITH_ADJACENCY,
        Topology::TRIANGLE_STRIP_WITH_ADJACENCY,
    ] {
        assert_eq!(count(topology, 0), 0);
    }
    assert_eq!(count(Topology::PATCH_LIST, 100), 0);
}

/// The same triangles, turned so that they end with their provoking vertices.
#[test]
fn triangles_end_with_a_last_provoking_vertex() {
    let all = |topology, length| {
        (0..count(topology, length))
            .map(|primitive| vertices(topology, primitive, true))
            .collect::<Vec<_>>()
    };
    assert_eq!(
        all(Topology::TRIANGLE_STRIP, 6),
        [[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]]
    );
    assert_eq!(
        all(Topology::TRIANGLE_FAN, 5),
        [[0, 1, 2], [0, 2, 3], [0, 3, 4]]
    );
    assert_eq!(
        all(Topology::TRIANGLE_STRIP_WITH_ADJACENCY, 10),
        [[0, 2, 4], [4, 2, 6], [4, 6, 8]]
    );
}

#[test]
fn the_provoking_vertex_is_the_first_or_the_last() {
    for topology in [
        Topology::TRIANGLE_LIST,
        Topology::TRIANGLE_STRIP,
        Topology::TRIANGLE_FAN,
        Topology::LINE_LIST,
        Topology::LINE_STRIP,
        Topology::TRIANGLE_STRIP_WITH_ADJACENCY,
    ] {
        for primitive in 0..4 {
            let of = |last| {
                let place = usize::from(provoking(topology, last));
                vertices(topology, primitive, last)[place]
            };
            let step = match topology {
                Topology::TRIANGLE_LIST => [3 * primitive, 3 * primitive + 2],
                Topology::TRIANGLE_FAN => [primitive + 1, primitive + 2],
                Topology::LINE_LIST => [2 * primitive, 2 * primitive + 1],
                Topology::LINE_STRIP => [primitive, primitive + 1],
                Topology::TRIANGLE_STRIP_WITH_ADJACENCY => [2 * primitive, 2 * primitive + 4],
                _ => [primitive, primitive + 2],
            };
            assert_eq!([of(false), of(true)], step, "{topology:?} {primitive}");
        }
    }
}

#[test]
fn runs_hold_the_vertices_of_their_primitives() {
    for topology in [
        Topology::POINT_LIST,
        Topology::LINE_LIST,
        Topology::LINE_STRIP,
        Topology::TRIANGLE_LIST,
        Topology::TRIANGLE_STRIP,
    ] {
        for (start, end) in [(0, 1), (0, 7), (3, 4), (4, 9), (5, 6)] {
            let mut used: Vec<u32> = (start..end)
                .flat_map(|primitive| vertices(topology, primitive, false))
                .collect();
            used.sort_unstable();
            used.dedup();
            let run: Vec<u32> = run(topology, &(start..end)).unwrap().collect();
            assert_eq!(run, used, "{topology:?} {start} {end}");
        }
    }
    assert_eq!(run(Topology::TRIANGLE_FAN, &(0..3)), None);
}
