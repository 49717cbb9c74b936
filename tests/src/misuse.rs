//! Rules broken on purpose, and what a driver that validates says of it.

use crate::Gpu;

/// Breaks one rule; its assertions hold with validation and without.
pub type Misuse = fn(&Gpu);

/// Of drivers that survive broken rules beyond what the specification asks for.
const PROMISE: &str = "a driver that promises this";

impl Gpu {
    /// A device without the validation layer, of a driver that promises to survive what tests do.
    #[track_caller]
    pub fn surviving() -> Option<Gpu> {
        Gpu::without_validation().with(PROMISE, Gpu::is_tuff)
    }

    /// The same with the driver's own validation.
    #[track_caller]
    pub fn reporting() -> Option<Gpu> {
        Gpu::validated_by_driver()?.with(PROMISE, Gpu::is_tuff)
    }

    /// Breaks each of the rules.
    pub fn assert_survived(&self, checks: &[(&str, Misuse)]) {
        for (name, check) in checks {
            println!("{name}");
            check(self);
        }
    }

    /// Breaks each of the rules, and asserts that the driver reports it by its name.
    pub fn assert_reported(&self, checks: &[(&str, Misuse)]) {
        for (name, check) in checks {
            check(self);
            let said = self.take_complaints();
            assert!(
                said.iter().any(|text| text.starts_with(name)),
                "{name} is not in {said:#?}"
            );
        }
    }

    /// Asserts that the driver said this, among other things.
    #[track_caller]
    pub fn assert_said(&self, text: &str) {
        let said = self.take_complaints();
        assert!(
            said.iter().any(|said| said.contains(text)),
            "{text} is not in {said:#?}"
        );
    }

    /// Asserts that the driver said nothing.
    #[track_caller]
    pub fn assert_silent(&self) {
        assert_eq!(self.take_complaints(), [""; 0]);
    }
}
