//! Arms that meet before the merge block of their selection. SPIR-V asks that a merge block is
//! dominated by its header and that a construct is entered through its header alone, not that arms
//! are apart until they come to the merge block.

use rspirv::spirv::{LoopControl, Op, SelectionControl};

use crate::assembler::Assembler;
use crate::expect;

const NO_CONTROL: u32 = SelectionControl::NONE.bits();

/// Whether the word that was read is greater than a number.
fn exceeds(a: &mut Assembler, number: usize) -> u32 {
    a.make(a.bool, Op::UGreaterThan, &[a.given, a.numbers[number]])
}

/// `x > 5 ? x * 2 : (x + 100) * 2`, the product behind the place where both sides meet.
#[test]
fn arms_meet_in_a_phi() {
    let mut a = Assembler::new();
    a.read();
    let hundred = a.number(100);
    let condition = exceeds(&mut a, 5);
    let [entry, otherwise, meet, merge] = [(); 4].map(|()| a.id());
    a.act(Op::Branch, &[entry]);
    a.label(entry);
    a.act(Op::SelectionMerge, &[merge, NO_CONTROL]);
    a.act(Op::BranchConditional, &[condition, meet, otherwise]);
    a.label(otherwise);
    let sum = a.make(a.word, Op::IAdd, &[a.given, hundred]);
    a.act(Op::Branch, &[meet]);
    a.label(meet);
    let phi = a.make(a.word, Op::Phi, &[a.given, entry, sum, otherwise]);
    let result = a.make(a.word, Op::IMul, &[phi, a.numbers[2]]);
    a.act(Op::Branch, &[merge]);
    a.label(merge);
    expect(
        &a.finish(result),
        &[(1, 202), (8, 16), (3, 206), (100, 200)],
    );
}

/// A place where arms meet behind which the arms of another selection do, and before it a selection
/// in one of the arms that has a merge block.
#[test]
fn places_where_arms_meet_nest() {
    let mut a = Assembler::new();
    let counter = a.counter();
    a.read();
    let [
        high,
        low,
        inside,
        joined,
        meet,
        even,
        odd,
        again,
        end,
        merge,
    ] = [(); 10].map(|()| a.id());
    let exceeds_five = exceeds(&mut a, 5);
    a.act(Op::SelectionMerge, &[merge, NO_CONTROL]);
    a.act(Op::BranchConditional, &[exceeds_five, high, low]);
    a.label(high);
    let exceeds_eight = exceeds(&mut a, 8);
    a.act(Op::SelectionMerge, &[joined, NO_CONTROL]);
    a.act(Op::BranchConditional, &[exceeds_eight, inside, joined]);
    a.label(inside);
    a.add(counter, a.numbers[1]);
    a.act(Op::Branch, &[joined]);
    a.label(joined);
    a.add(counter, a.numbers[2]);
    a.act(Op::Branch, &[meet]);
    a.label(low);
    a.add(counter, a.numbers[9]);
    a.act(Op::Branch, &[meet]);
    a.label(meet);
    let bit = a.make(a.word, Op::BitwiseAnd, &[a.given, a.numbers[1]]);
    let is_odd = a.make(a.bool, Op::INotEqual, &[bit, a.numbers[0]]);
    a.act(Op::SelectionMerge, &[end, NO_CONTROL]);
    a.act(Op::BranchConditional, &[is_odd, odd, even]);
    a.label(odd);
    a.add(counter, a.numbers[4]);
    a.act(Op::Branch, &[again]);
    a.label(even);
    a.add(counter, a.numbers[5]);
    a.act(Op::Branch, &[again]);
    a.label(again);
    let doubled = a.make(a.word, Op::Load, &[counter]);
    a.add(counter, doubled);
    a.act(Op::Branch, &[end]);
    a.label(end);
    a.act(Op::Branch, &[merge]);
    a.label(merge);
    let words = a.finish_counter(counter);
    let cases = [
        (9, 2 * (1 + 2 + 4)),
        (10, 2 * (1 + 2 + 5)),
        (6, 2 * (2 + 5)),
        (7, 2 * (2 + 4)),
        (1, 2 * (9 + 4)),
        (0, 2 * (9 + 5)),
    ];
    expect(&words, &cases);
}

/// Inside a loop: arms that meet, where one of them may leave the loop and one may start it again.
/// Sums 1 for each turn, and 2 for turns that come to the place where arms meet.
#[test]
fn arms_meet_in_a_loop() {
    let mut a = Assembler::new();
    let (counter, turns) = (a.counter(), a.counter());
    a.read();
    let [header, body, odd, even, meet, after, target, merge] = [(); 8].map(|()| a.id());
    a.act(Op::Branch, &[header]);
    a.label(header);
    a.act(Op::LoopMerge, &[merge, target, LoopControl::NONE.bits()]);
    a.act(Op::Branch, &[body]);
    a.label(body);
    a.count(turns);
    a.count(counter);
    let turn = a.make(a.word, Op::Load, &[turns]);
    let bit = a.make(a.word, Op::BitwiseAnd, &[turn, a.numbers[1]]);
    let is_odd = a.make(a.bool, Op::INotEqual, &[bit, a.numbers[0]]);
    a.act(Op::SelectionMerge, &[after, NO_CONTROL]);
    a.act(Op::BranchConditional, &[is_odd, odd, even]);
    a.label(odd);
    let done = a.make(a.bool, Op::UGreaterThan, &[turn, a.given]);
    a.act(Op::BranchConditional, &[done, merge, meet]);
    a.label(even);
    let third = a.make(a.word, Op::UMod, &[turn, a.numbers[4]]);
    let skips = a.make(a.bool, Op::IEqual, &[third, a.numbers[0]]);
    a.act(Op::BranchConditional, &[skips, target, meet]);
    a.label(meet);
    a.add(counter, a.numbers[2]);
    a.act(Op::Branch, &[after]);
    a.label(after);
    a.act(Op::Branch, &[target]);
    a.label(target);
    a.act(Op::Branch, &[header]);
    a.label(merge);
    let words = a.finish_counter(counter);
    let model = |given: u32| {
        let (mut sum, mut turn) = (0, 0);
        loop {
            turn += 1;
            sum += 1;
            match turn % 4 {
                1 | 3 if turn > given => return sum,
                0 => {}
                _ => sum += 2,
            }
        }
    };
    let cases = [0, 1, 2, 3, 4, 5, 20].map(|given| (given, model(given)));
    expect(&words, &cases);
}
