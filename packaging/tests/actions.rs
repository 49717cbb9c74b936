//! The GitHub action and the project's workflow: their shell steps run, or at least parse, and use
//! only declared names.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use yaml_rust2::{Yaml, YamlLoader};

fn root() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    fs::canonicalize(root).expect("the repository")
}

fn yaml(path: &str) -> Yaml {
    let text = fs::read_to_string(root().join(path)).expect("the file can be read");
    let mut documents = YamlLoader::load_from_str(&text).expect("the file is YAML");
    documents.remove(0)
}

/// The shell code of each step of a file.
fn scripts(yaml: &Yaml, found: &mut Vec<String>) {
    match yaml {
        Yaml::Hash(hash) => {
            for (key, value) in hash {
                match (key.as_str(), value.as_str()) {
                    (Some("run"), Some(script)) => found.push(script.into()),
                    _ => scripts(value, found),
                }
            }
        }
        Yaml::Array(items) => items.iter().for_each(|item| scripts(item, found)),
        _ => {}
    }
}

/// Texts between `${{` and `}}`.
fn expressions(text: &str) -> Vec<&str> {
    (text.split("${{").skip(1))
        .filter_map(|rest| rest.split_once("}}"))
        .map(|(inside, _)| inside.trim())
        .collect()
}

#[test]
fn steps_parse() {
    for file in ["action.yml", ".github/workflows/ci.yml"] {
        let mut found = Vec::new();
        scripts(&yaml(file), &mut found);
        assert!(!found.is_empty(), "{file} runs nothing");
        for script in found {
            let mut plain = script.clone();
            for inside in expressions(&script) {
                // User input reaches a shell only through variables.
                assert!(
                    inside.starts_with("matrix."),
                    "{file}: {inside} inside a script"
                );
                plain = plain.replace(&format!("${{{{ {inside} }}}}"), "1");
            }
            let parsed = Command::new("bash")
                .args(["-n", "-c", &plain])
                .output()
                .expect("bash");
            assert!(parsed.status.success(), "{file}: {script}\n{parsed:?}");
        }
    }
}

#[test]
fn inputs_are_declared() {
    let action = yaml("action.yml");
    let text = fs::read_to_string(root().join("action.yml")).expect("the file can be read");
    let inputs = action["inputs"].as_hash().expect("inputs");
    for name in expressions(&text)
        .iter()
        .filter_map(|it| it.strip_prefix("inputs."))
    {
        assert!(inputs.contains_key(&Yaml::String(name.into())), "{name}");
    }
    // Composite steps must name their shell.
    for step in action["runs"]["steps"].as_vec().expect("steps") {
        assert_eq!(step["shell"].as_str(), Some("bash"));
    }
}

/// A runner's folders and files.
struct Runner(PathBuf);

impl Runner {
    fn new(name: &str) -> Runner {
        let folder =
            std::env::temp_dir().join(format!("tuff-action-{}-{name}", std::process::id()));
        let runner = Runner(folder);
        fs::create_dir_all(runner.0.join("temp")).expect("a folder can be made");
        // The part of a release's tarball that the step uses.
        runner.write("tuff-0/share/vulkan/icd.d/tuff_icd.json", "{}");
        let program = "#!/bin/sh\n[ \"$*\" = 'env --shell sh' ] || exit 1\nhere=$(cd \"$(dirname \"$0\")/..\" && pwd)\n\
            echo \"export VK_DRIVER_FILES='$here/m.json'\"\n\
            echo \"export VK_ICD_FILENAMES='$here/m.json'\"\n\
            echo \"export LD_LIBRARY_PATH='$here/lib'\"\n";
        runner.write_program("tuff-0/bin/tuff", program);
        let mut tar = Command::new("tar");
        tar.current_dir(&runner.0);
        let packed = tar.args(["czf", "tuff.tar.gz", "tuff-0"]).status();
        assert!(packed.expect("tar starts").success());
        runner
    }

