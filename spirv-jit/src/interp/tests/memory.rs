//! Buffers, private and workgroup memory, atomics, subgroups.

use std::sync::Arc;

use lanes::LaneMask;

use super::{Bench, TierKind, on_tiers, outputs};
use crate::environment::{Descriptor, DescriptorSet};
use crate::reach::{Range, Reach};
use crate::state::{Event, SiteKind};

fn descriptor(data: &mut [u32], size_bytes: u64) -> Descriptor {
    Descriptor {
        address: data.as_mut_ptr() as u64,
        size_bytes,
        ..Descriptor::NULL
    }
}

#[test]
fn buffers_are_checked_per_scalar() {
    on_tiers(|tier| {
        let mut source: Vec<u32> = (0..8).map(|k| 100 + k).collect();
        let mut target = vec![7u32; 64];
        let entries = [
            descriptor(&mut source, 6 * 4),
            descriptor(&mut target, 40 * 4),
            Descriptor::NULL,
        ];
        let mut bench = Bench::new(
            "module compute
            inputs local_invocation_index.0
            output_rows 0
            func f0 {
                v0: i32 = const 0
                v1: descriptor = descriptor[set 2, first 0, count 1] v0
                v2: descriptor = descriptor[set 2, first 1, count 1] v0
                v3: i32 = input[0]
                v4: i32 = const 4
                v5: i32 = imul v3, v4
                v6: i32, v7: i32 = load.buffer v1, v5
                v8: i32 = iadd v6, v7
                store.buffer v2, v5, v8
                v9: i32 = const 1
                v10: descriptor = descriptor[set 2, first 0, count 1] v9
                v11: i32 = load.buffer v10, v0
                v12: i32 = const 128
                v13: i32 = iadd v12, v5
                store.buffer v2, v13, v11
                end
            }",
            tier,
            1,
        );
        bench.environment.sets[2] = DescriptorSet {
            entries: entries.as_ptr(),
            count: 3,
            ..DescriptorSet::NONE
        };
        bench.input(0, |lane| lane as u32);
        bench.run_to_end();
        let word = |k: usize| if k < 6 { 100 + k as u32 } else { 0 };
        for (k, &value) in target.iter().enumerate() {
            let expected = match k {
                0..16 => word(k) + word(k + 1),
                32..40 => 0,
                _ => 7,
            };
            assert_eq!(value, expected, "{tier:?} {k}");
        }
    });
}

#[test]
fn private_arrays_are_dynamic() {
    let out = outputs(
        "module closest_hit
        inputs payload.0
        output_rows 1
        func f0 {
            var0: 4 rows zero
            var1: 2 rows
            v0: i32 = input[0]
            v1: i32 = var.address[var0]
            v2: i32 = const 3
            v3: i32 = and v0, v2
            v4: i32 = iadd v1, v3
            store.private v4, v0
            v5: i32, v6: i32, v7: i32, v8: i32 = load.private v1
            v9: i32 = const 1000
            v10: i32 = load.private v9
            v11: i64 = pack64 v5, v6
            var.store[var1, 0] v11
            v12: i32 = var.address[var1]
            v13: i64 = load.private v12
            v14: i64 = var.load[var1, 0]
            v15: i64 = iadd v13, v14
            v16: i32, v17: i32 = unpack64 v15
            v18: i32 = iadd v16, v17
            v19: i32 = iadd v18, v7
            v20: i32 = iadd v19, v8
            v21: i32 = iadd v20, v10
            end(v21)
        }",
        |lane| lane as u32,
    );
    for (lane, &word) in out.iter().enumerate() {
        let x = lane as u32;
        assert_eq!(word, if x % 4 < 2 { 2 * x } else { x }, "lane {lane}");
    }
}

