//! Black-box tests of a Vulkan driver through the Vulkan loader: this library is the harness.
//!
//! A test opens a [`Gpu`], makes what it needs with its methods, runs commands and looks at the
//! result; the [`Gpu`] destroys everything at its end and fails the test if the validation layer
//! (where it is installed) had anything to complain of. Nothing here knows which driver it is on:
//! the loader's `VK_DRIVER_FILES` decides.

mod acceleration;
mod alone;
mod bind;
mod compositor;
mod compute;
mod gpu;
mod graphics;
mod image;
mod known;
mod memory;
mod micromap;
mod misuse;
mod newer;
mod nv_ray_tracing;
mod optional;
mod presenter;
mod shader;
mod skip;
mod trace;
mod window;
mod words;

pub use acceleration::{Geometry, Instance, Structure, Sweep, identity, scaled, translated};
pub use alone::alone;
pub use bind::{Bound, Set};
pub use compositor::Compositor;
pub use compute::Kernel;
pub use gpu::{Gpu, PATIENCE_NS};
pub use graphics::{Canvas, Corner, Painting, Pass};
pub use image::{Picture, Shape, all_of};
pub use known::unless_known;
pub use memory::Buffer;
pub use micromap::{MicroTriangle, Micromap, MicromapParts, part_centres};
pub use misuse::Misuse;
pub use newer::DeviceAddressRangeKHR;
pub use nv_ray_tracing::{DescribedNv, StructureNv, TableNv, TablesNv};
pub use optional::Optional;
pub use presenter::{Chain, Presenter, red_first, screen_picture};
pub use shader::{Stage, glsl, glsl_for, glsl_nv};
pub use skip::has;
pub use trace::{Group, Rays, RaysInput, Record, Table};
pub use window::{Window, Xvfb};
pub use words::{MISS, RESULTS, WORLD, layers, trace_words};

pub use ash::vk;

/// Small deterministic random numbers for test data.
pub struct Random(u32);

impl Random {
    pub fn new(seed: u32) -> Random {
        Random(seed)
    }

    /// Thirty-two random bits.
    pub fn bits(&mut self) -> u32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9);
        let mut x = self.0;
        x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
        x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
        x ^ (x >> 16)
    }

    /// In [low, high).
    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * ((self.bits() >> 8) as f32 / 16_777_216.0)
    }

    /// In 0..count.
    pub fn below(&mut self, count: u32) -> u32 {
        self.bits() % count
    }
}
