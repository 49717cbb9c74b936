//! A hundred values that live through a loop whose length differs by lane, with a divergent branch
//! in it.

use std::fmt::Write;

use spirv_jit::eval;

/// Values that live at once.
const VALUES: usize = 100;
/// Of these, values that the branch changes.
const CHANGED: usize = 20;
const LANES: usize = 16;

/// From each value to the one that is mixed into it.
const STEP: usize = 37;
const START_FACTOR: f32 = 1.7;
const LOOP_FACTOR: f32 = 0.61;

pub fn text() -> String {
    let constant = |name: &str, value: f32| format!("{name}: f32 = const {:#x}\n", value.to_bits());
    let list = |ids: &[usize]| -> String {
        let ids: Vec<String> = ids.iter().map(|id| format!("v{id}")).collect();
        ids.join(", ")
    };
    let typed = |ids: &[usize]| -> String {
        let ids: Vec<String> = ids.iter().map(|id| format!("v{id}: f32")).collect();
        ids.join(", ")
    };
    let mut next = 20;
    let mut fresh = || {
        next += 1;
        next - 1
    };
    let mut text = String::from(
        "module closest_hit
        inputs payload.0, payload.1, payload.2
        output_rows 1
        func f0 {
        v0: i32 = input[0]
        v1: i32 = input[1]
        v2: i32 = input[2]
        v3: f32 = bitcast v0
        v4: f32 = bitcast v1
        v5: f32 = bitcast v2
        v6: i32 = const 0
        v7: i32 = const 1
        v8: i32 = const 2\n",
    );
    text += &constant("v9", START_FACTOR);
    text += &constant("v10", LOOP_FACTOR);
    text += &constant("v11", 1.0);
    text += &constant("v12", 4.0);
    text += "v13: f32 = fmul v4, v12\nv14: i32 = fto_u v13\nv15: i32 = iadd v14, v8\n";
    let mut line = |text: &mut String, expression: String| -> usize {
        let id = fresh();
        writeln!(text, "v{id}: f32 = {expression}").unwrap();
        id
    };
    let mut values = vec![3, 4, 5];
    while values.len() < VALUES {
        let k = values.len();
        let mixed = line(
            &mut text,
            format!("ffma v{}, v9, v{}", values[k - 1], values[k - 3]),
        );
        values.push(line(&mut text, format!("ffract v{mixed}")));
    }
    let params: Vec<usize> = (1000..).take(VALUES).collect();
    let ends: Vec<usize> = (2000..).take(VALUES).collect();
    let changed: Vec<usize> = (3000..).take(CHANGED).collect();
    writeln!(text, "block L0 -> ({}) {{", typed(&ends)).unwrap();
    let (with_count, init) = (typed(&params), list(&values));
    writeln!(text, "loop L1 (v16: i32, {with_count}) = (v6, {init}) {{").unwrap();
    values.clone_from(&params);
    for k in 0..VALUES {
        let other = values[(k + STEP) % VALUES];
        let mixed = line(&mut text, format!("ffma v{other}, v10, v{}", values[k]));
        values[k] = line(&mut text, format!("ffract v{mixed}"));
    }
    writeln!(text, "v17: i1 = folt v{}, v{}", values[0], values[1]).unwrap();
    writeln!(text, "if v17, L2 -> ({}) {{", typed(&changed)).unwrap();
    let first: Vec<usize> = (0..CHANGED)
        .map(|k| line(&mut text, format!("fsub v11, v{}", values[k])))
        .collect();
    writeln!(text, "br L2({})\n}} else {{", list(&first)).unwrap();
    let second: Vec<usize> = (0..CHANGED)
        .map(|k| {
            line(
                &mut text,
                format!("fmul v{}, v{}", values[k], values[k + CHANGED]),
            )
        })
        .collect();
    writeln!(text, "br L2({})\n}}", list(&second)).unwrap();
    values[..CHANGED].copy_from_slice(&changed);
    let now = list(&values);
    write!(
        text,
        "v18: i32 = iadd v16, v7
        v19: i1 = ult v18, v15
        if v19, L3 {{ br L1(v18, {now}) }} else {{ br L0({now}) }}
        unreachable
        }}
        unreachable
        }}\n"
    )
    .unwrap();
    let mut sum = ends[0];
    for &end in &ends[1..] {
        sum = line(&mut text, format!("fadd v{sum}, v{end}"));
    }
    writeln!(text, "end(v{sum})\n}}").unwrap();
    text
}

type Lanes = [f32; LANES];

#[inline(always)]
fn each(f: impl Fn(usize) -> f32) -> Lanes {
    let mut lanes = [0.0; LANES];
    for (lane, value) in lanes.iter_mut().enumerate() {
        *value = f(lane);
    }
    lanes
}

/// Sixteen lanes, with selections where they diverge: what a vectorising compiler makes of the
/// shader.
#[inline(always)]
fn native_block([x, y, z]: [&Lanes; 3]) -> Lanes {
    let mut values = [[0.0; LANES]; VALUES];
    (values[0], values[1], values[2]) = (*x, *y, *z);
    for k in 3..VALUES {
        values[k] = each(|lane| {
            eval::ffract(eval::ffma(
                values[k - 1][lane],
                START_FACTOR,
                values[k - 3][lane],
            ))
        });
    }
    let mut length = [0u32; LANES];
    for lane in 0..LANES {
        length[lane] = eval::fto_u::<f32, u32>(y[lane] * 4.0) + 2;
    }
    let mut iteration = 0u32;
    loop {
        let mut goes_on = [false; LANES];
        for lane in 0..LANES {
            goes_on[lane] = iteration < length[lane];
        }
        if goes_on == [false; LANES] {
            break;
        }
        let old = values;
        for k in 0..VALUES {
            let other = values[(k + STEP) % VALUES];
            values[k] =
                each(|lane| eval::ffract(eval::ffma(other[lane], LOOP_FACTOR, values[k][lane])));
        }
        let less = values[..2].to_vec();
        for k in 0..CHANGED {
            values[k] = each(|lane| {
                let (first, second) = (
                    1.0 - values[k][lane],
                    values[k][lane] * values[k + CHANGED][lane],
                );
                if less[0][lane] < less[1][lane] {
                    first
                } else {
                    second
                }
            });
        }
        for k in 0..VALUES {
            values[k] = each(|lane| {
                if goes_on[lane] {
                    values[k][lane]
                } else {
                    old[k][lane]
                }
            });
        }
        iteration += 1;
    }
    let mut sum = values[0];
    for value in &values[1..] {
        sum = each(|lane| sum[lane] + value[lane]);
    }
    sum
}

#[inline(always)]
fn native([x, y, z]: [&[f32]; 3], out: &mut [f32]) {
    let inputs = x
        .as_chunks()
        .0
        .iter()
        .zip(y.as_chunks().0)
        .zip(z.as_chunks().0);
    for (out, ((x, y), z)) in out.as_chunks_mut().0.iter_mut().zip(inputs) {
        *out = native_block([x, y, z]);
    }
}

super::compiled!(native);
