//! A whole dispatch from shaders in the IR's text form: any-hit, intersection with its own any-hit,
//! recursion, callables, divergence.

use std::sync::Arc;

use lanes::Tier;
use scenes::{Bytes, IDENTITY, InstanceRecord, Mesh, build_boxes, build_instances, build_meshes};
use spirv_jit::Program;
use spirv_jit::environment::{Descriptor, DescriptorSet, Environment, MAX_SETS, uniform};
use spirv_jit::ir::text::parse_module;
use spirv_jit::reach::Reach;

use super::{Dispatch, Tracer};
use crate::wave::binding_table::{Group, HANDLE_SIZE, Handle, Live, Region, Shaders, Tables};
use crate::wave::{Limits, Stopped, Workers};

const SIZE: u32 = 20;

/// Traces along z from the middle of the launch's cell, with its index as the payload's word, and
/// stores what comes back.
const RAYGEN: &str = "
module ray_generation
inputs launch_id.0, launch_id.1
output_rows 0

func f0 {
  v0: i32 = input[0]
  v1: i32 = input[1]
  v2: i32 = const 0
  v3: i32 = const 255
  v4: f32 = const 0x3f000000
  v5: f32 = const 0xbf800000
  v6: f32 = const 0x00000000
  v7: f32 = const 0x3f800000
  v8: f32 = const 0x42c80000
  v9: f32 = uto_f v0
  v10: f32 = uto_f v1
  v11: f32 = fadd v9, v4
  v12: f32 = fadd v10, v4
  v13: descriptor = descriptor[set 0, first 0, count 2] v2
  v14: i64 = descriptor_address v13
  v15: i32, v16: i32 = unpack64 v14
  v17: i32 = uniform[0]
  v18: i32 = imul v1, v17
  v19: i32 = iadd v18, v0
  v20: i32 = trace_ray v15, v16, v2, v3, v2, v2, v2, v11, v12, v5, v6, v6, v6, v7, v8, v19
  v21: i32 = const 2
  v22: i32 = shl v19, v21
  v23: i32 = const 1
  v24: descriptor = descriptor[set 0, first 0, count 2] v23
  store.buffer v24, v22, v20
  end
}
";

/// Ignores the hit in odd columns, and counts itself in the payload's upper half.
const ANY_HIT: &str = "
module any_hit
inputs launch_id.0, payload.0
output_rows 2

func f0 {
  v0: i32 = input[0]
  v1: i32 = input[1]
  v2: i32 = const 1
  v3: i32 = and v0, v2
  v4: i32 = const 65536
  v5: i32 = iadd v1, v4
  end(v3, v5)
}
";

/// Adds 1000000 to the payload.
const CLOSEST_HIT_FRONT: &str = "
module closest_hit
inputs payload.0
output_rows 1

func f0 {
  v0: i32 = input[0]
  v1: i32 = const 1000000
  v2: i32 = iadd v0, v1
  end(v2)
}
";

/// Calls the callable with the payload, then traces a ray that no instance takes part in with what
/// came back.
const CLOSEST_HIT_BACK: &str = "
module closest_hit
inputs payload.0
output_rows 1

func f0 {
  v0: i32 = input[0]
  v1: i32 = const 0
  v2: i32 = execute_callable v1, v0
  v3: descriptor = descriptor[set 0, first 0, count 2] v1
  v4: i64 = descriptor_address v3
  v5: i32, v6: i32 = unpack64 v4
  v7: f32 = const 0x00000000
  v8: f32 = const 0x3f800000
  v9: i32 = trace_ray v5, v6, v1, v1, v1, v1, v1, v7, v7, v7, v7, v7, v7, v8, v8, v2
  end(v9)
}
";

const CALLABLE: &str = "
module callable
inputs callable_data.0
output_rows 1

func f0 {
  v0: i32 = input[0]
  v1: i32 = const 2000000
  v2: i32 = iadd v0, v1
  end(v2)
}
";

const MISS: &str = "
module miss
inputs payload.0
output_rows 1

func f0 {
  v0: i32 = input[0]
  v1: i32 = const 4000000
  v2: i32 = iadd v0, v1
  end(v2)
}
";

/// Reports one hit before the interval, which must be refused, then one inside it with the row as
/// attribute and hit kind 5.
const INTERSECTION: &str = "
module intersection
inputs launch_id.1
output_rows 0

