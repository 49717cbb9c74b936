//! Formats a message: the conversions of C's `printf` in `debug_printf.md` of the Vulkan validation
//! layers, also for vectors. The text reports mistakes in a format.
//!
//! A conversion that does not match its argument's type prints the argument by its type.

use std::fmt::Write;
use std::iter::Peekable;
use std::str::Chars;

use half::f16;

use super::{Argument, Message};
use crate::types::Type;

/// Largest width and precision, so that a format cannot exhaust memory.
const MAX_WIDTH: usize = 256;

/// A conversion: `%[flags][width][.precision][v2|v3|v4][l]conversion`.
#[derive(Clone, Debug, Default)]
struct Conversion {
    /// The source text, from the percent sign.
    text: String,
    left: bool,
    plus: bool,
    space: bool,
    alternate: bool,
    zeros: bool,
    width: usize,
    precision: Option<usize>,
    components: Option<u32>,
    letter: char,
}

/// A number from an invocation.
#[derive(Clone, Copy)]
struct Number {
    bits: u64,
    ty: Type,
}

impl Message {
    /// The text for an invocation's words.
    pub fn text(&self, words: &[u32]) -> String {
        let Some(format) = &self.format else {
            return "<the format is not an OpString>".into();
        };
        let mut text = String::new();
        let mut values = Values {
            arguments: self.arguments.iter(),
            words,
        };
        let mut chars = format.chars().peekable();
        while let Some(next) = chars.next() {
            if next != '%' {
                text.push(next);
            } else if chars.next_if_eq(&'%').is_some() {
                text.push('%');
            } else {
                let mut conversion = Conversion::parse(&mut chars);
                conversion.print(&mut chars, &mut values, &mut text);
            }
        }
        match values.arguments.len() {
            0 => {}
            1 => text.push_str(" <1 argument has no conversion>"),
            count => {
                let _ = write!(text, " <{count} arguments have no conversion>");
            }
        }
        text
    }
}

/// The remaining arguments.
struct Values<'a> {
    arguments: std::slice::Iter<'a, Argument>,
    words: &'a [u32],
}

impl Values<'_> {
    /// The components of the next argument; `None` at the end.
    fn next(&mut self) -> Option<(Argument, Vec<Number>)> {
        let argument = *self.arguments.next()?;
        let (words, rest) = self.words.split_at_checked(argument.words())?;
        self.words = rest;
        let Some(ty) = argument.ty else {
            return Some((argument, Vec::new()));
        };
        let numbers = words.chunks(ty.rows() as usize).map(|words| {
            let high = words.get(1).copied().unwrap_or(0);
            Number {
                bits: u64::from(words[0]) | u64::from(high) << 32,
                ty,
            }
        });
        Some((argument, numbers.collect()))
    }
}

impl Conversion {
    /// The conversion after a percent sign, up to its letter, which is `\0` if the format ends
    /// first.
    fn parse(chars: &mut Peekable<Chars<'_>>) -> Self {
        let mut it = Self {
            text: "%".into(),
            ..Self::default()
        };
        while let Some(flag) = chars.next_if(|&c| "-+ #0".contains(c)) {
            it.text.push(flag);
            match flag {
                '-' => it.left = true,
                '+' => it.plus = true,
                ' ' => it.space = true,
                '#' => it.alternate = true,
                _ => it.zeros = true,
            }
        }
        it.width = it.number(chars).unwrap_or(0);
        if let Some(point) = chars.next_if_eq(&'.') {
            it.text.push(point);
            it.precision = Some(it.number(chars).unwrap_or(0));
        }
        if let Some(vector) = chars.next_if_eq(&'v') {
            it.text.push(vector);
            if let Some(count) = chars.next_if(|&c| matches!(c, '2'..='4')) {
                it.text.push(count);
                it.components = count.to_digit(10);
            }
        }
        // Length modifiers are ignored, since arguments have types.
        while let Some(length) = chars.next_if(|&c| matches!(c, 'l' | 'h')) {
            it.text.push(length);
        }
        if let Some(letter) = chars.next() {
            it.text.push(letter);
            it.letter = letter;
        }
        it
    }

