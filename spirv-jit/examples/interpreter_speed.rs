//! How fast the interpreter is, as a share of what the compiler makes of the same operations: `cargo run --release --example interpreter_speed`.
//!
//! Both run one definition of the kernel: about 160 operations in four iterations of a loop, then a divergent branch with a sine on one
//! side and a square root on the other.

use std::fmt::Write;
use std::sync::Arc;
use std::time::Instant;

use spirv_jit::environment::{Descriptor, DescriptorSet, Environment, MAX_SETS};
use spirv_jit::eval;
use spirv_jit::ir::text::parse_module;
use spirv_jit::program::{AlignedRow, Event, Wave};
use spirv_jit::reach::Reach;
use spirv_jit::{Program, program::Frame};

/// The loop's body, as text and as a function.
macro_rules! body {
    (($x:ident, $y:ident, $z:ident) -> ($r:ident, $s:ident, $t:ident); $($d:ident = $op:ident($($a:ident),*);)*) => {
        const BODY: &[(&str, &str, &[&str])] = &[$((stringify!($d), stringify!($op), &[$(stringify!($a)),*])),*];

        #[inline(always)]
        fn native_body($x: f32, $y: f32, $z: f32) -> (f32, f32, f32) {
            $(let $d = eval::$op($($a),*);)*
            ($r, $s, $t)
        }
    };
}
body! {
    (x, y, z) -> (r, s, t);
    a = fmul(x, x);
    b = ffma(y, y, a);
    c = ffma(z, z, b);
    d = fadd(c, x);
    e = fsub(d, y);
    f = fmul(e, c);
    g = ffma(f, x, y);
    h = ffma(f, y, z);
    i = ffma(f, z, x);
    j = fmin(g, h);
    k = fmax(h, i);
    l = fsub(k, j);
    m = fmul(l, l);
    n = ffract(m);
    o = fadd(n, g);
    p = ffma(o, n, h);
    q = ffma(p, n, i);
    aa = fabs(q);
    ab = fadd(aa, o);
    ac = fmul(ab, p);
    ad = fsub(ac, q);
    ae = ffma(ad, n, l);
    af = fneg(ae);
    ag = fadd(af, m);
    ah = fmul(ag, n);
    ai = ffract(ah);
    aj = ffma(ai, o, p);
    ak = ffma(ai, p, q);
    al = ffma(ai, q, o);
    am = fmul(aj, ak);
    an = fadd(am, al);
    ao = ffract(an);
    ap = fadd(aj, ao);
    aq = fadd(ak, ao);
    ar = fadd(al, ao);
    r = ffract(ap);
    s = ffract(aq);
    t = ffract(ar);
}

const ITERATIONS: u32 = 4;

fn text() -> String {
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
        v8: i32 = const 4
        block L0 -> (v9: f32, v10: f32, v11: f32) {
        loop L1 (v12: i32, v13: f32, v14: f32, v15: f32) = (v6, v3, v4, v5) {\n",
    );
    let mut names = std::collections::HashMap::from([("x", 13), ("y", 14), ("z", 15)]);
    for (k, &(d, op, args)) in BODY.iter().enumerate() {
        let args: Vec<String> = args.iter().map(|a| format!("v{}", names[a])).collect();
        writeln!(text, "v{}: f32 = {op} {}", 100 + k, args.join(", ")).unwrap();
        names.insert(d, 100 + k);
    }
    let (r, s, t) = (names["r"], names["s"], names["t"]);
    write!(
        text,
        "v16: i32 = iadd v12, v7
        v17: i1 = ult v16, v8
        if v17, L2 {{ br L1(v16, v{r}, v{s}, v{t}) }} else {{ br L0(v{r}, v{s}, v{t}) }}
        unreachable
        }}
        unreachable
        }}
        v18: i1 = folt v9, v10
        if v18, L3 -> (v19: f32) {{
        v20: f32 = fsin v11
        br L3(v20)
        }} else {{
        v21: f32 = fsqrt v11
        br L3(v21)
        }}
        v22: f32 = fadd v19, v9
        end(v22)
        }}\n"
    )
    .unwrap();
    text
}

