//! Where sixteen pixels are, and where their texels begin.

use super::lanes::Row;
use crate::raster::Target;
use crate::raster::primitive::Bounds;

/// How sixteen pixels lie.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pattern {
    /// One behind the other, from the first place on; the other places do not matter.
    Row,
    /// A 4×4 block: quads row by row.
    Block,
    /// Quads anywhere.
    Inside,
    /// Quads anywhere, of which some are outside in part.
    #[default]
    Quads,
}

/// Where sixteen pixels are.
#[derive(Clone, Copy, Debug, Default)]
pub struct Places {
    /// The first pixel of each quad, in the attachments.
    pub x: [i32; 4],
    pub y: [i32; 4],
    pub layer: [u32; 4],
    /// Other patterns than [`Pattern::Quads`] lie entirely in the render area.
    pub pattern: Pattern,
}

impl Places {
    /// Those of the 4×4 block at (x, y).
    #[inline(always)]
    pub fn block([x, y]: [i32; 2], layer: u32, area: &Bounds) -> Self {
        let is_inside =
            x >= area.left && y >= area.top && x + 4 <= area.right && y + 4 <= area.bottom;
        Self {
            x: [x, x + 2, x, x + 2],
            y: [y, y, y + 2, y + 2],
            layer: [layer; 4],
            pattern: match is_inside {
                true => Pattern::Block,
                false => Pattern::Quads,
            },
        }
    }

    /// Sixteen pixels of a row, from (x, y) on, in the render area.
    #[inline(always)]
    pub fn row(x: i32, y: i32, layer: u32) -> Self {
        Self {
            x: [x; 4],
            y: [y; 4],
            layer: [layer; 4],
            pattern: Pattern::Row,
        }
    }
}

/// The texels of an attachment, up to four words each.
pub type TexelWords = [Row; 4];

/// The first byte of a quad's texels.
#[inline(always)]
pub fn quad(target: &Target, places: &Places, quad: usize, sample: u32) -> *mut u8 {
    let slice = target.first_layer + places.layer[quad];
    let (x, y) = (places.x[quad] as u32, places.y[quad] as u32);
    target.surface.texel(x, y, slice, sample)
}
