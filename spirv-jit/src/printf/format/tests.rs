//! Expected texts are those of `debug_printf.md` (Vulkan validation layers) and of C's `printf`
//! (ISO/IEC 9899:2018, 7.21.6.1, with its examples' values).

use super::super::{Argument, Message};
use crate::types::Type;

fn message(format: &str, arguments: &[(Type, u32)]) -> Message {
    let arguments = arguments.iter().map(|&(ty, components)| Argument {
        ty: Some(ty),
        components,
    });
    Message {
        format: Some(format.into()),
        arguments: arguments.collect(),
    }
}

fn text(format: &str, arguments: &[(Type, u32)], words: &[u32]) -> String {
    message(format, arguments).text(words)
}

fn float(format: &str, value: f32) -> String {
    text(format, &[(Type::F32, 1)], &[value.to_bits()])
}

fn double(format: &str, value: f64) -> String {
    let bits = value.to_bits();
    text(
        format,
        &[(Type::F64, 1)],
        &[bits as u32, (bits >> 32) as u32],
    )
}

fn int(format: &str, value: i32) -> String {
    text(format, &[(Type::I32, 1)], &[value as u32])
}

fn long(format: &str, value: u64) -> String {
    text(
        format,
        &[(Type::I64, 1)],
        &[value as u32, (value >> 32) as u32],
    )
}

/// The examples of `debug_printf.md`.
#[test]
#[expect(clippy::approx_constant, reason = "the page's number")]
fn the_layers_examples_print_what_their_page_says() {
    let value = 3.1415f32;
    assert_eq!(
        float("Here's a float value with full precision %f", value),
        "Here's a float value with full precision 3.141500"
    );
    assert_eq!(
        float("Here's a float value to 2 decimals %1.2f", value),
        "Here's a float value to 2 decimals 3.14"
    );
    let vector = [1.2f32, 2.2, 3.2, 4.2].map(f32::to_bits);
    assert_eq!(
        text(
            "Here's a vector of floats %1.2v4f",
            &[(Type::F32, 4)],
            &vector
        ),
        "Here's a vector of floats 1.20, 2.20, 3.20, 4.20"
    );
    let big = 0x2000000000000001;
    assert_eq!(
        long("Unsigned long as decimal %lu", big),
        "Unsigned long as decimal 2305843009213693953"
    );
    assert_eq!(
        long("Unsigned long as hex 0x%lx", big),
        "Unsigned long as hex 0x2000000000000001"
    );
    assert_eq!(long("%ul.", big), "2305843009213693953.");
}

#[test]
fn whole_numbers_are_as_in_c() {
    assert_eq!(int("%d %%", -5), "-5 %");
    assert_eq!(int("%i", i32::MIN), "-2147483648");
    assert_eq!(int("%u", -1), "4294967295");
    assert_eq!(int("%ul", 3), "3l");
    assert_eq!(int("%x|", 0xBEEF), "beef|");
    assert_eq!(int("%#X", 0xBEEF), "0XBEEF");
    assert_eq!(int("%#o", 8), "010");
    assert_eq!(int("%5d|", 42), "   42|");
    assert_eq!(int("%-5d|", 42), "42   |");
    assert_eq!(int("%05d|", -42), "-0042|");
    assert_eq!(int("%+d", 42), "+42");
    assert_eq!(int("% d", 42), " 42");
    assert_eq!(int("%.4d", -42), "-0042");
    assert_eq!(int("%08.4d", 42), "    0042");
    assert_eq!(int("%.0d", 0), "");
    assert_eq!(long("%ld", u64::MAX), "-1");
    assert_eq!(long("%p", 0xdead_beef_0000), "0xdeadbeef0000");
    assert_eq!(text("%d", &[(Type::I8, 1)], &[0xF0]), "-16");
    assert_eq!(text("%u", &[(Type::I16, 1)], &[0xFFFF]), "65535");
    assert_eq!(text("%d", &[(Type::I1, 1)], &[1]), "1");
    assert_eq!(
        text(
            "%v3d and %v2x",
            &[(Type::I32, 3), (Type::I32, 2)],
            &[1, 2, u32::MAX, 10, 11]
        ),
        "1, 2, -1 and a, b"
    );
}

