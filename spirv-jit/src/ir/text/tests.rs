use super::{parse_module, print_module};
use crate::ir::verify::verify;

pub const SAMPLE: &str = r#"module compute
inputs launch_id.0, payload.2, hit_attribute.1
query_words candidate.t.0, committed.object_to_world.11
output_rows 1
local_size 8, 4, 1
quads
shared 64

func f0 "ma\"in" {
  var0: 4 rows zero "color"
  var1: 2 rows
  unused v40: f64
  labels 9
  v0: i32 = input[0] @17
  v1: i32 = const -7
  v2: i1 = ult v0, v1
  v3: f32 = const 0x3fc00000 ; 1.5
  v4: f16 = const 0x3c00 ; 1.0
  v5: i1 = const 1
  if v2, L0 -> (v6: i32) {
    br L0(v0)
  } else {
    br L0(v1)
  }
  v7: descriptor = descriptor[set 1, first 2, count variable, dynamic] v6
  v8: f32, v9: f32 = load.buffer.constant v7, v6
  v28: i64 = descriptor_reference[set 0, first 0, count 1] v6
  store.global.align16.volatile v28, v8, v9
  v10: i32 = atomic.compare_exchange.shared v6, v6, v1 @900
  v11: descriptor = descriptor_at v28
  v12: f32, v13: f32, v14: f32, v15: f32 = image.sample[2d, f32, lod, format 37, arrayed, offset] v7, v11, v8, v9, v3, v3, v6, v6
  v16: f32 = subgroup.reduce[fadd, 16] v15
  v17: i1 = subgroup.all v2
  var.store[var0, 2] v16
  v18: i32 = var.address[var0]
  v27: i1 = ray_query_proceed v18
  v19: i64 = pack64 v18, v18
  v20: i32, v21: i32 = unpack64 v19
  v22: i32 = call[f1] v20
  loop L1 (v23: i32, v24: f32) = (v22, v3) {
    v25: i1 = ieq v23, v1
    if v25, L2 {
      end(v24)
    } else {
      br L2
    }
    v26: i32 = iadd v23, v0
    br L1(v26, v24)
  }
  unreachable
}

func f1 (v0: i32) -> (i32) {
  block L0 -> (v1: i32) {
    br L0(v0)
  }
  return(v1)
}
"#;

#[test]
fn text_round_trips() {
    let mut module = parse_module(SAMPLE).unwrap();
    verify(&module).unwrap();
    // Between the last value in use and the one listed there are numbers without a definition.
    let text = print_module(&module);
    let again = parse_module(&text).unwrap();
    assert_eq!(module, again);
    // The parser fills such gaps; without them the text itself is the same again.
    module.functions[0].value_types.truncate(29);
    let text = print_module(&module);
    assert_eq!(text, SAMPLE.replace("  unused v40: f64\n", ""));
}

/// A module whose entry is that text.
fn entry(body: &str) -> String {
    format!("module compute\nfunc f0 {{ {body} }}\n")
}

fn verdict(text: &str) -> Result<(), String> {
    verify(&parse_module(text).unwrap())
}

