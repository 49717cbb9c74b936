//! Workgroups with memory and barriers, many of them: random programs against the host's
//! arithmetic, and workgroups that wait for others.

use tuff_tests::*;

/// Settings of Tuff that must change nothing; others are the default. Other drivers do not know
/// them.
const SETTINGS: [&[(&str, &str)]; 6] = [
    &[],
    &[("TUFF_WAVE", "1"), ("TUFF_TIER", "portable")],
    &[
        ("TUFF_WAVE", "4"),
        ("TUFF_TIER", "avx2"),
        ("TUFF_THREADS", "4"),
    ],
    &[
        ("TUFF_WAVE", "16"),
        ("TUFF_TIER", "avx2"),
        ("TUFF_NATIVE", "0"),
    ],
    &[
        ("TUFF_THREADS", "1"),
        ("TUFF_TIER", "avx512"),
        ("TUFF_NATIVE", "0"),
    ],
    &[("TUFF_THREADS", "1"), ("TUFF_TIER", "portable")],
];

/// Runs a test in a process for each of the settings. True in those processes.
fn in_all_settings(test: &str) -> bool {
    SETTINGS.iter().any(|variables| alone(test, variables))
}

/// Numbers that an invocation has.
const NUMBERS: usize = 4;

/// Sums in a workgroup's memory.
const CELLS: usize = 8;

/// A step of a random program. All numbers are of 32 bits, and wrap.
enum Step {
    /// Computes a number from two others.
    Mix {
        to: usize,
        from: [usize; 2],
        factor: u32,
    },
    /// Shows a number to the workgroup, and takes that of another invocation.
    Exchange {
        numbers: [usize; 2],
        stride: u32,
        offset: u32,
    },
    /// Adds a number to a cell, and takes the sum in another one.
    Sum { numbers: [usize; 2] },
    /// Either one or the other, by a number of the invocation.
    Branch {
        number: usize,
        bodies: [Vec<Step>; 2],
    },
    /// As often as a number of the invocation says.
    Turns { number: usize, body: Vec<Step> },
    /// As often as the workgroup's number says.
    Loop { modulus: u32, body: Vec<Step> },
}

/// Random steps; those that meet at barriers only where all invocations of a workgroup come.
fn random_steps(random: &mut Rng, count: usize, depth: usize, meets: bool) -> Vec<Step> {
    let mut steps = Vec::new();
    for _ in 0..count {
        let number = random.usize(..NUMBERS);
        let numbers = [number, random.usize(..NUMBERS)];
        let inner = 1 + random.usize(..3);
        let step = match random.u32(..if depth == 0 { 6 } else { 10 }) {
            2 | 3 if meets => Step::Exchange {
                numbers,
                stride: random.u32(1..8),
                offset: random.u32(..1000),
            },
            4 | 5 if meets => Step::Sum { numbers },
            6 => Step::Branch {
                number,
                bodies: [(); 2].map(|()| random_steps(random, inner, depth - 1, false)),
            },
            7 => Step::Turns {
                number,
                body: random_steps(random, inner, depth - 1, false),
            },
            8 | 9 => Step::Loop {
                modulus: random.u32(1..6),
                body: random_steps(random, inner, depth - 1, meets),
            },
            _ => Step::Mix {
                to: random.usize(..NUMBERS),
                from: numbers,
                factor: random.u32(..) | 1,
            },
        };
        steps.push(step);
    }
    steps
}

