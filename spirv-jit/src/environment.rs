//! The environment of a program: descriptor sets, push constants, the dispatch.
//!
//! All of it is plain data at stable addresses; the caller that runs a program keeps it alive.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use images::{ImageDescriptor, Level};

use crate::abort::Aborts;
pub use crate::descriptor::Descriptor;
use crate::printf::Prints;
use crate::reach::{Reach, Strays};
use crate::views::{Key, Views};

/// Descriptor sets that can be bound (`maxBoundDescriptorSets`).
pub const MAX_SETS: usize = 32;

/// A descriptor in memory that applications and shaders write (`VK_EXT_descriptor_buffer`).
/// Whatever its bytes are, using it reaches live memory and objects of the device alone:
/// [`Environment::descriptor`] sees to that, at each use.
///
/// All zeros is the null descriptor. Fields are as in [`Descriptor`], except views and samplers,
/// which are named by keys.
#[repr(C, align(8))]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StoredDescriptor {
    /// Where [`Self::STRUCTURE`] is set, the [`Key`] of an acceleration structure.
    pub address: u64,
    pub size_bytes: u64,
    /// The [`Key`] of an image view; where bit 0 is set, a format, as [`Descriptor::texel_buffer`]
    /// has it.
    pub image: u64,
    /// The [`Key`] of a sampler.
    pub sampler: u64,
}

impl StoredDescriptor {
    /// No address has this bit.
    pub const STRUCTURE: u64 = 1 << 63;
}

const _: () = assert!(size_of::<StoredDescriptor>() == size_of::<Descriptor>());

impl From<Descriptor> for StoredDescriptor {
    /// Of a descriptor without a view and a sampler.
    fn from(descriptor: Descriptor) -> Self {
        let held = descriptor.viewed_image().is_null();
        Self {
            address: descriptor.address,
            size_bytes: descriptor.size_bytes,
            image: if held {
                descriptor.image.addr() as u64
            } else {
                0
            },
            sampler: 0,
        }
    }
}

/// A bound descriptor set: its entries and how many there are (with a variable descriptor count,
/// the actual one).
#[derive(Clone, Copy, Debug)]
pub struct DescriptorSet {
    /// [`StoredDescriptor`]s if the set is `stored`.
    pub entries: *const Descriptor,
    pub count: u32,
    /// The entries lie in memory that others write: aligned to 8 and mapped for as long as the set
    /// is bound, no more is known of them.
    pub stored: bool,
    /// In a stored set, entries that are not there but here: those of inline uniform blocks,
    /// `block_count` of them.
    pub blocks: *const InlineBlock,
    pub block_count: u32,
}

/// Numbers that name descriptors, for what a descriptor cannot be: a value that is kept, passed on
/// or compared.
///
/// The low half is the entry, the high half the table: 0 for none, so that 0 is the null
/// descriptor; then the sets, the dynamic descriptors, the push constants, and the messages of
/// invocations that abort. Every use of a reference checks both halves, so any number may be one.
pub mod reference {
    use super::MAX_SETS;

    /// The first set.
    pub const SETS: u32 = 1;
    /// [`Environment::dynamic`](super::Environment::dynamic).
    pub const DYNAMIC: u32 = SETS + MAX_SETS as u32;
    /// [`Environment::push_constants`](super::Environment::push_constants), which is the only
    /// entry.
    pub const PUSH_CONSTANTS: u32 = DYNAMIC + 1;

    /// The buffer of [`Environment::aborts`](super::Environment::aborts), which is the only entry.
    pub const ABORTS: u32 = PUSH_CONSTANTS + 1;

    /// The reference to an entry of a table.
    pub const fn of(table: u32, entry: u32) -> u64 {
        (table as u64) << 32 | entry as u64
    }
}

/// As [`Environment::held_image`].
///
/// # Safety
/// As there.
#[cold]
unsafe fn held_samples(samples: &[Samples], descriptor: &Descriptor) -> Option<ImageDescriptor> {
    // SAFETY: null, or a view that outlives the dispatch.
    let Some(view) = (unsafe { descriptor.viewed_image().as_ref() }) else {
        return descriptor.held_image();
    };
    let first = (view.data).wrapping_add(view.levels[0].offset_bytes as usize);
    let samples = samples.iter().find(|it| std::ptr::eq(it.single, first));
    samples.map(|it| it.view(view))
}

