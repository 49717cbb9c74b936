//! Sampling with a sampler Y′CbCr conversion (spec, "Chroma Reconstruction", "Sampler Y′CbCr
//! Conversion").
//!
//! Reconstruction is implicit: each plane is sampled at its own resolution with its own filter, and
//! the conversion follows. A plane is therefore a separate image, and the rest is ordinary
//! sampling.

use lanes::{LANES, Row};

use super::block::execute_plain;
use super::format::block::Texels;
use super::residency::Residency;
use super::{Filter, Format, ImageDescriptor, ImageOp, SamplerDescriptor};

/// A plane as it is sampled: of formats that hold chroma at half the rate in one plane, luma and
/// chroma are the same memory twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plane {
    pub format: Format,
    /// Which plane of the image it lies in.
    pub memory: u8,
    /// Whether it has half the width, half the height.
    pub halved: [bool; 2],
    /// Which component of a texel of it is R (C′R), G (Y′), B (C′B) and A.
    pub components: [Option<u8>; 4],
}

/// A format that needs a conversion, by its planes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Planes {
    pub planes: [Plane; 3],
    /// How many of them there are.
    pub count: u8,
    /// Bits of a component.
    pub bits: u8,
}

/// `VkSamplerYcbcrModelConversion`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Model {
    RgbIdentity,
    YcbcrIdentity,
    Bt709,
    Bt601,
    Bt2020,
}

/// `VkSamplerYcbcrConversion`, and what it is about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conversion {
    pub planes: Planes,
    pub model: Model,
    /// `VK_SAMPLER_YCBCR_RANGE_ITU_NARROW`.
    pub narrow: bool,
    /// As [`ImageDescriptor::swizzle`], before the conversion.
    pub swizzle: [u8; 4],
    /// `VK_CHROMA_LOCATION_MIDPOINT` in x and y; else cosited with even luma.
    pub midpoint: [bool; 2],
    pub chroma_filter: Filter,
}

/// First numbers of the formats that were added with conversions, and with two planes of full size.
const FIRST: u32 = 1_000_156_000;
const FIRST_444: u32 = 1_000_330_000;

/// Formats of planes. Rows: of 8, 10, 12 and 16 bits; one, two and four components.
const SINGLE_PLANES: [[Format; 3]; 4] = [
    [Format::R8_UNORM, Format::R8G8_UNORM, Format::R8G8B8A8_UNORM],
    [
        Format::R10X6_UNORM_PACK16,
        Format::R10X6G10X6_UNORM_2PACK16,
        Format::R10X6G10X6B10X6A10X6_UNORM_4PACK16,
    ],
    [
        Format::R12X4_UNORM_PACK16,
        Format::R12X4G12X4_UNORM_2PACK16,
        Format::R12X4G12X4B12X4A12X4_UNORM_4PACK16,
    ],
    [
        Format::R16_UNORM,
        Format::R16G16_UNORM,
        Format::R16G16B16A16_UNORM,
    ],
];

/// The planes of a multi-planar format.
#[derive(Clone, Copy)]
enum PlaneLayout {
    /// Luma before chroma in a pair of texels, or behind.
    Pairs {
        luma: u8,
    },
    Three([bool; 2]),
    Two([bool; 2]),
}

/// Layouts of one size of components, in the order of the formats' numbers.
const ORDER: [PlaneLayout; 7] = [
    PlaneLayout::Pairs { luma: 0 },
    PlaneLayout::Pairs { luma: 1 },
    PlaneLayout::Three([true, true]),
    PlaneLayout::Two([true, true]),
    PlaneLayout::Three([true, false]),
    PlaneLayout::Two([true, false]),
    PlaneLayout::Three([false, false]),
];

impl Planes {
    const NONE: Plane = Plane {
        format: Format::UNDEFINED,
        memory: 0,
        halved: [false; 2],
        components: [None; 4],
    };

    /// A format of one plane and one rate.
    fn whole(format: Format) -> Option<Planes> {
        let info = format.info()?;
        let component = |index: usize| (info.channels[index].bits != 0).then_some(index as u8);
        let plane = Plane {
            format,
            components: std::array::from_fn(component),
            ..Self::NONE
        };
        Some(Planes {
            planes: [plane, Self::NONE, Self::NONE],
            count: 1,
            bits: info.channels[0].bits,
        })
    }

