//! Lines for shells to evaluate: the syntax of each for quoting, setting and removing variables.

use std::ffi::OsStr;
use std::fmt::Write;

use clap::ValueEnum;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Shell {
    /// bash, dash and other descendants of the Bourne shell
    Sh,
    /// PowerShell
    Powershell,
    /// Windows' cmd
    Cmd,
}

impl Shell {
    /// The usual shell of this system.
    pub const HERE: Shell = match cfg!(windows) {
        true => Shell::Powershell,
        false => Shell::Sh,
    };

    /// The line that sets a variable.
    pub fn set(self, name: &str, value: &OsStr) -> String {
        let text = value.display().to_string();
        match self {
            Shell::Sh => format!("export {name}='{}'", text.replace('\'', r"'\''")),
            Shell::Powershell => format!("$env:{name} = {}", powershell_expression(&text)),
            // Windows' paths contain no quotation marks. `for /f` does not expand variables in its
            // lines.
            Shell::Cmd => format!("set \"{name}={text}\""),
        }
    }

    /// The line that removes a variable, even if it is not set.
    pub fn unset(self, name: &str) -> String {
        match self {
            Shell::Sh => format!("unset {name}"),
            Shell::Powershell => {
                format!("Remove-Item Env:{name} -ErrorAction SilentlyContinue")
            }
            Shell::Cmd => format!("set \"{name}=\""),
        }
    }

    /// The line with which the shell evaluates the output of `tuff env`.
    pub fn evaluation(self) -> &'static str {
        match self {
            Shell::Sh => "eval \"$(tuff env)\"",
            Shell::Powershell => "tuff env | Out-String | Invoke-Expression",
            Shell::Cmd => "for /f \"delims=\" %i in ('tuff env --shell cmd') do @%i",
        }
    }
}

/// A text in ASCII, because the code page of the pipe to PowerShell is unknown: other characters
/// are written as their numbers.
fn powershell_expression(text: &str) -> String {
    let mut expression = String::from("'");
    let mut is_open = true;
    for unit in text.encode_utf16() {
        let plain = u8::try_from(unit)
            .ok()
            .filter(|byte| (b' '..=b'~').contains(byte));
        if plain.is_some() != is_open {
            expression += if is_open { "'" } else { " + '" };
            is_open = !is_open;
        }
        match plain {
            Some(b'\'') => expression += "''",
            Some(byte) => expression.push(byte.into()),
            None => {
                let _ = write!(expression, " + [char]0x{unit:04x}");
            }
        }
    }
    if is_open {
        expression.push('\'');
    }
    expression
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(shell: Shell, value: &str) -> String {
        shell.set("NAME", OsStr::new(value))
    }

    #[test]
    fn values_are_quoted() {
        assert_eq!(set(Shell::Sh, "/it's"), r"export NAME='/it'\''s'");
        assert_eq!(
            set(Shell::Powershell, r"C:\it's $x"),
            r"$env:NAME = 'C:\it''s $x'"
        );
        assert_eq!(set(Shell::Cmd, r"C:\a b & c"), r#"set "NAME=C:\a b & c""#);
    }

    #[test]
    fn powershell_gets_letters_by_their_numbers() {
        assert_eq!(
            set(Shell::Powershell, r"C:\Jürgen\ż"),
            r"$env:NAME = 'C:\J' + [char]0x00fc + 'rgen\' + [char]0x017c"
        );
        // Characters outside the first plane are surrogate pairs. A first character follows an
        // empty text.
        assert_eq!(
            set(Shell::Powershell, "🌋"),
            "$env:NAME = '' + [char]0xd83c + [char]0xdf0b"
        );
        // PowerShell treats curved quotation marks as straight ones.
        assert!(set(Shell::Powershell, "a’b").is_ascii());
        assert_eq!(set(Shell::Powershell, ""), "$env:NAME = ''");
    }

    #[test]
    fn variables_are_removed() {
        assert_eq!(Shell::Sh.unset("A"), "unset A");
        assert_eq!(Shell::Cmd.unset("A"), "set \"A=\"");
        assert!(
            Shell::Powershell
                .unset("A")
                .starts_with("Remove-Item Env:A ")
        );
    }
}
