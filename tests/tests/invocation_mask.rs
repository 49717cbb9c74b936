//! Invocation masks (`VK_HUAWEI_invocation_mask`).

use ash::huawei;
use tuff_tests::*;

#[test]
fn masked_invocations_do_not_run() {
    let gpu = Gpu::new();
    let there = gpu.optional.invocation_mask.invocation_mask == vk::TRUE;
    if !has("VK_HUAWEI_invocation_mask", there) {
        return;
    }
    let device = huawei::invocation_mask::Device::new(&gpu.instance, &gpu.device);
    let (width, height) = (37u32, 21u32);
    let shape = Shape::flat(vk::Format::R8_UINT, width, height);
    let usage = vk::ImageUsageFlags::INVOCATION_MASK_HUAWEI | vk::ImageUsageFlags::STORAGE;
    let picture = gpu.picture(shape, usage);
    let mut random = Rng::with_seed(5);
    // A band without any, and the rest at random.
    let mask: Vec<u8> = (0..width * height)
        .map(|i| u8::from(!(5..14).contains(&(i / width)) && random.u32(..3) == 0))
        .collect();
    gpu.upload(&picture, 0, &mask);
    let output = gpu.buffer(u64::from(4 * width * height));
    output.write(0, &vec![0u32; (width * height) as usize]);
    let raygen = "layout(set = 0, binding = 0, std430) buffer Results { uint results[]; };
        void main() {
            atomicAdd(results[gl_LaunchIDEXT.y * gl_LaunchSizeEXT.x + gl_LaunchIDEXT.x], 1u);
        }";
    let case = Case::new(raygen).bind(output);
    let rays = gpu.rays(&case);
    let regions = gpu.regions(&rays, &case.table());
    let trace = |view: vk::ImageView| {
        gpu.run(|commands| {
            // SAFETY: the command buffer is being recorded, the view lives as long as the device.
            unsafe {
                (device.fp().cmd_bind_invocation_mask_huawei)(
                    commands,
                    view,
                    vk::ImageLayout::GENERAL,
                );
            }
            gpu.record_trace(commands, &rays, &regions, [width, height, 1]);
        });
        output.read::<u32>()
    };
    let masked = trace(picture.view);
    let expected: Vec<u32> = mask.iter().map(|&texel| texel.into()).collect();
    assert_eq!(masked, expected);
    // No image is an image full of ones.
    let all = trace(vk::ImageView::null());
    assert!(
        all.iter()
            .zip(&masked)
            .all(|(all, masked)| *all == masked + 1)
    );
}
