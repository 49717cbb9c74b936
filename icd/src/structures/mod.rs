//! Commands on acceleration structures and micromaps: builds, copies, serialization.

pub mod acceleration_structure;
pub mod build;
mod instances;
pub mod micromap;
mod swept_sphere;

use ash::vk;
use spirv_jit::reach::Reach;
use traversal::Live;

use crate::capabilities::limits;
use crate::command::StructureCommand;
use crate::command::structures::{Built, BuiltCopy};
use crate::validate::Checks;
use build::{build, with_ranges};

/// Performs a command on structures, on the current rayon pool; `in_blocks` as in [`copy`].
pub fn execute(
    command: &StructureCommand,
    in_blocks: bool,
    reach: &Reach,
    live: &Live,
    checks: Option<&Checks>,
) {
    match command {
        StructureCommand::Build(builds) => build(builds, reach, live, checks),
        StructureCommand::BuildIndirect(builds) => {
            // SAFETY: the application keeps structures and their memory until the command is
            // complete, and does not use them otherwise meanwhile.
            let with_ranges = |build| unsafe { with_ranges(build, reach, checks) };
            build(
                &builds.iter().map(with_ranges).collect::<Vec<_>>(),
                reach,
                live,
                checks,
            );
        }
        StructureCommand::BuildMicromaps(builds) => {
            // SAFETY: the application keeps structures and their memory until the command is
            // complete, and does not use them otherwise meanwhile.
            unsafe { micromap::build(builds, reach, live, checks) };
        }
        // SAFETY: the application keeps structures and their memory until the command is
        // complete, and does not use them otherwise meanwhile.
        &StructureCommand::Copy(built, what) => unsafe {
            copy(built, what, in_blocks, reach, live);
        },
        StructureCommand::WriteProperties {
            of,
            addresses,
            query_type,
            pool,
            first,
        } => {
            for (index, &address) in (*first..).zip(addresses) {
                // SAFETY: the application keeps structures and their memory until the command is
                // complete, and does not use them otherwise meanwhile.
                pool.write(index, unsafe { property(*of, address, *query_type, live) });
            }
        }
    }
}

/// Copies a structure or micromap. With `in_blocks`, serialized bottom levels list blocks of
/// addresses, as on devices with `VK_KHR_opacity_micromap`.
///
/// # Safety
/// As [`acceleration_structure::copy`], [`serialize`](acceleration_structure::serialize) and
/// [`deserialize`](acceleration_structure::deserialize).
pub unsafe fn copy(built: Built, what: BuiltCopy, in_blocks: bool, reach: &Reach, live: &Live) {
    use acceleration_structure as structure;
    // The head of serialized data says whether a structure or a micromap follows.
    let uuids = match built {
        Built::Structure => limits::serialization_uuids(),
        Built::Micromap => limits::micromap_uuids(),
    };
    // SAFETY: the caller keeps the promises of `acceleration_structure::copy`.
    unsafe {
        let is_micromap = match what {
            BuiltCopy::Whole { source, .. } | BuiltCopy::Serialize { source, .. } => {
                micromap::is_at(live, source.address)
            }
            BuiltCopy::Deserialize { source, .. } => micromap::is_serialized_at(reach, source),
        };
        let built = match is_micromap {
            true => Built::Micromap,
            false => built,
        };
        match what {
            BuiltCopy::Whole {
                source,
                destination,
                mode,
            } => match built {
                Built::Structure => structure::copy(source, destination, mode, live),
                Built::Micromap => micromap::copy(source, destination, live),
            },
            BuiltCopy::Serialize {
                source,
                destination,
            } => match built {
                Built::Structure => {
                    structure::serialize(source, destination, in_blocks, reach, live);
                }
                Built::Micromap => {
                    micromap::serialize(source, &uuids, destination, reach, live);
                }
            },
            BuiltCopy::Deserialize {
                source,
                destination,
            } => match built {
                Built::Structure => structure::deserialize(source, destination, reach, live),
                Built::Micromap => micromap::deserialize(source, destination, reach, live),
            },
        }
    }
}

/// A property of a built structure.
///
/// # Safety
/// As [`acceleration_structure::property`].
pub unsafe fn property(of: Built, address: u64, query_type: vk::QueryType, live: &Live) -> u64 {
    // SAFETY: the caller keeps the promises of `acceleration_structure::property`.
    unsafe {
        match of {
            Built::Structure if !micromap::is_at(live, address) => {
                acceleration_structure::property(address, query_type, live)
            }
            _ => micromap::property(address, query_type, live),
        }
    }
}
