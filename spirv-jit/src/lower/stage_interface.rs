//! Inputs and outputs of drawing stages, word by word: locations, components, interpolation, and
//! built-ins in variables or block members.
//!
//! The place of a word depends only on `Location` and `Component`, so that stages are compiled
//! separately (Vulkan, section "Interface Matching").

use std::rc::Rc;

use rspirv::spirv::{BuiltIn, Decoration, StorageClass};

use super::types::{LOCATION_WORDS, TypeKind};
use super::values::Values;
use super::values::{MemoryLocation, Pointer};
use super::{Lowerer, budget};
use crate::Error;
use crate::ir::interface::{Barycentric, OutputRow, Position, Varying, VaryingMode, VaryingPlace};
use crate::ir::stage::Stage;
use crate::ir::tessellation::MAX_PATCH_VERTICES;
use crate::ir::{self, InputRow, Type, Value};
use crate::parse::Id;

/// Words of a stage's inputs or outputs, at most: far beyond any device's limit.
const MAX_WORDS: usize = 1 << 12;

/// Vertices of a primitive, at most: of a patch.
const MAX_VERTICES: u32 = MAX_PATCH_VERTICES;

/// One row of a variable's value, as a stage's interface has it.
#[derive(Clone, Copy, Debug)]
pub(super) struct InterfaceWord {
    place: WordLocation,
    how: Interpolation,
}

#[derive(Clone, Copy, Debug)]
enum WordLocation {
    /// A word of a value that begins at a location; word 4 and later are in the next location.
    Location {
        location: u32,
        word: u32,
    },
    BuiltIn(BuiltIn, u32),
}

/// Decorations of a varying, and of a colour's index.
#[derive(Clone, Copy, Debug)]
struct Interpolation {
    flat: bool,
    linear: bool,
    position: Position,
    /// Of an element of a `PerVertexKHR` array, or of an input of a stage that takes primitives.
    vertex: Option<u8>,
    /// `Patch`.
    patch: bool,
    /// `PerPrimitiveEXT`.
    primitive: bool,
    index: u8,
}

/// How an input is evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Evaluation {
    /// By its decorations.
    Decorated,
    /// By its decorations, and `HelperInvocation` with its current value (`Volatile`).
    Volatile,
    /// At the position of `interpolateAtCentroid`.
    Centroid,
    /// At a vertex of the primitive.
    Vertex(u8),
}

impl Evaluation {
    /// The evaluation of a load through a pointer.
    pub fn of(pointer: &Pointer) -> Self {
        match pointer.volatile {
            true => Evaluation::Volatile,
            false => Evaluation::Decorated,
        }
    }
}

/// The start of a value.
#[derive(Clone, Copy)]
struct Start {
    location: u32,
    /// Locations between the first element of an array of blocks and this one.
    shift: u32,
    component: u32,
}

/// Consecutive values of one type to be placed.
#[derive(Clone, Copy)]
struct InterfacePart {
    ty: Id,
    start: Start,
    how: Interpolation,
    built_in: Option<BuiltIn>,
    count: u32,
}

impl Interpolation {
    fn mode(self, ty: Type, at: Evaluation) -> VaryingMode {
        let position = match at {
            Evaluation::Vertex(vertex) => return VaryingMode::PerVertex(vertex),
            Evaluation::Centroid => Position::Centroid,
            Evaluation::Decorated | Evaluation::Volatile => self.position,
        };
        match self.vertex {
            Some(vertex) => VaryingMode::PerVertex(vertex),
            None if self.flat || self.primitive || !matches!(ty, Type::F16 | Type::F32) => {
                VaryingMode::Flat
            }
            None if self.linear => VaryingMode::Linear(position),
            None => VaryingMode::Smooth(position),
        }
    }
}

impl InterfaceWord {
    /// The vertex weights of `interpolateAt*`: linear, perspective-correct, or none for flat
    /// inputs.
    pub fn is_perspective(self) -> Option<bool> {
        match self.how.mode(Type::F32, Evaluation::Decorated) {
            VaryingMode::Smooth(_) => Some(true),
            VaryingMode::Linear(_) => Some(false),
            VaryingMode::Flat | VaryingMode::PerVertex(_) => None,
        }
    }

