//! A function's control flow graph, as its terminators say it.

use foldhash::HashMap;

use rspirv::spirv::Op;
use smallvec::SmallVec;

use crate::Error;
use crate::parse::{Block, Function, Id, ParsedModule};

/// A block of the SPIR-V function.
pub(super) type BlockIndex = usize;

/// The target of cases, and the selector's values that lead there.
pub(super) type SwitchCase = (BlockIndex, Vec<u64>);

#[derive(Clone, Copy)]
pub(super) struct Flow<'a> {
    pub module: &'a ParsedModule,
    pub function: &'a Function,
}

impl<'a> Flow<'a> {
    pub fn block(self, index: BlockIndex) -> &'a Block {
        &self.function.blocks[index]
    }

    /// A block by its label, if there is one.
    pub fn index(self, label: Id) -> Option<BlockIndex> {
        self.function.block_index.get(&label).copied()
    }

    /// The block that another one branches to.
    pub fn find(self, at: BlockIndex, label: Id) -> Result<BlockIndex, Error> {
        self.index(label).ok_or_else(|| {
            let offset = self.block(at).offset;
            Error::invalid(offset, format!("branch to {label}, which is no block here"))
        })
    }

    /// Opcode and operands of a block's last instruction.
    pub fn terminator(self, block: BlockIndex) -> (Op, &'a [u32]) {
        let instruction = self.module.instruction(self.block(block).terminator);
        (instruction.opcode, self.module.operands(instruction))
    }

    /// The blocks that a block branches to, each once.
    pub fn successors(self, block: BlockIndex) -> SmallVec<[BlockIndex; 4]> {
        let (opcode, operands) = self.terminator(block);
        let index = |&label: &Id| self.index(label);
        let mut targets: SmallVec<[BlockIndex; 4]> = match opcode {
            Op::Branch => operands[..1].iter().filter_map(index).collect(),
            Op::BranchConditional => operands[1..3].iter().filter_map(index).collect(),
            Op::Switch => {
                let cases = self.switch_cases(block).map(|case| case.1);
                let labels = cases.chain([operands[1]]);
                labels.filter_map(|label| self.index(label)).collect()
            }
            _ => SmallVec::new(),
        };
        if targets.len() > 1 {
            targets.sort_unstable();
            targets.dedup();
        }
        targets
    }

    /// Words of a case literal: two if the selector has 64 bits.
    fn literal_words(self, block: BlockIndex) -> usize {
        let instruction = self.module.instruction(self.block(block).terminator);
        let uses = self.module.uses(instruction).len();
        let operands = self.module.operands(instruction).len();
        // Selector, default and one label a case are ids; the rest is literals.
        let cases = uses.saturating_sub(2);
        if cases > 0 && operands >= 2 + 3 * cases {
            2
        } else {
            1
        }
    }

    fn switch_cases(self, block: BlockIndex) -> impl Iterator<Item = (u64, Id)> {
        let (_, operands) = self.terminator(block);
        let width = self.literal_words(block);
        operands[2..].chunks_exact(width + 1).map(move |case| {
            let high = if width == 2 { case[1] as u64 } else { 0 };
            (case[0] as u64 | high << 32, case[width])
        })
    }

    /// The default of a switch, and its cases, those with one target put together.
    pub fn switch(self, at: BlockIndex) -> Result<(BlockIndex, Vec<SwitchCase>), Error> {
        let (_, operands) = self.terminator(at);
        let default = self.find(at, operands[1])?;
        let mut cases: Vec<SwitchCase> = Vec::new();
        let mut places: HashMap<BlockIndex, usize> = HashMap::default();
        for (literal, label) in self.switch_cases(at) {
            let target = self.find(at, label)?;
            let place = *places.entry(target).or_insert_with(|| {
                cases.push((target, Vec::new()));
                cases.len() - 1
            });
            cases[place].1.push(literal);
        }
        Ok((default, cases))
    }
}
