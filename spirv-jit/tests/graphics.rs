//! Vertex and fragment shaders: their interface, helper invocations, quads and interpolation.

use shaders::lower_glsl;
use shaders::raster::{ALL, ActiveLanes, program, run};
use spirv_jit::LaneMask;
use spirv_jit::program::{
    Barycentric, Builtin, DepthMode, InputRow, Interlock, OutputRow, Position, Stage, Varying,
    VaryingMode, VaryingPlace,
};

fn varying(location: u16, component: u8, mode: VaryingMode) -> InputRow {
    InputRow::Varying(Varying {
        place: VaryingPlace::Location(location),
        component,
        mode,
    })
}

fn location(location: u16, component: u8) -> OutputRow {
    OutputRow::Location {
        location,
        component,
        index: 0,
    }
}

const SMOOTH: VaryingMode = VaryingMode::Smooth(Position::Center);

#[test]
fn attributes_and_varyings_lie_where_location_and_component_say() {
    let program = program(
        Stage::Vertex,
        "layout(location = 1) in vec3 a;
         layout(location = 4) in dvec3 d;
         layout(location = 7, component = 1) in ivec2 i;
         layout(location = 2) out mat2x3 m;
         layout(location = 5, component = 2) out float f;
         layout(location = 6) flat out dvec3 e;
         layout(location = 9) out Block { vec2 x; layout(location = 12) vec4 y[2]; } b;
         void main() {
             gl_Position = vec4(a, 1.0);
             m = mat2x3(a, a.zyx);
             f = float(i.y);
             e = d * 2.0lf;
             b.x = a.xy;
             b.y[i.x] = vec4(7.0);
         }",
    );
    let attribute = |location, component| InputRow::Attribute {
        location,
        component,
    };
    for component in 0..6 {
        assert!(program.inputs().contains(&attribute(4, component)));
    }
    assert!(program.inputs().contains(&attribute(7, 2)));
    let ended = run(&program, ALL, &mut [], |row, lane| match row {
        InputRow::Attribute {
            location: 1,
            component,
        } => (lane as f32 + 0.25 * f32::from(component)).to_bits(),
        InputRow::Attribute {
            location: 4,
            component,
        } => {
            let bits = (1.5 + f64::from(component / 2)).to_bits();
            (bits >> (32 * (component % 2))) as u32
        }
        InputRow::Attribute {
            location: 7,
            component: 1,
        } => lane as u32 % 2,
        InputRow::Attribute { location: 7, .. } => -3i32 as u32,
        row => panic!("{row:?}"),
    });
    let lane = 5;
    let float = |row| f32::from_bits(ended.words(row)[lane]);
    let position = [0, 1, 2, 3].map(|at| float(OutputRow::Position(at)));
    assert_eq!(position, [5.0, 5.25, 5.5, 1.0]);
    let columns = [(2, 0), (2, 2), (3, 0), (3, 2)].map(|(at, of)| float(location(at, of)));
    assert_eq!(columns, [5.0, 5.5, 5.5, 5.0]);
    assert_eq!(float(location(5, 2)), -3.0);
    let double = |at: u16, of| {
        let words = [of, of + 1].map(|of| u64::from(ended.words(location(at, of))[lane]));
        f64::from_bits(words[0] | words[1] << 32)
    };
    assert_eq!([double(6, 0), double(6, 2), double(7, 0)], [3.0, 5.0, 7.0]);
    assert_eq!(float(location(9, 1)), 5.25);
    let dynamic = [12, 13].map(|at| float(location(at, 3)));
    assert_eq!(dynamic, [0.0, 7.0]);
}

#[test]
fn what_is_never_written_is_no_output() {
    let module = "layout(location = 0) out vec4 c; void main() { gl_Position.x = 2.0; }";
    let program = program(Stage::Vertex, module);
    let expected = [0, 1, 2, 3].map(OutputRow::Position);
    assert_eq!(program.outputs(), expected);
    let ended = run(&program, ALL, &mut [], |_, _| 0);
    assert_eq!(ended.words(OutputRow::Position(0)), [2.0f32.to_bits(); 16]);
    assert_eq!(ended.words(OutputRow::Position(3)), [0; 16]);
}

