//! A captured command as JSON.

#![forbid(unsafe_code)]

use serde_json::{Map, Value, json};
use spirv_jit::Program;
use spirv_jit::origin::CodeLocation;
use traversal::{Hit, Opacity, Swept};

use super::binding_table::{ReadRecord, ReadRegion};
use super::meeting::{Meeting, Meetings};
use super::path::{Asked, Path, PathRay, Ran};
use super::{CapturedCommand, flags, kind_name};
use crate::wave::binding_table::{GroupKind, Shaders};
use crate::wave::observer::{Instruction, QueryDecision, ReportVerdict};

/// A float; those that JSON has no number for are text.
pub fn float(value: f32) -> Value {
    match value.is_finite() {
        true => json!(value),
        false => json!(format!("{value:?}")),
    }
}

fn floats(values: &[f32]) -> Value {
    values.iter().copied().map(float).collect()
}

/// An address, which may be past what JSON's readers keep of numbers.
fn address(value: u64) -> Value {
    json!(format!("{value:#x}"))
}

/// The whole command.
pub fn command(captured: &CapturedCommand<'_>) -> Value {
    let CapturedCommand {
        number,
        frame,
        what,
        extent,
        invocation,
        programs,
        shaders,
        path,
        meetings,
        table,
        stopped,
    } = captured;
    let pipeline = (programs.iter())
        .filter_map(|program| program.origin())
        .find_map(|origin| origin.pipeline.text());
    let rays: Vec<Value> = (path.rays.iter().zip(meetings).enumerate())
        .map(|(index, (it, meetings))| ray(index, it, meetings, programs))
        .collect();
    let mut object = json!({
        "command": number,
        "frame": frame,
        "kind": what,
        "pipeline": pipeline.as_deref(),
        "extent": extent,
        "invocation": invocation,
        "stopped": stopped,
        "rays": rays,
        "calls": calls(path, programs),
        "dropped_rays": path.dropped_rays,
        "dropped_calls": path.dropped_calls,
    });
    if let (Some(shaders), Some(table)) = (shaders, table) {
        let regions = table
            .iter()
            .map(|it| (kind_name(it.kind), region(it, shaders)));
        let regions: Map<String, Value> = (regions)
            .map(|(name, value)| (name.to_owned(), value))
            .collect();
        object["table"] = Value::Object(regions);
    }
    object
}

fn ray(index: usize, it: &PathRay, meetings: &Meetings, programs: &[&Program]) -> Value {
    let start = &it.start;
    let ray = &start.ray;
    let instruction = match start.instruction {
        Instruction::TraceRay => "trace",
        Instruction::HitObjectTrace => "hit object trace",
        Instruction::HitObjectExecute => "hit object execute",
        Instruction::RayQuery(_) => "ray query",
    };
    let mut object = json!({
        "ray": index,
        "parent": it.parent,
        "depth": it.depth,
        "instruction": instruction,
        "traced_by": place(&start.place, None),
        "origin": floats(&ray.origin),
        "direction": floats(&ray.direction),
        "t_min": float(ray.t_min),
        "t_max": float(ray.t_max),
        "time": float(start.time),
        "flags": ray.flags,
        "flag_names": flags(ray.flags),
        "pipeline_flags": start.pipeline_flags,
        "cull_mask": ray.cull_mask & 0xFF,
        "structure": address(start.structure),
    });
    if let Some(operands) = &start.operands {
        object["sbt_offset"] = json!(operands.offset);
        object["sbt_stride"] = json!(operands.stride);
        object["miss_index"] = json!(operands.miss_index);
    }
    if !matches!(start.instruction, Instruction::RayQuery(_)) {
        object["payload_before"] = json!(start.payload);
        let after = payload_after(it);
        object["payload_after"] = json!(after);
    }
    if it.is_traversed() {
        let met = meetings.listed.iter().map(|m| meeting(m, it, programs));
        object["met"] = met.collect();
        object["more_met"] = json!(meetings.more);
        object["report_is_cut"] = json!(meetings.is_cut);
    }
    if let Some(settled) = &it.settled {
        object["hit"] = settled.hit.as_ref().map_or(Value::Null, hit);
        object["record"] = json!(settled.record);
        if !settled.attributes.is_empty() {
            object["attributes"] = json!(settled.attributes);
        }
        object["shader"] = it
            .shader
            .as_ref()
            .map_or(Value::Null, |it| ran(it, programs));
    }
    object
}