    /// The planes of a format; `None` for formats that do not exist here.
    pub fn of(format: Format) -> Option<Planes> {
        use PlaneLayout::{Pairs, Three, Two};
        let (size, layout) = match format.0 {
            n @ FIRST_444.. if n < FIRST_444 + 4 => ((n - FIRST_444) as usize, Two([false, false])),
            n @ FIRST.. if n < FIRST + 34 => match n - FIRST {
                // Three single planes stand before the others of 10 and of 12 bits.
                n @ 0..7 => (0, ORDER[n as usize]),
                n @ 10..17 => (1, ORDER[n as usize - 10]),
                n @ 20..27 => (2, ORDER[n as usize - 20]),
                n @ 27..34 => (3, ORDER[n as usize - 27]),
                _ => return Self::whole(format),
            },
            _ => return Self::whole(format),
        };
        let [one, two, four] = SINGLE_PLANES[size];
        let plane = |format, memory, halved, components| Plane {
            format,
            memory,
            halved,
            components,
        };
        let luma = plane(one, 0, [false; 2], [None, Some(0), None, None]);
        let (planes, count) = match layout {
            Pairs { luma } => {
                let chroma = 1 - luma;
                let luma = plane(two, 0, [false; 2], [None, Some(luma), None, None]);
                let of_pair = [Some(chroma + 2), None, Some(chroma), None];
                let chroma = plane(four, 0, [true, false], of_pair);
                ([luma, chroma, Self::NONE], 2)
            }
            Two(halved) => {
                let chroma = plane(two, 1, halved, [Some(1), None, Some(0), None]);
                ([luma, chroma, Self::NONE], 2)
            }
            Three(halved) => {
                let blue = plane(one, 1, halved, [None, None, Some(0), None]);
                let red = plane(one, 2, halved, [Some(0), None, None, None]);
                ([luma, blue, red], 3)
            }
        };
        Some(Planes {
            planes,
            count,
            bits: [8, 10, 12, 16][size],
        })
    }

    /// The planes that there are.
    pub fn planes(&self) -> &[Plane] {
        &self.planes[..self.count as usize]
    }

    /// How many planes lie apart in memory.
    pub fn memory_count(&self) -> usize {
        self.planes().iter().map(|it| it.memory).max().unwrap_or(0) as usize + 1
    }

    /// Whether images of the format can only be sampled with a conversion ("Formats Requiring
    /// Sampler Y′CbCr Conversion").
    pub fn requires_conversion(&self) -> bool {
        self.count > 1
    }
}

/// A plane of the image as an image.
fn plane_image(image: &ImageDescriptor, plane: &Plane) -> ImageDescriptor {
    let mut level = image.levels[plane.memory as usize];
    if plane.memory == 0 && plane.halved[0] {
        // Pairs of texels.
        level.width /= 2;
    }
    // Planes may be bound to memory of their own, far apart.
    let data = image.data.wrapping_add(level.offset_bytes as usize);
    level.offset_bytes = 0;
    let mut of_plane = ImageDescriptor {
        data,
        size_bytes: level.slice_stride_bytes * u64::from(image.layer_count),
        format: plane.format,
        conversion: None,
        // The slice's stride is the plane's layer: levels and depth there are none.
        layer_stride_bytes: level.slice_stride_bytes,
        swizzle: [0, 1, 2, 3],
        ..*image
    };
    of_plane.levels[0] = level;
    of_plane
}

/// `OpImageSample*` of an image with a conversion, in the lanes of `mask`.
///
/// # Safety
/// As [`execute_plain`].
pub(super) unsafe fn sample(
    op: &ImageOp,
    image: &ImageDescriptor,
    conversion: &Conversion,
    sampler: &SamplerDescriptor,
    mask: u16,
    operands: &[&Row],
    residency: Option<&Residency<'_>>,
    results: &mut [Row],
) {
    let mut texels: Texels = [[0; LANES]; 4];
    texels[3] = [1f32.to_bits(); LANES];
    for (index, plane) in conversion.planes.planes().iter().enumerate() {
        let of_plane = match conversion.planes.count {
            // Of one plane, all levels.
            1 => ImageDescriptor {
                conversion: None,
                ..*image
            },
            _ => plane_image(image, plane),
        };
        let mut sampler = *sampler;
        if index > 0 {
            sampler.mag_filter = conversion.chroma_filter;
            sampler.min_filter = conversion.chroma_filter;
        }
        // Cosited chroma lies under the even texel, a quarter of its own texel to the left of its
        // middle.
        let sizes = [image.levels[0].width, image.levels[0].height];
        let mut moved = [[0; LANES]; 2];
        let mut rows: [&Row; 16] = [&[0; LANES]; 16];
        let count = operands.len().min(rows.len());
        rows[..count].copy_from_slice(&operands[..count]);
        for (axis, moved) in moved.iter_mut().enumerate().take(op.spatial_count()) {
            if plane.halved[axis] && !conversion.midpoint[axis] {
                let step = 0.5 / sizes[axis] as f32;
                *moved = operands[axis].map(|word| (f32::from_bits(word) + step).to_bits());
                rows[axis] = moved;
            }
        }
        let mut of = [[0; LANES]; super::operands::MAX_RESULT_ROWS];
        let (image, sampler) = (Some(&of_plane), Some(&sampler));
        // SAFETY: the caller keeps the contract of `execute_plain`; the plane is a part of the
        // image.
        unsafe { execute_plain(op, image, sampler, mask, &rows[..count], residency, &mut of) };
        for (texel, component) in texels.iter_mut().zip(plane.components) {
            if let Some(component) = component {
                *texel = of[component as usize];
            }
        }
    }
    let source = texels;
    for (texel, from) in texels.iter_mut().zip(conversion.swizzle) {
        *texel = match from {
            0..=3 => source[from as usize],
            4 => [0; LANES],
            _ => [1f32.to_bits(); LANES],
        };
    }
    for lane in 0..LANES {
        let [r, g, b] = [0, 1, 2].map(|i| f32::from_bits(texels[i][lane]));
        let converted = convert(conversion, [r, g, b]);
        for (texel, value) in texels.iter_mut().zip(converted) {
            texel[lane] = value.to_bits();
        }
    }
    results[..4].copy_from_slice(&texels);
}

