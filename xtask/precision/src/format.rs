//! Binary formats of floats, and errors in them.

use half::f16;
use spirv_jit::ir::Type;

use super::functions::Allowance;

/// A binary format of floats.
#[derive(Clone, Copy, Debug)]
pub struct Format {
    pub ty: Type,
    /// Bits of the significand after the point.
    fraction: i32,
    least_exponent: i32,
    greatest_exponent: i32,
}

pub const F32: Format = Format {
    ty: Type::F32,
    fraction: 23,
    least_exponent: -126,
    greatest_exponent: 127,
};

pub const F16: Format = Format {
    ty: Type::F16,
    fraction: 10,
    least_exponent: -14,
    greatest_exponent: 15,
};

impl Format {
    pub fn value(self, bits: u32) -> f64 {
        match self.ty {
            Type::F16 => f16::from_bits(bits as u16).to_f64(),
            _ => f32::from_bits(bits) as f64,
        }
    }

    /// The last place of a number in this format.
    pub fn unit(self, exact: f64) -> f64 {
        let exponent = (exact.to_bits() >> 52 & 0x7ff) as i32 - 1023;
        let exponent = exponent.clamp(self.least_exponent, self.greatest_exponent);
        power_of_two(exponent - self.fraction)
    }

    /// How far a result is off, in units of the exact one's last place. What is past the greatest
    /// number counts as the next one after it.
    pub fn error(self, got: f64, exact: f64) -> f64 {
        if got.is_nan() || exact.is_nan() {
            return if got.is_nan() && exact.is_nan() {
                0.0
            } else {
                f64::INFINITY
            };
        }
        let end = power_of_two(self.greatest_exponent + 1);
        let (got, exact) = (got.clamp(-end, end), exact.clamp(-end, end));
        (got - exact).abs() / self.unit(exact)
    }

    /// Whether a result is the exact one, rounded.
    pub fn is_rounded(self, got: f64, exact: f64) -> bool {
        match self.ty {
            Type::F16 => got == f16::from_f64(exact).to_f64(),
            _ => got == (exact as f32) as f64,
        }
    }

    /// The allowance at an input, in the same units.
    pub fn allowed(self, allowance: Allowance, x: f64, exact: f64) -> f64 {
        let half = matches!(self.ty, Type::F16);
        let absolute = |exponent: i32| power_of_two(exponent) / self.unit(exact);
        match allowance {
            Allowance::Correct => 0.5,
            Allowance::ArcTangent => {
                if half {
                    5.0
                } else {
                    4096.0
                }
            }
            Allowance::Ulp(units) | Allowance::Inherited(_, units) => units,
            Allowance::Exponential if x.is_infinite() => 0.5,
            Allowance::Exponential => 2.0f64.mul_add(x.abs(), if half { 1.0 } else { 3.0 }),
            Allowance::Logarithm if (0.5..=2.0).contains(&x) => {
                absolute(if half { -7 } else { -21 })
            }
            Allowance::Logarithm => 3.0,
            Allowance::Circular if x.abs() <= 3.1415927410125732 => {
                absolute(if half { -7 } else { -11 })
            }
            Allowance::Circular => f64::INFINITY,
        }
    }
}

fn power_of_two(exponent: i32) -> f64 {
    f64::from_bits(((exponent + 1023) as u64) << 52)
}
