//! The shader's decisions, and those of flags and masks before it.

use super::*;

#[test]
fn the_shader_decides_on_triangles_that_are_not_opaque() {
    let Some(gpu) = open() else { return };
    let heights: Vec<f32> = (1..=12).map(|z| z as f32).collect();
    let world = gpu.scene(&[
        Geometry::triangles(&layers(&heights), ASKS),
        Geometry::triangles(&layers(&[20.0]), NEAREST),
    ]);
    // Each invocation confirms the layers whose height is a multiple of its number plus one.
    let body = r"
    layout(local_size_x = 24) in;
    void main() {
        uint i = gl_LocalInvocationIndex;
        rayQueryEXT q;
        rayQueryInitializeEXT(q, world, 0, 0xff, vec3(0.0), 0.0, vec3(0.0, 0.0, 1.0), 100.0);
        uint wrong = 0, after = 0;
        while (rayQueryProceedEXT(q)) {
            float t = rayQueryGetIntersectionTEXT(q, false);
            uint primitive = rayQueryGetIntersectionPrimitiveIndexEXT(q, false);
            if (rayQueryGetIntersectionTypeEXT(q, false) != 0) wrong++;
            if (primitive + 1 != uint(t + 0.5)) wrong++;
            if (rayQueryGetIntersectionGeometryIndexEXT(q, false) != 0) wrong++;
            if (t > rayQueryGetIntersectionTEXT(q, true)
                && rayQueryGetIntersectionTypeEXT(q, true) != 0) wrong++;
            if ((primitive + 1) % (i + 1) == 0) {
                rayQueryConfirmIntersectionEXT(q);
                if (rayQueryGetIntersectionTEXT(q, true) != t) wrong++;
                if (rayQueryGetIntersectionPrimitiveIndexEXT(q, true) != primitive) wrong++;
                if (rayQueryGetIntersectionTypeEXT(q, true) != 1) wrong++;
            }
        }
        results[4 * i] = rayQueryGetIntersectionTypeEXT(q, true);
        results[4 * i + 1] = uint(rayQueryGetIntersectionTEXT(q, true) + 0.5);
        results[4 * i + 2] = uint(rayQueryGetIntersectionGeometryIndexEXT(q, true));
        results[4 * i + 3] = wrong;
    }";
    let words = query(&gpu, world, body, 1, 96);
    for (i, words) in words.chunks(4).enumerate() {
        let step = i as u32 + 1;
        let expected = if step <= 12 {
            [1, step, 0, 0]
        } else {
            [1, 20, 1, 0]
        };
        assert_eq!(words, expected, "every {step}th");
    }
}

