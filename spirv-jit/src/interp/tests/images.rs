//! Image operations of lanes that differ in their descriptors.

use crate::environment::{Descriptor, Environment};
use crate::interp::images::execute;
use images::{Dim, Format, ImageDescriptor, ImageOp, ImageOpKind, TexelType};
use lanes::Row;

#[test]
fn lanes_with_different_images_keep_their_own_texels() {
    let mut texels = [0x0403_0201u32, 0x1413_1211, 0x2423_2221].map(|texel| [0, texel]);
    let images = texels.each_mut().map(|texels| {
        ImageDescriptor::texel_buffer(texels.as_mut_ptr().cast(), 8, Format::R8G8B8A8_UINT)
    });
    let descriptors = images.each_ref().map(|image| Descriptor {
        image,
        ..Descriptor::NULL
    });
    let addresses: [u64; 16] = std::array::from_fn(|lane| &raw const descriptors[lane % 3] as u64);
    let op = ImageOp {
        texel: TexelType::I32,
        ..ImageOp::plain(ImageOpKind::Fetch, Dim::Buffer)
    };
    let mut results = [[7; 16]; 4];
    let rows: [&Row; 1] = [&[1; 16]];
    // SAFETY: descriptors and images are alive.
    unsafe {
        execute(
            &op,
            &Environment::unbound(),
            &addresses,
            &[0; 16],
            0x7fff,
            &rows,
            &mut results,
        )
    };
    for lane in 0..15 {
        let expected = texels[lane % 3][1].to_le_bytes().map(u32::from);
        let texel: [u32; 4] = std::array::from_fn(|component| results[component][lane]);
        assert_eq!(texel, expected, "lane {lane}");
    }
    assert_eq!(results[0][15], 7);
}
