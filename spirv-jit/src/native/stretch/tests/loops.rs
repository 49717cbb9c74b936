//! Instructions of loops: the memory that they touch, and gathers.

use super::*;
use crate::native::WORKGROUP;

/// Loops touch what stretches do, and besides: masks of lanes, what they are given, and the words
/// that they gather at `rbx`. Only their first and last instructions touch the stack.
#[test]
fn memory_of_loops_is_at_the_pointers_that_code_was_given() {
    use iced_x86::Register as R;
    for (encoding, is_paired, subgroups) in [
        (Encoding::Vex, false, 1),
        (Encoding::Vex, true, 1),
        (Encoding::Vex, true, 2),
        (Encoding::Evex, false, 1),
        (Encoding::Evex, false, 2),
        (Encoding::Evex, false, 4),
    ] {
        let mut turns = Turns::new(encoding, is_paired, subgroups);
        let at = |value: u32, ty| place(value, ty, ValueRow::Frame(2 * value as usize));
        let (counter, sum) = (at(0, Type::I32), at(1, Type::I64));
        for copy in 0..turns.copies() {
            let same = [Sameness::Nowhere, Sameness::Subgroup][copy % 2];
            let lanes = turns.begin(copy, &[(counter, Sameness::Nowhere), (sum, same)]);
            let (less, word, wide) = (at(2, Type::I1), at(3, Type::I32), at(4, Type::I64));
            let bound = at(5, Type::I32);
            let operation = |turns: &mut Turns, op: Op, from: &[IrOperand], to: IrOperand| {
                let written = turns.perform(&[to.value], Sameness::Nowhere, |stretch| {
                    stretch.perform(&op, from, &[to]) && {
                        stretch.end_operation();
                        true
                    }
                });
                written.unwrap();
            };
            let stop = place(9, Type::I1, ValueRow::Uniform(3));
            let taken = [(sum, ValueRow::Frame(22)), (bound, ValueRow::Frame(24))];
            let leaves = turns.leave_together(lanes, (&stop, true), &taken);
            assert!(leaves);
            operation(&mut turns, Op::ULt, &[counter, bound], less);
            let [stay, go] = turns.split(lanes, &less).unwrap();
            turns.leave(go, &sum, ValueRow::Frame(20));
            let place = (&counter, 4);
            turns.load(stay, 3, place, &[Some(word)]).unwrap();
            turns
                .load_at_one_place(2, (&bound, false), &[Some(at(6, Type::I32))])
                .unwrap();
            operation(&mut turns, Op::UConvert, &[word], wide);
            if is_paired || encoding == Encoding::Evex {
                let rows = (PrivateRow::Apart(word), 5);
                turns.store_private(stay, rows, &[word]).unwrap();
                turns.store(stay, 4, (&counter, 4), &word).unwrap();
                let more = [Some(at(7, Type::I32)), None, Some(at(8, Type::F32))];
                turns
                    .load_at_one_place(WORKGROUP, (&bound, false), &more)
                    .unwrap();
            }
            let ends = [turns.only(&word), turns.only(&wide)];
            turns.end(stay, &ends);
        }
        let copies = turns.copies();
        let all = function(&turns.assemble(1).unwrap());
        let end = all.iter().position(|(_, text)| text == "ret").unwrap();
        let pointers = [
            R::RDI,
            R::RSI,
            R::R8,
            R::R9,
            R::RAX,
            R::R10,
            R::R13,
            R::R14,
            R::RBP,
        ];
        let frames = [
            "lea r8,[rdi+rcx]",
            "lea r9,[rdi+rcx*2]",
            "lea rax,[r8+rcx*2]",
        ];
        let next = [
            "lea rdi,[rdi+rcx]",
            "lea rdi,[rdi+rcx*2]",
            "lea rdi,[rdi+rcx*4]",
        ];
        let is_frame = |text: &str| frames.contains(&text) || next.contains(&text);
        let frames_written: Vec<&str> = (all[..end].iter())
            .map(|(_, text)| &text[..])
            .filter(|text| is_frame(text))
            .collect();
        let expected = (frames[..subgroups - 1].iter()).chain([&next[subgroups.ilog2() as usize]]);
        assert_eq!(frames_written, expected.copied().collect::<Vec<_>>());
        let mut gathers = 0;
        // The first and the last instructions are of the stack.
        for (instruction, text) in &all[7..end] {
            let is_gather = text.starts_with("vpgatherdd");
            gathers += is_gather as usize;
            let has_memory =
                (0..instruction.op_count()).any(|k| instruction.op_kind(k) == OpKind::Memory);
            // The address of a lane of a row, or of a word of a region or a private row.
            let is_lane = text.starts_with("lea rbx,[") && text.contains("+rbx")
                || ["[r13+rax]", "[r13+rbx]", "[r13+r9]"]
                    .iter()
                    .any(|at| text.contains(at));
            if has_memory && !is_frame(text) && !is_lane {
                let base = instruction.memory_base();
                assert!(
                    pointers.contains(&base) && instruction.memory_index() == R::None
                        || instruction.is_ip_rel_memory_operand()
                        || base == R::RBX,
                    "{text}"
                );
            }
        }
        let halves = 1 + (encoding == Encoding::Vex && is_paired) as usize;
        assert_eq!(gathers, copies * halves);
        let text = |k: usize| &all[k].1[..];
        let saved = ["push rbx", "push rbp", "push r13", "push r14"];
        assert_eq!([text(0), text(1), text(2), text(3)], saved);
        let (begins, stack) = text(4).split_once(',').unwrap();
        assert_eq!(begins, "sub rsp");
        let aligned = ["lea rbp,[rsp+3Fh]", "and rbp,0FFFFFFFFFFFFFFC0h"];
        assert_eq!([text(5), text(6)], aligned);
        assert_eq!(text(end - 6), format!("add rsp,{stack}"));
        let restored = ["pop r14", "pop r13", "pop rbp", "pop rbx"];
        let last: Vec<&str> = (end - 5..end - 1).map(text).collect();
        assert_eq!(last, restored);
        let is_of_stack = |(_, text): &(_, String)| text.contains("rsp") || text.contains("push");
        assert!(!all[7..end - 6].iter().any(is_of_stack));
    }
}

