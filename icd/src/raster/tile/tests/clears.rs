//! Clears, in whole and inside a round.

use ash::vk;
use smallvec::SmallVec;

use super::support::{Canvas, Triangle, chunk, draw, pass_on, run, targets};
use crate::object::graphics_state::GraphicsState;
use crate::raster::{Chunk, Clear, ClearValue, Work};

const COLOR: vk::ImageAspectFlags = vk::ImageAspectFlags::COLOR;

fn clear(value: ClearValue, rect: [u32; 4], layers: [u32; 2]) -> Work {
    let [x, y, width, height] = rect;
    Work::Clear(Clear {
        value,
        rects: SmallVec::from_slice(&[vk::ClearRect {
            rect: vk::Rect2D {
                offset: vk::Offset2D {
                    x: x as i32,
                    y: y as i32,
                },
                extent: vk::Extent2D { width, height },
            },
            base_array_layer: layers[0],
            layer_count: layers[1],
        }]),
    })
}

fn uint(color: [u32; 4]) -> ClearValue {
    ClearValue::Color(0, vk::ClearColorValue { uint32: color })
}

fn clearing(index: u32) -> Chunk {
    Chunk {
        clear: Some(index),
        ..Chunk::default()
    }
}

#[test]
fn rectangles_are_cleared_in_all_samples_and_their_layers() {
    for format in [
        vk::Format::R8_UINT,
        vk::Format::R16_UINT,
        vk::Format::R8G8B8A8_UINT,
        vk::Format::R16G16B16A16_UINT,
        vk::Format::R32G32B32_UINT,
        vk::Format::R32G32B32A32_UINT,
    ] {
        for samples in [1, 4] {
            let canvas = Canvas::new(format, 150, 70, 3, samples);
            let targets = targets(Some(&canvas), None);
            let first = [1, 2, 3, 4];
            // The whole at the beginning, a part after a draw.
            let work = [
                clear(uint(first), [0, 0, 150, 70], [0, 3]),
                Work::Draw(draw(GraphicsState::default(), Some(pass_on("flat")))),
                clear(uint([9; 4]), [60, 10, 30, 60], [1, 7]),
            ];
            let nothing = chunk(1, &targets, &[]);
            run(3, &targets, &work, &[clearing(0), nothing, clearing(2)]);
            let components = canvas.texel(COLOR, [0; 4]);
            assert_eq!(components[0], 1);
            for place in 0..150 * 70 * 3 * samples {
                let (x, y) = (place % 150, place / 150 % 70);
                let (layer, sample) = (place / 10500 % 3, place / 31500);
                let inside = (60..90).contains(&x) && (10..70).contains(&y) && layer >= 1;
                let got = canvas.texel(COLOR, [x, y, layer, sample])[0];
                assert_eq!(got, if inside { 9 } else { 1 }, "{x} {y} {layer} {sample}");
            }
        }
    }
}

#[test]
fn clears_of_depth_and_stencil_leave_the_other_alone() {
    let canvas = Canvas::new(vk::Format::D24_UNORM_S8_UINT, 80, 9, 1, 2);
    let targets = targets(None, Some(&canvas));
    let all = [0, 0, 80, 9];
    let work = [
        clear(ClearValue::Depth(0.5), all, [0, 1]),
        clear(ClearValue::Stencil(0x1ab), all, [0, 1]),
        clear(ClearValue::Depth(1.0), [0, 0, 1, 9], [0, 1]),
    ];
    run(1, &targets, &work, &[clearing(0), clearing(1), clearing(2)]);
    let depth = |x| f32::from_bits(canvas.texel(vk::ImageAspectFlags::DEPTH, [x, 8, 0, 1])[0]);
    assert_eq!((depth(0), depth(1)), (1.0, 8_388_608.0 / 16_777_215.0));
    assert_eq!(
        canvas.texel(vk::ImageAspectFlags::STENCIL, [79, 8, 0, 1])[0],
        0xab
    );
}

#[test]
fn clears_come_in_order_with_draws_and_stay_in_the_area() {
    let canvas = Canvas::new(vk::Format::R8G8B8A8_UINT, 130, 66, 1, 1);
    let mut targets = targets(Some(&canvas), None);
    targets.area = vk::Rect2D {
        offset: vk::Offset2D { x: 3, y: 5 },
        extent: vk::Extent2D {
            width: 120,
            height: 50,
        },
    };
    let draw = || Work::Draw(draw(GraphicsState::default(), Some(pass_on("flat"))));
    let work = [
        draw(),
        clear(uint([2; 4]), [0, 0, 100, 66], [0, 1]),
        draw(),
        clear(uint([4; 4]), [90, 0, 100, 1000], [0, 1]),
    ];
    let mut chunks = [
        chunk(0, &targets, &[Triangle::everywhere(0.0, [1; 4])]),
        clearing(1),
        chunk(
            2,
            &targets,
            &[Triangle {
                corners: [[0, 0], [10240, 0], [0, 30720]],
                ..Triangle::everywhere(0.0, [3; 4])
            }],
        ),
        clearing(3),
    ];
    for chunk in &mut chunks {
        for shape in &mut chunk.shapes {
            (shape.bounds.right, shape.bounds.bottom) = (1000, 1000);
        }
    }
    run(4, &targets, &work, &chunks);
    for y in 0..66 {
        for x in 0..130 {
            // Pixel centres against the triangle's long edge, which none of them lies on.
            let is_third = 3 * (2 * x + 1) + 2 * y + 1 < 240;
            let wanted = match () {
                () if !(3..123).contains(&x) || !(5..55).contains(&y) => 0,
                () if x >= 90 => 4,
                () if is_third => 3,
                () => 2,
            };
            assert_eq!(canvas.texel(COLOR, [x, y, 0, 0]), [wanted; 4], "{x} {y}");
        }
    }
}
