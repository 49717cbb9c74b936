//! Shaders' arithmetic: the interpreter's speed as a share of what the compiler makes of the same
//! operations for the same vectors.

mod large;
mod small;

use std::time::Instant;

use anyhow::{Context, Result, ensure};
use spirv_jit::Tier;
use waves::Waves;

#[derive(clap::Args)]
pub struct Options {
    /// Turns of each contestant; the best counts
    #[arg(long, default_value_t = 40)]
    turns: usize,
}

/// Three columns of inputs, one number a lane, to one of outputs.
type Native = fn([&[f32]; 3], &mut [f32]);

/// `$native` compiled for the two vector instruction sets, as `for_tier`.
macro_rules! compiled {
    ($native:ident) => {
        pub fn for_tier(tier: spirv_jit::Tier) -> Option<super::Native> {
            #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma")]
            fn avx512(inputs: [&[f32]; 3], out: &mut [f32]) {
                $native(inputs, out);
            }
            #[target_feature(enable = "avx2,fma")]
            fn avx2(inputs: [&[f32]; 3], out: &mut [f32]) {
                $native(inputs, out);
            }
            use spirv_jit::Tier;
            match tier {
                // SAFETY: the caller has checked that the machine has the tier.
                Tier::Avx512 => Some(|inputs, out| unsafe { avx512(inputs, out) }),
                // SAFETY: the caller has checked that the machine has the tier.
                Tier::Avx2 => Some(|inputs, out| unsafe { avx2(inputs, out) }),
                Tier::Portable => None,
            }
        }
    };
}
use compiled;

/// A kernel in two forms, and the share of native speed that is wanted of each tier.
struct Kernel {
    name: &'static str,
    text: fn() -> String,
    native: fn(Tier) -> Option<Native>,
    wanted_avx512: f64,
    wanted_avx2: f64,
}

const KERNELS: [Kernel; 2] = [
    Kernel {
        name: "small",
        text: small::text,
        native: small::for_tier,
        wanted_avx512: 0.40,
        wanted_avx2: 0.30,
    },
    Kernel {
        name: "100 values",
        text: large::text,
        native: large::for_tier,
        wanted_avx512: 0.30,
        wanted_avx2: 0.22,
    },
];

/// Lanes of a turn, about.
const LANES: usize = 1 << 14;

pub fn run(options: &Options) -> Result<()> {
    println!("| kernel | vectors | lanes a wave | interpreter | native | share | wanted |");
    println!("| --- | --- | ---: | ---: | ---: | ---: | ---: |");
    for kernel in &KERNELS {
        for &tier in Tier::available() {
            let Some(native) = (kernel.native)(tier) else {
                continue;
            };
            let mut bench = Bench::new(&(kernel.text)(), tier)?;
            let [interpreter, native] = bench.measure(native, options.turns)?;
            let wanted = match tier {
                Tier::Avx512 => kernel.wanted_avx512,
                _ => kernel.wanted_avx2,
            };
            println!(
                "| {} | {tier:?} | {} | {interpreter:.2} ns | {native:.2} ns | {:.0} % | {:.0} % |",
                kernel.name,
                bench.waves.lanes_a_wave(),
                100.0 * native / interpreter,
                100.0 * wanted,
            );
        }
    }
    println!(
        "\nnanoseconds a lane, best of {} turns, in turn",
        options.turns
    );
    Ok(())
}

/// A program, and inputs for both contestants.
struct Bench {
    waves: Waves,
    columns: [Vec<f32>; 3],
    out: Vec<f32>,
}

impl Bench {
    fn new(text: &str, tier: Tier) -> Result<Bench> {
        let mut waves = Waves::new(text, Some(tier), LANES).context("the kernel")?;
        let lanes = waves.lanes();
        let value = |lane: usize, k: usize| {
            ((lane * 3 + k) as u32).wrapping_mul(2_654_435_761) as f32 / 4_294_967_296.0
        };
        let columns: [Vec<f32>; 3] =
            std::array::from_fn(|k| (0..lanes).map(|lane| value(lane, k)).collect());
        for (number, column) in columns.iter().enumerate() {
            waves.set_input(number, |lane| column[lane].to_bits());
        }
        Ok(Bench {
            waves,
            columns,
            out: vec![0.0; lanes],
        })
    }

    /// Best nanoseconds a lane of the interpreter and of native code, once they agree.
    fn measure(&mut self, native: Native, turns: usize) -> Result<[f64; 2]> {
        let mut best = [f64::INFINITY; 2];
        for turn in 0..=turns {
            let seconds = [self.interpret()?, self.compute(native)];
            self.check()?;
            for (best, seconds) in best.iter_mut().zip(seconds) {
                // The first turn warms up.
                if turn > 0 {
                    *best = best.min(seconds * 1e9 / self.out.len() as f64);
                }
            }
        }
        Ok(best)
    }

    fn compute(&mut self, native: Native) -> f64 {
        let [x, y, z] = &self.columns;
        let start = Instant::now();
        native([x, y, z], &mut self.out);
        start.elapsed().as_secs_f64()
    }

    fn interpret(&mut self) -> Result<f64> {
        self.waves.restart();
        let start = Instant::now();
        self.waves.run()?;
        Ok(start.elapsed().as_secs_f64())
    }

    fn check(&self) -> Result<()> {
        for (lane, (got, wanted)) in self.waves.results().zip(&self.out).enumerate() {
            ensure!(
                got == wanted.to_bits(),
                "lane {lane}: the interpreter says {}, native code {wanted}",
                f32::from_bits(got)
            );
        }
        Ok(())
    }
}
