//! An instruction's message: its format and the types of its arguments, which the IR stores as
//! words in a table.

use crate::types::Type;

/// An argument of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Argument {
    /// The component type; `None` for values other than numbers and vectors of numbers, which have
    /// no words.
    pub ty: Option<Type>,
    /// 1 for a scalar.
    pub components: u32,
}

impl Argument {
    /// Number of words of the argument.
    pub fn words(self) -> usize {
        let rows = self.ty.map_or(0, |ty| ty.rows() as usize);
        rows * self.components as usize
    }
}

/// The message of an instruction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// `None` if the module has no constant string.
    pub format: Option<String>,
    pub arguments: Vec<Argument>,
}

/// Largest number of components of an argument: SPIR-V's longest vectors have 16.
const MAX_COMPONENTS: u32 = 16;

impl Message {
    /// Number of words of all arguments.
    pub fn words(&self) -> usize {
        self.arguments.iter().map(|argument| argument.words()).sum()
    }

    /// The table: the format's length in bytes plus 1, or 0; its bytes, four a word; then a word
    /// for each argument, components in the high half and, in the low one, the place of
    /// its type in [`Type::NUMBERS`] plus 1, or 0.
    pub fn to_table(&self) -> Vec<u32> {
        let mut table = vec![0];
        if let Some(format) = &self.format {
            table[0] = format.len() as u32 + 1;
            table.extend(format.as_bytes().chunks(4).map(|bytes| {
                let mut word = [0; 4];
                word[..bytes.len()].copy_from_slice(bytes);
                u32::from_le_bytes(word)
            }));
        }
        table.extend(self.arguments.iter().map(|argument| {
            let number = |ty| Type::NUMBERS.iter().position(|&other| other == ty);
            let number = argument.ty.and_then(number).map_or(0, |at| at as u32 + 1);
            argument.components << 16 | number
        }));
        table
    }

    /// Decodes a table; `None` for other words.
    pub fn from_table(table: &[u32]) -> Option<Message> {
        let (&size, rest) = table.split_first()?;
        let bytes = size.saturating_sub(1) as usize;
        let (text, arguments) = rest.split_at_checked(bytes.div_ceil(4))?;
        let text: Vec<u8> = text.iter().flat_map(|word| word.to_le_bytes()).collect();
        let format = match size {
            0 => None,
            _ => Some(std::str::from_utf8(&text[..bytes]).ok()?.to_owned()),
        };
        let argument = |&word: &u32| {
            let components = word >> 16;
            let ty = match word & 0xffff {
                0 => None,
                number => Some(*Type::NUMBERS.get(number as usize - 1)?),
            };
            (components <= MAX_COMPONENTS).then_some(Argument { ty, components })
        };
        let arguments = arguments.iter().map(argument).collect::<Option<_>>()?;
        Some(Message { format, arguments })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_hold_messages_and_other_words_are_refused() {
        let argument = |ty, components| Argument { ty, components };
        let message = Message {
            format: Some("n = %d".into()),
            arguments: vec![
                argument(Some(Type::I64), 1),
                argument(None, 1),
                argument(Some(Type::F16), 4),
            ],
        };
        assert_eq!(message.words(), 6);
        let table = message.to_table();
        assert_eq!(Message::from_table(&table), Some(message));
        let nameless = Message {
            format: None,
            arguments: Vec::new(),
        };
        assert_eq!(Message::from_table(&nameless.to_table()), Some(nameless));
        // No words, a cut string, bytes that are no text, an unknown type, too long a vector.
        for words in [
            &[][..],
            &[9, 0],
            &[2, 0xFF],
            &[0, 1 << 16 | 9],
            &[0, 17 << 16 | 4],
        ] {
            assert_eq!(Message::from_table(words), None, "{words:x?}");
        }
    }
}