#[test]
fn vertices_know_their_numbers_and_choose_layer_viewport_and_distances() {
    let program = program(
        Stage::Vertex,
        "out float gl_ClipDistance[2];
         void main() {
             gl_Position = vec4(gl_VertexIndex, gl_InstanceIndex, gl_BaseVertex, gl_BaseInstance);
             gl_PointSize = float(gl_DrawID);
             gl_Layer = gl_ViewIndex;
             gl_ViewportIndex = 3;
             gl_ClipDistance[1] = 0.5;
         }",
    );
    let ended = run(&program, ALL, &mut [], |row, _| match row {
        InputRow::Builtin(Builtin::VertexIndex, 0) => 10,
        InputRow::Builtin(Builtin::InstanceIndex, 0) => 11,
        InputRow::Builtin(Builtin::BaseVertex, 0) => 12,
        InputRow::Builtin(Builtin::BaseInstance, 0) => 13,
        InputRow::Builtin(Builtin::DrawIndex, 0) => 14,
        InputRow::Builtin(Builtin::ViewIndex, 0) => 15,
        row => panic!("{row:?}"),
    });
    let float = |row| f32::from_bits(ended.words(row)[3]);
    let position = [0, 1, 2, 3].map(|at| float(OutputRow::Position(at)));
    assert_eq!(position, [10.0, 11.0, 12.0, 13.0]);
    assert_eq!(float(OutputRow::PointSize), 14.0);
    assert_eq!(ended.words(OutputRow::Layer)[3], 15);
    assert_eq!(ended.words(OutputRow::ViewportIndex)[3], 3);
    assert_eq!(float(OutputRow::ClipDistance(1)), 0.5);
}

#[test]
fn qualifiers_say_how_a_varying_is_evaluated() {
    let program = program(
        Stage::Fragment,
        "layout(location = 0) in vec2 s;
         layout(location = 1) noperspective centroid in float l;
         layout(location = 2) flat in vec2 f;
         layout(location = 3) flat in ivec2 i;
         layout(location = 4, component = 1) sample in float p;
         layout(location = 5) pervertexEXT in vec2 v[3];
         layout(location = 0) out vec4 c;
         void main() {
             c = vec4(s.y, l, f.y, float(i.y)) + p + v[1].y + gl_BaryCoordEXT.z
                 + gl_BaryCoordNoPerspEXT.x;
         }",
    );
    let mut inputs = program.inputs().to_vec();
    inputs.sort();
    let barycentric = |vertex, perspective| {
        InputRow::Barycentric(Barycentric {
            vertex,
            perspective,
            position: Position::Center,
        })
    };
    let mut expected = vec![
        varying(0, 1, SMOOTH),
        varying(1, 0, VaryingMode::Linear(Position::Centroid)),
        varying(2, 1, VaryingMode::Flat),
        varying(3, 1, VaryingMode::Flat),
        varying(4, 1, VaryingMode::Smooth(Position::Sample)),
        varying(5, 1, VaryingMode::PerVertex(1)),
        barycentric(2, true),
        barycentric(0, false),
    ];
    expected.sort();
    assert_eq!(inputs, expected);
    assert!(program.fragment().unwrap().per_sample);
}

