//! Where descriptors are: addresses of entries of the bound sets, made here and nowhere else.
//!
//! A value of type `descriptor` is such an address in every lane that was active when it was made.
//! It lives in the frame alone: a state keeps what it was made of, and it is made again when the
//! wave goes on ([`make_again`]).

use lanes::{LaneMask, by_lane};

use super::code::{DescriptorSource, Remade};
use super::machine::{Instr, MAX_SUBGROUPS, Machine};
use super::operand::Operand;
use crate::SUBGROUP_SIZE;
use crate::environment::{Descriptor, DescriptorSet, Environment, reference};
use crate::ir::op::DescriptorBinding;

static NULL: Descriptor = Descriptor::NULL;

/// A binding's entries in the set that is bound.
pub(super) struct Entries {
    /// The base that entries are counted from.
    table: DescriptorSet,
    first: u64,
    /// One past the last entry.
    end: u64,
    /// The table's number in references.
    number: u32,
}

impl Entries {
    pub(super) fn of(environment: &Environment, binding: &DescriptorBinding) -> Self {
        let (table, number) = if binding.dynamic {
            (dynamic(environment), reference::DYNAMIC)
        } else {
            match environment.sets.get(binding.set as usize) {
                Some(set) => (*set, reference::SETS + binding.set),
                None => (DescriptorSet::NONE, 0),
            }
        };
        let count = table.count as u64;
        let end = match binding.count {
            u32::MAX => count,
            in_binding => (binding.first as u64 + in_binding as u64).min(count),
        };
        Self {
            table,
            first: binding.first as u64,
            end: if table.entries.is_null() { 0 } else { end },
            number,
        }
    }

    fn entry(&self, index: u32) -> Option<u64> {
        let entry = self.first + index as u64;
        (entry < self.end).then_some(entry)
    }

    /// Address of the descriptor at an index of the binding.
    #[inline(always)]
    pub(super) fn address(&self, index: u32) -> u64 {
        match self.entry(index) {
            // SAFETY: the table is bound.
            Some(entry) => unsafe { self.table.address_of(entry) },
            None => &raw const NULL as u64,
        }
    }

    #[inline(always)]
    fn reference(&self, index: u32) -> u64 {
        match self.entry(index) {
            Some(entry) => reference::of(self.number, entry as u32),
            None => 0,
        }
    }
}

fn dynamic(environment: &Environment) -> DescriptorSet {
    DescriptorSet {
        entries: environment.dynamic,
        count: environment.dynamic_count,
        ..DescriptorSet::NONE
    }
}

/// Address of what a reference names, whatever the number.
fn follow(environment: &Environment, number: u64) -> u64 {
    let (table, entry) = ((number >> 32) as u32, number as u32);
    let table = match table {
        reference::PUSH_CONSTANTS => DescriptorSet {
            entries: &raw const environment.push_constants,
            count: 1,
            ..DescriptorSet::NONE
        },
        reference::DYNAMIC => dynamic(environment),
        reference::ABORTS => match &environment.aborts {
            Some(aborts) => DescriptorSet {
                entries: &raw const aborts.descriptor,
                count: 1,
                ..DescriptorSet::NONE
            },
            None => DescriptorSet::NONE,
        },
        table => {
            let set = table.checked_sub(reference::SETS);
            let set = set.and_then(|set| environment.sets.get(set as usize));
            set.copied().unwrap_or(DescriptorSet::NONE)
        }
    };
    if table.entries.is_null() || entry >= table.count {
        &raw const NULL as u64
    } else {
        // SAFETY: the table is bound.
        unsafe { table.address_of(entry as u64) }
    }
}

/// Makes descriptors in row `d`, in some subgroups, of what row `from` holds.
///
/// # Safety
/// Operands are the program's, with the widths of the source and of descriptors; subgroups are the
/// wave's.
#[inline(always)]
unsafe fn make(
    m: &Machine<'_>,
    source: DescriptorSource,
    d: Operand,
    from: Operand,
    subgroups: &[u16],
) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        match source {
            DescriptorSource::Binding(index) => {
                let binding = &m.code.bindings[index as usize];
                let entries = Entries::of(m.environment, binding);
                for &subgroup in subgroups {
                    let index = *m.block::<u32>(from, subgroup);
                    // Mostly all lanes name the same: where a loop counts, say.
                    let is_one = LaneMask::holding(&index, index[0]) == LaneMask::ALL;
                    *m.block::<u64>(d, subgroup) = match is_one {
                        true => [entries.address(index[0]); SUBGROUP_SIZE],
                        false => by_lane(|lane| entries.address(index[lane])),
                    };
                }
            }
            DescriptorSource::Reference => {
                for &subgroup in subgroups {
                    let number = *m.block::<u64>(from, subgroup);
                    *m.block::<u64>(d, subgroup) =
                        by_lane(|lane| follow(m.environment, number[lane]));
                }
            }
        }
    }
}

