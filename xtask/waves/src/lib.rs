//! A program of the interpreter over many lanes, for measurements, without bindings and
//! suspensions.

use anyhow::{Error, Result, ensure};
use spirv_jit::environment::Environment;
use spirv_jit::ir::text::parse_module;
use spirv_jit::program::{AlignedRow, Event, Frame, Program, Wave};
use spirv_jit::{LaneMask, Tier};

/// Lanes of a subgroup.
const LANES: usize = 16;

pub struct Waves {
    program: Program,
    /// One for each subgroup.
    states: Vec<Vec<AlignedRow>>,
    frame: Frame,
}

impl Waves {
    /// Whole waves of at least so many lanes, on the best instruction set or on a given one.
    ///
    /// # Errors
    /// A text that is no module, or a module that is no program.
    pub fn new(text: &str, tier: Option<Tier>, lanes: usize) -> Result<Waves> {
        let module = parse_module(text).map_err(Error::msg)?;
        shaders::code_pages::allow_native_code();
        let program = match tier {
            Some(tier) => Program::with_tier(&module, tier),
            None => Program::new(&module),
        }
        .map_err(Error::msg)?;
        let wave = program.max_wave_subgroups();
        let subgroups = lanes.div_ceil(LANES).max(1).next_multiple_of(wave);
        Ok(Waves {
            states: vec![vec![AlignedRow::default(); program.layout().rows]; subgroups],
            program,
            frame: Frame::default(),
        })
    }

    pub fn lanes(&self) -> usize {
        self.states.len() * LANES
    }

    pub fn lanes_a_wave(&self) -> usize {
        self.program.max_wave_subgroups() * LANES
    }

    /// Sets one of the inputs in every lane.
    pub fn set_input(&mut self, number: usize, word: impl Fn(usize) -> u32) {
        let row = self.program.layout().inputs + number;
        for (subgroup, state) in self.states.iter_mut().enumerate() {
            state[row].0 = std::array::from_fn(|lane| word(subgroup * LANES + lane));
        }
    }

    /// Puts every lane back to the entry, with the inputs as they are.
    pub fn restart(&mut self) {
        for state in &mut self.states {
            self.program.start(state, LaneMask::ALL);
        }
    }

    /// Runs wave by wave to the end.
    ///
    /// # Errors
    /// A program that stops for anything else.
    pub fn run(&mut self) -> Result<()> {
        const FUEL: u64 = 1000;
        let environment = Environment::unbound();
        for wave in self.states.chunks_mut(self.program.max_wave_subgroups()) {
            let mut states: Vec<&mut [AlignedRow]> =
                wave.iter_mut().map(|state| &mut state[..]).collect();
            let mut wave = Wave {
                states: &mut states,
                shared: &[],
                is_whole: false,
                outputs_to: &[],
                environment: &environment,
            };
            // SAFETY: nothing is bound, and programs that are measured follow no pointers and share
            // no memory.
            let events = unsafe {
                self.program
                    .run(&mut self.frame, &mut wave, &mut { FUEL })?
            };
            let ended = events.iter().all(|event| event == Event::End);
            ensure!(ended, "the program stopped: {:?}", events);
        }
        Ok(())
    }

    /// The first word of each lane's output.
    pub fn results(&self) -> impl Iterator<Item = u32> {
        let row = self.program.layout().io;
        self.states.iter().flat_map(move |state| state[row].0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_lane_computes_with_its_input() {
        let text = "module closest_hit\ninputs payload.0\noutput_rows 1\nfunc f0 {\n\
                    v0: i32 = input[0]\nv1: i32 = iadd v0, v0\nend(v1)\n}\n";
        let mut waves = Waves::new(text, None, 100).expect("a program");
        assert!(waves.lanes() >= 100 && waves.lanes().is_multiple_of(waves.lanes_a_wave()));
        waves.set_input(0, |lane| lane as u32);
        for _ in 0..2 {
            waves.restart();
            waves.run().expect("it ends");
            let lanes = waves.lanes() as u32;
            assert!(waves.results().eq((0..lanes).map(|lane| 2 * lane)));
        }
    }
}