#[test]
fn facts_of_a_fragment_shader() {
    let facts = |source: &str| *program(Stage::Fragment, source).fragment().unwrap();
    let plain = facts("layout(location = 2) out vec4 c; void main() { c = vec4(1.0); }");
    assert_eq!(plain.color_mask, 4);
    assert!(!plain.discards && !plain.writes_memory && !plain.per_sample && !plain.dual_source);
    assert_eq!((plain.depth, plain.interlock), (None, None));
    let depth = facts(
        "layout(depth_greater) out float gl_FragDepth;
         void main() { gl_FragDepth = gl_FragCoord.z + 0.5; }",
    );
    assert_eq!(depth.depth, Some(DepthMode::Greater));
    let early = facts("layout(early_fragment_tests) in; void main() {}");
    assert!(early.early_tests);
    let masked = facts(
        "layout(location = 0, index = 0) out vec4 a;
         layout(location = 0, index = 1) out vec4 b;
         void main() {
             a = b = vec4(0.5);
             gl_SampleMask[0] = gl_SampleMaskIn[0] & 5;
             gl_FragStencilRefARB = gl_SampleID;
             if (gl_FragCoord.x > 3.0) discard;
         }",
    );
    assert!(masked.writes_sample_mask && masked.writes_stencil_ref && masked.dual_source);
    assert!(masked.discards && masked.per_sample && !masked.writes_memory);
    let locked = facts(
        "layout(pixel_interlock_ordered) in;
         layout(set = 0, binding = 0) buffer B { uint x; };
         void main() { beginInvocationInterlockARB(); x += 1u; endInvocationInterlockARB(); }",
    );
    assert_eq!(locked.interlock, Some(Interlock::PixelOrdered));
    assert!(locked.writes_memory);
    let attachment = facts(
        "layout(input_attachment_index = 0, set = 0, binding = 1) uniform subpassInput a;
         layout(location = 0) out vec4 c;
         void main() { c = subpassLoad(a); }",
    );
    assert!(attachment.reads_attachments);
}

#[test]
fn helpers_change_no_memory_and_atomics_give_them_zero() {
    let program = program(
        Stage::Fragment,
        "layout(set = 0, binding = 0) buffer B { uint count; uint bits; uint stored[16]; };
         layout(location = 0) flat in uint lane;
         layout(location = 0) out uint c;
         void main() {
             c = atomicAdd(count, 1u) + 100u;
             atomicOr(bits, 1u << lane);
             stored[lane] = lane + 1u;
             if (gl_HelperInvocation) c += 1000u;
         }",
    );
    let helpers = LaneMask::from_bits(0b1010_0000_1111_0110);
    let mut buffer = [0; 18];
    buffer[0] = 7;
    let lanes = ActiveLanes {
        active: LaneMask::ALL,
        helpers,
    };
    let ended = run(&program, lanes, &mut buffer, |_, lane| lane as u32);
    assert_eq!(ended.helpers, helpers);
    assert_eq!(buffer[0], 7 + (!helpers).count());
    assert_eq!(buffer[1], u32::from((!helpers).bits()));
    for lane in 0..16 {
        let is_helper = helpers.contains(lane);
        let expected = if is_helper { 0 } else { lane as u32 + 1 };
        assert_eq!(buffer[2 + lane], expected, "lane {lane}");
        let color = ended.words(location(0, 0))[lane];
        assert_eq!(color >= 1000, is_helper);
        assert!(!is_helper || color == 1100);
    }
}

/// A lane that is demoted goes on, so that its neighbours have derivatives; `gl_HelperInvocation`
/// stays what it was at the start.
#[test]
fn a_demoted_lane_is_still_a_neighbour() {
    let program = program(
        Stage::Fragment,
        "layout(set = 0, binding = 0) buffer B { uint stored[16]; };
         layout(location = 0) in vec2 x;
         layout(location = 1) flat in uint lane;
         layout(location = 0) out vec4 c;
         void main() {
             bool before = helperInvocationEXT();
             if (lane == 1u || lane == 6u) demote;
             float y = x.y * 2.0;
             c = vec4(dFdx(x.x), dFdy(y), fwidth(x.x), before ? 1.0 : 0.0);
             stored[lane] = 1u + uint(helperInvocationEXT());
         }",
    );
    let value = |lane: usize| [1.0, 5.0, 12.0, 40.0][lane % 4] + lane as f32;
    let mut buffer = [0; 16];
    let lanes = ActiveLanes {
        active: LaneMask::ALL,
        helpers: LaneMask::of(9),
    };
    let ended = run(&program, lanes, &mut buffer, |row, lane| match row {
        InputRow::Varying(Varying {
            place: VaryingPlace::Location(0),
            ..
        }) => value(lane).to_bits(),
        _ => lane as u32,
    });
    assert_eq!(ended.helpers, [1, 6, 9].into_iter().collect());
    for lane in 0..16 {
        let dx = value(lane | 1) - value(lane & !1);
        let dy = value(lane | 2) - value(lane & !2);
        assert_eq!(ended.floats(0, 0)[lane], dx, "lane {lane}");
        assert_eq!(ended.floats(0, 1)[lane], 2.0 * dy, "lane {lane}");
        assert_eq!(ended.floats(0, 2)[lane], dx.abs() + dy.abs());
        assert_eq!(ended.floats(0, 3)[lane], f32::from(lane as u8 == 9));
        let is_helper = ended.helpers.contains(lane);
        assert_eq!(buffer[lane], u32::from(!is_helper));
    }
}