#[test]
fn hits_are_generated_in_boxes() {
    let Some(gpu) = open() else { return };
    let boxes: Vec<[f32; 6]> = (0..6)
        .map(|i| {
            let z = 10.0 * (i + 1) as f32;
            [-1.0, -1.0, z - 1.0, 1.0, 1.0, z + 1.0]
        })
        .collect();
    let world = gpu.scene(&[
        Geometry::boxes(&boxes[..3], ASKS),
        Geometry::boxes(&boxes[3..], NEAREST),
    ]);
    // Invocation i takes the middle of the boxes from number i on; 6 takes none.
    let body = r"
    layout(local_size_x = 7) in;
    void main() {
        uint i = gl_LocalInvocationIndex;
        rayQueryEXT q;
        rayQueryInitializeEXT(q, world, 0, 0xff, vec3(0.0), 0.0, vec3(0.0, 0.0, 1.0), 1000.0);
        uint wrong = 0;
        while (rayQueryProceedEXT(q)) {
            uint geometry = rayQueryGetIntersectionGeometryIndexEXT(q, false);
            uint number = 3 * geometry + rayQueryGetIntersectionPrimitiveIndexEXT(q, false);
            if (rayQueryGetIntersectionTypeEXT(q, false) != 1) wrong++;
            if (rayQueryGetIntersectionCandidateAABBOpaqueEXT(q) != (geometry == 1)) wrong++;
            float t = 10.0 * (number + 1);
            bool nearer = rayQueryGetIntersectionTypeEXT(q, true) == 0
                || t < rayQueryGetIntersectionTEXT(q, true);
            if (number >= i && nearer) {
                // The nearer one of two counts.
                rayQueryGenerateIntersectionEXT(q, t + 0.5);
                rayQueryGenerateIntersectionEXT(q, t);
                if (rayQueryGetIntersectionTypeEXT(q, true) != 2) wrong++;
                if (rayQueryGetIntersectionTEXT(q, true) != t) wrong++;
            }
        }
        results[4 * i] = rayQueryGetIntersectionTypeEXT(q, true);
        results[4 * i + 1] = results[4 * i] == 0 ? 0 : uint(rayQueryGetIntersectionTEXT(q, true));
        results[4 * i + 2] = results[4 * i] == 0 ? 0 : uint(rayQueryGetIntersectionPrimitiveIndexEXT(q, true));
        results[4 * i + 3] = wrong;
    }";
    let words = query(&gpu, world, body, 1, 28);
    for (i, words) in words.chunks(4).enumerate() {
        let i = i as u32;
        let expected = match i {
            6 => [0; 4],
            _ => [2, 10 * (i + 1), i % 3, 0],
        };
        assert_eq!(words, expected, "from box {i}");
    }
}

#[test]
fn flags_and_masks_choose_candidates() {
    let Some(gpu) = open() else { return };
    let bottoms = [
        gpu.bottom(&[Geometry::triangles(&layers(&[1.0]), NEAREST)]),
        gpu.bottom(&[Geometry::triangles(&layers(&[2.0]), ASKS)]),
        gpu.bottom(&[Geometry::boxes(&[[-1.0, -1.0, 3.0, 1.0, 1.0, 4.0]], ASKS)]),
        gpu.bottom(&[Geometry::boxes(
            &[[-1.0, -1.0, 5.0, 1.0, 1.0, 6.0]],
            NEAREST,
        )]),
    ];
    let mut instances: Vec<Instance> = bottoms.into_iter().map(Instance::of).collect();
    // Turned round, a triangle shows its back.
    instances.push(Instance {
        transform: [
            1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 10.0,
        ],
        ..Instance::of(bottoms[1])
    });
    instances.push(Instance {
        mask: 0x40,
        flags: vk::GeometryInstanceFlagsKHR::FORCE_OPAQUE
            | vk::GeometryInstanceFlagsKHR::TRIANGLE_FLIP_FACING,
        transform: translated([0.0, 0.0, 8.0]),
        ..Instance::of(bottoms[1])
    });
    let world = gpu.top(&instances);
    // Bits of the instances that were candidates, and the nearest opaque triangle's.
    let body = r"
    layout(primitive_culling);
    layout(local_size_x = 1) in;
    layout(push_constant) uniform Push { uint flags; uint mask; };
    void main() {
        rayQueryEXT q;
        rayQueryInitializeEXT(q, world, flags, mask, vec3(0.0), 0.0, vec3(0.0, 0.0, 1.0), 100.0);
        uint candidates = 0;
        while (rayQueryProceedEXT(q)) candidates |= 1u << rayQueryGetIntersectionInstanceIdEXT(q, false);
        results[0] = candidates;
        results[1] = rayQueryGetIntersectionTypeEXT(q, true) == 0
            ? 99 : rayQueryGetIntersectionInstanceIdEXT(q, true);
    }";
    let results = gpu.buffer(8);
    let set = gpu.set_of(&[world.into(), results.into()]);
    let kernel = gpu.kernel(&format!("{HEAD}{body}"), &[set.layout]);
    const OPAQUE: u32 = 0x1;
    const NO_OPAQUE: u32 = 0x2;
    const CULL_BACK: u32 = 0x10;
    const CULL_FRONT: u32 = 0x20;
    const CULL_OPAQUE: u32 = 0x40;
    const CULL_NO_OPAQUE: u32 = 0x80;
    const SKIP_TRIANGLES: u32 = 0x100;
    const SKIP_AABBS: u32 = 0x200;
    // Queries after an opaque triangle depend on the order, so there is none with candidates.
    let cases: [(u32, u32, u32, u32); 9] = [
        (NO_OPAQUE, 0xff, 0b111111, 99),
        (NO_OPAQUE | CULL_BACK, 0xff, 0b001111, 99),
        (NO_OPAQUE | CULL_FRONT, 0xff, 0b111100, 99),
        (NO_OPAQUE, 0x80 | 0x300, 0b011111, 99),
        (NO_OPAQUE, 0, 0, 99),
        (CULL_OPAQUE, 0xff, 0b010110, 99),
        (CULL_NO_OPAQUE | SKIP_AABBS, 0xff, 0, 0),
        (SKIP_TRIANGLES, 0xff, 0b001100, 99),
        (OPAQUE | SKIP_AABBS, 0xff, 0, 0),
    ];
    for (flags, mask, candidates, nearest) in cases {
        results.write(0, &[0u32; 2]);
        gpu.dispatch(kernel, &[set], &[flags, mask], [1, 1, 1]);
        let got: Vec<u32> = results.read();
        assert_eq!(
            got,
            [candidates, nearest],
            "flags {flags:#x}, mask {mask:#x}"
        );
    }
}