/// Makes descriptors that live on again, in all subgroups: in some of them all lanes may wait for
/// others.
///
/// # Safety
/// As for every handler; what they are made of stands in its rows.
pub(super) unsafe fn make_again(m: &Machine<'_>, remade: &[Remade]) {
    let subgroups: [u16; MAX_SUBGROUPS] = std::array::from_fn(|s| s as u16);
    for one in remade {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { make(m, one.source, one.to, one.from, &subgroups[..m.subgroups]) };
    }
}

/// `descriptor`: entries of binding `x`, by the indices in `a`.
///
/// # Safety
/// The instruction was emitted for the program that the machine runs.
pub(super) unsafe fn descriptor(m: &mut Machine<'_>, i: &Instr) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe { make(m, DescriptorSource::Binding(i.x), i.d, i.a, m.listed()) };
}

/// `descriptor_at`: what the references in `a` name.
///
/// # Safety
/// As [`descriptor`].
pub(super) unsafe fn descriptor_at(m: &mut Machine<'_>, i: &Instr) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe { make(m, DescriptorSource::Reference, i.d, i.a, m.listed()) };
}

/// `descriptor_reference`: references to entries of binding `x`, by the indices in `a`.
///
/// # Safety
/// As [`descriptor`].
pub(super) unsafe fn descriptor_reference(m: &mut Machine<'_>, i: &Instr) {
    let binding = &m.code.bindings[i.x as usize];
    let entries = Entries::of(m.environment, binding);
    for &subgroup in m.listed() {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            let index: [u32; SUBGROUP_SIZE] = *m.block::<u32>(i.a, subgroup);
            *m.block::<u64>(i.d, subgroup) = by_lane(|lane| entries.reference(index[lane]));
        }
    }
}

/// The descriptor of the push constants.
///
/// # Safety
/// As [`descriptor`].
pub(super) unsafe fn push_constants(m: &mut Machine<'_>, i: &Instr) {
    let address = &raw const m.environment.push_constants as u64;
    for &subgroup in m.listed() {
        // SAFETY: the caller keeps the contract of this function.
        unsafe { *m.block::<u64>(i.d, subgroup) = [address; SUBGROUP_SIZE] };
    }
}

/// A descriptor's address field.
///
/// # Safety
/// As [`descriptor`].
pub(super) unsafe fn descriptor_address(m: &mut Machine<'_>, i: &Instr) {
    for &subgroup in m.listed() {
        for lane in m.active[subgroup as usize] {
            // SAFETY: the caller guarantees that the instruction was emitted for the program that
            // the machine runs; active lanes hold addresses of descriptors.
            unsafe {
                let descriptor = m.environment.descriptor(m.lane(i.a, subgroup, lane, true));
                m.set_lane(i.d, subgroup, lane, true, descriptor.address);
            }
        }
    }
}

/// A descriptor's size, of 64 bits if `y` is not 0, else of 32 and saturated.
///
/// # Safety
/// As [`descriptor`].
pub(super) unsafe fn buffer_size(m: &mut Machine<'_>, i: &Instr) {
    for &subgroup in m.listed() {
        for lane in m.active[subgroup as usize] {
            // SAFETY: the caller guarantees that the instruction was emitted for the program that
            // the machine runs; active lanes hold addresses of descriptors.
            unsafe {
                let descriptor = m.environment.descriptor(m.lane(i.a, subgroup, lane, true));
                let is_wide = i.y != 0;
                let most = if is_wide { u64::MAX } else { u32::MAX.into() };
                let size = descriptor.size_bytes.min(most);
                m.set_lane(i.d, subgroup, lane, is_wide, size);
            }
        }
    }
}
