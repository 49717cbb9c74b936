//! Loops in native code: memory that they load from, and fuel.

use effort::sparse::Sparse;

use crate::environment::Descriptor;
use crate::interp::tests::{Bench, on_tiers};
use crate::state::Event;
use lanes::Tier as TierKind;

fn is_native(bench: &Bench, tier: TierKind) -> bool {
    bench.program.native_loops() == (tier != TierKind::Portable) as usize
}

/// Offsets use all 32 bits, also of words that lie one behind another and of one word for all
/// lanes; the words of one load wrap behind the last one, and those that are not inside as a whole
/// are zero.
#[test]
fn loops_load_from_large_buffers() {
    const SIZE_BYTES: u64 = (1 << 32) - 6;
    let memory = Sparse::new(1 << 32);
    let places: [u32; 16] = [
        0,
        4,
        0x7fff_fff8,
        0x7fff_fffc,
        0x7fff_fffe,
        0x8000_0000,
        0x8000_0001,
        0xbfff_fff0,
        0xffff_fff0,
        0xffff_fff4,
        0xffff_fff6,
        0xffff_fff7,
        0xffff_fff8,
        0xffff_fffc,
        0xffff_ffff,
        0x1234_5678,
    ];
    // Words that lie one behind another: also where offsets change their sign, and behind the end.
    let run = |start: u32| std::array::from_fn(|lane| start.wrapping_add(4 * lane as u32));
    let starts = [0, 0x1234_5678, 0x7fff_ffe0, 0xffff_ffc0, 0xffff_ffe2];
    let all = || starts.map(run).into_iter().chain([places]);
    let bytes = |at: u64| (at as u32).wrapping_mul(0x9e37_79b9).to_le_bytes()[3];
    for place in all().flatten() {
        for at in place as u64 & !3..place as u64 + 12 {
            memory.write(at & 0xffff_ffff, &[bytes(at & 0xffff_ffff)]);
        }
    }
    let word = |at: u64| match at + 4 <= SIZE_BYTES {
        true => u32::from_le_bytes([at, at + 1, at + 2, at + 3].map(bytes)),
        false => 0,
    };
    on_tiers(|tier| {
        let mut bench = Bench::new(
            "module closest_hit
            inputs payload.0
            output_rows 3
            func f0 {
                v0: descriptor = push_constants
                v1: i32 = input[0]
                v2: i32 = const 0
                v3: i32 = const 1
                v4: i32 = const 3
                v20: i32 = const 2
                block L0 -> (v5: i32, v6: i32, v21: i32) {
                    loop L1 (v7: i32, v8: i32, v9: i32, v23: i32) = (v2, v2, v2, v2) {
                        v10: i1 = ult v7, v4
                        if v10, L2 {
                            br L2
                        } else {
                            br L0(v8, v9, v23)
                        }
                        v16: i32 = lshr v1, v20
                        v17: i32 = shl v16, v20
                        v11: i32 = load.buffer v0, v17
                        v24: i32, v12: i32 = load.buffer v0, v1
                        v25: i32 = shl v7, v20
                        v26: i32 = load.buffer v0, v25
                        v13: i32 = iadd v8, v11
                        v14: i32 = iadd v9, v12
                        v27: i32 = iadd v23, v26
                        v15: i32 = iadd v7, v3
                        br L1(v15, v13, v14, v27)
                    }
                    unreachable
                }
                end(v5, v6, v21)
            }",
            tier,
            1,
        );
        assert!(is_native(&bench, tier), "{tier:?}");
        bench.environment.push_constants = Descriptor {
            address: memory.as_mut_ptr() as u64,
            size_bytes: SIZE_BYTES,
            ..Descriptor::NULL
        };
        for places in all() {
            let states = bench.states.iter_mut();
            states.for_each(|state| bench.program.start(state, lanes::LaneMask::ALL));
            bench.input(0, |lane| places[lane]);
            bench.run_to_end();
            // The first load's offsets are those of whole words.
            for (row, (behind, bits)) in [(0, !3), (4, !0)].into_iter().enumerate() {
                for (&place, sum) in places.iter().zip(bench.io(row)) {
                    let at = (place & bits).wrapping_add(behind) as u64;
                    assert_eq!(sum, word(at).wrapping_mul(3), "{place:#x}, {tier:?}");
                }
            }
            let first = (0..3).fold(0u32, |sum, k| sum.wrapping_add(word(4 * k)));
            assert_eq!(bench.io(2), [first; 16], "{tier:?}");
        }
        // Memory of less than a word.
        bench.environment.push_constants.size_bytes = 3;
        let states = bench.states.iter_mut();
        states.for_each(|state| bench.program.start(state, lanes::LaneMask::ALL));
        bench.input(0, |_| 0);
        bench.run_to_end();
        for row in 0..3 {
            assert_eq!(bench.io(row), [0; 16], "{tier:?}");
        }
    });
}