/// Each lane leaves the loop in its own iteration, killed or not; the helper mask outlasts
/// suspensions.
#[test]
fn a_killed_lane_ends_at_once() {
    let program = program(
        Stage::Fragment,
        "layout(set = 0, binding = 0) buffer B { uint stored[16]; };
         layout(location = 0) flat in uint lane;
         layout(location = 0) out uint c;
         void main() {
             uint n = 0u;
             for (uint i = 0u; i < 100u + lane; i++) {
                 if (i == 3u * lane && (lane & 1u) != 0u) terminateInvocation;
                 stored[lane] = i;
                 n += i;
             }
             c = n;
         }",
    );
    let mut buffer = [0; 16];
    let ended = run(&program, ALL, &mut buffer, |_, lane| lane as u32);
    assert_eq!(ended.helpers, LaneMask::from_bits(0xAAAA));
    for lane in 0..16u32 {
        let (last, color) = match lane % 2 {
            0 => (99 + lane, (0..100 + lane).sum()),
            _ => (3 * lane - 1, 0),
        };
        assert_eq!(buffer[lane as usize], last);
        assert_eq!(ended.words(location(0, 0))[lane as usize], color);
    }
    assert!(program.fragment().unwrap().discards);
}

/// An ended neighbour counts as equal: derivatives are zero, swaps give the own value.
#[test]
fn an_inactive_neighbour_counts_as_equal() {
    let program = program(
        Stage::Fragment,
        "layout(location = 0) in float x;
         layout(location = 1) flat in uint lane;
         layout(location = 0) out vec4 c;
         void main() {
             if (lane == 1u) terminateInvocation;
             c = vec4(dFdx(x), dFdy(x), subgroupQuadSwapHorizontal(x), subgroupQuadBroadcast(x, 3u));
         }",
    );
    let ended = run(&program, ALL, &mut [], |row, lane| match row {
        InputRow::Varying(Varying {
            place: VaryingPlace::Location(0),
            ..
        }) => (10.0 * lane as f32).to_bits(),
        _ => lane as u32,
    });
    let color = |lane: usize| [0, 1, 2, 3].map(|component| ended.floats(0, component)[lane]);
    assert_eq!(color(0), [0.0, 20.0, 0.0, 30.0]);
    assert_eq!(color(2), [10.0, 20.0, 30.0, 30.0]);
    assert_eq!(color(3), [10.0, 0.0, 20.0, 30.0]);
    assert_eq!(color(5), [10.0, 20.0, 40.0, 70.0]);
}

/// Operations across the subgroup exclude helpers, except those of quads; helpers among themselves
/// are a subgroup, so waterfall loops end.
#[test]
fn subgroups_leave_helpers_out() {
    let program = program(
        Stage::Fragment,
        "layout(set = 0, binding = 0) buffer B { uint elected; uint ballot; };
         layout(location = 0) flat in uint lane;
         layout(location = 0) out uvec4 c;
         void main() {
             uint all = subgroupBallot(true).x;
             if (subgroupElect()) { elected = lane; ballot = all; }
             c.x = subgroupAdd(lane);
             c.y = subgroupQuadSwapDiagonal(lane);
             c.z = 0u;
             for (;;) {
                 uint first = subgroupBroadcastFirst(lane / 4u);
                 c.z++;
                 if (first == lane / 4u) break;
             }
             c.w = subgroupBallot(true).x;
         }",
    );
    let mut buffer = [99; 2];
    let lanes = ActiveLanes {
        active: LaneMask::ALL,
        helpers: LaneMask::from_bits(0xF003),
    };
    let ended = run(&program, lanes, &mut buffer, |_, lane| lane as u32);
    assert_eq!(buffer, [2, 0x0FFC]);
    let component = |at| ended.words(location(0, at));
    assert_eq!(component(0), [(2..12).sum(); 16]);
    assert_eq!(component(1), std::array::from_fn(|lane| lane as u32 ^ 3));
    assert_eq!(
        component(2),
        std::array::from_fn(|lane| lane as u32 / 4 + 1)
    );
}

