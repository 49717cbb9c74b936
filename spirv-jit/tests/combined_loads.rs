//! Combined loads give what the loads did that they are made of: on every tier, in lanes whose
//! record is inside of its memory, partly outside and outside.

use std::sync::Arc;

use spirv_jit::environment::{Descriptor, DescriptorSet, Environment};
use spirv_jit::interp::Frame;
use spirv_jit::ir::text::parse_module;
use spirv_jit::ir::{Module, Op, verify};
use spirv_jit::pass::run_pass;
use spirv_jit::program::{AlignedRow, Event, Wave};
use spirv_jit::reach::{Range, Reach};
use spirv_jit::{LaneMask, Program, Tier};

const LANES: usize = 16;

/// Bytes of the buffer, of workgroup memory, and of what device addresses lead to: the last word is
/// not wholly inside.
const SIZE_BYTES: u64 = 158;

/// Loads at `v30` and at offsets of 4, 8, 12 bytes behind it, `v31` to `v33`, in some space; of
/// global ones the addresses are `v40` and so on.
struct LoadCase {
    loads: &'static str,
    /// How many become of them.
    combined: usize,
    /// 32-bit results.
    results: &'static [&'static str],
    /// The unit of offsets: 64-bit scalars at device addresses are inside or outside as a whole.
    unit: u32,
}

const CASES: &[LoadCase] = &[
    LoadCase {
        loads: "v50: f32, v51: f32, v52: f32 = load.buffer v2, v30
            v53: i32 = load.buffer v2, v33",
        combined: 1,
        results: &["v50", "v51", "v52", "v53"],
        unit: 4,
    },
    LoadCase {
        loads: "v50: i32 = load.buffer v2, v32
            v51: f32 = load.buffer v2, v31
            v52: i32 = load.buffer v2, v30",
        combined: 1,
        results: &["v50", "v51", "v52"],
        unit: 4,
    },
    LoadCase {
        loads: "v50: i32 = load.buffer v2, v33
            v51: i32 = load.buffer v2, v31
            v52: i32 = load.buffer v2, v30",
        combined: 1,
        results: &["v50", "v51", "v52"],
        unit: 4,
    },
    LoadCase {
        loads: "v60: i64 = load.buffer v2, v32
            v61: i64 = load.buffer v2, v30
            v62: f32 = load.buffer v2, v31
            v50: i32, v51: i32 = unpack64 v60
            v52: i32, v53: i32 = unpack64 v61",
        combined: 2,
        results: &["v50", "v51", "v52", "v53", "v62"],
        unit: 4,
    },
    LoadCase {
        loads: "v50: f32 = load.shared v31
            v51: i32 = load.shared v30",
        combined: 1,
        results: &["v50", "v51"],
        unit: 4,
    },
    LoadCase {
        loads: "v50: f32 = load.global v41
            v51: i32 = load.global v40
            v52: f32 = load.global v43",
        combined: 1,
        results: &["v50", "v51", "v52"],
        unit: 4,
    },
    LoadCase {
        loads: "v50: f32 = load.global v42
            v60: i64 = load.global v40
            v51: i32 = load.global v43
            v52: i32, v53: i32 = unpack64 v60",
        combined: 1,
        results: &["v50", "v51", "v52", "v53"],
        unit: 16,
    },
];

fn module(case: &LoadCase) -> Module {
    let mut addresses = String::new();
    for (k, distance) in [0, 4, 8, 12].into_iter().enumerate() {
        let (narrow, wide) = (10 + k, 20 + k);
        let (offset, address) = (30 + k, 40 + k);
        addresses += &format!(
            "v{narrow}: i32 = const {distance}
            v{wide}: i64 = const {distance}
            v{offset}: i32 = iadd v0, v{narrow}
            v{address}: i64 = iadd v5, v{wide}\n"
        );
    }
    let text = format!(
        "module compute
        inputs local_invocation_index.0
        output_rows {}
        shared {SIZE_BYTES}
        func f0 {{
            v0: i32 = input[0]
            v1: i32 = const 0
            v2: descriptor = descriptor[set 0, first 0, count 1] v1
            v3: i64 = descriptor_address v2
            v4: i64 = uconvert v0
            v5: i64 = iadd v3, v4
            {addresses}
            {}
            end({})
        }}",
        case.results.len(),
        case.loads,
        case.results.join(", "),
    );
    let module = parse_module(&text).unwrap();
    verify(&module).unwrap();
    module
}

