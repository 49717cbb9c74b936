//! Against arithmetic in f64 that knows nothing of the table's parser.

use super::block;
use super::layout::{Aspect, Numeric};
use super::{Format, small_float};
use crate::srgb;
use proptest::prelude::*;

#[test]
fn sizes_of_some_formats_by_the_specification() {
    for (format, size) in [
        (Format::R4G4_UNORM_PACK8, 1),
        (Format::R5G6B5_UNORM_PACK16, 2),
        (Format::R8_SRGB, 1),
        (Format::R8G8B8_UINT, 3),
        (Format::B8G8R8A8_SRGB, 4),
        (Format::A8B8G8R8_SINT_PACK32, 4),
        (Format::A2B10G10R10_UNORM_PACK32, 4),
        (Format::R16G16B16_SFLOAT, 6),
        (Format::R32G32B32_SFLOAT, 12),
        (Format::R64G64B64A64_SFLOAT, 32),
        (Format::B10G11R11_UFLOAT_PACK32, 4),
        (Format::E5B9G9R9_UFLOAT_PACK32, 4),
        (Format::D16_UNORM, 2),
        (Format::X8_D24_UNORM_PACK32, 4),
        (Format::D24_UNORM_S8_UINT, 4),
        (Format::D32_SFLOAT, 4),
        (Format::S8_UINT, 1),
        (Format::A4R4G4B4_UNORM_PACK16, 2),
        (Format::UNDEFINED, 0),
        (Format::BC1_RGB_UNORM_BLOCK, 8),
        (Format::BC4_SNORM_BLOCK, 8),
        (Format::BC7_SRGB_BLOCK, 16),
        (Format::EAC_R11_SNORM_BLOCK, 8),
        (Format::ETC2_R8G8B8A8_SRGB_BLOCK, 16),
        (Format::ASTC_12x10_UNORM_BLOCK, 16),
        (Format::R10X6_UNORM_PACK16, 2),
        (Format::R12X4G12X4B12X4A12X4_UNORM_4PACK16, 8),
        (Format(185), 0),
    ] {
        assert_eq!(format.size_bytes(), size, "{format:?}");
    }
    assert_eq!(Format::all().count(), 194);
    assert_eq!(Format::R8G8B8A8_UNORM, Format(37));
    assert_eq!(Format::D32_SFLOAT_S8_UINT, Format(130));
    assert_eq!(Format::ASTC_12x12_SRGB_BLOCK, Format(184));
    let extent = |format: Format| format.info().unwrap().block_extent();
    assert_eq!(extent(Format::ASTC_10x6_SRGB_BLOCK), [10, 6]);
    assert_eq!(extent(Format::BC6H_SFLOAT_BLOCK), [4, 4]);
    assert_eq!(extent(Format::R8_UNORM), [1, 1]);
}

#[test]
fn planes_of_depth_and_stencil() {
    use Aspect::*;
    let d24s8 = Format::D24_UNORM_S8_UINT;
    assert_eq!(d24s8.plane(Depth), Some(Format::X8_D24_UNORM_PACK32));
    assert_eq!(d24s8.plane(Stencil), Some(Format::S8_UINT));
    assert_eq!(d24s8.plane(Color), None);
    assert_eq!(Format::S8_UINT.plane(Stencil), Some(Format::S8_UINT));
    assert_eq!(Format::S8_UINT.plane(Depth), None);
    assert_eq!(Format::D16_UNORM.plane(Depth), Some(Format::D16_UNORM));
    assert_eq!(Format::D16_UNORM.plane(Stencil), None);
    let rgba = Format::R8G8B8A8_UNORM;
    assert_eq!(rgba.plane(Color), Some(rgba));
}

