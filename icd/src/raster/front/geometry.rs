//! Geometry shaders: from primitives of shaded vertices to the primitives that invocations emit, in
//! order of input primitive, invocation and emission.

use ash::vk::PrimitiveTopology as Topology;
use lanes::LaneMask;
use smallvec::SmallVec;
use spirv_jit::environment::Environment;
use spirv_jit::program::{AlignedRow, Builtin, Emits, GeometryFacts, InputRow, MAX_STREAMS};
use spirv_jit::{Program, SUBGROUP_SIZE};

use super::fetch::Common;
use super::outputs::OutputPlaces;
use super::topology::{self, Assembled};
use super::transpose::copy_vertices;
use super::vertices::SUBGROUPS;
use crate::wave::runner::{Runner, Subgroups, subgroups_at_once};
use crate::wave::{Limits, Stopped};

/// Vertices that the primitives of a job may become, at most, unless a single one may become more.
const JOB_VERTICES: u32 = 8192;

/// Primitives of a job, at most, of which each runs a geometry program.
pub fn longest(facts: &GeometryFacts) -> u32 {
    let each = facts.invocations.saturating_mul(facts.max_vertices);
    (JOB_VERTICES / each.max(1)).max(1)
}

/// The topology of each strip that a geometry program emits.
pub fn emitted_topology(facts: &GeometryFacts) -> Topology {
    match facts.emits {
        Emits::Points => Topology::POINT_LIST,
        Emits::LineStrips => Topology::LINE_STRIP,
        Emits::TriangleStrips => Topology::TRIANGLE_STRIP,
    }
}

/// The source of an input row.
#[derive(Clone, Copy)]
enum GeometryRowSource {
    /// A word of a vertex of the primitive.
    Vertex {
        vertex: usize,
        word: usize,
    },
    PrimitiveId,
    InvocationId,
    View,
    Zero,
}

/// The primitives that a geometry program runs for.
pub struct GeometryInput<'a> {
    /// Outputs of the vertices, one behind the other.
    pub words: &'a [u32],
    /// The vertices of all primitives, as many each as the program takes.
    pub corners: &'a [u32],
    /// Their identities.
    pub primitives: &'a [Assembled],
    pub commons: &'a [Common],
}

/// The vertices that the invocations of a subgroup have emitted.
struct Emitted<'a> {
    /// Vertices of each invocation.
    counts: &'a AlignedRow,
    /// Where strips start, and their streams.
    starts: &'a [AlignedRow],
    /// Rows of each word of a vertex.
    words: SmallVec<[&'a [AlignedRow]; 32]>,
}

/// A geometry program behind a vertex program.
pub struct Geometry<'a> {
    program: &'a Program,
    facts: GeometryFacts,
    fills: Vec<GeometryRowSource>,
    /// Words of a vertex of its input.
    stride: usize,
    places: &'a OutputPlaces,
    /// The last vertex of a primitive is its provoking one.
    last: bool,
}

impl<'a> Geometry<'a> {
    /// Links a program to the outputs of the vertex program; `places` are of its own outputs.
    pub fn new(
        program: &'a Program,
        facts: &GeometryFacts,
        vertex: &Program,
        places: &'a OutputPlaces,
        last: bool,
    ) -> Self {
        let fill = |row: &InputRow| match *row {
            InputRow::Varying(varying) => {
                let wanted = varying.output();
                match vertex.outputs().iter().position(|row| *row == wanted) {
                    Some(word) => GeometryRowSource::Vertex {
                        vertex: varying.vertex().into(),
                        word,
                    },
                    None => GeometryRowSource::Zero,
                }
            }
            InputRow::Builtin(Builtin::PrimitiveId, _) => GeometryRowSource::PrimitiveId,
            InputRow::Builtin(Builtin::InvocationId, _) => GeometryRowSource::InvocationId,
            InputRow::Builtin(Builtin::ViewIndex, _) => GeometryRowSource::View,
            _ => GeometryRowSource::Zero,
        };
        Self {
            program,
            facts: *facts,
            fills: program.inputs().iter().map(fill).collect(),
            stride: vertex.outputs().len(),
            places,
            last,
        }
    }

