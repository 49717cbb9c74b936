//! Suspending and resuming: in loops, in calls, in waves that change, and for lack of fuel.

use lanes::{AlignedRow, LaneMask, Tier as TierKind};

use super::{Bench, on_tiers};
use crate::environment::Environment;
use crate::interp::Frame;
use crate::ir::op::Trace;
use crate::ir::text::parse_module;
use crate::ir::verify::verify;
use crate::program::Program;
use crate::state::{Event, IO_DATA_ROW, SiteKind, Wave};

const TRACED: SiteKind = SiteKind::TraceRay {
    trace: Trace::new(false, false),
    payload_words: 2,
};

/// A callable is executed in a loop, whose trip count differs by lane; values live across it in
/// every way.
const LOOP: &str = "module closest_hit
    inputs payload.0
    output_rows 1
    func f0 {
        v0: i32 = input[0]
        v1: i32 = const 1
        v2: i32 = const 0
        v3: i64 = const 0x100000001
        v30: i32 = const 3
        v31: i32 = and v0, v30
        block L0 -> (v4: i32, v5: i64) {
            loop L1 (v6: i32, v7: i32, v8: i64) = (v2, v0, v3) {
                v9: i1 = ule v31, v6
                if v9, L2 { br L0(v7, v8) } else { br L2 }
                v10: i32 = imul v7, v0
                v11: i32 = execute_callable v6, v7
                v12: i32 = iadd v11, v10
                v13: i64 = iadd v8, v3
                v14: i32 = iadd v6, v1
                br L1(v14, v12, v13)
            }
            unreachable
        }
        v15: i32, v16: i32 = unpack64 v5
        v17: i32 = imul v15, v16
        v18: i32 = iadd v4, v17
        end(v18)
    }";

fn expected_loop(x: u32) -> u32 {
    let (mut sum, mut count) = (x, 1u32);
    for index in 0..x & 3 {
        let product = sum.wrapping_mul(x);
        // The callable adds its index and 5.
        sum = (sum + index + 5).wrapping_add(product);
        count += 1;
    }
    sum.wrapping_add(count * count)
}

#[test]
fn yields_in_a_loop() {
    on_tiers(|tier| {
        let mut bench = Bench::new(LOOP, tier, 3);
        bench.input(0, |lane| lane as u32);
        let mut yields = 0;
        loop {
            // No fuel at all: every back-edge suspends.
            match bench.run(&mut 0) {
                Event::End => break,
                Event::OutOfFuel => {}
                event => {
                    assert_eq!(
                        bench.site(event),
                        SiteKind::ExecuteCallable { data_words: 1 }
                    );
                    yields += 1;
                    let index = bench.io(0);
                    bench.answer(IO_DATA_ROW, |lane, word| word + index[lane] + 5);
                }
            }
        }
        assert_eq!(yields, 3);
        for (lane, &word) in bench.io(0).iter().enumerate() {
            assert_eq!(word, expected_loop(lane as u32), "{tier:?} lane {lane}");
        }
    });
}

/// Subgroups that yield alone are resumed together with others at the same point, in frames that
/// ran other things meanwhile.
#[test]
fn waves_are_regrouped() {
    on_tiers(|tier| {
        let mut bench = Bench::new(LOOP, tier, 4);
        bench.input(0, |lane| lane as u32);
        let mut done = [false; 4];
        let mut round = 0;
        while done.contains(&false) {
            round += 1;
            let first = (0..4).map(|k| (k + round) % 4).find(|&k| !done[k]).unwrap();
            let point = bench.program.resume_point(&bench.states[first]);
            let group: Vec<usize> = (0..4)
                .filter(|&k| !done[k] && bench.program.resume_point(&bench.states[k]) == point)
                .filter(|&k| k == first || round % 3 != 0)
                .collect();
            match bench.run_some(&group, &mut 1) {
                Event::End => group.iter().for_each(|&k| done[k] = true),
                Event::OutOfFuel => {}
                Event::Yield(_) => {
                    let layout = bench.program.layout();
                    for &k in &group {
                        for lane in bench.program.event_mask(&bench.states[k]) {
                            let index = bench.states[k][layout.io].0[lane];
                            bench.states[k][layout.io + IO_DATA_ROW].0[lane] += index + 5;
                        }
                    }
                }
            }
        }
        for (lane, &word) in bench.io(0).iter().enumerate() {
            assert_eq!(word, expected_loop(lane as u32), "{tier:?} lane {lane}");
        }
    });
}

