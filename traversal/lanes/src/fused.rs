//! C's fused multiplication and addition, by which `mul_add` is compiled for processors without the
//! instruction. MinGW's `fmaf` rounds twice; these round once, as C's standard has it. The linker
//! takes them before those of a library. They are in this crate because all that compute depend on
//! it, their tests too.

/// `a × b + c`, rounded once.
#[unsafe(no_mangle)]
extern "C" fn fmaf(a: f32, b: f32, c: f32) -> f32 {
    libm::fmaf(a, b, c)
}

/// `a × b + c`, rounded once.
#[unsafe(no_mangle)]
extern "C" fn fma(a: f64, b: f64, c: f64) -> f64 {
    libm::fma(a, b, c)
}

#[cfg(test)]
mod tests {
    use std::hint::black_box;

    /// The exact sum is just below the middle of two numbers. Rounded to 53 bits it is the middle,
    /// and would then be rounded up to the even one.
    #[test]
    fn sums_are_rounded_once() {
        let more = black_box(1.0 + f32::EPSILON);
        let less = black_box((1.0 - f32::EPSILON) * (f32::EPSILON / 2.0));
        assert_eq!(more.mul_add(less, more), more);
        let factor = black_box(1.0 + f64::EPSILON);
        let rest = factor.mul_add(factor, -(1.0 + 2.0 * f64::EPSILON));
        assert_eq!(rest, f64::EPSILON * f64::EPSILON);
    }
}
