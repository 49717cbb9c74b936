//! Functions of shaders: nanoseconds a lane in the interpreter, and error in units in the last
//! place.

use std::fmt::Write as _;
use std::hint::black_box;

use anyhow::{Result, ensure};
use canvas::{Axis, Mark, Point, Scatter, save, short};
use spirv_jit::{Accuracy, eval};
use waves::Waves;

use crate::Options;
use crate::report::Report;
use crate::timing::alternate;

/// A function of one or two numbers, as each accuracy computes it.
struct Function {
    name: &'static str,
    op: &'static str,
    operands: usize,
    /// Where errors are measured.
    domain: [f32; 2],
    /// Whether arguments are spread evenly by their logarithm.
    by_size: bool,
    spec: fn(f32, f32) -> f32,
    fast: Option<fn(f32, f32) -> f32>,
    /// In f64, rounded by the caller; `None`: one rounding already.
    wide: Option<fn(f64, f64) -> f64>,
    truth: fn(f64, f64) -> f64,
}

const TAU: f32 = std::f32::consts::TAU;

const FUNCTIONS: &[Function] = &[
    Function {
        name: "sin",
        op: "fsin",
        operands: 1,
        domain: [-TAU, TAU],
        by_size: false,
        spec: |x, _| eval::fsin(x),
        fast: Some(|x, _| eval::fsin_fast(x)),
        wide: Some(|x, _| x.sin()),
        truth: |x, _| x.sin(),
    },
    Function {
        name: "cos",
        op: "fcos",
        operands: 1,
        domain: [-TAU, TAU],
        by_size: false,
        spec: |x, _| eval::fcos(x),
        fast: Some(|x, _| eval::fcos_fast(x)),
        wide: Some(|x, _| x.cos()),
        truth: |x, _| x.cos(),
    },
    Function {
        name: "tan",
        op: "ftan",
        operands: 1,
        domain: [-1.5, 1.5],
        by_size: false,
        spec: |x, _| eval::ftan(x),
        fast: Some(|x, _| eval::ftan_fast(x)),
        wide: Some(|x, _| x.tan()),
        truth: |x, _| x.tan(),
    },
    Function {
        name: "atan2",
        op: "fatan2",
        operands: 2,
        domain: [-10.0, 10.0],
        by_size: false,
        spec: eval::fatan2,
        fast: Some(eval::fatan2_fast),
        wide: Some(f64::atan2),
        truth: f64::atan2,
    },
    Function {
        name: "exp2",
        op: "fexp2",
        operands: 1,
        domain: [-30.0, 30.0],
        by_size: false,
        spec: |x, _| eval::fexp2(x),
        fast: Some(|x, _| eval::fexp2_fast(x)),
        wide: Some(|x, _| x.exp2()),
        truth: |x, _| x.exp2(),
    },
    Function {
        name: "log2",
        op: "flog2",
        operands: 1,
        domain: [1e-6, 1e6],
        by_size: true,
        spec: |x, _| eval::flog2(x),
        fast: Some(|x, _| eval::flog2_fast(x)),
        wide: Some(|x, _| x.log2()),
        truth: |x, _| x.log2(),
    },
    Function {
        name: "pow",
        op: "fpow",
        operands: 2,
        domain: [0.01, 10.0],
        by_size: true,
        spec: eval::fpow,
        fast: Some(eval::fpow_fast),
        wide: Some(f64::powf),
        truth: f64::powf,
    },
    Function {
        name: "inversesqrt",
        op: "finverse_sqrt",
        operands: 1,
        domain: [1e-6, 1e6],
        by_size: true,
        spec: |x, _| eval::finverse_sqrt(x),
        fast: Some(|x, _| eval::finverse_sqrt_fast(x)),
        wide: Some(|x, _| 1.0 / x.sqrt()),
        truth: |x, _| 1.0 / x.sqrt(),
    },
    Function {
        name: "sqrt",
        op: "fsqrt",
        operands: 1,
        domain: [1e-6, 1e6],
        by_size: true,
        spec: |x, _| eval::fsqrt(x),
        fast: None,
        wide: None,
        truth: |x, _| x.sqrt(),
    },
    Function {
        name: "division",
        op: "fdiv",
        operands: 2,
        domain: [0.01, 100.0],
        by_size: true,
        spec: eval::fdiv,
        fast: None,
        wide: None,
        truth: |x, y| x / y,
    },
];