#[test]
fn workgroup_memory_and_barrier() {
    on_tiers(|tier| {
        let mut bench = Bench::new(
            "module compute
            inputs local_invocation_index.0
            output_rows 1
            local_size 64, 1, 1
            shared 256
            func f0 {
                v0: i32 = input[0]
                v1: i32 = const 2
                v2: i32 = shl v0, v1
                v3: i32 = imul v0, v0
                store.shared v2, v3
                v4: i32 = const 0
                v5: i32 = const 1
                v6: i32 = atomic.iadd.shared v4, v4
                barrier
                v7: i32 = const 252
                v8: i32 = isub v7, v2
                v9: i32 = load.shared v8
                v10: i32 = iadd v9, v0
                end(v10)
            }",
            tier,
            4,
        );
        bench.input(0, |lane| lane as u32);
        // Two waves reach the barrier one after the other, and go on as one.
        let event = bench.run_some(&[0, 2], &mut 0);
        assert_eq!(bench.site(event), SiteKind::Barrier);
        let event = bench.run_some(&[1, 3], &mut 0);
        assert_eq!(bench.site(event), SiteKind::Barrier);
        assert_eq!(bench.run(&mut 0), Event::End);
        for (lane, &word) in bench.io(0).iter().enumerate() {
            let other = 63 - lane as u32;
            assert_eq!(word, other * other + lane as u32, "{tier:?} lane {lane}");
        }
    });
}

/// Two workgroups of two subgroups in one wave: stores, loads at one address for all, atomics and
/// loads at an address for each lane.
const TWO_WORKGROUPS: &str = "module compute
    inputs local_invocation_index.0, workgroup_id.0
    output_rows 3
    local_size 32, 1, 1
    shared 136
    func f0 {
        v0: i32 = input[0]
        v1: i32 = input[1]
        v2: i32 = const 2
        v3: i32 = shl v0, v2
        v4: i32 = const 1000
        v5: i32 = imul v1, v4
        v6: i32 = iadd v5, v0
        store.shared v3, v6
        barrier
        v7: i32 = const 124
        v8: i32 = load.shared v7
        v9: i32 = isub v7, v3
        v10: i32 = load.shared v9
        v11: i32 = const 128
        v12: i32 = const 1
        v13: i32 = atomic.iadd.shared v11, v12
        barrier
        v14: i32 = load.shared v11
        end(v8, v10, v14)
    }";

fn check_two_workgroups(bench: &Bench) {
    let [last, reversed, counts] = [0, 1, 2].map(|row| bench.io(row));
    for lane in 0..64 {
        let (workgroup, index) = (lane as u32 / 32, lane as u32 % 32);
        assert_eq!(last[lane], workgroup * 1000 + 31);
        assert_eq!(reversed[lane], workgroup * 1000 + 31 - index);
        assert_eq!(counts[lane], 32);
    }
}

fn two_workgroups(tier: TierKind) -> Bench {
    let mut bench = Bench::new(TWO_WORKGROUPS, tier, 4);
    bench.of_workgroup = 2;
    bench.input(0, |lane| lane as u32 % 32);
    bench.input(1, |lane| lane as u32 / 32);
    bench
}

#[test]
fn each_subgroup_has_its_workgroups_memory() {
    on_tiers(|tier| {
        let mut bench = two_workgroups(tier);
        for _ in 0..2 {
            let event = bench.run(&mut 0);
            assert_eq!(bench.site(event), SiteKind::Barrier);
        }
        assert_eq!(bench.run(&mut 0), Event::End);
        check_two_workgroups(&bench);
    });
}

#[test]
fn a_whole_wave_passes_barriers_in_place() {
    on_tiers(|tier| {
        let mut bench = two_workgroups(tier);
        bench.is_whole = true;
        assert_eq!(bench.run(&mut 0), Event::End);
        check_two_workgroups(&bench);
        // A subgroup without lanes does not come to the barrier.
        let mut bench = two_workgroups(tier);
        bench.is_whole = true;
        (bench.program).start(&mut bench.states[3], LaneMask::NONE);
        for _ in 0..2 {
            let event = bench.run(&mut 0);
            assert_eq!(bench.site(event), SiteKind::Barrier);
            assert!(bench.event_masks()[3].is_empty());
        }
        assert_eq!(bench.run(&mut 0), Event::End);
    });
}

