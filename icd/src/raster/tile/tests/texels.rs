//! Texels of sixteen pixels, of every size and pattern and in every instruction set, against bytes
//! that are moved one by one.

use ash::vk;
use lanes::Tier;

use super::super::lanes::{LANE_X, LANE_Y, load_words, rows_of};
use super::super::places::{Pattern, Places, TexelWords};
use super::super::texels::{load, store};
use super::support::{Canvas, Random};
use crate::raster::Target;
use crate::raster::primitive::Bounds;

lanes::vectors! {
    /// Loads texels, then stores others.
    ///
    /// # Safety
    /// As [`load`].
    unsafe fn exchange<V>(v, target: &Target, places: &Places, mask: u16, words: &TexelWords) -> TexelWords {
        // SAFETY: the caller keeps the contract of `load`.
        unsafe {
            let loaded = load(v, target, places, 0, mask);
            store(v, target, places, 0, mask, &load_words(v, words));
            rows_of(v, &loaded)
        }
    }
}

const FORMATS: [vk::Format; 6] = [
    vk::Format::R8_UINT,
    vk::Format::R16_UINT,
    vk::Format::R32_UINT,
    vk::Format::R32G32_UINT,
    vk::Format::R16G16B16A16_UINT,
    vk::Format::R32G32B32A32_UINT,
];
const MASKS: [u16; 7] = [0xffff, 0x8421, 0x1248, 0x7bde, 0xf00f, 0x0550, 1];
const SIZE: [u32; 2] = [37, 11];

/// A pixel in a pattern.
fn pixel(places: &Places, lane: usize) -> [u32; 2] {
    let quad = lane / 4;
    let (x, y) = match places.pattern {
        Pattern::Row => (lane as i32, 0),
        Pattern::Block => (LANE_X[lane], LANE_Y[lane]),
        Pattern::Inside | Pattern::Quads => (LANE_X[lane] & 1, LANE_Y[lane] & 1),
    };
    let first = match places.pattern {
        Pattern::Row | Pattern::Block => 0,
        Pattern::Inside | Pattern::Quads => quad,
    };
    [(places.x[first] + x) as u32, (places.y[first] + y) as u32]
}

fn check(tier: Tier, random: &mut Random, format: vk::Format, places: &Places, mask: u16) {
    let canvas = Canvas::new(format, SIZE[0], SIZE[1], 1, 1);
    let target = canvas.target(vk::ImageAspectFlags::COLOR);
    let size = target.surface.texel_size_bytes;
    let at = |x, y| target.surface.texel(x, y, 0, 0);
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            for byte in 0..size {
                // SAFETY: a texel of the image.
                unsafe { *at(x, y).add(byte) = random.u8(..) };
            }
        }
    }
    let words: TexelWords = [(); 4].map(|()| [(); 16].map(|()| random.u32(..)));
    let texel_bytes = |words: &TexelWords, lane: usize| -> Vec<u8> {
        let bytes = words.iter().flat_map(|row| row[lane].to_le_bytes());
        bytes.take(size).collect()
    };
    let mut expected = canvas.bytes().to_vec();
    let first = canvas.bytes().as_ptr();
    let lanes = || (0..16).filter(|lane| mask >> lane & 1 != 0);
    let range = |lane| {
        let [x, y] = pixel(places, lane);
        let start = at(x, y) as usize - first as usize;
        start..start + size
    };
    let before = expected.clone();
    for lane in lanes() {
        expected[range(lane)].copy_from_slice(&texel_bytes(&words, lane));
    }
    // SAFETY: the pixels are in the image, which no other thread looks at.
    let loaded = unsafe { exchange(tier, &target, places, mask, &words) };
    for lane in lanes() {
        let what = format!("{tier:?} {format:?} {places:?} {mask:x}, lane {lane}");
        let mut bytes = before[range(lane)].to_vec();
        bytes.resize(16, 0);
        let got: Vec<u8> = (0..4)
            .flat_map(|word| loaded[word][lane].to_le_bytes())
            .collect();
        assert_eq!(got, bytes, "{what}");
    }
    assert_eq!(
        canvas.bytes(),
        expected,
        "{tier:?} {format:?} {places:?} {mask:x}"
    );
}

#[test]
fn texels_are_loaded_and_stored_alone() {
    let mut random = Random::with_seed(8);
    let area = Bounds {
        left: 0,
        top: 0,
        right: SIZE[0] as i32,
        bottom: SIZE[1] as i32,
    };
    let anywhere = |pattern| Places {
        x: [4, 0, 30, 35],
        y: [2, 8, 9, 3],
        layer: [0; 4],
        pattern,
    };
    for &tier in Tier::available() {
        for format in FORMATS {
            for mask in MASKS {
                for places in [
                    Places::row(19, 10, 0),
                    Places::block([8, 7], 0, &area),
                    anywhere(Pattern::Inside),
                    anywhere(Pattern::Quads),
                ] {
                    check(tier, &mut random, format, &places, mask);
                }
            }
            // Quads that are not there look like the first one.
            let mut places = anywhere(Pattern::Inside);
            for quads in 1..4 {
                for quad in quads..4 {
                    (places.x[quad], places.y[quad]) = (places.x[0], places.y[0]);
                }
                let mask = u16::MAX >> (16 - 4 * quads);
                check(tier, &mut random, format, &places, mask);
                check(tier, &mut random, format, &places, mask & 0x7b6d);
                places = anywhere(Pattern::Inside);
            }
        }
    }
}