#[test]
fn verifier_refuses() {
    let cases = [
        ("v1: i32 = inot v0\nend", None),
        ("v1: i32 = not v0\nend", Some("before its definition")),
        (
            "v0: i32 = const 1\nv0: i32 = const 1\nend",
            Some("defined twice"),
        ),
        ("v0: i8 = const 0x100\nend", Some("above its type's width")),
        (
            "v0: i32 = const 1\nv1: f32 = fneg v0\nend",
            Some("wrong operand"),
        ),
        ("v0: i1 = const 1\nv1: i1 = iadd v0, v0\nend", Some("")),
        (
            "block L0 {\nv0: i32 = const 1\nbr L0\n}\nv1: i32 = not v0\nend",
            Some("outside the construct"),
        ),
        (
            "block L0 -> (v0: i32) {\nbr L0\n}\nend",
            Some("takes 1 values and is given 0"),
        ),
        ("block L0 {\nbr L0\n}\nbr L0", Some("outside its construct")),
        (
            "block L0 {\nbr L0\n}\nblock L0 {\nbr L0\n}\nend",
            Some("names two constructs"),
        ),
        (
            "var0: 1 rows\nv0: i64 = var.load[var0, 0]\nend",
            Some("past the end"),
        ),
        ("return", Some("returns instead of ending")),
        ("v0: i32 = const 1\nend(v0)", Some("end has 1 operands")),
        (
            "v0: f32 = const 1\nloop L0 (v1: i32) = (v0) {\nend\n}\nend",
            Some("L0: v0 is f32"),
        ),
        (
            "v0: i32 = const 1\nif v0, L0 {\nbr L0\n} else {\nbr L0\n}\nend",
            Some("condition"),
        ),
        (
            "v0: i1 = const 1\nv1: i32 = const 0\nstore.shared v1, v0\nend",
            Some("not storable"),
        ),
    ];
    for (body, expected) in cases {
        let text = entry(body);
        match (parse_module(&text), expected) {
            (Err(_), None) => {}
            (Ok(module), Some(expected)) => match verify(&module) {
                // Integer operations include the i1 ones.
                Ok(()) => assert!(expected.is_empty(), "accepted: {body}"),
                Err(message) => assert!(message.contains(expected), "{body}: {message}"),
            },
            (result, _) => panic!("{body}: {:?}", result.err()),
        }
    }
}

/// A descriptor comes from the operations that look one up, and goes nowhere but to those that use
/// one.
#[test]
fn verifier_refuses_forged_descriptors() {
    const SEEN: &str = "v0: i32 = const 0\n\
        v1: descriptor = descriptor[set 0, first 0, count 1] v0\n\
        v2: i64 = const 0x414141414140\nv3: i1 = const 1\n";
    let fetch = |operand: &str| {
        format!(
            "v4: f32, v5: f32, v6: f32, v7: f32 = \
             image.fetch[2d, f32, implicit, format 0] {operand}, v0, v0\nend"
        )
    };
    let refused = [
        // Made of a number.
        fetch("v2"),
        "v4: descriptor = const 0x414141414140\nend".into(),
        "v4: descriptor = iadd v2, v2\nend".into(),
        "v4: descriptor = bitcast v2\nend".into(),
        "v4: descriptor = pack64 v0, v0\nend".into(),
        "v4: descriptor = uconvert v0\nend".into(),
        "v4: descriptor = read_clock\nend".into(),
        "v4: descriptor = descriptor_reference[set 0, first 0, count 1] v0\nend".into(),
        "v4: i32 = load.buffer v2, v0\nend".into(),
        "store.buffer v2, v0, v0\nend".into(),
        "v4: i32 = atomic.iadd.buffer v2, v0, v0\nend".into(),
        "v4: i32 = buffer_size v2\nend".into(),
        "v4: i64 = descriptor_address v2\nend".into(),
        // Read from memory.
        "v4: descriptor = load.buffer v1, v0\nend".into(),
        "v4: descriptor = load.private v0\nend".into(),
        "var0: 2 rows\nv4: descriptor = var.load[var0, 0]\nend".into(),
        "v4: descriptor = atomic.load.buffer v1, v0\nend".into(),
        // Changed, chosen, sent, shown or kept.
        "v4: descriptor = iadd v1, v1\nend".into(),
        "v4: descriptor = select v3, v1, v1\nend".into(),
        "v4: i64 = bitcast v1\nend".into(),
        "v4: i1 = ieq v1, v1\nend".into(),
        "v4: i32, v5: i32 = unpack64 v1\nend".into(),
        "v4: descriptor = subgroup.shuffle v1, v0\nend".into(),
        "v4: descriptor = subgroup.broadcast_first v1\nend".into(),
        "v4: i1 = subgroup.all_equal v1\nend".into(),
        "store.buffer v1, v0, v1\nend".into(),
        "store.global v2, v1\nend".into(),
        "v4: i32 = load.global v1\nend".into(),
        "var0: 2 rows\nvar.store[var0, 0] v1\nend".into(),
        "v4: descriptor = descriptor_at v1\nend".into(),
        // PassThrough on.
        "block L0 -> (v4: descriptor) {\nbr L0(v1)\n}\nend".into(),
        "if v3, L0 -> (v4: descriptor) {\nbr L0(v1)\n} else {\nbr L0(v1)\n}\nend".into(),
        "loop L0 (v4: descriptor) = (v1) {\nend\n}\nend".into(),
        "end\n}\nfunc f1 (v0: descriptor) {\nreturn".into(),
        "end\n}\nfunc f1 -> (descriptor) {\nunreachable".into(),
    ];
    for body in refused {
        let declared = body.starts_with("var0");
        let (first, rest) = match declared {
            true => body.split_once('\n').unwrap(),
            false => ("", &body[..]),
        };
        let module = parse_module(&entry(&format!("{first}\n{SEEN}{rest}"))).expect(rest);
        assert!(verify(&module).is_err(), "accepted: {body}");
        // The same from a cache.
        let bytes = crate::ir::binary::encode(&module);
        assert!(crate::program::from_bytes(&bytes).is_err(), "{body}");
    }
    verdict(&entry(&format!("{SEEN}{}", fetch("v1")))).unwrap();
    let followed = format!("{SEEN}v8: descriptor = descriptor_at v2\n{}", fetch("v8"));
    verdict(&entry(&followed)).unwrap();
}

