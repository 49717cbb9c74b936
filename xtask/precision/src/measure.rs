//! Errors, and the greatest of them over many inputs.

use std::num::NonZero;
use std::sync::atomic::{AtomicU64, Ordering};

use spirv_jit::ir::Type;

use super::format::Format;
use super::functions::{Sampling, Several, Unary};
use super::kernel::Kernel;

#[derive(clap::Args)]
pub struct Options {
    /// Take every N-th of the 2^32 inputs
    #[arg(long, value_name = "N", default_value = "1")]
    pub step: NonZero<u64>,
    /// How many threads work; all that the machine has by default
    #[arg(long)]
    threads: Option<NonZero<usize>>,
}

/// The greatest errors so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct Worst {
    pub error: f64,
    /// Where it is.
    pub at: [f64; 3],
    /// The greatest share of the allowance.
    pub share: f64,
    pub count: u64,
}

impl Worst {
    fn add(&mut self, error: f64, allowed: f64, at: [f64; 3]) {
        if error > self.error {
            (self.error, self.at) = (error, at);
        }
        if error > self.share * allowed {
            self.share = error / allowed;
        }
    }

    fn merge(self, other: Self) -> Self {
        let greater = if other.error > self.error {
            other
        } else {
            self
        };
        Self {
            share: self.share.max(other.share),
            count: self.count + other.count,
            ..greater
        }
    }
}

/// Inputs of one block: what a thread takes at a time.
const BLOCK: u64 = 1 << 20;

/// Runs `block` for each block of `0..count` on all threads.
fn over_blocks(
    options: &Options,
    count: u64,
    block: impl Fn(std::ops::Range<u64>, &mut Kernel, &mut Worst) + Sync,
    kernel: impl Fn() -> Kernel + Sync,
) -> Worst {
    let next = AtomicU64::new(0);
    let work = || {
        let (mut kernel, mut worst) = (kernel(), Worst::default());
        loop {
            let start = next.fetch_add(1, Ordering::Relaxed) * BLOCK;
            if start >= count {
                return worst;
            }
            block(start..(start + BLOCK).min(count), &mut kernel, &mut worst);
        }
    };
    std::thread::scope(|scope| {
        let all = || std::thread::available_parallelism().map_or(1, usize::from);
        let threads: Vec<_> = (0..options.threads.map_or_else(all, usize::from))
            .map(|_| scope.spawn(work))
            .collect();
        let worst = threads.into_iter().map(|thread| thread.join().unwrap());
        worst.fold(Worst::default(), Worst::merge)
    })
}

/// The greatest error of a function of one operand.
pub fn unary(function: &Unary, format: Format, options: &Options) -> Worst {
    let step = match function.sampling() {
        Sampling::All => options.step.get(),
        Sampling::Every(step) => options.step.get().max(step),
    };
    let (count, step) = match format.ty {
        Type::F16 => (1 << 16, 1),
        _ => ((1u64 << 32).div_ceil(step), step),
    };
    over_blocks(
        options,
        count,
        |range, kernel, worst| {
            let inputs = range
                .map(|index| (index * step) as u32)
                .filter(|&bits| function.domain.contains(format.value(bits)));
            let mut check = |column: &[Vec<u32>], results: &[u32]| {
                for (&bits, &result) in column[0].iter().zip(results) {
                    let x = format.value(bits);
                    let (got, exact) = (format.value(result), (function.exact)(x));
                    worst.count += 1;
                    if got == exact {
                        continue;
                    }
                    // Most results; what is left is worth a closer look.
                    if worst.error >= 0.5 && format.is_rounded(got, exact) {
                        continue;
                    }
                    let error = format.error(got, exact);
                    let allowed = format.allowed(function.allowance, x, exact);
                    worst.add(error, allowed, [x, 0.0, 0.0]);
                }
            };
            in_waves(kernel, inputs.map(|bits| [bits, 0, 0]), 1, &mut check);
        },
        || Kernel::new(function.operation, 1, format.ty),
    )
}

/// The greatest error of a function of several operands.
pub fn several(function: &Several, format: Format, options: &Options) -> Worst {
    let count = (1u64 << 26).div_ceil(options.step.get()).max(1 << 16);
    over_blocks(
        options,
        count,
        |range, kernel, worst| {
            let mut check = |columns: &[Vec<u32>], results: &[u32]| {
                for (lane, &result) in results.iter().enumerate() {
                    let operand = |k: usize| columns.get(k).map_or(0.0, |c| format.value(c[lane]));
                    let operands = [operand(0), operand(1), operand(2)];
                    let exact = (function.exact)(&operands);
                    let error = format.error(format.value(result), exact);
                    worst.count += 1;
                    let allowed = format.allowed(function.allowance, operands[0], exact);
                    worst.add(error, allowed, operands);
                }
            };
            let operands = range.map(|index| super::samples::operands(index, format));
            in_waves(kernel, operands, function.arity, &mut check);
        },
        || Kernel::new(function.operation, function.arity, format.ty),
    )
}

/// Cuts operands into waves; the last one is filled up with its last operands.
fn in_waves(
    kernel: &mut Kernel,
    operands: impl Iterator<Item = [u32; 3]>,
    arity: usize,
    check: &mut dyn FnMut(&[Vec<u32>], &[u32]),
) {
    let lanes = kernel.lanes();
    let mut columns = vec![Vec::with_capacity(lanes); arity];
    let mut results = vec![0; lanes];
    let mut operands = operands.peekable();
    while operands.peek().is_some() {
        columns.iter_mut().for_each(Vec::clear);
        for given in operands.by_ref().take(lanes) {
            for (column, word) in columns.iter_mut().zip(given) {
                column.push(word);
            }
        }
        let count = columns[0].len();
        for column in &mut columns {
            column.resize(lanes, column[count - 1]);
        }
        kernel.run(&columns, &mut results);
        for column in &mut columns {
            column.truncate(count);
        }
        check(&columns, &results[..count]);
    }
}