/// A loop that no lane ever leaves comes back each time that its fuel is out, and so does one that
/// lanes leave late: with the same result as with fuel for all turns.
#[test]
fn loops_end_when_their_fuel_is_out() {
    let text = |bound: &str| {
        format!(
            "module closest_hit
            inputs payload.0
            output_rows 2
            func f0 {{
                v0: i32 = input[0]
                v1: i32 = const {bound}
                v2: i32 = const 1
                v3: i32 = umin v0, v1
                v4: i32 = const 5
                block L0 -> (v5: i32, v6: i32) {{
                    loop L1 (v7: i32, v8: i32) = (v3, v0) {{
                        v9: i32 = imul v8, v4
                        v10: i1 = ine v7, v1
                        if v10, L2 {{
                            br L2
                        }} else {{
                            br L0(v7, v9)
                        }}
                        v11: i32 = iadd v7, v2
                        br L1(v11, v9)
                    }}
                    unreachable
                }}
                end(v5, v6)
            }}"
        )
    };
    on_tiers(|tier| {
        let mut bench = Bench::new(&text("700"), tier, 3);
        assert!(is_native(&bench, tier), "{tier:?}");
        bench.input(0, |i| 13 * i as u32 + 1);
        let mut runs = 0;
        loop {
            let mut fuel = 20;
            match bench.run(&mut fuel) {
                Event::OutOfFuel => assert_eq!(fuel, 0, "{tier:?}"),
                Event::End => break,
                other => panic!("{other:?}"),
            }
            runs += 1;
        }
        // 20 turns of a wave each, or as many turns of single subgroups as that are.
        assert!((10..=700 / 10).contains(&runs), "{runs}, {tier:?}");
        assert_eq!(bench.io(0), [700; 48], "{tier:?}");
        for (i, given) in bench.io(1).into_iter().enumerate() {
            let first = 13 * i as u32 + 1;
            let expected = first.wrapping_mul(5u32.wrapping_pow(700 - first + 1));
            assert_eq!(given, expected, "{i}, {tier:?}");
        }

        // The counter stands still.
        let endless = text("700").replace("v2: i32 = const 1", "v2: i32 = const 0");
        let mut bench = Bench::new(&endless, tier, 2);
        assert!(is_native(&bench, tier), "{tier:?}");
        bench.input(0, |i| i as u32);
        for _ in 0..3 {
            let mut fuel = 1000;
            assert_eq!(bench.run(&mut fuel), Event::OutOfFuel, "{tier:?}");
        }
    });
}

/// Short loops that follow one load to the next are the interpreter's; where there is much else to
/// do in a turn, they are native code.
#[test]
fn short_loops_that_chase_loads_are_interpreted() {
    let text = |others: usize| {
        let more: String = (0..others)
            .map(|k| format!("v{}: i32 = imul v{}, v1\n", 30 + k + 1, 30 + k))
            .collect();
        format!(
            "module closest_hit
            inputs payload.0
            output_rows 1
            func f0 {{
                v0: descriptor = push_constants
                v1: i32 = input[0]
                v2: i32 = const 0
                v3: i32 = const 1
                v4: i32 = const 9
                v5: i32 = const 124
                block L0 -> (v6: i32) {{
                    loop L1 (v7: i32, v8: i32) = (v2, v1) {{
                        v9: i1 = ult v7, v4
                        if v9, L2 {{
                            br L2
                        }} else {{
                            br L0(v8)
                        }}
                        v10: i32 = and v8, v5
                        v11: i32 = load.buffer v0, v10
                        v30: i32 = iadd v11, v7
                        {more}
                        v12: i32 = iadd v7, v3
                        br L1(v12, v{})
                    }}
                    unreachable
                }}
                end(v6)
            }}",
            30 + others
        )
    };
    on_tiers(|tier| {
        let loops = |others| Bench::new(&text(others), tier, 1).program.native_loops();
        assert_eq!(loops(2), 0, "{tier:?}");
        assert_eq!(loops(16), (tier != TierKind::Portable) as usize, "{tier:?}");
    });
}

