//! Integer operations. All wrap; see the IR's prose for division and shifts.

/// An integer scalar: an unsigned type whose signed reading is [`Int::Signed`].
pub trait Int: Copy + PartialEq + PartialOrd + std::fmt::Debug + 'static {
    type Signed: Copy + PartialOrd;
    const BITS: u32;
    const ZERO: Self;
    const ONE: Self;
    /// All bits set.
    const ONES: Self;
    /// The low bits.
    fn from_u64(bits: u64) -> Self;
    /// Zero-extended.
    fn to_u64(self) -> u64;
    /// Sign-extended.
    fn to_i64(self) -> i64;
    fn signed(self) -> Self::Signed;
    fn add(self, b: Self) -> Self;
    fn sub(self, b: Self) -> Self;
    fn mul(self, b: Self) -> Self;
    fn umul_hi(self, b: Self) -> Self;
    fn smul_hi(self, b: Self) -> Self;
    /// `b` is not zero.
    fn div(self, b: Self) -> Self;
    fn rem(self, b: Self) -> Self;
    fn sdiv(self, b: Self) -> Self;
    fn srem(self, b: Self) -> Self;
    fn and(self, b: Self) -> Self;
    fn or(self, b: Self) -> Self;
    fn xor(self, b: Self) -> Self;
    fn not(self) -> Self;
    /// The count is taken modulo the width.
    fn shl(self, count: u32) -> Self;
    fn shr(self, count: u32) -> Self;
    fn sar(self, count: u32) -> Self;
    fn reverse(self) -> Self;
    fn ones(self) -> u32;
    fn leading_zeros(self) -> u32;
    fn trailing_zeros(self) -> u32;
}

macro_rules! impl_int {
    ($u:ident, $s:ident, $wide_u:ident, $wide_s:ident) => {
        impl Int for $u {
            type Signed = $s;
            const BITS: u32 = $u::BITS;
            const ZERO: Self = 0;
            const ONE: Self = 1;
            const ONES: Self = $u::MAX;
            #[inline(always)]
            fn from_u64(bits: u64) -> Self {
                bits as $u
            }
            #[inline(always)]
            fn to_u64(self) -> u64 {
                self as u64
            }
            #[inline(always)]
            fn to_i64(self) -> i64 {
                self as $s as i64
            }
            #[inline(always)]
            fn signed(self) -> $s {
                self as $s
            }
            #[inline(always)]
            fn add(self, b: Self) -> Self {
                self.wrapping_add(b)
            }
            #[inline(always)]
            fn sub(self, b: Self) -> Self {
                self.wrapping_sub(b)
            }
            #[inline(always)]
            fn mul(self, b: Self) -> Self {
                self.wrapping_mul(b)
            }
            #[inline(always)]
            fn umul_hi(self, b: Self) -> Self {
                ((self as $wide_u * b as $wide_u) >> $u::BITS) as $u
            }
            #[inline(always)]
            fn smul_hi(self, b: Self) -> Self {
                ((self as $s as $wide_s * b as $s as $wide_s) >> $u::BITS) as $u
            }
            #[inline(always)]
            fn div(self, b: Self) -> Self {
                self / b
            }
            #[inline(always)]
            fn rem(self, b: Self) -> Self {
                self % b
            }
            #[inline(always)]
            fn sdiv(self, b: Self) -> Self {
                (self as $s).wrapping_div(b as $s) as $u
            }
            #[inline(always)]
            fn srem(self, b: Self) -> Self {
                (self as $s).wrapping_rem(b as $s) as $u
            }
            #[inline(always)]
            fn and(self, b: Self) -> Self {
                self & b
            }
            #[inline(always)]
            fn or(self, b: Self) -> Self {
                self | b
            }
            #[inline(always)]
            fn xor(self, b: Self) -> Self {
                self ^ b
            }
            #[inline(always)]
            fn not(self) -> Self {
                !self
            }
            #[inline(always)]
            fn shl(self, count: u32) -> Self {
                self.wrapping_shl(count)
            }
            #[inline(always)]
            fn shr(self, count: u32) -> Self {
                self.wrapping_shr(count)
            }
            #[inline(always)]
            fn sar(self, count: u32) -> Self {
                (self as $s).wrapping_shr(count) as $u
            }
            #[inline(always)]
            fn reverse(self) -> Self {
                self.reverse_bits()
            }
            #[inline(always)]
            fn ones(self) -> u32 {
                self.count_ones()
            }
            #[inline(always)]
            fn leading_zeros(self) -> u32 {
                $u::leading_zeros(self)
            }
            #[inline(always)]
            fn trailing_zeros(self) -> u32 {
                $u::trailing_zeros(self)
            }
        }
    };
}
impl_int!(u8, i8, u16, i16);
impl_int!(u16, i16, u32, i32);
impl_int!(u32, i32, u64, i64);
impl_int!(u64, i64, u128, i128);

