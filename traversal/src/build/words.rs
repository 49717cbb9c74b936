//! A geometry's word at each of its primitives: see [`geometry_word`].
#![forbid(unsafe_code)]

use crate::input::{GeometryFlags, TriangleGeometry};
use crate::layout::geometry_word;

/// See [`geometry_word`].
pub(crate) fn triangle_word(index: u32, geometry: &TriangleGeometry) -> u32 {
    let micromap = match geometry.micromap {
        Some(_) => geometry_word::MICROMAP,
        None => 0,
    };
    word(index, geometry.flags) | micromap
}

/// See [`geometry_word`].
pub(crate) fn word(geometry: u32, flags: GeometryFlags) -> u32 {
    let opaque = if flags.contains(GeometryFlags::OPAQUE) {
        geometry_word::OPAQUE
    } else {
        0
    };
    geometry | opaque
}
