//! The inputs of vertex invocations: attributes, converted by their formats, and built-ins.

use ash::vk;
use images::format::{FormatInfo, Numeric};
use images::texels::decode_words;
use lanes::Tier;
use smallvec::SmallVec;
use spirv_jit::program::{AlignedRow, Builtin, InputRow};
use spirv_jit::reach::Reach;
use spirv_jit::{Program, SUBGROUP_SIZE};

use super::transpose::transposed;
use crate::format::texel_format;
use crate::raster::Draw;
use crate::wave::reachable::readable;

/// Bytes of the largest vertex format.
const MAX_BYTES: usize = 32;

/// Bytes of the largest texel without components of 64 bits.
const MAX_NARROW_BYTES: usize = 16;

/// The values that all vertices of an instance of a call, for a view, share.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Common {
    pub first_instance: u32,
    /// From 0 on.
    pub instance: u32,
    pub base_vertex: u32,
    pub draw_index: u32,
    pub view: u32,
}

/// An invocation to come.
#[derive(Clone, Copy, Debug, Default)]
pub struct Vertex {
    /// `VertexIndex`.
    pub index: u32,
    /// Its [`Common`].
    pub common: u32,
}

/// How texels become words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Conversion {
    /// Words of 32 bits are the texel.
    Words,
    /// Components of 64 bits: two words each.
    Wide,
    Format,
}

/// An attribute that a program reads.
struct Attribute {
    base: *const u8,
    /// Elements whose texel is there as a whole.
    elements: u64,
    stride: u64,
    offset: u64,
    /// `None`: by vertex; else instances between advances, 0 for never.
    divisor: Option<u32>,
    info: &'static FormatInfo,
    conversion: Conversion,
    /// Components, and the input rows that they go to.
    rows: SmallVec<[(u8, u16); 4]>,
}

/// How the inputs of a draw's vertices are made.
pub struct Fetch {
    attributes: SmallVec<[Attribute; 4]>,
    builtins: SmallVec<[(Builtin, u16); 4]>,
    /// Rows of locations without an attribute.
    absent: SmallVec<[u16; 4]>,
    first_input: usize,
}

/// The word of a component that a texel of 64-bit components lacks.
fn missing_wide(info: &FormatInfo, word: usize) -> u32 {
    let one = if info.numeric.is_integer() {
        1
    } else {
        1.0f64.to_bits()
    };
    match word {
        6 => one as u32,
        7 => (one >> 32) as u32,
        _ => 0,
    }
}

impl Fetch {
    /// Of a draw with that vertex program.
    pub fn new(draw: &Draw, program: &Program, reach: &Reach) -> Self {
        let input = &draw.state.vertex_input;
        let mut fetch = Self {
            attributes: SmallVec::new(),
            builtins: SmallVec::new(),
            absent: SmallVec::new(),
            first_input: program.layout().inputs,
        };
        let mut locations: SmallVec<[u16; 4]> = SmallVec::new();
        for (row, input_row) in program.inputs().iter().enumerate() {
            let row = row as u16;
            match *input_row {
                InputRow::Builtin(builtin, _) => fetch.builtins.push((builtin, row)),
                InputRow::Attribute {
                    location,
                    component,
                } => {
                    if let Some(at) = locations.iter().position(|it| *it == location) {
                        fetch.attributes[at].rows.push((component, row));
                        continue;
                    }
                    let found = input
                        .attributes
                        .iter()
                        .find(|it| it.location == u32::from(location));
                    match found.and_then(|it| attribute(draw, it, reach)) {
                        Some(mut attribute) => {
                            attribute.rows.push((component, row));
                            fetch.attributes.push(attribute);
                            locations.push(location);
                        }
                        None => fetch.absent.push(row),
                    }
                }
                _ => {}
            }
        }
        fetch
    }

    /// Fills the inputs of a subgroup's state.
    pub fn fill(&self, state: &mut [AlignedRow], vertices: &[Vertex], commons: &[Common]) {
        let rows = &mut state[self.first_input..];
        for attribute in &self.attributes {
            attribute.fill(rows, vertices, commons);
        }
        // `defaultVertexAttributeValue`.
        for &row in &self.absent {
            rows[usize::from(row)].0 = [0; SUBGROUP_SIZE];
        }
        for &(builtin, row) in &self.builtins {
            let row = &mut rows[usize::from(row)].0;
            for (word, vertex) in row.iter_mut().zip(vertices) {
                let common = &commons[vertex.common as usize];
                *word = match builtin {
                    Builtin::VertexIndex => vertex.index,
                    Builtin::InstanceIndex => common.first_instance.wrapping_add(common.instance),
                    Builtin::BaseVertex => common.base_vertex,
                    Builtin::BaseInstance => common.first_instance,
                    Builtin::DrawIndex => common.draw_index,
                    Builtin::ViewIndex => common.view,
                    _ => 0,
                };
            }
        }
    }
}