/// Words of a ray's payload after its last shader; unknown of a ray that has not ended.
pub fn payload_after(ray: &PathRay) -> Option<Vec<u32>> {
    ray.settled.as_ref()?;
    if let Some(shader) = &ray.shader {
        return shader.after.clone();
    }
    let deciders = ray.asked.iter().flat_map(|asked| {
        let of_reports = asked
            .reports
            .iter()
            .filter_map(|report| report.ran.as_ref());
        // An intersection shader sees no payload.
        let any_hit = asked.ran.iter().filter(|_| asked.hit.is_built_in());
        of_reports.chain(any_hit)
    });
    let last = deciders.last();
    Some(last.map_or_else(
        || ray.start.payload.clone(),
        |ran| ran.after.clone().unwrap_or_default(),
    ))
}

/// Where the hit is, and what is known of it.
fn hit(hit: &Hit) -> Value {
    let primitive = match hit.swept {
        Swept::Sphere => "sphere",
        Swept::LinearSweptSphere => "linear swept sphere",
        Swept::No if hit.triangle => "triangle",
        Swept::No => "box",
    };
    json!({
        "t": float(hit.t),
        "instance": hit.instance_index,
        "custom_index": hit.instance_custom_index,
        "instance_sbt_offset": hit.instance_sbt_offset,
        "geometry": hit.geometry_index,
        "primitive": hit.primitive_index,
        "primitive_kind": primitive,
        "barycentrics": floats(&hit.barycentrics),
        "hit_kind": hit.hit_kind,
        "opaque": hit.opaque,
    })
}

fn meeting(it: &Meeting, ray: &PathRay, programs: &[&Program]) -> Value {
    let mut object = hit(&it.hit);
    if !it.hit.is_built_in() {
        // A box has no distance of its own.
        object["t"] = Value::Null;
    }
    object["outcome"] = json!(it.outcome.name());
    object["instance_mask"] = json!(it.mask);
    if let Some(micromap) = it.micromap {
        object["micromap"] = json!(opacity_name(micromap));
    }
    if let Some(index) = it.asked {
        object["asked"] = json!(index);
        decision(&mut object, &ray.asked[index], programs);
    }
    object
}

fn decision(object: &mut Value, asked: &Asked, programs: &[&Program]) {
    if asked.record.is_some() {
        object["record"] = json!(asked.record);
        object["shader"] = (asked.ran.as_ref()).map_or(Value::Null, |it| ran(it, programs));
    }
    if !asked.reports.is_empty() {
        let reports = asked.reports.iter().map(|report| {
            let verdict = match report.reported.verdict {
                ReportVerdict::OutsideInterval => "outside of the interval",
                _ if report.is_committed() => "committed",
                _ if report.ran.is_none() => "undecided",
                _ => "ignored",
            };
            json!({
                "t": float(report.reported.t),
                "hit_kind": report.reported.hit_kind,
                "attributes": report.reported.attributes,
                "verdict": verdict,
                "any_hit": report.ran.as_ref().map(|it| ran(it, programs)),
            })
        });
        object["reports"] = reports.collect();
    }
    if let Some(decision) = asked.decision {
        object["decision"] = match decision {
            QueryDecision::Ignored => json!("ignored"),
            QueryDecision::Confirmed => json!("confirmed"),
            QueryDecision::Generated(..) => json!("generated"),
        };
        if let QueryDecision::Generated(t, counts) = decision {
            object["generated_t"] = float(t);
            object["generated_counts"] = json!(counts);
        }
    }
}

