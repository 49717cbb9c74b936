//! Shader binding tables: from an address and an index to the group whose handle is stored there.
//!
//! Tables are read at execution through the addresses that the dispatch gives (chapter Ray Tracing,
//! "Shader Binding Table").

use std::sync::Arc;

use spirv_jit::Program;
use spirv_jit::reach::Reach;

pub use crate::capabilities::limits::HANDLE_SIZE;

/// A shader group handle: 32 bytes derived from the group's content. All zero is an unused group.
pub type Handle = [u8; HANDLE_SIZE];

/// Index into [`Shaders::programs`].
pub type ProgramIndex = u32;

/// `VkRayTracingShaderGroupTypeKHR`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GroupKind {
    #[default]
    General,
    Triangles,
    Procedural,
}

/// The programs of a shader group (`VkRayTracingShaderGroupCreateInfoKHR`).
#[derive(Clone, Debug, Default)]
pub struct Group {
    pub handle: Handle,
    pub kind: GroupKind,
    /// Ray generation, miss or callable shader.
    pub general: Option<ProgramIndex>,
    pub closest_hit: Option<ProgramIndex>,
    pub any_hit: Option<ProgramIndex>,
    pub intersection: Option<ProgramIndex>,
}

/// The shaders of a ray tracing pipeline.
pub struct Shaders {
    pub programs: Vec<Arc<Program>>,
    pub groups: Vec<Group>,
    /// A group has an any-hit shader.
    pub has_any_hit: bool,
    /// Programs print messages.
    pub prints: bool,
    /// Open addressing by the handle's first word: group index + 1, or 0.
    slots: Vec<u32>,
}

impl Shaders {
    /// Indexes groups by handle. Groups of the same shaders have the same one: the first stands for
    /// all of them.
    pub fn new(programs: Vec<Arc<Program>>, groups: Vec<Group>) -> Self {
        let mut shaders = Self {
            slots: vec![0; (groups.len() * 2).next_power_of_two().max(2)],
            prints: programs.iter().any(|program| program.prints()),
            has_any_hit: groups.iter().any(|group| group.any_hit.is_some()),
            programs,
            groups,
        };
        for index in 0..shaders.groups.len() {
            let handle = &shaders.groups[index].handle;
            let mut slot = shaders.first_slot(handle);
            while let Some(other) = shaders.slots[slot].checked_sub(1)
                && shaders.groups[other as usize].handle != *handle
            {
                slot = (slot + 1) & (shaders.slots.len() - 1);
            }
            if shaders.slots[slot] == 0 {
                shaders.slots[slot] = index as u32 + 1;
            }
        }
        shaders
    }

    fn first_slot(&self, handle: &Handle) -> usize {
        let word = u64::from_le_bytes(handle[..8].try_into().expect("8 of 32 bytes"));
        word as usize & (self.slots.len() - 1)
    }

    /// The group of a handle; `None` for an all-zero handle or one of another pipeline.
    pub fn group_index(&self, handle: &Handle) -> Option<u32> {
        let mut slot = self.first_slot(handle);
        loop {
            let index = self.slots[slot].checked_sub(1)?;
            if self.groups[index as usize].handle == *handle {
                return Some(index);
            }
            slot = (slot + 1) & (self.slots.len() - 1);
        }
    }

    /// As [`Self::group_index`], the group itself.
    pub fn group(&self, handle: &Handle) -> Option<&Group> {
        self.group_index(handle)
            .map(|index| &self.groups[index as usize])
    }
}

/// `VkStridedDeviceAddressRegionKHR`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Region {
    pub address: u64,
    pub stride_bytes: u64,
    pub size_bytes: u64,
}

/// The four tables of a dispatch: as it names them, or [live](Live).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tables<R = Region> {
    pub raygen: R,
    pub miss: R,
    pub hit: R,
    pub callable: R,
}

impl Tables {
    /// The tables as far as there is memory.
    ///
    /// # Safety
    /// As [`Live::new`].
    pub unsafe fn live(&self, reach: &Reach) -> Tables<Live> {
        // SAFETY: the caller keeps the contract of `Live::new`.
        let live = |region| unsafe { Live::new(region, reach) };
        Tables {
            raygen: live(self.raygen),
            miss: live(self.miss),
            hit: live(self.hit),
            callable: live(self.callable),
        }
    }
}

/// A region all of which is memory that may be read.
#[derive(Clone, Copy, Debug)]
pub struct Live(Region);

