//! The page: one file with a whole capture. It needs no network.

use std::io::Write;
use std::path::Path;

use anyhow::Result;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use serde_json::{Map, Value, json};

use super::capture::{Capture, MapCommand};

const PAGE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
/// The first defines what the second uses.
const SCRIPT: &str = concat!(include_str!("space.js"), "\n", include_str!("page.js"));

/// The page of the capture in a folder.
///
/// # Errors
/// Out of memory.
pub fn of(capture: &Capture, folder: &Path) -> Result<String> {
    let commands = capture.commands.iter().map(command);
    let floats = capture.floats.iter().map(|(name, bytes)| {
        let file = json!({ "length": bytes.len() / 4, "data": packed(bytes, 4)? });
        Ok((name.clone(), file))
    });
    let floats: Map<String, Value> = floats.collect::<Result<_>>()?;
    let data = json!({
        "program": capture.program,
        "folder": folder.to_string_lossy(),
        "dropped": capture.dropped,
        "commands": commands.collect::<Result<Vec<_>>>()?,
        "paths": capture.paths,
        "floats": floats,
    });
    Ok(filled(&data))
}

/// The page with its data, in which `</` is escaped: it would end the script.
fn filled(data: &Value) -> String {
    let data = data.to_string().replace("</", "<\\/");
    let parts = [
        ("/*STYLE*/", STYLE),
        ("/*DATA*/", &data),
        ("/*SCRIPT*/", SCRIPT),
    ];
    let (mut page, mut rest) = (String::new(), PAGE);
    for (name, text) in parts {
        let (before, after) = rest.split_once(name).unwrap_or((rest, ""));
        page.push_str(before);
        page.push_str(text);
        rest = after;
    }
    page + rest
}

fn command(command: &MapCommand) -> Result<Value> {
    let mut entry = command.entry.clone();
    let maps = command.maps.iter().map(|map| {
        Ok(json!({
            "name": map.name,
            "of": map.of,
            "width": map.width,
            "data": if map.bytes.is_empty() { Value::Null } else { packed(&map.bytes, map.width)?.into() },
        }))
    });
    entry["maps"] = maps.collect::<Result<Vec<Value>>>()?.into();
    Ok(entry)
}

/// Numbers of so many bytes, the first byte of each, then the second, and so on; compressed (RFC
/// 1950), as text.
fn packed(bytes: &[u8], width: usize) -> Result<String> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    for byte in 0..width {
        let plane = bytes.iter().skip(byte).step_by(width);
        encoder.write_all(&plane.copied().collect::<Vec<u8>>())?;
    }
    Ok(base64(&encoder.finish()?))
}

/// RFC 4648.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let byte = |index: usize| u32::from(three.get(index).copied().unwrap_or(0));
        let word = byte(0) << 16 | byte(1) << 8 | byte(2);
        for letter in 0..4 {
            let index = (word >> (18 - 6 * letter) & 63) as usize;
            text.push(match letter <= three.len() {
                true => char::from(LETTERS[index]),
                false => '=',
            });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// RFC 4648, 10.
    #[test]
    fn text_of_bytes() {
        for (bytes, text) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
    }

    #[test]
    fn a_page_needs_nothing_else() {
        let page = filled(&json!({ "pipeline": "</script>" }));
        assert!(!page.contains("/*"), "a part is missing");
        assert_eq!(page.matches("</script>").count(), 2);
        for word in [
            "http:", "https:", "src=", "href=", "import ", "@import", "url(",
        ] {
            assert!(!page.contains(word), "{word}");
        }
    }
}
