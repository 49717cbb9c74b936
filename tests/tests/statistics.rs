//! `TUFF_STATS`: the table of how full the waves were, and that callees are packed whatever the
//! divergence.

use std::collections::HashMap;
use std::process::Command;

use tuff_tests::*;

const CHILD: &str = "TUFF_TEST_STATISTICS";

/// Rays of which one in five hits, so that no subgroup of the caller is full of hits.
fn trace_divergently(gpu: &Gpu) {
    let corners: Vec<[f32; 3]> = (0..64)
        .flat_map(|i| {
            let x = 5.0 * i as f32;
            [[x, 0.0, 1.0], [x + 1.0, 0.0, 1.0], [x, 1.0, 1.0]]
        })
        .collect();
    let world = gpu.scene(&[Geometry::opaque(&corners)]);
    let found = gpu.depths(world, 320);
    let expected: Vec<f32> = (0..320)
        .map(|x| if x % 5 == 0 { 1.0 } else { -1.0 })
        .collect();
    assert_eq!(found, expected);
}

#[test]
fn calls_fill_their_waves() {
    let gpu = Gpu::new().with("a driver that promises this", Gpu::is_tuff);
    let Some(gpu) = gpu else { return };
    if std::env::var_os(CHILD).is_some() {
        trace_divergently(&gpu);
        return;
    }
    let program = std::env::current_exe().expect("this program");
    let child = Command::new(program)
        .args(["--exact", "calls_fill_their_waves", "--nocapture"])
        .envs([("TUFF_STATS", "1"), (CHILD, "1")])
        .output()
        .expect("this program runs again");
    let said = String::from_utf8_lossy(&child.stderr);
    assert!(child.status.success(), "{said}");
    // Stage, number, waves, subgroups, lanes, occupancy; stages may be of two words.
    let rows: HashMap<String, Vec<&str>> = said
        .lines()
        .filter(|line| line.ends_with('%'))
        .map(|line| {
            let words: Vec<&str> = line.split_whitespace().collect();
            let stage = words.len() - 5;
            (words[..stage].join(" "), words[stage..].to_vec())
        })
        .collect();
    let column = |stage: &str, column: usize| {
        let row = rows.get(stage).unwrap_or_else(|| panic!("{said}"));
        row[column]
            .trim_end_matches('%')
            .parse::<f32>()
            .expect("a number")
    };
    assert_eq!(column("closest hit", 3), 64.0, "{said}");
    assert_eq!(column("miss", 3), 256.0, "{said}");
    // The 64 hits are of twenty subgroups.
    assert!(column("closest hit", 4) >= 80.0, "{said}");
    // The rest of each, twelve or thirteen lanes, is as full.
    assert!(column("miss", 4) >= 80.0, "{said}");
}
