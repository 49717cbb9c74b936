//! Inputs and outputs of vertex and fragment shaders, word by word: locations, components, interpolation, and built-ins in variables or in
//! members of blocks.
//!
//! A word's place follows from `Location` and `Component` alone, so that stages are compiled apart (Vulkan, section "Interface Matching").

use std::rc::Rc;

use rspirv::spirv::{BuiltIn, Decoration, ExecutionMode, StorageClass};

use super::types::TypeKind;
use super::{Lowerer, budget};
use crate::Error;
use crate::ir::interface::{
    Barycentric, DepthMode, FragmentFacts, Interlock, OutputRow, Position, Varying, VaryingMode,
    VaryingPlace,
};
use crate::ir::{self, InputRow, Type, Value};
use crate::parse::Id;
use crate::program::{Builtin, Stage};

/// Words of a stage's inputs or outputs, at most: far beyond any device's limit.
const MAX_WORDS: usize = 1 << 12;

/// Words of a location.
const LOCATION_WORDS: u32 = 4;

/// One row of a variable's value, as a stage's interface has it.
#[derive(Clone, Copy, Debug)]
pub(super) struct InterfaceWord {
    place: WordPlace,
    how: Interpolation,
}

#[derive(Clone, Copy, Debug)]
enum WordPlace {
    Location { location: u32, component: u32 },
    BuiltIn(BuiltIn, u32),
}

/// What decorations say of a varying, and of a colour's index.
#[derive(Clone, Copy, Debug)]
struct Interpolation {
    flat: bool,
    linear: bool,
    position: Position,
    /// Of an element of a `PerVertexKHR` array.
    vertex: Option<u8>,
    index: u8,
}

impl Interpolation {
    fn mode(self, ty: Type) -> VaryingMode {
        match self.vertex {
            Some(vertex) => VaryingMode::PerVertex(vertex),
            None if self.flat || ty != Type::F32 => VaryingMode::Flat,
            None if self.linear => VaryingMode::Linear(self.position),
            None => VaryingMode::Smooth(self.position),
        }
    }
}

