//! The promises about hard scenes: every hit is found, none is invented, and distances are right.

use scenes::hard::{self, CASES, fault};
use scenes::*;
use traversal::*;

/// Faults by column, in walks of this accuracy.
fn faults(case: &hard::HardSeries, accuracy: Accuracy, rays: usize) -> Vec<(f64, usize)> {
    let options = Options {
        accuracy,
        ..Options::default()
    };
    let mut walker = Walker::with(options).expect("the best tier is available");
    let count = |&column: &f64| {
        let hard = case.make(column, rays);
        let scene = Scene::new(std::slice::from_ref(&hard.mesh), 0);
        let wrong = hard.rays.iter().filter(|(ray, truth)| {
            let found = closest_with(&mut walker, &scene.top, ray).map(|hit| hit.t);
            let fault = fault(found, *truth);
            if let Some(fault) = fault {
                println!(
                    "{} {column:e}: {fault:?} {found:?} {truth:?} {ray:?}",
                    case.name
                );
            }
            fault.is_some()
        });
        (column, wrong.count())
    };
    case.columns.iter().map(count).collect()
}

/// Between which columns of each case every answer is right.
const PROMISES: [(&str, f64, f64); 12] = [
    ("slivers", 1.0, 1e9),
    ("reach", 1.0, 1e8),
    ("needles", 1.0, 1e6),
    ("offset", 1.0, 1e8),
    ("scale", 1e-41, 1e37),
    ("direction", 1e-44, 1e37),
    ("grazing", 1e-7, 1.0),
    ("parallel", 0.0, 1.0),
    ("start", 1e-9, 1.0),
    ("end", 3e-7, 1e-1),
    ("layers", 0.0, 1e-1),
    ("nested", 4.0, 512.0),
];

#[test]
fn answers_are_right_as_far_as_is_promised() {
    assert_eq!(CASES.len(), PROMISES.len());
    let mut broken = Vec::new();
    for (case, (name, low, high)) in CASES.iter().zip(PROMISES) {
        assert_eq!(case.name, name);
        for accuracy in [Accuracy::Spec, Accuracy::Exact] {
            let found = faults(case, accuracy, 60);
            let inside =
                |(column, wrong): &&(f64, usize)| (low..=high).contains(column) && *wrong > 0;
            let inside: Vec<_> = found.iter().filter(inside).collect();
            if !inside.is_empty() {
                broken.push(format!("{name} {accuracy:?}: {inside:?}"));
            }
        }
    }
    assert!(broken.is_empty(), "{broken:#?}");
}
