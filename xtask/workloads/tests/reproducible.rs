//! The same input gives the same bits: for any number of threads, on every instruction set, with
//! native code and without, in waves of any length, with lines of ray generation shaders and
//! without, in hosts that flush denormals, and again.

use std::process::Command;

/// A way to run.
#[derive(Clone, Copy, Debug)]
struct Way {
    threads: u32,
    tier: &'static str,
    native: &'static str,
    /// Subgroups of a wave, at most.
    wave: &'static str,
    /// Whether lines of ray generation shaders are taken on directly.
    direct: &'static str,
    accuracy: &'static str,
    flushes: bool,
}

/// The default, except for the number of threads.
const USUAL: Way = Way {
    threads: 1,
    tier: "",
    native: "",
    wave: "",
    direct: "",
    accuracy: "",
    flushes: false,
};

/// The output of the workloads; digests of two turns are equal.
fn run(arguments: &[&str], way: Way) -> Vec<String> {
    let output = Command::new(env!("CARGO_BIN_EXE_workloads"))
        .args(arguments)
        .env("TUFF_THREADS", way.threads.to_string())
        .env("TUFF_TIER", way.tier)
        .env("TUFF_NATIVE", way.native)
        .env("TUFF_WAVE", way.wave)
        .env("TUFF_DIRECT", way.direct)
        .env("TUFF_ACCURACY", way.accuracy)
        .env("LP_NUM_THREADS", way.threads.to_string())
        .output()
        .expect("the workloads start");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}: {errors}", output.status);
    let text = String::from_utf8(output.stdout).expect("text");
    for line in text.lines() {
        let mut fields = line.split('\t').skip(1);
        assert_eq!(fields.next(), fields.next(), "{way:?}: {line}");
    }
    text.lines().map(str::to_owned).collect()
}

/// How many lanes of each ray tracing shader ran, and in how many subgroups. Of ray generation
/// shaders the lanes alone: a subgroup that has ended runs along with others of its wave.
fn subgroups(workload: &str, direct: &str) -> Vec<String> {
    let arguments = "--turns 1 --width 120 --height 68 --triangles 2000 --instances 8";
    let output = Command::new(env!("CARGO_BIN_EXE_workloads"))
        .args(["measure", workload])
        .args(arguments.split(' '))
        .env("TUFF_STATS", "1")
        .env("TUFF_DIRECT", direct)
        .output()
        .expect("the workloads start");
    assert!(output.status.success(), "{}", output.status);
    let table = String::from_utf8(output.stderr).expect("text");
    let columns = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let (shader, numbers) = words.split_at(words.len().saturating_sub(4));
        let first = if shader.contains(&"generation") { 2 } else { 1 };
        format!("{shader:?} {:?}", numbers.get(first..3))
    };
    table.lines().map(columns).collect()
}

/// Lines form the subgroups that a batch without them forms.
#[test]
fn lines_change_no_subgroup() {
    for workload in ["path", "foliage"] {
        let one = subgroups(workload, "0");
        if one.iter().any(|row| row.contains("generation")) {
            assert_eq!(subgroups(workload, "1"), one, "{workload}");
        }
    }
}

/// The digests of every workload's picture.
fn pictures(way: Way) -> Vec<String> {
    let size = ["--width", "48", "--height", "32"];
    let scene = ["--triangles", "2000", "--instances", "8"];
    run(&[&["digest"], &size[..], &scene[..]].concat(), way)
}

/// The digests of what shaders can see of how they are run.
fn probes(way: Way) -> Vec<String> {
    let arguments: &[&str] = match way.flushes {
        true => &["probe", "--flush"],
        false => &["probe"],
    };
    run(arguments, way)
}

#[test]
fn pictures_depend_on_their_input_alone() {
    let one = pictures(USUAL);
    assert!(one.len() > 10, "{one:?}");
    for threads in [2, 8] {
        let way = Way { threads, ..USUAL };
        assert_eq!(pictures(way), one, "{way:?}");
    }
    for (tier, native, wave, direct) in [
        ("avx2", "", "4", ""),
        ("portable", "", "1", "0"),
        ("", "0", "", "0"),
    ] {
        let way = Way {
            threads: 2,
            tier,
            native,
            wave,
            direct,
            ..USUAL
        };
        assert_eq!(pictures(way), one, "{way:?}");
    }
}

/// Who shares a subgroup in hit, miss, any-hit, intersection and callable shaders; candidates in
/// their order; which hit is the first; functions and denormals.
#[test]
fn shaders_cannot_tell_how_they_are_run() {
    for accuracy in ["", "exact"] {
        let usual = Way { accuracy, ..USUAL };
        let one = probes(usual);
        for (threads, tier, wave, direct, flushes) in [
            (8, "", "", "", false),
            (1, "", "1", "0", true),
            (2, "", "4", "", false),
            (2, "", "", "0", false),
            (2, "avx2", "", "", true),
            (1, "avx2", "1", "", false),
            (1, "avx2", "4", "0", false),
            (2, "portable", "16", "0", false),
            (2, "portable", "4", "", true),
        ] {
            let way = Way {
                threads,
                tier,
                wave,
                direct,
                flushes,
                ..usual
            };
            assert_eq!(probes(way), one, "{way:?}");
        }
    }
}
