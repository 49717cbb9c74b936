//! Performs commands on acceleration structures and micromaps.

#![forbid(unsafe_code)]

use super::engine::Engine;
use super::spans;
use crate::command::StructureCommand;
use crate::structures;
use crate::timeline::{self, Kind};
use crate::validate::Caller;

/// Performs a command, with the device's workers where it is large.
pub fn perform(engine: &Engine, command: &StructureCommand) {
    let (reach, live) = (engine.memory.reach(), engine.memory.structures());
    let checks = engine.checks(Caller::Other);
    let _span = timeline::span(Kind::Build, || spans::build(command));
    let in_blocks = engine.options.serializes_blocks;
    (engine.workers)
        .install(|| structures::execute(command, in_blocks, &reach, &live, checks.as_ref()));
}