/// GLSL of steps. `names` counts loops.
fn text(steps: &[Step], size: u32, names: &mut u32) -> String {
    let mut all = String::new();
    for step in steps {
        all += &match step {
            Step::Mix {
                to,
                from: [a, b],
                factor,
            } => format!("r[{to}] = r[{a}] * {factor}u + (r[{b}] ^ r[{b}] >> 7u);\n"),
            Step::Exchange {
                numbers: [a, b],
                stride,
                offset,
            } => format!(
                "shown[i] = r[{a}]; barrier();
                r[{b}] ^= shown[(i * {stride}u + {offset}u) % {size}u]; barrier();\n"
            ),
            Step::Sum { numbers: [a, b] } => format!(
                "atomicAdd(cells[r[{a}] % {CELLS}u], r[{a}] >> 3u); barrier();
                r[{b}] += cells[i % {CELLS}u]; barrier();\n"
            ),
            Step::Branch { number, bodies } => {
                let [first, second] = [0, 1].map(|k: usize| text(&bodies[k], size, names));
                format!("if ((r[{number}] & 4u) != 0u) {{\n{first}}} else {{\n{second}}}\n")
            }
            Step::Turns { number, body } => {
                *names += 1;
                let (k, body) = (*names, text(body, size, names));
                format!(
                    "for (uint k{k} = 0u, n{k} = r[{number}] & 7u; k{k} < n{k}; k{k}++) {{\n{body}}}\n"
                )
            }
            Step::Loop { modulus, body } => {
                *names += 1;
                let (k, body) = (*names, text(body, size, names));
                format!(
                    "for (uint k{k} = 0u; k{k} <= gl_WorkGroupID.x % {modulus}u; k{k}++) {{\n{body}}}\n"
                )
            }
        };
    }
    all
}

/// A workgroup on the host.
struct Workgroup {
    id: u32,
    /// By invocation.
    numbers: Vec<[u32; NUMBERS]>,
    cells: [u32; CELLS],
}

impl Workgroup {
    fn new(id: u32, size: u32) -> Self {
        let number = |i: u32, k: usize| (id * size + i).wrapping_mul(0x9e37_79b9) >> (5 * k);
        Self {
            id,
            numbers: (0..size)
                .map(|i| std::array::from_fn(|k| number(i, k)))
                .collect(),
            cells: [0; CELLS],
        }
    }

    /// Performs steps in some of its invocations, all of them where steps meet.
    fn perform(&mut self, steps: &[Step], active: &[usize]) {
        for step in steps {
            match step {
                Step::Mix {
                    to,
                    from: [a, b],
                    factor,
                } => {
                    for &i in active {
                        let r = &mut self.numbers[i];
                        r[*to] = (r[*a].wrapping_mul(*factor)).wrapping_add(r[*b] ^ r[*b] >> 7);
                    }
                }
                Step::Exchange {
                    numbers: [a, b],
                    stride,
                    offset,
                } => {
                    let shown: Vec<u32> = self.numbers.iter().map(|r| r[*a]).collect();
                    for &i in active {
                        let from = (i * *stride as usize + *offset as usize) % shown.len();
                        self.numbers[i][*b] ^= shown[from];
                    }
                }
                Step::Sum { numbers: [a, b] } => {
                    for &i in active {
                        let number = self.numbers[i][*a];
                        let cell = &mut self.cells[number as usize % CELLS];
                        *cell = cell.wrapping_add(number >> 3);
                    }
                    for &i in active {
                        let number = &mut self.numbers[i][*b];
                        *number = number.wrapping_add(self.cells[i % CELLS]);
                    }
                }
                Step::Branch { number, bodies } => {
                    let (first, second): (Vec<usize>, Vec<usize>) = active
                        .iter()
                        .partition(|&&i| self.numbers[i][*number] & 4 != 0);
                    self.perform(&bodies[0], &first);
                    self.perform(&bodies[1], &second);
                }
                Step::Turns { number, body } => {
                    for &i in active {
                        for _ in 0..self.numbers[i][*number] & 7 {
                            self.perform(body, &[i]);
                        }
                    }
                }
                Step::Loop { modulus, body } => {
                    for _ in 0..=self.id % modulus {
                        self.perform(body, active);
                    }
                }
            }
        }
    }
}