func f0 {
  v0: i32 = input[0]
  v1: f32 = const 0xbf800000
  v2: i32 = const 5
  v3: i1 = report_intersection v1, v2, v0
  if v3, L0 {
    end
  } else {
    br L0
  }
  v4: f32 = const 0x3fa00000
  v5: i1 = report_intersection v4, v2, v0
  end
}
";

/// Accepts reports in even rows.
const ANY_HIT_OF_REPORT: &str = "
module any_hit
inputs hit_attribute.0, payload.0
output_rows 2

func f0 {
  v0: i32 = input[0]
  v1: i32 = input[1]
  v2: i32 = const 1
  v3: i32 = and v0, v2
  v4: i32 = const 131072
  v5: i32 = iadd v1, v4
  end(v3, v5)
}
";

/// Adds the hit kind and a thousand times the attribute.
const CLOSEST_HIT_BOX: &str = "
module closest_hit
inputs hit_attribute.0, payload.0, hit_kind.0
output_rows 1

func f0 {
  v0: i32 = input[0]
  v1: i32 = input[1]
  v2: i32 = input[2]
  v3: i32 = const 8000000
  v4: i32 = imul v0, v3
  v5: i32 = iadd v1, v4
  v6: i32 = const 16000000
  v7: i32 = imul v2, v6
  v8: i32 = iadd v5, v7
  end(v8)
}
";

/// The results of the shaders above for a launch index.
fn expected(x: u32, y: u32) -> u32 {
    let mut payload = y * SIZE + x;
    if x >= 16 || y >= 16 {
        return payload + 4_000_000;
    }
    if x < 8 {
        payload += 65536;
        if x.is_multiple_of(2) {
            return payload + 1_000_000;
        }
    } else if y < 8 {
        payload += 131_072;
        if y.is_multiple_of(2) {
            return payload
                .wrapping_add(y * 8_000_000)
                .wrapping_add(5 * 16_000_000);
        }
    }
    payload + 2_000_000 + 4_000_000
}

fn program(text: &str) -> Arc<Program> {
    // Programs have native code once the settings are read.
    crate::settings::settings();
    let module = parse_module(text).expect("the text is well formed");
    Arc::new(Program::new(&module).expect("the module compiles"))
}

/// A rectangle at depth `z` as two triangles.
fn rectangle(width: f32, height: f32, z: f32, opaque: bool) -> Bytes {
    let vertices = vec![
        [0.0, 0.0, z],
        [width, 0.0, z],
        [width, height, z],
        [0.0, height, z],
    ];
    let mesh = Mesh {
        vertices,
        indices: vec![[0, 1, 2], [0, 2, 3]],
        opaque,
    };
    build_meshes(&[mesh], 0)
}

/// Bottom levels where they are, each with its own hit record.
fn top_level(bottom_levels: &[&Bytes]) -> Bytes {
    let instances: Vec<_> = (0u32..)
        .zip(bottom_levels)
        .map(|(index, bottom)| InstanceRecord {
            sbt_offset_and_flags: index,
            ..InstanceRecord::new(bottom, IDENTITY)
        })
        .collect();
    build_instances(&instances, 0)
}

fn handle(index: usize) -> Handle {
    let mut handle = [0; HANDLE_SIZE];
    handle[0] = index as u8 + 1;
    handle
}

/// Groups, with the handle of group `i` being `handle(i)`, and a table region for a run of them.
fn shaders(texts: &[&str], groups: &[Group]) -> (Shaders, Vec<Handle>) {
    let handles: Vec<_> = (0..groups.len()).map(handle).collect();
    let groups = groups.iter().zip(&handles).map(|(group, &handle)| Group {
        handle,
        ..group.clone()
    });
    (
        Shaders::new(
            texts.iter().map(|text| program(text)).collect(),
            groups.collect(),
        ),
        handles,
    )
}

fn region(handles: &[Handle], first: usize, count: usize) -> Region {
    Region {
        address: handles[first..].as_ptr() as u64,
        stride_bytes: HANDLE_SIZE as u64,
        size_bytes: (count * HANDLE_SIZE) as u64,
    }
}

fn live(tables: &Tables) -> Tables<Live> {
    // SAFETY: tests keep their tables.
    unsafe { tables.live(&Reach::everywhere()) }
}

fn workers() -> Arc<Workers> {
    Workers::new(2)
}