impl Lowerer<'_> {
    /// Whether inputs and outputs are those of the rasterizer's stages.
    pub(super) fn is_rasterized(&self) -> bool {
        matches!(self.request.stage, Stage::Vertex | Stage::Fragment)
    }

    /// What each row of a variable's value is.
    pub(super) fn interface_words(&self, id: Id) -> Result<Rc<[InterfaceWord]>, Error> {
        let annotations = &self.module.annotations;
        let find = |decoration| annotations.id(id, decoration);
        let how = self.interpolation(&find, None);
        let mut pointee = self.variables[&id].pointee;
        let mut words = Vec::new();
        let location = find(Decoration::Location).unwrap_or(0);
        let component = find(Decoration::Component).unwrap_or(0);
        if let Some(built_in) = find(Decoration::BuiltIn).and_then(BuiltIn::from_u32) {
            let rows = self.types.info(pointee)?.rows;
            self.push_built_in(&mut words, built_in, rows, how)?;
            return Ok(words.into());
        }
        let mut vertices = 1;
        if find(Decoration::PerVertexKHR).is_some()
            && let TypeKind::Array { element, count } = *self.types.kind(pointee)?
        {
            (pointee, vertices) = (element, count);
        }
        for vertex in 0..vertices {
            let how = Interpolation {
                vertex: (find(Decoration::PerVertexKHR).is_some()).then_some(vertex as u8),
                ..how
            };
            self.place(&mut words, pointee, location, component, how)?;
        }
        Ok(words.into())
    }

    fn interpolation(
        &self,
        find: &dyn Fn(Decoration) -> Option<u32>,
        outer: Option<Interpolation>,
    ) -> Interpolation {
        let has = |decoration| find(decoration).is_some();
        let from = outer.unwrap_or(Interpolation {
            flat: false,
            linear: false,
            position: Position::Center,
            vertex: None,
            index: 0,
        });
        Interpolation {
            flat: from.flat || has(Decoration::Flat),
            linear: from.linear || has(Decoration::NoPerspective),
            position: if has(Decoration::Sample) {
                Position::Sample
            } else if has(Decoration::Centroid) {
                Position::Centroid
            } else {
                from.position
            },
            vertex: from.vertex,
            index: find(Decoration::Index).map_or(from.index, |index| index.min(1) as u8),
        }
    }

    fn push_built_in(
        &self,
        words: &mut Vec<InterfaceWord>,
        built_in: BuiltIn,
        rows: u64,
        how: Interpolation,
    ) -> Result<(), Error> {
        if rows as usize + words.len() > MAX_WORDS {
            return Err(budget("a stage's interface is too large"));
        }
        words.extend((0..rows as u32).map(|word| InterfaceWord {
            place: WordPlace::BuiltIn(built_in, word),
            how,
        }));
        Ok(())
    }

    /// Locations that a type takes.
    fn locations(&self, ty: Id) -> Result<u32, Error> {
        Ok(match self.types.kind(ty)? {
            TypeKind::Vector { .. } => {
                let rows = self.types.info(ty)?.rows as u32;
                rows.div_ceil(LOCATION_WORDS)
            }
            TypeKind::Matrix { column, count } => self.locations(*column)?.saturating_mul(*count),
            TypeKind::Array { element, count } => self.locations(*element)?.saturating_mul(*count),
            TypeKind::Struct { members } => {
                let mut sum = 0u32;
                for &member in members.iter() {
                    sum = sum.saturating_add(self.locations(member)?);
                }
                sum
            }
            _ => 1,
        })
    }

    /// Places a value of a type from a location on.
    fn place(
        &self,
        words: &mut Vec<InterfaceWord>,
        ty: Id,
        location: u32,
        component: u32,
        how: Interpolation,
    ) -> Result<(), Error> {
        match self.types.kind(ty)?.clone() {
            TypeKind::Matrix {
                column: element,
                count,
            }
            | TypeKind::Array { element, count } => {
                let step = self.locations(element)?;
                for index in 0..count {
                    let at = location.saturating_add(index.saturating_mul(step));
                    self.place(words, element, at, component, how)?;
                }
            }
            TypeKind::Struct { members } => {
                let mut next = location;
                for (index, &member) in members.iter().enumerate() {
                    let find =
                        |decoration| self.module.annotations.member(ty, index as u32, decoration);
                    let how = self.interpolation(&find, Some(how));
                    if let Some(built_in) = find(Decoration::BuiltIn).and_then(BuiltIn::from_u32) {
                        let rows = self.types.info(member)?.rows;
                        self.push_built_in(words, built_in, rows, how)?;
                        continue;
                    }
                    next = find(Decoration::Location).unwrap_or(next);
                    let component = find(Decoration::Component).unwrap_or(0);
                    self.place(words, member, next, component, how)?;
                    next = next.saturating_add(self.locations(member)?);
                }
            }
            _ => {
                let rows = self.types.info(ty)?.rows as u32;
                if rows as usize + words.len() > MAX_WORDS {
                    return Err(budget("a stage's interface is too large"));
                }
                words.extend((component..component.saturating_add(rows)).map(|word| {
                    InterfaceWord {
                        place: WordPlace::Location {
                            location: location.saturating_add(word / LOCATION_WORDS),
                            component: word % LOCATION_WORDS,
                        },
                        how,
                    }
                }));
            }
        }
        Ok(())
    }

    /// The scalars of (a part of) an input of a rasterizer's stage, from a word on; `at` evaluates varyings elsewhere than decorated.
    pub(super) fn load_stage_input(
        &mut self,
        variable: Id,
        word: u32,
        ty: Id,
        at: Option<Position>,
    ) -> Result<Vec<Value>, Error> {
        let words = self.interface_words(variable)?;
        let types = self.types.leaves(ty)?;
        let mut rows = Vec::with_capacity(types.len());
        let mut next = word as usize;
        for &ty in types.iter() {
            for half in 0..ty.rows() as usize {
                // A computed index past the end is undefined; the last word will do.
                let from = words.get(next + half).or(words.last()).copied();
                let Some(from) = from else {
                    return Err(self.b.invalid("an input without words"));
                };
                rows.push(self.input_word(from, ty, at)?);
            }
            next += ty.rows() as usize;
        }
        self.words_to_scalars(&rows, &types)
    }

    fn input_word(
        &mut self,
        word: InterfaceWord,
        ty: Type,
        at: Option<Position>,
    ) -> Result<Value, Error> {
        let row_type = if ty == Type::F32 { ty } else { Type::I32 };
        match word.place {
            WordPlace::BuiltIn(built_in, index) => self.built_in_word(built_in, index, row_type),
            WordPlace::Location {
                location,
                component,
            } => {
                if self.request.stage == Stage::Vertex {
                    let row = InputRow::Attribute {
                        location: u16::try_from(location).unwrap_or(u16::MAX),
                        component: component as u8,
                    };
                    return self.input(row, row_type);
                }
                let mut word = word;
                word.how.position = at.unwrap_or(word.how.position);
                let varying = self.varying(word, ty);
                let varying = varying.ok_or_else(|| self.b.invalid("not a varying"))?;
                self.input(InputRow::Varying(varying), row_type)
            }
        }
    }

    /// The varying that a word of a fragment shader's input is, as its decorations have it.
    pub(super) fn varying(&self, word: InterfaceWord, ty: Type) -> Option<Varying> {
        let WordPlace::Location {
            location,
            component,
        } = word.place
        else {
            return None;
        };
        Some(Varying {
            place: VaryingPlace::Location(u16::try_from(location).unwrap_or(u16::MAX)),
            component: component as u8,
            mode: word.how.mode(ty),
        })
    }

    /// Built-in inputs that are rows of their own kind.
    pub(super) fn special_input(
        &mut self,
        variable: Option<Id>,
        built_in: BuiltIn,
        word: u32,
        ty: Type,
    ) -> Result<Option<Value>, Error> {
        let component = word.min(u32::from(u8::MAX)) as u8;
        let distance = |place| {
            InputRow::Varying(Varying {
                place,
                component,
                mode: VaryingMode::Smooth(Position::Center),
            })
        };
        let row = match built_in {
            BuiltIn::HelperInvocation => {
                let helper = self.b.emit(ir::Op::IsHelper, &[], Type::I1)?;
                return self.bool_to_word(helper).map(Some);
            }
            BuiltIn::ClipDistance => distance(VaryingPlace::ClipDistance),
            BuiltIn::CullDistance => distance(VaryingPlace::CullDistance),
            BuiltIn::BaryCoordKHR | BuiltIn::BaryCoordNoPerspKHR => {
                let annotations = &self.module.annotations;
                let find = |decoration| variable.and_then(|id| annotations.id(id, decoration));
                InputRow::Barycentric(Barycentric {
                    vertex: component.min(2),
                    perspective: built_in == BuiltIn::BaryCoordKHR,
                    position: self.interpolation(&find, None).position,
                })
            }
            _ => return Ok(None),
        };
        self.input(row, ty).map(Some)
    }

    /// The outputs of the entry point: their variables, and what each word is.
    pub(super) fn declare_outputs(&mut self) -> Result<(), Error> {
        let mut ids: Vec<Id> = (self.variables.iter())
            .filter(|(_, variable)| variable.class == StorageClass::Output)
            .map(|(&id, _)| id)
            .filter(|&id| self.is_listed(id) && self.entry.interface.contains(&id))
            .collect();
        ids.sort_unstable();
        for &id in &ids {
            for word in self.interface_words(id)?.iter() {
                let row = self.output_row(*word)?;
                self.outputs.push(row);
            }
            if self.outputs.len() > MAX_WORDS {
                return Err(budget("a stage's interface is too large"));
            }
        }
        self.output_variables = ids;
        self.output_rows = self.outputs.len() as u32;
        Ok(())
    }

    fn output_row(&self, word: InterfaceWord) -> Result<OutputRow, Error> {
        Ok(match word.place {
            WordPlace::Location {
                location,
                component,
            } => OutputRow::Location {
                location: u16::try_from(location).unwrap_or(u16::MAX),
                component: component as u8,
                index: word.how.index,
            },
            WordPlace::BuiltIn(built_in, index) => {
                let index = index.min(u32::from(u8::MAX)) as u8;
                match built_in {
                    BuiltIn::Position => OutputRow::Position(index),
                    BuiltIn::PointSize => OutputRow::PointSize,
                    BuiltIn::ClipDistance => OutputRow::ClipDistance(index),
                    BuiltIn::CullDistance => OutputRow::CullDistance(index),
                    BuiltIn::Layer => OutputRow::Layer,
                    BuiltIn::ViewportIndex => OutputRow::ViewportIndex,
                    BuiltIn::FragDepth => OutputRow::FragDepth,
                    BuiltIn::FragStencilRefEXT => OutputRow::FragStencilRef,
                    BuiltIn::SampleMask => OutputRow::SampleMask,
                    other => {
                        let message = format!("built-in {other:?} is no output here");
                        return Err(Error::unsupported(self.b.source, message));
                    }
                }
            }
        })
    }

    /// The values of all output words.
    pub(super) fn output_words(&mut self) -> Result<Vec<Value>, Error> {
        let mut words = Vec::with_capacity(self.outputs.len());
        for id in self.output_variables.clone() {
            let pointer = self.module_pointer(id)?;
            let values = self.load(&pointer)?;
            words.extend(self.scalars_to_words(&values)?);
        }
        Ok(words)
    }

    /// What execution modes and outputs say of a fragment shader.
    pub(super) fn fragment_facts(&self) -> Option<FragmentFacts> {
        if self.request.stage != Stage::Fragment {
            return None;
        }
        let mut facts = FragmentFacts {
            reads_attachments: self.reads_attachments,
            ..FragmentFacts::default()
        };
        let mut mode = DepthMode::Any;
        for &index in &self.module.execution_modes {
            let operands = self.module.operands(self.module.instruction(index));
            if operands[0] != self.entry.function {
                continue;
            }
            match ExecutionMode::from_u32(operands[1]) {
                Some(ExecutionMode::EarlyFragmentTests) => facts.early_tests = true,
                Some(ExecutionMode::PostDepthCoverage) => facts.post_depth_coverage = true,
                Some(ExecutionMode::RequireFullQuadsKHR) => facts.full_quads = true,
                Some(ExecutionMode::DepthGreater) => mode = DepthMode::Greater,
                Some(ExecutionMode::DepthLess) => mode = DepthMode::Less,
                Some(ExecutionMode::DepthUnchanged) => mode = DepthMode::Unchanged,
                Some(ExecutionMode::PixelInterlockOrderedEXT) => {
                    facts.interlock = Some(Interlock::PixelOrdered);
                }
                Some(ExecutionMode::PixelInterlockUnorderedEXT) => {
                    facts.interlock = Some(Interlock::PixelUnordered);
                }
                Some(ExecutionMode::SampleInterlockOrderedEXT) => {
                    facts.interlock = Some(Interlock::SampleOrdered);
                }
                Some(ExecutionMode::SampleInterlockUnorderedEXT) => {
                    facts.interlock = Some(Interlock::SampleUnordered);
                }
                _ => {}
            }
        }
        for row in &self.outputs {
            match *row {
                OutputRow::Location {
                    location, index, ..
                } => {
                    facts.color_mask |= 1u32.checked_shl(location.into()).unwrap_or(0);
                    facts.dual_source |= index == 1;
                }
                OutputRow::FragDepth => facts.depth = Some(mode),
                OutputRow::FragStencilRef => facts.writes_stencil_ref = true,
                OutputRow::SampleMask => facts.writes_sample_mask = true,
                _ => {}
            }
        }
        facts.per_sample = self.inputs.iter().any(|row| match row {
            InputRow::Builtin(Builtin::SampleId | Builtin::SamplePosition, _) => true,
            InputRow::Varying(varying) => matches!(
                varying.mode,
                VaryingMode::Smooth(Position::Sample) | VaryingMode::Linear(Position::Sample)
            ),
            InputRow::Barycentric(coordinate) => coordinate.position == Position::Sample,
            _ => false,
        });
        Some(facts)
    }
}
