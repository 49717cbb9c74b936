//! A captured command as text.

#![forbid(unsafe_code)]

use std::fmt::Write;

use spirv_jit::Program;
use traversal::{Hit, Swept};

use super::binding_table::{ReadRecord, ReadRegion};
use super::json::{opacity_name, payload_after};
use super::meeting::{Meeting, Meetings, Outcome};
use super::path::{Asked, PathRay, Ran};
use super::{CapturedCommand, flags, kind_name};
use crate::wave::binding_table::Shaders;
use crate::wave::observer::{Instruction, QueryDecision, ReportVerdict, TableKind};

/// The whole command.
pub fn command(captured: &CapturedCommand<'_>) -> String {
    let mut text = String::new();
    let [width, height, depth] = captured.extent;
    let [x, y, z] = captured.invocation;
    line(
        &mut text,
        0,
        format!(
            "command {} of frame {}: {} of {width} x {height} x {depth}, invocation ({x}, {y}, {z})",
            captured.number, captured.frame, captured.what
        ),
    );
    if captured.stopped {
        line(&mut text, 1, "the command was stopped".into());
    }
    if let (Some(shaders), Some(table)) = (captured.shaders, &captured.table) {
        for it in table {
            region(&mut text, it, shaders);
        }
    }
    if captured.path.rays.is_empty() {
        line(&mut text, 1, "no rays".into());
    }
    for (index, (it, meetings)) in captured
        .path
        .rays
        .iter()
        .zip(&captured.meetings)
        .enumerate()
    {
        ray(&mut text, index, it, meetings, &captured.programs);
    }
    for call in &captured.path.calls {
        let by = match call.by {
            Some(ray) => format!("a shader of ray {ray}"),
            None => "the invocation".into(),
        };
        let shader = match &call.ran {
            Some(ran) => shader_of(ran, &captured.programs),
            None => "no shader".into(),
        };
        line(
            &mut text,
            1,
            format!("callable {} called by {by}: {shader}", call.index),
        );
        if let Some(ran) = &call.ran {
            data(&mut text, 2, "data", &ran.before, ran.after.as_deref());
        }
    }
    if captured.path.dropped_rays > 0 {
        let dropped = captured.path.dropped_rays;
        line(&mut text, 1, format!("{dropped} more rays are not listed"));
    }
    if captured.path.dropped_calls > 0 {
        let dropped = captured.path.dropped_calls;
        line(&mut text, 1, format!("{dropped} more calls are not listed"));
    }
    text
}

fn line(text: &mut String, indent: usize, content: String) {
    for _ in 0..indent {
        text.push_str("  ");
    }
    text.push_str(&content);
    text.push('\n');
}

fn region(text: &mut String, it: &ReadRegion, shaders: &Shaders) {
    let name = kind_name(it.kind).replace('_', " ");
    if it.region.address == 0 && it.region.size_bytes == 0 && it.outside.is_empty() {
        return;
    }
    let (count, region) = (it.record_count, &it.region);
    line(
        text,
        1,
        format!(
            "{name} region at {:#x}: {count} record{}, stride {}, size {}",
            region.address,
            if count == 1 { "" } else { "s" },
            region.stride_bytes,
            region.size_bytes
        ),
    );
    if it.live_bytes < region.size_bytes {
        let live = it.live_bytes;
        line(text, 2, format!("only {live} bytes of it are memory"));
    }
    for it in &it.records {
        line(text, 2, record(it, shaders));
    }
    let listed = it.records.len() as u64;
    if listed < count {
        line(text, 2, format!("{} more records", count - listed));
    }
    for (index, used) in &it.outside {
        let rays = used.candidates + used.calls;
        line(
            text,
            2,
            format!("{index}: past the end, looked up by rays: {rays}"),
        );
    }
    for (offset, group) in &it.between {
        line(
            text,
            2,
            format!("byte {offset} has the handle of group {group}, but no record begins there"),
        );
    }
    if it.kind == TableKind::RayGeneration && it.records.is_empty() {
        line(text, 2, "no record: nothing is launched".into());
    }
}

