//! The functions, their references, and what Vulkan's "Precision of Individual Operations" allows
//! each.

/// The allowance of the specification.
#[derive(Clone, Copy, Debug)]
pub enum Allowance {
    /// "Correctly rounded" or "correct result".
    Correct,
    /// In units of the last place.
    Ulp(f64),
    /// 4,096 units (5 of 16 bits).
    ArcTangent,
    /// 3 + 2|x| units (1 + 2|x| of 16 bits).
    Exponential,
    /// Units outside [0.5, 2], 2^-21 (2^-7) absolutely inside.
    Logarithm,
    /// 2^-11 (2^-7) absolutely in [−π, π], nothing outside.
    Circular,
    /// Whatever this expression of other functions has; we hold ourselves to the units given.
    Inherited(&'static str, f64),
}

/// The inputs of a row of the table.
#[derive(Clone, Copy, Debug)]
pub enum Domain {
    All,
    /// |x| up to this.
    UpTo(f64),
    /// |x| from the first to the second.
    Between(f64, f64),
}

impl Domain {
    pub fn contains(self, x: f64) -> bool {
        match self {
            Domain::All => true,
            Domain::UpTo(end) => x.abs() <= end,
            Domain::Between(start, end) => x.abs() > start && x.abs() <= end,
        }
    }
}

/// Which of the 2^32 inputs are taken.
pub enum Sampling {
    All,
    Every(u64),
}

pub struct Unary {
    pub name: &'static str,
    /// The operation in the IR's text.
    pub operation: &'static str,
    pub exact: fn(f64) -> f64,
    pub allowance: Allowance,
    pub domain: Domain,
    /// The bound of 32-bit results, in units of the last place; 16-bit ones must be within half a
    /// unit and a little.
    pub bound: f64,
}

use Allowance::{ArcTangent, Circular, Correct, Exponential, Inherited, Logarithm, Ulp};
use Domain::{All, Between, UpTo};

impl Unary {
    /// A function of a few processor instructions, or outside Vulkan's promises, is not worth all
    /// inputs.
    pub fn sampling(&self) -> Sampling {
        match (self.allowance, self.domain) {
            (Correct, _) | (_, Between(..)) => Sampling::Every(31),
            _ => Sampling::All,
        }
    }
}

/// π, rounded to 32 bits.
const PI_32: f64 = std::f32::consts::PI as f64;

/// 2^50: up to here our reduction by π/2 keeps all bits of a result.
const FAR: f64 = (1u64 << 50) as f64;

macro_rules! unary {
    ($($name:literal $operation:literal $exact:expr, $allowance:expr, $domain:expr, $bound:literal;)*) => {
        pub const UNARY: &[Unary] = &[$(Unary {
            name: $name,
            operation: $operation,
            exact: $exact,
            allowance: $allowance,
            domain: $domain,
            bound: $bound,
        },)*];
    };
}
unary! {
    "sin" "fsin" sin, Circular, UpTo(PI_32), 1.6;
    "sin" "fsin" sin, Circular, Between(PI_32, FAR), 1.6;
    "cos" "fcos" cos, Circular, UpTo(PI_32), 1.6;
    "cos" "fcos" cos, Circular, Between(PI_32, FAR), 1.6;
    "tan" "ftan" tan, Inherited("sin x / cos x", 1e6), UpTo(FAR), 3.5;
    "asin" "fasin" asin, Inherited("atan2(x, √(1 − x²))", 4096.0), All, 4.0;
    "acos" "facos" f64::acos, Inherited("atan2(√(1 − x²), x)", 4096.0), All, 4.0;
    "atan" "fatan" atan, ArcTangent, All, 3.0;
    "sinh" "fsinh" sinh, Inherited("(exp x − exp −x) / 2", 3.0), All, 0.6;
    "cosh" "fcosh" f64::cosh, Inherited("(exp x + exp −x) / 2", 3.0), All, 0.6;
    "tanh" "ftanh" tanh, Inherited("sinh x / cosh x", 3.0), All, 0.6;
    "asinh" "fasinh" asinh, Inherited("log(x + √(x² + 1))", 3.0), All, 0.6;
    "acosh" "facosh" f64::acosh, Inherited("log(x + √(x² − 1))", 3.0), All, 0.6;
    "atanh" "fatanh" atanh, Inherited("log((1 + x) / (1 − x)) / 2", 3.0), All, 0.6;
    "exp" "fexp" exp, Exponential, All, 1.5;
    "exp2" "fexp2" exp2, Exponential, All, 1.5;
    "log" "flog" f64::ln, Logarithm, All, 1.5;
    "log2" "flog2" f64::log2, Logarithm, All, 1.5;
    "inverseSqrt" "finverse_sqrt" |x| 1.0 / x.sqrt(), Ulp(2.0), All, 1.6;
    "sqrt" "fsqrt" f64::sqrt, Inherited("1 / inverseSqrt x", 2.0), All, 0.5;
    "floor" "ffloor" f64::floor, Correct, All, 0.5;
    "ceil" "fceil" f64::ceil, Correct, All, 0.5;
    "trunc" "ftrunc" f64::trunc, Correct, All, 0.5;
    "round" "fround" f64::round, Correct, All, 0.5;
    "roundEven" "fround_even" f64::round_ties_even, Correct, All, 0.5;
    "fract" "ffract" fract, Correct, All, 0.5;
    "fabs" "fabs" f64::abs, Correct, All, 0.5;
}

/// Below this a function with f(x) = x + c x³ + … is its first two terms, to far more than 64 bits
/// can say.
const LINEAR: f64 = 1e-6;

macro_rules! odd {
    ($($name:ident $cubic:expr;)*) => {$(
        fn $name(x: f64) -> f64 {
            if x.abs() < LINEAR { x + $cubic * x * x * x } else { f64::$name(x) }
        }
    )*};
}
odd! {
    sin -1.0 / 6.0;
    tan 1.0 / 3.0;
    asin 1.0 / 6.0;
    atan -1.0 / 3.0;
    sinh 1.0 / 6.0;
    tanh -1.0 / 3.0;
    atanh 1.0 / 3.0;
}

/// By `ln_1p`, because the library's own formula cancels.
fn asinh(x: f64) -> f64 {
    let a = x.abs();
    let value = if a < LINEAR {
        a - a * a * a / 6.0
    } else if a > 1e150 {
        a.ln() + std::f64::consts::LN_2
    } else {
        (a + a * a / (1.0 + (a * a + 1.0).sqrt())).ln_1p()
    };
    value.copysign(x)
}

fn cos(x: f64) -> f64 {
    if x.abs() < LINEAR {
        1.0 - 0.5 * x * x
    } else {
        x.cos()
    }
}

fn exp(x: f64) -> f64 {
    if x.abs() < LINEAR {
        1.0 + x + 0.5 * x * x
    } else {
        x.exp()
    }
}

fn exp2(x: f64) -> f64 {
    if x.abs() < LINEAR {
        exp(x * std::f64::consts::LN_2)
    } else {
        x.exp2()
    }
}

fn fract(x: f64) -> f64 {
    x - x.floor()
}

pub struct Several {
    pub name: &'static str,
    pub operation: &'static str,
    pub arity: usize,
    /// The operands as 64-bit floats.
    pub exact: fn(&[f64; 3]) -> f64,
    pub allowance: Allowance,
    pub bound: f64,
}

macro_rules! several {
    ($($name:literal $operation:literal $arity:literal $exact:expr, $allowance:expr, $bound:literal;)*) => {
        pub const SEVERAL: &[Several] = &[$(Several {
            name: $name,
            operation: $operation,
            arity: $arity,
            exact: $exact,
            allowance: $allowance,
            bound: $bound,
        },)*];
    };
}
several! {
    "x + y" "fadd" 2 |v| v[0] + v[1], Correct, 0.5;
    "x − y" "fsub" 2 |v| v[0] - v[1], Correct, 0.5;
    "x · y" "fmul" 2 |v| v[0] * v[1], Correct, 0.5;
    "x / y" "fdiv" 2 |v| v[0] / v[1], Ulp(2.5), 0.5;
    "fma" "ffma" 3 fma, Inherited("x · y + z", 0.5), 0.5;
    "pow" "fpow" 2 |v| pow(v[0], v[1]), Inherited("exp2(y log2 x)", 3.0), 4.0;
    "atan2" "fatan2" 2 |v| v[0].atan2(v[1]), ArcTangent, 4.0;
}

/// Rounded to odd, so that the rounding to 32 bits which follows is the only one.
fn fma(v: &[f64; 3]) -> f64 {
    // The product of two 32-bit floats is exact.
    let product = v[0] * v[1];
    let sum = product + v[2];
    let lost = {
        let b = sum - product;
        (product - (sum - b)) + (v[2] - b)
    };
    if lost == 0.0 || !lost.is_finite() || sum.to_bits() & 1 == 1 {
        return sum;
    }
    // The neighbour on the side of what was lost has the odd last bit.
    let away = (lost > 0.0) == (sum > 0.0);
    f64::from_bits(if away {
        sum.to_bits() + 1
    } else {
        sum.to_bits() - 1
    })
}

/// As exp2(y log2 x) has it: NaN for negative x, 0⁰, ∞⁰ and 1^∞.
fn pow(x: f64, y: f64) -> f64 {
    if (y * x.log2()).is_nan() {
        f64::NAN
    } else {
        x.abs().powf(y)
    }
}