/// Planes of barycentric coordinates with different 1/w at each vertex.
const PLANES: [[f32; 3]; 3] = [
    [0.25, 0.125, -0.0625],
    [0.5, -0.25, 0.125],
    [1.0, 0.0625, 0.5],
];

fn vertex_value(vertex: u8, component: u8) -> f32 {
    f32::from(1 + vertex) * 3.0 + f32::from(component)
}

fn interpolation_input(row: InputRow, lane: usize) -> u32 {
    match row {
        InputRow::Builtin(Builtin::PerspectivePlanes | Builtin::LinearPlanes, word) => {
            PLANES[usize::from(word % 3)][usize::from(word / 3)].to_bits()
        }
        // Those of four samples.
        InputRow::Builtin(Builtin::SampleLocations, axis) => [0xa2e6, 0xea62][usize::from(axis)],
        InputRow::Varying(Varying {
            place: VaryingPlace::Location(9),
            ..
        }) => lane as u32 % 4,
        InputRow::Varying(Varying {
            place: VaryingPlace::Location(location),
            component,
            mode: VaryingMode::PerVertex(vertex),
        }) => vertex_value(vertex, location as u8 * 4 + component).to_bits(),
        InputRow::Varying(Varying {
            component,
            mode: VaryingMode::Smooth(Position::Centroid),
            ..
        }) => (50.0 + f32::from(component)).to_bits(),
        InputRow::Varying(Varying {
            mode: VaryingMode::Flat,
            ..
        }) => 77.0f32.to_bits(),
        row => panic!("{row:?}"),
    }
}

/// The interpolated value by the definition: weights from planes at the offset, divided by their
/// sum where perspective-correct.
fn interpolated(component: u8, [x, y]: [f32; 2], perspective: bool) -> f32 {
    let weights = PLANES.map(|[at, dx, dy]| at + dx * x + dy * y);
    let sum: f32 = match perspective {
        true => weights.iter().sum(),
        false => 1.0,
    };
    let parts = (0u8..).zip(weights);
    parts
        .map(|(vertex, weight)| weight / sum * vertex_value(vertex, component))
        .sum()
}

fn assert_near(a: f32, b: f32) {
    assert!(
        (a - b).abs() <= 1e-5 * b.abs().max(1.0),
        "{a} instead of {b}"
    );
}

#[test]
fn interpolation_at_an_offset_follows_the_planes() {
    let program = program(
        Stage::Fragment,
        "layout(location = 0) in vec4 a[2];
         layout(location = 3) noperspective in vec2 b;
         layout(location = 4) flat in float f;
         layout(location = 9) flat in int i;
         layout(location = 0) out vec4 c;
         layout(location = 1) out vec4 d;
         void main() {
             vec2 offset = vec2(0.25, -0.375);
             c.x = interpolateAtOffset(a[1].z, offset);
             c.y = interpolateAtOffset(b, offset).y;
             c.z = interpolateAtOffset(a[i & 1], offset).w;
             c.w = interpolateAtOffset(f, offset);
             d.x = interpolateAtSample(a[0].x, i);
             d.y = interpolateAtCentroid(a[0]).y;
             d.z = interpolateAtCentroid(a[i & 1]).w;
             d.w = interpolateAtOffset(gl_BaryCoordEXT, offset).z;
         }",
    );
    let ended = run(&program, ALL, &mut [], interpolation_input);
    let offset = [0.25, -0.375];
    // The standard locations of four samples, from the centre.
    let samples = [
        [-0.125, -0.375],
        [0.375, -0.125],
        [-0.375, 0.125],
        [0.125, 0.375],
    ];
    for lane in 0..16 {
        let at = |location, component| ended.floats(location, component)[lane];
        assert_near(at(0, 0), interpolated(4 + 2, offset, true));
        assert_near(at(0, 1), interpolated(12 + 1, offset, false));
        let element = lane as u8 & 1;
        assert_near(at(0, 2), interpolated(4 * element + 3, offset, true));
        assert_eq!(at(0, 3), 77.0);
        assert_near(at(1, 0), interpolated(0, samples[lane % 4], true));
        assert_eq!(at(1, 1), 51.0);
        assert_eq!(at(1, 2), 53.0);
        let weights = PLANES.map(|[at, dx, dy]| at + dx * offset[0] + dy * offset[1]);
        assert_near(at(1, 3), weights[2] / weights.iter().sum::<f32>());
    }
    assert!(!program.fragment().unwrap().per_sample);
}