fn record(it: &ReadRecord, shaders: &Shaders) -> String {
    let mut text = format!("{}: ", it.index);
    match it
        .group
        .and_then(|index| shaders.groups.get(index as usize))
    {
        None if it.is_zero() => text.push_str("zeros, an unused group"),
        None => text.push_str("the handle of no group of this pipeline"),
        Some(group) => {
            let _ = write!(text, "group {}", it.group.unwrap_or_default());
            let programs = [
                group.general,
                group.closest_hit,
                group.any_hit,
                group.intersection,
            ];
            let programs = programs.into_iter().flatten();
            let programs = programs.filter_map(|index| shaders.programs.get(index as usize));
            for (place, program) in programs.enumerate() {
                let separator = if place == 0 { ": " } else { "; " };
                let _ = write!(text, "{separator}{}", shader(program));
            }
        }
    }
    if it.misplaced {
        text.push_str(", which cannot be called from this region");
    }
    let used = it.use_count;
    match (used.candidates, used.calls) {
        (0, 0) => text.push_str(" (never looked up)"),
        (0, calls) => {
            let _ = write!(text, " (calls: {calls})");
        }
        (candidates, calls) => {
            let _ = write!(text, " (candidates: {candidates}, calls: {calls})");
        }
    }
    text
}

fn shader(program: &Program) -> String {
    let mut text = program.place_of(&[]).to_string();
    if let Some(file) = program.origin().and_then(|origin| origin.file()) {
        let _ = write!(text, ", {file}");
    }
    text
}

fn shader_of(ran: &Ran, programs: &[&Program]) -> String {
    let program = programs.get(ran.program as usize);
    program.map_or_else(|| "a shader".into(), |program| shader(program))
}

fn vector([x, y, z]: [f32; 3]) -> String {
    format!("({x:?}, {y:?}, {z:?})")
}

fn ray(text: &mut String, index: usize, it: &PathRay, meetings: &Meetings, programs: &[&Program]) {
    let (start, at) = (&it.start, it.depth);
    let ray = &start.ray;
    let (instruction, by) = match start.instruction {
        Instruction::TraceRay => ("", "traced"),
        Instruction::HitObjectTrace => (" into a hit object", "traced"),
        Instruction::HitObjectExecute => (" of a hit object", "executed"),
        Instruction::RayQuery(_) => (" of a ray query", "proceeding"),
    };
    let parent = match it.parent {
        Some(parent) => format!(" in a shader of ray {parent}"),
        None => String::new(),
    };
    line(
        text,
        at,
        format!("ray {index}{instruction}{parent}, {by} by {}", start.place),
    );
    let (origin, direction) = (vector(ray.origin), vector(ray.direction));
    let (t_min, t_max) = (ray.t_min, ray.t_max);
    line(
        text,
        at + 1,
        format!("from {origin} along {direction}, t from {t_min:?} to {t_max:?}"),
    );
    let mut how = format!("mask {:#04x}", ray.cull_mask & 0xFF);
    let named = flags(ray.flags | start.pipeline_flags);
    if !named.is_empty() {
        let _ = write!(how, ", flags {}", named.join(" | "));
    }
    if let Some(operands) = &start.operands {
        let _ = write!(
            how,
            ", record offset {}, stride {}, miss index {}",
            operands.offset, operands.stride, operands.miss_index
        );
    }
    line(text, at + 1, how);
    let is_finite = (ray.origin.iter().chain(&ray.direction)).all(|c| c.is_finite());
    if !is_finite {
        line(
            text,
            at + 1,
            "a component is not finite: the ray meets nothing".into(),
        );
    }
    if it.is_traversed() {
        for meeting in &meetings.listed {
            met(text, at + 1, meeting, it, programs);
        }
        if meetings.more > 0 {
            let more = meetings.more;
            line(text, at + 1, format!("{more} more are not listed"));
        }
        if meetings.is_cut {
            line(text, at + 1, "there is more than was looked at".into());
        }
    }
    end(text, at + 1, it, programs);
}

fn end(text: &mut String, at: usize, it: &PathRay, programs: &[&Program]) {
    let Some(settled) = &it.settled else {
        line(text, at, "traversal has not ended".into());
        return;
    };
    let record = match settled.record {
        Some(record) => format!(", record {record}"),
        None => String::new(),
    };
    let mut ended = match &settled.hit {
        Some(hit) => format!("hit at t = {:?}{record}", hit.t),
        None => format!("miss{record}"),
    };
    let has_shader = matches!(
        it.start.instruction,
        Instruction::TraceRay | Instruction::HitObjectExecute
    );
    match &it.shader {
        Some(ran) => {
            let _ = write!(ended, ": {}", shader_of(ran, programs));
        }
        None if has_shader => ended.push_str(": no shader runs"),
        None => {}
    }
    line(text, at, ended);
    if has_shader {
        let after = payload_after(it);
        data(text, at, "payload", &it.start.payload, after.as_deref());
    }
}

