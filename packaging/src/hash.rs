//! SHA-256 sums: of packages, and of the files in a wheel.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use sha2::{Digest, Sha256};

/// The sum of bytes, in binary.
pub fn sha256(bytes: &[u8]) -> Vec<u8> {
    Sha256::digest(bytes).to_vec()
}

pub fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Base64 for URLs without padding (RFC 4648, section 5), the form in wheels.
pub fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";
    let digits = |chunk: &[u8]| {
        let bits = (0..3).fold(0u32, |bits, i| {
            bits << 8 | u32::from(*chunk.get(i).unwrap_or(&0))
        });
        let all: [char; 4] =
            std::array::from_fn(|i| ALPHABET[(bits >> (18 - 6 * i)) as usize & 63].into());
        all.into_iter().take(chunk.len() + 1).collect::<String>()
    };
    bytes.chunks(3).map(digits).collect()
}

/// Writes `SHA256SUMS`, which `sha256sum --check` reads. Earlier entries for packages of another
/// architecture stay while those packages exist.
///
/// # Errors
/// A file cannot be read or written.
pub fn write_sums(packages: &[PathBuf], out: &Path) -> Result<PathBuf> {
    let sums = out.join("SHA256SUMS");
    let mut by_name = BTreeMap::new();
    let before = std::fs::read_to_string(&sums).unwrap_or_default();
    for (sum, name) in before.lines().filter_map(|line| line.split_once("  ")) {
        if out.join(name).is_file() {
            by_name.insert(name.to_owned(), sum.to_owned());
        }
    }
    for package in packages {
        let bytes =
            std::fs::read(package).with_context(|| format!("reading {}", package.display()))?;
        let name = package.file_name().context("a package has a name")?;
        by_name.insert(name.display().to_string(), hexadecimal(&sha256(&bytes)));
    }
    let lines = by_name.iter().map(|(name, sum)| format!("{sum}  {name}\n"));
    std::fs::write(&sums, lines.collect::<String>())
        .with_context(|| format!("writing {}", sums.display()))?;
    Ok(sums)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_the_standards() {
        // FIPS 180-2, appendix B.1.
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(hexadecimal(&sha256(b"abc")), expected);
        // RFC 4648, section 10, without the padding.
        let cases = [
            ("", ""),
            ("f", "Zg"),
            ("fo", "Zm8"),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg"),
            ("fooba", "Zm9vYmE"),
        ];
        for (text, expected) in cases {
            assert_eq!(base64(text.as_bytes()), expected);
        }
        assert_eq!(base64(&[0xfb, 0xff]), "-_8");
    }
    #[test]
    fn packages_that_lie_there_keep_their_sums() {
        let out = std::env::temp_dir().join(format!("tuff-sums-{}", std::process::id()));
        std::fs::create_dir_all(&out).unwrap();
        let write = |name: &str, text: &str| {
            let file = out.join(name);
            std::fs::write(&file, text).unwrap();
            file
        };
        let names = |sums: &Path| -> Vec<String> {
            let text = std::fs::read_to_string(sums).unwrap();
            text.lines()
                .map(|line| line.split_once("  ").unwrap().1.to_owned())
                .collect()
        };
        let [a, b] = [write("a.deb", "abc"), write("b.deb", "abc")];
        write_sums(std::slice::from_ref(&b), &out).unwrap();
        let sums = write_sums(std::slice::from_ref(&a), &out).unwrap();
        assert_eq!(names(&sums), ["a.deb", "b.deb"]);
        std::fs::remove_file(b).unwrap();
        write("a.deb", "another");
        write_sums(std::slice::from_ref(&a), &out).unwrap();
        let text = std::fs::read_to_string(&sums).unwrap();
        assert_eq!(
            text,
            format!("{}  a.deb\n", hexadecimal(&sha256(b"another")))
        );
        std::fs::remove_dir_all(&out).unwrap();
    }
}