/// A yield in a function that is called along three paths, one of them nested, from inside
/// constructs.
#[test]
fn yields_in_calls() {
    on_tiers(|tier| {
        let mut bench = Bench::new(
            "module closest_hit
            inputs payload.0
            output_rows 1
            func f0 {
                v0: i32 = input[0]
                v1: i32 = const 1
                v2: i32 = and v0, v1
                v3: i1 = ieq v2, v1
                if v3, L0 -> (v4: i32) {
                    v5: i32 = call[f1] v0
                    v6: i32 = iadd v5, v0
                    br L0(v6)
                } else {
                    v7: i32 = call[f2] v0
                    br L0(v7)
                }
                v8: i32 = call[f1] v4
                end(v8)
            }
            func f1 (v0: i32) -> (i32) {
                var0: 1 rows zero
                v1: i32 = var.load[var0, 0]
                v2: i32 = const 10
                v3: i1 = ult v0, v2
                var.store[var0, 0] v2
                if v3, L0 -> (v4: i32) {
                    v5: i32 = execute_callable v0, v0
                    v6: i32 = iadd v5, v0
                    v7: i32 = var.load[var0, 0]
                    v8: i32 = iadd v6, v7
                    br L0(v8)
                } else {
                    br L0(v0)
                }
                v9: i32 = iadd v4, v1
                return(v9)
            }
            func f2 (v0: i32) -> (i32) {
                v1: i32 = const 2
                v2: i32 = imul v0, v1
                v3: i32 = call[f1] v2
                v4: i32 = iadd v3, v0
                return(v4)
            }",
            tier,
            2,
        );
        bench.input(0, |lane| lane as u32);
        let mut points = Vec::new();
        loop {
            // No fuel at all: every call suspends.
            match bench.run(&mut 0) {
                Event::End => break,
                Event::OutOfFuel => {}
                event => {
                    assert_eq!(
                        bench.site(event),
                        SiteKind::ExecuteCallable { data_words: 1 }
                    );
                    points.push(bench.program.resume_point(&bench.states[0]));
                    bench.answer(IO_DATA_ROW, |_, word| word * 100);
                }
            }
        }
        let f1 = |x: u32| if x < 10 { x * 101 + 10 } else { x };
        for (lane, &word) in bench.io(0).iter().enumerate() {
            let x = lane as u32;
            let inner = if x % 2 == 1 { f1(x) + x } else { f1(2 * x) + x };
            assert_eq!(word, f1(inner), "{tier:?} lane {lane}");
        }
        // Three call paths to one yield are three points (the third call yields in no lane, as all
        // values are 10 or more).
        points.dedup();
        assert_eq!(points.len(), 2);
    });
}

#[test]
fn reported_hits_may_end_the_invocation() {
    on_tiers(|tier| {
        let mut bench = Bench::new(
            "module intersection
            inputs primitive_id.0
            output_rows 0
            func f0 {
                v0: i32 = input[0]
                v1: f32 = uto_f v0
                v2: i1 = report_intersection v1, v0, v0
                if v2, L0 { br L0 } else {
                    v3: f32 = fadd v1, v1
                    v4: i1 = report_intersection v3, v0, v0
                    br L0
                }
                v5: i1 = report_intersection v1, v0, v0
                end
            }",
            tier,
            1,
        );
        bench.input(0, |lane| lane as u32);
        let event = bench.run(&mut 0);
        assert_eq!(
            bench.site(event),
            SiteKind::ReportIntersection { attribute_words: 1 }
        );
        assert_eq!(bench.event_masks(), [LaneMask::ALL]);
        assert_eq!(bench.io(0)[3], 3f32.to_bits());
        bench.answer(0, |lane, _| lane as u32 % 3);
        assert!(matches!(bench.run(&mut 0), Event::Yield(_)));
        let of = |remainder: usize| LaneMask::from_fn(|k| k % 3 == remainder);
        assert_eq!(bench.event_masks(), [of(0)]);
        assert_eq!(bench.io(0)[3], 6f32.to_bits());
        bench.answer(0, |_, _| 1);
        assert!(matches!(bench.run(&mut 0), Event::Yield(_)));
        assert_eq!(bench.event_masks(), [of(0) | of(1)]);
        bench.answer(0, |_, _| 2);
        assert_eq!(bench.run(&mut 0), Event::End);
    });
}