    fn write(&self, path: &str, text: &str) -> PathBuf {
        let path = self.0.join(path);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder can be made");
        fs::write(&path, text).expect("written");
        path
    }

    fn write_program(&self, path: &str, text: &str) {
        let path = self.write(path, text);
        fs::set_permissions(path, PermissionsExt::from_mode(0o755)).expect("made executable");
    }

    fn read(&self, path: &str) -> String {
        fs::read_to_string(self.0.join(path)).unwrap_or_default()
    }

    /// Runs the action's first step.
    fn step(&self, variables: &[(&str, &str)]) -> Output {
        let action = yaml("action.yml");
        let script = action["runs"]["steps"][0]["run"]
            .as_str()
            .expect("a script")
            .to_owned();
        let mut path = std::ffi::OsString::from(self.0.join("programs"));
        path.push(":");
        path.push(std::env::var_os("PATH").unwrap_or_default());
        let mut step = Command::new("bash");
        step.args(["-e", "-c", &script])
            .env("PATH", path)
            .env_remove("LD_LIBRARY_PATH");
        step.env("GITHUB_ACTION_PATH", root())
            .env("RUNNER_TEMP", self.0.join("temp"));
        for name in ["GITHUB_ENV", "GITHUB_PATH", "GITHUB_OUTPUT"] {
            step.env(name, self.0.join(name));
        }
        step.envs(variables.iter().copied())
            .output()
            .expect("bash starts")
    }
}

