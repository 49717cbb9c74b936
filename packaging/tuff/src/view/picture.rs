//! Pictures of maps, as PNG.

use anyhow::{Context, Result};

use super::capture::Map;
use super::colours::viridis;

/// The share of numbers within the range of colours. Otherwise a few large ones would leave the
/// others one colour.
const SHOWN: f64 = 0.999;

/// A picture of a map, with its layers one below the other.
///
/// # Errors
/// The map is too large for the format.
pub fn of(map: &Map, [width, height, depth]: [u32; 3]) -> Result<Vec<u8>> {
    let end = end_of_scale(map.values().collect());
    let colours: Vec<u8> = (map.values())
        .flat_map(|value| viridis(f64::from(value) / f64::from(end.max(1))))
        .collect();
    let rows = height
        .checked_mul(depth)
        .context("a map of too many rows")?;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, rows);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let text = format!("{}: from 0 (dark) to {end} (light), viridis", map.name);
    encoder.add_text_chunk("Description".into(), text)?;
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&colours)?;
    writer.finish()?;
    Ok(bytes)
}

/// The smallest number with the last colour.
fn end_of_scale(mut values: Vec<u32>) -> u32 {
    let Some(last) = values.len().checked_sub(1) else {
        return 0;
    };
    let place = (last as f64 * SHOWN).ceil() as usize;
    let (_, end, _) = values.select_nth_unstable(place.min(last));
    *end
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(numbers: &[u16]) -> Map {
        Map {
            name: "rays".into(),
            of: "ray".into(),
            file: Some("rays.npy".into()),
            width: 2,
            bytes: numbers
                .iter()
                .flat_map(|number| number.to_le_bytes())
                .collect(),
        }
    }

    #[test]
    fn a_picture_has_a_pixel_for_each_number() {
        let picture = of(&map(&[0, 500, 1000, 1000, 0, 0]), [3, 1, 2]).expect("a picture");
        let decoder = png::Decoder::new(std::io::Cursor::new(picture));
        let mut reader = decoder.read_info().expect("its head");
        let mut pixels = vec![0; reader.output_buffer_size().expect("its size")];
        let info = reader.next_frame(&mut pixels).expect("its pixels");
        assert_eq!((info.width, info.height), (3, 2));
        assert_eq!(info.color_type, png::ColorType::Rgb);
        let expected = [0.0, 0.5, 1.0, 1.0, 0.0, 0.0].map(viridis);
        assert_eq!(pixels, expected.as_flattened());
        let texts = &reader.info().uncompressed_latin1_text;
        assert_eq!(
            texts[0].text,
            "rays: from 0 (dark) to 1000 (light), viridis"
        );
    }

    #[test]
    fn few_large_numbers_do_not_stretch_the_scale() {
        let mut numbers = vec![10; 5000];
        numbers[17] = 9999;
        assert_eq!(end_of_scale(numbers), 10);
        assert_eq!((end_of_scale(vec![]), end_of_scale(vec![4])), (0, 4));
    }
}