#[inline(always)]
fn native_lane(x: f32, y: f32, z: f32) -> f32 {
    let (mut x, mut y, mut z) = (x, y, z);
    for _ in 0..ITERATIONS {
        (x, y, z) = native_body(x, y, z);
    }
    let (sine, root) = (eval::fsin(z), eval::fsqrt(z));
    (if x < y { sine } else { root }) + x
}

macro_rules! native {
    ($name:ident, $features:literal) => {
        #[target_feature(enable = $features)]
        fn $name(x: &[f32], y: &[f32], z: &[f32], out: &mut [f32]) {
            for (((o, &x), &y), &z) in out.iter_mut().zip(x).zip(y).zip(z) {
                *o = native_lane(x, y, z);
            }
        }
    };
}
native!(native_512, "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma");
native!(native_256, "avx2,fma");

fn main() {
    let module = parse_module(&text()).unwrap();
    let program = Program::new(&module).unwrap();
    let layout = program.layout();
    let subgroups = program.max_wave_subgroups();
    println!("wave of {} lanes", subgroups * 16);
    let waves = 64;
    let lanes = waves * subgroups * 16;
    let value = |lane: usize, k: usize| {
        ((lane * 3 + k) as u32).wrapping_mul(2_654_435_761) as f32 / 4_294_967_296.0
    };
    let columns: Vec<Vec<f32>> = (0..3)
        .map(|k| (0..lanes).map(|lane| value(lane, k)).collect())
        .collect();
    let mut native_out = vec![0.0; lanes];
    let mut states = vec![vec![AlignedRow::default(); layout.rows]; waves * subgroups];
    let environment = Environment {
        sets: [DescriptorSet {
            entries: std::ptr::null(),
            count: 0,
        }; MAX_SETS],
        dynamic: std::ptr::null(),
        dynamic_count: 0,
        push_constants: Descriptor::NULL,
        uniforms: [0; 8],
        reach: Arc::new(Reach::everywhere()),
        strays: None,
    };
    let mut frame = Frame::default();
    let mut best = [f64::INFINITY; 3];
    for _ in 0..60 {
        for (which, best) in best.iter_mut().enumerate() {
            for (s, state) in states.iter_mut().enumerate() {
                program.start(state, !0);
                for (k, column) in columns.iter().enumerate() {
                    state[layout.inputs + k].0 =
                        std::array::from_fn(|lane| column[s * 16 + lane].to_bits());
                }
            }
            let [x, y, z] = &columns[..] else {
                unreachable!()
            };
            let start = Instant::now();
            match which {
                0 => {
                    for wave in states.chunks_mut(subgroups) {
                        let mut refs: Vec<&mut [AlignedRow]> =
                            wave.iter_mut().map(|s| &mut s[..]).collect();
                        let mut wave = Wave {
                            states: &mut refs,
                            shared: std::ptr::null_mut(),
                            environment: &environment,
                        };
                        let event = program.run(&mut frame, &mut wave, &mut 1000);
                        assert_eq!(event, Event::End);
                    }
                }
                // SAFETY: the features are checked.
                1 if is_x86_feature_detected!("avx512bw") => unsafe {
                    native_512(x, y, z, &mut native_out)
                },
                // SAFETY: the features are checked.
                _ if is_x86_feature_detected!("avx2") => unsafe {
                    native_256(x, y, z, &mut native_out)
                },
                _ => {}
            }
            *best = best.min(start.elapsed().as_secs_f64() * 1e9 / lanes as f64);
        }
    }
    // The result before the speed.
    for (s, state) in states.chunks_mut(subgroups).enumerate() {
        let mut refs: Vec<&mut [AlignedRow]> = state.iter_mut().map(|s| &mut s[..]).collect();
        let mut wave = Wave {
            states: &mut refs,
            shared: std::ptr::null_mut(),
            environment: &environment,
        };
        assert_eq!(program.run(&mut frame, &mut wave, &mut 1000), Event::End);
        for lane in 0..subgroups * 16 {
            let got = wave.states[lane / 16][layout.io].0[lane % 16];
            assert_eq!(got, native_out[s * subgroups * 16 + lane].to_bits());
        }
    }
    println!(
        "interpreter {:.2} ns/lane, native AVX-512 {:.2}, AVX2 {:.2}: {:.0} % of native",
        best[0],
        best[1],
        best[2],
        100.0 * best[1] / best[0]
    );
}