/// The name of a micromap's state.
pub fn opacity_name(opacity: Opacity) -> &'static str {
    match opacity {
        Opacity::Transparent => "transparent",
        Opacity::Opaque => "opaque",
        Opacity::UnknownTransparent => "unknown transparent",
        Opacity::UnknownOpaque => "unknown opaque",
    }
}

fn ran(it: &Ran, programs: &[&Program]) -> Value {
    let mut object = programs
        .get(it.program as usize)
        .map_or(json!({}), |program| shader(program));
    object["record_address"] = address(it.record);
    object["payload_before"] = json!(it.before);
    object["payload_after"] = json!(it.after);
    object
}

fn shader(program: &Program) -> Value {
    let file = program.origin().and_then(|origin| origin.file());
    place(&program.place_of(&[]), file)
}

fn place(place: &CodeLocation, file: Option<String>) -> Value {
    let line = place.line.as_ref();
    json!({
        "stage": format!("{:?}", place.stage),
        "entry_point": place.entry_point,
        "name": place.name.as_deref(),
        "file": line.map(|line| line.file.clone()).or(file),
        "line": line.map(|line| line.line),
    })
}

fn calls(path: &Path, programs: &[&Program]) -> Value {
    let calls = path.calls.iter().map(|call| {
        json!({
            "index": call.index,
            "by_ray": call.by,
            "shader": call.ran.as_ref().map(|it| ran(it, programs)),
        })
    });
    calls.collect()
}

fn region(it: &ReadRegion, shaders: &Shaders) -> Value {
    let outside = it.outside.iter().map(|(index, used)| {
        json!({ "index": index, "candidates": used.candidates, "calls": used.calls })
    });
    let between = it
        .between
        .iter()
        .map(|(offset, index)| json!({ "offset": offset, "group": group(*index, shaders) }));
    let records = it.records.iter().map(|it| record(it, shaders));
    json!({
        "address": address(it.region.address),
        "stride": it.region.stride_bytes,
        "size": it.region.size_bytes,
        "memory": it.live_bytes,
        "record_count": it.record_count,
        "records": records.collect::<Value>(),
        "outside": outside.collect::<Value>(),
        "handles_between_records": between.collect::<Value>(),
    })
}

fn record(it: &ReadRecord, shaders: &Shaders) -> Value {
    let handle: String = it.handle.iter().map(|byte| format!("{byte:02x}")).collect();
    let state = match it.group {
        Some(_) if it.misplaced => "of another region",
        Some(_) => "a group",
        None if it.is_zero() => "zeros",
        None => "no group of this pipeline",
    };
    json!({
        "index": it.index,
        "address": address(it.address),
        "handle": handle,
        "names": state,
        "group": it.group.map(|index| group(index, shaders)),
        "candidates": it.use_count.candidates,
        "calls": it.use_count.calls,
        "used": it.use_count.candidates + it.use_count.calls > 0,
    })
}

fn group(index: u32, shaders: &Shaders) -> Value {
    let Some(group) = shaders.groups.get(index as usize) else {
        return Value::Null;
    };
    let of = |program: Option<u32>| {
        let program = program.and_then(|index| shaders.programs.get(index as usize));
        program.map(|program| shader(program))
    };
    let kind = match group.kind {
        GroupKind::General => "general",
        GroupKind::Triangles => "triangles",
        GroupKind::Procedural => "procedural",
    };
    let mut object = json!({ "group": index, "kind": kind });
    for (name, program) in [
        ("general", group.general),
        ("closest_hit", group.closest_hit),
        ("any_hit", group.any_hit),
        ("intersection", group.intersection),
    ] {
        if let Some(shader) = of(program) {
            object[name] = shader;
        }
    }
    object
}