/// The descriptor that stands for an entry of a stored set.
#[derive(Clone, Copy, Debug)]
pub struct InlineBlock {
    pub entry: u32,
    pub descriptor: Descriptor,
}

impl DescriptorSet {
    /// No set: all its descriptors are null.
    pub const NONE: DescriptorSet = DescriptorSet {
        entries: std::ptr::null(),
        count: 0,
        stored: false,
        blocks: std::ptr::null(),
        block_count: 0,
    };

    /// Address of the descriptor at an entry that there is, as [`Environment::descriptor`] takes
    /// it.
    ///
    /// # Safety
    /// The set is bound.
    #[inline(always)]
    pub unsafe fn address_of(&self, entry: u64) -> u64 {
        let address = self.entries as u64 + entry * size_of::<Descriptor>() as u64;
        if !self.stored {
            return address;
        }
        // SAFETY: the caller guarantees that the set is bound.
        match unsafe { self.block(entry as u32) } {
            Some(block) => &raw const *block as u64,
            None => address | STORED,
        }
    }

    /// The inline uniform block at an entry of a stored set.
    ///
    /// # Safety
    /// The set is bound.
    unsafe fn block(&self, entry: u32) -> Option<&Descriptor> {
        if self.block_count == 0 {
            return None;
        }
        // SAFETY: what is bound is valid.
        let blocks = unsafe { std::slice::from_raw_parts(self.blocks, self.block_count as usize) };
        let block = blocks.iter().find(|block| block.entry == entry)?;
        Some(&block.descriptor)
    }
}

/// Descriptors are multiples of 8; this bit in the address of one says that it is a
/// [`StoredDescriptor`].
pub const STORED: u64 = 1;

/// Descriptors are never below this: what is, is none.
const LOWEST_ADDRESS: u64 = 1 << 16;

/// Indices into [`Environment::uniforms`], for `Op::Uniform`.
pub mod uniform {
    /// `LaunchSizeKHR`, 3 words.
    pub const LAUNCH_SIZE: u32 = 0;
    /// `NumWorkgroups`, 3 words.
    pub const NUM_WORKGROUPS: u32 = 3;
    /// `DeviceIndex`.
    pub const DEVICE_INDEX: u32 = 6;
    /// Words there are.
    pub const COUNT: usize = 8;
}

/// Everything that is the same for all invocations of a dispatch.
#[derive(Clone)]
pub struct Environment {
    /// A number of [`Environment::next_number`] for these fields and the data that they point to.
    /// Programs cache values that they compute of them by this number.
    pub number: u64,
    pub sets: [DescriptorSet; MAX_SETS],
    /// Dynamic uniform and storage buffers with their offsets applied; per set, the first one's
    /// index comes with the pipeline layout.
    pub dynamic: *const Descriptor,
    pub dynamic_count: u32,
    /// Covers the push constants.
    pub push_constants: Descriptor,
    /// See [`uniform`].
    pub uniforms: [u32; uniform::COUNT],
    /// Where physical pointers may lead: elsewhere, reads give zero and writes are dropped.
    pub reach: Arc<Reach>,
    /// Counts the pointers that lead nowhere, if anyone wants to know.
    pub strays: Option<Arc<Strays>>,
    /// Takes the messages of shaders; none are printed without it.
    pub prints: Option<Arc<Prints>>,
    /// Takes the messages of invocations that abort; without it they only end.
    pub aborts: Option<Arc<Aborts>>,
    /// The views that keys in stored descriptors name.
    pub views: Arc<Views>,
    /// Where the samples of some images are, if a pass has several of images with one.
    pub samples: Option<Arc<[Samples]>>,
}

/// The samples of a layered image with one sample, in memory of their own
/// (`VK_EXT_multisampled_render_to_single_sampled`).
#[derive(Clone, Copy, Debug)]
pub struct Samples {
    /// The first texel of the image, which views of it begin with.
    pub single: *const u8,
    /// The samples, and the sizes and strides that they have.
    pub data: *mut u8,
    pub size_bytes: u64,
    pub samples: u8,
    pub layer_count: u32,
    pub layer_stride_bytes: u64,
    pub sample_stride_bytes: u64,
    pub level: Level,
}

// SAFETY: plain data, as descriptors are.
unsafe impl Send for Samples {}
// SAFETY: plain data, as descriptors are.
unsafe impl Sync for Samples {}

