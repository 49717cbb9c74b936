//! Boxes.

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub(crate) struct Bounds {
    pub min: [f32; 3],
    pub max: [f32; 3],
}

impl Bounds {
    /// Holds nothing; the neutral element of [`Self::union`].
    pub const EMPTY: Bounds = Bounds {
        min: [f32::INFINITY; 3],
        max: [f32::NEG_INFINITY; 3],
    };

    /// The smallest box around both.
    #[inline]
    pub fn union(self, other: Bounds) -> Bounds {
        Bounds {
            min: std::array::from_fn(|i| self.min[i].min(other.min[i])),
            max: std::array::from_fn(|i| self.max[i].max(other.max[i])),
        }
    }

    /// The smallest box around three points.
    #[inline]
    pub fn of_triangle(triangle: &[[f32; 3]; 3]) -> Bounds {
        let [a, b, c] = triangle;
        Bounds {
            min: std::array::from_fn(|i| a[i].min(b[i]).min(c[i])),
            max: std::array::from_fn(|i| a[i].max(b[i]).max(c[i])),
        }
    }

    /// Whether there is a point in it.
    pub fn is_empty(&self) -> bool {
        (0..3).any(|i| self.min[i] > self.max[i])
    }
}
