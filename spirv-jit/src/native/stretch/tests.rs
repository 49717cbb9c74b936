//! Encodings, against a decoder that is not ours. What the text of each must be is from Intel's
//! manual.

mod loops;

use iced_x86::{
    Decoder, DecoderOptions, Formatter, Instruction, MemorySizeOptions, NasmFormatter, OpKind,
};

use super::super::allocate::*;
use super::super::encode::{DOWN, Operand, Register, TOWARDS_ZERO, UP, ZEROING};
use super::lower::*;
use super::*;

/// Text of an instruction's operands, in the manual's order: which field each is in (`r`: reg, `v`:
/// vvvv, `m`: rm, `i`: the immediate, `s`: the immediate's upper half), then `h` for half a vector
/// and `k` for a mask.
type Operands = &'static str;

/// An instruction as the manual has it.
struct Listed {
    constant: &'static str,
    op: Opcode,
    name: &'static str,
    operands: Operands,
    immediate: Option<u8>,
    /// The number in reg, of instructions that have such.
    number: Option<u8>,
    /// Whether it is used with a mask of lanes, and what is added to that.
    masked: bool,
    zeroing: u8,
}

impl Listed {
    fn immediate(mut self, immediate: u8) -> Listed {
        self.immediate = Some(immediate);
        self
    }

    fn number(mut self, number: u8) -> Listed {
        self.number = Some(number);
        self
    }

    fn masked(mut self) -> Listed {
        self.masked = true;
        self
    }

    fn zeroing(mut self) -> Listed {
        self.zeroing = ZEROING;
        self.masked()
    }

    /// Whether the operand in rm may be in memory: a whole vector.
    fn has_memory(&self) -> bool {
        self.operands.split(' ').any(|operand| operand == "m")
    }
}

macro_rules! listed {
    ($op:ident, $name:literal, $operands:literal) => {
        Listed {
            constant: stringify!($op),
            op: $op,
            name: $name,
            operands: $operands,
            immediate: None,
            number: None,
            masked: false,
            zeroing: 0,
        }
    };
}

/// In both encodings, with the same names.
fn in_both() -> Vec<Listed> {
    vec![
        listed!(LOAD, "vmovups", "r m"),
        listed!(STORE, "vmovups", "m r"),
        listed!(MOVE, "vmovaps", "r m"),
        listed!(MULTIPLY_ADD_213, "vfmadd213ps", "r v m"),
        listed!(MULTIPLY_ADD_231, "vfmadd231ps", "r v m"),
        listed!(FMAPS, "vfmadd213ps", "r v m"),
        listed!(ADDPS, "vaddps", "r v m"),
        listed!(ADDPD, "vaddpd", "r v m"),
        listed!(SUBPD, "vsubpd", "r v m"),
        listed!(MULPD, "vmulpd", "r v m"),
        listed!(DIVPD, "vdivpd", "r v m"),
        listed!(SQRTPD, "vsqrtpd", "r m"),
        listed!(FMAPD, "vfmadd213pd", "r v m"),
        listed!(SUBPS, "vsubps", "r v m"),
        listed!(MULPS, "vmulps", "r v m"),
        listed!(DIVPS, "vdivps", "r v m"),
        listed!(MINPS, "vminps", "r v m"),
        listed!(MAXPS, "vmaxps", "r v m"),
        listed!(SQRTPS, "vsqrtps", "r m"),
        listed!(CVTDQ2PS, "vcvtdq2ps", "r m"),
        listed!(CVTTPS2DQ, "vcvttps2dq", "r m"),
        listed!(CVTPH2PS, "vcvtph2ps", "r mh"),
        listed!(CVTPS2PH, "vcvtps2ph", "mh r i").immediate(0),
        listed!(PADDD, "vpaddd", "r v m"),
        listed!(PADDQ, "vpaddq", "r v m"),
        listed!(PSUBD, "vpsubd", "r v m"),
        listed!(PSUBQ, "vpsubq", "r v m"),
        listed!(PMULLD, "vpmulld", "r v m"),
        listed!(PMULUDQ, "vpmuludq", "r v m"),
        listed!(PMINSD, "vpminsd", "r v m"),
        listed!(PMAXSD, "vpmaxsd", "r v m"),
        listed!(PMINUD, "vpminud", "r v m"),
        listed!(PMAXUD, "vpmaxud", "r v m"),
        listed!(PABSD, "vpabsd", "r m"),
        listed!(PSHIFTD, "vpsrld", "v mr i")
            .immediate(31)
            .number(RIGHT),
        listed!(PSHIFTD, "vpsrad", "v mr i")
            .immediate(7)
            .number(RIGHT_SIGNED),
        listed!(PSHIFTD, "vpslld", "v mr i")
            .immediate(16)
            .number(LEFT),
        listed!(PSHIFTQ, "vpsrlq", "v mr i")
            .immediate(63)
            .number(RIGHT),
        listed!(PSHIFTQ, "vpsllq", "v mr i")
            .immediate(32)
            .number(LEFT),
        listed!(PSLLVD, "vpsllvd", "r v m"),
        listed!(PSRLVD, "vpsrlvd", "r v m"),
        listed!(PSRAVD, "vpsravd", "r v m"),
        listed!(PMOVZXDQ, "vpmovzxdq", "r mh"),
        listed!(PMOVSXDQ, "vpmovsxdq", "r mh"),
        listed!(PMOVZXWD, "vpmovzxwd", "r mh"),
        listed!(UNPCKLPS, "vunpcklps", "r v m"),
        listed!(UNPCKHPS, "vunpckhps", "r v m"),
        listed!(UNPCKLPD, "vunpcklpd", "r v m"),
        listed!(UNPCKHPD, "vunpckhpd", "r v m"),
    ]
}