/// Gathers of every register: words at `rbx` in lanes of a mask.
#[test]
fn gathers_are_decoded_as_they_were_encoded() {
    for encoding in BOTH {
        let count = match encoding {
            Encoding::Vex => 16,
            Encoding::Evex => 32,
        };
        for reg in 0..count {
            // Three registers, else it is no instruction.
            let index = (reg + 11) % count;
            let mut a = Assembler::new(encoding);
            let (mask, text) = match encoding {
                Encoding::Vex => {
                    let mask = (reg + 5) % count;
                    (mask, format!("ymm{reg},[rbx+ymm{index}],ymm{mask}"))
                }
                Encoding::Evex => {
                    let mask = 1 + reg % 7;
                    (mask, format!("zmm{reg}{{k{mask}}},[rbx+zmm{index}]"))
                }
            };
            a.gather(PGATHERDD, reg, index, mask);
            let mut expected = vec![format!("vpgatherdd {text}")];
            if encoding == Encoding::Evex {
                a.gather(PSCATTERDD, reg, index, mask);
                expected.push(format!("vpscatterdd [rbx+zmm{index}]{{k{mask}}},zmm{reg}"));
            }
            let given: Vec<String> = (decoded(&a.bytes).into_iter())
                .map(|(_, text)| {
                    let sizes = ["dword ", "yword ", "zword "].iter();
                    sizes.fold(text, |text, size| text.replace(size, ""))
                })
                .collect();
            assert_eq!(given, expected);
        }
    }
}

