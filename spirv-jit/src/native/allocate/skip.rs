//! Regions of a turn that code jumps over where no lane comes to them. Code behind a region finds
//! all values where the region leaves them: the way over it moves those that the region moves.
//! Values of the region itself are not taken behind it in lanes that did not come to it.

use super::*;

/// Contents of registers and memory where code jumps over a region.
pub(super) struct Skipped {
    jump: usize,
    registers: Vec<Option<Register>>,
    is_home: Vec<bool>,
}

impl Allocation<'_> {
    /// Jumps over a region where no lane of any subgroup comes to it.
    pub(super) fn skip(&mut self, index: usize) -> Result<(), TooManyLive> {
        let registers = self.lanes_of_exit(index)?;
        let jump = jump_without(self.assembler, &registers).ok_or(TooManyLive)?;
        self.skipped.push(Skipped {
            jump,
            registers: self.registers.clone(),
            is_home: self.values.iter().map(|info| info.is_home).collect(),
        });
        Ok(())
    }

    /// The end of the region that was begun last.
    pub(super) fn end_skip(&mut self) -> Result<(), TooManyLive> {
        let before = self.skipped.pop().ok_or(TooManyLive)?;
        let (mut stored, mut loaded) = (Vec::new(), Vec::new());
        for (value, &was) in before.registers.iter().enumerate() {
            if self.next[value] == NEVER {
                continue;
            }
            let (info, was_home) = (&self.values[value], before.is_home[value]);
            if let (Some(register), true, false) = (was, info.is_home, was_home) {
                stored.push((*info, register));
            }
            match self.registers[value] {
                Some(now) if was != Some(now) && (was.is_some() || was_home) => {
                    // It left its register and came back.
                    if !info.is_home {
                        return Err(TooManyLive);
                    }
                    loaded.push((*info, now));
                }
                _ => {}
            }
        }
        if stored.is_empty() && loaded.is_empty() {
            self.assembler.land(before.jump);
            return Ok(());
        }
        let over = self.assembler.jump();
        self.assembler.land(before.jump);
        for (info, register) in stored {
            self.write_home(&info, register)?;
        }
        for (info, register) in loaded {
            self.read_home(&info, register)?;
        }
        self.assembler.land(over);
        Ok(())
    }
}
