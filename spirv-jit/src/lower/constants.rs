//! Constants, specialized: every constant id as the bits of its scalars.

use std::rc::Rc;

use super::id_table::IdTable;
use super::types::Types;
use crate::Error;
use crate::ir::Type;
use crate::parse::Id;

/// A constant: its type and the bits of its scalars; `None` for the null constant (and for undefined values).
#[derive(Clone, Debug)]
pub(super) struct Constant {
    pub ty: Id,
    pub bits: Option<Rc<[u64]>>,
}

/// All constants of a module.
#[derive(Default)]
pub(super) struct Constants {
    pub(super) by_id: IdTable<Constant>,
    /// Scalars of all constants together: composites of composites could otherwise double with each line.
    pub(super) total: u64,
}

impl Constants {
    pub fn find(&self, id: Id) -> Option<&Constant> {
        self.by_id.get(id)
    }

    /// The bits of a constant's scalars.
    pub fn bits(&self, types: &Types, id: Id) -> Result<Rc<[u64]>, Error> {
        let constant = self
            .find(id)
            .ok_or_else(|| Error::invalid(0, format!("id {id} is not a constant")))?;
        match &constant.bits {
            Some(bits) => Ok(bits.clone()),
            None => Ok(vec![0; types.leaves(constant.ty)?.len()].into()),
        }
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
