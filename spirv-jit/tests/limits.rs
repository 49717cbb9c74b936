//! Modules that are deep, long, or would explode: the passes take them in bounded stack, memory and
//! time.

use std::time::Duration;

use spirv_jit::LaneMask;
use spirv_jit::environment::Environment;
use spirv_jit::ir::text::parse_module;
use spirv_jit::ir::{Body, Module};
use spirv_jit::pass::optimize;
use spirv_jit::program::{AlignedRow, Event, Frame, Program, Wave};

fn count(body: &Body) -> usize {
    let mut count = 0;
    body.visit(&mut |_| count += 1);
    count
}

fn optimised(text: &str) -> (Module, Duration) {
    let mut module = parse_module(text).unwrap();
    let begin = effort::processor_time();
    optimize(&mut module).unwrap();
    (module, effort::processor_time() - begin)
}

/// Nests `depth` constructs of all kinds, each of which changes a variable.
#[test]
fn nests_of_a_thousand() {
    let mut text = String::from(
        "module callable\ninputs callable_data.0\noutput_rows 1\nfunc f0 {\nvar0: 4 rows zero\nv0: i32 = input[0]\nv1: i1 = ieq v0, v0\n",
    );
    let depth = 1000;
    let mut ends = Vec::new();
    for k in 0..depth {
        let row = k % 4;
        let value = 10 + 2 * k;
        let change = format!(
            "v{value}: i32 = var.load[var0, {row}]\nv{}: i32 = iadd v{value}, v0\nvar.store[var0, {row}] v{}\n",
            value + 1,
            value + 1
        );
        match k % 3 {
            0 => {
                text += &format!("block L{k} {{\n{change}");
                ends.push(format!("br L{k}\n}}\n"));
            }
            1 => {
                text += &format!("if v1, L{k} {{\n{change}");
                ends.push(format!("br L{k}\n}} else {{\nbr L{k}\n}}\n"));
            }
            // Left to the enclosing construct.
            _ => {
                text += &format!("loop L{k} {{\n{change}");
                ends.push(format!(
                    "br L{}\n}}\nunreachable\n}} else {{\nbr L{}\n}}\n",
                    k - 1,
                    k - 1
                ));
            }
        }
    }
    let mut skip = false;
    for (k, end) in ends.iter().enumerate().rev() {
        // The loop's end closed the `if` around it.
        if !std::mem::take(&mut skip) {
            text += end;
        }
        skip = k % 3 == 2;
    }
    text += "v5: i32 = var.load[var0, 0]\nend(v5)\n}\n";
    // Test threads have 2 MiB of stack.
    let (module, _) = optimised(&text);
    assert!(module.functions[0].variables.is_empty());
}

/// Functions each of which calls the next one twice.
fn call_tree(levels: u32) -> String {
    let mut text = String::from("module callable\noutput_rows 1\n");
    for level in 0..levels {
        let head = if level == 0 {
            "func f0 {\nv0: i32 = const 1\n".to_string()
        } else {
            format!("func f{level} (v0: i32) -> (i32) {{\n")
        };
        let end = if level == 0 { "end" } else { "return" };
        if level + 1 < levels {
            let callee = level + 1;
            text += &format!(
                "{head}v1: i32 = call[f{callee}] v0\nv2: i32 = call[f{callee}] v1\n{end}(v2)\n}}\n"
            );
        } else {
            text += &format!("{head}v2: i32 = const 1\nv1: i32 = iadd v0, v2\n{end}(v1)\n}}\n");
        }
    }
    text
}

#[test]
fn call_trees_that_double() {
    let (module, _) = optimised(&call_tree(40));
    let total: usize = module.functions.iter().map(|f| count(&f.body)).sum();
    assert!(total < 40_000, "{total} instructions");
}

/// However little fuel a run has, it comes back where that is spent, and the next one goes on
/// there.
#[test]
fn calls_burn_fuel() {
    let (levels, fuel) = (12, 100);
    shaders::code_pages::allow_native_code();
    let program = Program::new(&parse_module(&call_tree(levels)).unwrap()).unwrap();
    let mut state = vec![AlignedRow::default(); program.layout().rows];
    let active = LaneMask::from_bits(0x0ff0);
    program.start(&mut state, active);
    let (mut frame, environment) = (Frame::default(), Environment::unbound());
    let mut runs = 0;
    loop {
        runs += 1;
        let mut states = [&mut state[..]];
        let mut wave = Wave {
            states: &mut states,
            shared: &[],
            is_whole: false,
            outputs_to: &[],
            environment: &environment,
        };
        // SAFETY: nothing is bound, and the program shares no memory.
        let events = unsafe { program.run(&mut frame, &mut wave, &mut { fuel }) };
        match events.expect("the frame is small").iter().next().unwrap() {
            Event::End => break,
            event => assert_eq!(event, Event::OutOfFuel),
        }
    }
    // 2 + 4 + … + 2¹¹ calls, 100 a run.
    let calls = (1u64 << levels) - 2;
    assert_eq!(runs, calls / fuel + 1);
    // The last function adds one to a number that goes through all of its calls and is one at
    // first.
    let sum = 1 + (1 << (levels - 1));
    let io = state[program.layout().io].0;
    let expected = std::array::from_fn(|lane| if active.contains(lane) { sum } else { 0 });
    assert_eq!(io, expected);
}

/// Many variables, stored and read in many loops and branches: the worst for promotion.
#[test]
fn ten_thousand_instructions() {
    let mut text = String::from(
        "module callable\ninputs callable_data.0\noutput_rows 1\nfunc f0 {\nvar0: 500 rows zero\nv0: i32 = input[0]\nv1: i1 = ieq v0, v0\nv2: i32 = const 3\n",
    );
    let mut value = 3;
    for k in 0..700 {
        let (a, b) = (k * 7 % 500, k * 13 % 500);
        let v = value;
        value += 8;
        text += &format!(
            "block L{0} {{\nloop L{1} {{
            v{v}: i32 = var.load[var0, {a}]
            v{7}: i1 = ult v{v}, v2
            if v{7}, L{2} {{\nvar.store[var0, {b}] v{v}\nbr L{2}\n}} else {{\nbr L{0}\n}}
            v{3}: i32 = var.load[var0, {b}]
            v{4}: i32 = iadd v{3}, v{v}
            v{5}: i32 = imul v{4}, v{3}
            v{6}: i32 = xor v{5}, v2
            var.store[var0, {a}] v{6}
            br L{1}\n}}\nunreachable\n}}\n",
            3 * k,
            3 * k + 1,
            3 * k + 2,
            v + 1,
            v + 2,
            v + 3,
            v + 4,
            v + 5,
        );
    }
    text += &format!("v{value}: i32 = var.load[var0, 0]\nend(v{value})\n}}\n");
    let text = text.replace("v1: i1 = ieq v0, v0\n", "");
    let (module, time) = optimised(&text);
    assert!(module.functions[0].variables.is_empty());
    // A few milliseconds in release mode; the bound is for a debug build with the verifier.
    assert!(time < Duration::from_secs(2), "{time:?}");
    println!("{time:?}");
}
