//! Runs a module on made-up inputs, and keeps what can be seen of it: outputs, what it wrote, what
//! it yielded, by lane.

use std::sync::Arc;

use spirv_jit::environment::{Descriptor, DescriptorSet, Environment, uniform};
use spirv_jit::interp::Frame;
use spirv_jit::ir::{InputRow, Module};
use spirv_jit::program::{AlignedRow, Event, IO_DATA_ROW, SiteKind, Stage, Wave};
use spirv_jit::reach::{Range, Reach};
use spirv_jit::{LaneMask, Program, Tier};

const LANES: usize = 16;

/// The fuel of one run.
const FUEL: u64 = 7;

/// Words of the buffer that a program may write, per lane.
pub const WRITABLE_WORDS: usize = 16;

/// Words of the buffer that it may only read, and of the push constants.
pub const READABLE_WORDS: usize = 64;

/// The observable outcome of a run.
#[derive(Debug, PartialEq)]
pub enum Outcome {
    Ended(Box<Observation>),
    OutOfFuel,
}

#[derive(Debug, PartialEq)]
pub struct Observation {
    /// Output words, by row and lane.
    pub outputs: Vec<Vec<u32>>,
    /// The writable buffer.
    pub memory: Vec<u32>,
    /// A digest of each lane's yields in order.
    pub yields: Vec<u64>,
}

impl Outcome {
    /// With every output word that would be a NaN made the same one: their payloads mean nothing.
    #[allow(dead_code)]
    pub fn without_payloads(mut self) -> Outcome {
        if let Outcome::Ended(seen) = &mut self {
            for word in seen.outputs.iter_mut().flatten() {
                if f32::from_bits(*word).is_nan() {
                    *word = f32::NAN.to_bits();
                }
            }
        }
        self
    }

    /// With the words that a vertex module leaves out because they are zero.
    #[allow(dead_code)]
    pub fn with_outputs_of(mut self, whole: &Module, trimmed: &Module) -> Outcome {
        if let Outcome::Ended(seen) = &mut self {
            let lanes = seen.outputs.first().map_or(0, Vec::len);
            for (index, row) in whole.outputs.iter().enumerate() {
                if !trimmed.outputs.contains(row) {
                    seen.outputs.insert(index, vec![0; lanes]);
                }
            }
        }
        self
    }

    /// With the payload words that an any-hit module leaves out because it leaves them as they
    /// came: those of a module that has them.
    #[allow(dead_code)]
    pub fn with_payload_of(mut self, whole: &Module, seed: u64) -> Outcome {
        if let Outcome::Ended(seen) = &mut self
            && whole.stage == Stage::AnyHit
            && seen.outputs.len() == 1
        {
            let lanes = seen.outputs[0].len();
            for word in 0..whole.output_rows - 1 {
                let row = (0..lanes).map(|lane| input_word(InputRow::Payload(word), lane, seed));
                seen.outputs.push(row.collect());
            }
        }
        self
    }
}

/// A word that looks random, or now and then special.
pub fn scramble(seed: u64) -> u32 {
    let mut x = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^= x >> 31;
    match x >> 60 {
        0..4 => (x % 16) as u32,
        4 => 0,
        5 => u32::MAX,
        6 => 0x8000_0000,
        7..12 => ((x % 2000) as f32 / 100.0 - 10.0).to_bits(),
        12 => f32::INFINITY.to_bits(),
        _ => x as u32,
    }
}

fn input_word(row: InputRow, lane: usize, seed: u64) -> u32 {
    match row {
        // The lane's number: what it may write follows from it.
        InputRow::CallableData(0) => lane as u32,
        InputRow::CallableData(word) | InputRow::Payload(word) => {
            scramble(seed ^ (word as u64) << 32 ^ lane as u64)
        }
        other => scramble(seed ^ format!("{other:?}").len() as u64 ^ (lane as u64) << 8),
    }
}

/// Runs two subgroups as one wave, on inputs made from `seed` or, in all lanes, given by index.
pub fn execute(module: &Module, seed: u64, inputs: Option<&[u32]>) -> Outcome {
    execute_on(Tier::best(), module, seed, inputs)
}

/// As [`execute`], on a tier that the machine has.
pub fn execute_on(tier: Tier, module: &Module, seed: u64, inputs: Option<&[u32]>) -> Outcome {
    shaders::code_pages::allow_native_code();
    let program = Program::with_tier(module, tier).unwrap_or_else(|error| panic!("{error}"));
    execute_program(&program, module, seed, inputs)
}

/// As [`execute_on`], without native code.
#[allow(dead_code)]
pub fn execute_interpreted_on(tier: Tier, module: &Module, seed: u64) -> Outcome {
    let program = Program::with_tier_interpreted(module, tier);
    let program = program.unwrap_or_else(|error| panic!("{error}"));
    execute_program(&program, module, seed, None)
}