fn attribute(
    draw: &Draw,
    attribute: &crate::object::graphics_state::VertexAttribute,
    reach: &Reach,
) -> Option<Attribute> {
    let binding = draw
        .state
        .vertex_input
        .bindings
        .iter()
        .find(|it| it.binding == attribute.binding)?;
    let info = texel_format(attribute.format).info()?;
    if usize::from(info.size_bytes) > MAX_BYTES || attribute.format == vk::Format::UNDEFINED {
        return None;
    }
    let buffer = draw.vertex_buffers.get(attribute.binding as usize)?;
    let memory = readable(reach, buffer.address, buffer.size_bytes);
    let channels = &info.channels[..info.component_count()];
    let in_words = |bits: u8| {
        channels
            .iter()
            .zip(0..)
            .all(|(channel, at)| channel.bits == bits && channel.offset == at * bits)
    };
    let is_plain = matches!(
        info.numeric,
        Numeric::Sfloat | Numeric::Uint | Numeric::Sint
    );
    let conversion = if info.is_wide() {
        Conversion::Wide
    } else if is_plain && in_words(32) {
        Conversion::Words
    } else {
        Conversion::Format
    };
    let stride = buffer.stride_bytes.unwrap_or(binding.stride_bytes.into());
    let offset = u64::from(attribute.offset_bytes);
    // Bytes that the first texel leaves.
    let end = offset + u64::from(info.size_bytes);
    let elements = match (memory.bytes as u64).checked_sub(end) {
        None => 0,
        Some(rest) => (rest.checked_div(stride)).map_or(u64::MAX, |more| more + 1),
    };
    Some(Attribute {
        base: memory.base,
        elements,
        stride,
        offset,
        divisor: binding.per_instance.then_some(binding.divisor),
        info,
        conversion,
        rows: SmallVec::new(),
    })
}

/// The value of missing texels: zeros; components that the format lacks keep their defaults (spec,
/// "Robust Buffer Access").
static ZEROS: [u8; MAX_BYTES] = [0; MAX_BYTES];

impl Attribute {
    /// Where an element's texel starts, if all of it is there.
    #[inline(always)]
    fn texel(&self, element: u64) -> *const u8 {
        if element >= self.elements {
            return ZEROS.as_ptr();
        }
        // No more than the bytes that there are.
        let offset = element * self.stride + self.offset;
        self.base.wrapping_add(offset as usize)
    }

    fn fill(&self, rows: &mut [AlignedRow], vertices: &[Vertex], commons: &[Common]) {
        let mut texels = [ZEROS.as_ptr(); SUBGROUP_SIZE];
        let mut is_shared = false;
        match self.divisor {
            None => {
                for (texel, vertex) in texels.iter_mut().zip(vertices) {
                    *texel = self.texel(vertex.index.into());
                }
            }
            Some(divisor) => {
                let texel_of = |vertex: &Vertex| {
                    let common = &commons[vertex.common as usize];
                    let advances = common.instance.checked_div(divisor).unwrap_or(0);
                    self.texel(u64::from(common.first_instance) + u64::from(advances))
                };
                // Mostly all vertices are of one instance.
                let first = vertices.first().map_or(0, |vertex| vertex.common);
                is_shared = vertices.iter().all(|vertex| vertex.common == first);
                if let Some(vertex) = vertices.first().filter(|_| is_shared) {
                    texels = [texel_of(vertex); SUBGROUP_SIZE];
                } else {
                    for (texel, vertex) in texels.iter_mut().zip(vertices) {
                        *texel = texel_of(vertex);
                    }
                }
            }
        }
        if self.conversion == Conversion::Wide {
            return self.fill_wide(rows, &texels);
        }
        let mut words = [[0; SUBGROUP_SIZE]; 4];
        // SAFETY: as many bytes as the format has are there while the draw runs, for each texel;
        // they may be anything.
        unsafe {
            match (is_shared, self.info.size_bytes) {
                (true, size) => {
                    let texel = match size {
                        4 => load_texel::<1>(texels[0]),
                        8 => load_texel::<2>(texels[0]),
                        12 => load_texel::<3>(texels[0]),
                        16 => load_texel::<4>(texels[0]),
                        _ => load(texels[0], size),
                    };
                    for (row, word) in words.iter_mut().zip(texel) {
                        *row = [word; SUBGROUP_SIZE];
                    }
                }
                (false, 4) => load_all::<1>(&texels, &mut words),
                (false, 8) => load_all::<2>(&texels, &mut words),
                (false, 12) => load_all::<3>(&texels, &mut words),
                (false, 16) => load_all::<4>(&texels, &mut words),
                (false, size) => {
                    for (lane, &texel) in texels.iter().enumerate() {
                        for (row, word) in words.iter_mut().zip(load(texel, size)) {
                            row[lane] = word;
                        }
                    }
                }
            }
        }
        if self.conversion == Conversion::Format {
            decode(Tier::best(), self.info, &mut words);
        }
        let count = match self.conversion {
            Conversion::Words => self.info.component_count(),
            _ => words.len(),
        };
        for &(component, row) in &self.rows {
            let word = words[..count].get(usize::from(component));
            rows[usize::from(row)].0 = match word {
                Some(word) => *word,
                None => [self.info.missing(component.into()); SUBGROUP_SIZE],
            };
        }
    }

