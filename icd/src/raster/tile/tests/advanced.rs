//! Advanced blend operations against the specification's tables in f64, on every tier.

use ash::vk::{BlendOp, BlendOverlapEXT};
use lanes::Tier;

use super::super::advanced::blend_advanced;
use super::super::blend::Range;
use super::support::Random;
use crate::object::graphics_state::{AdvancedBlend, BlendAttachment};

const OVERLAPS: [BlendOverlapEXT; 3] = [
    BlendOverlapEXT::UNCORRELATED,
    BlendOverlapEXT::DISJOINT,
    BlendOverlapEXT::CONJOINT,
];

type Color = [f64; 4];

fn luminosity(c: [f64; 3]) -> f64 {
    0.30 * c[0] + 0.59 * c[1] + 0.11 * c[2]
}

fn least(c: [f64; 3]) -> f64 {
    c[0].min(c[1]).min(c[2])
}

fn most(c: [f64; 3]) -> f64 {
    c[0].max(c[1]).max(c[2])
}

/// `SetLum` with `ClipColor`.
fn set_luminosity(base: [f64; 3], other: [f64; 3]) -> [f64; 3] {
    let difference = luminosity(other) - luminosity(base);
    let color = base.map(|it| it + difference);
    let (center, low, high) = (luminosity(color), least(color), most(color));
    if low < 0.0 {
        return color.map(|it| center + (it - center) * center / (center - low));
    }
    if high > 1.0 {
        return color.map(|it| center + (it - center) * (1.0 - center) / (high - center));
    }
    color
}

/// `SetLumSat`.
fn set_both(base: [f64; 3], saturation: [f64; 3], light: [f64; 3]) -> [f64; 3] {
    let (low, high) = (least(base), most(base));
    let wanted = most(saturation) - least(saturation);
    let color = match high > low {
        true => base.map(|it| (it - low) * wanted / (high - low)),
        false => [0.0; 3],
    };
    set_luminosity(color, light)
}

/// The function `f` of the table "Advanced Blend Overlap Modes", of one component.
fn f(op: BlendOp, s: f64, d: f64) -> f64 {
    let hard = |s: f64, d: f64| match s <= 0.5 {
        true => 2.0 * s * d,
        false => 1.0 - 2.0 * (1.0 - s) * (1.0 - d),
    };
    match op {
        BlendOp::SRC_EXT | BlendOp::SRC_OVER_EXT | BlendOp::SRC_IN_EXT | BlendOp::SRC_ATOP_EXT => s,
        BlendOp::DST_EXT | BlendOp::DST_OVER_EXT | BlendOp::DST_IN_EXT | BlendOp::DST_ATOP_EXT => d,
        BlendOp::ZERO_EXT | BlendOp::SRC_OUT_EXT | BlendOp::DST_OUT_EXT | BlendOp::XOR_EXT => 0.0,
        BlendOp::MULTIPLY_EXT => s * d,
        BlendOp::SCREEN_EXT => s + d - s * d,
        BlendOp::OVERLAY_EXT => hard(d, s),
        BlendOp::DARKEN_EXT => s.min(d),
        BlendOp::LIGHTEN_EXT => s.max(d),
        BlendOp::COLORDODGE_EXT if d <= 0.0 => 0.0,
        BlendOp::COLORDODGE_EXT if s < 1.0 => (d / (1.0 - s)).min(1.0),
        BlendOp::COLORDODGE_EXT => 1.0,
        BlendOp::COLORBURN_EXT if d >= 1.0 => 1.0,
        BlendOp::COLORBURN_EXT if s > 0.0 => 1.0 - ((1.0 - d) / s).min(1.0),
        BlendOp::COLORBURN_EXT => 0.0,
        BlendOp::HARDLIGHT_EXT => hard(s, d),
        BlendOp::SOFTLIGHT_EXT if s <= 0.5 => d - (1.0 - 2.0 * s) * d * (1.0 - d),
        BlendOp::SOFTLIGHT_EXT if d <= 0.25 => {
            d + (2.0 * s - 1.0) * d * ((16.0 * d - 12.0) * d + 3.0)
        }
        BlendOp::SOFTLIGHT_EXT => d + (2.0 * s - 1.0) * (d.sqrt() - d),
        BlendOp::DIFFERENCE_EXT => (d - s).abs(),
        BlendOp::EXCLUSION_EXT => s + d - 2.0 * s * d,
        BlendOp::INVERT_EXT => 1.0 - d,
        BlendOp::INVERT_RGB_EXT => s * (1.0 - d),
        BlendOp::LINEARDODGE_EXT => (s + d).min(1.0),
        BlendOp::LINEARBURN_EXT => (s + d - 1.0).max(0.0),
        BlendOp::VIVIDLIGHT_EXT if s <= 0.0 => 0.0,
        BlendOp::VIVIDLIGHT_EXT if s < 0.5 => 1.0 - ((1.0 - d) / (2.0 * s)).min(1.0),
        BlendOp::VIVIDLIGHT_EXT if s < 1.0 => (d / (2.0 * (1.0 - s))).min(1.0),
        BlendOp::VIVIDLIGHT_EXT => 1.0,
        BlendOp::LINEARLIGHT_EXT => (2.0 * s + d - 1.0).clamp(0.0, 1.0),
        BlendOp::PINLIGHT_EXT => match (2.0 * s - 1.0 > d, s < 0.5, s < 0.5 * d) {
            (true, true, _) => 0.0,
            (true, false, _) => 2.0 * s - 1.0,
            (false, _, true) => 2.0 * s,
            (false, _, false) => d,
        },
        BlendOp::HARDMIX_EXT if s + d < 1.0 => 0.0,
        BlendOp::HARDMIX_EXT => 1.0,
        other => panic!("{other:?}"),
    }
}