#[test]
fn random_programs_with_barriers() {
    if !in_all_settings("random_programs_with_barriers") {
        return;
    }
    let gpu = Gpu::new();
    let mut random = Rng::with_seed(46);
    for size in [1, 7, 16, 17, 32, 48, 64, 100, 128, 250, 384, 1024] {
        if size > gpu.limits.max_compute_work_group_invocations {
            continue;
        }
        let groups = 1 + random.u32(..(4000 / size).clamp(3, 50));
        let steps = random_steps(&mut random, 10, 2, true);
        let body = text(&steps, size, &mut 0);
        let source = format!(
            "layout(local_size_x = {size}) in;
            layout(set = 0, binding = 0) buffer Numbers {{ uint numbers[]; }};
            layout(set = 0, binding = 1) buffer Total {{ uint total; }};
            shared uint shown[{size}];
            shared uint cells[{CELLS}];
            void main() {{
                uint i = gl_LocalInvocationIndex, id = gl_WorkGroupID.x * {size}u + i;
                uint r[{NUMBERS}];
                for (uint k = 0u; k < {NUMBERS}u; k++) r[k] = id * 0x9e3779b9u >> (5u * k);
                if (i == 0u) for (uint k = 0u; k < {CELLS}u; k++) cells[k] = 0u;
                barrier();
                {body}
                for (uint k = 0u; k < {NUMBERS}u; k++) numbers[id * {NUMBERS}u + k] = r[k];
                atomicAdd(total, r[0]);
            }}"
        );
        let numbers = gpu.buffer(u64::from(groups * size) * NUMBERS as u64 * 4);
        let total = gpu.buffer_with(&[0u32]);
        gpu.compute(&source, &[numbers, total], [groups, 1, 1]);
        let all: Vec<usize> = (0..size as usize).collect();
        let mut expected = Vec::new();
        for id in 0..groups {
            let mut workgroup = Workgroup::new(id, size);
            workgroup.perform(&steps, &all);
            expected.extend(workgroup.numbers);
        }
        let sum = (expected.iter()).fold(0u32, |sum, numbers| sum.wrapping_add(numbers[0]));
        let numbers = numbers.read::<[u32; NUMBERS]>();
        let wrong = numbers
            .iter()
            .zip(&expected)
            .position(|(got, right)| got != right);
        assert_eq!(wrong, None, "{groups} workgroups of {size}:\n{source}");
        assert_eq!(total.read::<u32>(), [sum]);
    }
}

/// A prefix sum by decoupled look-back (Merrill and Garland 2016): each workgroup adds up what
/// those before it have told so far.
#[test]
fn workgroups_look_back() {
    if !in_all_settings("workgroups_look_back") {
        return;
    }
    let gpu = Gpu::new();
    const GROUPS: u32 = 200;
    let source = "
    layout(local_size_x = 64) in;
    layout(set = 0, binding = 0) buffer X { uint x[]; };
    layout(set = 0, binding = 1) buffer Y { uint y[]; };
    layout(set = 0, binding = 2) coherent buffer Parts { uint ticket; uint told[]; };
    shared uint part, before, scan[64];
    void main() {
        uint i = gl_LocalInvocationIndex;
        if (i == 0u) part = atomicAdd(ticket, 1u);
        barrier();
        scan[i] = x[part * 64u + i];
        barrier();
        for (uint step = 1u; step < 64u; step *= 2u) {
            uint add = i >= step ? scan[i - step] : 0u;
            barrier();
            scan[i] += add;
            barrier();
        }
        if (i == 63u) {
            // Two bits say whether a word is of one part or of all up to it.
            atomicExchange(told[part], (part == 0u ? 2u : 1u) << 30u | scan[63]);
            uint sum = 0u;
            int p = int(part) - 1;
            while (p >= 0) {
                uint word = atomicOr(told[p], 0u);
                if (word >> 30u == 0u) continue;
                sum += word & 0x3fffffffu;
                if (word >> 30u == 2u) break;
                p--;
            }
            if (part != 0u) atomicExchange(told[part], 2u << 30u | (sum + scan[63]));
            before = sum;
        }
        barrier();
        y[part * 64u + i] = before + scan[i];
    }";
    let x: Vec<u32> = (0..GROUPS * 64).map(|i| i * i % 1009).collect();
    let sums = gpu.buffer(u64::from(GROUPS) * 64 * 4);
    let parts = gpu.buffer_with(&vec![0u32; GROUPS as usize + 1]);
    gpu.compute(source, &[gpu.buffer_with(&x), sums, parts], [GROUPS, 1, 1]);
    let mut sum = 0;
    for (i, (x, y)) in x.iter().zip(sums.read::<u32>()).enumerate() {
        sum += x;
        assert_eq!(y, sum, "{i}");
    }
}

