//! Vertex and fragment shaders: their interface by location and component, helper invocations, quads, interpolation.

mod support;

use spirv_jit::environment::{Descriptor, DescriptorSet, Environment};
use spirv_jit::interp::Frame;
use spirv_jit::ir::binary;
use spirv_jit::program::{
    AlignedRow, Builtin, Event, InputRow, OutputRow, Position, Stage, Varying, VaryingMode,
    VaryingPlace, Wave,
};
use spirv_jit::{Program, SUBGROUP_SIZE};
use support::run::compile_as;
use support::{glsl, lower_glsl};

/// Runs one subgroup; `fill` gives each input row's words. Returns the outputs' rows and the helpers.
fn run(
    program: &Program,
    (active, helpers): (u16, u16),
    environment: &Environment,
    fill: impl Fn(InputRow, usize) -> u32,
) -> (Vec<[u32; SUBGROUP_SIZE]>, u16) {
    let layout = program.layout();
    let mut state = vec![AlignedRow::default(); layout.rows];
    program.start_fragments(&mut state, active, helpers);
    for (row, &input) in state[layout.inputs..].iter_mut().zip(program.inputs()) {
        row.0 = std::array::from_fn(|lane| fill(input, lane));
    }
    let mut fuel = u64::MAX;
    // SAFETY: what the environment names outlives the run.
    let event = unsafe {
        program.run(
            &mut Frame::default(),
            &mut Wave {
                states: &mut [&mut state],
                shared: std::ptr::null_mut(),
                environment,
            },
            &mut fuel,
        )
    };
    assert_eq!(event, Event::End);
    let outputs = state[layout.io..][..program.outputs().len()].iter();
    (outputs.map(|row| row.0).collect(), program.helpers(&state))
}

fn location(location: u16, component: u8) -> OutputRow {
    OutputRow::Location {
        location,
        component,
        index: 0,
    }
}

fn smooth(location: u16, component: u8) -> InputRow {
    InputRow::Varying(Varying {
        place: VaryingPlace::Location(location),
        component,
        mode: VaryingMode::Smooth(Position::Center),
    })
}

#[test]
fn a_vertex_shader_has_what_it_writes() {
    let words = glsl(
        Stage::Vertex,
        "layout(location = 2) in vec3 position;
         layout(location = 5, component = 1) in vec2 middle;
         layout(location = 1) out mat2 matrix;
         layout(location = 6, component = 2) flat out uint number;
         layout(location = 7) out vec4 never;
         void main() {
             gl_Position = vec4(position, 1.0);
             matrix = mat2(middle, middle.yx);
             number = uint(gl_VertexIndex) * 10u + uint(gl_InstanceIndex);
         }",
    );
    let program = compile_as(Stage::Vertex, &words, &[]);
    // Point size, distances, and the location that is never written are not there.
    let mut outputs = program.outputs().to_vec();
    outputs.sort();
    let mut expected = vec![
        location(1, 0),
        location(1, 1),
        location(2, 0),
        location(2, 1),
        location(6, 2),
    ];
    expected.extend((0..4).map(OutputRow::Position));
    assert_eq!(outputs, expected);
    let value = |input, lane: usize| match input {
        InputRow::Attribute {
            location: 2,
            component,
        } => ((lane + usize::from(component)) as f32).to_bits(),
        InputRow::Attribute {
            location: 5,
            component,
        } => (f32::from(component) * 0.5).to_bits(),
        InputRow::Builtin(Builtin::VertexIndex, _) => lane as u32,
        InputRow::Builtin(Builtin::InstanceIndex, _) => 3,
        other => panic!("{other:?}"),
    };
    let (rows, _) = run(&program, (u16::MAX, 0), &Environment::unbound(), value);
    let row = |wanted| {
        let place = program.outputs().iter().position(|&row| row == wanted);
        rows[place.expect("an output")]
    };
    assert_eq!(row(OutputRow::Position(2))[4], 6.0f32.to_bits());
    assert_eq!(row(OutputRow::Position(3))[4], 1.0f32.to_bits());
    // Components 1 and 2 of location 5 are 0.5 and 1; the second column is the other way round.
    assert_eq!(row(location(1, 0))[0], 0.5f32.to_bits());
    assert_eq!(row(location(2, 0))[0], 1.0f32.to_bits());
    assert_eq!(row(location(6, 2))[7], 73);
}

#[test]
fn varyings_say_how_they_are_interpolated() {
    let module = lower_glsl(
        Stage::Fragment,
        "layout(location = 0) in vec2 plain;
         layout(location = 1) flat in int number;
         layout(location = 2) noperspective centroid in float linear;
         layout(location = 3) in Block { sample vec2 first; float second; } block;
         layout(location = 0) out vec4 color;
         void main() {
             color = vec4(plain.y, float(number), linear + block.first.y, block.second);
         }",
    );
    let varying = |location, component, mode| {
        InputRow::Varying(Varying {
            place: VaryingPlace::Location(location),
            component,
            mode,
        })
    };
    for row in [
        smooth(0, 1),
        varying(1, 0, VaryingMode::Flat),
        varying(2, 0, VaryingMode::Linear(Position::Centroid)),
        varying(3, 1, VaryingMode::Smooth(Position::Sample)),
        varying(4, 0, VaryingMode::Smooth(Position::Center)),
    ] {
        assert!(module.inputs.contains(&row), "{row:?}");
    }
    let facts = module.fragment.expect("a fragment shader");
    assert!(facts.per_sample && !facts.discards && facts.color_mask == 1);
    let again = binary::decode(&binary::encode(&module)).expect("round trip");
    assert_eq!(again, module);
}