fn environment(descriptors: &[Descriptor]) -> Environment {
    let mut sets = [DescriptorSet::NONE; MAX_SETS];
    sets[0] = DescriptorSet {
        entries: descriptors.as_ptr(),
        count: descriptors.len() as u32,
        ..DescriptorSet::NONE
    };
    let mut uniforms = [0; uniform::COUNT];
    uniforms[..3].copy_from_slice(&[SIZE, SIZE, 1]);
    Environment {
        number: Environment::next_number(),
        sets,
        uniforms,
        ..Environment::unbound()
    }
}

#[test]
fn every_kind_of_shader_call_returns_to_its_caller() {
    let front = rectangle(8.0, 16.0, 0.0, false);
    let back = rectangle(16.0, 16.0, 1.0, true);
    let boxes = build_boxes(&[[8.0, 0.0, 0.125, 16.0, 8.0, 0.5]], false, 0);
    let scene = top_level(&[&front, &back, &boxes]);
    let texts = [
        RAYGEN,
        MISS,
        ANY_HIT,
        CLOSEST_HIT_FRONT,
        CLOSEST_HIT_BACK,
        INTERSECTION,
        ANY_HIT_OF_REPORT,
        CLOSEST_HIT_BOX,
        CALLABLE,
    ];
    let general = |program| Group {
        general: Some(program),
        ..Group::default()
    };
    let hit = |closest_hit, any_hit, intersection| Group {
        closest_hit: Some(closest_hit),
        any_hit,
        intersection,
        ..Group::default()
    };
    let groups = [
        general(0),
        general(1),
        hit(3, Some(2), None),
        hit(4, None, None),
        hit(7, Some(6), Some(5)),
        general(8),
    ];
    let (shaders, handles) = shaders(&texts, &groups);
    let mut output = vec![0u32; (SIZE * SIZE) as usize];
    let descriptors = [
        Descriptor {
            address: scene.address(),
            ..Descriptor::NULL
        },
        Descriptor {
            address: output.as_mut_ptr() as u64,
            size_bytes: size_of_val(&output[..]) as u64,
            ..Descriptor::NULL
        },
    ];
    let dispatch = Dispatch {
        shaders: &shaders,
        tier: Tier::best(),
        tables: live(&Tables {
            raygen: region(&handles, 0, 1),
            miss: region(&handles, 1, 1),
            hit: region(&handles, 2, 3),
            callable: region(&handles, 5, 1),
        }),
        extent: [SIZE, SIZE, 1],
        environment: &environment(&descriptors),
        pipeline_ray_flags: 0,
        takes_all_hits: false,
        mask: None,
        limits: &Limits::default(),
        observer: None,
    };
    Tracer::default()
        .trace_rays(&dispatch, &workers())
        .expect("no limit is reached");
    for y in 0..SIZE {
        for x in 0..SIZE {
            assert_eq!(
                output[(y * SIZE + x) as usize],
                expected(x, y),
                "launch {x}, {y}"
            );
        }
    }
}

/// A ray generation shader that never ends.
const ENDLESS: &str = "
module ray_generation
output_rows 0

func f0 {
  loop L0 {
    br L0
  }
  unreachable
}
";

/// One that asks without end: each turn of its loop suspends, and burns no fuel to speak of.
const ASKING: &str = "
module ray_generation
output_rows 0

func f0 {
  var0: 15 rows zero
  v0: i32 = const 1
  v1: i32 = var.address[var0]
  loop L0 {
    var.store[var0, 1] v0
    v2: i1 = ray_query_proceed v1
    br L0
  }
  unreachable
}
";

#[test]
fn a_hanging_shader_is_stopped() {
    is_stopped(ENDLESS);
    is_stopped(ASKING);
}

fn is_stopped(text: &str) {
    let (shaders, handles) = shaders(
        &[text],
        &[Group {
            general: Some(0),
            ..Group::default()
        }],
    );
    let limits = Limits {
        deadline: Some(std::time::Instant::now()),
        ..Limits::default()
    };
    let dispatch = Dispatch {
        shaders: &shaders,
        tier: Tier::best(),
        tables: live(&Tables {
            raygen: region(&handles, 0, 1),
            ..Tables::default()
        }),
        extent: [1, 1, 1],
        environment: &environment(&[]),
        pipeline_ray_flags: 0,
        takes_all_hits: false,
        mask: None,
        limits: &limits,
        observer: None,
    };
    assert_eq!(
        Tracer::default().trace_rays(&dispatch, &workers()),
        Err(Stopped::TimedOut)
    );
}
