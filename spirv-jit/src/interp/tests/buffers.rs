//! Loads and stores in buffers with offsets of 64 bits, against copies of single scalars.

use std::fmt::Write;

use effort::sparse::Sparse;

use super::numbers::Random;
use super::{Bench, on_tiers};
use crate::SUBGROUP_SIZE;
use crate::environment::{Descriptor, DescriptorSet};

/// Not a multiple of any scalar's size except one byte's.
const SIZE_BYTES: u64 = (9 << 30) - 5;

/// A program that copies so many scalars of a type from the offset in inputs 0 and 1 to that in
/// inputs 2 and 3, in lanes whose input 4 is not zero. Input 5 is the descriptor's number.
fn program(ty: &str, count: usize) -> String {
    let values: Vec<String> = (0..count).map(|k| format!("v{}", 20 + k)).collect();
    let results: Vec<String> = values
        .iter()
        .map(|value| format!("{value}: {ty}"))
        .collect();
    let mut text = String::from(
        "module compute
        inputs local_invocation_index.0, local_invocation_id.0, local_invocation_id.1, local_invocation_id.2, launch_id.0, launch_id.1
        output_rows 0
        func f0 {\n",
    );
    for input in 0..6 {
        writeln!(text, "v{input}: i32 = input[{input}]").unwrap();
    }
    writeln!(
        text,
        "v6: i64 = pack64 v0, v1
        v7: i64 = pack64 v2, v3
        v8: descriptor = descriptor[set 0, first 0, count 2] v5
        v9: i32 = const 0
        v10: i1 = ine v4, v9
        if v10, L0 {{
            {} = load.buffer64 v8, v6
            store.buffer64 v8, v7, {}
            br L0
        }} else {{
            br L0
        }}
        end
        }}",
        results.join(", "),
        values.join(", ")
    )
    .unwrap();
    text
}

/// From where to where a lane copies, in which buffer, and whether it does.
type Copies = [(u64, u64, u32, bool); SUBGROUP_SIZE];

fn run(bench: &mut Bench, copies: &Copies) {
    for state in &mut bench.states {
        bench.program.start(state, lanes::LaneMask::ALL);
    }
    bench.input(0, |k| copies[k].0 as u32);
    bench.input(1, |k| (copies[k].0 >> 32) as u32);
    bench.input(2, |k| copies[k].1 as u32);
    bench.input(3, |k| (copies[k].1 >> 32) as u32);
    bench.input(4, |k| copies[k].3.into());
    bench.input(5, |k| copies[k].2);
    bench.run_to_end();
}