/// Operations that booleans and integers share.
pub trait Bits: Copy + PartialEq {
    fn bit_and(self, b: Self) -> Self;
    fn bit_or(self, b: Self) -> Self;
    fn bit_xor(self, b: Self) -> Self;
    fn bit_not(self) -> Self;
}

macro_rules! impl_bits {
    ($($t:ident)*) => {$(
        impl Bits for $t {
            #[inline(always)]
            fn bit_and(self, b: Self) -> Self {
                self & b
            }
            #[inline(always)]
            fn bit_or(self, b: Self) -> Self {
                self | b
            }
            #[inline(always)]
            fn bit_xor(self, b: Self) -> Self {
                self ^ b
            }
            #[inline(always)]
            fn bit_not(self) -> Self {
                !self
            }
        }
    )*};
}
impl_bits!(bool u8 u16 u32 u64);

macro_rules! int_ops {
    ($($(#[$doc:meta])* $name:ident($($arg:ident),*) = $value:expr;)*) => {$(
        $(#[$doc])*
        #[inline(always)]
        pub fn $name<T: Int>($($arg: T),*) -> T {
            $value
        }
    )*};
}

int_ops! {
    iadd(a, b) = a.add(b);
    isub(a, b) = a.sub(b);
    imul(a, b) = a.mul(b);
    /// High half of the unsigned product.
    umul_hi(a, b) = a.umul_hi(b);
    smul_hi(a, b) = a.smul_hi(b);
    /// 0 for a zero divisor.
    udiv(a, b) = if T::BITS == 32 {
        let q = quotient_32(a.to_u64() as u32 as f64, b.to_u64() as u32 as f64);
        T::from_u64(q as u64)
    } else if b == T::ZERO {
        T::ZERO
    } else {
        a.div(b)
    };
    sdiv(a, b) = if T::BITS == 32 {
        let q = quotient_32(a.to_i64() as i32 as f64, b.to_i64() as i32 as f64);
        T::from_u64(q as u64)
    } else if b == T::ZERO {
        T::ZERO
    } else {
        a.sdiv(b)
    };
    /// The dividend for a zero divisor.
    urem(a, b) = if T::BITS == 32 {
        a.sub(udiv(a, b).mul(b))
    } else if b == T::ZERO {
        a
    } else {
        a.rem(b)
    };
    srem(a, b) = if T::BITS == 32 {
        a.sub(sdiv(a, b).mul(b))
    } else if b == T::ZERO {
        a
    } else {
        a.srem(b)
    };
    /// The result has the divisor's sign.
    smod(a, b) = {
        let r = srem(a, b);
        let signs_differ = slt(r, T::ZERO) != slt(b, T::ZERO);
        if b != T::ZERO && r != T::ZERO && signs_differ { r.add(b) } else { r }
    };
    shl(a, b) = a.shl(b.to_u64() as u32);
    lshr(a, b) = a.shr(b.to_u64() as u32);
    ashr(a, b) = a.sar(b.to_u64() as u32);
    smin(a, b) = if slt(b, a) { b } else { a };
    smax(a, b) = if slt(a, b) { b } else { a };
    umin(a, b) = if b < a { b } else { a };
    umax(a, b) = if a < b { b } else { a };
    ineg(a) = T::ZERO.sub(a);
    iabs(a) = if slt(a, T::ZERO) { T::ZERO.sub(a) } else { a };
    isign(a) = if slt(a, T::ZERO) { T::ONES } else if a == T::ZERO { T::ZERO } else { T::ONE };
    bit_reverse(a) = a.reverse();
    bit_count(a) = T::from_u64(a.ones() as u64);
    /// All ones where there is none.
    find_lsb(a) = if a == T::ZERO { T::ONES } else { T::from_u64(a.trailing_zeros() as u64) };
    find_umsb(a) = T::from_u64((T::BITS as u64).wrapping_sub(1 + a.leading_zeros() as u64));
    /// The highest bit that differs from the sign.
    find_smsb(a) = find_umsb(if slt(a, T::ZERO) { a.not() } else { a });
}

#[inline(always)]
pub fn and<T: Bits>(a: T, b: T) -> T {
    a.bit_and(b)
}

#[inline(always)]
pub fn or<T: Bits>(a: T, b: T) -> T {
    a.bit_or(b)
}

#[inline(always)]
pub fn xor<T: Bits>(a: T, b: T) -> T {
    a.bit_xor(b)
}

#[inline(always)]
pub fn not<T: Bits>(a: T) -> T {
    a.bit_not()
}

#[inline(always)]
pub fn ieq<T: Bits>(a: T, b: T) -> bool {
    a == b
}

#[inline(always)]
pub fn ine<T: Bits>(a: T, b: T) -> bool {
    a != b
}

#[inline(always)]
pub fn ult<T: Int>(a: T, b: T) -> bool {
    a < b
}

#[inline(always)]
pub fn ule<T: Int>(a: T, b: T) -> bool {
    a <= b
}

#[inline(always)]
pub fn slt<T: Int>(a: T, b: T) -> bool {
    a.signed() < b.signed()
}

#[inline(always)]
pub fn sle<T: Int>(a: T, b: T) -> bool {
    a.signed() <= b.signed()
}

/// The truncated quotient of two integers of 32 bits, by way of f64, which vector units divide: a
/// quotient that is not an integer is at least 2^-32 away from one, and the rounding of one below
/// 2^32 smaller than that wherever it matters. 0 for a zero divisor.
#[inline(always)]
fn quotient_32(a: f64, b: f64) -> u32 {
    let quotient = (a / b).trunc();
    super::wide::low_word(if b == 0.0 { 0.0 } else { quotient })
}

/// A mask of the lowest `count` bits; all of them from the width on.
#[inline(always)]
fn low_bits<T: Int>(count: u32) -> T {
    if count >= T::BITS {
        T::ONES
    } else {
        T::ONE.shl(count).sub(T::ONE)
    }
}

/// `a << count`, zero from the width on.
#[inline(always)]
fn shl_full<T: Int>(a: T, count: u32) -> T {
    if count >= T::BITS {
        T::ZERO
    } else {
        a.shl(count)
    }
}

/// `OpBitFieldInsert`; bits beyond the width are dropped.
#[inline(always)]
pub fn bitfield_insert<T: Int>(base: T, insert: T, offset: u32, count: u32) -> T {
    let mask = shl_full(low_bits::<T>(count), offset);
    base.and(mask.not()).or(shl_full(insert, offset).and(mask))
}

/// `OpBitFieldUExtract`; bits beyond the width read as zero.
#[inline(always)]
pub fn bitfield_uextract<T: Int>(base: T, offset: u32, count: u32) -> T {
    let shifted = if offset >= T::BITS {
        T::ZERO
    } else {
        base.shr(offset)
    };
    shifted.and(low_bits(count))
}

/// `OpBitFieldSExtract`: the field's highest bit is extended; 0 for an empty field.
#[inline(always)]
pub fn bitfield_sextract<T: Int>(base: T, offset: u32, count: u32) -> T {
    let field = bitfield_uextract(base, offset, count);
    let count = count.min(T::BITS);
    let up = T::BITS - count;
    if count == 0 {
        T::ZERO
    } else {
        field.shl(up).sar(up)
    }
}

#[inline(always)]
pub fn pack64(low: u32, high: u32) -> u64 {
    low as u64 | (high as u64) << 32
}

#[inline(always)]
pub fn unpack64(value: u64) -> (u32, u32) {
    (value as u32, (value >> 32) as u32)
}
