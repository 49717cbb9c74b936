//! The cost of keeping denormal numbers, and the loss from flushing them.

use anyhow::Result;
use canvas::{Axis, Mark, Point, Scatter, save};

use crate::Options;
use crate::report::Report;
use crate::timing::alternate;

const STEPS: usize = 1 << 16;

/// Multiplies and adds vectors of `start` in one chain of `STEPS`, with the control register as
/// given. All of it is in assembly: Rust's own arithmetic must not run with another control
/// register. Returns the first lane.
#[cfg(target_arch = "x86_64")]
fn chain(start: f32, factor: f32, flush: bool) -> f32 {
    const DEFAULT: u32 = 0x1F80;
    const FLUSH: u32 = DEFAULT | 1 << 15 | 1 << 6;
    let control = if flush { FLUSH } else { DEFAULT };
    let saved = DEFAULT;
    let mut lanes = [start; 4];
    let factors = [factor; 4];
    // SAFETY: reads and writes the arrays only, and leaves the control register as every Rust
    // program has it.
    unsafe {
        std::arch::asm!(
            "ldmxcsr [{control}]",
            "movups {x}, [{lanes}]",
            "movups {f}, [{factors}]",
            "movups {s}, [{lanes}]",
            "2:",
            "mulps {x}, {f}",
            "addps {x}, {s}",
            "dec {count}",
            "jnz 2b",
            "movups [{lanes}], {x}",
            "ldmxcsr [{saved}]",
            control = in(reg) &control,
            saved = in(reg) &saved,
            lanes = in(reg) lanes.as_mut_ptr(),
            factors = in(reg) factors.as_ptr(),
            count = inout(reg) STEPS => _,
            x = out(xmm_reg) _,
            f = out(xmm_reg) _,
            s = out(xmm_reg) _,
            options(nostack),
        );
    }
    lanes[0]
}

#[cfg(target_arch = "x86_64")]
pub fn measure(options: &Options, report: &mut Report) -> Result<()> {
    // x ← x/2 + s converges to 2 s.
    const NORMAL: f32 = 1.5;
    const DENORMAL: f32 = 3.0e-40;
    let cases = [
        ("normal numbers, kept", NORMAL, false, Mark::Other),
        ("normal numbers, flushing", NORMAL, true, Mark::Other),
        ("denormal numbers, kept", DENORMAL, false, Mark::Default),
        ("denormal numbers, flushed", DENORMAL, true, Mark::Other),
    ];
    let mut runs: Vec<Box<dyn FnMut()>> = Vec::new();
    for (_, start, flush, _) in cases {
        runs.push(Box::new(move || {
            std::hint::black_box(chain(start, 0.5, flush));
        }));
    }
    let times = alternate(if options.quick { 10 } else { 100 }, &mut runs);
    let (mut points, mut rows) = (Vec::new(), Vec::new());
    for ((label, start, flush, mark), time) in cases.into_iter().zip(times) {
        let expected = 2.0 * f64::from(start);
        let off = (f64::from(chain(start, 0.5, flush)) - expected).abs() / expected;
        let (cost, error) = (
            time / STEPS as f64 * 1e9,
            if off < 1e-5 { 0.0 } else { off },
        );
        rows.push(vec![
            label.to_string(),
            format!("{cost:.2}"),
            format!("{:.0} %", error * 100.0),
        ]);
        report.number("denormals", label, "ns", cost);
        report.number("denormals", label, "error", error);
        points.push(Point {
            label: label.into(),
            x: cost,
            y: error * 100.0,
            mark,
        });
    }
    report.table(
        "Denormal numbers",
        &["ns a step", "error of the result"],
        &rows,
    );
    let scatter = Scatter {
        title: "Denormal numbers: one multiplication and one addition of four".into(),
        x: Axis::of("ns a step", points.iter().map(|point| point.x)),
        y: Axis::of("error of the result, %", points.iter().map(|point| point.y)),
        points,
        // Kept and flushed, of each kind of numbers.
        groups: vec![vec![0, 1], vec![2, 3]],
        foot: report.foot(),
    };
    save(&scatter, &options.out, "denormals")
}

#[cfg(not(target_arch = "x86_64"))]
pub fn measure(_: &Options, _: &mut Report) -> Result<()> {
    eprintln!("there is no assembly for this processor");
    Ok(())
}