    fn number(&mut self, chars: &mut Peekable<Chars<'_>>) -> Option<usize> {
        let mut number = None;
        while let Some(digit) = chars.next_if(char::is_ascii_digit) {
            self.text.push(digit);
            let digit = digit as usize - '0' as usize;
            number = Some((number.unwrap_or(0) * 10 + digit).min(MAX_WIDTH));
        }
        number
    }

    /// Prints the next argument.
    fn print(&mut self, chars: &mut Peekable<Chars<'_>>, values: &mut Values<'_>, to: &mut String) {
        let known = "diouxXfFeEgGaAp".contains(self.letter);
        let written = std::mem::take(&mut self.text);
        if !known {
            // Its argument has no other conversion.
            if self.letter != '\0' {
                values.next();
            }
            return to.push_str(&format!("<{written} is not supported>"));
        }
        let Some((argument, numbers)) = values.next() else {
            return to.push_str(&format!("<no argument for {written}>"));
        };
        // The layers write 64 bits as `%ul`, too.
        if self.letter == 'u' && argument.ty == Some(Type::I64) {
            chars.next_if_eq(&'l');
        }
        if argument.ty.is_none() {
            return to.push_str(&format!("<the argument for {written} is not a number>"));
        }
        if self.components.unwrap_or(argument.components) != argument.components {
            let count = argument.components;
            let _ = write!(to, "<{written} for {count} component");
            to.push_str(if count == 1 { ">" } else { "s>" });
        }
        for (index, number) in numbers.iter().enumerate() {
            if index > 0 {
                to.push_str(", ");
            }
            self.print_number(*number, to);
        }
    }

    fn print_number(&self, number: Number, to: &mut String) {
        let (sign, prefix, digits) = match self.letter {
            'o' | 'x' | 'X' | 'p' => self.digits_of_bits(number.bits, self.letter),
            _ if number.ty.is_float() => {
                let value = number.float();
                let letter = match self.letter {
                    'd' | 'i' | 'u' => 'f',
                    letter => letter,
                };
                let sign = if value.is_sign_negative() && !value.is_nan() {
                    "-"
                } else {
                    self.positive()
                };
                let (prefix, digits) = self.digits_of_float(value.abs(), letter);
                (sign, prefix, digits)
            }
            'u' => ("", "", self.padded(number.bits.to_string())),
            _ => {
                let value = number.signed();
                let sign = if value < 0 { "-" } else { self.positive() };
                (sign, "", self.padded(value.unsigned_abs().to_string()))
            }
        };
        let used = sign.len() + prefix.len() + digits.len();
        let rest = self.width.saturating_sub(used);
        let is_text = matches!(&*digits, "inf" | "nan" | "INF" | "NAN");
        let integer = !number.ty.is_float() || "oxXp".contains(self.letter);
        let zeros = self.zeros && !is_text && (self.precision.is_none() || !integer);
        match (self.left, zeros) {
            (true, _) => {
                let _ = write!(to, "{sign}{prefix}{digits}{:rest$}", "");
            }
            (false, true) => {
                let _ = write!(to, "{sign}{prefix}{:0>rest$}{digits}", "");
            }
            (false, false) => {
                let _ = write!(to, "{:rest$}{sign}{prefix}{digits}", "");
            }
        }
    }

