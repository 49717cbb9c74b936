//! Control flow and calls.

use super::*;

#[test]
fn selections_and_early_returns() {
    check(
        "int f(int x) { if (x < 5) return 1; else if (x < 9) { if (x == 7) return 2; } else return 3; return x * 10; }",
        "r = uint(f(int(x)));",
        &ramp(),
        |_, x| match x {
            0..5 => 1,
            7 => 2,
            5..9 => x * 10,
            _ => 3,
        },
    );
}

#[test]
fn loops_with_breaks_and_continues() {
    check(
        "",
        "for (uint i = 0; i < x; i++) {
             if (i % 3 == 1) continue;
             for (uint j = 0; ; j++) { if (j * j > i) break; if (j == 4) continue; r += j; }
             if (r > 200) break;
             r += 1;
         }
         uint k = x; do { r ^= k; k >>= 1; if (k == 3) continue; r += 2; } while (k > 1);",
        &ramp(),
        |_, x| {
            let mut r = 0u32;
            for i in 0..x {
                if i % 3 == 1 {
                    continue;
                }
                let mut j = 0;
                while j * j <= i {
                    if j != 4 {
                        r += j;
                    }
                    j += 1;
                }
                if r > 200 {
                    break;
                }
                r += 1;
            }
            let mut k = x;
            loop {
                r ^= k;
                k >>= 1;
                if k != 3 {
                    r += 2;
                }
                if k <= 1 {
                    break;
                }
            }
            r
        },
    );
}

#[test]
fn switches_that_fall_through() {
    check(
        "uint f(uint x) {
             uint r = 0;
             switch (x % 12) {
             case 0: r = 1;
             case 1: r += 2; break;
             case 2: case 5: r = 5;
             default: r += 10;
             case 9: if (r > 12) break; r += 100; break;
             case 11: return 77;
             }
             return r + x;
         }",
        "for (uint i = 0; i < 3; i++) {
             switch (x & 3) { case 1: r += f(x + i); continue; case 2: if (i == 1) break; r += 7; default: r += 1000; }
             r ^= i << 20;
         }",
        &ramp(),
        |_, x| {
            let f = |x: u32| {
                let r = match x % 12 {
                    0 => 3,
                    1 => 2,
                    2 | 5 => 15,
                    9 => 100,
                    11 => return 77,
                    _ => 110,
                };
                r + x
            };
            let mut r = 0u32;
            for i in 0..3 {
                match x & 3 {
                    1 => {
                        r += f(x + i);
                        continue;
                    }
                    2 if i == 1 => {}
                    2 => r += 1007,
                    _ => r += 1000,
                }
                r ^= i << 20;
            }
            r
        },
    );
}

#[test]
fn short_circuits_and_phis() {
    check(
        "uint calls = 0; bool t(bool b) { calls++; return b; }",
        "bool a = t(x > 10) && t(x < 20) || t(x == 3); uint p = 1, q = 2;
         for (uint i = 0; i < x; i++) { uint s = p; p = q; q = s; }
         r = calls + (a ? 100 : 0) + p * 1000;",
        &ramp(),
        |_, x| {
            let mut calls = 1;
            let mut a = x > 10;
            if a {
                calls += 1;
                a = x < 20;
            }
            if !a {
                calls += 1;
                a = x == 3;
            }
            calls + a as u32 * 100 + if x % 2 == 0 { 1000 } else { 2000 }
        },
    );
}

#[test]
fn values_that_leave_loops() {
    check(
        "",
        "uint last = 9u, found = 0u;
         for (uint i = 1u; i < 40u; i++) { uint sq = i * i; last = sq; if (sq > x) { found = i + sq; break; } }
         while (true) { r += last; if (r > x * 3u) { break; } found++; }
         r += found;",
        &ramp(),
        |_, x| {
            let i = (1..40).find(|i| i * i > x).unwrap_or(39);
            let last = i * i;
            let mut found = i + last;
            let mut r = 0;
            loop {
                r += last;
                if r > x * 3 {
                    break;
                }
                found += 1;
            }
            r + found
        },
    );
}

#[test]
fn calls_give_back_what_they_take() {
    let step = "for (int k = 0; k < 4; k++) { y += a[k]; s = s * 3u + uint(y); a[(k + 1) & 3] ^= int(s); }\n";
    let declarations = format!(
        "uint s = 1u;
         int big(inout int a[4], int y) {{ if (y == 7) return 5; {} return y; }}
         int twice(inout int b[4], int y) {{ return big(b, y) + big(b, y + 1); }}",
        step.repeat(16)
    );
    check(
        &declarations,
        "int a[4] = int[](1, 2, 3, int(x));
         if (x % 3u == 0u) r = uint(twice(a, int(x)));
         for (uint k = 0u; k < x % 5u; k++) r += uint(big(a, int(k + x)));
         r += uint(a[2]) + s * 7u;",
        &ramp(),
        |_, x| {
            fn big(a: &mut [i32; 4], s: &mut u32, mut y: i32) -> i32 {
                if y == 7 {
                    return 5;
                }
                for k in 0..64 {
                    y = y.wrapping_add(a[k % 4]);
                    *s = s.wrapping_mul(3).wrapping_add(y as u32);
                    a[(k + 1) & 3] ^= *s as i32;
                }
                y
            }
            let mut a = [1, 2, 3, x as i32];
            let (mut s, mut r) = (1, 0u32);
            if x % 3 == 0 {
                let first = big(&mut a, &mut s, x as i32);
                r = first.wrapping_add(big(&mut a, &mut s, x as i32 + 1)) as u32;
            }
            for k in 0..x % 5 {
                r = r.wrapping_add(big(&mut a, &mut s, (k + x) as i32) as u32);
            }
            r.wrapping_add(a[2] as u32).wrapping_add(s.wrapping_mul(7))
        },
    );
}