#[test]
fn floats_are_as_in_c() {
    assert_eq!(double("%f", -0.0), "-0.000000");
    assert_eq!(double("%.0f", 2.5), "2");
    assert_eq!(double("%#.0f", 2.0), "2.");
    assert_eq!(double("%e", 12345.678), "1.234568e+04");
    assert_eq!(double("%.1E", 1e-300), "1.0E-300");
    assert_eq!(double("%e", 0.0), "0.000000e+00");
    assert_eq!(double("%g", 100000.0), "100000");
    assert_eq!(double("%g", 1000000.0), "1e+06");
    assert_eq!(double("%g", 0.0001), "0.0001");
    assert_eq!(double("%g", 0.00001), "1e-05");
    assert_eq!(double("%#g", 1.0), "1.00000");
    assert_eq!(double("%.3g", 999.9), "1e+03");
    assert_eq!(double("%g", 0.0), "0");
    assert_eq!(double("%a", 1.0), "0x1p+0");
    assert_eq!(double("%a", -0.5), "-0x1p-1");
    assert_eq!(double("%A", 3.140625), "0X1.92P+1");
    assert_eq!(double("%.1a", 1.96875), "0x2.0p+0");
    assert_eq!(double("%.2a", 3.1406), "0x1.92p+1");
    assert_eq!(double("%a", 0.0), "0x0p+0");
    assert_eq!(double("%08.2f|", -1.5), "-0001.50|");
    assert_eq!(double("%8f|%%", f64::INFINITY), "     inf|%");
    assert_eq!(double("%08F|", f64::NEG_INFINITY), "    -INF|");
    assert_eq!(double("%f", f64::NAN), "nan");
    assert_eq!(text("%g", &[(Type::F16, 1)], &[0x3E00]), "1.5");
}

#[test]
fn arguments_print_by_their_own_type() {
    assert_eq!(float("%d", 1.5), "1.500000");
    assert_eq!(float("%x", 1.0), "3f800000");
    assert_eq!(int("%f", -3), "-3");
}

#[test]
fn wrong_formats_say_so() {
    let nothing = Message {
        format: None,
        arguments: Vec::new(),
    };
    assert_eq!(nothing.text(&[]), "<the format is not an OpString>");
    assert_eq!(text("a %d b", &[], &[]), "a <no argument for %d> b");
    assert_eq!(int("a", 1), "a <1 argument has no conversion>");
    let two = [(Type::I32, 1); 2];
    assert_eq!(text("", &two, &[1, 2]), " <2 arguments have no conversion>");
    assert_eq!(int("[%s]", 1), "[<%s is not supported>]");
    assert_eq!(int("%d %", 1), "1 <% is not supported>");
    assert_eq!(
        text("%v2d", &[(Type::I32, 3)], &[1, 2, 3]),
        "<%v2d for 3 components>1, 2, 3"
    );
    assert_eq!(int("%v2d", 1), "<%v2d for 1 component>1");
    let matrix = Message {
        format: Some("%f %d".into()),
        arguments: vec![
            Argument {
                ty: None,
                components: 1,
            },
            Argument {
                ty: Some(Type::I32),
                components: 1,
            },
        ],
    };
    assert_eq!(matrix.text(&[7]), "<the argument for %f is not a number> 7");
    // Words that are missing are no arguments.
    assert_eq!(int("%d %d", 4), "4 <no argument for %d>");
    assert_eq!(text("%d", &[(Type::I64, 1)], &[1]), "<no argument for %d>");
    // A width of any size fills no memory.
    assert_eq!(int("%99999999999d", 1).len(), 256);
}
