//! Names and sizes of commands, for the timeline.

#![forbid(unsafe_code)]

use ash::vk::Handle;
use serde_json::{Value, json};
use spirv_jit::Program;

use crate::command::build::{Build, BuildGeometries};
use crate::command::pass::Pass;
use crate::command::{Command, Mark, StructureCommand};
use crate::handle::handle_of;
use crate::object::ray_tracing_pipeline::RayTracingPipeline;
use crate::raster::{Batch, Work};
use crate::timeline::{self, Kind, Stack, object_name};

type Described = (String, Value);

/// A command buffer's name and number of commands.
pub(super) fn command_buffer(commands: &[Command]) -> Described {
    let name = match commands.first() {
        Some(Command::Mark(Mark::CommandBuffer(handle))) => object_name(*handle),
        _ => None,
    };
    let name = name.as_deref().unwrap_or("command buffer");
    (name.to_owned(), json!({ "commands": commands.len() }))
}

/// Performs a mark.
pub(super) fn mark(spans: &mut Stack, mark: &Mark) {
    match mark {
        Mark::CommandBuffer(_) => {}
        Mark::Begin(label) => spans.begin(Kind::Label, || (label.to_string(), json!({}))),
        Mark::End => spans.end(Kind::Label),
        Mark::Insert(label) => drop(timeline::span(Kind::Label, || {
            (label.to_string(), json!({}))
        })),
    }
}

pub(super) fn dispatch(program: &Program, groups: [u32; 3]) -> Described {
    let sizes = json!({
        "groups": groups,
        "group size": program.local_size(),
        "shader": program.place_of(&[]).to_string(),
    });
    ("dispatch".into(), sizes)
}

pub(super) fn trace(pipeline: &RayTracingPipeline, extent: [u32; 3]) -> Described {
    let programs = pipeline.shaders.programs.iter();
    let name = programs
        .filter_map(|program| program.origin())
        .find_map(|origin| origin.pipeline.text());
    let sizes = json!({ "extent": extent, "pipeline": name.as_deref() });
    ("trace rays".into(), sizes)
}

/// Builds and copies of structures.
pub(super) fn build(command: &StructureCommand) -> Described {
    match command {
        StructureCommand::Build(builds) => {
            let builds: Vec<Value> = builds.iter().map(one_build).collect();
            ("build".into(), json!({ "structures": builds }))
        }
        StructureCommand::BuildIndirect(builds) => {
            let builds = builds.iter().map(|it| {
                let name = object_name(it.build.destination.address);
                let primitives = it.max_primitive_counts.iter().map(|&n| u64::from(n));
                json!({ "name": name.as_deref(), "primitives at most": primitives.sum::<u64>() })
            });
            let builds: Vec<Value> = builds.collect();
            ("build".into(), json!({ "structures": builds }))
        }
        StructureCommand::BuildMicromaps(builds) => {
            let counts: Vec<u32> = builds.iter().map(|build| build.count()).collect();
            ("build micromaps".into(), json!({ "triangles": counts }))
        }
        StructureCommand::Copy(..) => ("copy structure".into(), json!({})),
        StructureCommand::WriteProperties { .. } => ("structure properties".into(), json!({})),
    }
}

fn one_build(build: &Build) -> Value {
    let sum = |counts: &mut dyn Iterator<Item = u32>| counts.map(u64::from).sum::<u64>();
    let (kind, primitives) = match &build.geometries {
        BuildGeometries::Triangles(list) => (
            "triangles",
            sum(&mut list.iter().map(|it| it.primitive_count)),
        ),
        BuildGeometries::Aabbs(list) => {
            ("boxes", sum(&mut list.iter().map(|it| it.primitive_count)))
        }
        BuildGeometries::Swept(list) => (
            "spheres",
            sum(&mut list.iter().map(|it| it.primitive_count)),
        ),
        BuildGeometries::Motion(list) => {
            let mut counts = list.iter().map(|it| it.start.primitive_count);
            ("moving triangles", sum(&mut counts))
        }
        BuildGeometries::Instances(instances) => ("instances", u64::from(instances.count)),
    };
    json!({
        "name": object_name(build.destination.address).as_deref(),
        "kind": kind,
        "primitives": primitives,
        "update": build.update_from.is_some(),
    })
}

pub(super) fn pass(pass: &Pass) -> Described {
    let views = pass.colors.iter().flatten().chain(&pass.depth);
    let names = views.map(|attachment| object_name(handle_of(&attachment.view).as_raw()));
    let names: Vec<Option<String>> = names
        .map(|name| name.map(|name| name.to_string()))
        .collect();
    let extent = pass.area.extent;
    let sizes = json!({
        "extent": [extent.width, extent.height],
        "layers": pass.layers,
        "attachments": names,
    });
    ("pass".into(), sizes)
}

/// The draws of one flush.
pub(super) fn draws(batch: &Batch) -> Described {
    let (mut calls, mut vertices) = (0u64, 0u64);
    let mut pipelines: Vec<String> = Vec::new();
    for work in &batch.work {
        if let Work::Draw(draw) = work {
            calls += draw.calls.len() as u64;
            let counts = draw.calls.iter();
            vertices += counts
                .map(|call| u64::from(call.count) * u64::from(call.instances))
                .sum::<u64>();
            let program = draw.stages.iter().last();
            let origin = program.and_then(|program| program.origin());
            let name = origin.and_then(|origin| origin.pipeline.text());
            if let Some(name) = name.filter(|name| !pipelines.iter().any(|it| **it == **name)) {
                pipelines.push(name.to_string());
            }
        }
    }
    let sizes = json!({ "draws": calls, "vertices": vertices, "pipelines": pipelines });
    ("draws".into(), sizes)
}