fn data(text: &mut String, at: usize, name: &str, before: &[u32], after: Option<&[u32]>) {
    if before.is_empty() {
        return;
    }
    let after = after.map_or_else(|| "unknown: the shader has not ended".into(), words);
    line(text, at, format!("{name} before: {}", words(before)));
    line(text, at, format!("{name} after: {after}"));
}

/// Words, by what each looks like: a float of usual size, a small whole number, or bits.
fn words(words: &[u32]) -> String {
    let words = words.iter().map(|&word| {
        let float = f32::from_bits(word);
        match word {
            0..=0xFFFF => format!("{word}"),
            _ if (1e-9..1e9).contains(&float.abs()) => format!("{float:?}"),
            _ => format!("{word:#010x}"),
        }
    });
    words.collect::<Vec<_>>().join(" ")
}

fn met(text: &mut String, at: usize, it: &Meeting, ray: &PathRay, programs: &[&Program]) {
    let mut content = primitive(&it.hit);
    let _ = write!(content, ": {}", it.outcome.name());
    if let (Outcome::Rejected(traversal::Reason::Masked), Some(mask)) = (it.outcome, it.mask) {
        let _ = write!(content, " {mask:#04x}");
    }
    if let Some(micromap) = it.micromap {
        let _ = write!(content, ", micromap {}", opacity_name(micromap));
    }
    let asked = it.asked.map(|index| &ray.asked[index]);
    if let (Some(index), Some(asked)) = (it.asked, asked) {
        let _ = write!(content, "{}", decided(index, asked, programs));
    }
    line(text, at, content);
    for report in asked.iter().flat_map(|asked| &asked.reports) {
        let verdict = match report.reported.verdict {
            ReportVerdict::OutsideInterval => "outside of the interval",
            _ if report.is_committed() => "committed",
            _ if report.ran.is_none() => "undecided",
            _ => "ignored by the any-hit shader",
        };
        let (t, kind) = (report.reported.t, report.reported.hit_kind);
        line(
            text,
            at + 1,
            format!("reported t = {t:?}, kind {kind}: {verdict}"),
        );
    }
}

fn primitive(hit: &Hit) -> String {
    let mut text = match (hit.is_built_in(), hit.swept) {
        (false, _) => "box".to_owned(),
        (_, Swept::No) => format!("t = {:?}: triangle", hit.t),
        (_, Swept::Sphere) => format!("t = {:?}: sphere", hit.t),
        (_, Swept::LinearSweptSphere) => format!("t = {:?}: linear swept sphere", hit.t),
    };
    let _ = write!(
        text,
        " {} of geometry {}, instance {} (custom index {})",
        hit.primitive_index, hit.geometry_index, hit.instance_index, hit.instance_custom_index
    );
    if hit.triangle {
        let [u, v] = hit.barycentrics;
        let facing = match hit.hit_kind {
            traversal::ray::HIT_KIND_FRONT_FACING_TRIANGLE => "front",
            _ => "back",
        };
        let _ = write!(text, ", barycentrics ({u:?}, {v:?}), {facing}");
    }
    text.push_str(if hit.opaque {
        ", opaque"
    } else {
        ", not opaque"
    });
    text
}

fn decided(index: usize, asked: &Asked, programs: &[&Program]) -> String {
    let mut text = String::new();
    match (&asked.ran, asked.record) {
        (Some(ran), _) => {
            let _ = write!(text, " (asked {index}: {}", shader_of(ran, programs));
            if ran.decision > 1 {
                text.push_str(", ends the ray");
            }
            text.push(')');
        }
        (None, Some(record)) if !asked.has_shader => {
            let _ = write!(text, " (record {record} has no shader for it)");
        }
        (None, None) => match asked.decision {
            Some(QueryDecision::Generated(t, true)) => {
                let _ = write!(text, " (asked {index}, generated t = {t:?})");
            }
            Some(QueryDecision::Generated(t, false)) => {
                let _ = write!(
                    text,
                    " (asked {index}, generated t = {t:?} outside of the interval)"
                );
            }
            _ => {
                let _ = write!(text, " (asked {index})");
            }
        },
        _ => {}
    }
    text
}
