//! Which invocations of a subgroup run together: random structured programs, against the rule of
//! maximal reconvergence carried out on the host.

use std::fmt::Write;

use tuff_tests::*;

/// Words that an invocation may note.
const ROOM: usize = 400;

/// `(lane * a + counter * b) % m < c`; the counter is that of the innermost loop.
#[derive(Clone, Copy)]
struct Condition {
    a: u32,
    b: u32,
    m: u32,
    c: u32,
}

impl Condition {
    fn text(self, depth: u32) -> String {
        let Condition { a, b, m, c } = self;
        let counter = match depth {
            0 => "0u".to_owned(),
            _ => format!("i{depth}"),
        };
        format!("((lane * {a}u + {counter} * {b}u) % {m}u < {c}u)")
    }

    fn holds(self, lane: u32, counter: u32) -> bool {
        (lane * self.a + counter * self.b) % self.m < self.c
    }
}

enum Statement {
    /// Notes who is here.
    Note,
    If(Condition, Vec<Statement>, Vec<Statement>),
    /// So many turns: `1 + lane % n`.
    Loop(u32, Vec<Statement>),
    /// By `lane % cases`.
    Switch(Vec<Vec<Statement>>),
    Break(Condition),
    Continue(Condition),
    Return(Condition),
    /// In the one invocation that is elected.
    Elect(Vec<Statement>),
}

struct Generator {
    random: Rng,
    budget: u32,
}

impl Generator {
    fn condition(&mut self) -> Condition {
        let m = 2 + self.random.u32(..6);
        Condition {
            a: 1 + self.random.u32(..5),
            b: self.random.u32(..4),
            m,
            c: 1 + self.random.u32(..m - 1),
        }
    }

    /// `in_loop`: breaks and continues lead to a loop, not out of a switch.
    fn list(&mut self, depth: u32, in_loop: bool) -> Vec<Statement> {
        let mut list = vec![Statement::Note];
        for _ in 0..1 + self.random.u32(..3) {
            if self.budget == 0 {
                break;
            }
            self.budget -= 1;
            let nested = depth < 4;
            list.push(match self.random.u32(..12) {
                0..3 if nested => {
                    let condition = self.condition();
                    let then = self.list(depth + 1, in_loop);
                    let other = match self.random.u32(..2) {
                        0 => Vec::new(),
                        _ => self.list(depth + 1, in_loop),
                    };
                    Statement::If(condition, then, other)
                }
                3..6 if nested => {
                    let turns = 1 + self.random.u32(..4);
                    Statement::Loop(turns, self.list(depth + 1, true))
                }
                6 if nested => {
                    let count = 2 + self.random.u32(..3);
                    let cases = (0..count).map(|_| self.list(depth + 1, false));
                    Statement::Switch(cases.collect())
                }
                7 if nested => Statement::Elect(self.list(depth + 1, in_loop)),
                8 | 9 if in_loop => Statement::Break(self.condition()),
                10 if in_loop => Statement::Continue(self.condition()),
                11 if self.random.u32(..3) == 0 => Statement::Return(self.condition()),
                _ => Statement::Note,
            });
            list.push(Statement::Note);
        }
        list
    }
}

/// GLSL of a list; `loops` counts the loops around it.
fn write_list(list: &[Statement], loops: u32, text: &mut String) {
    for statement in list {
        let put = |text: &mut String, condition: &Condition, what: &str| {
            let _ = writeln!(text, "if {} {what};", condition.text(loops));
        };
        match statement {
            Statement::Note => *text += "note();\n",
            Statement::If(condition, then, other) => {
                let _ = writeln!(text, "if {} {{", condition.text(loops));
                write_list(then, loops, text);
                if !other.is_empty() {
                    *text += "} else {\n";
                    write_list(other, loops, text);
                }
                *text += "}\n";
            }
            Statement::Loop(turns, body) => {
                let i = format!("i{}", loops + 1);
                let head = format!("for (uint {i} = 0; {i} < 1u + lane % {turns}u; {i}++) {{");
                let _ = writeln!(text, "{head}");
                write_list(body, loops + 1, text);
                *text += "}\n";
            }
            Statement::Switch(cases) => {
                let _ = writeln!(text, "switch (lane % {}u) {{", cases.len());
                for (index, body) in cases.iter().enumerate() {
                    let _ = writeln!(text, "case {index}u: {{");
                    write_list(body, loops, text);
                    *text += "} break;\n";
                }
                *text += "}\n";
            }
            Statement::Break(condition) => put(text, condition, "break"),
            Statement::Continue(condition) => put(text, condition, "continue"),
            Statement::Return(condition) => put(text, condition, "return"),
            Statement::Elect(body) => {
                *text += "if (subgroupElect()) {\n";
                write_list(body, loops, text);
                *text += "}\n";
            }
        }
    }
}

