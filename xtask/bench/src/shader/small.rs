//! About 160 operations in four iterations of a loop, then a divergent branch with a sine on one
//! side and a square root on the other.

use std::fmt::Write;

use spirv_jit::eval;

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

pub fn text() -> String {
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

#[inline(always)]
fn native([x, y, z]: [&[f32]; 3], out: &mut [f32]) {
    for (((o, &x), &y), &z) in out.iter_mut().zip(x).zip(y).zip(z) {
        *o = native_lane(x, y, z);
    }
}

super::compiled!(native);
