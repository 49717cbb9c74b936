//! Black-box tests of a Vulkan driver through the Vulkan loader: this library is the harness.
//!
//! A test opens a [`Gpu`], makes what it needs with its methods, runs commands and looks at the
//! result; the [`Gpu`] destroys everything at its end and fails the test if the validation layer
//! (where it is installed) had anything to complain of. Nothing here knows which driver it is on:
//! the loader's `VK_DRIVER_FILES` decides.

mod acceleration;
mod alone;
pub mod assembly;
mod bind;
mod case;
#[cfg(unix)]
mod compositor;
mod compute;
mod drawing;
mod faults;
mod gpu;
mod graphics;
pub mod heaps;
mod image;
mod known;
mod memory;
mod micromap;
mod misuse;
pub mod newer;
mod nv_ray_tracing;
mod optional;
mod patience;
mod present_times;
mod presenter;
mod query;
mod quotes;
mod shader;
mod skip;
pub mod spirv;
mod trace;
#[cfg(windows)]
mod win32_window;
#[cfg(unix)]
mod window;
mod words;

pub use acceleration::{
    Geometry, Instance, Structure, Sweep, geometry_of, identity, scaled, translated, triangles_at,
};
pub use alone::alone;
pub use bind::{Bound, Set};
pub use case::Case;
#[cfg(unix)]
pub use compositor::{Compositor, Offers};
pub use compute::Kernel;
pub use drawing::{BLACK, COVER, PUSHED, Pass, RGBA, WHITE};
pub use faults::{Faults, fault, fault_text};
pub use gpu::Gpu;
pub use graphics::{Canvas, Corner, Painting};
pub use image::{Picture, Shape, all_of, flat_info};
pub use known::unless_known;
pub use memory::Buffer;
pub use micromap::{
    MicroTriangle, Micromap, MicromapForm, MicromapParts, part_centre, part_centres,
};
pub use misuse::Misuse;
pub use newer::{
    ACCELERATION_STRUCTURE_TYPE_OPACITY_MICROMAP_KHR,
    AccelerationStructureTrianglesOpacityMicromapKHR,
    BUILD_ACCELERATION_STRUCTURE_MICROMAP_LOSSY_BIT_KHR, DeviceAddressRangeKHR,
    GEOMETRY_TYPE_MICROMAP_KHR, PhysicalDeviceOpacityMicromapPropertiesKHR, PresentTimingInfoEXT,
    SwapchainTimingPropertiesEXT,
};
pub use nv_ray_tracing::{DescribedNv, StructureNv, TableNv, TablesNv};
pub use optional::Optional;
pub use patience::{PATIENCE, PATIENCE_NS, comes, enough};
pub use present_times::{PresentTimes, PresentationTiming, Stages};
pub use presenter::{Asked, Chain, Presenter, red_first, screen_picture};
pub use quotes::missing_quotes;
pub use shader::{Stage, glsl, glsl_nv, stage_flag};
pub use skip::{has, has_program};
pub use trace::{Group, Rays, Record, Table};
#[cfg(windows)]
pub use win32_window::Win32Window;
#[cfg(unix)]
pub use window::{Window, Xvfb};
pub use words::{MISS, RESULTS, WORLD, layers};

pub use ash::vk;
pub use fastrand::Rng;

/// A random number in [low, high).
pub fn between(random: &mut Rng, low: f32, high: f32) -> f32 {
    low + (high - low) * random.f32()
}