#[test]
fn atomics_go_in_lane_order() {
    on_tiers(|tier| {
        let mut data = vec![0u32; 8];
        data[1] = 1.5f32.to_bits();
        data[2] = 5;
        let entries = [descriptor(&mut data, 32)];
        let mut bench = Bench::new(
            "module compute
            inputs local_invocation_index.0
            output_rows 1
            func f0 {
                v0: i32 = const 0
                v1: descriptor = descriptor[set 0, first 0, count 1] v0
                v2: i32 = input[0]
                v3: i32 = const 1
                v4: i32 = and v2, v3
                v5: i1 = ieq v4, v3
                v6: f32 = const 0x3f000000
                v7: i32 = const 4
                v8: i32 = const 8
                v9: i32 = const 2
                if v5, L0 -> (v10: i32) {
                    v11: i32 = atomic.iadd.buffer v1, v0, v9
                    v12: f32 = atomic.fadd.buffer v1, v7, v6
                    v13: i32 = atomic.compare_exchange.buffer v1, v8, v2, v8
                    v14: i32 = atomic.umax.buffer v1, v7, v0
                    br L0(v11)
                } else { br L0(v3) }
                v15: i32 = const 30
                v16: i32 = atomic.iadd.buffer v1, v15, v9
                v17: i32 = iadd v10, v16
                end(v17)
            }",
            tier,
            2,
        );
        bench.environment.sets[0] = DescriptorSet {
            entries: entries.as_ptr(),
            count: 1,
            ..DescriptorSet::NONE
        };
        bench.input(0, |lane| lane as u32);
        bench.run_to_end();
        assert_eq!(data[0], 32);
        assert_eq!(f32::from_bits(data[1]), 1.5 + 16.0 * 0.5);
        assert_eq!(data[2], 5);
        assert_eq!(data[7], 0);
        for (lane, &word) in bench.io(0).iter().enumerate() {
            let expected = if lane % 2 == 1 { lane as u32 - 1 } else { 1 };
            assert_eq!(word, expected, "{tier:?} lane {lane}");
        }
    });
}

#[test]
fn subgroups_see_active_lanes_only() {
    let out = outputs(
        "module closest_hit
        inputs payload.0
        output_rows 1
        func f0 {
            v0: i32 = input[0]
            v1: i32 = const 3
            v2: i32 = urem v0, v1
            v3: i32 = const 0
            v4: i1 = ieq v2, v3
            if v4, L0 -> (v5: i32) {
                v6: i32 = subgroup.reduce[iadd, 16] v0
                v7: i32 = subgroup.exclusive_scan[iadd] v0
                v8: i32 = subgroup.broadcast_first v0
                v9: i1 = subgroup.elect
                v10: i32 = select v9, v1, v3
                v11: i32 = subgroup.ballot v4
                v12: i32 = iadd v6, v7
                v13: i32 = iadd v12, v8
                v14: i32 = iadd v13, v10
                v15: i32 = iadd v14, v11
                br L0(v15)
            } else {
                br L0(v3)
            }
            end(v5)
        }",
        |lane| lane as u32,
    );
    for (lane, &word) in out.iter().enumerate() {
        let start = lane & !15;
        let active: Vec<u32> = (start as u32..start as u32 + 16)
            .filter(|x| x % 3 == 0)
            .collect();
        let before: u32 = active.iter().filter(|&&x| x < lane as u32).sum();
        let ballot: u32 = active.iter().map(|x| 1 << (x % 16)).sum();
        let elected = if active[0] == lane as u32 { 3 } else { 0 };
        let total = active.iter().sum::<u32>() + before + active[0] + elected + ballot;
        let expected = if lane % 3 == 0 { total } else { 0 };
        assert_eq!(word, expected, "lane {lane}");
    }
}

