//! Tessellation shaders: from patches of shaded vertices to the vertices of their subdivision.
//!
//! A control program runs for all patches of a job. Their levels tell how many primitives each of
//! them becomes, so that the chunks after that are cut by counts, like those of other draws.

#![forbid(unsafe_code)]

use std::ops::Range;
use std::sync::Arc;

use half::f16;
use lanes::LaneMask;
use spirv_jit::environment::Environment;
use spirv_jit::program::{
    AlignedRow, Builtin, ControlFacts, InputRow, OutputRow, PatchWord, Spacing, TessellationModes,
    Width,
};
use spirv_jit::{Program, SUBGROUP_SIZE};

use super::fetch::Common;
use super::tessellate::{Subdivision, Tessellation};
use super::topology::Assembled;
use super::vertices::SUBGROUPS;
use crate::object::graphics_pipeline::Stages;
use crate::object::graphics_state::GraphicsState;
use crate::wave::runner::{Runner, Subgroups, subgroups_at_once};
use crate::wave::{Limits, Stopped};

/// Patches of a job, and words that its control shaders leave, at most, unless a single patch has
/// more.
const JOB_PATCHES: usize = 256;
const JOB_WORDS: usize = 1 << 16;

/// Subdivisions that a worker keeps.
const KEPT: usize = 16;

/// Vertices of the patches of a draw; `None` if it draws no patches.
pub fn control_points(stages: &Stages, state: &GraphicsState) -> Option<u32> {
    let points = state.tessellation.control_points;
    let is_valid = (1..=spirv_jit::program::MAX_PATCH_VERTICES).contains(&points);
    (is_valid && stages.tessellation().is_some()).then_some(points)
}

/// Patches of a job, at most, of a draw with that control program.
pub fn longest(control: &Program) -> u32 {
    let facts = control.tessellation().and_then(|it| it.control.as_ref());
    let words = facts.map_or(1, |facts| PatchLayout::new(facts).words());
    (JOB_WORDS / words.max(1)).clamp(1, JOB_PATCHES) as u32
}

/// The words of a patch that a control program has made: those of its vertices, one vertex behind
/// the other, then those of the patch.
#[derive(Clone, Debug, PartialEq, Eq)]
struct PatchLayout {
    vertices: usize,
    of_vertex: Vec<PatchWord>,
    of_patch: Vec<PatchWord>,
}

impl PatchLayout {
    fn new(facts: &ControlFacts) -> Self {
        let is_of_patch = |word: &&PatchWord| word.stride_bytes == 0;
        let (of_patch, of_vertex) = facts.outputs.iter().partition(is_of_patch);
        Self {
            vertices: facts.vertices as usize,
            of_vertex,
            of_patch,
        }
    }

    fn words(&self) -> usize {
        self.vertices * self.of_vertex.len() + self.of_patch.len()
    }

    /// The place of a word; `vertex` counts where it is one of a vertex.
    fn find(&self, row: OutputRow, vertex: usize) -> Option<usize> {
        let place = |words: &[PatchWord]| words.iter().position(|word| word.row == row);
        match place(&self.of_vertex) {
            Some(word) if vertex < self.vertices => Some(vertex * self.of_vertex.len() + word),
            Some(_) => None,
            None => Some(self.vertices * self.of_vertex.len() + place(&self.of_patch)?),
        }
    }
}

/// How the patches of a draw are subdivided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Manner {
    modes: TessellationModes,
    clockwise: bool,
}

/// A patch with its levels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Patch {
    primitive_id: u32,
    common: u32,
    subdivision: Subdivision,
    /// Primitives that it becomes.
    pub primitives: u32,
}

/// Patches of one draw that are not discarded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Patches {
    /// Index of the draw in the batch's work.
    pub draw: u32,
    pub commons: Vec<Common>,
    pub patches: Vec<Patch>,
    words: Vec<u32>,
    manner: Manner,
}

/// Consecutive primitives of a patch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Piece {
    pub patch: u32,
    pub primitives: Range<u32>,
}

/// Patches' primitives that become a chunk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pieces {
    pub patches: Arc<Patches>,
    pub pieces: Vec<Piece>,
}

/// Cuts the primitives of patches into pieces of a chunk each, of so many at most. A patch that
/// fits into a chunk stays whole.
pub fn cut(patches: &Arc<Patches>, most: u32, mut add: impl FnMut(Pieces, u32)) {
    let mut pieces: Vec<Piece> = Vec::new();
    let mut taken = 0;
    let mut flush = |pieces: &mut Vec<Piece>, taken: &mut u32| {
        let made = Pieces {
            patches: Arc::clone(patches),
            pieces: std::mem::take(pieces),
        };
        add(made, std::mem::take(taken));
    };
    for (patch, each) in (0..).zip(&patches.patches) {
        let mut start = 0;
        while start < each.primitives {
            let rest = each.primitives - start;
            if taken > 0 && taken + rest > most {
                flush(&mut pieces, &mut taken);
            }
            let primitives = start..start + rest.min(most);
            start = primitives.end;
            taken += primitives.len() as u32;
            pieces.push(Piece { patch, primitives });
        }
    }
    if taken > 0 {
        flush(&mut pieces, &mut taken);
    }
}