    /// Components of 64 bits: two words each.
    fn fill_wide(&self, rows: &mut [AlignedRow], texels: &[*const u8; SUBGROUP_SIZE]) {
        let words = 2 * self.info.component_count();
        for &(component, row) in &self.rows {
            let row = &mut rows[usize::from(row)].0;
            let component = usize::from(component);
            if component >= words {
                *row = [missing_wide(self.info, component); SUBGROUP_SIZE];
                continue;
            }
            for (word, texel) in row.iter_mut().zip(texels) {
                // SAFETY: that many words are there while the draw runs; they may be anything.
                *word = unsafe { texel.cast::<u32>().add(component).read_unaligned() };
            }
        }
    }
}

lanes::vectors! {
    /// Sixteen texels from their words to components.
    fn decode<V>(v, info: &FormatInfo, words: &mut [[u32; SUBGROUP_SIZE]; 4]) {
        let loaded = [v.load_i(&words[0]), v.load_i(&words[1]), v.load_i(&words[2]), v.load_i(&words[3])];
        let texels = decode_words(v, info, &loaded);
        for (texel, row) in texels.iter().zip(words) {
            v.store_i(*texel, row);
        }
    }
}

/// The words of a texel; words past its size are zero.
///
/// # Safety
/// So many bytes can be read, at most 16.
unsafe fn load(texel: *const u8, size_bytes: u8) -> [u32; 4] {
    let mut bytes = [0; MAX_NARROW_BYTES];
    let size = usize::from(size_bytes).min(MAX_NARROW_BYTES);
    // SAFETY: the caller guarantees that so many bytes are readable, at most 16.
    unsafe { std::ptr::copy_nonoverlapping(texel, bytes.as_mut_ptr(), size) };
    let (words, _) = bytes.as_chunks();
    std::array::from_fn(|word| u32::from_le_bytes(words[word]))
}

/// The words of texels of `WORDS` words.
///
/// # Safety
/// So many words can be read of each.
#[inline(always)]
unsafe fn load_all<const WORDS: usize>(
    texels: &[*const u8; SUBGROUP_SIZE],
    words: &mut [[u32; SUBGROUP_SIZE]; 4],
) {
    for first in (0..SUBGROUP_SIZE).step_by(4) {
        // SAFETY: the caller guarantees that so many words of each are readable.
        let [a, b, c, d] = unsafe {
            [
                load_texel::<WORDS>(texels[first]),
                load_texel::<WORDS>(texels[first + 1]),
                load_texel::<WORDS>(texels[first + 2]),
                load_texel::<WORDS>(texels[first + 3]),
            ]
        };
        let components = transposed([a, b, c, d]);
        for (row, four) in words.iter_mut().zip(components).take(WORDS) {
            row[first..first + 4].copy_from_slice(&four);
        }
    }
}

/// A texel of `WORDS` words, and zeros behind them.
///
/// # Safety
/// So many can be read.
#[inline(always)]
unsafe fn load_texel<const WORDS: usize>(texel: *const u8) -> [u32; 4] {
    let mut words = [0; 4];
    // SAFETY: the caller guarantees that so many bytes are readable.
    let loaded = unsafe { texel.cast::<[u32; WORDS]>().read_unaligned() };
    words[..WORDS].copy_from_slice(&loaded);
    words
}