/// Operations that a stage's scheduler cannot answer, and memory that its programs lack, are
/// refused.
#[test]
fn verifier_refuses_what_a_stage_lacks() {
    let shared = "v0: i32 = const 0\nstore.shared v0, v0\nend";
    for stage in ["ray_generation", "any_hit", "callable", "miss"] {
        for (head, body) in [("", shared), ("shared 64", "end"), ("", "barrier\nend")] {
            let text = format!("module {stage}\n{head}\nfunc f0 {{\n{body}\n}}\n");
            assert!(verdict(&text).is_err(), "accepted: {text}");
        }
    }
    let call = "v0: i32 = const 0\nexecute_callable v0\nend";
    assert!(verdict(&format!("module miss\nfunc f0 {{\n{call}\n}}\n")).is_ok());
    assert!(verdict(&entry(call)).is_err());
    assert!(verdict(&entry("barrier\nend")).is_ok());
    assert!(verdict("module compute\nlocal_size 0, 1, 1\nfunc f0 {\nend\n}\n").is_err());
}

/// Words past the end of what an input or a fact has: schedulers index by them.
#[test]
fn verifier_refuses_words_that_inputs_lack() {
    let text = |stage: &str, head: &str| format!("module {stage}\n{head}\nfunc f0 {{\nend\n}}\n");
    for (stage, row, last) in [
        ("compute", "workgroup_id", 2),
        ("compute", "global_invocation_id", 2),
        ("compute", "local_invocation_index", 0),
        ("ray_generation", "launch_id", 2),
        ("ray_generation", "shader_record_address", 1),
        ("closest_hit", "object_to_world", 11),
        ("closest_hit", "world_ray_direction", 2),
    ] {
        let input = |word: u32| text(stage, &format!("inputs {row}.{word}"));
        verdict(&input(last)).unwrap();
        for word in [last + 1, 255] {
            assert!(verdict(&input(word)).is_err(), "accepted: {row}.{word}");
        }
    }
}

#[test]
fn verifier_refuses_recursion() {
    let text = "module compute\nfunc f0 {\ncall[f1]\nend\n}\nfunc f1 {\ncall[f2]\nreturn\n}\nfunc f2 {\ncall[f1]\nreturn\n}\n";
    assert!(verdict(text).unwrap_err().contains("calls itself"));
}

#[test]
fn deep_nests_are_verified_and_printed() {
    let depth = 1000;
    let mut body = String::new();
    for level in 0..depth {
        body += &format!("block L{level} {{\n");
    }
    for level in (0..depth).rev() {
        body += &format!("br L{level}\n}}\n");
    }
    body += "end";
    let module = parse_module(&entry(&body)).unwrap();
    verify(&module).unwrap();
    assert_eq!(parse_module(&print_module(&module)).unwrap(), module);
}