impl Live {
    /// The region as far as there is memory.
    ///
    /// # Safety
    /// The memory in reach stays readable while the region is used. Other threads may write there
    /// meanwhile: a handle is then any bytes.
    pub unsafe fn new(region: Region, reach: &Reach) -> Self {
        Self(Region {
            size_bytes: reach.clip(region.address, region.size_bytes),
            ..region
        })
    }

    /// The region itself.
    pub fn region(&self) -> &Region {
        &self.0
    }

    /// A copy of the region's first bytes, at most so many.
    pub fn bytes(&self, most: usize) -> Vec<u8> {
        let Region {
            address,
            size_bytes,
            ..
        } = self.0;
        if address == 0 {
            return Vec::new();
        }
        let mut bytes = vec![0; most.min(usize::try_from(size_bytes).unwrap_or(most))];
        let start = std::ptr::with_exposed_provenance::<u8>(address as usize);
        // SAFETY: the region is memory as far as its size says, by the promise of `new`.
        unsafe { start.copy_to_nonoverlapping(bytes.as_mut_ptr(), bytes.len()) };
        bytes
    }

    /// As [`Region::record`].
    pub fn record(&self, index: u32) -> Option<u64> {
        self.0.record(index)
    }

    /// The record at an index, and the handle at its head.
    pub fn handle(&self, index: u32) -> Option<(u64, Handle)> {
        let record = self.record(index)?;
        // SAFETY: a record lies inside its region whole, and that is memory.
        Some((record, unsafe {
            std::ptr::read_unaligned(record as *const Handle)
        }))
    }
}

impl Region {
    /// Records that lie inside: the indices that have one. A stride of zero has one.
    pub fn record_count(&self) -> u64 {
        match self.size_bytes.checked_sub(HANDLE_SIZE as u64) {
            Some(rest) if self.address != 0 => rest.checked_div(self.stride_bytes).unwrap_or(0) + 1,
            _ => 0,
        }
    }

    /// Address of the record at `index`, or `None` where the region has none: address zero, or past
    /// its end. A stride of zero makes every index the first record.
    pub fn record(&self, index: u32) -> Option<u64> {
        let offset = self.stride_bytes.checked_mul(index as u64)?;
        let end = offset.checked_add(HANDLE_SIZE as u64)?;
        (self.address != 0 && end <= self.size_bytes).then(|| self.address.wrapping_add(offset))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn handle(byte: u8) -> Handle {
        let mut handle = [0; HANDLE_SIZE];
        handle[0] = byte & 1;
        handle[31] = byte;
        handle
    }

    #[test]
    fn groups_are_found_by_their_whole_handle() {
        let groups = (1..=9).map(|i| Group {
            handle: handle(i),
            general: Some(i as u32),
            ..Group::default()
        });
        let shaders = Shaders::new(Vec::new(), groups.collect());
        for i in 1..=9 {
            assert_eq!(
                shaders.group(&handle(i)).and_then(|g| g.general),
                Some(i as u32)
            );
        }
        assert!(shaders.group(&[0; HANDLE_SIZE]).is_none());
        assert!(shaders.group(&handle(10)).is_none());
    }

    #[test]
    fn many_groups_of_the_same_shaders_are_one_entry() {
        let group = |i: u8| Group {
            handle: handle(i),
            ..Group::default()
        };
        // Were each searched for behind all others, this would not end.
        let mut groups = vec![group(3); 1 << 20];
        groups.push(group(5));
        let shaders = Shaders::new(Vec::new(), groups);
        assert_eq!(shaders.group_index(&handle(3)), Some(0));
        assert_eq!(shaders.group_index(&handle(5)), Some(1 << 20));
    }

    #[test]
    fn records_stay_inside_their_region() {
        let region = Region {
            address: 0x1000,
            stride_bytes: 64,
            size_bytes: 192,
        };
        assert_eq!(region.record(2), Some(0x1080));
        assert_eq!(region.record(3), None);
        assert_eq!(region.record_count(), 3);
        for size_bytes in [0, 31, 32, 95, 96, 97] {
            let region = Region {
                size_bytes,
                ..region
            };
            let inside = (0..9).take_while(|&index| region.record(index).is_some());
            assert_eq!(region.record_count(), inside.count() as u64, "{size_bytes}");
        }
        assert_eq!(
            Region {
                address: 0,
                ..region
            }
            .record(0),
            None
        );
        assert_eq!(
            Region {
                stride_bytes: 0,
                size_bytes: 32,
                ..region
            }
            .record(7),
            Some(0x1000)
        );
        assert_eq!(
            Region {
                stride_bytes: u64::MAX,
                ..region
            }
            .record(2),
            None
        );
    }
}