/// C′R, Y′, C′B to R, G, B ("Sampler Y′CbCr Range Expansion", "Sampler Y′CbCr Model Conversion").
fn convert(conversion: &Conversion, [r, g, b]: [f32; 3]) -> [f32; 3] {
    if conversion.model == Model::RgbIdentity {
        return [r, g, b];
    }
    let bits = u32::from(conversion.planes.bits).clamp(8, 16);
    let most = ((1u32 << bits) - 1) as f32;
    let unit = (1u32 << (bits - 8)) as f32;
    let (luma, blue, red) = if conversion.narrow {
        let chroma = |value: f32| (value * most - 128.0 * unit) / (224.0 * unit);
        let luma = (g * most - 16.0 * unit) / (219.0 * unit);
        (luma, chroma(b), chroma(r))
    } else {
        let middle = 128.0 * unit / most;
        (g, b - middle, r - middle)
    };
    // Of red and blue to luma: the rest is green's.
    let (kr, kb) = match conversion.model {
        Model::Bt709 => (0.2126f32, 0.0722f32),
        Model::Bt601 => (0.299, 0.114),
        Model::Bt2020 => (0.2627, 0.0593),
        Model::RgbIdentity | Model::YcbcrIdentity => return [red, luma, blue],
    };
    let (to_red, to_blue) = (2.0 * (1.0 - kr), 2.0 * (1.0 - kb));
    let kg = 1.0 - kr - kb;
    let green = luma - (kb * to_blue / kg) * blue - (kr * to_red / kg) * red;
    [luma + to_red * red, green, luma + to_blue * blue]
}

#[cfg(test)]
mod tests {
    use super::super::execute::execute_block;
    use super::super::{AddressMode, Dim, ImageOp, ImageOpKind, Level};
    use super::*;

    fn conversion(format: Format, model: Model, narrow: bool) -> Conversion {
        Conversion {
            planes: Planes::of(format).unwrap(),
            model,
            narrow,
            swizzle: [0, 1, 2, 3],
            midpoint: [true; 2],
            chroma_filter: Filter::Nearest,
        }
    }

    const P420: Format = Format(1_000_156_002);

    #[test]
    fn planes_follow_from_the_numbers() {
        let of = |number: u32| Planes::of(Format(number)).unwrap();
        // G8B8G8R8_422 and B8G8R8G8_422.
        assert_eq!(of(1_000_156_000).planes[0].components[1], Some(0));
        assert_eq!(
            of(1_000_156_000).planes[1].components,
            [Some(3), None, Some(1), None]
        );
        assert_eq!(
            of(1_000_156_001).planes[1].components,
            [Some(2), None, Some(0), None]
        );
        // G8_B8_R8_3PLANE_420, G8_B8R8_2PLANE_422, G8_B8_R8_3PLANE_444.
        assert_eq!(
            (of(1_000_156_002).count, of(1_000_156_002).planes[2].halved),
            (3, [true, true])
        );
        assert_eq!(
            (of(1_000_156_005).count, of(1_000_156_005).planes[1].halved),
            (2, [true, false])
        );
        assert_eq!(
            (of(1_000_156_006).count, of(1_000_156_006).planes[1].halved),
            (3, [false, false])
        );
        // R10X6 is no such format, G10X6_B10X6R10X6_2PLANE_420 is.
        assert!(!of(1_000_156_007).requires_conversion());
        assert_eq!(
            of(1_000_156_013).planes[1].format,
            Format::R10X6G10X6_UNORM_2PACK16
        );
        assert_eq!((of(1_000_156_026).bits, of(1_000_156_033).bits), (12, 16));
        // G16_B16R16_2PLANE_444.
        assert_eq!((of(1_000_330_003).bits, of(1_000_330_003).count), (16, 2));
        assert_eq!(Planes::of(Format(1_000_330_004)), None);
    }