#[test]
fn rays_carry_their_operands() {
    on_tiers(|tier| {
        let text = "module ray_generation
            inputs launch_id.0
            output_rows 0
            func f0 {
                v0: i32 = input[0]
                v1: i32 = const 1
                v2: i32 = const 2
                v3: f32 = uto_f v0
                v4: i32, v5: f32 = trace_ray v0, v1, v2, v1, v2, v1, v2, v3, v3, v3, v3, v3, v3, v3, v3, v0, v3
                v6: i32 = fto_u v5
                v7: i32 = iadd v4, v6
                v8: i32, v9: f32 = trace_ray v7, v1, v2, v1, v2, v1, v2, v3, v3, v3, v3, v3, v3, v3, v3, v7, v3
                end
            }";
        let mut bench = Bench::new(text, tier, 2);
        bench.input(0, |lane| lane as u32);
        let event = bench.run(&mut 0);
        assert_eq!(bench.site(event), TRACED);
        assert_eq!(bench.io(2)[20], 2);
        assert_eq!(bench.io(14)[20], 20f32.to_bits());
        assert_eq!(bench.io(IO_DATA_ROW)[20], 20);
        bench.answer(IO_DATA_ROW, |_, word| word + 1);
        bench.answer(IO_DATA_ROW + 1, |_, _| 7f32.to_bits());
        let event = bench.run(&mut 0);
        assert_eq!(bench.site(event), TRACED);
        assert_eq!(bench.io(0)[20], 28);
        assert_eq!(bench.run(&mut 0), Event::End);
    });
}

/// A ray generation shader with `inputs` input rows, whose rays' flags are `flags` plus a number of
/// the environment's.
fn ray_generation(inputs: usize, flags: u32) -> Program {
    let rows = vec!["launch_id.0"; inputs].join(", ");
    let text = format!(
        "module ray_generation
        inputs {rows}
        output_rows 0
        func f0 {{
            v0: i32 = input[{}]
            v1: i32 = uniform[0]
            v2: i32 = const {flags}
            v3: i32 = iadd v1, v2
            v4: f32 = const 0x3f800000
            v5: f32 = uto_f v0
            v6: i32 = trace_ray v1, v1, v3, v2, v0, v2, v2, v4, v4, v5, v4, v4, v4, v5, v4, v2
            v7: i32 = trace_ray v2, v1, v1, v2, v0, v2, v6, v4, v4, v5, v4, v4, v4, v5, v4, v3
            end
        }}",
        inputs - 1
    );
    let module = parse_module(&text).unwrap();
    verify(&module).unwrap();
    Program::with_tier(&module, TierKind::best()).unwrap()
}

