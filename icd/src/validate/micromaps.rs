//! Checks of the memory that micromap builds read, and of the geometries that use micromaps.

use spirv_jit::reach::Reach;
use traversal::{Micromap, MicromapFormat};

use super::{Checks, Rule};
use crate::command::build::Triangles;
use crate::command::micromap::MicromapBuild;
use crate::wave::reachable::{around, read};

/// `VkMicromapTriangleEXT`: offset, level, format.
#[derive(Clone, Copy)]
#[repr(C)]
struct MicromapTriangle {
    data_offset: u32,
    level: u16,
    format: u16,
}

impl Checks {
    /// Checks a build.
    ///
    /// # Safety
    /// Nothing writes the build's inputs during the call.
    pub unsafe fn micromap(&self, build: &MicromapBuild, reach: &Reach) {
        let destination = build.destination;
        self.output(
            "micromap",
            destination.address,
            destination.size_bytes,
            reach,
        );
        let size = size_of::<MicromapTriangle>() as u64;
        let Some(last) = build.count().checked_sub(1) else {
            return;
        };
        let bytes = u64::from(last)
            .saturating_mul(build.stride_bytes)
            .saturating_add(size);
        self.input("micromap triangles", build.triangles, bytes, reach);
        // The remaining triangles of each usage.
        let mut left: Vec<u32> = build.usages.iter().map(|usage| usage.count).collect();
        for index in 0..=u64::from(last) {
            let address = build
                .triangles
                .wrapping_add(index.wrapping_mul(build.stride_bytes));
            // SAFETY: the caller guarantees that nothing writes what the build reads meanwhile.
            let Some(triangle) = (unsafe { read::<MicromapTriangle>(reach, address) }) else {
                break;
            };
            let level = u32::from(triangle.level);
            let place = build.triangles;
            let detail = || {
                let format = triangle.format;
                format!("triangle {index} is of format {format} and level {level}")
            };
            let Some(format) = MicromapFormat::of(triangle.format.into()) else {
                self.broken(Rule::MicromapFormat, place, detail);
                continue;
            };
            let limit = match format {
                MicromapFormat::TwoStates => Rule::MicromapLevel2,
                MicromapFormat::FourStates => Rule::MicromapLevel4,
            };
            let is_there = level <= traversal::micromap::MAX_LEVEL;
            self.require(is_there, limit, place, detail);
            if !is_there {
                continue;
            }
            let states = build.data.wrapping_add(triangle.data_offset.into());
            let bytes = format.triangle_bytes(level);
            self.input("micromap states", states, bytes, reach);
            let usage = (build.usages.iter().zip(&mut left))
                .find(|(usage, left)| usage.format == format && usage.level == level && **left > 0);
            match usage {
                Some((_, left)) => *left -= 1,
                None => self.broken(Rule::MicromapUsage, place, detail),
            }
        }
    }

    /// Checks the micromap of a geometry in a build.
    ///
    /// # Safety
    /// Nothing writes the indices or the micromap during the call.
    pub(super) unsafe fn geometry_micromap(&self, list: &Triangles, reach: &Reach) {
        let Some(micromap) = list.bounded_micromap(reach) else {
            return;
        };
        // SAFETY: the range is in memory, and the caller keeps it unwritten.
        let built = unsafe { Micromap::at(micromap.micromap, &around(reach, micromap.micromap)) };
        let count = built.map_or(0, |built| built.triangle_count());
        for index in 0..list.primitive_count {
            // SAFETY: the indices are in memory, and the caller keeps them unwritten.
            let Some(triangle) = (unsafe { micromap.triangle(index) }) else {
                continue;
            };
            self.require(
                triangle < count,
                Rule::MicromapIndex,
                micromap.micromap,
                || format!("triangle {index} has the micromap's {triangle}, of {count}"),
            );
        }
    }
}