/// Operations in a program.
const REPEATED: u32 = 16;

/// A program that applies a function again and again to its inputs and adds the results.
fn text(function: &Function, accuracy: Accuracy) -> String {
    let mut text = String::from(
        "module closest_hit\ninputs payload.0, payload.1\noutput_rows 1\nfunc f0 {\n\
         v0: i32 = input[0]\nv1: i32 = input[1]\nv2: f32 = bitcast v0\nv3: f32 = bitcast v1\n",
    );
    let (mut next, mut sum) = (4, 2);
    let mut line = |ty: &str, what: String| {
        let value = next;
        next += 1;
        let _ = writeln!(text, "v{value}: {ty} = {what}");
        value
    };
    for _ in 0..REPEATED {
        let operands = [2, 3];
        let operands = &operands[..function.operands];
        let list = |values: &[i32]| {
            let names: Vec<String> = values.iter().map(|value| format!("v{value}")).collect();
            names.join(", ")
        };
        let op = function.op;
        let result = match accuracy {
            Accuracy::Spec => line("f32", format!("{op} {}", list(operands))),
            Accuracy::Fast => line("f32", format!("{op}_fast {}", list(operands))),
            Accuracy::Exact => {
                let wide: Vec<i32> = operands
                    .iter()
                    .map(|operand| line("f64", format!("fconvert v{operand}")))
                    .collect();
                let result = line("f64", format!("{op} {}", list(&wide)));
                line("f32", format!("fconvert v{result}"))
            }
        };
        sum = line("f32", format!("fadd v{sum}, v{result}"));
    }
    let _ = writeln!(text, "end(v{sum})\n}}");
    text
}

/// The program of a function with its arguments, one wave.
fn waves(function: &Function, accuracy: Accuracy) -> Result<Waves> {
    let mut waves = Waves::new(&text(function, accuracy), None, 1)?;
    for number in 0..2 {
        waves.set_input(number, |lane| {
            argument(function, (2 * lane + number) as u32).to_bits()
        });
    }
    Ok(waves)
}

/// An argument inside the domain.
fn argument(function: &Function, number: u32) -> f32 {
    let share = f64::from(number.wrapping_mul(2_654_435_761)) / 4_294_967_296.0;
    let [low, high] = function.domain.map(f64::from);
    if function.by_size {
        (low.ln() + share * (high / low).ln()).exp() as f32
    } else {
        (low + share * (high - low)) as f32
    }
}

/// The greatest and the mean error, in units of the exact result's last place.
fn errors(function: &Function, accuracy: Accuracy, samples: u32) -> (f64, f64) {
    let (mut worst, mut sum) = (0f64, 0f64);
    for number in 0..samples {
        let x = argument(function, 2 * number);
        let y = argument(function, 2 * number + 1);
        let exact = (function.truth)(f64::from(x), f64::from(y));
        let got = match (accuracy, function.fast, function.wide) {
            (Accuracy::Fast, Some(fast), _) => fast(x, y),
            (Accuracy::Exact, _, Some(wide)) => wide(f64::from(x), f64::from(y)) as f32,
            _ => (function.spec)(x, y),
        };
        let size = exact.abs().max(f64::from(f32::MIN_POSITIVE));
        let unit = 2f64.powi(size.log2().floor() as i32 - 23);
        let error = (f64::from(got) - exact).abs() / unit;
        worst = worst.max(error);
        sum += error;
    }
    (worst, sum / f64::from(samples))
}