impl Drop for Runner {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[track_caller]
fn expect_error(output: &Output, expected: &str) {
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(
        !output.status.success() && said.contains("::error title=Tuff::"),
        "{output:?}"
    );
    assert!(said.contains(expected), "{said}");
}

#[test]
fn a_path_is_taken() {
    let runner = Runner::new("path");
    let tarball = runner.0.join("tuff.tar.gz");
    let output = runner.step(&[("FROM", tarball.to_str().expect("UTF-8"))]);
    assert!(output.status.success(), "{output:?}");
    let prefix = runner.0.join("temp/tuff").display().to_string();
    let expected = format!(
        "VK_DRIVER_FILES={prefix}/m.json\nVK_ICD_FILENAMES={prefix}/m.json\nLD_LIBRARY_PATH={prefix}/lib\n"
    );
    assert_eq!(runner.read("GITHUB_ENV"), expected);
    assert_eq!(runner.read("GITHUB_PATH"), format!("{prefix}/bin\n"));
    let manifest = format!("manifest={prefix}/share/vulkan/icd.d/tuff_icd.json\n");
    assert_eq!(runner.read("GITHUB_OUTPUT"), manifest);
    let folder = runner.0.join("tuff-0");
    let output = runner.step(&[("FROM", folder.to_str().expect("UTF-8"))]);
    assert!(output.status.success(), "{output:?}");
    assert!(runner.read("GITHUB_PATH").ends_with("tuff-0/bin\n"));
    expect_error(
        &runner.step(&[("FROM", "/no/such.tar.gz")]),
        "there is no /no/such.tar.gz",
    );
    expect_error(&runner.step(&[("FROM", "/")]), "is no folder of Tuff");
    expect_error(&runner.step(&[]), "give a version or a path");
}

#[test]
fn releases_are_fetched_and_checked() {
    let runner = Runner::new("release");
    // Replaces the network: copies from a folder, and fails for missing files like `curl --fail`.
    let curl = "#!/bin/bash\nwhile [ $# -gt 1 ]; do [ \"$1\" = --output ] && out=$2; shift; done\n\
        cp \"${1#http://here}\" \"$out\" 2>/dev/null || exit 22\n";
    runner.write_program("programs/curl", curl);
    let name = format!("tuff-vulkan-0.1.0-linux-{}.tar.gz", std::env::consts::ARCH);
    let release = runner.0.join("releases/v0.1.0");
    fs::create_dir_all(&release).expect("a folder can be made");
    fs::copy(runner.0.join("tuff.tar.gz"), release.join(&name)).expect("copied");
    let mut sum = Command::new("sha256sum");
    let sum = sum
        .arg(&name)
        .current_dir(&release)
        .output()
        .expect("sha256sum")
        .stdout;
    let sum = String::from_utf8(sum).expect("text");
    runner.write("releases/v0.1.0/SHA256SUMS", &sum);
    let releases = format!("http://here{}", runner.0.join("releases").display());
    let good = [("VERSION", "0.1.0"), ("RELEASES", releases.as_str())];
    let output = runner.step(&good);
    assert!(output.status.success(), "{output:?}");
    let own = [
        good[0],
        good[1],
        ("SHA256", sum.split(' ').next().expect("a sum")),
    ];
    assert!(runner.step(&own).status.success());
    let wrong = "0".repeat(64);
    expect_error(
        &runner.step(&[good[0], good[1], ("SHA256", &wrong)]),
        "is not what its sum says",
    );
    runner.write("releases/v0.1.0/SHA256SUMS", "");
    expect_error(&runner.step(&good), "is not what its sum says");
    expect_error(
        &runner.step(&[("VERSION", "9"), good[1]]),
        "could not be downloaded",
    );
}

/// On Windows the shell is Git's, the runner's folders have Windows' separators, and the driver is
/// registered.
#[test]
fn runners_of_windows_get_a_registered_driver() {
    let runner = Runner::new("windows");
    runner.write_program(
        "programs/uname",
        "#!/bin/sh\n[ \"$1\" = -m ] && echo x86_64 || echo MINGW64_NT-10.0-26100\n",
    );
    // Windows' form of a path starts with a drive letter.
    let cygpath = "#!/bin/sh\n[ \"$1\" = --windows ] && echo \"D:$2\" || echo \"${2#D:}\"\n";
    runner.write_program("programs/cygpath", cygpath);
    // The zip's only folder, unpacked; the archive itself is not needed.
    let unzip = format!(
        "#!/bin/sh\ncp -r '{}' \"$4\"/\n",
        runner.0.join("tuff-1").display()
    );
    runner.write_program("programs/unzip", &unzip);
    runner.write("tuff-1/share/vulkan/icd.d/tuff_icd.json", "{}");
    let program = "#!/bin/sh\ncase $* in\n'env --shell sh')\n\
        echo \"export VK_DRIVER_FILES='D:\\\\m.json'\"\n\
        echo \"export VK_ICD_FILENAMES='D:\\\\m.json'\"\n\
        echo 'export PATH=\"$PATH:/loader\"' ;;\n\
        install) echo registered for all users ;;\n\
        *) exit 1 ;;\nesac\n";
    runner.write_program("tuff-1/bin/tuff.exe", program);
    runner.write("tuff.zip", "");
    let zip = runner.0.join("tuff.zip");
    let temp = format!("D:{}", runner.0.join("temp").display());
    let variables = [
        ("FROM", zip.to_str().expect("UTF-8")),
        ("RUNNER_TEMP", &temp),
    ];
    let output = runner.step(&variables);
    assert!(output.status.success(), "{output:?}");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("registered for all users"), "{said}");
    let expected = "VK_DRIVER_FILES=D:\\m.json\nVK_ICD_FILENAMES=D:\\m.json\n";
    assert_eq!(runner.read("GITHUB_ENV"), expected);
    let prefix = format!("D:{}/temp/tuff/tuff-1", runner.0.display());
    let expected = format!("{prefix}/lib/tuff/loader\n{prefix}/bin\n");
    assert_eq!(runner.read("GITHUB_PATH"), expected);
    let expected = format!("manifest={prefix}/share/vulkan/icd.d/tuff_icd.json\n");
    assert_eq!(runner.read("GITHUB_OUTPUT"), expected);
}