/// Writes a word of the interface to a byte offset of memory.
fn put(memory: &mut [AlignedRow], offset: u32, width: Width, word: u32) {
    let Some((place, shift)) = place(memory.len(), offset) else {
        return;
    };
    let (bits, mask) = match width {
        Width::Word => (word, u32::MAX),
        Width::Short => (word, 0xFFFF),
        Width::Byte => (word, 0xFF),
        Width::Half => (f16::from_f32(f32::from_bits(word)).to_bits().into(), 0xFFFF),
    };
    let to = &mut memory[place / SUBGROUP_SIZE].0[place % SUBGROUP_SIZE];
    *to = *to & !(mask << shift) | (bits & mask) << shift;
}

/// Reads a word of the interface.
pub fn get(memory: &[AlignedRow], offset: u32, width: Width) -> u32 {
    let Some((place, shift)) = place(memory.len(), offset) else {
        return 0;
    };
    let bits = memory[place / SUBGROUP_SIZE].0[place % SUBGROUP_SIZE] >> shift;
    match width {
        Width::Word => bits,
        Width::Short => bits & 0xFFFF,
        Width::Byte => bits & 0xFF,
        Width::Half => f16::from_bits(bits as u16).to_f32().to_bits(),
    }
}

/// The 32-bit word that a byte offset lies in, and the bit that it starts at.
fn place(rows: usize, offset: u32) -> Option<(usize, u32)> {
    let place = offset as usize / 4;
    (place < rows * SUBGROUP_SIZE).then_some((place, offset % 4 * 8))
}

/// The patches that a control program runs for.
pub struct ControlInput<'a> {
    /// Outputs of the vertices, one behind the other.
    pub words: &'a [u32],
    /// The vertices of all patches, as many each.
    pub corners: &'a [u32],
    pub points: u32,
    /// The patches' identities.
    pub patches: &'a [Assembled],
    pub commons: &'a [Common],
}

/// A control program behind a vertex program.
pub struct Control<'a> {
    program: &'a Program,
    facts: &'a ControlFacts,
    layout: PatchLayout,
    /// Words of the vertices, and where they lie.
    fills: Vec<(usize, PatchWord)>,
    /// Words of a vertex.
    stride: usize,
    manner: Manner,
}

impl<'a> Control<'a> {
    /// Links the programs of a draw; `None` where there is no control program.
    pub fn new(stages: &'a Stages, vertex: &Program, state: &GraphicsState) -> Option<Self> {
        let (program, evaluation) = stages.tessellation()?;
        let own = program.tessellation()?;
        let facts = own.control.as_ref()?;
        let modes = own.modes.or(evaluation.tessellation()?.modes);
        let place = |row| vertex.outputs().iter().position(|other| *other == row);
        let fill = |word: &PatchWord| Some((place(word.row)?, *word));
        Some(Self {
            program,
            facts,
            layout: PatchLayout::new(facts),
            fills: facts.inputs.iter().filter_map(fill).collect(),
            stride: vertex.outputs().len(),
            manner: Manner {
                modes,
                // The order is that of a picture with the origin in its corner.
                clockwise: modes.clockwise.unwrap_or(false) == state.tessellation.lower_left,
            },
        })
    }

    /// Runs the program for all patches.
    ///
    /// # Errors
    /// When a limit stopped it.
    pub fn run(
        &self,
        runner: &mut Runner,
        environment: &Environment,
        limits: &Limits,
        input: &ControlInput<'_>,
        draw: u32,
    ) -> Result<Patches, Stopped> {
        let mut made = Patches {
            draw,
            commons: input.commons.to_vec(),
            patches: Vec::new(),
            words: Vec::new(),
            manner: self.manner,
        };
        let size = input.patches.len() * self.layout.words();
        (made.words.try_reserve(size)).map_err(|_| Stopped::OutOfMemory)?;
        let (each, subgroups) = (
            self.facts.patches() as usize,
            self.facts.subgroups() as usize,
        );
        let at_once = (subgroups_at_once(self.program).min(SUBGROUPS) / subgroups).max(1);
        let all = (input.patches.chunks(at_once * each)).zip((0..).step_by(at_once * each));
        for (patches, first) in all {
            let workgroups = patches.len().div_ceil(each);
            let shape = Subgroups::of_workgroups(workgroups, subgroups);
            runner.begin(self.program, shape, limits)?;
            for (workgroup, patches) in patches.chunks(each).enumerate() {
                for subgroup in 0..subgroups {
                    let state = runner.state(workgroup * subgroups + subgroup);
                    self.start(state, subgroup, patches, input);
                }
                let memory = runner.shared(workgroup);
                for patch in 0..patches.len() {
                    let of_patch = first + workgroup * each + patch;
                    self.fill(memory, patch, of_patch, input);
                }
            }
            runner.run(self.program, environment, limits)?;
            for (workgroup, patches) in patches.chunks(each).enumerate() {
                let memory = runner.shared(workgroup);
                for (patch, from) in patches.iter().enumerate() {
                    self.collect(memory, patch, from, &mut made);
                }
            }
        }
        Ok(made)
    }

