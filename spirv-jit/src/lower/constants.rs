//! Constants, specialized: every constant id as the bits of its scalars.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use super::id_table::IdTable;
use super::types::{MAX_ROWS, Types, too_many_rows};
use crate::Error;
use crate::ir::Type;
use crate::parse::Id;

/// A constant.
#[derive(Clone, Debug)]
pub(super) struct Constant {
    pub ty: Id,
    pub contents: Contents,
}

/// The parts of a constant.
#[derive(Clone, Debug)]
pub(super) enum Contents {
    /// The null constant, and undefined values.
    Null,
    /// The bits of its scalars.
    Bits(Rc<[u64]>),
    /// Its constituents, with repetition counts.
    Composite(Rc<[Id]>, u32),
}

/// All constants of a module.
#[derive(Default)]
pub(super) struct Constants {
    pub(super) by_id: IdTable<Constant>,
    /// A cache of the bits of composites.
    bits: RefCell<IdTable<Rc<[u64]>>>,
    /// The number of scalars in the cache.
    remembered: Cell<u64>,
    /// Scalars of all constants that have no constituents.
    pub(super) total: u64,
    /// 32-bit denormals are flushed, also in specialization constants that convert.
    pub(super) flushes_denormals: bool,
}

/// Largest number of scalars in the cache, and in constants without constituents.
pub(super) const MAX_SCALARS: u64 = 1 << 20;

impl Constants {
    pub fn find(&self, id: Id) -> Option<&Constant> {
        self.by_id.get(id)
    }

    fn get(&self, id: Id) -> Result<&Constant, Error> {
        self.find(id)
            .ok_or_else(|| Error::invalid(0, format!("id {id} is not a constant")))
    }

    pub fn is_null(&self, id: Id) -> bool {
        let constant = self.find(id);
        constant.is_some_and(|constant| matches!(constant.contents, Contents::Null))
    }

    /// The bits of a constant's scalars.
    pub fn bits(&self, types: &Types, id: Id) -> Result<Rc<[u64]>, Error> {
        let constant = self.get(id)?;
        if let Contents::Bits(bits) = &constant.contents {
            return Ok(bits.clone());
        }
        if let Some(bits) = self.bits.borrow().get(id) {
            return Ok(bits.clone());
        }
        let count = types.info(constant.ty)?.leaf_count;
        let bits: Rc<[u64]> = self.part(types, id, 0, count as usize)?.into();
        if self.remembered.get() + count <= MAX_SCALARS {
            self.remembered.set(self.remembered.get() + count);
            self.bits.borrow_mut().insert(id, bits.clone());
        }
        Ok(bits)
    }

    /// The bits of some of a constant's scalars.
    pub fn part(
        &self,
        types: &Types,
        id: Id,
        first: usize,
        count: usize,
    ) -> Result<Vec<u64>, Error> {
        if count as u64 > MAX_ROWS {
            return Err(too_many_rows());
        }
        let mut bits = Vec::with_capacity(count);
        let mut skipped = first;
        // A stack of constants with repetition counts.
        let mut work = vec![(id, 1u32)];
        while let Some((id, times)) = work.pop() {
            if bits.len() == count {
                break;
            }
            let constant = self.get(id)?;
            let leaves = types.info(constant.ty)?.leaf_count as usize;
            // Skips whole constants before the part.
            let whole = match leaves {
                0 => times,
                _ => times.min(u32::try_from(skipped / leaves).unwrap_or(u32::MAX)),
            };
            skipped -= whole as usize * leaves;
            if whole == times {
                continue;
            }
            if times - whole > 1 {
                work.push((id, times - whole - 1));
            }
            match &constant.contents {
                Contents::Composite(parts, times) => {
                    work.extend(parts.iter().rev().map(|&part| (part, *times)));
                }
                contents => {
                    let wanted = (leaves - skipped).min(count - bits.len());
                    match contents {
                        Contents::Bits(all) => bits.extend(all.iter().skip(skipped).take(wanted)),
                        _ => bits.resize(bits.len() + wanted, 0),
                    }
                    skipped = 0;
                }
            }
        }
        Ok(bits)
    }

    /// A scalar integer constant, sign- or zero-extended by its type, cut to 64 bits.
    pub fn integer(&self, types: &Types, id: Id) -> Result<i64, Error> {
        let bits = self.bits(types, id)?;
        let constant = self.find(id).map_or(0, |constant| constant.ty);
        let ty = types.scalar(constant)?;
        let value = bits.first().copied().unwrap_or(0);
        if ty.is_float() {
            return Err(Error::invalid(0, "an integer constant is expected"));
        }
        if types.is_signed(constant) {
            let unused = 64 - ty.bits();
            Ok((value << unused) as i64 >> unused)
        } else {
            Ok(value as i64)
        }
    }

    /// A scalar integer constant that fits 32 bits without a sign.
    pub fn unsigned(&self, types: &Types, id: Id) -> Result<u32, Error> {
        let value = self.integer(types, id)?;
        u32::try_from(value)
            .map_err(|_| Error::invalid(0, format!("constant {value} is out of range")))
    }
}

/// The low bits that a type has.
pub(super) fn truncate(bits: u64, ty: Type) -> u64 {
    match ty.bits() {
        64 => bits,
        width => bits & ((1 << width) - 1),
    }
}
