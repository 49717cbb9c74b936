//! The same input gives the same bits: for any number of threads, on every instruction set, and again.

use std::process::Command;

/// The digests of every workload's picture, drawn with so many threads and an instruction set; those of two turns are equal.
fn digests(threads: u32, tier: &str) -> Vec<String> {
    let output = Command::new(env!("CARGO_BIN_EXE_workloads"))
        .arg("digest")
        .args(["--width", "48", "--height", "32"])
        .args(["--triangles", "2000", "--instances", "8"])
        .env("TUFF_THREADS", threads.to_string())
        .env("TUFF_TIER", tier)
        .env("LP_NUM_THREADS", threads.to_string())
        .output()
        .expect("the workloads start");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}: {errors}", output.status);
    let text = String::from_utf8(output.stdout).expect("text");
    for line in text.lines() {
        let mut fields = line.split('\t').skip(1);
        assert_eq!(
            fields.next(),
            fields.next(),
            "with {threads} threads: {line}"
        );
    }
    text.lines().map(str::to_owned).collect()
}

#[test]
fn pictures_depend_on_their_input_alone() {
    let one = digests(1, "");
    assert!(one.len() > 10, "{one:?}");
    for threads in [2, 8] {
        assert_eq!(digests(threads, ""), one, "with {threads} threads");
    }
    for tier in ["avx2", "portable"] {
        assert_eq!(digests(2, tier), one, "with {tier}");
    }
}
