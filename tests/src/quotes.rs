//! Output that docs/debugging.md quotes, for the tests that produce it.

const PAGE: &str = include_str!("../../docs/debugging.md");

/// Quoted lines of a section that an output lacks. Quotes are indented by more than commands are;
/// `…` in a quote is for anything.
pub fn missing_quotes(section: &str, output: &str) -> Vec<&'static str> {
    let (_, rest) = PAGE
        .split_once(&format!("\n### {section}\n"))
        .expect("a section of the page");
    let lines = rest.lines().take_while(|line| !line.starts_with('#'));
    let quotes: Vec<&str> = lines.filter(|line| line.starts_with("      ")).collect();
    assert!(!quotes.is_empty(), "{section} quotes nothing");
    let is_missing = |quote: &&str| {
        let mut lines = output.lines();
        !lines.any(|line| has_parts(line.trim(), quote.trim()))
    };
    quotes.into_iter().filter(is_missing).collect()
}

fn has_parts(line: &str, quote: &str) -> bool {
    let mut parts = quote.split('…');
    let first = parts.next().unwrap_or_default();
    let Some(mut rest) = line.strip_prefix(first) else {
        return false;
    };
    let mut last = first;
    for part in parts {
        let Some((_, after)) = rest.split_once(part) else {
            return false;
        };
        (rest, last) = (after, part);
    }
    rest.is_empty() || last.is_empty()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotes_may_leave_something_out() {
        assert!(has_parts(
            "region at 0x10: 4 records",
            "region at …: 4 records"
        ));
        assert!(!has_parts(
            "region at 0x10: 4 records",
            "region at …: 5 records"
        ));
        assert!(!has_parts(
            "region at 0x10: 4 records, 2",
            "region at …: 4 records"
        ));
        assert!(has_parts("a line", "a line") && !has_parts("a line more", "a line"));
    }
}