    /// Which barycentric coordinate it is, and whether that is perspective-correct.
    pub fn barycentric(self) -> Option<(u32, bool)> {
        match self.place {
            WordLocation::BuiltIn(BuiltIn::BaryCoordKHR, word) => Some((word, true)),
            WordLocation::BuiltIn(BuiltIn::BaryCoordNoPerspKHR, word) => Some((word, false)),
            _ => None,
        }
    }

    /// All samples are in the first word of the sample mask.
    fn is_row(self) -> bool {
        !matches!(self.place, WordLocation::BuiltIn(BuiltIn::SampleMask, 1..))
    }
}

impl WordLocation {
    /// Location and component of a word between stages.
    fn of_location(location: u32, word: u32) -> (u16, u8) {
        let location = location.saturating_add(word / LOCATION_WORDS);
        let location = u16::try_from(location).unwrap_or(u16::MAX);
        (location, (word % LOCATION_WORDS) as u8)
    }
}

/// The vertex output that corresponds to a built-in of a primitive's vertices.
fn of_vertices(built_in: BuiltIn) -> Option<VaryingPlace> {
    Some(match built_in {
        BuiltIn::Position => VaryingPlace::Position,
        BuiltIn::PointSize => VaryingPlace::PointSize,
        BuiltIn::ClipDistance => VaryingPlace::ClipDistance,
        BuiltIn::CullDistance => VaryingPlace::CullDistance,
        _ => return None,
    })
}