/// Helpers see stores of nobody, and nobody sees theirs; atomics give them zero; demotion takes effect at once.
#[test]
fn helpers_have_no_effects() {
    let words = glsl(
        Stage::Fragment,
        "layout(set = 0, binding = 0) buffer Out { uint data[]; };
         layout(location = 0) in flat uint lane;
         layout(location = 0) out uvec3 color;
         void main() {
             data[lane] = 7u;
             uint before = atomicAdd(data[32], 1u) + 1u;
             if (lane == 5u) demote;
             data[16u + lane] = 9u;
             uint after = atomicAdd(data[33], 1u) + 1u;
             if (lane == 6u) discard;
             color = uvec3(before, after, helperInvocationEXT() ? 1u : 0u);
         }",
    );
    let program = compile_as(Stage::Fragment, &words, &[]);
    let facts = program.fragment().expect("a fragment shader");
    assert!(facts.discards && facts.writes_memory);
    let mut data = vec![0u32; 64];
    let entries = [Descriptor {
        address: data.as_mut_ptr() as u64,
        size_bytes: 256,
        ..Descriptor::NULL
    }];
    let mut environment = Environment::unbound();
    environment.sets[0] = DescriptorSet {
        entries: entries.as_ptr(),
        count: 1,
        ..DescriptorSet::NONE
    };
    let (rows, helpers) = run(&program, (0x0fff, 0x0009), &environment, |_, lane| {
        lane as u32
    });
    let stored = |first: usize, value: u32| -> u16 {
        (0..16).fold(0, |mask, lane| {
            mask | u16::from(data[first + lane] == value) << lane
        })
    };
    assert_eq!(stored(0, 7), 0x0ff6);
    assert_eq!(stored(16, 9), 0x0fd6);
    assert_eq!((data[32], data[33]), (10, 9));
    assert_eq!(helpers, 0x0069);
    assert_eq!((rows[0][0], rows[0][3]), (1, 1));
    assert_eq!((rows[1][5], rows[2][5]), (1, 1));
    assert_eq!((rows[2][0], rows[2][1]), (1, 0));
}

/// A neighbour that has ended reads as the lane itself: the derivative there is zero.
#[test]
fn derivatives_are_between_the_lanes_of_a_quad() {
    let words = glsl(
        Stage::Fragment,
        "layout(location = 0) in float value;
         layout(location = 1) in flat uint lane;
         layout(location = 0) out vec3 color;
         void main() {
             if (lane == 5u) terminateInvocation;
             color = vec3(dFdx(value), dFdy(value), fwidth(value));
         }",
    );
    let program = compile_as(Stage::Fragment, &words, &[]);
    let value = |lane: usize| (lane * lane) as f32;
    let (rows, _) = run(
        &program,
        (u16::MAX, 0),
        &Environment::unbound(),
        |input, lane| match input {
            InputRow::Varying(varying) if varying.place == VaryingPlace::Location(0) => {
                value(lane).to_bits()
            }
            _ => lane as u32,
        },
    );
    for lane in (0..16).filter(|&lane| lane != 5) {
        let quad = lane / 4 * 4;
        let (left, top) = (quad + (lane & 2), quad + (lane & 1));
        let difference = |first: usize, second: usize| {
            let at = |other: usize| {
                if other == 5 {
                    value(lane)
                } else {
                    value(other)
                }
            };
            at(second) - at(first)
        };
        let (dx, dy) = (difference(left, left + 1), difference(top, top + 2));
        assert_eq!(f32::from_bits(rows[0][lane]), dx, "dx of {lane}");
        assert_eq!(f32::from_bits(rows[1][lane]), dy, "dy of {lane}");
        assert_eq!(f32::from_bits(rows[2][lane]), dx.abs() + dy.abs());
    }
}

/// At an offset, a varying is the sum of the vertices' values by weights that the planes give there.
#[test]
fn interpolation_at_an_offset_follows_the_planes() {
    let words = glsl(
        Stage::Fragment,
        "layout(location = 0) in float value;
         layout(location = 0) out vec2 color;
         void main() {
             color = vec2(interpolateAtOffset(value, vec2(0.25, -0.5)), interpolateAtSample(value, 2));
         }",
    );
    let program = compile_as(Stage::Fragment, &words, &[]);
    let planes: [f32; 9] = [0.5, 0.25, 0.125, 0.0625, -0.125, 0.25, 0.125, 0.5, -0.0625];
    let vertices = [3.0f32, 5.0, -2.0];
    let (rows, _) = run(
        &program,
        (1, 0),
        &Environment::unbound(),
        |input, _| match input {
            InputRow::Builtin(Builtin::PerspectivePlanes, word) => {
                planes[usize::from(word)].to_bits()
            }
            InputRow::Builtin(Builtin::SampleCount, _) => 4,
            InputRow::Varying(Varying {
                mode: VaryingMode::PerVertex(vertex),
                ..
            }) => vertices[usize::from(vertex)].to_bits(),
            other => panic!("{other:?}"),
        },
    );
    let at = |x: f32, y: f32| {
        let weights = [0, 1, 2].map(|k| planes[k] + planes[3 + k] * x + planes[6 + k] * y);
        let sum = weights[0] + weights[1] + weights[2];
        let [a, b, c] = [0, 1, 2].map(|k| weights[k] / sum * vertices[k]);
        a + b + c
    };
    assert_eq!(f32::from_bits(rows[0][0]), at(0.25, -0.5));
    // The third of four samples lies at (0.125, 0.625).
    assert_eq!(f32::from_bits(rows[1][0]), at(-0.375, 0.125));
}