impl Samples {
    /// The view of the samples that stands for a view of the image.
    fn view(&self, single: &ImageDescriptor) -> ImageDescriptor {
        let mut levels = single.levels;
        levels[0] = self.level;
        ImageDescriptor {
            data: self.data,
            size_bytes: self.size_bytes,
            samples: self.samples,
            level_count: 1,
            layer_count: self.layer_count,
            layer_stride_bytes: self.layer_stride_bytes,
            sample_stride_bytes: self.sample_stride_bytes,
            levels,
            ..*single
        }
    }
}

impl Environment {
    /// A number that no other environment of the process has; not 0.
    pub fn next_number() -> u64 {
        static NUMBER: AtomicU64 = AtomicU64::new(1);
        NUMBER.fetch_add(1, Ordering::Relaxed)
    }

    /// Nothing is bound; physical pointers are followed to all addresses.
    pub fn unbound() -> Self {
        Self::new(Arc::new(Reach::everywhere()), Arc::default())
    }

    /// Nothing is bound; physical pointers are followed within `reach`, and stored descriptors name
    /// `views`.
    pub fn new(reach: Arc<Reach>, views: Arc<Views>) -> Self {
        Self {
            number: Self::next_number(),
            sets: [DescriptorSet::NONE; MAX_SETS],
            dynamic: std::ptr::null(),
            dynamic_count: 0,
            push_constants: Descriptor::NULL,
            uniforms: [0; uniform::COUNT],
            reach,
            strays: None,
            prints: None,
            aborts: None,
            views,
            samples: None,
        }
    }

    /// The image that a descriptor holds, or the samples that a pass has of the image that it
    /// points to. None: accesses use the image that it points to.
    ///
    /// # Safety
    /// The descriptor is of this environment.
    #[inline(always)]
    pub unsafe fn held_image(&self, descriptor: &Descriptor) -> Option<ImageDescriptor> {
        match &self.samples {
            None => descriptor.held_image(),
            // SAFETY: the caller guarantees that the descriptor is of this environment.
            Some(samples) => unsafe { held_samples(samples, descriptor) },
        }
    }

    /// The descriptor at an address that `Op::Descriptor` gave. Pointers in it lead to live memory,
    /// or to views and samplers of the device.
    ///
    /// # Safety
    /// The address is such a one, or zero.
    #[inline(always)]
    pub unsafe fn descriptor(&self, address: u64) -> Descriptor {
        if address & STORED != 0 {
            // SAFETY: the caller guarantees that the address comes from `Op::Descriptor`, or is
            // zero.
            return unsafe { self.stored_descriptor(address) };
        }
        if address < LOWEST_ADDRESS {
            return Descriptor::NULL;
        }
        // SAFETY: the caller guarantees that the address comes from `Op::Descriptor`, or is zero;
        // sets outlive the dispatch.
        unsafe { *(address as *const Descriptor) }
    }

    /// Resolves a stored descriptor: it is read once, and then checked against the live objects.
    ///
    /// # Safety
    /// As [`Self::descriptor`].
    #[inline(never)]
    unsafe fn stored_descriptor(&self, address: u64) -> Descriptor {
        let words = (address & !STORED) as *const u64;
        // SAFETY: the caller guarantees that the address comes from `Op::Descriptor`, or is zero;
        // aligned and mapped. Others may write meanwhile: the words are then any mix.
        let [address, size_bytes, image, sampler] =
            std::array::from_fn(|k| unsafe { words.add(k).read_volatile() });
        if address & StoredDescriptor::STRUCTURE != 0 {
            let key = Key(address & !StoredDescriptor::STRUCTURE);
            let structure = self.views.structures.get(key);
            return Descriptor {
                // SAFETY: null, or in the table, which lives as long as the environment.
                address: unsafe { structure.as_ref() }.copied().unwrap_or(0),
                ..Descriptor::NULL
            };
        }
        Descriptor {
            address,
            size_bytes: self.reach.clip(address, size_bytes),
            image: if image & 1 == 0 {
                self.views.images.get(Key(image))
            } else {
                std::ptr::without_provenance(image as usize)
            },
            sampler: self.views.samplers.get(Key(sampler)),
        }
    }
}

// SAFETY: as for `Descriptor`.
unsafe impl Send for Environment {}
// SAFETY: as for `Descriptor`.
unsafe impl Sync for Environment {}