    /// Invocations for so many primitives.
    pub fn invocations(&self, primitives: usize) -> u64 {
        primitives as u64 * u64::from(self.facts.invocations)
    }

    /// Runs the invocations of all primitives. Appends the vertices' words to `outputs`, and
    /// primitives of vertices that are counted from the first appended one.
    ///
    /// # Errors
    /// When a limit stopped it.
    pub fn run(
        &self,
        runner: &mut Runner,
        environment: &Environment,
        limits: &Limits,
        input: &GeometryInput<'_>,
        outputs: &mut Vec<u32>,
        primitives: &mut Vec<Assembled>,
    ) -> Result<(), Stopped> {
        let first_word = outputs.len();
        let invocations = input.primitives.len() * self.facts.invocations as usize;
        let at_once = subgroups_at_once(self.program).min(SUBGROUPS) * SUBGROUP_SIZE;
        for first in (0..invocations).step_by(at_once) {
            let end = invocations.min(first + at_once);
            let lanes_of = |first: usize| first..end.min(first + SUBGROUP_SIZE);
            let starts = (first..end).step_by(SUBGROUP_SIZE);
            runner.begin(self.program, Subgroups::apart(starts.len()), limits)?;
            for (state, first) in runner.states().zip(starts.clone()) {
                let lanes = lanes_of(first);
                self.program.start(state, LaneMask::full(lanes.len()));
                self.fill(state, lanes, input);
            }
            runner.run(self.program, environment, limits)?;
            for (state, first) in runner.states().zip(starts) {
                let state = &*state;
                let rows = |word| self.program.emitted_rows(state, word);
                let emitted = Emitted {
                    counts: &state[self.program.layout().io],
                    starts: rows(0),
                    words: (0..self.places.words).map(|word| rows(1 + word)).collect(),
                };
                let lanes = lanes_of(first);
                let base = self.copy(&emitted, lanes.len(), first_word, outputs)?;
                for ((lane, invocation), base) in lanes.enumerate().zip(base) {
                    let from = &input.primitives[invocation / self.facts.invocations as usize];
                    let words = &outputs[first_word..];
                    self.collect(&emitted, lane, from, base, words, primitives)?;
                }
            }
        }
        Ok(())
    }

    /// Fills the inputs of a subgroup's state, for those invocations.
    fn fill(
        &self,
        state: &mut [AlignedRow],
        lanes: std::ops::Range<usize>,
        input: &GeometryInput<'_>,
    ) {
        let rows = &mut state[self.program.layout().inputs..];
        let each = self.facts.invocations as usize;
        let size = self.facts.vertices as usize;
        // The primitive of each lane, and its invocation.
        let mut at = [(0, 0); SUBGROUP_SIZE];
        for (at, invocation) in at.iter_mut().zip(lanes.clone()) {
            *at = (invocation / each, (invocation % each) as u32);
        }
        let at = &at[..lanes.len()];
        for (row, fill) in rows.iter_mut().zip(&self.fills) {
            let row = row.0.iter_mut().zip(at);
            match *fill {
                GeometryRowSource::Vertex { vertex, word } => {
                    row.for_each(|(to, &(primitive, _))| {
                        let vertex = input.corners[primitive * size + vertex] as usize;
                        *to = input.words[vertex * self.stride + word];
                    })
                }
                GeometryRowSource::PrimitiveId => row.for_each(|(to, &(primitive, _))| {
                    *to = input.primitives[primitive].primitive_id;
                }),
                GeometryRowSource::InvocationId => {
                    row.for_each(|(to, &(_, invocation))| *to = invocation)
                }
                GeometryRowSource::View => row.for_each(|(to, &(primitive, _))| {
                    let common = input.primitives[primitive].common;
                    *to = input.commons[common as usize].view;
                }),
                GeometryRowSource::Zero => row.for_each(|(to, _)| *to = 0),
            }
        }
    }