/// Values that a loop hands round: with some numbers of them, a few stay in rows, which are
/// written while others are still to be handed on.
#[test]
fn loops_hand_values_round() {
    let list = |from: usize, count: usize| {
        let names: Vec<String> = (from..from + count).map(|v| format!("v{v}")).collect();
        names.join(", ")
    };
    let text = |count: usize| {
        let last = 100 + count - 1;
        let typed: Vec<String> = (100..=last).map(|v| format!("v{v}: i32")).collect();
        let typed = typed.join(", ");
        let starts: String = (0..count)
            .map(|k| {
                format!(
                    "v{}: i32 = const {}\nv{}: i32 = iadd v0, v{}\n",
                    40 + k,
                    7 * k,
                    200 + k,
                    40 + k
                )
            })
            .collect();
        let results: Vec<String> = (300..300 + count).map(|v| format!("v{v}: i32")).collect();
        format!(
            "module closest_hit
            inputs payload.0, payload.1
            output_rows {count}
            func f0 {{
                v0: i32 = input[0]
                v1: i32 = input[1]
                v2: i32 = const 0
                v3: i32 = const 1
                {starts}
                block L0 -> ({}) {{
                    loop L1 (v4: i32, {typed}) = (v2, {}) {{
                        v5: i1 = ult v4, v1
                        if v5, L2 {{
                            br L2
                        }} else {{
                            br L0({})
                        }}
                        v6: i1 = ult v4, v3
                        if v6, L3 -> (v7: i32) {{
                            br L3(v4)
                        }} else {{
                            br L3(v2)
                        }}
                        if v6, L4 -> (v8: i32) {{
                            br L4(v7)
                        }} else {{
                            br L4(v2)
                        }}
                        v9: i32 = iadd v4, v3
                        v10: i32 = iadd v9, v8
                        v11: i32 = isub v10, v8
                        br L1(v11, {}, v100)
                    }}
                    unreachable
                }}
                end({})
            }}",
            results.join(", "),
            list(200, count),
            list(100, count),
            list(101, count - 1),
            list(300, count),
        )
    };
    on_tiers(|tier| {
        let mut native = 0;
        for count in 2..28 {
            let mut bench = Bench::new(&text(count), tier, 7);
            native += bench.program.native_loops();
            bench.input(0, |i| 1000 * i as u32);
            bench.input(1, |i| i as u32 % 9);
            bench.run_to_end();
            for row in 0..count {
                for (i, given) in bench.io(row).into_iter().enumerate() {
                    let from = (row + i % 9) % count;
                    let expected = 1000 * i as u32 + 7 * from as u32;
                    assert_eq!(given, expected, "{row} of {count}, lane {i}, {tier:?}");
                }
            }
        }
        assert!(
            tier == TierKind::Portable || native > 4,
            "{native}, {tier:?}"
        );
    });
}

