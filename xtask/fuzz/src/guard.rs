//! Memory around buffers, and in the process, that nothing is to write.

use ash::vk;
use tuff_tests::{Buffer, Gpu, flat_info};

/// Bytes before and after the bound range.
pub const MARGIN: u64 = 4096;

const PATTERN: u64 = 0x5AFE_C0DE_DEAD_BEA7;

/// A buffer of which only the middle is ever bound.
pub struct Guarded {
    pub buffer: Buffer,
    pub size_bytes: u64,
}

impl Guarded {
    pub fn new(gpu: &Gpu, size_bytes: u64) -> Guarded {
        let buffer = gpu.buffer(size_bytes + 2 * MARGIN);
        let guarded = Guarded { buffer, size_bytes };
        guarded.renew();
        guarded
    }

    /// Makes margins of what somebody was allowed to write.
    pub fn renew(&self) {
        let margin = [PATTERN; MARGIN as usize / 8];
        self.buffer.write(0, &margin);
        let end = MARGIN + self.size_bytes;
        self.buffer.write(end as usize, &margin);
    }

    /// Where the middle is.
    pub fn address(&self) -> u64 {
        self.buffer.address + MARGIN
    }

    /// # Panics
    /// Something was written beside the middle.
    pub fn check(&self) {
        let words = self.buffer.read::<u64>();
        let margin = MARGIN as usize / 8;
        let middle = self.size_bytes as usize / 8;
        let sides = words[..margin].iter().chain(&words[margin + middle..]);
        if sides.into_iter().any(|&word| word != PATTERN) {
            found("a buffer was written beside what is bound of it");
        }
    }
}

/// An image to draw to, in the middle of its memory.
pub struct Attachment {
    device: ash::Device,
    image: vk::Image,
    memory: vk::DeviceMemory,
    mapped: *const u64,
    /// Words before the image, and from where on there are words behind it, of all.
    words: [usize; 3],
    pub view: vk::ImageView,
    pub format: vk::Format,
}

impl Attachment {
    pub fn new(
        gpu: &Gpu,
        format: vk::Format,
        [width, height]: [u32; 2],
        layers: u32,
        samples: u32,
    ) -> Attachment {
        use vk::{Format, ImageAspectFlags as Aspect, ImageUsageFlags as Usage};
        let (aspects, usage) = match format {
            Format::D16_UNORM | Format::D32_SFLOAT => {
                (Aspect::DEPTH, Usage::DEPTH_STENCIL_ATTACHMENT)
            }
            Format::D24_UNORM_S8_UINT | Format::D32_SFLOAT_S8_UINT => (
                Aspect::DEPTH | Aspect::STENCIL,
                Usage::DEPTH_STENCIL_ATTACHMENT,
            ),
            // Of fragment shading rates.
            Format::R8_UINT => (Aspect::COLOR, Usage::FRAGMENT_SHADING_RATE_ATTACHMENT_KHR),
            _ => (Aspect::COLOR, Usage::COLOR_ATTACHMENT),
        };
        let info = flat_info(format, width, height)
            .array_layers(layers)
            .samples(vk::SampleCountFlags::from_raw(samples))
            .usage(usage);
        let range = vk::ImageSubresourceRange::default()
            .aspect_mask(aspects)
            .level_count(1)
            .layer_count(layers);
        // SAFETY: the structures outlive the calls, and the memory is mapped whole.
        unsafe {
            let device = gpu.device.clone();
            let image = device.create_image(&info, None).expect("vkCreateImage");
            let needs = device.get_image_memory_requirements(image);
            let start = MARGIN.next_multiple_of(needs.alignment);
            let end = (start + needs.size).next_multiple_of(8);
            let allocation = vk::MemoryAllocateInfo::default()
                .allocation_size(end + MARGIN)
                .memory_type_index(needs.memory_type_bits.trailing_zeros());
            let memory = device.allocate_memory(&allocation, None).expect("memory");
            let mapped = device
                .map_memory(memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty())
                .expect("vkMapMemory")
                .cast::<u64>();
            let words = [start, end, end + MARGIN].map(|bytes| bytes as usize / 8);
            std::slice::from_raw_parts_mut(mapped, words[2]).fill(PATTERN);
            device
                .bind_image_memory(image, memory, start)
                .expect("vkBindImageMemory");
            let view = vk::ImageViewCreateInfo::default()
                .image(image)
                .view_type(vk::ImageViewType::TYPE_2D_ARRAY)
                .format(format)
                .subresource_range(range);
            let view = device
                .create_image_view(&view, None)
                .expect("vkCreateImageView");
            Attachment {
                device,
                image,
                memory,
                mapped,
                words,
                view,
                format,
            }
        }
    }

    /// # Panics
    /// Something was written beside the image.
    pub fn check(&self) {
        let [start, end, all] = self.words;
        // SAFETY: the memory is mapped whole.
        let read = |word| unsafe { self.mapped.add(word).read_volatile() };
        if (0..start).chain(end..all).any(|word| read(word) != PATTERN) {
            found("memory beside an attachment was written");
        }
    }
}

impl Drop for Attachment {
    fn drop(&mut self) {
        // SAFETY: what was made is destroyed once; commands have ended, or the device is lost.
        unsafe {
            self.device.destroy_image_view(self.view, None);
            self.device.destroy_image(self.image, None);
            self.device.free_memory(self.memory, None);
        }
    }
}

/// Memory of the process that no driver knows of.
pub struct Host(Vec<Box<[u64; 512]>>);

impl Host {
    pub fn new() -> Host {
        Host((0..64).map(|_| Box::new([PATTERN; 512])).collect())
    }

    /// # Panics
    /// Something was written.
    pub fn check(&self) {
        let pages = std::hint::black_box(&self.0);
        if pages
            .iter()
            .any(|page| page.iter().any(|&word| word != PATTERN))
        {
            found("memory of the process was written");
        }
    }
}

/// Ends the process: the case at hand is a finding.
pub fn found(what: &str) -> ! {
    eprintln!("FOUND: {what}");
    std::process::abort();
}
