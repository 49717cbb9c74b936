//! The inputs of vertex invocations: attributes, converted by their formats, and built-ins.

use ash::vk;
use smallvec::SmallVec;
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::image::format::{FormatInfo, Numeric};
use spirv_jit::program::{AlignedRow, Builtin, InputRow};
use spirv_jit::reach::Reach;

use crate::format::texel_format;
use crate::raster::Draw;
use crate::wave::reachable::readable;

/// Bytes of the largest vertex format.
const MAX_BYTES: usize = 32;

/// What all vertices of an instance of a call, for a view, have in common.
#[derive(Clone, Copy, Debug, Default)]
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
    /// Bytes there are from `base` on.
    bytes: u64,
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
    /// Components of locations without an attribute: what a missing component reads.
    absent: SmallVec<[(u8, u16); 4]>,
    first_input: usize,
}

/// The word of a component that a texel of 32-bit floats lacks.
fn missing(component: u8) -> u32 {
    if component == 3 { 1.0f32.to_bits() } else { 0 }
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
    /// Of a draw.
    pub fn new(draw: &Draw, reach: &Reach) -> Self {
        let program = &draw.stages.vertex;
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
                        None => fetch.absent.push((component, row)),
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
        for &(component, row) in &self.absent {
            rows[usize::from(row)].0 = [missing(component); SUBGROUP_SIZE];
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
    Some(Attribute {
        base: memory.base,
        bytes: memory.bytes as u64,
        stride: buffer.stride_bytes.unwrap_or(binding.stride_bytes.into()),
        offset: attribute.offset_bytes.into(),
        divisor: binding.per_instance.then_some(binding.divisor),
        info,
        conversion,
        rows: SmallVec::new(),
    })
}

impl Attribute {
    /// Where a vertex's texel starts, if all of it is there.
    #[inline(always)]
    fn texel(&self, vertex: &Vertex, commons: &[Common]) -> Option<*const u8> {
        let element = match self.divisor {
            None => u64::from(vertex.index),
            Some(divisor) => {
                let common = &commons[vertex.common as usize];
                let advances = common.instance.checked_div(divisor).unwrap_or(0);
                u64::from(common.first_instance) + u64::from(advances)
            }
        };
        let offset = element.checked_mul(self.stride)?.checked_add(self.offset)?;
        let end = offset.checked_add(self.info.size_bytes.into())?;
        (end <= self.bytes).then(|| self.base.wrapping_add(offset as usize))
    }

    fn fill(&self, rows: &mut [AlignedRow], vertices: &[Vertex], commons: &[Common]) {
        // Zeros where there is nothing; components that the format lacks are as ever (spec, "Robust Buffer Access").
        static ZEROS: [u8; MAX_BYTES] = [0; MAX_BYTES];
        let mut texels = [ZEROS.as_ptr(); SUBGROUP_SIZE];
        for (texel, vertex) in texels.iter_mut().zip(vertices) {
            *texel = self.texel(vertex, commons).unwrap_or(ZEROS.as_ptr());
        }
        let texels = &texels[..vertices.len()];
        let count = self.info.component_count();
        match self.conversion {
            Conversion::Words | Conversion::Wide => {
                let (words, is_wide) = match self.conversion {
                    Conversion::Wide => (2 * count, true),
                    _ => (count, false),
                };
                for &(component, row) in &self.rows {
                    let row = &mut rows[usize::from(row)].0;
                    let component = usize::from(component);
                    if component < words {
                        for (word, texel) in row.iter_mut().zip(texels) {
                            // SAFETY: that many words are there while the draw runs; they may be anything.
                            *word = unsafe { texel.cast::<u32>().add(component).read_unaligned() };
                        }
                    } else if is_wide {
                        *row = [missing_wide(self.info, component); SUBGROUP_SIZE];
                    } else {
                        *row = [self.info.missing(component); SUBGROUP_SIZE];
                    }
                }
            }
            Conversion::Format => {
                let size = usize::from(self.info.size_bytes);
                for (lane, texel) in texels.iter().enumerate() {
                    let mut bytes = ZEROS;
                    // SAFETY: as above.
                    unsafe { std::ptr::copy_nonoverlapping(*texel, bytes.as_mut_ptr(), size) };
                    let words = self.info.decode(&bytes[..size]);
                    for &(component, row) in &self.rows {
                        let word = words.get(usize::from(component)).copied();
                        rows[usize::from(row)].0[lane] = word.unwrap_or(0);
                    }
                }
            }
        }
    }
}
