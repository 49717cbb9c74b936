//! Sums and products of f64 numbers without rounding (Shewchuk 1997, "Adaptive Precision
//! Floating-Point Arithmetic and Fast Robust Geometric Predicates").
//!
//! The inputs here come from f32 numbers: differences of two, and products of at most three of
//! those. All are whole multiples of 2⁻⁴⁴⁷ and below 2³⁹⁰, and so are rounding residues, so nothing
//! under- or overflows.
#![forbid(unsafe_code)]

/// A sum and what rounding took from it.
#[inline(always)]
pub(crate) fn two_sum(a: f64, b: f64) -> [f64; 2] {
    let sum = a + b;
    let from_b = sum - a;
    let from_a = sum - from_b;
    [sum, (a - from_a) + (b - from_b)]
}

/// A number in two halves of 26 bits.
#[inline(always)]
fn split(a: f64) -> [f64; 2] {
    let large = a * ((1u64 << 27) + 1) as f64;
    let high = large - (large - a);
    [high, a - high]
}

/// A product and what rounding took from it.
#[inline(always)]
pub(crate) fn two_product(a: f64, b: f64) -> [f64; 2] {
    let product = a * b;
    let ([a_high, a_low], [b_high, b_low]) = (split(a), split(b));
    let error = product - a_high * b_high - a_low * b_high - a_high * b_low;
    [product, a_low * b_low - error]
}

/// Terms of the longest sum: six products of three differences, each in two terms.
const TERMS: usize = 6 * 8 * 4;

/// A sum of terms that do not overlap, the least first; none of them is zero.
pub(crate) struct Expansion {
    terms: [f64; TERMS],
    count: usize,
}

impl Expansion {
    /// Zero.
    #[inline]
    pub fn new() -> Expansion {
        Expansion {
            terms: [0.0; TERMS],
            count: 0,
        }
    }

    /// Adds a number.
    pub fn add(&mut self, value: f64) {
        let (mut sum, mut kept) = (value, 0);
        for i in 0..self.count {
            let [next, error] = two_sum(sum, self.terms[i]);
            sum = next;
            if error != 0.0 {
                self.terms[kept] = error;
                kept += 1;
            }
        }
        if sum != 0.0 {
            self.terms[kept] = sum;
            kept += 1;
        }
        self.count = kept;
    }

    /// Adds a product of two.
    pub fn add_product(&mut self, a: f64, b: f64) {
        let [product, error] = two_product(a, b);
        self.add(error);
        self.add(product);
    }

    /// Adds a product of three.
    pub fn add_triple(&mut self, a: f64, b: f64, c: f64) {
        let [product, error] = two_product(a, b);
        if error != 0.0 {
            self.add_product(error, c);
        }
        self.add_product(product, c);
    }

    /// The sum, rounded to a few units in the last place: zero if and only if it is zero, and of
    /// the same sign.
    pub fn value(&self) -> f64 {
        self.terms[..self.count].iter().sum()
    }
}