/// Where components lie, written out by hand from the spec's format definitions.
#[test]
fn packed_components_lie_where_the_specification_says() {
    let decode = |format: Format, word: u32| format.info().unwrap().decode(&word.to_le_bytes());
    let floats = |words: [u32; 4]| words.map(f32::from_bits);
    assert_eq!(
        floats(decode(Format::R5G6B5_UNORM_PACK16, 31 << 11 | 21 << 5 | 1)),
        [1.0, 21.0 / 63.0, 1.0 / 31.0, 1.0]
    );
    assert_eq!(
        floats(decode(
            Format::B5G5R5A1_UNORM_PACK16,
            1 << 11 | 2 << 6 | 3 << 1 | 1
        )),
        [3.0 / 31.0, 2.0 / 31.0, 1.0 / 31.0, 1.0]
    );
    assert_eq!(
        floats(decode(Format::A1R5G5B5_UNORM_PACK16, 4 << 10 | 5 << 5 | 6)),
        [4.0 / 31.0, 5.0 / 31.0, 6.0 / 31.0, 0.0]
    );
    assert_eq!(
        floats(decode(Format::A4R4G4B4_UNORM_PACK16, 0x1234)),
        [2.0 / 15.0, 3.0 / 15.0, 4.0 / 15.0, 1.0 / 15.0]
    );
    // The upper bits of each word.
    let half = 512.0 / 1023.0;
    assert_eq!(
        floats(decode(
            Format::R10X6G10X6_UNORM_2PACK16,
            1023 << 6 | 512 << 22
        )),
        [1.0, half, 0.0, 1.0]
    );
    assert_eq!(
        floats(decode(Format::R12X4_UNORM_PACK16, 1 << 4 | 15)),
        [1.0 / 4095.0, 0.0, 0.0, 1.0]
    );
    assert_eq!(
        decode(
            Format::A2R10G10B10_UINT_PACK32,
            3 << 30 | 100 << 20 | 200 << 10 | 300
        ),
        [100, 200, 300, 3]
    );
    assert_eq!(
        decode(
            Format::A2B10G10R10_SINT_PACK32,
            2 << 30 | 1023 << 20 | 512 << 10 | 7
        ),
        [7, -512i32 as u32, -1i32 as u32, -2i32 as u32]
    );
    assert_eq!(
        decode(Format::A8B8G8R8_UINT_PACK32, 0x04030201),
        [1, 2, 3, 4]
    );
    assert_eq!(decode(Format::B8G8R8A8_UINT, 0x04030201), [3, 2, 1, 4]);
    assert_eq!(decode(Format::B8G8R8_UINT, 0x00030201), [3, 2, 1, 1]);
    assert_eq!(
        decode(Format::R8G8_SINT, 0x80ff),
        [-1i32 as u32, -128i32 as u32, 0, 1]
    );
    assert_eq!(
        floats(decode(Format::X8_D24_UNORM_PACK32, 0xab00_0000 | 0xff_ffff)),
        [1.0, 0.0, 0.0, 1.0]
    );
    assert_eq!(
        floats(decode(Format::R8G8B8A8_SNORM, 0x7f81_80ff))[1..],
        [-1.0, -1.0, 1.0]
    );
    assert_eq!(
        floats(decode(Format::R4G4_UNORM_PACK8, 0xf3)),
        [1.0, 3.0 / 15.0, 0.0, 1.0]
    );
    // 1.0 in 11 and 10 bits: exponent 15, mantissa 0.
    assert_eq!(
        floats(decode(
            Format::B10G11R11_UFLOAT_PACK32,
            15 << 5 << 22 | (16 << 6) << 11 | 15 << 6
        )),
        [1.0, 2.0, 1.0, 1.0]
    );
    // exponent 15: a unit is 2^-9.
    assert_eq!(
        floats(decode(
            Format::E5B9G9R9_UFLOAT_PACK32,
            15 << 27 | 256 << 18 | 128 << 9 | 1
        )),
        [1.0 / 512.0, 0.25, 0.5, 1.0]
    );
    let wide = Format::R64_SINT.info().unwrap();
    assert_eq!(
        wide.decode(&(-2i64).to_le_bytes())[..2],
        [-2i32 as u32, u32::MAX]
    );
}

/// Value of a component's code, in f64.
fn reference_value(numeric: Numeric, bits: u32, code: u64, component: usize) -> f64 {
    let signed = ((code << (64 - bits)) as i64 >> (64 - bits)) as f64;
    let unorm = code as f64 / (2f64.powi(bits as i32) - 1.0);
    match numeric {
        Numeric::Unorm => unorm,
        Numeric::Srgb if component == 3 => unorm,
        Numeric::Srgb if unorm <= 0.04045 => unorm / 12.92,
        Numeric::Srgb => ((unorm + 0.055) / 1.055).powf(2.4),
        Numeric::Snorm => (signed / (2f64.powi(bits as i32 - 1) - 1.0)).max(-1.0),
        Numeric::Uscaled | Numeric::Uint => code as f64,
        Numeric::Sscaled | Numeric::Sint => signed,
        Numeric::Ufloat | Numeric::Sfloat => unreachable!(),
    }
}

/// Nearest representable code to a value, in f64.
fn reference_code(numeric: Numeric, bits: u32, value: f64, component: usize) -> i64 {
    let unorm_scale = 2f64.powi(bits as i32) - 1.0;
    let snorm_scale = 2f64.powi(bits as i32 - 1) - 1.0;
    let value = if value.is_nan() { 0.0 } else { value };
    let scaled = match numeric {
        Numeric::Unorm => value.clamp(0.0, 1.0) * unorm_scale,
        Numeric::Srgb if component == 3 => value.clamp(0.0, 1.0) * unorm_scale,
        Numeric::Srgb if value <= 0.0031308 => value.max(0.0) * 12.92 * unorm_scale,
        Numeric::Srgb => (1.055 * value.min(1.0).powf(1.0 / 2.4) - 0.055) * unorm_scale,
        Numeric::Snorm => value.clamp(-1.0, 1.0) * snorm_scale,
        Numeric::Uscaled => value.clamp(0.0, unorm_scale),
        Numeric::Sscaled => value.clamp(-snorm_scale - 1.0, snorm_scale),
        _ => unreachable!(),
    };
    scaled.round_ties_even() as i64
}

