//! The instances of a build.

use spirv_jit::reach::Reach;
use traversal::{BuildError, InstanceArray, InstanceSource, Live};

use crate::command::instances::Instances;
use crate::wave::reachable::{read, readable};

/// Words of the longest record, `VkAccelerationStructureSRTMotionInstanceNV`.
const MAX_WORDS: usize = 18;

/// One record: its type (0 static, 1 by matrices, 2 by decompositions) and its words, of which the
/// last is the reference.
struct Record {
    ty: u32,
    length: usize,
    words: [u64; MAX_WORDS],
}

impl Instances {
    /// Bounds the memory. The build looks each referenced structure up once in `live`.
    pub fn resolve<'a>(&self, reach: &Reach, live: &'a Live) -> InstanceSource<'a> {
        InstanceSource {
            memory: readable(reach, self.address, self.size_bytes()),
            array: self.array,
            count: self.count,
            flags: self.flags,
            live,
        }
    }

    /// The structure that each instance refers to; `None` for an instance outside of memory.
    ///
    /// # Safety
    /// Nothing writes the instances during the call.
    pub unsafe fn references(&self, reach: &Reach) -> impl Iterator<Item = Option<u64>> {
        // SAFETY: the caller guarantees that nothing writes the instances during the call.
        (0..self.count)
            .map(|index| unsafe { self.record(reach, index).map(|record| record.reference()) })
    }

    fn size_bytes(&self) -> u64 {
        u64::from(self.count) * self.array.stride_bytes()
    }

    /// An array of records with the references in `resolved`, and the instances in it, which it
    /// must outlive. An instance outside of memory is inactive.
    ///
    /// # Errors
    /// [`BuildError::OutOfMemory`].
    ///
    /// # Safety
    /// Nothing writes the instances during the call.
    pub unsafe fn copied(
        &self,
        reach: &Reach,
        resolved: impl Fn(u64) -> u64,
    ) -> Result<(Instances, Vec<u64>), BuildError> {
        let is_motion = self.array.is_motion();
        let array = match is_motion {
            true => InstanceArray::MotionRecords,
            false => InstanceArray::Records,
        };
        let words = array.stride_bytes() as usize / 8;
        let mut records = Vec::new();
        let room = records.try_reserve_exact(words * self.count as usize);
        room.map_err(|_| BuildError::OutOfMemory)?;
        records.resize(words * self.count as usize, 0u64);
        for (index, place) in records.chunks_exact_mut(words).enumerate() {
            // SAFETY: the caller guarantees that nothing writes the instances during the call.
            let Some(mut record) = (unsafe { self.record(reach, index as u32) }) else {
                continue;
            };
            let reference = resolved(record.reference());
            record.words[record.length - 1] = reference;
            let head = usize::from(is_motion);
            if is_motion {
                place[0] = record.ty.into();
            }
            place[head..head + record.length].copy_from_slice(&record.words[..record.length]);
        }
        let copy = Instances {
            array,
            address: records.as_ptr() as u64,
            ..*self
        };
        Ok((copy, records))
    }

    /// Reads a record, through its pointer if the array is one of pointers.
    ///
    /// # Safety
    /// Nothing writes the record during the call.
    unsafe fn record(&self, reach: &Reach, index: u32) -> Option<Record> {
        let element = self
            .address
            .wrapping_add(u64::from(index) * self.array.stride_bytes());
        // SAFETY: the caller keeps the record unwritten; its members are plain numbers.
        unsafe {
            let (address, ty) = match self.array {
                InstanceArray::Records => (element, 0),
                InstanceArray::MotionRecords => (element + 8, read::<u32>(reach, element)?),
                InstanceArray::Pointers => (read::<u64>(reach, element)?, 0),
                InstanceArray::MotionPointers => {
                    let pointer = read::<u64>(reach, element)?;
                    (pointer & !0xF, (pointer & 0xF) as u32)
                }
            };
            let mut words = [0; MAX_WORDS];
            let length = match ty {
                1 => 14,
                2 => 18,
                _ => 8,
            };
            match ty {
                1 => words[..14].copy_from_slice(&read::<[u64; 14]>(reach, address)?),
                2 => words = read::<[u64; 18]>(reach, address)?,
                _ => words[..8].copy_from_slice(&read::<[u64; 8]>(reach, address)?),
            }
            Some(Record { ty, length, words })
        }
    }
}

impl Record {
    fn reference(&self) -> u64 {
        self.words[self.length - 1]
    }
}
