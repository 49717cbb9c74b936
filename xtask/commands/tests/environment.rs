//! Programs get the environment that the user had, and what points them at Tuff.

use std::ffi::OsString;

use commands::{Variables, of_the_shell, succeed, xtask};

/// A folder that no toolchain has.
const LIBRARIES: (&str, &str) = ("LD_LIBRARY_PATH", "/opt/of-the-user/lib");

/// The environment that `cargo xtask run` passes to a program.
fn handed_on(shell: &Variables) -> Variables {
    let said = succeed(&xtask(shell, &["run", "--", "env", "-0"]));
    let lines = said.split('\0').filter_map(|line| line.split_once('='));
    lines
        .map(|(name, value)| (name.into(), value.into()))
        .collect()
}

#[test]
fn programs_get_the_environment_of_the_user() {
    for libraries in [None, Some(LIBRARIES)] {
        let mut shell = of_the_shell();
        shell.extend(libraries.map(|(name, value)| (name.into(), value.into())));
        let mut seen = handed_on(&shell);
        for name in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
            let manifest = seen.remove(&OsString::from(name));
            let manifest = manifest.expect("it points at Tuff").into_string();
            assert!(manifest.is_ok_and(|it| it.ends_with("tuff_icd.json")));
        }
        // By these two cargo names the system's certificates if the user does not: they may be new.
        for name in ["SSL_CERT_FILE", "SSL_CERT_DIR"].map(OsString::from) {
            if !shell.contains_key(&name) {
                seen.remove(&name);
            }
        }
        assert_eq!(seen, shell);
    }
}

#[test]
fn info_tells_the_variables_of_the_user() {
    let mut shell = of_the_shell();
    let told = succeed(&xtask(&shell, &["info"]));
    assert!(
        told.contains("Tuff (") && !told.contains("LD_LIBRARY_PATH"),
        "{told}"
    );
    let (name, value) = LIBRARIES;
    shell.insert(name.into(), value.into());
    let told = succeed(&xtask(&shell, &["info"]));
    assert!(told.contains(&format!("  {name}={value}\n")), "{told}");
}