/// The notes of each lane of a subgroup.
struct Machine {
    lanes: u32,
    notes: Vec<Vec<u32>>,
}

/// Lanes that left for the loop's end and its next turn.
#[derive(Default)]
struct Parted {
    broken: u32,
    continued: u32,
}

impl Machine {
    fn lanes_where(&self, active: u32, condition: impl Fn(u32) -> bool) -> u32 {
        (0..self.lanes)
            .filter(|lane| active >> lane & 1 != 0 && condition(*lane))
            .fold(0, |mask, lane| mask | 1 << lane)
    }

    /// Runs a list in these lanes; those that come out at its end.
    fn run(&mut self, list: &[Statement], mut active: u32, turn: u32, parted: &mut Parted) -> u32 {
        for statement in list {
            if active == 0 {
                break;
            }
            match statement {
                Statement::Note => {
                    for lane in 0..self.lanes {
                        if active >> lane & 1 != 0 {
                            self.notes[lane as usize].push(active);
                        }
                    }
                }
                Statement::If(condition, then, other) => {
                    let taken = self.lanes_where(active, |lane| condition.holds(lane, turn));
                    let rest = active & !taken;
                    active = self.run(then, taken, turn, parted);
                    active |= self.run(other, rest, turn, parted);
                }
                Statement::Elect(body) => {
                    let elected = active & active.wrapping_neg();
                    let rest = active & !elected;
                    active = self.run(body, elected, turn, parted) | rest;
                }
                Statement::Loop(turns, body) => {
                    let mut out = 0;
                    for turn in 0.. {
                        let inside = self.lanes_where(active, |lane| turn < 1 + lane % turns);
                        out |= active & !inside;
                        if inside == 0 {
                            break;
                        }
                        let mut inner = Parted::default();
                        active = self.run(body, inside, turn, &mut inner) | inner.continued;
                        out |= inner.broken;
                    }
                    active = out;
                }
                Statement::Switch(cases) => {
                    let count = cases.len() as u32;
                    let mut out = 0;
                    for (index, body) in cases.iter().enumerate() {
                        let inside = self.lanes_where(active, |lane| lane % count == index as u32);
                        out |= self.run(body, inside, turn, parted);
                    }
                    active = out;
                }
                Statement::Break(condition) => {
                    let leaving = self.lanes_where(active, |lane| condition.holds(lane, turn));
                    parted.broken |= leaving;
                    active &= !leaving;
                }
                Statement::Continue(condition) => {
                    let leaving = self.lanes_where(active, |lane| condition.holds(lane, turn));
                    parted.continued |= leaving;
                    active &= !leaving;
                }
                Statement::Return(condition) => {
                    active &= !self.lanes_where(active, |lane| condition.holds(lane, turn));
                }
            }
        }
        active
    }
}