    fn positive(&self) -> &'static str {
        match (self.plus, self.space) {
            (true, _) => "+",
            (false, true) => " ",
            _ => "",
        }
    }

    /// Pads to the precision's number of digits.
    fn padded(&self, digits: String) -> String {
        let least = self.precision.unwrap_or(1);
        match digits.as_str() {
            "0" if least == 0 => String::new(),
            _ => format!("{digits:0>least$}"),
        }
    }

    fn digits_of_bits(&self, bits: u64, letter: char) -> (&'static str, &'static str, String) {
        let (prefix, digits) = match letter {
            'o' => ("0", format!("{bits:o}")),
            'X' => ("0X", format!("{bits:X}")),
            _ => ("0x", format!("{bits:x}")),
        };
        let has_prefix = letter == 'p' || self.alternate && bits != 0;
        let prefix = if has_prefix { prefix } else { "" };
        ("", prefix, self.padded(digits))
    }

    /// Digits of a positive number.
    fn digits_of_float(&self, value: f64, letter: char) -> (&'static str, String) {
        if !value.is_finite() {
            let text = if value.is_nan() { "nan" } else { "inf" };
            let upper = letter.is_ascii_uppercase();
            return (
                "",
                if upper {
                    text.to_uppercase()
                } else {
                    text.into()
                },
            );
        }
        let precision = self.precision.unwrap_or(6);
        let point = |digits: String| match self.alternate && !digits.contains('.') {
            true => digits + ".",
            false => digits,
        };
        let (prefix, digits) = match letter.to_ascii_lowercase() {
            'e' => ("", exponential(value, precision, self.alternate)),
            'g' => ("", self.shortest(value, precision.max(1))),
            'a' => ("0x", hexadecimal(value, self.precision, self.alternate)),
            _ => ("", point(format!("{value:.precision$}"))),
        };
        match letter.is_ascii_uppercase() {
            true if prefix.is_empty() => ("", digits.to_uppercase()),
            true => ("0X", digits.to_uppercase()),
            false => (prefix, digits),
        }
    }

    /// `%g`: this many significant digits, in the shorter notation.
    fn shortest(&self, value: f64, digits: usize) -> String {
        let written = exponential(value, digits - 1, false);
        let (mantissa, exponent) = written.split_once('e').unwrap_or((&written, "0"));
        let exponent: i64 = exponent.parse().unwrap_or(0);
        let trim = |text: &str| match text.contains('.') && !self.alternate {
            true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
            false => text.to_owned(),
        };
        if exponent < -4 || exponent >= digits as i64 {
            let sign = if exponent < 0 { '-' } else { '+' };
            return format!("{}e{sign}{:02}", trim(mantissa), exponent.abs());
        }
        let behind = (digits as i64 - 1 - exponent) as usize;
        trim(&format!("{value:.behind$}"))
    }
}

impl Number {
    fn signed(self) -> i64 {
        match self.ty.bits() {
            // True is 1.
            1 => self.bits as i64,
            bits => (self.bits as i64) << (64 - bits) >> (64 - bits),
        }
    }

    fn float(self) -> f64 {
        match self.ty {
            Type::F16 => f16::from_bits(self.bits as u16).to_f64(),
            Type::F32 => f32::from_bits(self.bits as u32).into(),
            _ => f64::from_bits(self.bits),
        }
    }
}

/// `%e`: C has a sign and at least two digits in the exponent.
fn exponential(value: f64, precision: usize, alternate: bool) -> String {
    let text = format!("{value:.precision$e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let point = if alternate && precision == 0 { "." } else { "" };
    let (sign, exponent) = match exponent.strip_prefix('-') {
        Some(exponent) => ('-', exponent),
        None => ('+', exponent),
    };
    format!("{mantissa}{point}e{sign}{exponent:0>2}")
}

/// `%a`, behind `0x`: as glibc writes it, with 1 before the point, or 0 for zero and denormals.
fn hexadecimal(value: f64, precision: Option<usize>, alternate: bool) -> String {
    const DIGITS: usize = 13;
    let bits = value.to_bits();
    let (exponent, fraction) = (bits >> 52 & 0x7ff, bits & ((1 << 52) - 1));
    let power = match (exponent, fraction) {
        (0, 0) => 0,
        (0, _) => -1022,
        (exponent, _) => exponent as i64 - 1023,
    };
    let mut mantissa = fraction | u64::from(exponent != 0) << 52;
    let mut digits = DIGITS;
    if let Some(wanted) = precision.filter(|&wanted| wanted < DIGITS) {
        let dropped = 4 * (DIGITS - wanted);
        let (half, rest) = (1 << (dropped - 1), mantissa & ((1 << dropped) - 1));
        mantissa >>= dropped;
        mantissa += u64::from(rest > half || rest == half && mantissa & 1 == 1);
        digits = wanted;
    }
    let whole = mantissa >> (4 * digits);
    let rest = mantissa & ((1 << (4 * digits)) - 1);
    let mut behind = match digits {
        0 => String::new(),
        _ => format!("{rest:0digits$x}"),
    };
    match precision {
        None => behind.truncate(behind.trim_end_matches('0').len()),
        Some(wanted) => behind.extend(std::iter::repeat_n('0', wanted.saturating_sub(DIGITS))),
    }
    let point = if behind.is_empty() && !alternate {
        ""
    } else {
        "."
    };
    format!("{whole}{point}{behind}p{power:+}")
}

#[cfg(test)]
mod tests;
