//! A structure tells all that was built into it.

use scenes::*;
use traversal::*;

fn described(bytes: &Bytes) -> (Structure, StructureFacts) {
    // SAFETY: a structure lies there.
    let found = unsafe { Structure::described(bytes.address(), &EVERYWHERE) };
    found.expect("a structure")
}

fn sorted(structure: &Structure) -> Vec<Content> {
    let mut contents: Vec<Content> = structure.contents().collect();
    contents.sort_by_key(|content| (content.geometry, content.primitive));
    contents
}

#[test]
fn triangles_are_those_of_the_geometries() {
    let meshes = [
        Mesh::icosphere(2, true, |point| point),
        Mesh::icosphere(1, false, |point| point * 3.0),
    ];
    for flags in [0, BuildFlags::LOW_MEMORY, BuildFlags::PREFER_FAST_TRACE] {
        let bytes = build_meshes(&meshes, flags);
        let (structure, facts) = described(&bytes);
        let expected = meshes.iter().zip(0..).flat_map(|(mesh, geometry)| {
            let primitives = 0..mesh.indices.len();
            primitives.map(move |primitive| Content {
                geometry,
                primitive: primitive as u32,
                shape: PrimitiveShape::Triangle(mesh.triangle(primitive)),
            })
        });
        let expected: Vec<Content> = expected.collect();
        assert_eq!(sorted(&structure), expected, "{flags}");
        let count = expected.len() as u64;
        assert_eq!((facts.primitive_count, facts.geometry_count), (count, 2));
        assert_eq!(facts.flags, BuildFlags(flags));
        assert_eq!(facts.size_bytes, structure.size_bytes());
        let [least, most] = facts.bounds.expect("there is something");
        assert!(least.iter().all(|&c| c <= -2.5) && most.iter().all(|&c| c >= 2.5));
        assert_eq!(structure.instances().count(), 0);
    }
}

/// Each level's boxes lie in those of the level above, and together in the bounds; the last level's
/// are leaves, and all triangles lie in leaves.
#[test]
fn boxes_of_levels_enclose_those_below() {
    let mesh = Mesh::icosphere(3, true, |point| point);
    let bytes = build_meshes(std::slice::from_ref(&mesh), 0);
    let (structure, facts) = described(&bytes);
    let levels = structure.box_levels(usize::MAX);
    assert_eq!(levels.len() as u32, facts.depth);
    let is_in = |[least, most]: &[[f32; 3]; 2], [from, to]: &[[f32; 3]; 2]| {
        (0..3).all(|axis| from[axis] <= least[axis] && most[axis] <= to[axis])
    };
    let mut above = vec![facts.bounds.expect("there is something")];
    for level in &levels {
        assert_eq!(level.count, level.boxes.len() as u64);
        // Boxes may reach out by their rounding alone.
        let wider =
            |[least, most]: &[[f32; 3]; 2]| [least.map(|c| c - 1e-3), most.map(|c| c + 1e-3)];
        let outer: Vec<_> = above.iter().map(wider).collect();
        for one in &level.boxes {
            assert!(outer.iter().any(|outer| is_in(one, outer)), "{one:?}");
        }
        above.clone_from(&level.boxes);
    }
    let boxes: Vec<_> = levels.iter().flat_map(|level| &level.boxes).collect();
    for index in 0..mesh.indices.len() {
        let corners = mesh.triangle(index);
        let is_around =
            |one: &[[f32; 3]; 2]| corners.iter().all(|&corner| is_in(&[corner, corner], one));
        assert!(boxes.iter().any(|one| is_around(one)), "{corners:?}");
    }
    let some = structure.box_levels(5);
    assert_eq!(some.len(), levels.len());
    for (some, all) in some.iter().zip(&levels) {
        assert_eq!(some.count, all.count);
        assert_eq!(some.boxes.len(), all.boxes.len().min(5));
        assert!(some.boxes.iter().all(|one| all.boxes.contains(one)));
    }
}

#[test]
fn boxes_and_instances_are_those_of_the_input() {
    let boxes = [
        [0.0, 0.0, 1.0, 2.0, 1.0, 2.0],
        [1.0, -4.0, 5.0, 2.0, 1.0, 6.0],
    ];
    let bottom = build_boxes(&boxes, true, 0);
    let contents = sorted(&described(&bottom).0);
    let shapes: Vec<PrimitiveShape> = contents.iter().map(|content| content.shape).collect();
    let [a, b] = boxes.map(|it| {
        let [least, most] = [0, 3].map(|at| [it[at], it[at + 1], it[at + 2]]);
        PrimitiveShape::Box([least, most])
    });
    assert_eq!(shapes, [a, b]);

    let transform = [1.0, 0.0, 0.0, 7.0, 0.0, 1.0, 0.0, 8.0, 0.0, 0.0, 1.0, 9.0];
    let top = build_instances(&[InstanceRecord::new(&bottom, transform)], 0);
    let (structure, facts) = described(&top);
    let instances: Vec<InstanceContent> = structure.instances().collect();
    let [instance] = &instances[..] else {
        panic!("{instances:?}");
    };
    assert_eq!((instance.index, instance.object_to_world), (0, transform));
    assert_eq!(instance.reference, bottom.address());
    assert_eq!(
        (facts.primitive_count, structure.contents().count()),
        (1, 0)
    );
}
