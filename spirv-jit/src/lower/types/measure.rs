//! The facts that follow from a type's parts: scalars, rows, locations, size and alignment.

use rspirv::spirv::Decoration;

use super::{
    FEW_COMPONENTS, LOCATION_WORDS, TypeInfo, TypeKind, Types, is_physical, is_through_descriptor,
};
use crate::Error;
use crate::descriptor_heap::DESCRIPTOR_BYTES;
use crate::hit_object::word;
use crate::ir::op::MatrixProduct;
use crate::parse::{Annotations, Id};

impl Types {
    /// The facts that follow from a type's parts, which are declared before it.
    pub(super) fn measure(
        &self,
        at: u32,
        id: Id,
        kind: TypeKind,
        annotations: &Annotations,
    ) -> Result<TypeInfo, Error> {
        let (leaf_count, rows) = self.leaves_and_rows(at, &kind)?;
        Ok(TypeInfo {
            leaf_count,
            rows,
            is_opaque: self.is_opaque(at, &kind)?,
            components: self.components(at, &kind)?,
            locations: self.locations(at, &kind, rows)?,
            natural: self.size_and_alignment(id, &kind, annotations, true),
            packed: self.size_and_alignment(id, &kind, annotations, false),
            kind,
        })
    }

    /// The facts of a type that another one is made of.
    fn part(&self, at: u32, id: Id) -> Result<&TypeInfo, Error> {
        self.infos
            .get(id)
            .ok_or_else(|| Error::invalid(at, format!("type {id} is used before it is declared")))
    }

    /// See [`TypeInfo::leaf_count`] and [`TypeInfo::rows`].
    fn leaves_and_rows(&self, at: u32, kind: &TypeKind) -> Result<(u64, u64), Error> {
        Ok(match kind {
            TypeKind::Void | TypeKind::Function { .. } => (0, 0),
            TypeKind::Scalar { ty, .. } => (1, ty.rows() as u64),
            TypeKind::Vector { component, count } => {
                let TypeKind::Scalar { ty, .. } = self.part(at, *component)?.kind else {
                    return Err(Error::invalid(at, "vector components must be scalars"));
                };
                let [least, most] = self.components;
                if !(least..=most).contains(count) {
                    let message = format!("a vector cannot have {count} components");
                    return Err(Error::invalid(at, message));
                }
                (*count as u64, *count as u64 * ty.rows() as u64)
            }
            TypeKind::CooperativeMatrix { component } => {
                let TypeKind::Scalar { ty, .. } = self.part(at, *component)?.kind else {
                    return Err(Error::invalid(at, "components of matrices must be scalars"));
                };
                let size = MatrixProduct::SIZE as u64;
                (size, size * u64::from(ty.rows()))
            }
            TypeKind::Matrix { column, count } => {
                let info = self.part(at, *column)?;
                let of_columns = matches!(
                    info.kind,
                    TypeKind::Vector {
                        count: 2..=FEW_COMPONENTS,
                        ..
                    }
                );
                if !of_columns || !matches!(count, 2..=4) {
                    let message = "a matrix has 2 to 4 columns of 2 to 4 components";
                    return Err(Error::invalid(at, message));
                }
                (info.leaf_count * *count as u64, info.rows * *count as u64)
            }
            TypeKind::Array { element, count } => {
                let info = self.part(at, *element)?;
                let count = *count as u64;
                let leaves = info.leaf_count.saturating_mul(count);
                (leaves, info.rows.saturating_mul(count))
            }
            TypeKind::RuntimeArray { element } => {
                self.part(at, *element)?;
                (0, 0)
            }
            TypeKind::Struct { members } => {
                let mut sum = (0u64, 0u64);
                for &member in members.iter() {
                    let info = self.part(at, member)?;
                    sum.0 = sum.0.saturating_add(info.leaf_count);
                    sum.1 = sum.1.saturating_add(info.rows);
                }
                sum
            }
            TypeKind::Pointer { class, .. } => {
                let leaves = self.pointer_leaves(*class);
                let rows = leaves.iter().map(|ty| ty.rows() as u64).sum();
                (leaves.len() as u64, rows)
            }
            TypeKind::Image(_)
            | TypeKind::Sampler
            | TypeKind::AccelerationStructure
            | TypeKind::Buffer => (1, 2),
            TypeKind::RayQuery => (self.query_rows, self.query_rows),
            TypeKind::HitObject => (word::COUNT as u64, word::COUNT as u64),
            TypeKind::SampledImage { image } => {
                if !matches!(self.part(at, *image)?.kind, TypeKind::Image(_)) {
                    return Err(Error::invalid(at, "a sampled image is made of an image"));
                }
                (2, 4)
            }
        })
    }