    /// Starts a subgroup of a workgroup that runs those patches.
    fn start(
        &self,
        state: &mut [AlignedRow],
        subgroup: usize,
        patches: &[Assembled],
        input: &ControlInput<'_>,
    ) {
        let vertices = self.facts.vertices as usize;
        let first = subgroup * SUBGROUP_SIZE;
        let count = (patches.len() * vertices - first).min(SUBGROUP_SIZE);
        self.program.start(state, LaneMask::full(count));
        let rows = &mut state[self.program.layout().inputs..];
        for (row, kind) in rows.iter_mut().zip(self.program.inputs()) {
            for (lane, word) in row.0.iter_mut().take(count).enumerate() {
                let (patch, invocation) = ((first + lane) / vertices, (first + lane) % vertices);
                let of = &patches[patch];
                *word = match kind {
                    InputRow::Builtin(Builtin::PatchOffset, _) => {
                        patch as u32 * self.facts.patch_bytes
                    }
                    InputRow::Builtin(Builtin::InvocationId, _) => invocation as u32,
                    InputRow::Builtin(Builtin::PrimitiveId, _) => of.primitive_id,
                    InputRow::Builtin(Builtin::PatchVertices, _) => input.points,
                    InputRow::Builtin(Builtin::ViewIndex, _) => {
                        input.commons[of.common as usize].view
                    }
                    _ => 0,
                };
            }
        }
    }

    /// Fills the memory of a patch with the outputs of its vertices.
    fn fill(
        &self,
        memory: &mut [AlignedRow],
        patch: usize,
        of_patch: usize,
        input: &ControlInput<'_>,
    ) {
        let base = patch as u32 * self.facts.patch_bytes;
        let points = input.points as usize;
        let corners = &input.corners[of_patch * points..][..points];
        for &(word, to) in &self.fills {
            let mut offset = base + to.offset_bytes;
            for &corner in corners {
                let from = input.words[corner as usize * self.stride + word];
                put(memory, offset, to.width, from);
                offset += to.stride_bytes;
            }
        }
    }

    /// Appends a patch, unless its levels discard it.
    fn collect(&self, memory: &[AlignedRow], patch: usize, from: &Assembled, made: &mut Patches) {
        let start = made.words.len();
        let base = patch as u32 * self.facts.patch_bytes;
        for vertex in 0..self.facts.vertices {
            made.words.extend(self.layout.of_vertex.iter().map(|word| {
                let offset = base + word.offset_bytes + vertex * word.stride_bytes;
                get(memory, offset, word.width)
            }));
        }
        let of_patch = self.layout.of_patch.iter();
        (made.words).extend(of_patch.map(|it| get(memory, base + it.offset_bytes, it.width)));
        let words = &made.words[start..];
        let level = |row| match self.layout.find(row, 0) {
            Some(place) => f32::from_bits(words[place]),
            None => 0.0,
        };
        let modes = self.manner.modes;
        let outer = [0, 1, 2, 3].map(|index| level(OutputRow::TessLevelOuter(index)));
        let inner = [0, 1].map(|index| level(OutputRow::TessLevelInner(index)));
        let spacing = modes.spacing.unwrap_or(Spacing::Equal);
        let subdivision =
            (modes.domain).and_then(|domain| Subdivision::new(domain, spacing, outer, inner));
        match subdivision {
            Some(subdivision) => made.patches.push(Patch {
                primitive_id: from.primitive_id,
                common: from.common,
                subdivision,
                primitives: subdivision.primitives(modes.point_mode),
            }),
            None => made.words.truncate(start),
        }
    }
}

/// Subdivisions that a worker made last.
#[derive(Default)]
pub struct Subdivided(Vec<(Subdivision, Manner, Arc<Tessellation>)>);

impl Subdivided {
    fn of(&mut self, subdivision: &Subdivision, manner: &Manner) -> Arc<Tessellation> {
        let mut kept = self.0.iter();
        if let Some((.., made)) = kept.find(|(of, how, _)| of == subdivision && how == manner) {
            return Arc::clone(made);
        }
        let made = Arc::new(subdivision.tessellate(manner.modes.point_mode, manner.clockwise));
        if self.0.len() == KEPT {
            self.0.remove(0);
        }
        self.0.push((*subdivision, *manner, Arc::clone(&made)));
        made
    }
}