    /// Vertices that an invocation emitted.
    fn count(&self, emitted: &Emitted<'_>, lane: usize) -> usize {
        emitted.counts.0[lane].min(self.facts.max_vertices) as usize
    }

    /// Appends the vertices of the first `lanes` invocations of a subgroup, one invocation behind
    /// the other. Gives the number of each one's first vertex, counted from `first_word`.
    fn copy(
        &self,
        emitted: &Emitted<'_>,
        lanes: usize,
        first_word: usize,
        outputs: &mut Vec<u32>,
    ) -> Result<[usize; SUBGROUP_SIZE], Stopped> {
        let words = self.places.words;
        let mut total = (outputs.len() - first_word).checked_div(words).unwrap_or(0);
        let mut base = [0; SUBGROUP_SIZE];
        let mut counts = [0; SUBGROUP_SIZE];
        for lane in 0..lanes {
            base[lane] = total;
            counts[lane] = self.count(emitted, lane);
            total += counts[lane];
        }
        let end = first_word + total * words;
        (outputs.try_reserve(end - outputs.len())).map_err(|_| Stopped::OutOfMemory)?;
        outputs.resize(end, 0);
        let most = counts.into_iter().max().unwrap_or(0);
        let to = &mut outputs[first_word..];
        let least = counts[..lanes].iter().copied().min().unwrap_or(0);
        for vertex in 0..least {
            let mut starts = base;
            for start in &mut starts {
                *start = (*start + vertex) * words;
            }
            let row = |word: usize| &emitted.words[word][vertex].0;
            copy_vertices(words, row, &starts[..lanes], to);
        }
        // Of invocations that emitted more than others.
        for vertex in least..most {
            for (word, rows) in emitted.words.iter().enumerate() {
                let row = &rows[vertex].0;
                for lane in 0..lanes {
                    if vertex < counts[lane] {
                        to[(base[lane] + vertex) * words + word] = row[lane];
                    }
                }
            }
        }
        Ok(base)
    }

    /// Appends the primitives of an invocation, whose first vertex is `base`. `words`: of all
    /// vertices.
    fn collect(
        &self,
        emitted: &Emitted<'_>,
        lane: usize,
        from: &Assembled,
        base: usize,
        words: &[u32],
        primitives: &mut Vec<Assembled>,
    ) -> Result<(), Stopped> {
        let count = self.count(emitted, lane);
        (primitives.try_reserve(count)).map_err(|_| Stopped::OutOfMemory)?;
        let stride = self.places.words;
        let topology = emitted_topology(&self.facts);
        let provoking = topology::provoking(topology, self.last);
        let starts = &emitted.starts[..count];
        // With streams: the vertices of one of them.
        let mut own = Vec::new();
        let streams = if self.facts.streams { MAX_STREAMS } else { 1 };
        for stream in 0..streams {
            let mut count = count;
            if self.facts.streams {
                own.clear();
                own.extend((0..count).filter(|&vertex| starts[vertex].0[lane] >> 1 == stream));
                count = own.len();
            }
            let vertex_at = |place: usize| own.get(place).copied().unwrap_or(place);
            let is_start = |place: usize| starts[vertex_at(place)].0[lane] & 1 != 0;
            let mut first = 0;
            while first < count {
                let mut end = first + 1;
                while end < count && (topology == Topology::POINT_LIST || !is_start(end)) {
                    end += 1;
                }
                for primitive in 0..topology::count(topology, (end - first) as u32) {
                    let strip = topology::vertices(topology, primitive, self.last)
                        .map(|vertex| vertex_at(first + vertex as usize));
                    let corner = strip[usize::from(provoking)];
                    primitives.push(Assembled {
                        vertices: strip.map(|vertex| (base + vertex) as u32),
                        primitive_id: match self.places.primitive_id {
                            Some(word) => words[(base + corner) * stride + usize::from(word)],
                            None => from.primitive_id,
                        },
                        common: from.common,
                        provoking,
                        stream: stream as u8,
                    });
                }
                first = end;
            }
        }
        Ok(())
    }
}
