//! Programs that refuse a driver because of its properties. A driver cannot see which program asks,
//! so `tuff info` lists them.

/// The variable with the conformance version that the driver reports.
pub const CONFORMANCE: &str = "TUFF_CONFORMANCE";

/// Programs that require a conformance version other than 0.0.0.0. docs/ci.md has the same list.
pub const WANT_A_CONFORMANCE_VERSION: [&str; 4] = [
    "Firefox's WebGPU",
    "SDL3's GPU interface",
    "wgpu",
    "wgpu-py with pygfx",
];

/// Programs that print a name for the vendor's number, and have none for 0. docs/ci.md has the same
/// list.
pub const PRINT_THE_VENDOR: [&str; 1] = ["ANGLE (WebGL in Chromium) prints `NULL`"];

/// The lines of `tuff info` about them; `conformance` is the version that is set, if any.
pub fn lines(conformance: Option<&str>) -> Vec<String> {
    let mut lines = vec![format!(
        "Programs that refuse a driver without a conformance version: {}.",
        WANT_A_CONFORMANCE_VERSION.join(", ")
    )];
    lines.push(match conformance {
        Some(version) => format!("  {CONFORMANCE} is set: the driver reports {version} to them."),
        None => "  For one of them: tuff run --conformance -- PROGRAM. Tuff has not been certified, and \
                 reports what you say."
            .into(),
    });
    lines.push(format!(
        "The vendor's number is 0, since Vulkan sets none aside for drivers without one: {}.",
        PRINT_THE_VENDOR.join(", ")
    ));
    lines
}

/// Accepts the same values as the driver: four numbers below 256.
///
/// # Errors
/// The text is no such version.
pub fn conformance_version(text: &str) -> Result<String, String> {
    let numbers: Vec<_> = text.split('.').map(str::parse::<u8>).collect();
    match numbers.len() == 4 && numbers.iter().all(Result::is_ok) {
        true => Ok(text.into()),
        false => Err("a conformance version is like 1.4.0.0".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_lists_the_same_programs() {
        let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/ci.md");
        let page = std::fs::read_to_string(page).expect("the page can be read");
        let said = lines(None).join("\n");
        let programs = WANT_A_CONFORMANCE_VERSION.iter().chain(&PRINT_THE_VENDOR);
        for program in programs {
            assert!(page.contains(&format!("\n* {program}")), "{program}");
            assert!(said.contains(program), "{said}");
        }
        assert!(said.contains("tuff run --conformance"), "{said}");
        let set = lines(Some("1.3.8.0")).join("\n");
        assert!(set.contains("reports 1.3.8.0"), "{set}");
    }

    #[test]
    fn versions_have_four_numbers() {
        assert_eq!(conformance_version("1.4.0.0").as_deref(), Ok("1.4.0.0"));
        for text in ["", "1.4", "1.4.0.0.0", "1.4.0.256", "1.4.0.x"] {
            assert!(conformance_version(text).is_err(), "{text}");
        }
    }
}