/// Varyings of 16 bits are interpolated with 32, and are colours of 32.
#[test]
fn narrow_varyings_and_colors() {
    let vertex = program(
        Stage::Vertex,
        "layout(location = 0) in f16vec2 a;
         layout(location = 0) out f16vec2 h;
         layout(location = 1) flat out i16vec2 i;
         void main() {
             gl_Position = vec4(1.0);
             h = a * float16_t(2.0);
             i = i16vec2(-5, 6);
         }",
    );
    let ended = run(&vertex, ALL, &mut [], |_, _| 0.75f32.to_bits());
    assert_eq!(ended.floats(0, 1), [1.5; 16]);
    assert_eq!(ended.words(location(1, 0)), [-5i32 as u32; 16]);
    let fragment = program(
        Stage::Fragment,
        "layout(location = 0) in f16vec2 h;
         layout(location = 1) flat in i16vec2 i;
         layout(location = 0) out f16vec4 c;
         layout(location = 1) out u16vec2 u;
         void main() { c = f16vec4(h.y, float16_t(i.x), 0.0, 1.0); u = u16vec2(i); }",
    );
    assert!(fragment.inputs().contains(&varying(0, 1, SMOOTH)));
    let ended = run(&fragment, ALL, &mut [], |row, _| match row {
        InputRow::Varying(Varying {
            mode: VaryingMode::Flat,
            ..
        }) => -5i32 as u32,
        _ => 0.625f32.to_bits(),
    });
    assert_eq!(ended.floats(0, 0), [0.625; 16]);
    assert_eq!(ended.floats(0, 1), [-5.0; 16]);
    assert_eq!(ended.words(location(1, 0)), [0xFFFB; 16]);
}

/// Outputs that several functions write in part, through computed indices, and that are read back.
#[test]
fn outputs_are_variables_until_the_end() {
    let program = program(
        Stage::Fragment,
        "layout(location = 0) flat in uint lane;
         layout(location = 0) out uvec4 c;
         layout(location = 1) out uint list[3];
         void set(uint at, uint value) { c[at] = value; list[at % 3u]++; }
         void main() {
             c = uvec4(9u);
             for (uint i = 0u; i < lane; i++) set(i % 4u, i);
             c.w += c.x;
         }",
    );
    let ended = run(&program, ALL, &mut [], |_, lane| lane as u32);
    for lane in 0..16u32 {
        let (mut color, mut list) = ([9u32; 4], [0; 3]);
        for i in 0..lane {
            color[i as usize % 4] = i;
            list[i as usize % 4 % 3] += 1;
        }
        color[3] += color[0];
        let at = |place, component| ended.words(location(place, component))[lane as usize];
        assert_eq!([0, 1, 2, 3].map(|component| at(0, component)), color);
        assert_eq!([1, 2, 3].map(|place| at(place, 0)), list);
    }
}

/// An input attachment is read at the fragment's own pixel, in the layer that is drawn to.
#[test]
fn input_attachments_are_read_in_place() {
    let module = lower_glsl(
        Stage::Fragment,
        "layout(input_attachment_index = 0, set = 0, binding = 1) uniform subpassInputMS a;
         layout(location = 0) out vec4 c;
         void main() { c = subpassLoad(a, 2); }",
    );
    for row in [
        InputRow::Builtin(Builtin::FragCoord, 0),
        InputRow::Builtin(Builtin::FragCoord, 1),
        InputRow::Builtin(Builtin::AttachmentLayer, 0),
    ] {
        assert!(module.inputs.contains(&row), "{row:?}");
    }
}