fn in_vex() -> Vec<Listed> {
    let mut list = in_both();
    list.extend([
        listed!(ROUNDPS, "vroundps", "r m i").immediate(9),
        listed!(CMPPS, "vcmpps", "r v m i").immediate(float::LT),
        listed!(PAND, "vpand", "r v m"),
        listed!(POR, "vpor", "r v m"),
        listed!(PXOR, "vpxor", "r v m"),
        listed!(PCMPEQD, "vpcmpeqd", "r v m"),
        listed!(PCMPGTD, "vpcmpgtd", "r v m"),
        listed!(BLENDVPS, "vblendvps", "r v m s").immediate(0xd0),
        listed!(EXTRACT_128, "vextracti128", "mh r i").immediate(1),
        listed!(INSERT_128, "vinserti128", "r v mh i").immediate(1),
        listed!(PTEST, "vptest", "r m"),
        listed!(PACKUSDW, "vpackusdw", "r v m"),
        listed!(PERMQ, "vpermq", "r m i").immediate(0xd8),
        listed!(SHUFPS, "vshufps", "r v m i").immediate(0x88),
        listed!(PANDN, "vpandn", "r v m"),
        listed!(TESTPS, "vtestps", "r m"),
        listed!(PERMD, "vpermd", "r v m"),
        listed!(PSHUFD, "vpshufd", "r m i").immediate(0xb1),
        listed!(PERM2I128, "vperm2i128", "r v m i").immediate(0x21),
        listed!(PERMILPS, "vpermilps", "r v m"),
        listed!(PALIGNR, "vpalignr", "r v m i").immediate(12),
        listed!(PBLENDD, "vpblendd", "r v m i").immediate(0xf0),
        listed!(PSHUFB, "vpshufb", "r v m"),
        listed!(PADDB, "vpaddb", "r v m"),
        listed!(PMADDUBSW, "vpmaddubsw", "r v m"),
        listed!(PMADDWD, "vpmaddwd", "r v m"),
        listed!(PBROADCASTD, "vpbroadcastd", "r mx"),
        listed!(PBROADCASTQ_VEX, "vpbroadcastq", "r mx"),
    ]);
    list
}