/// Words between general registers and vectors, addresses of lanes, and masked loads.
#[test]
fn words_of_lanes_are_decoded_as_they_were_encoded() {
    for encoding in BOTH {
        for &reg in registers(encoding) {
            let mut a = Assembler::new(encoding);
            first_word(&mut a, reg);
            let mut expected = vec![format!("vmovd ebx,xmm{reg}")];
            for (op, text) in [
                (MOVSS, "vmovss xmm{}"),
                (ADDSS, "vaddss xmm{},xmm{}"),
                (MULSS, "vmulss xmm{},xmm{}"),
            ] {
                let second = if text.contains(',') { reg } else { 0 };
                let text = text.replace("{}", &reg.to_string());
                for (at, place) in [(-28, "-1Ch"), (64, "+40h"), (4096, "+1000h")] {
                    a.first_lane(op, (reg, second), Memory::At(Base::Word, at));
                    expected.push(format!("{text},dword [rbx{place}]"));
                }
            }
            if encoding == Encoding::Vex {
                broadcast_word(&mut a, reg);
                expected.push(format!("vmovd xmm{reg},ebx"));
                expected.push(format!("vpbroadcastd ymm{reg},xmm{reg}"));
                let last = Operand::Memory(Memory::At(Base::Word, -28));
                a.vector(MASKMOVPS, (reg, 9, last), 0, None);
                expected.push(format!("vmaskmovps ymm{reg},ymm9,yword [rbx-1Ch]"));
                let word = Operand::Register(3);
                a.mask(MOVQ_OUT, (reg, 0, word), false, None);
                expected.push(format!("vmovq rbx,xmm{reg}"));
                a.mask(PEXTRQ, (reg, 0, Operand::Register(9)), false, Some(1));
                expected.push(format!("vpextrq r9,xmm{reg},1"));
                for (index, name) in [(0, "rax"), (3, "rbx"), (9, "r9")] {
                    a.store_lane(MOVD_OUT, reg, index, None);
                    expected.push(format!("vmovd dword [r13+{name}],xmm{reg}"));
                    a.store_lane(PEXTRD, reg, index, Some(3));
                    expected.push(format!("vpextrd dword [r13+{name}],xmm{reg},3"));
                }
                // First lanes alone, which the longer form would not be.
                for (op, text, immediate) in [
                    (MOVD_IN, "vmovd xmm{}", None),
                    (PINSRD, "vpinsrd xmm{},xmm{}", Some(2)),
                ] {
                    let second = if text.contains(',') { reg } else { 0 };
                    a.mask(op, (reg, second, last), false, immediate);
                    let text = text.replace("{}", &reg.to_string());
                    let lane = if immediate.is_some() { ",2" } else { "" };
                    expected.push(format!("{text},dword [rbx-1Ch]{lane}"));
                }
            }
            if encoding == Encoding::Evex {
                let word = Operand::Memory(Memory::At(Base::Word, 0));
                a.vector(BROADCAST_128, (reg, 0, word), 0, None);
                expected.push(format!("vbroadcasti32x4 zmm{reg},oword [rbx]"));
                a.vector(INSERT_128, (reg, 9, word), 0, Some(2));
                expected.push(format!("vinserti32x4 zmm{reg},zmm9,oword [rbx],2"));
                // A run, masked.
                let first = Operand::Memory(Memory::At(Base::Word, -60));
                a.vector(STORE, (reg, 0, first), 3, None);
                expected.push(format!("vmovups zword [rbx-3Ch]{{k3}},zmm{reg}"));
                a.vector(STORE_WIDE, (reg, 0, first), 3, None);
                expected.push(format!("vmovupd zword [rbx-3Ch]{{k3}},zmm{reg}"));
            }
            let all = decoded(&a.bytes);
            let text: Vec<String> = all.into_iter().map(|(_, text)| text).collect();
            assert_eq!(text, expected);
        }
        for base in [Base::Frame, Base::Half, Base::WideHalf, Base::FourthFrame] {
            for is_wide in [false, true] {
                let mut a = Assembler::new(encoding);
                a.lane_address(base, 0x1240, is_wide);
                let name = memory_text(base, 0).replace(['[', ']'], "");
                let bytes = 4 << is_wide as u32;
                let expected = format!("lea rbx,[{name}+rbx*{bytes}+1240h]");
                let all = decoded(&a.bytes);
                let text: Vec<String> = all.into_iter().map(|(_, text)| text).collect();
                assert_eq!(text, [expected]);
            }
        }
    }
}

/// Words at a distance, from vectors that each begin at the words or behind, and that none reaches
/// past: what the instruction does by Intel's manual.
#[test]
fn lanes_choose_their_words_of_vectors() {
    let permuted = |table: [u32; 16], choice: [u32; 16], other: [u32; 16]| {
        choice.map(|from| match from & 16 {
            0 => table[from as usize & 15],
            _ => other[from as usize & 15],
        })
    };
    for words in 2..=8 {
        let last = 15 * words;
        let starts: Vec<u32> = blocks(4 * words).collect();
        assert_eq!(starts[0], 0);
        assert!(starts.iter().all(|start| start + 16 <= last + 1));
        let block = |start: u32| std::array::from_fn(|k| start + k as u32);
        let mut given = block(0);
        for (k, &start) in starts.iter().enumerate().skip(1) {
            given = permuted(given, choice(4 * words, k), block(start));
        }
        assert_eq!(given, std::array::from_fn(|lane| words * lane as u32));
    }
}
