//! Programs that only sample one image, once, and multiply the texel, as for textured triangles and
//! boxes of user interfaces. The outputs can be computed from the inputs and the sample without
//! running the program.

#![forbid(unsafe_code)]

use std::collections::HashMap;

use images::{Dim, ImageOp, ImageOpKind, LodMode, TexelType};

use super::module::{Module, Node, Terminator};
use super::op::DescriptorBinding;
use super::pass_through::PassThrough;
use super::{Inst, Op, Value};

/// A descriptor, by a constant index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bound {
    pub binding: DescriptorBinding,
    pub index: u32,
}

/// The description of such a program.
#[derive(Clone, Debug)]
pub struct Modulated {
    /// A sample of a 2D image at the derivatives of its coordinates.
    pub op: ImageOp,
    pub image: Bound,
    pub sampler: Bound,
    /// Rows of inputs.
    pub coordinates: [u32; 2],
    pub outputs: Vec<ModulatedOutput>,
    /// A bit for each used component of the texel.
    pub wanted: u8,
}

/// An output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModulatedOutput {
    PassThrough(PassThrough),
    /// A component of the texel.
    Texel(u8),
    /// A component of the texel, multiplied.
    Product(u8, PassThrough),
}

/// The origin of a value.
#[derive(Clone, Copy)]
enum ValueOrigin {
    Output(ModulatedOutput),
    Descriptor(Bound),
    /// The derivative of a coordinate, along an axis.
    Slope(usize, Value),
}

/// The description of a module, if it is such a program.
pub fn modulated(module: &Module) -> Option<Modulated> {
    let body = &module.functions.first()?.body;
    let mut analysis = ModulateAnalysis::default();
    for node in &body.nodes {
        let Node::Inst(inst) = node else {
            return None;
        };
        analysis.add(inst)?;
    }
    let Terminator::End(outputs) = &body.end else {
        return None;
    };
    let outputs: Option<Vec<ModulatedOutput>> = outputs
        .iter()
        .map(|value| analysis.output(*value))
        .collect();
    let outputs = outputs?;
    let wanted = outputs.iter().fold(0, |wanted, output| match *output {
        ModulatedOutput::PassThrough(_) => wanted,
        ModulatedOutput::Texel(component) | ModulatedOutput::Product(component, _) => {
            wanted | 1 << component
        }
    });
    let (op, image, sampler, coordinates) = analysis.sample?;
    (wanted != 0).then_some(Modulated {
        op,
        image,
        sampler,
        coordinates,
        outputs,
        wanted,
    })
}

#[derive(Default)]
struct ModulateAnalysis {
    known: HashMap<Value, ValueOrigin>,
    sample: Option<(ImageOp, Bound, Bound, [u32; 2])>,
}

impl ModulateAnalysis {
    fn output(&self, value: Value) -> Option<ModulatedOutput> {
        match self.known.get(&value)? {
            ValueOrigin::Output(output) => Some(*output),
            _ => None,
        }
    }

    fn passed(&self, value: Value) -> Option<PassThrough> {
        match self.output(value)? {
            ModulatedOutput::PassThrough(passed) => Some(passed),
            _ => None,
        }
    }

    fn descriptor(&self, value: Value) -> Option<Bound> {
        match self.known.get(&value)? {
            ValueOrigin::Descriptor(bound) => Some(*bound),
            _ => None,
        }
    }

    fn add(&mut self, inst: &Inst) -> Option<()> {
        let known = match (&inst.op, inst.args.as_slice()) {
            (Op::Const(bits), _) => ValueOrigin::Output(ModulatedOutput::PassThrough(
                PassThrough::Constant(*bits as u32),
            )),
            (Op::Input(row), _) => {
                ValueOrigin::Output(ModulatedOutput::PassThrough(PassThrough::Input(*row)))
            }
            (Op::Bitcast, [from]) => *self.known.get(from)?,
            (Op::Descriptor(binding), [index]) => match self.passed(*index)? {
                PassThrough::Constant(index) => ValueOrigin::Descriptor(Bound {
                    binding: *binding,
                    index,
                }),
                PassThrough::Input(_) => return None,
            },
            (Op::DerivativeX, [of]) => ValueOrigin::Slope(0, *of),
            (Op::DerivativeY, [of]) => ValueOrigin::Slope(1, *of),
            (Op::FMul, [a, b]) => match (self.output(*a)?, self.output(*b)?) {
                (ModulatedOutput::Texel(texel), ModulatedOutput::PassThrough(factor))
                | (ModulatedOutput::PassThrough(factor), ModulatedOutput::Texel(texel)) => {
                    ValueOrigin::Output(ModulatedOutput::Product(texel, factor))
                }
                _ => return None,
            },
            (Op::Image(op), args) => return self.add_sample(inst, op, args),
            _ => return None,
        };
        self.known.insert(*inst.results.first()?, known);
        Some(())
    }

    /// A sample at the derivatives of its own coordinates, and the only one.
    fn add_sample(&mut self, inst: &Inst, op: &ImageOp, args: &[Value]) -> Option<()> {
        let is_plain = op.kind == ImageOpKind::Sample
            && op.dim == Dim::D2
            && op.lod == LodMode::Grad
            && op.texel == TexelType::F32
            && !(op.arrayed || op.depth_compare || op.has_min_lod || op.has_offset);
        let &[image, sampler, s, t, ref slopes @ ..] = args else {
            return None;
        };
        let expected = [(0, s), (0, t), (1, s), (1, t)];
        let is_one = |(slope, (axis, of)): (&Value, (usize, Value))| {
            let known = self.known.get(slope);
            matches!(known, Some(ValueOrigin::Slope(along, value)) if (*along, *value) == (axis, of))
        };
        let are_its = slopes.len() == expected.len() && slopes.iter().zip(expected).all(is_one);
        if !is_plain || !are_its || self.sample.is_some() || inst.results.len() != 4 {
            return None;
        }
        let (PassThrough::Input(s), PassThrough::Input(t)) = (self.passed(s)?, self.passed(t)?)
        else {
            return None;
        };
        let (image, sampler) = (self.descriptor(image)?, self.descriptor(sampler)?);
        self.sample = Some((*op, image, sampler, [s, t]));
        for (component, result) in (0..).zip(&inst.results) {
            let known = ValueOrigin::Output(ModulatedOutput::Texel(component));
            self.known.insert(*result, known);
        }
        Some(())
    }
}
