//! What the environment asks for: `TUFF_ACCURACY`, `TUFF_TIER`, `TUFF_DISABLE`, `TUFF_WAVE` and `TUFF_GRAPHICS`,
//! read once.

#![forbid(unsafe_code)]

use std::sync::OnceLock;

use spirv_jit::interp::{TIER_NAMES, limit_tier};
use spirv_jit::{Accuracy, pass};
use traversal::{Options, Specialisation, Tier, Walker};

/// The settings of the process.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Of shaders' functions.
    pub accuracy: Accuracy,
    walks: Options,
    /// Subgroups of a wave, at most (`TUFF_WAVE`).
    pub wave: usize,
    /// Whether all geometry is opaque to pipelines without any-hit shaders.
    pub opaque_without_any_hit: bool,
    /// Whether queues draw (`TUFF_GRAPHICS=1`).
    pub graphics: bool,
}

/// The switch for [`Settings::opaque_without_any_hit`].
const NO_ANY_HIT: &str = "no_any_hit";

impl Settings {
    /// From the variables' values.
    ///
    /// # Errors
    /// What is wrong with them, in one line.
    fn parse(
        accuracy: Option<&str>,
        tier: Option<&str>,
        disabled: Option<&str>,
        wave: Option<&str>,
        graphics: Option<&str>,
    ) -> Result<Settings, String> {
        let accuracy: Accuracy = match accuracy {
            None | Some("") => Accuracy::Spec,
            Some(text) => text
                .parse()
                .map_err(|error| format!("TUFF_ACCURACY: {error}"))?,
        };
        let tier = match tier {
            None | Some("") => Tier::best(),
            Some(text) => no_better_than(text)?,
        };
        let wave = match wave {
            None | Some("") => usize::MAX,
            Some(text) => (text.parse().ok())
                .filter(|&subgroups| subgroups > 0)
                .ok_or_else(|| format!("TUFF_WAVE: \"{text}\" is not a number of subgroups"))?,
        };
        let graphics = match graphics {
            None | Some("" | "0") => false,
            Some("1") => true,
            Some(text) => return Err(format!("TUFF_GRAPHICS: \"{text}\" is not 0 or 1")),
        };
        let names = disabled.unwrap_or_default().split(',').map(str::trim);
        let mut without = Vec::new();
        let mut opaque_without_any_hit = true;
        for name in names.filter(|name| !name.is_empty()) {
            match Specialisation::ALL.iter().find(|(known, _)| *known == name) {
                Some(&(_, specialisation)) => without.push(specialisation),
                None if name == NO_ANY_HIT => opaque_without_any_hit = false,
                None if pass::is_switch(name) => {}
                None => return Err(format!("TUFF_DISABLE: {}", unknown(name))),
            }
        }
        Ok(Settings {
            accuracy,
            wave,
            opaque_without_any_hit,
            graphics,
            walks: Options {
                // What is cheaper than the default gains nothing in walks: docs/accuracy.md.
                accuracy: match accuracy {
                    Accuracy::Fast | Accuracy::Spec => traversal::Accuracy::Spec,
                    Accuracy::Exact => traversal::Accuracy::Exact,
                },
                without: without.into_iter().collect(),
                tier,
            },
        })
    }

    /// A walker for one thread.
    pub fn walker(&self) -> Box<Walker> {
        Walker::with(self.walks).expect("the best tier is available")
    }
}

/// The best tier of walks up to the one of this name.
fn no_better_than(name: &str) -> Result<Tier, String> {
    let named = TIER_NAMES
        .iter()
        .zip(Tier::ALL)
        .find(|(known, _)| **known == name);
    match named {
        Some((_, tier)) => Ok(tier.min(Tier::best())),
        None => Err(format!(
            "TUFF_TIER: \"{name}\" is not one of {}",
            TIER_NAMES.join(", ")
        )),
    }
}

fn unknown(name: &str) -> String {
    let walks = Specialisation::ALL.iter().map(|(name, _)| *name);
    let passes = pass::PASSES.iter().map(|pass| pass.name);
    let known: Vec<&str> = walks
        .chain([NO_ANY_HIT])
        .chain(passes)
        .chain(["passes"])
        .collect();
    format!("\"{name}\" is not one of {}", known.join(", "))
}

/// The process's settings.
///
/// # Errors
/// A variable has a value that it cannot have.
pub fn checked() -> Result<&'static Settings, &'static str> {
    static SETTINGS: OnceLock<Result<Settings, String>> = OnceLock::new();
    let settings = SETTINGS.get_or_init(|| {
        let names = [
            "TUFF_ACCURACY",
            "TUFF_TIER",
            "TUFF_DISABLE",
            "TUFF_WAVE",
            "TUFF_GRAPHICS",
        ];
        let values = names.map(|name| {
            let value = std::env::var_os(name)?;
            Some(value.to_string_lossy().into_owned())
        });
        let [accuracy, tier, disabled, wave, graphics] = &values;
        let of = Option::<String>::as_deref;
        let settings =
            Settings::parse(of(accuracy), of(tier), of(disabled), of(wave), of(graphics))?;
        // One limit for all: programs and samplers, walks and builds.
        if let Some(tier) = tier {
            limit_tier(tier);
            settings.walks.tier.limit();
        }
        Ok(settings)
    });
    settings.as_ref().map_err(String::as_str)
}

/// The process's settings: no device comes to be with others than [`checked`] ones.
pub fn settings() -> &'static Settings {
    checked().expect("devices are created with valid settings")
}

/// Whether queues draw: [`Settings::graphics`], also before there is a device. Settings that are not valid ask for nothing.
pub fn has_graphics() -> bool {
    checked().is_ok_and(|settings| settings.graphics)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_taken_or_refused() {
        let plain = Settings::parse(None, None, None, None, None).unwrap();
        assert_eq!(plain.accuracy, Accuracy::Spec);
        let exact = Settings::parse(
            Some("exact"),
            Some("portable"),
            Some("packets, simplify"),
            Some("4"),
            Some("1"),
        )
        .unwrap();
        assert_eq!(exact.accuracy, Accuracy::Exact);
        assert_eq!(exact.walks.accuracy, traversal::Accuracy::Exact);
        assert_eq!(exact.walks.tier, Tier::Portable);
        assert!(exact.walks.without.contains(Specialisation::Packets));
        assert!(!exact.walks.without.contains(Specialisation::Opaque));
        assert!(exact.opaque_without_any_hit);
        assert!(exact.graphics && !plain.graphics);
        assert!(Settings::parse(None, None, None, None, Some("yes")).is_err());
        let without = Settings::parse(None, None, Some("no_any_hit"), None, None).unwrap();
        assert!(!without.opaque_without_any_hit);
        let message = Settings::parse(Some("best"), None, None, None, None).unwrap_err();
        assert!(
            message.contains("\"best\" is not one of fast, spec and exact"),
            "{message}"
        );
        assert_eq!((plain.wave, exact.wave), (usize::MAX, 4));
        assert!(Settings::parse(None, None, None, Some("0"), None).is_err());
        let message = Settings::parse(None, Some("sse9"), None, None, None).unwrap_err();
        assert!(
            message.contains("not one of portable, avx2, avx512"),
            "{message}"
        );
        let message = Settings::parse(None, None, Some("pakets"), None, None).unwrap_err();
        assert!(
            message.contains("\"pakets\" is not one of packets,"),
            "{message}"
        );
    }
}