/// A vertex of a patch's subdivision.
#[derive(Clone, Copy, Debug, Default)]
pub struct DomainVertex {
    patch: u32,
    coordinate: [f32; 3],
}

/// Lists the primitives of pieces and the vertices that they need, each once in its piece.
pub fn list(
    subdivided: &mut Subdivided,
    pieces: &Pieces,
    last: bool,
    vertices: &mut Vec<DomainVertex>,
    primitives: &mut Vec<Assembled>,
) {
    const NONE: u32 = u32::MAX;
    vertices.clear();
    primitives.clear();
    let mut places: Vec<u32> = Vec::new();
    for piece in &pieces.pieces {
        let patch = &pieces.patches.patches[piece.patch as usize];
        let made = subdivided.of(&patch.subdivision, &pieces.patches.manner);
        places.clear();
        places.resize(made.coordinates.len(), NONE);
        let corners = made.corners;
        let range =
            piece.primitives.start as usize * corners..piece.primitives.end as usize * corners;
        for corners in made.vertices[range].chunks_exact(corners) {
            let mut all = [0; 3];
            for (to, &corner) in all.iter_mut().zip(corners) {
                let place = &mut places[usize::from(corner)];
                if *place == NONE {
                    *place = vertices.len() as u32;
                    vertices.push(DomainVertex {
                        patch: piece.patch,
                        coordinate: made.coordinates[usize::from(corner)],
                    });
                }
                *to = *place;
            }
            // A point has one vertex three times, a line its second one twice.
            for missing in corners.len()..all.len() {
                all[missing] = all[missing - 1];
            }
            primitives.push(Assembled {
                vertices: all,
                primitive_id: patch.primitive_id,
                common: patch.common,
                stream: 0,
                provoking: if last { corners.len() as u8 - 1 } else { 0 },
            });
        }
    }
}

/// The source of an input row.
#[derive(Clone, Copy)]
enum PatchRowSource {
    /// A word of the patch.
    Word(usize),
    Coordinate(usize),
    PrimitiveId,
    View,
    Constant(u32),
}

/// An evaluation program behind a control program.
pub struct Evaluation {
    fills: Vec<PatchRowSource>,
    /// Words of a patch.
    stride: usize,
    inputs: usize,
}

impl Evaluation {
    /// Links both programs of a draw; `None` where there are none.
    pub fn new(stages: &Stages) -> Option<Self> {
        let (control, program) = stages.tessellation()?;
        let facts = control.tessellation()?.control.as_ref()?;
        let layout = PatchLayout::new(facts);
        let fill = |row: &InputRow| match *row {
            InputRow::Varying(varying) => {
                match layout.find(varying.output(), varying.vertex().into()) {
                    Some(word) => PatchRowSource::Word(word),
                    None => PatchRowSource::Constant(0),
                }
            }
            InputRow::Builtin(Builtin::TessCoord, index) => {
                PatchRowSource::Coordinate(index.into())
            }
            InputRow::Builtin(Builtin::PrimitiveId, _) => PatchRowSource::PrimitiveId,
            InputRow::Builtin(Builtin::PatchVertices, _) => {
                PatchRowSource::Constant(facts.vertices)
            }
            InputRow::Builtin(Builtin::ViewIndex, _) => PatchRowSource::View,
            _ => PatchRowSource::Constant(0),
        };
        Some(Self {
            fills: program.inputs().iter().map(fill).collect(),
            stride: layout.words(),
            inputs: program.layout().inputs,
        })
    }

    /// Fills the inputs of a subgroup's state.
    pub fn fill(&self, state: &mut [AlignedRow], vertices: &[DomainVertex], from: &Patches) {
        let rows = &mut state[self.inputs..];
        let patch = |vertex: &DomainVertex| &from.patches[vertex.patch as usize];
        for (row, fill) in rows.iter_mut().zip(&self.fills) {
            let row = row.0.iter_mut().zip(vertices);
            match *fill {
                PatchRowSource::Word(word) => row.for_each(|(to, vertex)| {
                    *to = from.words[vertex.patch as usize * self.stride + word];
                }),
                PatchRowSource::Coordinate(index) => {
                    row.for_each(|(to, vertex)| *to = vertex.coordinate[index.min(2)].to_bits());
                }
                PatchRowSource::PrimitiveId => {
                    row.for_each(|(to, it)| *to = patch(it).primitive_id)
                }
                PatchRowSource::View => row.for_each(|(to, vertex)| {
                    *to = from.commons[patch(vertex).common as usize].view;
                }),
                PatchRowSource::Constant(word) => row.for_each(|(to, _)| *to = word),
            }
        }
    }
}
