//! Compiling takes memory and time by the size of the module, whatever grows in it: values that
//! live over many back-edges, values that all live at once, phis of many predecessors, calls with
//! much alive.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use effort::thread_time;
use shaders::request;
use spirv_jit::program::Stage;

/// Counts what each thread allocates.
struct Counting;

thread_local! {
    /// Bytes that are allocated, and the most that were.
    static NOW: Cell<i64> = const { Cell::new(0) };
    static MOST: Cell<i64> = const { Cell::new(0) };
}

fn count(bytes: i64) {
    // After the end of a thread nothing is counted.
    let _ = NOW.try_with(|now| {
        now.set(now.get() + bytes);
        let _ = MOST.try_with(|most| most.set(most.get().max(now.get())));
    });
}

// SAFETY: the system's allocator does it all.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as i64);
        // SAFETY: the caller keeps the contract of `GlobalAlloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, start: *mut u8, layout: Layout) {
        count(-(layout.size() as i64));
        // SAFETY: the caller keeps the contract of `GlobalAlloc`.
        unsafe { System.dealloc(start, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// A module of one compute shader, as words.
struct Words {
    next: u32,
    types: Vec<u32>,
    code: Vec<u32>,
}

// Ids that every module has.
const MAIN: u32 = 1;
const VOID: u32 = 2;
const FUNCTION: u32 = 3;
const UINT: u32 = 4;
const BOOL: u32 = 5;
const ZERO: u32 = 6;
const ONE: u32 = 7;
const BLOCK: u32 = 8;
const ARRAY: u32 = 9;
const TO_BLOCK: u32 = 10;
const TO_UINT: u32 = 11;
const BUFFER: u32 = 12;
const PLACE: u32 = 13;
const VARIABLE: u32 = 14;
const FIRST: u32 = 15;

fn put(to: &mut Vec<u32>, opcode: u32, operands: &[u32]) {
    to.push((operands.len() as u32 + 1) << 16 | opcode);
    to.extend(operands);
}

impl Words {
    fn new() -> Words {
        Words {
            next: FIRST,
            types: Vec::new(),
            code: Vec::new(),
        }
    }

    fn id(&mut self) -> u32 {
        self.next += 1;
        self.next - 1
    }

    fn put(&mut self, opcode: u32, operands: &[u32]) {
        put(&mut self.code, opcode, operands);
    }

    /// An instruction with a result of type `uint`.
    fn give(&mut self, opcode: u32, operands: &[u32]) -> u32 {
        let id = self.id();
        self.put(opcode, &[&[UINT, id], operands].concat());
        id
    }

    fn load(&mut self, from: u32) -> u32 {
        self.give(61, &[from])
    }

    fn add(&mut self, a: u32, b: u32) -> u32 {
        self.give(128, &[a, b])
    }

    fn store(&mut self, to: u32, value: u32) {
        self.put(62, &[to, value]);
    }

    /// A word of the buffer is not zero.
    fn condition(&mut self) -> u32 {
        let (word, id) = (self.load(PLACE), self.id());
        self.put(171, &[BOOL, id, word, ZERO]);
        id
    }

    fn label(&mut self, id: u32) {
        self.put(248, &[id]);
    }

    /// A loop that repeats its body while a word of the buffer is zero.
    fn repeat(&mut self, body: impl FnOnce(&mut Words)) {
        let [header, inside, next, after] = [(); 4].map(|()| self.id());
        self.put(249, &[header]);
        self.label(header);
        self.put(246, &[after, next, 0]);
        self.put(249, &[inside]);
        self.label(inside);
        body(self);
        self.put(249, &[next]);
        self.label(next);
        let condition = self.condition();
        self.put(250, &[condition, after, header]);
        self.label(after);
    }

    /// The module, whose entry has variables first, then what was put.
    fn finish(mut self, variables: &[u32]) -> Vec<u32> {
        self.put(253, &[]);
        self.put(56, &[]);
        let mut words = vec![0x0723_0203, 0x0001_0300, 0, self.next, 0];
        put(&mut words, 17, &[1]);
        put(&mut words, 14, &[0, 1]);
        put(&mut words, 15, &[5, MAIN, u32::from_le_bytes(*b"main"), 0]);
        put(&mut words, 16, &[MAIN, 17, 1, 1, 1]);
        put(&mut words, 71, &[BUFFER, 34, 0]);
        put(&mut words, 71, &[BUFFER, 33, 0]);
        put(&mut words, 71, &[BLOCK, 2]);
        put(&mut words, 71, &[ARRAY, 6, 4]);
        put(&mut words, 72, &[BLOCK, 0, 35, 0]);
        put(&mut words, 19, &[VOID]);
        put(&mut words, 33, &[FUNCTION, VOID]);
        put(&mut words, 21, &[UINT, 32, 0]);
        put(&mut words, 20, &[BOOL]);
        put(&mut words, 29, &[ARRAY, UINT]);
        put(&mut words, 30, &[BLOCK, ARRAY]);
        put(&mut words, 32, &[TO_BLOCK, 12, BLOCK]);
        put(&mut words, 32, &[TO_UINT, 12, UINT]);
        put(&mut words, 32, &[VARIABLE, 7, UINT]);
        put(&mut words, 59, &[TO_BLOCK, BUFFER, 12]);
        put(&mut words, 43, &[UINT, ZERO, 0]);
        put(&mut words, 43, &[UINT, ONE, 1]);
        words.extend(&self.types);
        put(&mut words, 54, &[VOID, MAIN, 0, FUNCTION]);
        put(&mut words, 248, &[self.next]);
        words[3] += 1;
        for &variable in variables {
            put(&mut words, 59, &[VARIABLE, variable, 7]);
        }
        put(&mut words, 65, &[TO_UINT, PLACE, BUFFER, ZERO, ZERO]);
        words.extend(&self.code);
        words
    }

    /// Adds up and stores.
    fn sum(&mut self, values: &[u32]) {
        let sum = values
            .iter()
            .rev()
            .fold(ZERO, |sum, &value| self.add(sum, value));
        self.store(PLACE, sum);
    }
}

/// Variables that live over as many loops, each of which changes one.
fn over_loops(count: u32) -> Vec<u32> {
    let mut words = Words::new();
    let variables: Vec<u32> = (0..count).map(|_| words.id()).collect();
    for &variable in &variables {
        words.store(variable, ONE);
    }
    for i in 0..count {
        let other = variables[(7 * i + 1) as usize % variables.len()];
        words.repeat(|words| {
            let value = words.load(variables[i as usize]);
            let changed = words.add(value, ONE);
            words.store(other, changed);
        });
    }
    let values: Vec<u32> = variables
        .iter()
        .map(|&variable| words.load(variable))
        .collect();
    words.sum(&values);
    words.finish(&variables)
}

/// Values that all live at once.
fn at_once(count: u32) -> Vec<u32> {
    let mut words = Words::new();
    let mut values = vec![ONE];
    for i in 0..count as usize {
        let loaded = words.load(PLACE);
        let value = words.add(loaded, values[i]);
        values.push(value);
    }
    words.sum(&values);
    words.finish(&[])
}

/// A switch of many cases, after which a few phis meet.
fn at_phis(count: u32) -> Vec<u32> {
    let mut words = Words::new();
    let (selector, after) = (words.load(PLACE), words.id());
    let cases: Vec<u32> = (0..count).map(|_| words.id()).collect();
    let literals = (0..count).flat_map(|i| [i, cases[i as usize]]);
    let literals: Vec<u32> = literals.collect();
    words.put(247, &[after, 0]);
    words.put(251, &[&[selector, cases[0]], &literals[..]].concat());
    for &case in &cases {
        words.label(case);
        words.put(249, &[after]);
    }
    words.label(after);
    let values: Vec<u32> = (0..10)
        .map(|k| {
            let value = [ZERO, ONE][k % 2];
            let pairs: Vec<u32> = cases.iter().flat_map(|&case| [value, case]).collect();
            words.give(245, &pairs)
        })
        .collect();
    words.sum(&values);
    words.finish(&[])
}

/// Values that live over as many barriers.
fn over_barriers(count: u32) -> Vec<u32> {
    let mut words = Words::new();
    let scope = words.id();
    put(&mut words.types, 43, &[UINT, scope, 2]);
    let loaded = words.load(PLACE);
    let mut values = vec![ONE];
    for i in 0..count as usize {
        let value = words.add(loaded, values[i]);
        values.push(value);
    }
    for &value in &values {
        words.put(224, &[scope, scope, ZERO]);
        words.store(PLACE, value);
    }
    words.sum(&values);
    words.finish(&[])
}

/// Seconds of processor time over which compiling is measured: clocks of Windows may count 64ths.
const MEASURED: f64 = 0.1;

/// The most memory and the processor time of compiling.
fn cost(words: &[u32]) -> (f64, f64) {
    shaders::code_pages::allow_native_code();
    let mut least = (f64::INFINITY, f64::INFINITY);
    for _ in 0..2 {
        let (start, before) = (thread_time(), NOW.get());
        MOST.set(before);
        let (mut times, mut spent) = (0.0, 0.0);
        while spent < MEASURED {
            let program = spirv_jit::compile(&request(Stage::Compute, words));
            program.expect("the module is taken");
            times += 1.0;
            spent = (thread_time() - start).as_secs_f64();
        }
        let time = spent / times;
        least = (least.0.min((MOST.get() - before) as f64), least.1.min(time));
    }
    least
}

#[test]
fn memory_and_time_follow_the_size_of_the_module() {
    let kinds: [(&str, u32, fn(u32) -> Vec<u32>); 4] = [
        ("values over loops", 150, over_loops),
        ("values at once", 2000, at_once),
        ("phis", 200, at_phis),
        ("values over barriers", 150, over_barriers),
    ];
    for (name, count, module) in kinds {
        let costs = [1, 4, 16].map(|times| {
            let words = module(times * count);
            let (memory, time) = cost(&words);
            (words.len() as f64, memory, time)
        });
        let (size, memory, time) = costs[0];
        for (larger, its_memory, its_time) in costs {
            let growth = larger / size;
            let (memory, time) = (its_memory / memory, its_time / time);
            println!("{name}: {growth:.1} times as large: memory {memory:.1}, time {time:.1}");
            assert!(
                memory < 1.6 * growth,
                "{name}: memory {memory:.1} for {growth:.1}"
            );
            // Quadratic growth takes sixteen times as long for each four.
            assert!(
                time < 3.0 * growth,
                "{name}: time {time:.1} for {growth:.1}"
            );
        }
    }
}