#[test]
fn invocations_meet_again_as_early_as_they_may() {
    // Validation layers may be older than the extension.
    let gpu = Gpu::without_validation();
    let feature = gpu.optional.maximal_reconvergence;
    let there = feature.shader_maximal_reconvergence == vk::TRUE;
    if !has("VK_KHR_shader_maximal_reconvergence", there) {
        return;
    }
    let mut properties = vk::PhysicalDeviceVulkan11Properties::default();
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut properties);
    // SAFETY: the physical device is of this instance.
    unsafe {
        gpu.instance
            .get_physical_device_properties2(gpu.physical, &mut all);
    }
    let lanes = properties.subgroup_size.min(32);
    for seed in 0..40 {
        let mut generator = Generator {
            random: Rng::with_seed(seed),
            budget: 14,
        };
        let program = generator.list(0, false);
        let mut machine = Machine {
            lanes,
            notes: vec![Vec::new(); lanes as usize],
        };
        machine.run(
            &program,
            (((1u64) << lanes) - 1) as u32,
            0,
            &mut Parted::default(),
        );
        if machine.notes.iter().any(|notes| notes.len() >= ROOM) {
            continue;
        }
        let mut body = String::new();
        write_list(&program, 0, &mut body);
        let source = format!(
            r"
            #extension GL_KHR_shader_subgroup_ballot : enable
            #extension GL_EXT_maximal_reconvergence : enable
            layout(local_size_x = {lanes}) in;
            layout(set = 0, binding = 0, std430) buffer Notes {{ uint notes[][{ROOM}]; }};
            uint lane = gl_SubgroupInvocationID, count = 0;
            void note() {{ notes[lane][1 + count++] = subgroupBallot(true).x; notes[lane][0] = count; }}
            void main() [[maximally_reconverges]] {{
                {body}
            }}"
        );
        let buffer = gpu.buffer_with(&vec![0u32; lanes as usize * ROOM]);
        gpu.compute(&source, &[buffer], [1, 1, 1]);
        let words: Vec<u32> = buffer.read();
        for (lane, (got, expected)) in words.chunks(ROOM).zip(&machine.notes).enumerate() {
            let got = &got[1..1 + got[0] as usize];
            assert_eq!(got, expected, "program {seed}, lane {lane}:\n{body}");
        }
    }
}

#[test]
fn quads_vote() {
    let gpu = Gpu::without_validation();
    let there = gpu.optional.quad_control.shader_quad_control == vk::TRUE;
    if !has("VK_KHR_shader_quad_control", there) {
        return;
    }
    let source = r"
    #extension GL_KHR_shader_subgroup_basic : enable
    #extension GL_KHR_shader_subgroup_vote : enable
    #extension GL_EXT_shader_quad_control : enable
    layout(local_size_x = 64) in;
    layout(set = 0, binding = 0, std430) buffer Results { uint results[]; };
    void main() {
        uint lane = gl_SubgroupInvocationID;
        uint quad = lane / 4;
        bool some = subgroupQuadAny(lane % 4 == quad);
        bool all = subgroupQuadAll(lane % 4 != 0 || quad % 2 == 0);
        // 1 where any and all are as the lane's number says.
        results[gl_GlobalInvocationID.x] = uint(some == (quad < 4) && all == (quad % 2 == 0));
    }";
    let buffer = gpu.buffer_with(&[0u32; 64]);
    gpu.compute(source, &[buffer], [1, 1, 1]);
    assert_eq!(buffer.read::<u32>(), [1; 64]);
}

#[test]
fn ballots_are_searched_among_the_lanes_that_there_are() {
    let gpu = Gpu::without_validation();
    let source = r"
    #extension GL_KHR_shader_subgroup_ballot : enable
    layout(local_size_x = 64) in;
    layout(set = 0, binding = 0, std430) buffer Results { uint results[]; };
    void main() {
        uvec4 all = uvec4(0xffffffffu);
        bool most = subgroupBallotFindMSB(all) == gl_SubgroupSize - 1u;
        bool least = subgroupBallotFindLSB(all) == 0u;
        bool count = subgroupBallotBitCount(all) == gl_SubgroupSize;
        results[gl_GlobalInvocationID.x] = uint(most && least && count);
    }";
    let buffer = gpu.buffer_with(&[0u32; 64]);
    gpu.compute(source, &[buffer], [1, 1, 1]);
    assert_eq!(buffer.read::<u32>(), [1; 64]);
}