#[test]
fn push_constants_are_uniform() {
    on_tiers(|tier| {
        let mut data = vec![11u32, 22, 33, 44];
        let mut bench = Bench::new(
            "module closest_hit
            inputs payload.0
            output_rows 1
            func f0 {
                v0: descriptor = push_constants
                v1: i32 = const 4
                v2: i32, v3: i32 = load.buffer v0, v1
                v4: i64 = load.buffer v0, v1
                v5: i64 = const 1
                v6: i64 = iadd v4, v5
                v7: i32, v8: i32 = unpack64 v6
                v9: i32 = iadd v2, v3
                v10: i32 = iadd v7, v8
                v11: i32 = uniform[0]
                v12: i32 = iadd v9, v10
                v13: i32 = iadd v12, v11
                v14: i32 = input[0]
                v15: i32 = iadd v13, v14
                end(v15)
            }",
            tier,
            2,
        );
        bench.environment.push_constants = descriptor(&mut data, 16);
        bench.environment.uniforms[0] = 1000;
        bench.input(0, |lane| lane as u32);
        bench.run_to_end();
        for (lane, &word) in bench.io(0).iter().enumerate() {
            assert_eq!(word, 1000 + 55 + 56 + lane as u32);
        }
    });
}

/// Offsets of sixteen lanes, the kinds that have code of their own first: the same, one behind
/// another, any.
fn offsets(kind: usize, size_bytes: u32) -> [u32; 16] {
    std::array::from_fn(|lane| {
        let lane = lane as u32;
        match kind {
            0 => 24,
            1 => 8 + lane * size_bytes,
            2 => 8 + lane * size_bytes + lane / 15,
            3 => 500 - 29 * lane,
            4 => lane * 37 % 16 * 3,
            5 => 520 + lane * size_bytes,
            6 => (u32::MAX - 20).wrapping_add(lane * size_bytes),
            7 => 8 + (lane % 8) * size_bytes,
            _ => lane * 31 * (lane % 2),
        }
    })
}

#[test]
fn loads_are_the_same_however_lanes_lie() {
    for (ty, size, slot) in [("i8", 1, 1), ("i16", 2, 1), ("i32", 4, 1), ("i64", 8, 2)] {
        for count in 1..=5 {
            for kind in 0..9 {
                for (space, exits) in [("buffer", false), ("global", false), ("buffer", true)] {
                    on_tiers(|tier| check_load(tier, (ty, size, slot), count, kind, space, exits));
                }
            }
        }
    }
}

