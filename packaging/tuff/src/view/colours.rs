//! Colours of numbers: viridis. Its order is visible with any colour vision, and in greys.

/// Polynomials that approximate viridis (Nathaniel Smith, Stéfan van der Walt) within 2 of 255,
/// fitted by Matt Zucker; public domain. The page uses the same ones.
const VIRIDIS: [[f64; 3]; 7] = [
    [0.277_727_327_2, 0.005_407_344_5, 0.334_099_805_3],
    [0.105_093_043_1, 1.404_613_529_9, 1.384_590_162_6],
    [-0.330_861_828_7, 0.214_847_559_5, 0.095_095_163_0],
    [-4.634_230_499_0, -5.799_100_973_4, -19.332_440_956_3],
    [6.228_269_936_3, 14.179_933_366_8, 56.690_552_600_7],
    [4.776_384_997_7, -13.745_145_377_7, -65.353_032_633_4],
    [-5.435_455_855_9, 4.645_852_612_2, 26.312_435_249_6],
];

/// The colour of a number in [0, 1], in sRGB.
pub fn viridis(number: f64) -> [u8; 3] {
    let x = number.clamp(0.0, 1.0);
    [0, 1, 2].map(|channel: usize| {
        let value = VIRIDIS
            .iter()
            .rev()
            .fold(0.0, |sum, row| sum * x + row[channel]);
        (value.clamp(0.0, 1.0) * 255.0).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The colours match entries of Matplotlib's table.
    #[test]
    fn colours_are_those_of_the_table() {
        for (number, expected) in [
            (0.0, [68, 1, 84]),
            (0.25, [59, 82, 139]),
            (0.5, [33, 145, 140]),
            (0.75, [94, 201, 98]),
            (1.0, [253, 231, 37]),
        ] {
            let colour = viridis(number);
            for channel in 0..3 {
                let off = colour[channel].abs_diff(expected[channel]);
                assert!(off <= 4, "{number}: {colour:?}, not {expected:?}");
            }
        }
    }

    #[test]
    fn larger_numbers_are_lighter() {
        let light = |number: f64| {
            let linear = viridis(number).map(|value| (f64::from(value) / 255.0).powf(2.2));
            0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
        };
        for step in 1..=64 {
            let (before, after) = (
                light(f64::from(step - 1) / 64.0),
                light(f64::from(step) / 64.0),
            );
            assert!(after > before, "{step}");
        }
    }
}
