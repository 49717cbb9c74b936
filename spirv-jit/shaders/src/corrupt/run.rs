//! Running what came out of a corrupted module: whatever it does, it ends when its fuel is spent
//! and writes only what is bound.

use fastrand::Rng;
use images::{Format, ImageDescriptor, Level, SamplerDescriptor};
use spirv_jit::environment::{Descriptor, DescriptorSet, Environment, uniform};
use spirv_jit::program::{AlignedRow, Event, Frame, IO_DATA_ROW, SiteKind, Wave};
use spirv_jit::reach::{Range, Reach};
use spirv_jit::{LaneMask, Program};

use super::word;

/// Words of the buffer that is bound everywhere.
const WORDS: usize = 256;

/// The guard words before and after it.
const PATTERN: u32 = 0x5AFE_C0DE;

/// `VK_FORMAT_R8G8B8A8_UNORM`.
const RGBA8: Format = Format(37);

/// The fuel of a run, and its maximum number of yields.
const FUEL: u64 = 20_000;
const YIELDS: u32 = 200;

/// A buffer, and so many words before and after it.
struct Guarded {
    words: Box<[u32]>,
    margin: usize,
}

impl Guarded {
    fn new(random: &mut Rng, margin: usize) -> Guarded {
        let mut words = vec![PATTERN; WORDS + 2 * margin];
        words[margin..margin + WORDS].fill_with(|| word(random));
        Guarded {
            words: words.into_boxed_slice(),
            margin,
        }
    }

    fn start(&mut self) -> *mut u32 {
        self.words[self.margin..].as_mut_ptr()
    }

    fn check(&self) {
        let (before, rest) = self.words.split_at(self.margin);
        let mut margins = before.iter().chain(&rest[WORDS..]);
        assert!(margins.all(|&word| word == PATTERN), "written beside");
    }
}

/// An image of 16 × 16 texels.
fn picture(data: *mut u8, size_bytes: u64) -> ImageDescriptor {
    let mut picture = ImageDescriptor {
        data,
        size_bytes,
        format: RGBA8,
        level_count: 1,
        layer_count: 1,
        layer_stride_bytes: size_bytes,
        ..ImageDescriptor::NULL
    };
    picture.levels[0] = Level {
        width: 16,
        height: 16,
        depth: 1,
        row_stride_bytes: 64,
        slice_stride_bytes: size_bytes,
        ..picture.levels[0]
    };
    picture
}

/// Runs a program as one wave, with a buffer, images and samplers bound everywhere but in each
/// fifth binding, and with nonsense for all that it is given and answered. `margin` words around
/// each buffer are looked at afterwards; none where a sanitizer watches its ends.
pub fn run(program: &Program, random: &mut Rng, margin: usize) {
    let [mut buffer, mut texels, mut pushed] = [(); 3].map(|()| Guarded::new(random, margin));
    let size_bytes = 4 * WORDS as u64;
    let picture = picture(texels.start().cast(), size_bytes);
    let list = ImageDescriptor::texel_buffer(picture.data, size_bytes, RGBA8);
    let sampler = SamplerDescriptor::DEFAULT;
    let entries: Vec<Descriptor> = (0..512)
        .map(|entry| match entry / 16 % 5 {
            4 => Descriptor::NULL,
            binding => Descriptor {
                address: buffer.start() as u64,
                size_bytes,
                image: if binding % 2 == 0 { &picture } else { &list },
                sampler: &sampler,
            },
        })
        .collect();
    let reach = Range {
        start: buffer.start() as u64,
        size_bytes,
    };
    let mut environment = Environment {
        dynamic: entries.as_ptr(),
        dynamic_count: entries.len() as u32,
        push_constants: Descriptor {
            address: pushed.start() as u64,
            size_bytes,
            ..Descriptor::NULL
        },
        uniforms: std::array::from_fn::<_, { uniform::COUNT }, _>(|k| 1 + k as u32),
        reach: Reach::new(vec![reach]).into(),
        ..Environment::unbound()
    };
    environment.sets[..3].fill(DescriptorSet {
        entries: entries.as_ptr(),
        count: entries.len() as u32,
        ..DescriptorSet::NONE
    });

    let layout = program.layout();
    let mut states =
        vec![vec![AlignedRow::default(); layout.rows]; program.max_wave_subgroups().min(2)];
    for state in &mut states {
        program.start(state, LaneMask::from_bits(random.u16(..) | 1));
        let inputs = &mut state[layout.inputs..][..program.inputs().len()];
        inputs
            .iter_mut()
            .for_each(|row| row.0.fill_with(|| word(random)));
    }
    let mut shared = vec![0u64; program.shared_size_bytes().div_ceil(8) as usize];
    let (mut frame, mut fuel) = (Frame::default(), FUEL);
    for _ in 0..YIELDS {
        let mut slices: Vec<&mut [AlignedRow]> = states.iter_mut().map(|s| &mut s[..]).collect();
        let mut wave = Wave {
            states: &mut slices,
            shared: &[shared.as_mut_ptr().cast(); 2],
            is_whole: false,
            outputs_to: &[],
            environment: &environment,
        };
        // SAFETY: what the environment and `shared` name is alive, and as large as they say.
        let events = unsafe { program.run(&mut frame, &mut wave, &mut fuel) };
        let Event::Yield(site) = events.expect("the frame is small").iter().next().unwrap() else {
            break;
        };
        let answered = answer_rows(program.sites()[site.0 as usize]);
        for state in &mut states {
            for row in answered.clone() {
                state[layout.io + row].0.fill_with(|| word(random));
            }
        }
    }
    for guarded in [buffer, texels, pushed] {
        guarded.check();
    }
}

/// The `io` rows that a site's answer has.
fn answer_rows(site: SiteKind) -> std::iter::Chain<std::ops::Range<usize>, std::ops::Range<usize>> {
    let (first, data) = match site {
        SiteKind::TraceRay {
            trace,
            payload_words,
        } => match trace.to_hit_object {
            true => (IO_DATA_ROW, payload_words),
            false => (0, payload_words),
        },
        SiteKind::HitObjectExecute { payload_words } => (0, payload_words),
        SiteKind::ExecuteCallable { data_words } => (0, data_words),
        SiteKind::HitObjectGet { fact } => (fact.words(), 0),
        SiteKind::ReportIntersection { .. } | SiteKind::RayQueryProceed => (1, 0),
        SiteKind::ReorderThread
        | SiteKind::Barrier
        | SiteKind::BarrierArrive
        | SiteKind::BarrierWait => (0, 0),
    };
    (0..first).chain(IO_DATA_ROW..IO_DATA_ROW + data as usize)
}