fn loads(module: &Module) -> usize {
    let mut count = 0;
    let body = &module.functions[0].body;
    body.visit_insts(&mut |inst| count += usize::from(matches!(inst.op, Op::Load(_))));
    count
}

/// Output words of some lanes by row, for records at their offsets.
fn run(tier: Tier, module: &Module, lanes: LaneMask, offsets: &[u32; LANES]) -> Vec<[u32; LANES]> {
    shaders::code_pages::allow_native_code();
    let program = Program::with_tier(module, tier).unwrap();
    let mut words: Vec<u64> = (1..=SIZE_BYTES.div_ceil(8))
        .map(|k| k.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 0x0100_0000_0100)
        .collect();
    let mut shared = words.clone();
    let address = words.as_mut_ptr() as u64;
    let entry = Descriptor {
        address,
        size_bytes: SIZE_BYTES,
        ..Descriptor::NULL
    };
    let mut environment = Environment {
        reach: Arc::new(Reach::new(vec![Range {
            start: address,
            size_bytes: SIZE_BYTES,
        }])),
        ..Environment::unbound()
    };
    environment.sets[0] = DescriptorSet {
        entries: &entry,
        count: 1,
        ..DescriptorSet::NONE
    };
    let mut state = vec![AlignedRow([0xdead_beef; LANES]); program.layout().rows];
    program.start(&mut state, lanes);
    state[program.layout().inputs].0 = *offsets;
    let mut wave = Wave {
        states: &mut [&mut state[..]],
        shared: &[shared.as_mut_ptr().cast()],
        is_whole: false,
        outputs_to: &[],
        environment: &environment,
    };
    // SAFETY: what the environment and `shared` name are the vectors above.
    let events = unsafe { program.run(&mut Frame::default(), &mut wave, &mut 1_000) };
    assert!(events.unwrap().iter().all(|event| event == Event::End));
    let io = program.layout().io;
    let row = |row: usize| -> [u32; LANES] {
        std::array::from_fn(|k| {
            if lanes.contains(k) {
                state[io + row].0[k]
            } else {
                0
            }
        })
    };
    (0..program.output_rows() as usize).map(row).collect()
}

#[test]
fn lanes_read_the_same_wherever_their_records_are() {
    let kinds: [fn(u32) -> u32; 6] = [
        |_| 2,
        |lane| lane % 7,
        |lane| lane,
        |lane| 42 - lane,
        |lane| lane * 37 % 16 + 25,
        |lane| lane.wrapping_sub(5),
    ];
    for case in CASES {
        let separate = module(case);
        let mut combined = separate.clone();
        run_pass("combine_loads", &mut combined);
        verify(&combined).unwrap();
        assert_eq!(loads(&combined), case.combined, "{}", case.loads);
        let mut some_partly_outside = false;
        for kind in kinds {
            let offsets = std::array::from_fn(|lane| kind(lane as u32).wrapping_mul(case.unit));
            for &tier in Tier::available() {
                for lanes in [LaneMask::ALL, LaneMask::from_bits(0x5a7e)] {
                    let expected = run(tier, &separate, lanes, &offsets);
                    let found = run(tier, &combined, lanes, &offsets);
                    assert_eq!(found, expected, "{tier:?} {offsets:?} {}", case.loads);
                    some_partly_outside |= (0..LANES).any(|lane| {
                        let zeros = expected.iter().filter(|row| row[lane] == 0).count();
                        zeros > 0 && zeros < expected.len()
                    });
                }
            }
        }
        assert!(some_partly_outside, "{}", case.loads);
    }
}
