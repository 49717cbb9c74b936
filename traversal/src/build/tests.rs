//! Trees as the fallback packs them.

use super::*;
use crate::input::GeometryFlags;
use crate::{
    AabbGeometry, Event, IndexType, InstanceArray, InstanceSource, Memory, Ray, TriangleGeometry,
    Verdict, VertexFormat, Walk, Walker,
};

fn memory<T>(slice: &[T]) -> Memory {
    Memory {
        base: slice.as_ptr().cast(),
        bytes: size_of_val(slice),
    }
}

#[repr(align(256))]
#[derive(Clone, Copy)]
struct Line(#[allow(dead_code, reason = "written through pointers")] [u8; 256]);

/// A structure whose tree may have so many levels; checked.
fn built(geometries: Geometries<'_>, max_depth: u32) -> Vec<Line> {
    let input = BuildInput {
        flags: BuildFlags(0),
        geometries,
    };
    let shape = Shape::of(&geometries).unwrap();
    let sizes = build_sizes(shape.kind, input.flags, &[shape.primitives as u32]);
    let mut lines = vec![Line([0xAA; 256]); sizes.structure_bytes as usize / 256];
    let mut scratch = vec![0xAA; sizes.build_scratch_bytes as usize];
    // SAFETY: as long as the lines.
    let blob = unsafe {
        std::slice::from_raw_parts_mut(lines.as_mut_ptr().cast::<u8>(), 256 * lines.len())
    };
    // SAFETY: the callers keep the memory of the geometries.
    unsafe { build_to_depth(&input, blob, &mut scratch, max_depth) }.unwrap();
    assert_eq!(crate::validate(blob), Ok(()));
    lines
}

/// Closest triangle, or the boxes along a ray, by primitive.
fn found(bottom: &[Line], origin: [f32; 3]) -> Vec<u32> {
    let mut record = [0u32; 16];
    for diagonal in [0, 5, 10] {
        record[diagonal] = 1f32.to_bits();
    }
    record[12] = 0xFF << 24;
    let reference = bottom.as_ptr().expose_provenance() as u64;
    record[14] = reference as u32;
    record[15] = (reference >> 32) as u32;
    let top = built(
        Geometries::Instances(InstanceSource {
            memory: memory(&record),
            array: InstanceArray::Records,
            count: 1,
            flags: GeometryFlags(0),
            live: &crate::EVERYWHERE,
        }),
        MAX_DEPTH,
    );
    let ray = Ray {
        origin,
        t_min: 0.0,
        direction: [0.1, 0.05, -1.0],
        t_max: f32::INFINITY,
        flags: 0,
        cull_mask: 0xFF,
    };
    // SAFETY: both levels are alive.
    let mut walk = unsafe { Walk::new(top.as_ptr().expose_provenance() as u64, &ray) };
    let mut walker = Walker::new();
    let mut all = Vec::new();
    while walk.resume(&mut walker, Verdict::Continue, &mut u64::MAX.clone()) != Event::Done {
        all.push(walk.candidate().primitive_index);
    }
    all.extend(walk.committed().map(|hit| hit.primitive_index));
    all.sort();
    all
}

/// A scatter of points in a cube, by the golden ratio.
fn point(i: u32) -> [f32; 3] {
    [0.754_877_6, 0.569_840_3, 0.430_159_7].map(|step: f64| (f64::from(i) * step).fract() as f32)
}

#[test]
fn packed_trees_hold_the_same_primitives() {
    for count in [1, 2, 7, 8, 9, 63, 64, 65, 511, 513, 3000] {
        let mut vertices = Vec::new();
        let mut boxes = Vec::new();
        for i in 0..count {
            let [x, y, z] = point(i);
            vertices.extend([[x, y, z], [x + 0.2, y, z], [x, y + 0.2, z]]);
            boxes.push([x, y, z, x + 0.1, y + 0.1, z]);
        }
        let triangles = [TriangleGeometry {
            vertices: memory(&vertices),
            vertex_stride_bytes: 12,
            vertex_format: VertexFormat::F32x3,
            first_vertex: 0,
            index_type: IndexType::None,
            indices: memory::<u8>(&[]),
            transform: None,
            primitive_count: count,
            flags: GeometryFlags(GeometryFlags::OPAQUE),
            micromap: None,
        }];
        let boxes = [AabbGeometry {
            boxes: memory(&boxes),
            stride_bytes: 24,
            primitive_count: count,
            flags: GeometryFlags(0),
        }];
        for geometries in [Geometries::Triangles(&triangles), Geometries::Aabbs(&boxes)] {
            let packed = built(geometries, 0);
            let planned = built(geometries, MAX_DEPTH);
            let mut hits = 0;
            for i in 0..200 {
                let [x, y, _] = point(i + 10_000);
                let expected = found(&planned, [x, y, 2.0]);
                assert_eq!(found(&packed, [x, y, 2.0]), expected, "{count}");
                hits += expected.len();
            }
            assert!(hits > 0 || count < 60);
        }
    }
}

/// Boxes of all sizes, some of them the same.
fn boxes(count: u32) -> Vec<[f32; 6]> {
    let mut state = 1u32;
    let mut next = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    (0..count)
        .map(|i| {
            let corner = match i % 7 {
                0 => [0.5; 3],
                _ => [next(), next(), next()],
            };
            let size = 0.1 * next() * next();
            let [x, y, z] = corner;
            [x, y, z, x + size, y + size, z]
        })
        .collect()
}

#[test]
fn instruction_sets_do_not_show() {
    let boxes = boxes(20_000);
    let list = [AabbGeometry {
        boxes: memory(&boxes),
        stride_bytes: 24,
        primitive_count: boxes.len() as u32,
        flags: GeometryFlags(0),
    }];
    for along_curve in [false, true] {
        let tree = |vectors: bool| {
            let mut primitives = vec![Primitive::HOLE; boxes.len()];
            // SAFETY: the boxes are alive.
            unsafe {
                primitive::collect(&Geometries::Aabbs(&list), BuildFlags(0), &mut primitives)
            };
            let extent = tree::extent(&primitives);
            let rules = SplitRules::new(4, 5, along_curve, &extent);
            let mut nodes = vec![BinaryNode::default(); 2 * boxes.len() - 1];
            let mut blocks =
                vec![Corners::EMPTY; sah_sweep::block_count(boxes.len() as u64) as usize];
            let (primitives, nodes) = (&mut primitives[..], &mut nodes[..]);
            match (along_curve, vectors) {
                (true, _) => {
                    morton::grow_all(primitives, nodes, &mut blocks, &rules, &extent, vectors);
                }
                (false, true) => tree::build(primitives, nodes, &rules, extent),
                (false, false) => tree::build_portable(primitives, nodes, &rules, extent),
            }
            format!("{primitives:?} {nodes:?}")
        };
        assert!(tree(false) == tree(true), "{along_curve}");
    }
}

#[test]
fn primitives_are_sorted_along_the_curve() {
    let boxes = boxes(5000);
    let list = [AabbGeometry {
        boxes: memory(&boxes),
        stride_bytes: 24,
        primitive_count: boxes.len() as u32,
        flags: GeometryFlags(0),
    }];
    let mut from = vec![Primitive::HOLE; boxes.len()];
    // SAFETY: the boxes are alive.
    unsafe { primitive::collect(&Geometries::Aabbs(&list), BuildFlags(0), &mut from) };
    let sorted = || {
        let mut to = from.clone();
        morton::arrange_for_test(&from, &mut to);
        to.iter()
            .map(|primitive| primitive.index)
            .collect::<Vec<_>>()
    };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(2)
        .build()
        .unwrap();
    let serial = sorted();
    assert_eq!(serial, pool.install(sorted));
    // The box in the lower half comes before the one in the upper half.
    let place = |i: usize| serial.iter().position(|&index| index == i as u32).unwrap();
    let half = |i: usize| boxes[i][0] + boxes[i][3] < 0.9;
    let other = |i: usize| boxes[i][0] + boxes[i][3] > 1.2;
    for i in (0..200).filter(|&i| half(i)) {
        for k in (0..200).filter(|&k| other(k)) {
            assert!(place(i) < place(k), "{i} {k}");
        }
    }
}

/// The sum of all boxes' surfaces, where every box holds those below it and counts what is there.
fn checked_area(nodes: &[BinaryNode], primitives: &[Primitive]) -> f32 {
    assert_eq!(nodes[0].count as usize, primitives.len());
    let holds = |inner: Bounds| assert_eq!(nodes[0].bounds().union(inner), nodes[0].bounds());
    let below = if nodes[0].is_leaf() {
        primitives.iter().for_each(|it| holds(it.bounds()));
        0.0
    } else {
        let (left, right) = tree::children(nodes);
        let (first, last) = primitives.split_at(left[0].count as usize);
        holds(left[0].bounds());
        holds(right[0].bounds());
        checked_area(left, first) + checked_area(right, last)
    };
    below + nodes[0].area(1.0)
}

#[test]
fn badly_placed_subtrees_move() {
    let mut boxes = boxes(6000);
    // Shelves through everything.
    for (i, shelf) in boxes.iter_mut().enumerate().step_by(40) {
        let [x, y, z, ..] = *shelf;
        *shelf = match i % 3 {
            0 => [0.0, y, z, 1.0, y + 0.01, z + 0.01],
            1 => [x, 0.0, z, x + 0.01, 1.0, z + 0.01],
            _ => [x, y, 0.0, x + 0.01, y + 0.01, 1.0],
        };
    }
    let list = [AabbGeometry {
        boxes: memory(&boxes),
        stride_bytes: 24,
        primitive_count: boxes.len() as u32,
        flags: GeometryFlags(0),
    }];
    let geometries = Geometries::Aabbs(&list);
    for kind in [Kind::Triangles, Kind::Instances] {
        let shape = Shape {
            kind,
            ..Shape::of(&geometries).unwrap()
        };
        let sizes = build_sizes(kind, BuildFlags(0), &[boxes.len() as u32]);
        let mut scratch = vec![0xAA; sizes.build_scratch_bytes as usize];
        let places = carve(&mut scratch, &shape, BuildFlags(0)).unwrap();
        let primitives = places.primitives;
        // SAFETY: the boxes are alive.
        unsafe { primitive::collect(&geometries, BuildFlags(0), primitives) };
        let nodes = &mut places.nodes[..2 * boxes.len() - 1];
        let costs = grow(kind, BuildFlags(0), primitives, nodes, places.blocks);
        let before = checked_area(nodes, primitives);
        let improved = reinsert::improve(
            primitives,
            places.nodes,
            (places.pieces, places.order),
            &costs,
        );
        let after = checked_area(improved, primitives);
        assert!(after < 0.95 * before, "{kind:?}: {before} {after}");
        let mut all: Vec<_> = primitives.iter().map(|it| it.index).collect();
        all.sort_unstable();
        assert!(all.into_iter().eq(0..boxes.len() as u32));
    }
}
