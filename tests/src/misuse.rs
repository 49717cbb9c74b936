//! Rules broken on purpose, and what a driver that validates says of it.

use crate::Gpu;

/// Breaks one rule; what it asserts holds with validation and without.
pub type Misuse = fn(&Gpu);

impl Gpu {
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
}