    /// See [`TypeInfo::is_opaque`].
    fn is_opaque(&self, at: u32, kind: &TypeKind) -> Result<bool, Error> {
        Ok(match kind {
            TypeKind::Image(_)
            | TypeKind::Sampler
            | TypeKind::SampledImage { .. }
            | TypeKind::Buffer => true,
            TypeKind::Pointer { class, .. } => is_through_descriptor(*class),
            TypeKind::Array { element, .. } | TypeKind::RuntimeArray { element } => {
                self.part(at, *element)?.is_opaque
            }
            TypeKind::Struct { members } => {
                let parts = members.iter().map(|&member| self.part(at, member));
                parts
                    .collect::<Result<Vec<_>, _>>()?
                    .iter()
                    .any(|part| part.is_opaque)
            }
            _ => false,
        })
    }

    /// See [`TypeInfo::components`].
    fn components(&self, at: u32, kind: &TypeKind) -> Result<u32, Error> {
        Ok(match kind {
            TypeKind::Vector { count, .. } => *count,
            TypeKind::Array { element, .. } | TypeKind::RuntimeArray { element } => {
                self.part(at, *element)?.components
            }
            TypeKind::Struct { members } => members.iter().try_fold(0, |most: u32, &member| {
                Ok::<_, Error>(most.max(self.part(at, member)?.components))
            })?,
            _ => 0,
        })
    }

    /// See [`TypeInfo::locations`].
    fn locations(&self, at: u32, kind: &TypeKind, rows: u64) -> Result<u32, Error> {
        Ok(match kind {
            TypeKind::Vector { .. } => (rows as u32).div_ceil(LOCATION_WORDS),
            TypeKind::Matrix {
                column: element,
                count,
            }
            | TypeKind::Array { element, count } => {
                self.part(at, *element)?.locations.saturating_mul(*count)
            }
            TypeKind::Struct { members } => members.iter().try_fold(0u32, |sum, &member| {
                Ok::<_, Error>(sum.saturating_add(self.part(at, member)?.locations))
            })?,
            _ => 1,
        })
    }

    /// See [`TypeInfo::natural`], and [`TypeInfo::packed`] for types without strides.
    fn size_and_alignment(
        &self,
        id: Id,
        kind: &TypeKind,
        annotations: &Annotations,
        has_strides: bool,
    ) -> Option<(u64, u64)> {
        let part = |id: Id| {
            let info = self.infos.get(id)?;
            match has_strides {
                true => info.natural,
                false => info.packed,
            }
        };
        match kind {
            TypeKind::Scalar { ty, .. } => Some((ty.size_bytes() as u64, ty.size_bytes() as u64)),
            TypeKind::Vector {
                component: element,
                count,
            }
            | TypeKind::Matrix {
                column: element,
                count,
            }
            | TypeKind::Array { element, count } => {
                let (size, align) = part(*element)?;
                let given = annotations.id(id, Decoration::ArrayStride);
                let stride = match given.filter(|_| has_strides) {
                    Some(stride) => stride as u64,
                    None => size.checked_next_multiple_of(align)?,
                };
                Some((stride.saturating_mul(*count as u64), align))
            }
            TypeKind::Struct { members } => {
                let (mut end, mut most) = (0u64, 1);
                for (index, &member) in members.iter().enumerate() {
                    let (size, align) = part(member)?;
                    let start = match annotations.member(id, index as u32, Decoration::Offset) {
                        Some(offset) => offset as u64,
                        None => end.saturating_add(align - 1) / align * align,
                    };
                    end = end.max(start.saturating_add(size));
                    most = most.max(align);
                }
                Some((end.saturating_add(most - 1) / most * most, most))
            }
            TypeKind::Pointer { class, .. } if is_physical(*class) => {
                let leaves = self.pointer_leaves(*class);
                let size = leaves.iter().map(|ty| ty.size_bytes() as u64).sum();
                Some((size, leaves[0].size_bytes() as u64))
            }
            TypeKind::RuntimeArray { .. } => Some((0, 1)),
            TypeKind::Image(_)
            | TypeKind::Sampler
            | TypeKind::AccelerationStructure
            | TypeKind::Buffer => Some((DESCRIPTOR_BYTES.into(), DESCRIPTOR_BYTES.into())),
            _ => None,
        }
    }
}
