//! The Debian package: the tree below `/usr`, in the format of deb(5).

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use crate::symbols::GlibcVersion;
use crate::tarball::packed;
use crate::tree::{Entry, Tree};
use crate::{PackageSystem, Release};

/// Writes `tuff-vulkan_VERSION_ARCHITECTURE.deb`.
///
/// # Errors
/// The file cannot be written, or the binaries are for another system.
pub fn write(tree: &Tree, release: &Release, out: &Path) -> Result<PathBuf> {
    let PackageSystem::Linux {
        glibc,
        needs_libgcc,
    } = release.system
    else {
        bail!("Debian packages are of Linux");
    };
    let architecture = match release.architecture.as_str() {
        "x86_64" => "amd64",
        "aarch64" => "arm64",
        other => other,
    };
    let mut installed = tree.below("usr");
    // Debian Policy 12.5: a package's file `copyright` has its licences.
    let copyright: String = (tree.files())
        .filter(|(path, _)| path.starts_with("share/doc/"))
        .map(|(path, entry)| {
            let name = path.rsplit('/').next().unwrap_or(path);
            format!("{name}\n\n{}\n\n", String::from_utf8_lossy(&entry.bytes))
        })
        .collect();
    installed.add(
        "usr/share/doc/tuff-vulkan/copyright",
        Entry::file(copyright.into_bytes()),
    );
    let depends = depends(glibc, needs_libgcc);
    let mut control = Tree::default();
    let text = control_file(&installed, &release.version, architecture, &depends);
    control.add("control", Entry::file(text.into_bytes()));
    let parts = [
        ("debian-binary", b"2.0\n".to_vec()),
        ("control.tar.gz", packed(&control, "./", release.time)?),
        ("data.tar.gz", packed(&installed, "./", release.time)?),
    ];
    let path = out.join(format!(
        "tuff-vulkan_{}_{architecture}.deb",
        release.version
    ));
    let file = std::fs::File::create(&path);
    let mut archive =
        ar::Builder::new(file.with_context(|| format!("writing {}", path.display()))?);
    for (name, bytes) in parts {
        let mut header = ar::Header::new(name.as_bytes().to_vec(), bytes.len() as u64);
        header.set_mtime(release.time);
        header.set_mode(0o100_644);
        archive
            .append(&header, &bytes[..])
            .context("writing the package")?;
    }
    Ok(path)
}

/// The packages that the binaries need.
fn depends(glibc: GlibcVersion, needs_libgcc: bool) -> String {
    let mut depends = format!("libc6 (>= {glibc})");
    if needs_libgcc {
        depends += ", libgcc-s1";
    }
    depends
}

/// The control fields (Debian Policy 5.3).
fn control_file(installed: &Tree, version: &str, architecture: &str, depends: &str) -> String {
    let kilobytes: usize = installed
        .files()
        .map(|(_, it)| it.bytes.len().div_ceil(1024))
        .sum();
    let mut text = String::new();
    let fields = [
        ("Package", "tuff-vulkan".into()),
        ("Version", version.into()),
        ("Architecture", architecture.into()),
        (
            "Maintainer",
            "The Tuff maintainers <tuff@project.invalid>".into(),
        ),
        ("Installed-Size", kilobytes.to_string()),
        ("Depends", depends.into()),
        ("Recommends", "libvulkan1".into()),
        ("Provides", "vulkan-icd".into()),
        ("Section", "libs".into()),
        ("Priority", "optional".into()),
        ("Description", DESCRIPTION.into()),
    ];
    for (name, value) in fields {
        let _ = writeln!(text, "{name}: {value}");
    }
    text
}

const DESCRIPTION: &str = "Vulkan driver that traces rays on the CPU
 Programs that use VK_KHR_ray_tracing_pipeline or ray queries run without a
 graphics card. The Vulkan loader finds the driver like any other; the
 command tuff runs one program on it, and tells what is wrong where something
 is.";