#[test]
fn offsets_have_64_bits() {
    const SMALL_BYTES: u64 = 1 << 12;
    let scalars = [("i8", 1), ("i16", 2), ("i32", 4), ("i64", 8)];
    for ((ty, size), count) in scalars
        .into_iter()
        .flat_map(|it| [1, 2, 3, 4, 7].map(|k| (it, k)))
    {
        let text = program(ty, count);
        on_tiers(|tier| {
            let memories = [Sparse::new(SIZE_BYTES), Sparse::new(SMALL_BYTES)];
            let entries = [0, 1].map(|k| Descriptor {
                address: memories[k].as_mut_ptr() as u64,
                size_bytes: memories[k].size_bytes(),
                ..Descriptor::NULL
            });
            let mut bench = Bench::new(&text, tier, 1);
            bench.environment.sets[0] = DescriptorSet {
                entries: entries.as_ptr(),
                count: 2,
                ..DescriptorSet::NONE
            };
            let mut random = Random(11);
            let total = size * count as u64;
            // Where lanes of all layouts copy from, and where they copy to: apart in any case.
            let starts = [
                0,
                1 << 31,
                (1 << 32) - 8 * total,
                1 << 32,
                5 << 30,
                SIZE_BYTES - 16 * total,
                SIZE_BYTES - total / 2,
                SIZE_BYTES,
                1 << 40,
                0u64.wrapping_sub(total),
                0u64.wrapping_sub(total / 2),
                0u64.wrapping_sub(8 * total),
            ];
            for (round, start) in (0..).zip(starts) {
                for layout in 0..4 {
                    let copies: Copies = std::array::from_fn(|k| {
                        let lane = k as u64 * total;
                        let from = match layout {
                            0 => start,
                            1 => start.wrapping_add(lane),
                            2 => start.wrapping_add(random.below(64) * size),
                            _ => starts[k % starts.len()].wrapping_add(lane),
                        };
                        let to = (6 << 30) + (round as u64 * 4 + layout) * 4096 + lane;
                        let is_small = layout == 3 && k % 3 == 0;
                        let to = if is_small { lane } else { to };
                        (
                            from,
                            to,
                            is_small.into(),
                            layout == 1 || random.below(3) > 0,
                        )
                    });
                    // The scalars that they copy.
                    let places =
                        |from: u64| (0..count as u64).map(move |j| from.wrapping_add(j * size));
                    let is_inside = |memory: &Sparse, at: u64| {
                        at.checked_add(size)
                            .is_some_and(|end| end <= memory.size_bytes())
                    };
                    for &(from, _, buffer, _) in &copies {
                        let memory = &memories[buffer as usize];
                        for at in places(from).filter(|&at| is_inside(memory, at)) {
                            let bytes = random.next().to_le_bytes();
                            memory.write(at, &bytes[..size as usize]);
                        }
                    }
                    let read = |memory: &Sparse, at: u64| -> Vec<u8> {
                        (0..size).map(|k| memory.read::<1>(at + k)[0]).collect()
                    };
                    for &(_, to, buffer, _) in &copies {
                        for at in places(to) {
                            memories[buffer as usize].write(at, &[0xee; 8][..size as usize]);
                        }
                    }
                    // In the small buffer lanes copy from where others copy to; loads come
                    // first.
                    let sources: Vec<Vec<Vec<u8>>> = copies
                        .iter()
                        .map(|&(from, _, buffer, _)| {
                            let memory = &memories[buffer as usize];
                            let at = places(from);
                            at.map(|at| match is_inside(memory, at) {
                                true => read(memory, at),
                                false => vec![0; size as usize],
                            })
                            .collect()
                        })
                        .collect();
                    run(&mut bench, &copies);
                    for (lane, &(from, to, buffer, is_active)) in copies.iter().enumerate() {
                        for (j, at) in places(to).enumerate() {
                            let stored = read(&memories[buffer as usize], at);
                            let wanted = match is_active {
                                true => sources[lane][j].clone(),
                                false => vec![0xee; size as usize],
                            };
                            let what = format!("{tier:?} {ty} × {count}, lane {lane}");
                            assert_eq!(stored, wanted, "{what}: {from:#x} to {to:#x}");
                        }
                    }
                }
            }
        });
    }
}

/// `buffer_size` of either width.
#[test]
fn sizes_have_32_or_64_bits() {
    for (size_bytes, saturated) in [
        (20, 20),
        ((5 << 32) | 7, u32::MAX),
        (u32::MAX.into(), u32::MAX),
    ] {
        let text = "module compute
            output_rows 3
            func f0 {
                v0: i32 = const 0
                v1: descriptor = descriptor[set 0, first 0, count 1] v0
                v2: i32 = buffer_size v1
                v3: i64 = buffer_size v1
                v4: i32, v5: i32 = unpack64 v3
                end(v2, v4, v5)
            }";
        on_tiers(|tier| {
            let mut bench = Bench::new(text, tier, 2);
            let entry = Descriptor {
                address: 1 << 20,
                size_bytes,
                ..Descriptor::NULL
            };
            bench.environment.sets[0] = DescriptorSet {
                entries: &raw const entry,
                count: 1,
                ..DescriptorSet::NONE
            };
            bench.run_to_end();
            assert_eq!(bench.io(0), [saturated; 32], "{tier:?}");
            assert_eq!(bench.io(1), [size_bytes as u32; 32], "{tier:?}");
            assert_eq!(bench.io(2), [(size_bytes >> 32) as u32; 32], "{tier:?}");
        });
    }
}
