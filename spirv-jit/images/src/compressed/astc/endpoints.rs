//! The endpoints of a partition (Khronos Data Format specification, "LDR Endpoint Decoding").
#![forbid(unsafe_code)]

/// Two colours of 8 bits a component.
pub(super) type Endpoints = [[u8; 4]; 2];

fn clamped(color: [i32; 4]) -> [u8; 4] {
    color.map(|value| value.clamp(0, 255) as u8)
}

fn blue_contract([r, g, b, a]: [i32; 4]) -> [i32; 4] {
    [(r + b) >> 1, (g + b) >> 1, b, a]
}

/// A base of 8 bits and an offset of 6 with a sign, from values that hold the base's bits apart.
fn base_and_offset(base: i32, offset: i32) -> (i32, i32) {
    let base = base >> 1 | offset & 0x80;
    let offset = offset >> 1 & 0x3f;
    (
        base,
        if offset & 0x20 != 0 {
            offset - 0x40
        } else {
            offset
        },
    )
}

/// The endpoints of a mode from its values; `None` for modes of high dynamic range.
pub(super) fn decode(mode: u32, v: &[i32]) -> Option<Endpoints> {
    let gray = |value: i32, alpha: i32| [value, value, value, alpha];
    // Colours whose order says whether blue is contracted.
    let direct = |alphas: [i32; 2]| {
        let first = [v[0], v[2], v[4], alphas[0]];
        let second = [v[1], v[3], v[5], alphas[1]];
        if v[1] + v[3] + v[5] >= v[0] + v[2] + v[4] {
            [first, second]
        } else {
            [blue_contract(second), blue_contract(first)]
        }
    };
    let offset = |alpha: (i32, i32)| {
        let (r, dr) = base_and_offset(v[0], v[1]);
        let (g, dg) = base_and_offset(v[2], v[3]);
        let (b, db) = base_and_offset(v[4], v[5]);
        let first = [r, g, b, alpha.0];
        let second = [r + dr, g + dg, b + db, alpha.0 + alpha.1];
        if dr + dg + db >= 0 {
            [first, second]
        } else {
            [blue_contract(second), blue_contract(first)]
        }
    };
    let scaled = |alphas: [i32; 2]| {
        [
            [
                (v[0] * v[3]) >> 8,
                (v[1] * v[3]) >> 8,
                (v[2] * v[3]) >> 8,
                alphas[0],
            ],
            [v[0], v[1], v[2], alphas[1]],
        ]
    };
    let endpoints = match mode {
        0 => [gray(v[0], 255), gray(v[1], 255)],
        1 => {
            let low = v[0] >> 2 | v[1] & 0xc0;
            [gray(low, 255), gray(low + (v[1] & 0x3f), 255)]
        }
        4 => [gray(v[0], v[2]), gray(v[1], v[3])],
        5 => {
            let (light, step) = base_and_offset(v[0], v[1]);
            let (alpha, alpha_step) = base_and_offset(v[2], v[3]);
            [gray(light, alpha), gray(light + step, alpha + alpha_step)]
        }
        6 => scaled([255; 2]),
        8 => direct([255; 2]),
        9 => offset((255, 0)),
        10 => scaled([v[4], v[5]]),
        12 => direct([v[6], v[7]]),
        13 => offset(base_and_offset(v[6], v[7])),
        _ => return None,
    };
    Some(endpoints.map(clamped))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_by_hand() {
        assert_eq!(
            decode(0, &[10, 20]),
            Some([[10, 10, 10, 255], [20, 20, 20, 255]])
        );
        // 0x40 + (200 >> 2), and a step that clamps.
        assert_eq!(
            decode(1, &[200, 0x41]),
            Some([[114, 114, 114, 255], [115, 115, 115, 255]])
        );
        assert_eq!(decode(1, &[255, 0xff]), Some([[255; 4], [255; 4]]));
        // Descending sums contract blue and swap.
        assert_eq!(
            decode(8, &[100, 10, 100, 20, 50, 30]),
            Some([[20, 25, 30, 255], [75, 75, 50, 255]])
        );
        assert_eq!(
            decode(6, &[200, 100, 50, 128]),
            Some([[100, 50, 25, 255], [200, 100, 50, 255]])
        );
        // An offset of -1: bits 0x7e >> 1 are 0x3f.
        assert_eq!(
            decode(5, &[20, 0x7e, 40, 0x82]),
            Some([[10, 10, 10, 148], [9, 9, 9, 149]])
        );
        assert_eq!(decode(11, &[0; 6]), None);
    }
}
