//! Programs in the IR's text form, run on every tier that the machine has. Expectations are
//! computed by plain Rust beside them.

mod atomics;
mod buffers;
mod control;
mod gather;
mod halves;
mod images;
mod kernels;
mod matrices;
mod memory;
mod native;
mod numbers;
mod pairs;
mod strided;
mod subgroups;
mod vector_products;
mod yields;

use lanes::{AlignedRow, LaneMask, Tier as TierKind};

use super::Frame;
use crate::environment::Environment;
use crate::ir::text::parse_module;
use crate::ir::verify::verify;
use crate::program::Program;
use crate::state::{Event, SiteKind, Wave};

/// A program with the states of some subgroups.
pub(super) struct Bench {
    pub program: Program,
    pub states: Vec<Vec<AlignedRow>>,
    pub environment: Environment,
    /// Memory of as many workgroups as there are subgroups.
    pub shared: Vec<u64>,
    /// Subgroups of a workgroup.
    pub of_workgroup: usize,
    /// Waves are said to be whole.
    pub is_whole: bool,
    pub frame: Frame,
}

impl Bench {
    /// Subgroups at the program's start, all lanes active.
    pub fn new(text: &str, tier: TierKind, subgroups: usize) -> Bench {
        let module = parse_module(text).unwrap();
        verify(&module).unwrap();
        Bench::of(Program::with_tier(&module, tier).unwrap(), subgroups)
    }

    /// As [`Self::new`], of a program that is there.
    pub fn of(program: Program, subgroups: usize) -> Bench {
        let rows = program.layout().rows;
        // Garbage, which `start` must clear.
        let mut states = vec![vec![AlignedRow([0xdead_beef; 16]); rows]; subgroups];
        for state in &mut states {
            program.start(state, LaneMask::ALL);
        }
        let shared = vec![0; subgroups * program.shared_size_bytes().div_ceil(8) as usize];
        Bench {
            program,
            states,
            environment: Environment::unbound(),
            shared,
            of_workgroup: subgroups,
            is_whole: false,
            frame: Frame::default(),
        }
    }

    /// Sets input row `row` of global lane `i` to `f(i)`.
    pub fn input(&mut self, row: usize, f: impl Fn(usize) -> u32) {
        let row = self.program.layout().inputs + row;
        for (s, state) in self.states.iter_mut().enumerate() {
            state[row].0 = std::array::from_fn(|k| f(s * 16 + k));
        }
    }

    /// Runs all subgroups as one wave.
    pub fn run(&mut self, fuel: &mut u64) -> Event {
        let all: Vec<usize> = (0..self.states.len()).collect();
        self.run_some(&all, fuel)
    }

    /// Runs a wave of some of the subgroups.
    pub fn run_some(&mut self, which: &[usize], fuel: &mut u64) -> Event {
        let mut states: Vec<&mut [AlignedRow]> = self
            .states
            .iter_mut()
            .enumerate()
            .filter(|(s, _)| which.contains(s))
            .map(|(_, state)| &mut state[..])
            .collect();
        let words = self.program.shared_size_bytes().div_ceil(8) as usize;
        let memory = self.shared.as_mut_ptr();
        let of = |s: &usize| memory.wrapping_add(s / self.of_workgroup * words).cast();
        let shared: Vec<*mut u8> = which.iter().map(of).collect();
        let mut wave = Wave {
            states: &mut states,
            shared: &shared,
            is_whole: self.is_whole,
            outputs_to: &[],
            environment: &self.environment,
        };
        // SAFETY: what the environment names is the bench's.
        let events = unsafe { self.program.run(&mut self.frame, &mut wave, fuel) }.unwrap();
        let events: Vec<Event> = events.iter().collect();
        assert_eq!(events.len(), which.len());
        assert!(events.iter().all(|event| *event == events[0]));
        events[0]
    }

    pub fn run_to_end(&mut self) {
        assert_eq!(self.run(&mut 1_000_000), Event::End);
    }

    /// Io row `row` of all lanes.
    pub fn io(&self, row: usize) -> Vec<u32> {
        let row = self.program.layout().io + row;
        self.states.iter().flat_map(|state| state[row].0).collect()
    }

    /// Rewrites io row `row` in the lanes that take part in the event.
    pub fn answer(&mut self, row: usize, f: impl Fn(usize, u32) -> u32) {
        let row = self.program.layout().io + row;
        for (s, state) in self.states.iter_mut().enumerate() {
            let mask = self.program.event_mask(state);
            for k in mask {
                let word = &mut state[row].0[k];
                *word = f(s * 16 + k, *word);
            }
        }
    }

    pub fn event_masks(&self) -> Vec<LaneMask> {
        let mask = |state: &Vec<AlignedRow>| self.program.event_mask(state);
        self.states.iter().map(mask).collect()
    }

    pub fn site(&self, event: Event) -> SiteKind {
        match event {
            Event::Yield(site) => self.program.sites()[site.0 as usize],
            other => panic!("{other:?} instead of a yield"),
        }
    }
}

/// Runs `test` on every tier.
pub(super) fn on_tiers(mut test: impl FnMut(TierKind)) {
    for &tier in TierKind::available() {
        test(tier);
    }
}

/// Output row 0 of a program whose input row 0 is `f(lane)`, the same on every tier and wave
/// length.
pub(super) fn outputs(text: &str, f: impl Fn(usize) -> u32 + Copy) -> Vec<u32> {
    let mut all: Option<Vec<u32>> = None;
    on_tiers(|tier| {
        for subgroups in [1, 3, 16] {
            let mut bench = Bench::new(text, tier, subgroups);
            bench.input(0, f);
            bench.run_to_end();
            let out = bench.io(0);
            let all = all.get_or_insert_with(Vec::new);
            if all.len() < out.len() && all[..] == out[..all.len()] {
                all.extend_from_slice(&out[all.len()..]);
            }
            assert_eq!(all[..out.len()], out[..], "{tier:?}");
        }
    });
    all.unwrap()
}
