//! Structures: memory, instances, updates, copies.

use super::*;

#[test]
fn memory_is_asked_for_by_what_it_is_for() {
    let Some(gpu) = gpu() else { return };
    let flags = BuildFlags::ALLOW_UPDATE;
    let geometry = Geometry::opaque(&squares(&[(0.0, 1.0); 50]));
    let described = gpu.describe_nv(&[geometry], flags);
    let structure = gpu.structure_nv(&described);
    let needs = |what| gpu.needs_nv(structure.handle, what);
    assert!(needs(Needs::OBJECT).size > 0);
    assert!(needs(Needs::OBJECT).memory_type_bits != 0);
    for scratch in [needs(Needs::BUILD_SCRATCH), needs(Needs::UPDATE_SCRATCH)] {
        assert_eq!((scratch.alignment, scratch.memory_type_bits), (0, 0));
    }
    assert!(needs(Needs::BUILD_SCRATCH).size > 0);
    assert_ne!(structure.reference, 0);
}

#[test]
fn instances_choose_by_mask_flags_and_table_offset() {
    let Some(gpu) = gpu() else { return };
    let bottom = gpu.bottom_nv(&[Geometry::opaque(&square(0.0, 0.0))]);
    // Each a unit square at x = 0, 1 … 5; the fourth is not in the mask of any ray, the fifth is
    // scaled by 2 along y.
    let at = |x: f32, y_scale: f32, z: f32| scaled([1.0, y_scale, 1.0], [x, 0.0, z]);
    let instance = |x: f32, table_offset: u32| Instance {
        transform: at(x, 1.0, 2.0 + x),
        custom_index: 100 + x as u32,
        table_offset,
        ..bottom.instance()
    };
    let instances = [
        instance(0.0, 0),
        instance(1.0, 2),
        instance(2.0, 1),
        Instance {
            mask: 0,
            ..instance(3.0, 0)
        },
        Instance {
            transform: at(4.0, 2.0, 9.0),
            ..instance(4.0, 3)
        },
    ];
    let world = gpu.top_nv(&instances);
    let hit = r"
    layout(location = 3) rayPayloadInNV vec4 found;
    layout(shaderRecordNV, std430) buffer Record { float number; };
    void main() { found = vec4(gl_HitTNV, gl_InstanceCustomIndexNV, gl_InstanceID, number); }";
    let mut traced = Traced::new(&gpu, world, shots(hit), [6, 2, 1]);
    traced.table.hit = [10.0f32, 11.0, 12.0, 13.0]
        .iter()
        .map(|&n| Record::with(2, &[n]))
        .collect();
    let found = traced.trace();
    let none = [-1.0; 4];
    let first_row = [
        [2.0, 100.0, 0.0, 10.0],
        [3.0, 101.0, 1.0, 12.0],
        [4.0, 102.0, 2.0, 11.0],
        none,
        [9.0, 104.0, 4.0, 13.0],
        none,
    ];
    assert_eq!(found[..6], first_row);
    assert_eq!(found[6..], [none, none, none, none, first_row[4], none]);
}

#[test]
fn updates_move_what_is_there() {
    let Some(gpu) = gpu() else { return };
    let corners = squares(&[(0.0, 2.0), (1.0, 3.0)]);
    let vertices = Geometry::opaque(&corners);
    let mut described = gpu.describe_nv(&[vertices], BuildFlags::ALLOW_UPDATE);
    described.transform(&gpu, 0, identity());
    let bottom = gpu.structure_nv(&described);
    gpu.build_nv(&described, &bottom, None);
    let top = gpu.describe_top_nv(&[bottom.instance()], BuildFlags::ALLOW_UPDATE);
    let world = gpu.structure_nv(&top);
    gpu.build_nv(&top, &world, None);
    let traced = Traced::new(&gpu, world, shots(HIT), [3, 1, 1]);
    let depths = |found: Vec<[f32; 4]>| found.iter().map(|found| found[0]).collect::<Vec<_>>();
    assert_eq!(depths(traced.trace()), [2.0, 3.0, -1.0]);

    // In place: the second square goes to x = 2.
    described.transform(&gpu, 0, translated([1.0, 0.0, 0.5]));
    gpu.build_nv(&described, &bottom, Some(&bottom));
    gpu.build_nv(&top, &world, Some(&world));
    assert_eq!(depths(traced.trace()), [-1.0, 2.5, 3.5]);

    // From one structure to another.
    let other = gpu.structure_nv(&described);
    described.transform(&gpu, 0, translated([0.0, 0.0, 4.0]));
    gpu.build_nv(&described, &other, Some(&bottom));
    let moved = gpu.top_nv(&[other.instance()]);
    assert_eq!(depths(traced.trace_into(moved)), [6.0, 7.0, -1.0]);
    assert_eq!(depths(traced.trace_into(world)), [-1.0, 2.5, 3.5]);
}

#[test]
fn copies_are_as_good_and_compact_ones_smaller() {
    let Some(gpu) = gpu() else { return };
    let at: Vec<(f32, f32)> = (0..200)
        .map(|i| ((i % 50) as f32, 1.0 + (i / 50) as f32))
        .collect();
    let described = gpu.describe_nv(
        &[Geometry::opaque(&squares(&at))],
        BuildFlags::ALLOW_COMPACTION,
    );
    let original = gpu.structure_nv(&described);
    gpu.build_nv(&described, &original, None);
    let query = vk::QueryType::ACCELERATION_STRUCTURE_COMPACTED_SIZE_NV;
    let pool = gpu.queries(query, 3);
    // SAFETY: the command buffer is being recorded, and the handles are of this device.
    gpu.run(|commands| unsafe {
        let structures = [original.handle];
        gpu.device.cmd_reset_query_pool(commands, pool, 0, 3);
        (gpu.nv()).cmd_write_acceleration_structures_properties(
            commands,
            &structures,
            query,
            pool,
            1,
        );
    });
    let sizes: [u64; 1] = gpu.query_results(pool, 1);
    let full = gpu.needs_nv(original.handle, Needs::OBJECT).size;
    assert!((1..=full).contains(&sizes[0]), "{} of {full}", sizes[0]);
    let clone = gpu.structure_nv(&described);
    let compact = gpu.compact_structure_nv(&described, sizes[0]);
    gpu.run(|commands| {
        // SAFETY: the structures live as long as the device.
        unsafe {
            let copy = |to: StructureNv, mode| {
                gpu.nv().cmd_copy_acceleration_structure(
                    commands,
                    to.handle,
                    original.handle,
                    mode,
                );
            };
            copy(clone, CopyMode::CLONE);
            copy(compact, CopyMode::COMPACT);
        }
    });
    let worlds = [original, clone, compact].map(|bottom| gpu.top_nv(&[bottom.instance()]));
    let traced = Traced::new(&gpu, worlds[0], shots(HIT), [52, 1, 1]);
    for world in worlds {
        let found = traced.trace_into(world);
        for (x, found) in found.into_iter().enumerate() {
            // (0.25, 0.25) is in the first of a square's triangles.
            let expected = if x < 50 {
                [1.0, 0.0, 2.0 * x as f32, 0.0]
            } else {
                [-1.0; 4]
            };
            assert_eq!(found, expected, "{x}");
        }
    }
}