/// Loads `count` scalars a lane; where `exits`, in every third lane only. Scalars of 64 bits come
/// out in halves.
fn check_load(
    tier: lanes::Tier,
    (ty, size, slot): (&str, u32, usize),
    count: usize,
    kind: usize,
    space: &str,
    exits: bool,
) {
    let mut bytes: Vec<u32> = (0..150u32)
        .map(|k| k.wrapping_mul(0x9e37_79b9) ^ 0x1234)
        .collect();
    let size_bytes = 4 * bytes.len() as u64 - 3;
    let mut target = vec![7u32; 16 * 10];
    let base = bytes.as_ptr() as u64;
    let names: Vec<String> = (0..count).map(|k| format!("v{}", 100 + k)).collect();
    let results: Vec<String> = names.iter().map(|name| format!("{name}: {ty}")).collect();
    let mut stores = String::new();
    let mut value = 200;
    for (k, name) in names.iter().enumerate() {
        let words: Vec<String> = match (slot, ty) {
            (2, _) => {
                stores += &format!("v{value}: i32, v{}: i32 = unpack64 {name}\n", value + 1);
                vec![format!("v{value}"), format!("v{}", value + 1)]
            }
            (_, "i32") => vec![name.clone()],
            _ => {
                stores += &format!("v{value}: i32 = uconvert {name}\n");
                vec![format!("v{value}")]
            }
        };
        value += 2;
        for (part, word) in words.iter().enumerate() {
            let row = k * slot + part;
            stores += &format!(
                "v{value}: i32 = const {}\nv{}: i32 = iadd v6, v{value}\nstore.buffer v2, v{}, {word}\n",
                row * 64,
                value + 1,
                value + 1
            );
            value += 2;
        }
    }
    let address = match space {
        "buffer" => "v1, v3",
        _ => "v9",
    };
    let leave = match exits {
        true => "v20: i32 = urem v4, v21\nv22: i1 = ieq v20, v0\nif v22, L0 { br L0 } else { end }",
        false => "",
    };
    let text = format!(
        "module compute
        inputs local_invocation_index.0, local_invocation_id.0
        output_rows 0
        func f0 {{
            v0: i32 = const 0
            v1: descriptor = descriptor[set 0, first 0, count 1] v0
            v2: descriptor = descriptor[set 0, first 1, count 1] v0
            v3: i32 = input[0]
            v4: i32 = input[1]
            v5: i32 = const 2
            v6: i32 = shl v4, v5
            v7: i64 = uconvert v3
            v8: i64 = const {base}
            v9: i64 = iadd v7, v8
            v21: i32 = const 3
            {leave}
            {} = load.{space} {address}
            {stores}
            end
        }}",
        results.join(", ")
    );
    let entries = [
        descriptor(&mut bytes, size_bytes),
        descriptor(&mut target, 4 * 160),
    ];
    let mut bench = Bench::new(&text, tier, 1);
    bench.environment.sets[0] = DescriptorSet {
        entries: entries.as_ptr(),
        count: 2,
        ..DescriptorSet::NONE
    };
    bench.environment.reach = Arc::new(Reach::new(vec![Range {
        start: base,
        size_bytes,
    }]));
    let places = offsets(kind, size * count as u32);
    bench.input(0, |lane| places[lane]);
    bench.input(1, |lane| lane as u32);
    bench.run_to_end();
    let memory: Vec<u8> = bytes.iter().flat_map(|word| word.to_le_bytes()).collect();
    for lane in 0..16 {
        for k in 0..count {
            let first = match space {
                "buffer" => places[lane].wrapping_add(k as u32 * size) as u64,
                _ => places[lane] as u64 + k as u64 * size as u64,
            };
            let is_inside = first + size as u64 <= size_bytes;
            for part in 0..slot {
                let mut word = [0; 4];
                let used = (size as usize).min(4);
                if is_inside {
                    let at = first as usize + part * 4;
                    word[..used].copy_from_slice(&memory[at..at + used]);
                }
                let expected = match exits && lane % 3 != 0 {
                    true => 7,
                    false => u32::from_le_bytes(word),
                };
                let found = target[(k * slot + part) * 16 + lane];
                assert_eq!(
                    found, expected,
                    "{tier:?} {ty} {count} {kind} {space} lane {lane}"
                );
            }
        }
    }
}

/// Offsets of sixteen lanes that store `bytes` bytes each without overlap: inside, across the end,
/// across 2³², descending, and every second one outside.
fn places_apart(kind: usize, bytes: u32, size_bytes: u32) -> [u32; 16] {
    std::array::from_fn(|lane| {
        let lane = lane as u32;
        match kind {
            0 => 8 + lane * bytes,
            1 => size_bytes - 7 * bytes - 3 + lane * bytes,
            2 => (u32::MAX - 5 * bytes).wrapping_add(lane * bytes),
            3 => (15 - lane) * (bytes + 1),
            _ => lane * bytes + lane % 2 * 5000,
        }
    })
}

#[test]
fn stores_are_the_same_however_lanes_lie() {
    for (ty, size) in [("i8", 1), ("i16", 2), ("i32", 4), ("i64", 8)] {
        for count in 1..=5 {
            for kind in 0..5 {
                for (space, exits) in [("buffer", false), ("global", false), ("buffer", true)] {
                    on_tiers(|tier| check_store(tier, (ty, size), count, kind, space, exits));
                }
            }
        }
    }
}