/// One workgroup at a time holds a lock, while the others spin.
#[test]
fn workgroups_spin_for_a_lock() {
    if !in_all_settings("workgroups_spin_for_a_lock") {
        return;
    }
    let gpu = Gpu::new();
    const GROUPS: u32 = 150;
    let source = "
    layout(local_size_x = 32) in;
    layout(set = 0, binding = 0) coherent buffer Lock { uint held; uint count; uint order[]; };
    layout(set = 0, binding = 1) buffer Places { uint places[]; };
    shared uint place;
    void main() {
        if (gl_LocalInvocationIndex == 0u) {
            while (atomicCompSwap(held, 0u, 1u) != 0u) {}
            memoryBarrierBuffer();
            place = count;
            order[place] = gl_WorkGroupID.x;
            count = place + 1u;
            memoryBarrierBuffer();
            atomicExchange(held, 0u);
        }
        barrier();
        places[gl_GlobalInvocationID.x] = place;
    }";
    let lock = gpu.buffer_with(&vec![0u32; GROUPS as usize + 2]);
    let places = gpu.buffer(u64::from(GROUPS) * 32 * 4);
    gpu.compute(source, &[lock, places], [GROUPS, 1, 1]);
    let words = lock.read::<u32>();
    assert_eq!(words[..2], [0, GROUPS]);
    let places = places.read::<u32>();
    let mut seen = vec![false; GROUPS as usize];
    for (place, &group) in words[2..].iter().enumerate() {
        assert!(!std::mem::replace(&mut seen[group as usize], true));
        let of_group = &places[32 * group as usize..][..32];
        assert!(of_group.iter().all(|it| *it == place as u32), "{group}");
    }
}

/// Workgroups of even numbers put items into a queue, those of odd numbers take one each, and spin
/// until it is there.
#[test]
fn workgroups_wait_for_items_of_a_queue() {
    if !in_all_settings("workgroups_wait_for_items_of_a_queue") {
        return;
    }
    let gpu = Gpu::new();
    const ITEMS: u32 = 90;
    let source = "
    layout(local_size_x = 48) in;
    layout(set = 0, binding = 0) coherent buffer Queue { uint head, tail, items[]; };
    layout(set = 0, binding = 1) buffer Taken { uint taken[]; };
    shared uint item, terms[48];
    void main() {
        uint i = gl_LocalInvocationIndex, group = gl_WorkGroupID.x;
        if (group % 2u == 0u) {
            terms[i] = group * i + 1u;
            barrier();
            if (i == 0u) {
                uint sum = 0u;
                for (uint k = 0u; k < 48u; k++) sum += terms[k];
                atomicExchange(items[atomicAdd(tail, 1u)], sum);
            }
        } else {
            if (i == 0u) {
                uint at = atomicAdd(head, 1u);
                do item = atomicExchange(items[at], 0u); while (item == 0u);
            }
            barrier();
            taken[group / 2u * 48u + i] = item + i;
        }
    }";
    let queue = gpu.buffer_with(&vec![0u32; ITEMS as usize + 2]);
    let taken = gpu.buffer(u64::from(ITEMS) * 48 * 4);
    gpu.compute(source, &[queue, taken], [2 * ITEMS, 1, 1]);
    let words = queue.read::<u32>();
    assert_eq!(words[..2], [ITEMS, ITEMS]);
    assert!(words[2..].iter().all(|item| *item == 0), "all are taken");
    let mut sums: Vec<u32> = Vec::new();
    for invocations in taken.read::<[u32; 48]>() {
        let sum = invocations[0];
        assert_eq!(invocations, std::array::from_fn(|i| sum + i as u32));
        sums.push(sum);
    }
    sums.sort_unstable();
    let of_group = |group: u32| group * (47 * 48 / 2) + 48;
    assert!(sums.into_iter().eq((0..ITEMS).map(|k| of_group(2 * k))));
}