    /// White, black and the primaries of BT.601 and BT.709 by their 8-bit codes (ITU-R BT.601-7,
    /// BT.709-6: rounded).
    #[test]
    fn primaries_by_the_recommendations() {
        let near = |model, narrow, ycbcr: [u8; 3], rgb: [f32; 3]| {
            let [y, cb, cr] = ycbcr.map(|code| f32::from(code) / 255.0);
            let got = convert(&conversion(P420, model, narrow), [cr, y, cb]);
            for (got, expected) in got.iter().zip(rgb) {
                assert!((got - expected).abs() < 0.006, "{ycbcr:?} {got:?} {rgb:?}");
            }
        };
        near(Model::Bt601, true, [235, 128, 128], [1.0; 3]);
        near(Model::Bt709, true, [16, 128, 128], [0.0; 3]);
        near(Model::Bt601, true, [81, 90, 240], [1.0, 0.0, 0.0]);
        near(Model::Bt601, true, [41, 240, 110], [0.0, 0.0, 1.0]);
        near(Model::Bt709, true, [63, 102, 240], [1.0, 0.0, 0.0]);
        near(Model::Bt709, true, [173, 42, 26], [0.0, 1.0, 0.0]);
        near(Model::Bt601, false, [76, 85, 255], [1.0, 0.0, 0.0]);
        near(Model::Bt2020, true, [235, 128, 128], [1.0; 3]);
    }

    /// Two luma texels a chroma texel: where chroma is taken from, for both locations.
    #[test]
    fn chroma_lies_where_its_location_says() {
        let luma: [u8; 4] = [0, 64, 128, 192];
        let chroma: [u8; 2] = [0, 200];
        let mut memory = [0u8; 64];
        memory[..4].copy_from_slice(&luma);
        memory[16..18].copy_from_slice(&chroma);
        memory[32..34].copy_from_slice(&chroma);
        let mut image = ImageDescriptor {
            data: memory.as_mut_ptr(),
            size_bytes: 64,
            format: Format::R8_UNORM,
            dim: Dim::D2,
            level_count: 1,
            layer_count: 1,
            ..ImageDescriptor::NULL
        };
        for (plane, width) in [4, 2, 2].into_iter().enumerate() {
            image.levels[plane] = Level {
                offset_bytes: 16 * plane as u64,
                row_stride_bytes: 16,
                slice_stride_bytes: 16,
                width,
                height: 1,
                depth: 1,
            };
        }
        let sampler = SamplerDescriptor {
            address_mode: [AddressMode::ClampToEdge; 3],
            mag_filter: Filter::Linear,
            min_filter: Filter::Linear,
            ..SamplerDescriptor::DEFAULT
        };
        // Centres of the luma texels.
        let u: Row = std::array::from_fn(|lane| ((lane as f32 + 0.5) / 4.0).to_bits());
        let v: Row = [0.5f32.to_bits(); 16];
        for (midpoint, expected) in [
            (true, [0.0, 0.25, 0.75, 1.0]),
            (false, [0.0, 0.5, 1.0, 1.0]),
        ] {
            // G8_B8_R8_3PLANE_422.
            image.conversion = Some(Conversion {
                midpoint: [midpoint; 2],
                chroma_filter: Filter::Linear,
                ..conversion(Format(1_000_156_004), Model::RgbIdentity, false)
            });
            let mut results = [[0; 16]; 8];
            let op = ImageOp::plain(ImageOpKind::Sample, Dim::D2);
            // SAFETY: the descriptor's memory is the array above.
            unsafe {
                execute_block(
                    &op,
                    Some(&image),
                    Some(&sampler),
                    0xf,
                    &[&u, &v],
                    &mut results,
                );
            }
            for lane in 0..4 {
                let [r, g, b, a] = [0, 1, 2, 3].map(|i| f32::from_bits(results[i][lane]));
                assert_eq!((g, a), (f32::from(luma[lane]) / 255.0, 1.0));
                let chroma = expected[lane] * 200.0 / 255.0;
                assert!((r - chroma).abs() < 1e-6 && (b - chroma).abs() < 1e-6);
            }
        }
    }
}