fn in_evex() -> Vec<Listed> {
    let mut list = in_both();
    list.extend([
        listed!(ADDPH, "vaddph", "r v m"),
        listed!(SUBPH, "vsubph", "r v m"),
        listed!(MULPH, "vmulph", "r v m"),
        listed!(FMAPH, "vfmadd213ph", "r v m"),
        listed!(ROUNDPS, "vrndscaleps", "r m i").immediate(9),
        listed!(CMPPS, "vcmpps", "rk v m i").immediate(float::GE),
        listed!(CVTUDQ2PS, "vcvtudq2ps", "r m"),
        listed!(CVTTPS2UDQ, "vcvttps2udq", "r m"),
        listed!(PMULLQ, "vpmullq", "r v m"),
        listed!(PAND, "vpandd", "r v m"),
        listed!(POR, "vpord", "r v m"),
        listed!(PXOR, "vpxord", "r v m"),
        listed!(PCMPD, "vpcmpd", "rk v m i").immediate(int::LE),
        listed!(PCMPUD, "vpcmpud", "rk v m i").immediate(int::NE),
        listed!(PBLENDMD, "vpblendmd", "r v m").masked(),
        listed!(MASK_TO_VECTOR, "vpmovm2d", "r mk"),
        listed!(VECTOR_TO_MASK, "vpmovd2m", "rk mr"),
        listed!(PMOVDW, "vpmovdw", "mh r"),
        listed!(PMOVQD, "vpmovqd", "mh r"),
        listed!(EXTRACT_HALF, "vextracti64x4", "mh r i").immediate(1),
        listed!(INSERT_HALF, "vinserti64x4", "r v mh i").immediate(1),
        listed!(PBLENDMQ, "vpblendmq", "r v m").masked(),
        listed!(STORE_WIDE, "vmovupd", "m r"),
        listed!(POPCNTD, "vpopcntd", "r m"),
        listed!(LZCNTD, "vplzcntd", "r m"),
        listed!(PERMD, "vpermd", "r v m"),
        listed!(PERMD, "vpermd", "r v m").zeroing(),
        listed!(PSHUFD, "vpshufd", "r m i").immediate(0xb1),
        listed!(SHUFFLE_QUARTERS, "vshufi64x2", "r v m i").immediate(0x4e),
        listed!(ALIGND, "valignd", "r v m i").immediate(15),
        listed!(PBROADCASTD, "vpbroadcastd", "r mx"),
        listed!(PBROADCASTQ, "vpbroadcastq", "r mx"),
        listed!(PTESTMD, "vptestmd", "rk v m"),
        listed!(PERMT2D, "vpermt2d", "r v m"),
        listed!(INSERT_128, "vinserti32x4", "r v mx i").immediate(3),
        listed!(PCMPD, "vpcmpd", "rk v m i")
            .immediate(int::LE)
            .masked(),
    ]);
    list
}

/// Of mask registers; one operand or two.
fn of_masks() -> Vec<Listed> {
    vec![
        listed!(KAND, "kandw", "rk vk mk"),
        listed!(KANDN, "kandnw", "rk vk mk"),
        listed!(KADD, "kaddw", "rk vk mk"),
        listed!(KOR, "korw", "rk vk mk"),
        listed!(KXNOR, "kxnorw", "rk vk mk"),
        listed!(KXOR, "kxorw", "rk vk mk"),
        listed!(KNOT, "knotw", "rk mk"),
        listed!(KSHIFTRW, "kshiftrw", "rk mk i").immediate(8),
        listed!(KORTESTW, "kortestw", "rk mk"),
    ]
}

fn listed(encoding: Encoding) -> Vec<Listed> {
    match encoding {
        Encoding::Vex => in_vex(),
        Encoding::Evex => in_evex(),
    }
}

const BOTH: [Encoding; 2] = [Encoding::Vex, Encoding::Evex];

/// As the decoder prints numbers.
fn number(n: u32) -> String {
    match n {
        0..10 => n.to_string(),
        _ => {
            let hex = format!("{n:X}h");
            let zero = if hex.starts_with(|c: char| c.is_ascii_alphabetic()) {
                "0"
            } else {
                ""
            };
            zero.to_owned() + &hex
        }
    }
}

fn memory_text(base: Base, displacement: i32) -> String {
    let base = match base {
        Base::Frame => "rdi",
        Base::Uniforms => "rsi",
        Base::Half => "r8",
        Base::WideHalf => "r9",
        Base::FourthFrame => "rax",
        Base::Lanes => "r10",
        Base::Word => "rbx",
        Base::Private => "r13",
        Base::Context => "r14",
        Base::Stack => "rbp",
    };
    match displacement {
        0 => format!("[{base}]"),
        1.. => format!("[{base}+{}]", number(displacement as u32)),
        _ => format!("[{base}-{}]", number(displacement.unsigned_abs())),
    }
}

