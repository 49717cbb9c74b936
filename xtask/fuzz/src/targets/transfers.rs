//! Copies, fills and updates of regions that are not there.

use std::panic::{AssertUnwindSafe, catch_unwind};

use ash::vk;
use fastrand::Rng;

use crate::case::{Case, wild};
use crate::guard::MARGIN;
use crate::world::{BYTES, World};

/// A length or an offset, mostly near what there is.
fn near(rng: &mut Rng, most: u64) -> u64 {
    match rng.u32(0..4) {
        0 => wild(rng),
        1 => most.wrapping_sub(rng.u64(0..8)),
        _ => rng.u64(0..=most),
    }
}

fn offset(rng: &mut Rng) -> vk::Offset3D {
    let mut one = || match rng.u32(0..3) {
        0 => wild(rng) as i32,
        _ => rng.i32(-1..9),
    };
    vk::Offset3D {
        x: one(),
        y: one(),
        z: if one() & 1 == 0 { 0 } else { 1 },
    }
}

fn extent(rng: &mut Rng) -> vk::Extent3D {
    let offset = offset(rng);
    vk::Extent3D {
        width: offset.x as u32,
        height: offset.y as u32,
        depth: 1,
    }
}

fn layers(rng: &mut Rng) -> vk::ImageSubresourceLayers {
    vk::ImageSubresourceLayers {
        aspect_mask: match rng.u32(0..6) {
            0 => vk::ImageAspectFlags::from_raw(rng.u32(0..16)),
            _ => vk::ImageAspectFlags::COLOR,
        },
        mip_level: rng.u32(0..8) / 7 * wild(rng) as u32,
        base_array_layer: rng.u32(0..8) / 7 * wild(rng) as u32,
        layer_count: match rng.u32(0..6) {
            0 => wild(rng) as u32,
            _ => 1,
        },
    }
}

pub fn run(world: &World, case: &Case) {
    for mut rng in case.steps() {
        // One that is refused does not keep the others from running.
        let _ = catch_unwind(AssertUnwindSafe(|| step(world, &mut rng)));
    }
}

/// One command.
fn step(world: &World, rng: &mut Rng) {
    let device = &world.gpu.device;
    let (buffer, image) = (world.guarded[0].buffer, world.picture.handle);
    let other = world.gpu.buffer(BYTES);
    let general = vk::ImageLayout::GENERAL;
    // SAFETY: all handles live as long as the device; the numbers the driver has to bear.
    world.run(|commands| unsafe {
        match rng.u32(0..8) {
            0 => {
                // Into a buffer without margins: what is in its bounds is allowed.
                let region = vk::BufferCopy {
                    src_offset: near(rng, BYTES + MARGIN),
                    dst_offset: near(rng, BYTES),
                    size: near(rng, BYTES),
                };
                device.cmd_copy_buffer(commands, buffer.handle, other.handle, &[region]);
            }
            1 => {
                let (at, size) = (near(rng, BYTES), near(rng, BYTES));
                device.cmd_fill_buffer(commands, other.handle, at, size, rng.u32(..));
            }
            2 => {
                let data = vec![rng.u8(..); 4 * rng.usize(1..64)];
                device.cmd_update_buffer(commands, other.handle, near(rng, BYTES), &data);
            }
            3 | 4 => {
                let regions = [vk::BufferImageCopy {
                    buffer_offset: near(rng, BYTES),
                    buffer_row_length: rng.u32(0..4) / 3 * wild(rng) as u32,
                    buffer_image_height: rng.u32(0..4) / 3 * wild(rng) as u32,
                    image_subresource: layers(rng),
                    image_offset: offset(rng),
                    image_extent: extent(rng),
                }];
                let handle = other.handle;
                match rng.bool() {
                    true => {
                        device.cmd_copy_buffer_to_image(commands, handle, image, general, &regions)
                    }
                    false => {
                        device.cmd_copy_image_to_buffer(commands, image, general, handle, &regions)
                    }
                }
            }
            5 => {
                let region = vk::ImageCopy {
                    src_subresource: layers(rng),
                    src_offset: offset(rng),
                    dst_subresource: layers(rng),
                    dst_offset: offset(rng),
                    extent: extent(rng),
                };
                device.cmd_copy_image(commands, image, general, image, general, &[region]);
            }
            6 => {
                let value = vk::ClearColorValue {
                    uint32: [rng.u32(..); 4],
                };
                let layers = layers(rng);
                let range = vk::ImageSubresourceRange {
                    aspect_mask: layers.aspect_mask,
                    base_mip_level: layers.mip_level,
                    level_count: layers.layer_count,
                    base_array_layer: layers.base_array_layer,
                    layer_count: wild(rng) as u32,
                };
                device.cmd_clear_color_image(commands, image, general, &value, &[range]);
            }
            _ => {
                let at = near(rng, BYTES);
                device.cmd_dispatch_indirect(commands, other.handle, at);
            }
        }
    });
}