/// Those that can be encoded.
fn uncompressed() -> impl Iterator<Item = Format> {
    Format::all().filter(|format| format.info().unwrap().blocks().is_none())
}

fn fixed_point_formats() -> impl Iterator<Item = Format> {
    uncompressed().filter(|format| {
        let numeric = format.info().unwrap().numeric;
        !matches!(
            numeric,
            Numeric::Uint | Numeric::Sint | Numeric::Ufloat | Numeric::Sfloat
        )
    })
}

/// Every code of every component of up to 16 bits, and ends and some in the middle of 24-bit depth.
#[test]
fn fixed_point_codes_decode_to_the_nearest_float_and_encode_back() {
    for format in fixed_point_formats() {
        let info = format.info().unwrap();
        for component in 0..4 {
            let channel = info.channels[component];
            let bits = channel.bits as u32;
            if bits == 0 {
                continue;
            }
            let step = if bits > 16 { 4097 } else { 1 };
            for code in (0..1u64 << bits).step_by(step) {
                let word = (code as u128) << channel.offset;
                let decoded = info.decode(&word.to_le_bytes());
                let value = f32::from_bits(decoded[component]);
                let reference = reference_value(info.numeric, bits, code, component) as f32;
                assert_eq!(
                    value, reference,
                    "{} component {component} code {code}",
                    info.name
                );
                let mut again = [0xff; 32];
                info.encode(decoded, &mut again);
                let round_trip = u128::from_le_bytes(again[..16].try_into().unwrap());
                let is_lowest_snorm = info.numeric == Numeric::Snorm && code == 1 << (bits - 1);
                let expected = if is_lowest_snorm { code + 1 } else { code };
                let mask = (1u128 << bits) - 1;
                assert_eq!(
                    round_trip >> channel.offset & mask,
                    expected as u128,
                    "{} component {component} code {code}",
                    info.name
                );
            }
        }
    }
}

/// Unsigned small floats by definition: (1 + m / 2^n) 2^(e - 15), or m / 2^n 2^-14.
fn reference_ufloat(code: u32, mantissa: u32) -> f64 {
    let (e, m) = (code >> mantissa, code & ((1 << mantissa) - 1));
    let fraction = m as f64 / (1 << mantissa) as f64;
    match e {
        0 => fraction * 2f64.powi(-14),
        31 if m == 0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + fraction) * 2f64.powi(e as i32 - 15),
    }
}

#[test]
fn every_unsigned_small_float_decodes_and_encodes_back() {
    for mantissa in [5, 6] {
        for code in 0..32u32 << mantissa {
            let value = small_float::ufloat_to_f32(code, mantissa);
            let reference = reference_ufloat(code, mantissa);
            if reference.is_nan() {
                assert!(value.is_nan());
                let again = small_float::f32_to_ufloat(value, mantissa);
                assert!(reference_ufloat(again, mantissa).is_nan());
                continue;
            }
            assert_eq!(value as f64, reference);
            assert_eq!(small_float::f32_to_ufloat(value, mantissa), code);
        }
    }
}

#[test]
fn srgb_thresholds_are_tight() {
    for code in 0..=254u32 {
        let middle = (code as f64 + 0.5) / 255.0;
        let reference = if middle / 12.92 <= 0.0031308 {
            middle / 12.92
        } else {
            ((middle + 0.055) / 1.055).powf(2.4)
        } as f32;
        let near = |ulps: i32| f32::from_bits((reference.to_bits() as i32 + ulps) as u32);
        assert_eq!(srgb::encode(near(-2)) as u32, code);
        assert_eq!(srgb::encode(near(2)) as u32, code + 1);
    }
    assert_eq!(srgb::encode(f32::NAN), 0);
    assert_eq!(srgb::encode(-1.0), 0);
    assert_eq!(srgb::encode(f32::INFINITY), 255);
}

fn any_float() -> impl Strategy<Value = f32> {
    prop_oneof![
        any::<u32>().prop_map(f32::from_bits),
        -1.2f32..1.2,
        -300f32..300.0,
        prop::sample::select(vec![
            0.0,
            -0.0,
            1.0,
            -1.0,
            f32::NAN,
            f32::INFINITY,
            -f32::INFINITY
        ]),
    ]
}

