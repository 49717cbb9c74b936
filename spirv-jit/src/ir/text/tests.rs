use super::{parse_module, print_module};
use crate::ir::verify::verify;

pub const SAMPLE: &str = r#"module closest_hit
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
  v7: i64 = descriptor[set 1, first 2, count variable, dynamic] v6
  v8: f32, v9: f32 = load.buffer.volatile v7, v6
  store.global.align16 v7, v8, v9
  v10: i32 = atomic.compare_exchange.shared v6, v6, v1 @900
  v11: i64 = descriptor[set 0, first 0, count 1] v6
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
    module.functions[0].value_types.truncate(28);
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
