//! The instructions that stretches are made of, by their names in Intel's manual (volume 2): opcode
//! map, prefix, `W`, opcode.

use super::encode::{Opcode, opcode};

const F: u8 = 1;
const F38: u8 = 2;
const F3A: u8 = 3;
/// Maps of AVX-512 FP16.
const MAP5: u8 = 5;
const MAP6: u8 = 6;
/// Prefixes.
const NONE: u8 = 0;
const X66: u8 = 1;
const XF3: u8 = 2;
const XF2: u8 = 3;

pub(super) const ADDPS: Opcode = opcode(F, NONE, 0, 0x58);
pub(super) const SUBPS: Opcode = opcode(F, NONE, 0, 0x5c);
pub(super) const MULPS: Opcode = opcode(F, NONE, 0, 0x59);
pub(super) const DIVPS: Opcode = opcode(F, NONE, 0, 0x5e);
pub(super) const MINPS: Opcode = opcode(F, NONE, 0, 0x5d);
pub(super) const MAXPS: Opcode = opcode(F, NONE, 0, 0x5f);
pub(super) const SQRTPS: Opcode = opcode(F, NONE, 0, 0x51);
pub(super) const ROUNDPS: Opcode = opcode(F3A, X66, 0, 0x08);
pub(super) const CMPPS: Opcode = opcode(F, NONE, 0, 0xc2);
pub(super) const FMAPS: Opcode = opcode(F38, X66, 0, 0xa8);
pub(super) const ADDPD: Opcode = opcode(F, X66, 1, 0x58);
pub(super) const SUBPD: Opcode = opcode(F, X66, 1, 0x5c);
pub(super) const MULPD: Opcode = opcode(F, X66, 1, 0x59);
pub(super) const DIVPD: Opcode = opcode(F, X66, 1, 0x5e);
pub(super) const SQRTPD: Opcode = opcode(F, X66, 1, 0x51);
pub(super) const FMAPD: Opcode = opcode(F38, X66, 1, 0xa8);
pub(super) const CVTDQ2PS: Opcode = opcode(F, NONE, 0, 0x5b);
pub(super) const CVTUDQ2PS: Opcode = opcode(F, XF2, 0, 0x7a);
pub(super) const CVTTPS2DQ: Opcode = opcode(F, XF3, 0, 0x5b);
pub(super) const CVTTPS2UDQ: Opcode = opcode(F, NONE, 0, 0x78);
pub(super) const CVTPH2PS: Opcode = opcode(F38, X66, 0, 0x13);
pub(super) const CVTPS2PH: Opcode = opcode(F3A, X66, 0, 0x1d);
pub(super) const ADDPH: Opcode = opcode(MAP5, NONE, 0, 0x58);
pub(super) const SUBPH: Opcode = opcode(MAP5, NONE, 0, 0x5c);
pub(super) const MULPH: Opcode = opcode(MAP5, NONE, 0, 0x59);
pub(super) const FMAPH: Opcode = opcode(MAP6, X66, 0, 0xa8);
pub(super) const PADDD: Opcode = opcode(F, X66, 0, 0xfe);
pub(super) const PADDQ: Opcode = opcode(F, X66, 1, 0xd4);
pub(super) const PSUBD: Opcode = opcode(F, X66, 0, 0xfa);
pub(super) const PSUBQ: Opcode = opcode(F, X66, 1, 0xfb);
/// Of the lower words of lanes of 64 bits.
pub(super) const PMULUDQ: Opcode = opcode(F, X66, 1, 0xf4);
pub(super) const PMULLD: Opcode = opcode(F38, X66, 0, 0x40);
pub(super) const PMULLQ: Opcode = opcode(F38, X66, 1, 0x40);
pub(super) const PAND: Opcode = opcode(F, X66, 0, 0xdb);
pub(super) const PANDN: Opcode = opcode(F, X66, 0, 0xdf);
pub(super) const POR: Opcode = opcode(F, X66, 0, 0xeb);
pub(super) const PXOR: Opcode = opcode(F, X66, 0, 0xef);
pub(super) const PMINSD: Opcode = opcode(F38, X66, 0, 0x39);
pub(super) const PMAXSD: Opcode = opcode(F38, X66, 0, 0x3d);
pub(super) const PMINUD: Opcode = opcode(F38, X66, 0, 0x3b);
pub(super) const PMAXUD: Opcode = opcode(F38, X66, 0, 0x3f);
pub(super) const PABSD: Opcode = opcode(F38, X66, 0, 0x1e);
pub(super) const PSHIFTD: Opcode = opcode(F, X66, 0, 0x72);
pub(super) const PSHIFTQ: Opcode = opcode(F, X66, 1, 0x73);
pub(super) const PSLLVD: Opcode = opcode(F38, X66, 0, 0x47);
pub(super) const PSRLVD: Opcode = opcode(F38, X66, 0, 0x45);
pub(super) const PSRAVD: Opcode = opcode(F38, X66, 0, 0x46);
pub(super) const PCMPEQD: Opcode = opcode(F, X66, 0, 0x76);
pub(super) const PCMPGTD: Opcode = opcode(F, X66, 0, 0x66);
pub(super) const PCMPD: Opcode = opcode(F3A, X66, 0, 0x1f);
pub(super) const PCMPUD: Opcode = opcode(F3A, X66, 0, 0x1e);
pub(super) const PBLENDMD: Opcode = opcode(F38, X66, 0, 0x64);
pub(super) const PBLENDMQ: Opcode = opcode(F38, X66, 1, 0x64);
pub(super) const BLENDVPS: Opcode = opcode(F3A, X66, 0, 0x4a);
pub(super) const PMOVZXDQ: Opcode = opcode(F38, X66, 0, 0x35);
pub(super) const PMOVSXDQ: Opcode = opcode(F38, X66, 0, 0x25);
pub(super) const PMOVZXWD: Opcode = opcode(F38, X66, 0, 0x33);
pub(super) const PMOVDW: Opcode = opcode(F38, XF3, 0, 0x33);
pub(super) const PMOVQD: Opcode = opcode(F38, XF3, 0, 0x35);
pub(super) const EXTRACT_HALF: Opcode = opcode(F3A, X66, 1, 0x3b);
pub(super) const INSERT_HALF: Opcode = opcode(F3A, X66, 1, 0x3a);
pub(super) const EXTRACT_128: Opcode = opcode(F3A, X66, 0, 0x39);
pub(super) const INSERT_128: Opcode = opcode(F3A, X66, 0, 0x38);
/// The same 128 bits in each quarter, from memory; AVX-512.
pub(super) const BROADCAST_128: Opcode = opcode(F38, X66, 0, 0x5a);
/// A word into one of the first four lanes.
pub(super) const PINSRD: Opcode = opcode(F3A, X66, 0, 0x22);
/// Of first lanes alone.
pub(super) const MOVSS: Opcode = opcode(F, XF3, 0, 0x10);
pub(super) const ADDSS: Opcode = opcode(F, XF3, 0, 0x58);
pub(super) const MULSS: Opcode = opcode(F, XF3, 0, 0x59);
pub(super) const UNPCKLPS: Opcode = opcode(F, NONE, 0, 0x14);
pub(super) const UNPCKHPS: Opcode = opcode(F, NONE, 0, 0x15);
pub(super) const UNPCKLPD: Opcode = opcode(F, X66, 1, 0x14);
pub(super) const UNPCKHPD: Opcode = opcode(F, X66, 1, 0x15);
/// Whether the operands have bits in common, and whether the second has some besides.
pub(super) const PTEST: Opcode = opcode(F38, X66, 0, 0x17);
pub(super) const PACKUSDW: Opcode = opcode(F38, X66, 0, 0x2b);
pub(super) const PERMQ: Opcode = opcode(F3A, X66, 1, 0x00);
pub(super) const SHUFPS: Opcode = opcode(F, NONE, 0, 0xc6);
pub(super) const PBROADCASTB: Opcode = opcode(F38, X66, 0, 0x78);
pub(super) const KMOV: Opcode = opcode(F, NONE, 0, 0x90);
pub(super) const KAND: Opcode = opcode(F, NONE, 0, 0x41);
pub(super) const KANDN: Opcode = opcode(F, NONE, 0, 0x42);
pub(super) const KNOT: Opcode = opcode(F, NONE, 0, 0x44);
pub(super) const KOR: Opcode = opcode(F, NONE, 0, 0x45);
pub(super) const KXNOR: Opcode = opcode(F, NONE, 0, 0x46);
pub(super) const KXOR: Opcode = opcode(F, NONE, 0, 0x47);
pub(super) const KSHIFTRW: Opcode = opcode(F3A, X66, 1, 0x30);
pub(super) const KORTESTW: Opcode = opcode(F, NONE, 0, 0x98);
/// From a mask register to a general one.
pub(super) const KMOV_OUT: Opcode = opcode(F, NONE, 0, 0x93);
pub(super) const TESTPS: Opcode = opcode(F38, X66, 0, 0x0e);
/// Signs of a vector's lanes to a general register.
pub(super) const MOVMSKPS: Opcode = opcode(F, NONE, 0, 0x50);
/// Stores lanes of 64 bits, where masks count them.
pub(super) const STORE_WIDE: Opcode = opcode(F, X66, 1, 0x11);
pub(super) const PGATHERDD: Opcode = opcode(F38, X66, 0, 0x90);
/// AVX-512 only.
pub(super) const PSCATTERDD: Opcode = opcode(F38, X66, 0, 0xa0);
pub(super) const KADD: Opcode = opcode(F, NONE, 0, 0x4a);
/// Lanes that the first operand numbers, of the second.
pub(super) const PERMD: Opcode = opcode(F38, X66, 0, 0x36);
/// Lanes of the first and the third operand that the second numbers; AVX-512.
pub(super) const PERMT2D: Opcode = opcode(F38, X66, 0, 0x7e);
/// Within each four words, as the immediate says.
pub(super) const PSHUFD: Opcode = opcode(F, X66, 0, 0x70);
/// Quarters of both operands, as the immediate says.
pub(super) const SHUFFLE_QUARTERS: Opcode = opcode(F3A, X66, 1, 0x43);
/// Words from so many places behind the second operand's start on, the first operand behind it.
pub(super) const ALIGND: Opcode = opcode(F3A, X66, 0, 0x03);
pub(super) const PBROADCASTD: Opcode = opcode(F38, X66, 0, 0x58);
/// From a general register.
pub(super) const PBROADCASTD_OF: Opcode = opcode(F38, X66, 0, 0x7c);
pub(super) const PTESTMD: Opcode = opcode(F38, X66, 0, 0x27);
/// From a general register to a mask register.
pub(super) const KMOV_IN: Opcode = opcode(F, NONE, 0, 0x92);
/// Quarters of both operands, as the immediate says; AVX2.
pub(super) const PERM2I128: Opcode = opcode(F3A, X66, 0, 0x46);
/// Within each quarter, words that the second operand numbers.
pub(super) const PERMILPS: Opcode = opcode(F38, X66, 0, 0x0c);
/// Within each quarter, bytes from so many places on of the second operand, the first behind it.
pub(super) const PALIGNR: Opcode = opcode(F3A, X66, 0, 0x0f);
/// Words of the first or the second operand, as the immediate says.
pub(super) const PBLENDD: Opcode = opcode(F3A, X66, 0, 0x02);
pub(super) const PSHUFB: Opcode = opcode(F38, X66, 0, 0x00);
pub(super) const PADDB: Opcode = opcode(F, X66, 0, 0xfc);
pub(super) const PMADDUBSW: Opcode = opcode(F38, X66, 0, 0x04);
pub(super) const PMADDWD: Opcode = opcode(F, X66, 0, 0xf5);
/// Loads words in lanes of the first operand's signs, zeros elsewhere.
pub(super) const MASKMOVPS: Opcode = opcode(F38, X66, 0, 0x2c);
/// From a general register to the first lane, and back.
pub(super) const MOVD_IN: Opcode = opcode(F, X66, 0, 0x6e);
pub(super) const MOVD_OUT: Opcode = opcode(F, X66, 0, 0x7e);
/// The first two lanes to a general register of 64 bits.
pub(super) const MOVQ_OUT: Opcode = opcode(F, X66, 1, 0x7e);
/// The same of any two lanes of the first four, and one lane to a register of 32 bits.
pub(super) const PEXTRQ: Opcode = opcode(F3A, X66, 1, 0x16);
pub(super) const PEXTRD: Opcode = opcode(F3A, X66, 0, 0x16);
pub(super) const PBROADCASTQ_VEX: Opcode = opcode(F38, X66, 0, 0x59);
pub(super) const PBROADCASTQ: Opcode = opcode(F38, X66, 1, 0x59);
pub(super) const POPCNTD: Opcode = opcode(F38, X66, 0, 0x55);
pub(super) const LZCNTD: Opcode = opcode(F38, X66, 0, 0x44);
