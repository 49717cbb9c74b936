//! Results of fragments that need no program run: draws without a program, and programs that only
//! pass on varyings and constants.

use lanes::Tier;
use lanes::vector::Vector;
use smallvec::SmallVec;

use super::inputs::{Inputs, Slope};
use super::lanes::rows_of;
use super::output::Output;
use crate::raster::primitive::{Bounds, Chunk, PlaneEquation, Record};

/// The result of fragments without a program run.
pub struct PassThrough {
    /// The outputs; none of a draw without a program.
    pub slopes: Option<Vec<Slope>>,
    /// The stored colours do not affect the result.
    pub replaces: bool,
    /// The texels of all primitives, where those are the same.
    pub constant: Option<Texels>,
}

/// A texel of each attachment that is drawn to.
pub type Texels = SmallVec<[[u32; 4]; 2]>;

/// A primitive in a tile.
pub struct Part<'a> {
    pub record: &'a Record,
    /// Its λᵢ ([`Chunk::linear_of`]).
    pub linear: &'a [PlaneEquation; 3],
    /// Outputs of its vertices.
    pub outputs: &'a [u32],
    /// The tile's first pixel.
    pub corner: [i32; 2],
    /// The render area.
    pub area: &'a Bounds,
}

/// An output of a primitive's fragments. A structure, since its parts are read one by one soon
/// after they are written: a copy of all in one would wait for them.
#[derive(Clone, Copy)]
pub struct Value {
    /// At the first vertex.
    pub word: u32,
    /// Differences of the other vertices from it, as numbers.
    pub others: [f32; 2],
    pub change: Change,
}

/// How an output changes across a primitive.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Change {
    None,
    Linear,
    Perspective,
}

impl Value {
    /// One that is the same everywhere.
    #[inline(always)]
    pub fn same(word: u32) -> Self {
        Self {
            word,
            others: [0.0; 2],
            change: Change::None,
        }
    }

    /// The word of all fragments, if they have the same.
    #[inline(always)]
    pub fn word(&self) -> Option<u32> {
        (self.change == Change::None).then_some(self.word)
    }
}

impl PassThrough {
    /// Of a program whose outputs are rows like inputs; none where they depend on more than pixels'
    /// centres.
    pub fn new(tier: Tier, rows: Option<&Inputs>, output: &Output) -> Option<Self> {
        let slopes = match rows {
            Some(rows) => Some(rows.slopes(output.rows)?),
            None => None,
        };
        let constants = slopes.iter().flatten().map(|slope| match *slope {
            Slope::Constant(word) => Some(Value::same(word)),
            _ => None,
        });
        let replaces = output.replaces();
        let constants = constants.collect::<Option<Vec<Value>>>();
        let constant = constants.filter(|_| replaces);
        Some(Self {
            constant: constant.and_then(|values| texels(tier, output, &values)),
            slopes,
            replaces,
        })
    }
}

lanes::vectors! {
    /// The texels that are written, if all fragments leave the same.
    fn texels<V>(v, output: &Output, values: &[Value]) -> Option<Texels> {
        texels_of(v, output, values)
    }
}

/// As [`texels`].
#[inline(always)]
pub fn texels_of<V: Vector>(v: V, output: &Output, values: &[Value]) -> Option<Texels> {
    let mut texels = SmallVec::new();
    for color in &output.colors {
        let mut source = [v.splat_i(0); 4];
        for (component, place) in color.source.iter().enumerate() {
            let Some(place) = place else {
                continue;
            };
            source[component] = v.splat_i(values[*place].word()? as i32);
        }
        let words = color.encode(v, &color.with_alpha(v, source));
        let rows = rows_of(v, &words);
        texels.push([rows[0][0], rows[1][0], rows[2][0], rows[3][0]]);
    }
    Some(texels)
}

impl<'a> Part<'a> {
    /// A primitive of a chunk in a tile that starts at a corner.
    #[inline(always)]
    pub fn new(chunk: &'a Chunk, record: &'a Record, corner: [i32; 2], area: &'a Bounds) -> Self {
        Self {
            record,
            linear: chunk.linear_of(record),
            outputs: &chunk.outputs,
            corner,
            area,
        }
    }
}

impl Part<'_> {
    #[inline(always)]
    fn word(&self, vertex: usize, word: u32) -> u32 {
        self.word_from(self.record.vertices[vertex], word)
    }

    fn word_from(&self, first: u32, word: u32) -> u32 {
        let place = first.wrapping_add(word);
        self.outputs.get(place as usize).copied().unwrap_or(0)
    }

    #[inline(always)]
    pub fn value(&self, slope: &Slope) -> Value {
        let record = self.record;
        Value::same(match *slope {
            Slope::Constant(word) => word,
            Slope::Flat(word) => self.word(usize::from(record.provoking.min(2)), word),
            Slope::PerVertex(word, vertex) => self.word(vertex, word),
            Slope::OfPrimitive(word) => self.word_from(record.words, word),
            Slope::Front => u32::from(record.front),
            Slope::Layer => record.layer.into(),
            Slope::Viewport => record.viewport.into(),
            Slope::Primitive => record.primitive_id,
            Slope::View => record.view_index.into(),
            Slope::Varying(word, perspective) => {
                let at = |vertex: usize| f32::from_bits(self.word(vertex, word));
                let first = at(0);
                let others = [at(1) - first, at(2) - first];
                // Its sum with products of zeros and numbers; −0 would become 0.
                if record.is_affine && others == [0.0; 2] && first.to_bits() != (-0.0f32).to_bits()
                {
                    return Value::same(first.to_bits());
                }
                return Value {
                    word: first.to_bits(),
                    others,
                    change: match perspective {
                        true => Change::Perspective,
                        false => Change::Linear,
                    },
                };
            }
        })
    }
}