proptest! {
    #[test]
    fn fixed_point_encodes_to_nearest(values in prop::array::uniform4(any_float())) {
        for format in fixed_point_formats() {
            let info = format.info().unwrap();
            let mut texel = [0; 32];
            info.encode(values.map(f32::to_bits), &mut texel);
            let word = u128::from_le_bytes(texel[..16].try_into().unwrap());
            for component in 0..4 {
                let channel = info.channels[component];
                if channel.bits == 0 { continue; }
                let mask = (1u128 << channel.bits) - 1;
                let code = (word >> channel.offset & mask) as i64;
                let expected = reference_code(info.numeric, channel.bits as u32, values[component] as f64, component);
                prop_assert_eq!(code, expected & mask as i64, "{} {}", info.name, values[component]);
            }
            prop_assert!(texel[info.size_bytes as usize..].iter().all(|&byte| byte == 0));
        }
    }

    #[test]
    fn integers_saturate(words in prop::array::uniform4(any::<u32>())) {
        for format in uncompressed() {
            let info = format.info().unwrap();
            if !info.numeric.is_integer() || info.is_wide() { continue; }
            let mut texel = [0; 32];
            info.encode(words, &mut texel);
            let decoded = info.decode(&texel);
            for component in 0..4 {
                let bits = info.channels[component].bits as u32;
                let expected = match (bits, info.numeric) {
                    (0, _) => (component == 3) as u32,
                    (_, Numeric::Uint) => (words[component] as u64).min((1 << bits) - 1) as u32,
                    _ => (words[component] as i32 as i64).clamp(-(1i64 << (bits - 1)), (1i64 << (bits - 1)) - 1) as u32,
                };
                prop_assert_eq!(decoded[component], expected, "{}", info.name);
            }
        }
    }

    #[test]
    fn small_floats_encode_to_nearest(value in any_float()) {
        for mantissa in [5u32, 6] {
            let code = small_float::f32_to_ufloat(value, mantissa);
            let got = reference_ufloat(code, mantissa);
            if value.is_nan() {
                prop_assert!(got.is_nan());
            } else if value <= 0.0 {
                prop_assert_eq!(code, 0);
            } else if value == f32::INFINITY {
                prop_assert_eq!(got, f64::INFINITY);
            } else {
                let distance = (got - value as f64).abs();
                for other in [code.saturating_sub(1), code + 1] {
                    let neighbour = reference_ufloat(other, mantissa);
                    if neighbour.is_finite() {
                        prop_assert!((neighbour - value as f64).abs() >= distance);
                    }
                }
            }
        }
    }

    /// The shared exponent is the least that holds the largest component, so the error is at most
    /// half a unit.
    #[test]
    fn shared_exponent_is_near(values in prop::array::uniform3(0f32..70000.0), scale in -30i32..1) {
        let values = values.map(|v| v * 2f32.powi(scale));
        let word = small_float::f32_to_shared_exponent(values);
        let decoded = small_float::shared_exponent_to_f32(word);
        let unit = 2f64.powi((word >> 27) as i32 - 24);
        for (value, decoded) in values.iter().zip(decoded) {
            let clamped = (*value as f64).min(65408.0);
            prop_assert!((decoded as f64 - clamped).abs() <= unit / 2.0, "{values:?} {decoded:?}");
        }
        let largest = decoded.iter().fold(0f32, |a, &b| a.max(b));
        // Normalised, unless the exponent is the least.
        prop_assert!(word >> 27 == 0 || largest as f64 >= 255.0 * unit);
    }

    /// Blocks agree with single texels, for every format and any bits.
    #[test]
    fn blocks_agree_with_texels(bytes in prop::collection::vec(any::<u8>(), 16 * 32), mask: u16) {
        for format in uncompressed() {
            let info = format.info().unwrap();
            if info.is_wide() && info.numeric.is_integer() { continue; }
            let size = info.size_bytes as usize;
            let offsets = std::array::from_fn(|lane| (lane * size) as u64);
            // SAFETY: 16 texels of at most 32 bytes.
            let mut texels = unsafe { block::load(info, bytes.as_ptr(), &offsets) };
            block::finish(info, &mut texels);
            let mut stored = vec![0xcd; 16 * 32];
            // SAFETY: 16 texels of at most 32 bytes.
            unsafe { block::store(info, stored.as_mut_ptr(), &offsets, mask, &texels) };
            for lane in 0..16 {
                let words = info.decode(&bytes[lane * size..][..size]);
                prop_assert_eq!(words, texels.map(|row| row[lane]), "{}", info.name);
                let mut expected = [0; 32];
                info.encode(words, &mut expected);
                let got = &stored[lane * size..][..size];
                if mask >> lane & 1 == 1 {
                    prop_assert_eq!(got, &expected[..size], "{}", info.name);
                } else {
                    prop_assert!(got.iter().all(|&byte| byte == 0xcd));
                }
            }
        }
    }
}
