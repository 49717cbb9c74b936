//! Files of numbers in NumPy's format (NEP 1, version 1.0), which `numpy.load` reads.

#![forbid(unsafe_code)]

/// Bytes that the head of a file is a multiple of.
const ALIGNMENT: usize = 64;
/// The magic string, the version and the length of the description.
const PREFIX_BYTES: usize = 10;

/// The type of the numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    One,
    Two,
    Four,
}

impl Width {
    /// The narrowest that has room for a number.
    pub fn of(most: u32) -> Self {
        match most {
            0..=0xFF => Self::One,
            0x100..=0xFFFF => Self::Two,
            _ => Self::Four,
        }
    }

    /// NumPy's name of the type, little endian.
    pub fn name(self) -> &'static str {
        match self {
            Self::One => "|u1",
            Self::Two => "<u2",
            Self::Four => "<u4",
        }
    }

    /// Bytes of a number.
    pub fn size_bytes(self) -> usize {
        match self {
            Self::One => 1,
            Self::Two => 2,
            Self::Four => 4,
        }
    }
}

/// NumPy's name of `f32`.
const FLOAT: &str = "<f4";

/// Makes a file of numbers, the last dimension fastest, none of which is too large for the width.
/// It takes the place of what is in `bytes`.
pub fn file(bytes: &mut Vec<u8>, shape: [u32; 3], width: Width, numbers: &[u32]) {
    let [depth, height, row] = shape;
    let shape = format!("{depth}, {height}, {row}");
    let size_bytes = numbers.len() * width.size_bytes();
    head(bytes, width.name(), &shape, size_bytes);
    match width {
        Width::One => bytes.extend(numbers.iter().map(|&number| number as u8)),
        Width::Two => extend(bytes, numbers, |&number| (number as u16).to_le_bytes()),
        Width::Four => extend(bytes, numbers, |number| number.to_le_bytes()),
    }
}

/// Adds numbers of `N` bytes each. Into room that is there, which takes a fraction of the time of
/// an iterator over single bytes.
fn extend<T, const N: usize>(bytes: &mut Vec<u8>, numbers: &[T], write: impl Fn(&T) -> [u8; N]) {
    let start = bytes.len();
    bytes.resize(start + numbers.len() * N, 0);
    let (places, _) = bytes[start..].as_chunks_mut::<N>();
    for (place, number) in places.iter_mut().zip(numbers) {
        *place = write(number);
    }
}

/// Makes a file of floats in the place of what is in `bytes`: the shape's last dimension has `N`.
pub fn floats<const N: usize>(bytes: &mut Vec<u8>, shape: &[u32], rows: &[[f32; N]]) {
    let shape: String = shape.iter().map(|size| format!("{size}, ")).collect();
    head(bytes, FLOAT, &format!("{shape}{N}"), rows.len() * N * 4);
    extend(bytes, rows.as_flattened(), |number| number.to_le_bytes());
}

/// Begins a file anew: its head, and room for so many bytes of numbers.
fn head(bytes: &mut Vec<u8>, descr: &str, shape: &str, size_bytes: usize) {
    let mut head = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({shape}), }}");
    // Spaces up to the newline.
    let end = (PREFIX_BYTES + head.len() + 1).next_multiple_of(ALIGNMENT);
    while PREFIX_BYTES + head.len() + 1 < end {
        head.push(' ');
    }
    head.push('\n');
    bytes.clear();
    bytes.reserve(end + size_bytes);
    bytes.extend(b"\x93NUMPY\x01\x00");
    // The description is shorter than 200 bytes.
    bytes.extend((head.len() as u16).to_le_bytes());
    bytes.extend(head.as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As NEP 1 describes the format.
    #[test]
    fn files_are_what_the_format_says() {
        for (most, width) in [(7, 1), (0x1234, 2), (0x0001_0203, 4)] {
            let numbers = [0, 1, 2, 3, 4, most];
            let mut bytes = vec![7; 3];
            file(&mut bytes, [1, 2, 3], Width::of(most), &numbers);
            let file = bytes;
            assert_eq!(&file[..8], b"\x93NUMPY\x01\x00");
            let length = usize::from(u16::from_le_bytes([file[8], file[9]]));
            assert_eq!((PREFIX_BYTES + length) % ALIGNMENT, 0);
            let head = std::str::from_utf8(&file[10..10 + length]).expect("it is ASCII");
            assert!(head.is_ascii() && head.ends_with('\n'), "{head:?}");
            assert!(head.contains("'shape': (1, 2, 3), "), "{head}");
            assert!(head.contains("'fortran_order': False"), "{head}");
            assert!(head.contains(&format!("u{width}'")), "{head}");
            let data = &file[10 + length..];
            assert_eq!(data.len(), 6 * width);
            let read = data.chunks(width).map(|bytes| {
                let number =
                    |number, (place, byte): (usize, &u8)| number | u32::from(*byte) << (8 * place);
                bytes.iter().enumerate().fold(0, number)
            });
            assert_eq!(read.collect::<Vec<u32>>(), numbers);
        }
        let mut file = Vec::new();
        floats(
            &mut file,
            &[2],
            &[[1.5, -2.0, 3.0], [0.25, 0.0, f32::INFINITY]],
        );
        let length = usize::from(u16::from_le_bytes([file[8], file[9]]));
        let head = std::str::from_utf8(&file[10..10 + length]).expect("it is ASCII");
        assert!(head.contains("'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), "));
        let numbers = file[10 + length..].chunks(4);
        let numbers = numbers.map(|it| f32::from_le_bytes(it.try_into().expect("four bytes")));
        assert!(numbers.eq([1.5, -2.0, 3.0, 0.25, 0.0, f32::INFINITY]));
    }
}