/// A loop stores words in the order of turns and of lanes, of which each sees what others stored
/// before: one behind another, apart, across each other, at the ends of memory and outside of it.
#[test]
fn loops_store_words_in_order() {
    const SIZE_BYTES: u64 = (1 << 32) - 6;
    const TURNS: u32 = 5;
    /// Two take their turns together, one by itself.
    const LANES: usize = 3 * 16;
    let run = |start: u32, distance: u32| {
        let own = move |lane: u32| {
            distance
                .wrapping_mul(lane % 16)
                .wrapping_add(lane / 16 << 24)
        };
        std::array::from_fn::<u32, LANES, _>(|lane| start.wrapping_add(own(lane as u32)))
    };
    let places = [
        run(0x4000, 4),
        run(0x4001, 4),
        // From one end of memory to the other.
        run(0x7fff_ffe0, 4),
        run(0xffff_ffd0, 4),
        run(0x8000_0000, 3),
        run(0x1234_5678, 0),
        run(0xffff_fff0, 1),
        run(0x5000, 0x9e37_79b0),
        run(0x6100, 0xffff_fffc),
    ];
    on_tiers(|tier| {
        let memory = Sparse::new(1 << 32);
        let mut bench = Bench::new(
            "module closest_hit
            inputs payload.0, payload.1, payload.2
            output_rows 2
            func f0 {
                v0: descriptor = push_constants
                v1: i32 = input[0]
                v2: i32 = input[1]
                v3: i32 = input[2]
                v4: i32 = const 0
                v5: i32 = const 1
                v6: i32 = const 8
                v7: i32 = const 2
                v30: i32 = const 1073741823
                block L0 -> (v8: i32, v9: i32) {
                    loop L1 (v10: i32, v11: i32, v12: i32) = (v4, v4, v4) {
                        v13: i1 = ult v10, v2
                        if v13, L2 {
                            br L2
                        } else {
                            br L0(v11, v12)
                        }
                        v14: i32 = imul v10, v6
                        v15: i32 = iadd v1, v14
                        v16: i32 = imul v15, v3
                        v17: i32 = iadd v16, v10
                        store.buffer v0, v15, v17
                        v18: i32 = load.buffer v0, v1
                        v19: i32 = iadd v11, v18
                        v20: i32 = and v1, v30
                        v21: i32 = shl v20, v7
                        store.buffer v0, v21, v18
                        v22: i32 = load.buffer v0, v3
                        v23: i32 = iadd v12, v22
                        v24: i32 = iadd v10, v5
                        br L1(v24, v19, v23)
                    }
                    unreachable
                }
                end(v8, v9)
            }",
            tier,
            LANES / 16,
        );
        assert!(is_native(&bench, tier), "{tier:?}");
        for (k, places) in places.iter().enumerate() {
            for (size_bytes, fuel) in [(SIZE_BYTES, 1000), (SIZE_BYTES, 1), (3, 1000), (0, 1000)] {
                bench.environment.push_constants = Descriptor {
                    address: memory.as_mut_ptr() as u64,
                    size_bytes,
                    ..Descriptor::NULL
                };
                let other = |lane: usize| places[lane & !15 | k];
                let bound = |lane: usize| (lane as u32 * 7 + k as u32) % TURNS;
                let states = bench.states.iter_mut();
                states.for_each(|state| bench.program.start(state, lanes::LaneMask::ALL));
                bench.input(0, |lane| places[lane]);
                bench.input(1, bound);
                bench.input(2, other);
                let mut expected = Expected::new(&memory, size_bytes);
                let mut sums = [[0u32; LANES]; 2];
                for turn in 0..TURNS {
                    let lanes = || (0..LANES).filter(|&lane| turn < bound(lane));
                    for lane in lanes() {
                        let place = places[lane].wrapping_add(8 * turn);
                        let value = place.wrapping_mul(other(lane)).wrapping_add(turn);
                        expected.store(place, value);
                    }
                    let load = |lane| (lane, expected.load(places[lane]));
                    let loaded: Vec<(usize, u32)> = lanes().map(load).collect();
                    for &(lane, word) in &loaded {
                        sums[0][lane] = sums[0][lane].wrapping_add(word);
                        expected.store(places[lane] << 2, word);
                    }
                    for lane in lanes() {
                        let word = expected.load(other(lane));
                        sums[1][lane] = sums[1][lane].wrapping_add(word);
                    }
                }
                while bench.run(&mut fuel.clone()) == Event::OutOfFuel {}
                for (row, sums) in sums.iter().enumerate() {
                    assert_eq!(bench.io(row), sums, "{row}, {tier:?}, {places:x?}");
                }
                expected.check();
            }
        }
    });
}

/// Bytes that a loop is to have stored.
struct Expected<'m> {
    memory: &'m Sparse,
    size_bytes: u64,
    stored: std::collections::HashMap<u64, u8>,
}

impl Expected<'_> {
    fn new(memory: &Sparse, size_bytes: u64) -> Expected<'_> {
        Expected {
            memory,
            size_bytes,
            stored: Default::default(),
        }
    }

    fn is_inside(&self, place: u32) -> bool {
        u64::from(place) + 4 <= self.size_bytes
    }

    fn store(&mut self, place: u32, word: u32) {
        if self.is_inside(place) {
            self.stored
                .extend((u64::from(place)..).zip(word.to_le_bytes()));
        }
    }

    fn load(&self, place: u32) -> u32 {
        if !self.is_inside(place) {
            return 0;
        }
        let byte = |at: u64| match self.stored.get(&at) {
            Some(&byte) => byte,
            None => self.memory.read::<1>(at)[0],
        };
        let first = u64::from(place);
        u32::from_le_bytes([first, first + 1, first + 2, first + 3].map(byte))
    }

    fn check(&self) {
        for (&at, &byte) in &self.stored {
            assert_eq!(self.memory.read::<1>(at), [byte], "{at:#x}");
        }
    }
}