/// The text that the decoder must print.
fn expected(
    listed: &Listed,
    encoding: Encoding,
    (reg, second, rm): (Register, Register, Operand),
    mask: u8,
) -> String {
    let (whole, half) = match encoding {
        Encoding::Vex => ("ymm", "xmm"),
        Encoding::Evex => ("zmm", "ymm"),
    };
    let lanes = match (mask, listed.zeroing) {
        (0, _) => String::new(),
        (_, 0) => format!("{{k{mask}}}"),
        _ => format!("{{k{mask}}}{{z}}"),
    };
    let operands = listed
        .operands
        .split(' ')
        .enumerate()
        .map(|(place, operand)| {
            let (field, class) = operand.split_at(1);
            let lanes = if place == 0 { &lanes[..] } else { "" };
            let class = match class {
                "x" => "xmm",
                "h" => half,
                "k" => "k",
                _ => whole,
            };
            let immediate = listed.immediate.unwrap_or(0);
            match (field, rm) {
                ("r", _) => format!("{class}{reg}{lanes}"),
                ("v", _) => format!("{class}{second}"),
                ("m", Operand::Register(register)) => format!("{class}{register}{lanes}"),
                ("m", Operand::Memory(Memory::At(base, displacement))) => {
                    let size = if encoding == Encoding::Vex {
                        "yword"
                    } else {
                        "zword"
                    };
                    format!("{size} {}{lanes}", memory_text(base, displacement))
                }
                ("s", _) => format!("{class}{}", immediate >> 4),
                ("i", _) => number(immediate.into()),
                _ => unreachable!("no such field"),
            }
        });
    format!("{} {}", listed.name, operands.collect::<Vec<_>>().join(","))
}

/// The instructions in some bytes, all of which they must take.
fn decoded(bytes: &[u8]) -> Vec<(Instruction, String)> {
    let mut formatter = NasmFormatter::new();
    let options = formatter.options_mut();
    options.set_use_pseudo_ops(false);
    options.set_show_branch_size(false);
    options.set_branch_leading_zeros(false);
    options.set_memory_size_options(MemorySizeOptions::Always);
    let mut decoder = Decoder::with_ip(64, bytes, 0, DecoderOptions::NONE);
    let mut all = Vec::new();
    while decoder.can_decode() {
        let instruction = decoder.decode();
        assert!(!instruction.is_invalid(), "{bytes:x?}");
        let mut text = String::new();
        formatter.format(&instruction, &mut text);
        all.push((instruction, text));
    }
    assert_eq!(decoder.position(), bytes.len());
    all
}

/// Emits one instruction and compares it with the text that it must have.
fn check(
    listed: &Listed,
    encoding: Encoding,
    operands: (Register, Register, Operand),
    mask: u8,
) -> Instruction {
    let mut a = Assembler::new(encoding);
    let (reg, second, rm) = operands;
    a.vector(
        listed.op,
        (listed.number.unwrap_or(reg), second, rm),
        mask | if mask != 0 { listed.zeroing } else { 0 },
        listed.immediate,
    );
    let all = decoded(&a.bytes);
    let [(instruction, text)] = &all[..] else {
        panic!("{}: {all:?}", listed.name);
    };
    assert_eq!(*text, expected(listed, encoding, operands, mask));
    assert_eq!(instruction.len(), a.bytes.len());
    *instruction
}

fn registers(encoding: Encoding) -> &'static [Register] {
    match encoding {
        Encoding::Vex => &[0, 1, 7, 8, 14, 15],
        Encoding::Evex => &[0, 1, 7, 8, 15, 16, 23, 24, 30, 31],
    }
}

const MASKS: [Register; 4] = [1, 2, 5, 7];