#[test]
fn queries_end_when_they_are_told_to() {
    let Some(gpu) = open() else { return };
    let heights: Vec<f32> = (1..=9).map(|z| z as f32).collect();
    let world = gpu.scene(&[Geometry::triangles(&layers(&heights), ASKS)]);
    let body = r"
    layout(local_size_x = 20) in;
    void begin(rayQueryEXT q, uint flags) {
        rayQueryInitializeEXT(q, world, flags, 0xff, vec3(0.0), 0.0, vec3(0.0, 0.0, 1.0), 100.0);
    }
    void main() {
        uint i = 8 * gl_LocalInvocationIndex;
        rayQueryEXT q;
        // Ended after a candidate was seen, with nothing committed.
        begin(q, 0);
        results[i] = uint(rayQueryProceedEXT(q));
        rayQueryTerminateEXT(q);
        results[i + 1] = uint(rayQueryProceedEXT(q));
        results[i + 2] = rayQueryGetIntersectionTypeEXT(q, true);
        // Begun again in the middle; ends with the first hit.
        begin(q, 0);
        rayQueryProceedEXT(q);
        begin(q, gl_RayFlagsTerminateOnFirstHitEXT);
        uint count = 0;
        while (rayQueryProceedEXT(q)) {
            count++;
            rayQueryConfirmIntersectionEXT(q);
        }
        results[i + 3] = count;
        results[i + 4] = rayQueryGetIntersectionTypeEXT(q, true);
        // Left in the middle, differently in each invocation, and begun again many times.
        uint seen = 0;
        for (uint k = 0; k < 10; k++) {
            begin(q, 0);
            for (uint n = 0; n < (gl_LocalInvocationIndex + k) % 5 && rayQueryProceedEXT(q); n++) seen++;
        }
        results[i + 5] = seen;
        // Committed, then terminated.
        begin(q, 0);
        rayQueryProceedEXT(q);
        rayQueryConfirmIntersectionEXT(q);
        float t = rayQueryGetIntersectionTEXT(q, false);
        rayQueryTerminateEXT(q);
        results[i + 6] = uint(rayQueryProceedEXT(q));
        results[i + 7] = uint(rayQueryGetIntersectionTEXT(q, true) == t);
    }";
    let words = query(&gpu, world, body, 1, 160);
    for (i, words) in words.chunks(8).enumerate() {
        assert_eq!(words, [1, 0, 0, 1, 1, 20, 0, 1], "invocation {i}");
    }
}