/// As [`execute`], with what was compiled from the module.
fn execute_program(
    program: &Program,
    module: &Module,
    seed: u64,
    inputs: Option<&[u32]>,
) -> Outcome {
    let subgroups = program.max_wave_subgroups().min(2);
    let lanes = 2 * LANES;
    let readable: Vec<u32> = (0..READABLE_WORDS as u64)
        .map(|k| scramble(seed ^ k << 40))
        .collect();
    let pushed: Vec<u32> = (0..READABLE_WORDS as u64)
        .map(|k| scramble(seed ^ k << 20))
        .collect();
    let mut writable = vec![0u32; lanes * WRITABLE_WORDS];
    let descriptor = |words: *const u32, count: usize| Descriptor {
        address: words as u64,
        size_bytes: 4 * count as u64,
        ..Descriptor::NULL
    };
    let entries = [
        descriptor(readable.as_ptr(), readable.len()),
        descriptor(writable.as_mut_ptr(), writable.len()),
    ];
    let mut environment = Environment {
        // The memory that device addresses reach.
        reach: Arc::new(Reach::new(vec![Range {
            start: readable.as_ptr() as u64,
            size_bytes: 4 * readable.len() as u64,
        }])),
        push_constants: descriptor(pushed.as_ptr(), pushed.len()),
        uniforms: std::array::from_fn::<_, { uniform::COUNT }, _>(|k| 5 + k as u32),
        ..Environment::unbound()
    };
    environment.sets[0] = DescriptorSet {
        entries: entries.as_ptr(),
        count: entries.len() as u32,
        ..DescriptorSet::NONE
    };

    let mut states = vec![vec![AlignedRow([0xdead_beef; LANES]); program.layout().rows]; 2];
    for (s, state) in states.iter_mut().enumerate() {
        program.start(state, LaneMask::ALL);
        for (index, &row) in program.inputs().iter().enumerate() {
            let words = &mut state[program.layout().inputs + index].0;
            for (k, word) in words.iter_mut().enumerate() {
                *word = match inputs {
                    Some(given) => {
                        let at = module.inputs.iter().position(|&r| r == row);
                        given.get(at.unwrap_or(usize::MAX)).copied().unwrap_or(0)
                    }
                    None => input_word(row, s * LANES + k, seed),
                };
            }
        }
    }
    let mut yields = vec![0u64; lanes];
    let mut frame = Frame::default();
    let mut shared = vec![0u64; program.shared_size_bytes().div_ceil(8) as usize];
    // Subgroups of a wave stay together in these programs, or run alone.
    for wave_states in states.chunks_mut(subgroups).enumerate() {
        let (first, wave_states) = (wave_states.0 * subgroups, wave_states.1);
        let mut budget = 20_000;
        for _ in 0..20_000 {
            // Little at a time, so that waves stop at back-edges and calls, too.
            let given = budget.min(FUEL);
            let mut fuel = given;
            let mut slices: Vec<&mut [AlignedRow]> =
                wave_states.iter_mut().map(|s| &mut s[..]).collect();
            let mut wave = Wave {
                states: &mut slices,
                shared: &[shared.as_mut_ptr().cast(); 2],
                is_whole: false,
                outputs_to: &[],
                environment: &environment,
            };
            // SAFETY: what the environment and `shared` name are the vectors above.
            let events = unsafe { program.run(&mut frame, &mut wave, &mut fuel) };
            let event = alike(events.expect("the frame is small").iter().collect());
            budget -= given - fuel;
            match event {
                Event::End => break,
                Event::OutOfFuel if budget == 0 => return Outcome::OutOfFuel,
                Event::OutOfFuel => {}
                Event::Yield(site) => {
                    let kind = program.sites()[site.0 as usize];
                    for (s, state) in wave_states.iter_mut().enumerate() {
                        let lanes = &mut yields[(first + s) * LANES..][..LANES];
                        answer(program, kind, state, lanes);
                    }
                }
            }
        }
    }
    let io = program.layout().io;
    let outputs = (0..program.output_rows() as usize)
        .map(|row| states.iter().flat_map(|state| state[io + row].0).collect())
        .collect();
    Outcome::Ended(Box::new(Observation {
        outputs,
        memory: writable,
        yields,
    }))
}

/// Notes an event's operands in the digests of its lanes, and answers with words made from them.
fn answer(program: &Program, kind: SiteKind, state: &mut [AlignedRow], digests: &mut [u64]) {
    let io = program.layout().io;
    let data = |count: u32| IO_DATA_ROW..IO_DATA_ROW + count as usize;
    let (rows, results): (Vec<usize>, Vec<usize>) = match kind {
        SiteKind::TraceRay {
            trace,
            payload_words,
        } => {
            let traced = if trace.to_hit_object { 0..16 } else { 0..0 };
            (
                (0..trace.words()).chain(data(payload_words)).collect(),
                traced.chain(data(payload_words)).collect(),
            )
        }
        SiteKind::ExecuteCallable { data_words } => (
            (0..1).chain(data(data_words)).collect(),
            data(data_words).collect(),
        ),
        SiteKind::ReportIntersection { attribute_words } => {
            ((0..2).chain(data(attribute_words)).collect(), vec![0])
        }
        SiteKind::HitObjectExecute { payload_words } => (
            (0..16).chain(data(payload_words + 11)).collect(),
            data(payload_words).collect(),
        ),
        SiteKind::HitObjectGet { fact } => ((0..9).collect(), (0..fact.words()).collect()),
        SiteKind::ReorderThread => ((0..4).collect(), Vec::new()),
        SiteKind::RayQueryProceed => (vec![0], vec![0]),
        SiteKind::Barrier | SiteKind::BarrierArrive | SiteKind::BarrierWait => {
            (Vec::new(), Vec::new())
        }
    };
    let mask = program.event_mask(state);
    for k in mask {
        let digest = &mut digests[k];
        for &row in &rows {
            *digest = digest.rotate_left(9).wrapping_mul(0x9e37_79b9_7f4a_7c15)
                ^ state[io + row].0[k] as u64;
        }
        for &row in &results {
            let word = scramble(state[io + row].0[k] as u64 ^ (row as u64) << 33);
            state[io + row].0[k] = match kind {
                SiteKind::ReportIntersection { .. } => word & 1,
                _ => word,
            };
        }
    }
}

/// The event that all subgroups of a wave came to.
fn alike(events: Vec<Event>) -> Event {
    assert!(events.iter().all(|event| *event == events[0]), "{events:?}");
    events[0]
}