/// The measurements of one function.
struct FunctionMeasurement {
    accuracy: Accuracy,
    name: &'static str,
    cost: f64,
    worst: f64,
    mean: f64,
}

fn rows(rounds: usize, samples: u32) -> Result<Vec<FunctionMeasurement>> {
    const RUNS: usize = 40;
    let mut benches = Vec::new();
    for function in FUNCTIONS {
        for (_, accuracy) in Accuracy::ALL {
            let exists = match accuracy {
                Accuracy::Fast => function.fast.is_some(),
                Accuracy::Spec => true,
                Accuracy::Exact => function.wide.is_some(),
            };
            if exists {
                benches.push((function, accuracy, waves(function, accuracy)?));
            }
        }
    }
    let lanes = benches.iter().map(|(.., waves)| waves.lanes() as f64);
    let lanes: Vec<f64> = lanes.collect();
    let mut runs: Vec<Box<dyn FnMut() + '_>> = Vec::new();
    for (.., waves) in &mut benches {
        runs.push(Box::new(move || {
            for _ in 0..RUNS {
                waves.restart();
                waves.run().expect("functions run to their end");
            }
            black_box(waves.results().next());
        }));
    }
    let times = alternate(rounds, &mut runs);
    drop(runs);
    let rows = benches.iter().zip(times).zip(lanes);
    Ok(rows
        .map(|(((function, accuracy, _), time), lanes)| {
            let (worst, mean) = errors(function, *accuracy, samples);
            let operations = RUNS as f64 * lanes * f64::from(REPEATED);
            FunctionMeasurement {
                accuracy: *accuracy,
                name: function.name,
                cost: time / operations * 1e9,
                worst,
                mean,
            }
        })
        .collect())
}

pub fn measure(options: &Options, report: &mut Report) -> Result<()> {
    let (rounds, samples) = if options.quick {
        (10, 50_000)
    } else {
        (60, 1_000_000)
    };
    let rows = rows(rounds, samples)?;
    ensure!(!rows.is_empty(), "no function was measured");
    let mut points = Vec::new();
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let mut table: Vec<Vec<String>> = Vec::new();
    let mut last = "";
    for row in &rows {
        let accuracy = row.accuracy.name();
        for (what, value) in [
            ("ns", row.cost),
            ("max ULP", row.worst),
            ("mean ULP", row.mean),
        ] {
            report.number(
                "functions",
                &format!("{} {accuracy}", row.name),
                what,
                value,
            );
        }
        if row.name != last {
            groups.push(Vec::new());
            let mut cells = vec![String::new(); 1 + 2 * Accuracy::ALL.len()];
            cells[0] = row.name.into();
            table.push(cells);
            last = row.name;
        }
        if let Some(cells) = table.last_mut() {
            let place = Accuracy::ALL.iter().position(|(_, it)| *it == row.accuracy);
            let place = 1 + 2 * place.unwrap_or(0);
            cells[place] = short(row.cost);
            cells[place + 1] = short(row.worst);
        }
        if let Some(group) = groups.last_mut() {
            group.push(points.len());
        }
        let chosen = row.accuracy == Accuracy::Spec;
        points.push(Point {
            label: if chosen {
                row.name.into()
            } else {
                String::new()
            },
            x: row.cost,
            y: row.worst,
            mark: if chosen { Mark::Default } else { Mark::Ours },
        });
    }
    let columns = ["fast ns", "ULP", "spec ns", "ULP", "exact ns", "ULP"];
    report.table("Functions", &columns, &table);
    let scatter = Scatter {
        title: "Functions of f32: fast, spec (named) and exact, joined".into(),
        x: Axis::of(
            "ns a lane, in the interpreter",
            points.iter().map(|point| point.x),
        ),
        y: Axis::of("greatest error, ULP", points.iter().map(|point| point.y)),
        points,
        groups,
        foot: report.foot(),
    };
    save(&scatter, &options.out, "functions")
}
