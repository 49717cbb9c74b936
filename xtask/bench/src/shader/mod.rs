//! Shaders' arithmetic: the interpreter's speed as a share of what the compiler makes of the same operations for the same vectors.

mod large;
mod small;

use std::time::Instant;

use anyhow::{Context, Error, Result, ensure};
use spirv_jit::environment::Environment;
use spirv_jit::interp::TierKind;
use spirv_jit::ir::text::parse_module;
use spirv_jit::program::{AlignedRow, Event, Wave};
use spirv_jit::{Program, program::Frame};

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
        pub fn for_tier(tier: spirv_jit::interp::TierKind) -> Option<super::Native> {
            #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma")]
            fn avx512(inputs: [&[f32]; 3], out: &mut [f32]) {
                $native(inputs, out);
            }
            #[target_feature(enable = "avx2,fma")]
            fn avx2(inputs: [&[f32]; 3], out: &mut [f32]) {
                $native(inputs, out);
            }
            use spirv_jit::interp::TierKind;
            match tier {
                // SAFETY: whoever asks for a tier has seen that the machine has it.
                TierKind::Avx512 => Some(|inputs, out| unsafe { avx512(inputs, out) }),
                // SAFETY: as above.
                TierKind::Avx2 => Some(|inputs, out| unsafe { avx2(inputs, out) }),
                TierKind::Portable => None,
            }
        }
    };
}
use compiled;

/// A kernel in two forms, and the share of native speed that is wanted of each tier.
struct Kernel {
    name: &'static str,
    text: fn() -> String,
    native: fn(TierKind) -> Option<Native>,
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
        for &tier in TierKind::present() {
            let Some(native) = (kernel.native)(tier) else {
                continue;
            };
            let mut bench = Bench::new(&(kernel.text)(), tier)?;
            let [interpreter, native] = bench.measure(native, options.turns)?;
            let wanted = match tier {
                TierKind::Avx512 => kernel.wanted_avx512,
                _ => kernel.wanted_avx2,
            };
            println!(
                "| {} | {tier:?} | {} | {interpreter:.2} ns | {native:.2} ns | {:.0} % | {:.0} % |",
                kernel.name,
                bench.subgroups * 16,
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

/// A program, its states, and inputs for both contestants.
struct Bench {
    program: Program,
    frame: Frame,
    subgroups: usize,
    columns: [Vec<f32>; 3],
    states: Vec<Vec<AlignedRow>>,
    out: Vec<f32>,
}

impl Bench {
    fn new(text: &str, tier: TierKind) -> Result<Bench> {
        let module = parse_module(text).map_err(Error::msg)?;
        let program = Program::with_tier(&module, tier).context("the kernel")?;
        let subgroups = program.max_wave_subgroups();
        let lanes = LANES.next_multiple_of(subgroups * 16);
        let value = |lane: usize, k: usize| {
            ((lane * 3 + k) as u32).wrapping_mul(2_654_435_761) as f32 / 4_294_967_296.0
        };
        let rows = program.layout().rows;
        Ok(Bench {
            frame: Frame::default(),
            subgroups,
            columns: std::array::from_fn(|k| (0..lanes).map(|lane| value(lane, k)).collect()),
            states: vec![vec![AlignedRow::default(); rows]; lanes / 16],
            out: vec![0.0; lanes],
            program,
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
        let layout = self.program.layout();
        for (s, state) in self.states.iter_mut().enumerate() {
            self.program.start(state, !0);
            for (k, column) in self.columns.iter().enumerate() {
                state[layout.inputs + k].0 =
                    std::array::from_fn(|lane| column[s * 16 + lane].to_bits());
            }
        }
        let environment = Environment::unbound();
        let start = Instant::now();
        for wave in self.states.chunks_mut(self.subgroups) {
            let mut states: Vec<&mut [AlignedRow]> =
                wave.iter_mut().map(|state| &mut state[..]).collect();
            let mut wave = Wave {
                states: &mut states,
                shared: std::ptr::null_mut(),
                environment: &environment,
            };
            let event = self.program.run(&mut self.frame, &mut wave, &mut 1000);
            ensure!(event == Event::End, "the kernel stopped");
        }
        Ok(start.elapsed().as_secs_f64())
    }

    fn check(&self) -> Result<()> {
        let io = self.program.layout().io;
        for (lane, wanted) in self.out.iter().enumerate() {
            let got = f32::from_bits(self.states[lane / 16][io].0[lane % 16]);
            ensure!(
                got.to_bits() == wanted.to_bits(),
                "lane {lane}: the interpreter says {got}, native code {wanted}"
            );
        }
        Ok(())
    }
}
