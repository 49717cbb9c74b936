//! All measurements, and the page that shows them.

use std::fmt::Write;

use super::format::{F16, F32, Format};
use super::functions::{Allowance, Domain, SEVERAL, UNARY};
use super::measure::{self, Options, Worst};

#[derive(Debug)]
pub struct OperationError {
    name: &'static str,
    half: bool,
    inputs: String,
    operands: usize,
    worst: Worst,
    allowance: Allowance,
    bound: f64,
}

impl OperationError {
    /// Inside what Vulkan allows and what we hold ourselves to.
    pub fn holds(&self) -> bool {
        self.worst.share <= 1.0 && self.worst.error <= self.bound
    }
}

/// A 16-bit result is a 32-bit one rounded again.
const HALF_BOUND: f64 = 0.51;

pub fn measure_all(options: &Options) -> Vec<OperationError> {
    let mut rows = Vec::new();
    for format in [F32, F16] {
        let half = half(format);
        for function in UNARY {
            eprint!("{} …", function.name);
            let worst = measure::unary(function, format, options);
            eprintln!(" {:.3}", worst.error);
            let inputs = match function.domain {
                Domain::All if half || worst.count == 1 << 32 => "all".into(),
                Domain::All => thousands(worst.count),
                Domain::UpTo(end) => format!("abs(x) ≤ {}", number(end)),
                Domain::Between(start, end) => format!(
                    "{} < abs(x) ≤ {}, {}",
                    number(start),
                    number(end),
                    thousands(worst.count)
                ),
            };
            rows.push(OperationError {
                name: function.name,
                half,
                inputs,
                operands: 1,
                worst,
                allowance: function.allowance,
                bound: if half { HALF_BOUND } else { function.bound },
            });
        }
        for function in SEVERAL {
            eprint!("{} …", function.name);
            let worst = measure::several(function, format, options);
            eprintln!(" {:.3}", worst.error);
            rows.push(OperationError {
                name: function.name,
                half,
                inputs: format!("{} samples", thousands(worst.count)),
                operands: function.arity,
                worst,
                allowance: function.allowance,
                bound: if half { HALF_BOUND } else { function.bound },
            });
        }
    }
    rows
}

fn half(format: Format) -> bool {
    format.ty == spirv_jit::ir::Type::F16
}

/// The page.
pub fn render(rows: &[OperationError], options: &Options) -> String {
    let coverage = match options.step.get() {
        1 => "all 2³² inputs".into(),
        step => format!("every {}th of the 2³² inputs", thousands(step)),
    };
    let mut text = format!(
        "# Precision\n\n\
        The greatest error of each float function, against a reference of 64 bits, next to what Vulkan's\n\
        \"Precision of Individual Operations\" allows. `cargo xtask precision` measures this and writes the\n\
        page: functions of one 32-bit float over {coverage} (of their domain), of one 16-bit float over\n\
        all 65,536, of several over structured and random samples. Errors are in units of the exact result's\n\
        last place (ULP): 0.5 is correct rounding. \"Share\" is the greatest share of the allowance that any\n\
        input uses.\n\n\
        All tiers of the interpreter give the same bits; denormals are kept, and count here as any other\n\
        number. Where an entry point asks for it (`DenormFlushToZero`), results of 32 bits that are denormal\n\
        become zeros of the same sign, after the function; operands are not flushed.\n\n\
        What Vulkan derives from an expression of other functions is allowed at least what the last of them\n\
        is. A power whose exponent is a constant from 1 to 5 is multiplied, but with `TUFF_ACCURACY=exact`:\n\
        up to 2.9 ULP, where Vulkan allows 3 and 2.8 for each unit of the exponent.\n"
    );
    for (half, title) in [(false, "32 bits"), (true, "16 bits")] {
        let _ = write!(
            text,
            "\n## {title}\n\n| function | inputs | error, ULP | at | Vulkan allows | share |\n| --- | --- | --- | --- | --- | --- |\n"
        );
        for row in rows.iter().filter(|row| row.half == half) {
            let at: Vec<String> = row.worst.at[..row.operands]
                .iter()
                .map(|&x| format!("{x:e}"))
                .collect();
            let _ = writeln!(
                text,
                "| {} | {} | {} | {} | {} | {} |",
                row.name,
                row.inputs,
                error(row.worst.error),
                if row.worst.error <= 0.5 {
                    String::new()
                } else {
                    at.join(", ")
                },
                allowed(row.allowance, half),
                share(row),
            );
        }
    }
    text.push_str(PRODUCTS);
    text
}

/// Sums have an order, not a measured error.
const PRODUCTS: &str = "
## Products of matrices

An element of `OpCooperativeMatrixMulAddKHR` is summed in one order, the same on every tier and
machine: it begins with the element of `C` and goes on with the products, that of the first column
of `A` and the first row of `B` first. Products and sums are f32, each rounded by itself; products
of 16-bit floats are exact. A result of 16 bits, of either encoding, is rounded once, from the last
sum. Integers are exact: the products and the element of `C` are added, then wrapped, or clamped
with `SaturatingAccumulationKHR`. `OpDot` of bfloat16 sums from the first component on, in f32, and
rounds once.

A component of `OpCooperativeVectorMatrixMulNV` and `OpCooperativeVectorMatrixMulAddNV` is summed
in the same way: it begins with the bias, or with 0, and goes on with the products, that of the
first column first. Products and sums are f32, each rounded by itself; products of floats of 16 and
8 bits are exact. A 16-bit result is rounded once, from the last sum. Integers are exact, and wrap.
An input of 16-bit floats that is read as 8-bit floats keeps its 16 bits.

Conversions to bfloat16 round once, to the nearest even number, from every float and from integers
of up to 32 bits. Integers of 64 bits become an f64 first.
";

fn error(units: f64) -> String {
    match units {
        0.0 => "0".into(),
        units if units <= 0.5 => "0.5".into(),
        units => format!("{units:.3}"),
    }
}

fn allowed(allowance: Allowance, half: bool) -> String {
    let absolute = if half { "2⁻⁷" } else { "2⁻¹¹" };
    match allowance {
        Allowance::Correct => "correct rounding".into(),
        Allowance::ArcTangent => format!("{} ULP", if half { 5 } else { 4096 }),
        Allowance::Ulp(units) => format!("{units} ULP"),
        Allowance::Exponential => format!("{} + 2 abs(x) ULP", if half { 1 } else { 3 }),
        Allowance::Logarithm => {
            let inside = if half { "2⁻⁷" } else { "2⁻²¹" };
            format!("3 ULP; {inside} absolutely in [0.5, 2]")
        }
        Allowance::Circular => format!("{absolute} absolutely in [−π, π]"),
        Allowance::Inherited(expression, _) => format!("that of {expression}"),
    }
}

fn share(row: &OperationError) -> String {
    match row.allowance {
        Allowance::Inherited(..) => String::new(),
        _ if row.worst.share == 0.0 => String::new(),
        _ => format!("{:.0} %", (100.0 * row.worst.share).ceil()),
    }
}

fn number(value: f64) -> String {
    if value == (1u64 << 50) as f64 {
        "2⁵⁰".into()
    } else if value == std::f32::consts::PI as f64 {
        "π".into()
    } else {
        value.to_string()
    }
}

fn thousands(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}