impl Lowerer<'_> {
    /// Whether inputs and outputs are those of the rasterizer's stages.
    pub(super) fn is_rasterized(&self) -> bool {
        matches!(
            self.request.stage,
            Stage::Vertex
                | Stage::TessellationControl
                | Stage::TessellationEvaluation
                | Stage::Geometry
                | Stage::Mesh
                | Stage::Fragment
        )
    }

    /// The contents of each row of a variable's value.
    pub(super) fn interface_words(&mut self, id: Id) -> Result<Rc<[InterfaceWord]>, Error> {
        if let Some(words) = self.interface.words.get(&id) {
            return Ok(words.clone());
        }
        let words: Rc<[InterfaceWord]> = self.find_interface_words(id)?.into();
        self.interface.words.insert(id, words.clone());
        Ok(words)
    }

    fn find_interface_words(&self, id: Id) -> Result<Vec<InterfaceWord>, Error> {
        let pointee = self.variables[&id].pointee;
        let built_in = self.module.annotations.id(id, Decoration::BuiltIn);
        let built_in = built_in.and_then(BuiltIn::from_u32);
        let mut words = Vec::new();
        if let TypeKind::Array { element, count } = *self.types.kind(pointee)?
            && self.is_per_vertex(id, element, built_in)
        {
            for vertex in 0..count {
                let vertex = vertex.min(MAX_VERTICES - 1) as u8;
                self.push_words(&mut words, id, element, Some(vertex))?;
            }
            return Ok(words);
        }
        self.push_words(&mut words, id, pointee, None)?;
        Ok(words)
    }

    /// The contents of each row of (an element of) a variable.
    pub(super) fn element_words(&self, id: Id, ty: Id) -> Result<Vec<InterfaceWord>, Error> {
        let mut words = Vec::new();
        self.push_words(&mut words, id, ty, None)?;
        Ok(words)
    }

    fn push_words(
        &self,
        words: &mut Vec<InterfaceWord>,
        id: Id,
        ty: Id,
        vertex: Option<u8>,
    ) -> Result<(), Error> {
        let find = |decoration| self.module.annotations.id(id, decoration);
        let how = Interpolation {
            vertex,
            patch: self.is_of_patch(id),
            primitive: self.is_of_primitive(id),
            ..self.interpolation(&find, None)
        };
        if let Some(built_in) = find(Decoration::BuiltIn).and_then(BuiltIn::from_u32) {
            let rows = self.types.info(ty)?.rows;
            return self.push_built_in(words, built_in, rows, how);
        }
        if !self.is_rasterized() {
            return Err(self.b.invalid("an input variable must be a built-in"));
        }
        let start = Start {
            location: find(Decoration::Location).unwrap_or(0),
            shift: 0,
            component: find(Decoration::Component).unwrap_or(0),
        };
        self.place(words, ty, start, how)
    }

    /// Whether an array's elements are the values of a primitive's vertices: `PerVertexKHR`, and
    /// the inputs of geometry and tessellation shaders and the outputs of control shaders, except
    /// those of the whole primitive.
    pub(super) fn is_per_vertex(&self, id: Id, element: Id, built_in: Option<BuiltIn>) -> bool {
        let is_input = self.variables[&id].class == StorageClass::Input;
        let has_vertices = match self.request.stage {
            Stage::Geometry | Stage::TessellationEvaluation => is_input,
            Stage::TessellationControl => true,
            _ => return self.is_decorated_per_vertex(id, element),
        };
        has_vertices
            && !self.is_of_patch(id)
            && built_in.is_none_or(|built_in| of_vertices(built_in).is_some())
    }

    fn is_decorated_per_vertex(&self, id: Id, element: Id) -> bool {
        let annotations = &self.module.annotations;
        let decoration = Decoration::PerVertexKHR;
        annotations.id(id, decoration).is_some()
            || annotations.member(element, 0, decoration).is_some()
    }

    fn interpolation(
        &self,
        find: &dyn Fn(Decoration) -> Option<u32>,
        outer: Option<Interpolation>,
    ) -> Interpolation {
        let has = |decoration| find(decoration).is_some();
        let from = outer.unwrap_or(Interpolation {
            flat: self.request.stage != Stage::Fragment,
            linear: false,
            position: Position::Center,
            vertex: None,
            patch: false,
            primitive: false,
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
            patch: from.patch,
            primitive: from.primitive,
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
            place: WordLocation::BuiltIn(built_in, word),
            how,
        }));
        Ok(())
    }

    /// Places a value of a type.
    fn place(
        &self,
        words: &mut Vec<InterfaceWord>,
        ty: Id,
        start: Start,
        how: Interpolation,
    ) -> Result<(), Error> {
        // Last first.
        let mut parts = vec![InterfacePart {
            ty,
            start,
            how,
            built_in: None,
            count: 1,
        }];
        while let Some(mut part) = parts.pop() {
            let (ty, start) = (part.ty, part.start);
            let info = self.types.info(ty)?;
            if part.count == 0 || info.rows == 0 {
                continue;
            }
            if let Some(built_in) = part.built_in {
                self.push_built_in(words, built_in, info.rows, part.how)?;
                continue;
            }
            part.count -= 1;
            if part.count > 0 {
                part.start.location = start.location.saturating_add(info.locations);
                part.start.shift = start.shift.saturating_add(info.locations);
                parts.push(part);
            }
            match &info.kind {
                TypeKind::Matrix {
                    column: element,
                    count,
                }
                | TypeKind::Array { element, count } => parts.push(InterfacePart {
                    ty: *element,
                    start,
                    how: part.how,
                    built_in: None,
                    count: *count,
                }),
                TypeKind::Struct { members } => {
                    self.push_members(&mut parts, ty, members, start, part.how)?;
                }
                _ => {
                    let rows = info.rows as u32;
                    if rows as usize + words.len() > MAX_WORDS {
                        return Err(budget("a stage's interface is too large"));
                    }
                    let first = start.component;
                    words.extend(
                        (first..first.saturating_add(rows)).map(|word| InterfaceWord {
                            place: WordLocation::Location {
                                location: start.location,
                                word,
                            },
                            how: part.how,
                        }),
                    );
                }
            }
        }
        Ok(())
    }

    /// Adds the members of a structure to the pending parts.
    fn push_members(
        &self,
        parts: &mut Vec<InterfacePart>,
        ty: Id,
        members: &[Id],
        start: Start,
        how: Interpolation,
    ) -> Result<(), Error> {
        let first = parts.len();
        let mut next = start.location;
        for (index, &member) in members.iter().enumerate() {
            let find = |decoration| self.module.annotations.member(ty, index as u32, decoration);
            let built_in = find(Decoration::BuiltIn).and_then(BuiltIn::from_u32);
            let given = find(Decoration::Location).filter(|_| built_in.is_none());
            next = given.map_or(next, |given| given.saturating_add(start.shift));
            parts.push(InterfacePart {
                ty: member,
                start: Start {
                    location: next,
                    shift: start.shift,
                    component: find(Decoration::Component).unwrap_or(0),
                },
                how: self.interpolation(&find, Some(how)),
                built_in,
                count: 1,
            });
            if built_in.is_none() {
                next = next.saturating_add(self.types.info(member)?.locations);
            }
        }
        parts[first..].reverse();
        Ok(())
    }

    /// The scalars of (a part of) an input, from a fixed row and a computed one on.
    pub(super) fn load_input(
        &mut self,
        variable: Id,
        row: u32,
        index: Option<Value>,
        ty: Id,
        at: Evaluation,
    ) -> Result<Values, Error> {
        if index.is_some() {
            let place = self.input_place(variable, at, row, index)?;
            return self.load(&Pointer::new(ty, place));
        }
        let words = self.interface_words(variable)?;
        let types = self.types.leaves(ty)?;
        let mut values = Values::with_capacity(types.len());
        let mut next = row as usize;
        for &ty in types.iter() {
            let end = next + ty.rows() as usize;
            // An index past the end is undefined and clamped to the last rows.
            let first = next.min(words.len().saturating_sub(ty.rows() as usize));
            let rows = words.get(first..first + ty.rows() as usize);
            let rows = rows.ok_or_else(|| self.b.invalid("an input without words"))?;
            values.push(self.input_scalar(variable, rows, ty, at)?);
            next = end;
        }
        Ok(values)
    }

    /// The row of an input's copy in per-lane memory.
    pub(super) fn input_place(
        &mut self,
        variable: Id,
        at: Evaluation,
        row: u32,
        index: Option<Value>,
    ) -> Result<MemoryLocation, Error> {
        let local = self.input_local(variable, at)?;
        let Some(index) = index else {
            return Ok(MemoryLocation::Local { local, row });
        };
        let (variable, row) = self.private.locals[local].find(row);
        let address = ir::Op::VarAddress(variable);
        let first = self.b.emit(address, &[], Type::I32)?;
        Ok(MemoryLocation::Private {
            row: self.b.binary(ir::Op::IAdd, first, index)?,
            constant: row,
        })
    }

    fn input_local(&mut self, variable: Id, at: Evaluation) -> Result<usize, Error> {
        if let Some(&local) = self.interface.input_locals.get(&(variable, at)) {
            return Ok(local);
        }
        let pointee = self.variables[&variable].pointee;
        let local = self.new_local("", pointee)?;
        self.interface.input_locals.insert((variable, at), local);
        let pointer = Pointer::new(pointee, MemoryLocation::Local { local, row: 0 });
        let nodes = self.b.enter_prologue();
        let stored = self
            .load_input(variable, 0, None, pointee, at)
            .and_then(|values| self.store(&pointer, &values));
        self.b.leave_prologue(nodes);
        stored?;
        Ok(local)
    }

    /// A scalar of an input; `rows` are its words.
    fn input_scalar(
        &mut self,
        variable: Id,
        rows: &[InterfaceWord],
        ty: Type,
        at: Evaluation,
    ) -> Result<Value, Error> {
        if let WordLocation::BuiltIn(built_in, word) = rows[0].place {
            return self.input_built_in(variable, built_in, word, rows[0].how, ty, at);
        }
        // Attributes and varyings of 16 bits arrive as 32-bit floats.
        let row_type = match ty {
            Type::F16 | Type::F32 => Type::F32,
            _ => Type::I32,
        };
        let mut words = Vec::with_capacity(rows.len());
        for &row in rows {
            let row = self.location_row(row, ty, at)?;
            words.push(self.input(row, row_type)?);
        }
        if ty == Type::F16 {
            return self.b.emit(ir::Op::FConvert, &words, ty);
        }
        Ok(self.words_to_scalars(&words, &[ty])?[0])
    }

    fn location_row(
        &self,
        row: InterfaceWord,
        ty: Type,
        at: Evaluation,
    ) -> Result<InputRow, Error> {
        let WordLocation::Location { location, word } = row.place else {
            return Err(self.b.invalid("a part of an input is a built-in"));
        };
        if self.request.stage == Stage::Vertex {
            return Ok(InputRow::Attribute {
                location: u16::try_from(location).unwrap_or(u16::MAX),
                component: word.min(u32::from(u8::MAX)) as u8,
            });
        }
        let (location, component) = WordLocation::of_location(location, word);
        Ok(InputRow::Varying(Varying {
            place: match (row.how.patch, row.how.primitive) {
                (true, _) => VaryingPlace::Patch(location),
                (_, true) => VaryingPlace::Primitive(location),
                _ => VaryingPlace::Location(location),
            },
            component,
            mode: row.how.mode(ty, at),
        }))
    }

    /// A scalar of a built-in: those of the fragment stage that are rows of their own kind, and all
    /// others.
    fn input_built_in(
        &mut self,
        variable: Id,
        built_in: BuiltIn,
        word: u32,
        how: Interpolation,
        ty: Type,
        at: Evaluation,
    ) -> Result<Value, Error> {
        let component = word.min(u32::from(u8::MAX)) as u8;
        let varying = |place| {
            InputRow::Varying(Varying {
                place,
                component,
                mode: how.mode(Type::F32, at),
            })
        };
        if self.request.stage != Stage::Fragment {
            let place = match built_in {
                BuiltIn::TessLevelOuter => Some(VaryingPlace::TessLevelOuter),
                BuiltIn::TessLevelInner => Some(VaryingPlace::TessLevelInner),
                _ => of_vertices(built_in).filter(|_| how.vertex.is_some()),
            };
            return match (place, ty) {
                (Some(place), Type::F32) => self.input(varying(place), ty),
                _ => self.built_in_scalar(built_in, word, ty),
            };
        }
        let row = match built_in {
            BuiltIn::HelperInvocation => {
                let volatile = self.module.annotations.id(variable, Decoration::Volatile);
                let helper = match volatile.is_some() || at == Evaluation::Volatile {
                    true => self.b.emit(ir::Op::IsHelper, &[], Type::I1)?,
                    false => self.helper_at_start()?,
                };
                return match ty {
                    Type::I1 => Ok(helper),
                    _ => self.bool_to_word(helper),
                };
            }
            BuiltIn::ClipDistance => varying(VaryingPlace::ClipDistance),
            BuiltIn::CullDistance => varying(VaryingPlace::CullDistance),
            BuiltIn::BaryCoordKHR | BuiltIn::BaryCoordNoPerspKHR => {
                InputRow::Barycentric(Barycentric {
                    vertex: component.min(2),
                    perspective: built_in == BuiltIn::BaryCoordKHR,
                    position: match at {
                        Evaluation::Centroid => Position::Centroid,
                        _ => how.position,
                    },
                })
            }
            _ => return self.built_in_scalar(built_in, word, ty),
        };
        match ty {
            Type::F32 => self.input(row, ty),
            _ => Err(self.b.invalid("a built-in has the wrong type")),
        }
    }

    /// Whether the invocation was a helper when it started.
    fn helper_at_start(&mut self) -> Result<Value, Error> {
        if let Some(helper) = self.interface.helper_at_start {
            return Ok(helper);
        }
        let nodes = self.b.enter_prologue();
        let helper = self.b.emit(ir::Op::IsHelper, &[], Type::I1);
        self.b.leave_prologue(nodes);
        self.interface.helper_at_start = Some(helper?);
        self.helper_at_start()
    }

    /// The outputs of the entry point: their variables and words.
    pub(super) fn declare_outputs(&mut self) -> Result<(), Error> {
        let mut ids: Vec<Id> = (self.variables.iter())
            .filter(|(_, variable)| variable.class == StorageClass::Output)
            .map(|(&id, _)| id)
            .filter(|&id| self.is_listed(id) && self.entry.interface.contains(&id))
            .collect();
        ids.sort_unstable();
        for &id in &ids {
            for &word in self.interface_words(id)?.iter() {
                if word.is_row() {
                    let row = self.output_row(word)?;
                    self.interface.outputs.push(row);
                }
            }
            if self.interface.outputs.len() > MAX_WORDS {
                return Err(budget("a stage's interface is too large"));
            }
        }
        self.interface.output_variables = ids;
        self.interface.output_rows = self.interface.outputs.len() as u32;
        Ok(())
    }

    pub(super) fn output_row(&self, word: InterfaceWord) -> Result<OutputRow, Error> {
        Ok(match word.place {
            WordLocation::Location { location, word: at } => {
                let (location, component) = WordLocation::of_location(location, at);
                if word.how.patch {
                    return Ok(OutputRow::Patch {
                        location,
                        component,
                    });
                }
                if word.how.primitive {
                    return Ok(OutputRow::Primitive {
                        location,
                        component,
                    });
                }
                OutputRow::Location {
                    location,
                    component,
                    index: word.how.index,
                }
            }
            WordLocation::BuiltIn(built_in, index) => {
                let index = index.min(u32::from(u8::MAX)) as u8;
                match built_in {
                    BuiltIn::Position => OutputRow::Position(index),
                    BuiltIn::PointSize => OutputRow::PointSize,
                    BuiltIn::TessLevelOuter => OutputRow::TessLevelOuter(index),
                    BuiltIn::TessLevelInner => OutputRow::TessLevelInner(index),
                    BuiltIn::ClipDistance => OutputRow::ClipDistance(index),
                    BuiltIn::CullDistance => OutputRow::CullDistance(index),
                    BuiltIn::Layer => OutputRow::Layer,
                    BuiltIn::ViewportIndex => OutputRow::ViewportIndex,
                    BuiltIn::PrimitiveShadingRateKHR => OutputRow::ShadingRate,
                    BuiltIn::PrimitiveId
                        if matches!(self.request.stage, Stage::Geometry | Stage::Mesh) =>
                    {
                        OutputRow::PrimitiveId
                    }
                    BuiltIn::CullPrimitiveEXT => OutputRow::CullPrimitive,
                    BuiltIn::PrimitivePointIndicesEXT
                    | BuiltIn::PrimitiveLineIndicesEXT
                    | BuiltIn::PrimitiveTriangleIndicesEXT => OutputRow::PrimitiveIndex(index),
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

    /// The values of all output words. Scalars of less than 32 bits are extended.
    pub(super) fn output_words(&mut self) -> Result<Vec<Value>, Error> {
        let mut words = Vec::with_capacity(self.interface.outputs.len());
        for id in self.interface.output_variables.clone() {
            let pointer = self.module_pointer(id)?;
            let rows = self.interface_words(id)?;
            let mut signs = Vec::new();
            self.push_signs(pointer.pointee, &mut signs)?;
            let mut rows = rows.iter();
            for (value, signed) in self.load(&pointer)?.into_iter().zip(signs) {
                let given = match self.b.ty(value) {
                    Type::F16 => vec![self.b.emit(ir::Op::FConvert, &[value], Type::F32)?],
                    Type::I8 | Type::I16 => vec![self.b.i32_of(value, signed)?],
                    _ => self.scalars_to_words(&[value])?,
                };
                let kept = given.into_iter().zip(&mut rows);
                words.extend(kept.filter(|(_, row)| row.is_row()).map(|(word, _)| word));
            }
        }
        Ok(words)
    }

    /// For each scalar of a type, whether it is a signed integer.
    fn push_signs(&self, ty: Id, signs: &mut Vec<bool>) -> Result<(), Error> {
        // A stack of types with repetition counts.
        let mut parts = vec![(ty, 1)];
        while let Some((ty, count)) = parts.pop() {
            let info = self.types.info(ty)?;
            if count == 0 || info.leaf_count == 0 {
                continue;
            }
            if count > 1 {
                parts.push((ty, count - 1));
            }
            match &info.kind {
                TypeKind::Matrix {
                    column: element,
                    count,
                }
                | TypeKind::Array { element, count } => parts.push((*element, *count)),
                TypeKind::Struct { members } => {
                    parts.extend(members.iter().rev().map(|&member| (member, 1)));
                }
                _ => {
                    let scalars = self.types.leaves(ty)?.len();
                    signs.extend(std::iter::repeat_n(self.types.is_signed(ty), scalars));
                }
            }
        }
        Ok(())
    }
}
