//! Commands on acceleration structures and micromaps: builds, copies, serialization.

pub mod acceleration_structure;
pub mod build;
mod instances;
pub mod micromap;
mod swept;

use spirv_jit::reach::Reach;
use traversal::Live;

use crate::command::RayTracingCommand;
use crate::table::limits;
use crate::validate::Checks;
use build::{build, with_ranges};

/// Performs a command on structures, on the current rayon pool.
pub fn execute(command: &RayTracingCommand, reach: &Reach, live: &Live, checks: Option<&Checks>) {
    // SAFETY, for each block: as in `execute`.
    match command {
        RayTracingCommand::Build(builds) => build(builds, reach, live, checks),
        RayTracingCommand::BuildIndirect(builds) => {
            // SAFETY: as above.
            let with_ranges = |build| unsafe { with_ranges(build, reach, checks) };
            build(
                &builds.iter().map(with_ranges).collect::<Vec<_>>(),
                reach,
                live,
                checks,
            );
        }
        RayTracingCommand::Copy {
            source,
            destination,
            mode,
        } => {
            // SAFETY: as above.
            unsafe { acceleration_structure::copy(*source, *destination, *mode, live) };
        }
        RayTracingCommand::Serialize {
            source,
            destination,
        } => {
            let uuids = limits::serialization_uuids();
            // SAFETY: as above.
            unsafe {
                acceleration_structure::serialize(*source, *destination, &uuids, reach, live);
            }
        }
        RayTracingCommand::Deserialize {
            source,
            destination,
        } => {
            // SAFETY: as above.
            unsafe {
                acceleration_structure::deserialize(*source, *destination, reach, live);
            }
        }
        RayTracingCommand::WriteProperties {
            structures,
            query_type,
            pool,
            first,
        } => {
            for (index, &address) in (*first..).zip(structures) {
                // SAFETY: as above.
                pool.write(index, unsafe {
                    acceleration_structure::property(address, *query_type, live)
                });
            }
        }
        // SAFETY: as above.
        RayTracingCommand::Micromap(command) => unsafe {
            micromap::execute(command, reach, live, checks)
        },
        RayTracingCommand::TraceRays { .. }
        | RayTracingCommand::TraceRaysNv { .. }
        | RayTracingCommand::TraceRaysIndirect { .. }
        | RayTracingCommand::TraceRaysIndirect2 { .. } => {}
    }
}