/// The factors X, Y, Z of the same table.
fn factors(op: BlendOp) -> [f64; 3] {
    match op {
        BlendOp::ZERO_EXT => [0.0, 0.0, 0.0],
        BlendOp::SRC_EXT => [1.0, 1.0, 0.0],
        BlendOp::DST_EXT => [1.0, 0.0, 1.0],
        BlendOp::SRC_IN_EXT | BlendOp::DST_IN_EXT => [1.0, 0.0, 0.0],
        BlendOp::SRC_OUT_EXT => [0.0, 1.0, 0.0],
        BlendOp::DST_OUT_EXT => [0.0, 0.0, 1.0],
        BlendOp::SRC_ATOP_EXT => [1.0, 0.0, 1.0],
        BlendOp::DST_ATOP_EXT => [1.0, 1.0, 0.0],
        BlendOp::XOR_EXT => [0.0, 1.0, 1.0],
        BlendOp::INVERT_EXT | BlendOp::INVERT_RGB_EXT => [1.0, 0.0, 1.0],
        _ => [1.0; 3],
    }
}

/// The table of operations that know no overlap.
fn additional(op: BlendOp, s: Color, d: Color) -> Color {
    let (sa, da) = (s[3], d[3]);
    let whole = (sa + da).min(1.0);
    let rgb = |f: &dyn Fn(f64, f64) -> f64, alpha: f64| {
        [f(s[0], d[0]), f(s[1], d[1]), f(s[2], d[2]), alpha]
    };
    match op {
        BlendOp::PLUS_EXT => rgb(&|s, d| s + d, sa + da),
        BlendOp::PLUS_CLAMPED_EXT => rgb(&|s, d| (s + d).min(1.0), whole),
        BlendOp::PLUS_CLAMPED_ALPHA_EXT => rgb(&|s, d| (s + d).min(whole), whole),
        BlendOp::PLUS_DARKER_EXT => rgb(&|s, d| (whole - ((sa - s) + (da - d))).max(0.0), whole),
        BlendOp::MINUS_EXT => rgb(&|s, d| d - s, da - sa),
        BlendOp::MINUS_CLAMPED_EXT => rgb(&|s, d| (d - s).max(0.0), (da - sa).max(0.0)),
        BlendOp::CONTRAST_EXT => rgb(&|s, d| da / 2.0 + 2.0 * (d - da / 2.0) * (s - sa / 2.0), da),
        BlendOp::INVERT_OVG_EXT => rgb(&|_, d| sa * (1.0 - d) + (1.0 - sa) * d, sa + da - sa * da),
        BlendOp::RED_EXT => [s[0], d[1], d[2], da],
        BlendOp::GREEN_EXT => [d[0], s[1], d[2], da],
        BlendOp::BLUE_EXT => [d[0], d[1], s[2], da],
        other => panic!("{other:?}"),
    }
}