#[test]
fn registers_are_decoded_as_they_were_encoded() {
    for encoding in BOTH {
        for listed in listed(encoding) {
            let of = |field: &str| -> Vec<Register> {
                let operands = || listed.operands.split(' ');
                match operands().find(|operand| operand.starts_with(field)) {
                    Some(operand) if operand.ends_with('k') => MASKS.to_vec(),
                    Some(_) => registers(encoding).to_vec(),
                    None => vec![0],
                }
            };
            let masks: &[u8] = if listed.masked { &MASKS } else { &[0] };
            for &reg in &of("r") {
                for &second in &of("v") {
                    for &rm in &of("m") {
                        for &mask in masks {
                            let rm = Operand::Register(rm);
                            check(&listed, encoding, (reg, second, rm), mask);
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn roundings_are_decoded_as_they_were_encoded() {
    let registers = registers(Encoding::Evex);
    for (how, name) in [(DOWN, "rd"), (UP, "ru"), (TOWARDS_ZERO, "rz")] {
        for &reg in registers {
            for &second in registers {
                for &rm in registers {
                    let mut a = Assembler::new(Encoding::Evex);
                    a.rounding(ADDPS, (reg, second, Operand::Register(rm)), how);
                    let all = decoded(&a.bytes);
                    let text = format!("vaddps zmm{reg},zmm{second},zmm{rm},{{{name}-sae}}");
                    let printed: Vec<String> = all.into_iter().map(|(_, text)| text).collect();
                    assert_eq!(printed, [text]);
                }
            }
        }
    }
}

#[test]
fn memory_is_decoded_as_it_was_encoded() {
    // Short ones, those that are short in units of vectors, their neighbours, long ones, those off
    // the vectors' alignment.
    let displacements = [
        0,
        4,
        32,
        36,
        64,
        96,
        100,
        127,
        128,
        -4,
        -32,
        -64,
        -128,
        -129,
        4096,
        127 * 64,
        128 * 64,
        129 * 64,
        -128 * 64,
        -129 * 64,
        127 * 64 + 32,
        1 << 20,
        (1 << 26) + 32,
        i32::MAX,
        i32::MIN,
    ];
    for encoding in BOTH {
        let bases: &[Base] = match encoding {
            Encoding::Vex => &[Base::Frame, Base::Uniforms, Base::Half, Base::WideHalf],
            Encoding::Evex => &[Base::Frame, Base::Uniforms],
        };
        let last = *registers(encoding).last().unwrap();
        for listed in listed(encoding).iter().filter(|listed| listed.has_memory()) {
            let is_mask = listed.operands.starts_with("rk");
            for &base in bases {
                for displacement in displacements {
                    let rm = Operand::Memory(Memory::At(base, displacement));
                    let second = if listed.operands.contains('v') {
                        last
                    } else {
                        0
                    };
                    for reg in [0, if is_mask { 7 } else { last }] {
                        let mask = listed.masked as u8 * 7;
                        let instruction = check(listed, encoding, (reg, second, rm), mask);
                        assert!(!instruction.is_broadcast());
                    }
                }
            }
        }
    }
}

#[test]
fn short_displacements_are_short() {
    let length = |encoding, displacement| {
        let mut a = Assembler::new(encoding);
        let rm = Operand::Memory(Memory::At(Base::Frame, displacement));
        a.vector(PADDD, (0, 0, rm), 0, None);
        a.bytes.len()
    };
    // Prefix, opcode, ModRM; one byte or four.
    assert_eq!(length(Encoding::Vex, 96), 6);
    assert_eq!(length(Encoding::Vex, 128), 9);
    assert_eq!(length(Encoding::Evex, 127 * 64), 7);
    assert_eq!(length(Encoding::Evex, 32), 10);
    assert_eq!(length(Encoding::Evex, 128 * 64), 10);
}

#[test]
fn logic_of_masks_is_decoded_as_it_was_encoded() {
    for listed in of_masks() {
        let is_binary = listed.operands.contains('v');
        for reg in 0..8 {
            for second in if is_binary { 0..8 } else { 0..1 } {
                for rm in 0..8 {
                    let mut a = Assembler::new(Encoding::Evex);
                    let operands = (reg, second, Operand::Register(rm));
                    a.mask(listed.op, operands, is_binary, listed.immediate);
                    let all = decoded(&a.bytes);
                    let text = expected(&listed, Encoding::Evex, operands, 0);
                    assert_eq!(all.len(), 1);
                    assert_eq!(all[0].1, text);
                }
            }
        }
    }
}

/// Constants behind the code: wherever an instruction is, with an immediate behind the displacement
/// or without.
#[test]
fn constants_are_found_behind_the_code() {
    let words = [1, 0x8000_0000, 3, u32::MAX];
    let mut pool = words.map(Constant::Word).to_vec();
    pool.push(Constant::LaneBits);
    for encoding in BOTH {
        let list: Vec<Listed> = listed(encoding)
            .into_iter()
            .filter(|listed| listed.has_memory() && !listed.constant.starts_with("STORE"))
            .collect();
        let mut a = Assembler::new(encoding);
        for (k, listed) in list.iter().enumerate() {
            let rm = Operand::Memory(Memory::Pool((k % pool.len()) as u32));
            let reg = if listed.operands.starts_with("rk") {
                7
            } else {
                9
            };
            let second = if listed.operands.contains('v') { 13 } else { 0 };
            a.vector(listed.op, (reg, second, rm), 0, listed.immediate);
        }
        let code_length = a.bytes.len();
        let bytes = a.finish(&pool);
        let size = encoding.vector_bytes() as usize;
        let start = code_length.next_multiple_of(size);
        assert_eq!(bytes.len(), start + pool.len() * size);
        let all = decoded(&bytes[..code_length]);
        assert_eq!(all.len(), list.len());
        for (k, ((instruction, text), listed)) in all.iter().zip(&list).enumerate() {
            assert!(text.starts_with(listed.name), "{text}");
            assert!(instruction.is_ip_rel_memory_operand(), "{text}");
            let at = start + k % pool.len() * size;
            assert_eq!(instruction.ip_rel_memory_address(), at as u64, "{text}");
        }
        for (k, word) in words.iter().enumerate() {
            let vector = &bytes[start + k * size..][..size];
            assert_eq!(vector, word.to_le_bytes().repeat(size / 4));
        }
        let bits = (0..size / 4).flat_map(|lane| (1u32 << lane).to_le_bytes());
        assert!(bits.eq(bytes[start + words.len() * size..].iter().copied()));
    }
}

/// The constants of a source file that are opcodes.
fn opcodes(source: &str) -> impl Iterator<Item = &str> {
    source.lines().filter_map(|line| {
        let (name, _) = line.split_once("const ")?.1.split_once(": Opcode = ")?;
        Some(name)
    })
}

#[test]
fn every_opcode_is_listed() {
    let of_lanes = vec![
        listed!(PBROADCASTB, "vpbroadcastb", "r m"),
        listed!(KMOV, "kmovw", "rk m"),
        listed!(BROADCAST_128, "vbroadcasti32x4", "r m"),
        listed!(KMOV_OUT, "kmovw", ""),
        listed!(KMOV_IN, "kmovw", ""),
        listed!(PBROADCASTD_OF, "vpbroadcastd", ""),
        listed!(MOVMSKPS, "vmovmskps", ""),
        listed!(PGATHERDD, "vpgatherdd", ""),
        listed!(PSCATTERDD, "vpscatterdd", ""),
        listed!(MASKMOVPS, "vmaskmovps", ""),
        listed!(MOVD_IN, "vmovd", ""),
        listed!(MOVD_OUT, "vmovd", ""),
        listed!(PINSRD, "vpinsrd", ""),
        listed!(MOVQ_OUT, "vmovq", ""),
        listed!(PEXTRQ, "vpextrq", ""),
        listed!(PEXTRD, "vpextrd", ""),
        listed!(MOVSS, "vmovss", ""),
        listed!(ADDSS, "vaddss", ""),
        listed!(MULSS, "vmulss", ""),
    ];
    let lists = [in_vex(), in_evex(), of_masks(), of_lanes];
    let names: Vec<&str> = lists
        .iter()
        .flatten()
        .map(|listed| listed.constant)
        .collect();
    let sources = [
        include_str!("../opcodes.rs"),
        include_str!("../stretch.rs"),
        include_str!("../allocate.rs"),
    ];
    let mut count = 0;
    for name in sources.iter().flat_map(|source| opcodes(source)) {
        assert!(names.contains(&name), "{name} is not in the lists above");
        count += 1;
    }
    assert!(count > 50, "{count}");
}

fn place(value: u32, ty: Type, row: ValueRow) -> IrOperand {
    IrOperand {
        value: Value(value),
        ty,
        row,
        constant: None,
    }
}

/// The decoder's output for a function; its last instruction returns.
fn function(bytes: &[u8]) -> Vec<(Instruction, String)> {
    let mut decoder = Decoder::with_ip(64, bytes, 0, DecoderOptions::NONE);
    while decoder.can_decode() {
        if decoder.decode().mnemonic() == iced_x86::Mnemonic::Ret {
            return decoded(&bytes[..decoder.position()]);
        }
    }
    panic!("does not return");
}

/// `a * b + 1`, kept, for one subgroup after the other; with AVX2 one half of each after the other.
#[test]
fn functions_walk_over_frames() {
    let text = |encoding| {
        let mut stretch = Stretch::new(encoding);
        let f32 = |value, row| place(value, Type::F32, row);
        let (a, b) = (f32(0, ValueRow::Frame(1)), f32(1, ValueRow::Frame(300)));
        let one = f32(2, ValueRow::Uniform(5));
        let (product, sum) = (f32(3, ValueRow::Frame(1)), f32(4, ValueRow::Frame(2)));
        assert!(stretch.perform(&Op::FMul, &[a, b], &[product]));
        stretch.end_operation();
        assert!(stretch.perform(&Op::FAdd, &[product, one], &[sum]));
        stretch.end_operation();
        assert_eq!(stretch.operations(), 2);
        let code = stretch.assemble(|value| value == Value(4)).unwrap();
        let text: Vec<String> = function(&code).into_iter().map(|(_, text)| text).collect();
        text.join("; ").replace("yword ", "").replace("zword ", "")
    };
    assert_eq!(
        text(Encoding::Evex),
        "vmovups zmm0,[rdi+40h]; vmulps zmm0,zmm0,[rdi+4B00h]; vaddps zmm0,zmm0,[rsi+140h]; vmovups [rdi+80h],zmm0; \
         add rdi,rcx; dec rdx; jne 0; vzeroupper; ret"
    );
    assert_eq!(
        text(Encoding::Vex),
        "mov r8,rdi; mov r9,rdi; mov eax,2; \
         vmovups ymm0,[r8+40h]; vmulps ymm0,ymm0,[r8+4B00h]; vaddps ymm0,ymm0,[rsi+140h]; vmovups [r8+80h],ymm0; \
         add r8,20h; add r9,40h; dec eax; jne 0Bh; \
         add rdi,rcx; dec rdx; jne 0; vzeroupper; ret"
    );
}

/// Copies of `a + b` and of a condition, in active lanes, and of a row as it is: the mask is read
/// for each subgroup, with AVX2 for each half.
#[test]
fn copies_change_active_lanes() {
    let text = |encoding| {
        let mut stretch = Stretch::new(encoding);
        let i32 = |value, row| place(value, Type::I32, ValueRow::Frame(row));
        let (a, b, sum) = (i32(0, 1), i32(1, 2), i32(2, 3));
        let holds = place(3, Type::I1, ValueRow::Frame(4));
        assert!(stretch.perform(&Op::IAdd, &[a, b], &[sum]));
        stretch.end_operation();
        stretch.copy_to(&sum, ValueRow::Frame(5), true);
        stretch.copy_to(&holds, ValueRow::Frame(6), true);
        stretch.copy_to(&a, ValueRow::Frame(7), false);
        assert_eq!(stretch.operations(), 4);
        let code = stretch.assemble(|_| false).unwrap();
        let text: Vec<String> = function(&code).into_iter().map(|(_, text)| text).collect();
        text.join("; ").replace("yword ", "").replace("zword ", "")
    };
    assert_eq!(
        text(Encoding::Evex),
        "mov r10,r8; \
         vmovups zmm0,[rdi+40h]; vpaddd zmm1,zmm0,[rdi+80h]; \
         kmovw k1,word [r10]; vmovups zmm2,[rdi+140h]; vpblendmd zmm2{k1},zmm2,zmm1; vmovups [rdi+140h],zmm2; \
         vmovups zmm31,[rdi+100h]; vpmovd2m k2,zmm31; kandw k2,k1,k2; \
         vmovups zmm31,[rdi+180h]; vpmovd2m k3,zmm31; kandnw k3,k1,k3; korw k3,k2,k3; \
         vpmovm2d zmm31,k3; vmovups [rdi+180h],zmm31; \
         vmovaps zmm0,zmm0; vmovups [rdi+1C0h],zmm0; \
         add r10,2; add rdi,rcx; dec rdx; jne 3; vzeroupper; ret"
    );
    assert_eq!(
        text(Encoding::Vex),
        "mov r10,r8; mov r8,rdi; mov r9,rdi; mov eax,2; \
         vmovups ymm0,[r8+40h]; vpaddd ymm1,ymm0,[r8+80h]; \
         vpbroadcastb ymm2,byte [r10]; vmovups ymm3,[rel 0A0h]; vpand ymm2,ymm2,ymm3; vpcmpeqd ymm3,ymm2,ymm3; \
         vmovups ymm2,[r8+140h]; vblendvps ymm2,ymm2,ymm1,ymm3; vmovups [r8+140h],ymm2; \
         vmovups ymm2,[r8+180h]; vblendvps ymm2,ymm2,[r8+100h],ymm3; vmovups [r8+180h],ymm2; \
         vmovaps ymm0,ymm0; vmovups [r8+1C0h],ymm0; \
         add r10,1; add r8,20h; add r9,40h; dec eax; jne 0Eh; \
         add rdi,rcx; dec rdx; jne 3; vzeroupper; ret"
    );
}

/// No instruction but those at the ends of loops writes a pointer, and all memory is the frame's,
/// uniform rows', or constants behind the code.
#[test]
fn memory_is_at_the_pointers_that_code_was_given() {
    use iced_x86::Register as R;
    for encoding in BOTH {
        let mut stretch = Stretch::new(encoding);
        let at = |value: u32, ty| place(value, ty, ValueRow::Frame(2 * value as usize));
        let mut count = 0;
        for (k, op) in [
            Op::IAdd,
            Op::IMul,
            Op::SMin,
            Op::Shl,
            Op::ULt,
            Op::UToF,
            Op::FMin,
        ]
        .iter()
        .cycle()
        .take(200)
        .enumerate()
        {
            let k = k as u32;
            let operands = [at(k % 90, Type::I32), at((k + 7) % 90, Type::I32)];
            let (operands, ty) = match op {
                Op::UToF => (&operands[..1], Type::F32),
                Op::ULt => (&operands[..], Type::I1),
                _ => (&operands[..], Type::I32),
            };
            count += stretch.perform(op, operands, &[at(100 + k, ty)]) as u32;
            stretch.end_operation();
        }
        assert!(count > 150, "{count}");
        let code = stretch.assemble(|value| value.0 % 3 == 0).unwrap();
        let all = function(&code);
        let pointers = [R::RDI, R::RSI, R::R8, R::R9, R::None];
        for (instruction, text) in &all {
            if (0..instruction.op_count()).any(|k| instruction.op_kind(k) == OpKind::Memory) {
                let base = instruction.memory_base();
                assert!(
                    pointers.contains(&base) && base != R::None
                        || instruction.is_ip_rel_memory_operand(),
                    "{text}"
                );
                assert_eq!(instruction.memory_index(), R::None, "{text}");
            }
            let written = instruction.op0_register();
            let name = format!("{written:?}");
            let is_vector = name.contains("MM") || name.starts_with('K');
            let is_store = instruction.op0_kind() == OpKind::Memory;
            let ends_loop = ["add ", "dec ", "jne ", "mov ", "vzeroupper", "ret"];
            let ends_loop = ends_loop.iter().any(|start| text.starts_with(start));
            assert!(is_vector || is_store || ends_loop, "{text}");
        }
    }
}

/// Intermediates have no place in memory: an operation with more of them than there are registers
/// has no code.
#[test]
fn what_has_neither_register_nor_row_has_no_code() {
    for encoding in BOTH {
        let assembled = |count: u32| {
            let mut stretch = Stretch::new(encoding);
            let from = |value| place(value, Type::I32, ValueRow::Frame(value as usize));
            for k in 0..count {
                let nowhere = place(100 + k, Type::I32, ValueRow::Forwarded);
                assert!(stretch.perform(&Op::IAdd, &[from(k), from(k + 1)], &[nowhere]));
            }
            for k in 0..count {
                let nowhere = place(100 + k, Type::I32, ValueRow::Forwarded);
                assert!(stretch.perform(&Op::IAdd, &[nowhere, from(k)], &[from(200 + k)]));
            }
            stretch.end_operation();
            stretch.assemble(|value| value.0 >= 200)
        };
        assert!(assembled(5).is_some());
        assert!(assembled(40).is_none());
    }
}
