//! SHA-256 sums: of packages, and of the files in a wheel.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use sha2::{Digest, Sha256};

/// Of the bytes, in binary.
pub fn sha256(bytes: &[u8]) -> Vec<u8> {
    Sha256::digest(bytes).to_vec()
}

pub fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Base64 for URLs without padding (RFC 4648, section 5), as wheels have it.
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

/// Writes `SHA256SUMS`, which `sha256sum --check` reads.
///
/// # Errors
/// A file cannot be read or written.
pub fn write_sums(packages: &[PathBuf], out: &Path) -> Result<PathBuf> {
    let mut text = String::new();
    for package in packages {
        let bytes =
            std::fs::read(package).with_context(|| format!("reading {}", package.display()))?;
        let name = package
            .file_name()
            .context("a package has a name")?
            .display();
        text += &format!("{}  {name}\n", hexadecimal(&sha256(&bytes)));
    }
    let sums = out.join("SHA256SUMS");
    std::fs::write(&sums, text).with_context(|| format!("writing {}", sums.display()))?;
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
}