fn reference(op: BlendOp, state: &AdvancedBlend, s: Color, d: Color) -> Color {
    let flags = [state.source_premultiplied, state.destination_premultiplied];
    let scaled = |[r, g, b, a]: Color, by: f64| [r * by, g * by, b * by, a];
    let mut result = if op.as_raw() >= BlendOp::PLUS_EXT.as_raw() {
        let base = |c: Color, premultiplied: bool| match premultiplied {
            true => c,
            false => scaled(c, c[3]),
        };
        additional(op, base(s, flags[0]), base(d, flags[1]))
    } else {
        let base = |c: Color, premultiplied: bool| match (premultiplied, c[3] == 0.0) {
            (false, _) => c,
            (true, true) => [0.0, 0.0, 0.0, c[3]],
            (true, false) => scaled(c, 1.0 / c[3]),
        };
        let (s, d) = (base(s, flags[0]), base(d, flags[1]));
        let (sa, da) = (s[3], d[3]);
        let p = match state.overlap {
            BlendOverlapEXT::CONJOINT => [sa.min(da), (sa - da).max(0.0), (da - sa).max(0.0)],
            BlendOverlapEXT::DISJOINT => {
                [(sa + da - 1.0).max(0.0), sa.min(1.0 - da), da.min(1.0 - sa)]
            }
            _ => [sa * da, sa * (1.0 - da), da * (1.0 - sa)],
        };
        let [x, y, z] = factors(op);
        let (sc, dc) = ([s[0], s[1], s[2]], [d[0], d[1], d[2]]);
        let mode = match op {
            BlendOp::HSL_HUE_EXT => set_both(sc, dc, dc),
            BlendOp::HSL_SATURATION_EXT => set_both(dc, sc, dc),
            BlendOp::HSL_COLOR_EXT => set_luminosity(sc, dc),
            BlendOp::HSL_LUMINOSITY_EXT => set_luminosity(dc, sc),
            _ => [0, 1, 2].map(|it| f(op, sc[it], dc[it])),
        };
        let rgb = [0, 1, 2].map(|it| mode[it] * p[0] + y * sc[it] * p[1] + z * dc[it] * p[2]);
        [rgb[0], rgb[1], rgb[2], x * p[0] + y * p[1] + z * p[2]]
    };
    if !flags[1] {
        let by = if result[3] == 0.0 {
            0.0
        } else {
            1.0 / result[3]
        };
        result = scaled(result, by);
    }
    match state.clamps {
        true => result.map(|it| it.clamp(0.0, 1.0)),
        false => result,
    }
}

/// A colour of alpha 0, 1 or between, whose components are at most alpha where they are multiplied
/// with it; in steps in which neither sums nor products stand at a limit by rounding alone.
fn color(random: &mut Random, premultiplied: bool) -> [f32; 4] {
    let alpha = [0.0, 0.25, 0.5, 1.0][random.usize(0..4)];
    let mut part = || {
        let part = random.u32(0..=8) as f32 / 8.0;
        if premultiplied { part * alpha } else { part }
    };
    [part(), part(), part(), alpha]
}

#[test]
fn every_operation_is_what_the_tables_say_on_every_tier() {
    let mut random = Random::with_seed(11);
    for raw in BlendOp::ZERO_EXT.as_raw()..=BlendOp::BLUE_EXT.as_raw() {
        for case in 0..24 {
            let op = BlendOp::from_raw(raw);
            let advanced = AdvancedBlend {
                source_premultiplied: case & 1 == 0,
                destination_premultiplied: case & 2 == 0,
                clamps: case & 4 != 0,
                overlap: OVERLAPS[case / 8],
            };
            let state = BlendAttachment {
                color_op: op,
                advanced,
                ..Default::default()
            };
            let (mut source, mut destination) = ([[0; 16]; 4], [[0; 16]; 4]);
            for lane in 0..16 {
                let colors = [
                    color(&mut random, advanced.source_premultiplied),
                    color(&mut random, advanced.destination_premultiplied),
                ];
                for component in 0..4 {
                    source[component][lane] = colors[0][component].to_bits();
                    destination[component][lane] = colors[1][component].to_bits();
                }
            }
            let blend = |tier| blend_advanced(tier, &state, Range::All, 0.0, &source, &destination);
            let blended = blend(Tier::best());
            for &tier in Tier::available() {
                assert_eq!(blend(tier), blended, "{op:?} {advanced:?} {tier:?}");
            }
            for lane in 0..16 {
                let color = |rows: &[[u32; 16]; 4]| {
                    [0, 1, 2, 3].map(|it| f64::from(f32::from_bits(rows[it][lane])))
                };
                let wanted = reference(op, &advanced, color(&source), color(&destination));
                let got = color(&blended);
                for (got, wanted) in got.into_iter().zip(wanted) {
                    assert!(
                        (got - wanted).abs() <= 1e-5,
                        "{op:?} {advanced:?}: {:?} over {:?} is {got}, not {wanted}",
                        color(&source),
                        color(&destination)
                    );
                }
            }
        }
    }
}