/// Stores `count` scalars a lane: the lane's number times 16, plus the scalar's number. With
/// `exits`, only every third lane stores. Some device addresses lead to a second range, or nowhere.
fn check_store(
    tier: lanes::Tier,
    (ty, size): (&str, usize),
    count: usize,
    kind: usize,
    space: &str,
    exits: bool,
) {
    // More than the ranges, so that stores past an end would be seen.
    let (mut near, far) = (vec![0xaaaa_aaaau32; 2000], vec![0xaaaa_aaaau32; 2000]);
    let size_bytes = 797;
    let mut values = String::new();
    let names: Vec<String> = (0..count).map(|k| format!("v{}", 100 + 4 * k)).collect();
    for (k, name) in names.iter().enumerate() {
        let at = 100 + 4 * k;
        values += &format!(
            "v{}: i32 = const {k}\nv{}: i32 = iadd v6, v{}\n",
            at + 1,
            at + 2,
            at + 1
        );
        values += &match ty {
            "i32" => format!("{name}: i32 = or v{}, v0\n", at + 2),
            _ => format!("{name}: {ty} = uconvert v{}\n", at + 2),
        };
    }
    let address = match space {
        "buffer" => "v1, v3",
        _ => "v9",
    };
    let leave = match exits {
        true => "v20: i32 = urem v4, v21\nv22: i1 = ieq v20, v0\nif v22, L0 { br L0 } else { end }",
        false => "",
    };
    let text = format!(
        "module compute
        inputs local_invocation_index.0, local_invocation_id.0, local_invocation_id.1
        output_rows 0
        func f0 {{
            v0: i32 = const 0
            v1: descriptor = descriptor[set 0, first 0, count 1] v0
            v3: i32 = input[0]
            v4: i32 = input[1]
            v5: i32 = const 4
            v6: i32 = shl v4, v5
            v8: i32 = input[2]
            v9: i64 = pack64 v3, v8
            v21: i32 = const 3
            {values}
            {leave}
            store.{space} {address}, {}
            end
        }}",
        names.join(", ")
    );
    let entry = descriptor(&mut near, size_bytes);
    let mut bench = Bench::new(&text, tier, 1);
    bench.environment.sets[0] = DescriptorSet {
        entries: &raw const entry,
        count: 1,
        ..DescriptorSet::NONE
    };
    let starts = [near.as_ptr() as u64, far.as_ptr() as u64];
    bench.environment.reach = Arc::new(Reach::new(
        starts
            .map(|start| Range { start, size_bytes })
            .into_iter()
            .collect(),
    ));
    let places = places_apart(kind, (size * count) as u32, size_bytes as u32);
    let addresses: Vec<u64> = (0..16)
        .map(|lane| match (space, lane % 5) {
            ("buffer", _) => places[lane] as u64,
            (_, 4) => starts[1] + places[lane] as u64,
            (_, 3) => places[lane] as u64 % 4096,
            _ => starts[0] + places[lane] as u64,
        })
        .collect();
    bench.input(0, |lane| addresses[lane] as u32);
    bench.input(1, |lane| lane as u32);
    bench.input(2, |lane| (addresses[lane] >> 32) as u32);
    bench.run_to_end();

    let mut expected = [vec![0xaa; 8000], vec![0xaa; 8000]];
    for lane in (0..16).filter(|lane| !exits || lane % 3 == 0) {
        for k in 0..count {
            let which = (space == "global" && lane % 5 == 4) as usize;
            let first = match space {
                "buffer" => places[lane].wrapping_add((k * size) as u32) as u64,
                _ if lane % 5 == 3 => continue,
                _ => places[lane] as u64 + (k * size) as u64,
            };
            if first + size as u64 <= size_bytes {
                let scalar = (lane * 16 + k) as u64;
                expected[which][first as usize..][..size]
                    .copy_from_slice(&scalar.to_le_bytes()[..size]);
            }
        }
    }
    for (given, expected) in [near, far].iter().zip(&expected) {
        let given: Vec<u8> = given.iter().flat_map(|word| word.to_le_bytes()).collect();
        assert_eq!(given, *expected, "{tier:?} {ty} {count} {kind} {space}");
    }
}