/// Operands that are uniform in a dispatch are right in all lanes of states that are used again: by
/// their program with other lanes, by another one, in another environment.
#[test]
fn uniform_operands_of_traces_are_right_in_states_used_again() {
    const STATES: usize = 3;
    let flags = [100, 5000];
    let programs = [ray_generation(1, flags[0]), ray_generation(4, flags[1])];
    let rows = programs
        .iter()
        .map(|program| program.layout().rows)
        .max()
        .unwrap();
    let mut states = vec![vec![AlignedRow([0xdead_beef; 16]); rows]; STATES];
    let mut frames = [Frame::default(), Frame::default()];
    let environment = |number: u32| {
        let mut environment = Environment::unbound();
        environment.uniforms[0] = number;
        environment
    };
    let environments = [environment(7), environment(40)];
    let mut random = fastrand::Rng::with_seed(5);
    for _ in 0..500 {
        let (p, e) = (random.usize(..2), random.usize(..2));
        let (program, environment) = (&programs[p], &environments[e]);
        let layout = program.layout();
        let states = &mut states[..random.usize(1..=STATES)];
        for state in states.iter_mut() {
            let lanes = match random.bool() {
                true => LaneMask::ALL,
                false => LaneMask::from_bits(random.u16(..)),
            };
            program.start(state, lanes);
            for row in &mut state[layout.inputs..layout.io] {
                row.0 = std::array::from_fn(|lane| lane as u32 + 1);
            }
        }
        for turn in 0..3 {
            let mut wave: Vec<&mut [AlignedRow]> =
                states.iter_mut().map(|state| &mut state[..]).collect();
            let mut wave = Wave {
                states: &mut wave,
                shared: &[],
                is_whole: false,
                outputs_to: &[],
                environment,
            };
            // SAFETY: the environment names no memory.
            unsafe { program.run(&mut frames[e], &mut wave, &mut 1000) }.unwrap();
            let (number, flags) = (environment.uniforms[0], flags[p]);
            for state in states.iter_mut().filter(|_| turn < 2) {
                for lane in program.event_mask(state) {
                    let x = lane as u32 + 1;
                    let io = |row: usize| state[layout.io + row].0[lane];
                    let (one, float) = (1f32.to_bits(), (x as f32).to_bits());
                    let ray = [one, one, float, one, one, one, float, one];
                    let words = match turn {
                        0 => [number, number, number + flags, flags, x, flags, flags],
                        _ => [flags, number, number, flags, x, flags, 3 * flags],
                    };
                    let payload = [flags, number + flags][turn];
                    let rows = words.into_iter().chain(ray).chain([payload]);
                    let places = (0..15).chain([IO_DATA_ROW]);
                    for (place, word) in places.zip(rows) {
                        assert_eq!(io(place), word, "row {place}, lane {lane}, trace {turn}");
                    }
                    state[layout.io + IO_DATA_ROW].0[lane] *= 3;
                }
            }
        }
    }
}

/// Outputs go to other rows than a state's, in the lanes that end: there at once where some end
/// early.
#[test]
fn outputs_go_elsewhere() {
    let text = "module closest_hit
        inputs payload.0, payload.1
        output_rows 2
        func f0 {
            v0: i32 = input[0]
            v1: i32 = input[1]
            v2: i32 = const 1
            v3: i32 = and v0, v2
            v4: i1 = ieq v3, v2
            if v4, L0 { end(v1, v0) } else { br L0 }
            v5: i32 = execute_callable v0, v1
            end(v0, v5)
        }";
    on_tiers(|tier| {
        let mut bench = Bench::new(text, tier, 3);
        bench.input(0, |lane| lane as u32);
        bench.input(1, |lane| 1000 + lane as u32);
        let lanes = LaneMask::from_bits(0x7ff7);
        for state in &mut bench.states {
            bench.program.start_without_outputs(state, lanes);
        }
        bench.input(0, |lane| lane as u32);
        bench.input(1, |lane| 1000 + lane as u32);
        let mut taken = [[AlignedRow([77; 16]); 2]; 2];
        let [first, second] = &mut taken;
        // The middle one keeps its own.
        let outputs_to = [
            first.as_mut_ptr(),
            std::ptr::null_mut(),
            second.as_mut_ptr(),
        ];
        for turn in 0..2 {
            let mut states: Vec<&mut [AlignedRow]> = bench
                .states
                .iter_mut()
                .map(|state| &mut state[..])
                .collect();
            let mut wave = Wave {
                states: &mut states,
                shared: &[],
                is_whole: false,
                outputs_to: &outputs_to,
                environment: &bench.environment,
            };
            // SAFETY: the environment names no memory; there are two rows for two outputs.
            let events = unsafe { bench.program.run(&mut bench.frame, &mut wave, &mut 1000) };
            assert_eq!(events.unwrap().all() == Event::End, turn == 1);
            if turn == 0 {
                bench.answer(IO_DATA_ROW, |_, word| word + 5);
            }
        }
        let own = bench.program.layout().io;
        let own = [0, 1].map(|row| bench.states[1][own + row]);
        for (s, rows) in [taken[0], own, taken[1]].iter().enumerate() {
            for lane in 0..16 {
                let (x, y) = ((16 * s + lane) as u32, (1000 + 16 * s + lane) as u32);
                let expected = match (lanes.contains(lane), x % 2) {
                    (false, _) if s == 1 => continue,
                    (false, _) => [77, 77],
                    (true, 1) => [y, x],
                    (true, _) => [x, y + 5],
                };
                assert_eq!([rows[0].0[lane], rows[1].0[lane]], expected, "{s}, {lane}");
            }
        }
    });
}
