//! Native code as tools see it.

use lanes::Tier as TierKind;

use crate::interp::tests::{Bench, on_tiers};
use crate::native::NativeCounts;

/// A stretch before a loop of native code, which adds a word of a buffer.
const TEXT: &str = "module closest_hit
    inputs payload.0
    output_rows 2
    func f0 {
        v0: descriptor = push_constants
        v1: i32 = input[0]
        v2: i32 = const 0
        v3: i32 = const 1
        v4: i32 = const 9
        v6: i32 = iadd v1, v4
        v7: i32 = imul v6, v6
        v8: i32 = xor v7, v1
        block L0 -> (v9: i32) {
            loop L1 (v10: i32, v11: i32) = (v2, v8) {
                v12: i1 = ult v10, v4
                if v12, L2 {
                    br L2
                } else {
                    br L0(v11)
                }
                v14: i32 = load.buffer v0, v1
                v15: i32 = iadd v14, v10
                v16: i32 = imul v15, v15
                v17: i32 = iadd v16, v11
                v18: i32 = iadd v10, v3
                br L1(v18, v17)
            }
            unreachable
        }
        end(v9, v8)
    }";

#[test]
fn native_code_is_listed_to_the_end_of_each_function() {
    on_tiers(|tier| {
        let bench = Bench::new(TEXT, tier, 1);
        let counts = bench.program.native_counts();
        if tier == TierKind::Portable {
            assert_eq!(counts, NativeCounts::default());
            assert_eq!(bench.program.native_text(), None);
            return;
        }
        let text = bench.program.native_text().expect("it has native code");
        let functions: Vec<&str> = text.trim_end().split("\n\n").collect();
        let begin_with = |start: &str| functions.iter().filter(|it| it.starts_with(start)).count();
        let (stretches, loops) = (begin_with("stretch of "), begin_with("loop of "));
        assert!(stretches >= 1 && loops >= 1, "{text}");
        assert_eq!(stretches + loops, functions.len(), "{text}");
        for function in &functions {
            assert!(function.ends_with(": ret"), "{function}");
            assert_eq!(function.matches(": ret").count(), 1, "{function}");
            assert!(!function.contains("(bad)"), "{function}");
        }
        // The square, in the registers of the tier, and a constant behind the code.
        let vector = if tier == TierKind::Avx2 { "ymm" } else { "zmm" };
        let is_product = |line: &&str| line.contains(&format!("vpmulld {vector}"));
        assert!(text.lines().filter(is_product).count() >= 2, "{text}");
        assert!(text.contains("[rel ") && text.contains(" ; "), "{text}");

        let loops = bench.program.native_loops();
        assert_eq!((counts.stretches, loops), (stretches + 1, 1), "{text}");
        assert!(
            counts.operations > 3 && counts.size_bytes > 64,
            "{counts:?}"
        );
        assert!((3..=32).contains(&counts.vector_registers), "{counts:?}");
    });
}

/// Where lanes leave one after another, code tests whether there is one as soon as some have left,
/// and not at a turn's end.
#[test]
fn loops_end_once_all_lanes_have_left() {
    let products: String = (20..40)
        .map(|k| {
            format!(
                "v{k}: i32 = imul v{}, v17\n",
                if k == 20 { 17 } else { k - 1 }
            )
        })
        .collect();
    let text = TEXT
        .replace("ult v10, v4", "ult v10, v1")
        .replace("v18: i32", &(products + "v18: i32"))
        .replace("br L1(v18, v17)", "br L1(v18, v39)");
    on_tiers(|tier| {
        let test = match tier {
            TierKind::Portable => return,
            TierKind::Avx2 => "vtestps",
            TierKind::Avx512 => "kortestw",
        };
        let bench = Bench::new(&text, tier, 1);
        let listing = bench.program.native_text().expect("it has native code");
        let loops: Vec<&str> = (listing.split("\n\n"))
            .filter(|function| function.starts_with("loop of "))
            .collect();
        assert!(!loops.is_empty(), "{listing}");
        for code in loops {
            let last = |name: &str| code.rfind(name).expect("it is there");
            assert!(last(test) < last("vpmulld"), "{code}");
        }
    });
}
