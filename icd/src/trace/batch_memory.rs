//! The memory of a batch, within the device's budget, and its checks of the limits.

#![forbid(unsafe_code)]

use spirv_jit::program::{Event, Events};

use crate::wave::{Limits, Share, Stopped};

/// Waves between two checks of the limits.
const PATIENCE: u32 = 256;

/// Bytes of new subgroup states between two checks of the limits: clearing them burns no fuel.
const STATE_BYTES: usize = 64 << 20;

/// The bytes of a batch, and the work since the last check of the limits.
pub struct BatchMemory {
    /// Of subgroup states in flight.
    state_bytes: usize,
    /// Of the longest frame of a wave so far.
    frame_bytes: usize,
    /// Of the most states of a line's callees so far, by depth.
    line_bytes: [usize; 2],
    /// Their share of the device's budget.
    share: Share,
    /// Bytes of states made since the last check of the limits.
    unchecked_bytes: usize,
    /// Waves until the next check of the limits: a shader that always yields never runs out of
    /// fuel.
    patience: u32,
}

impl Default for BatchMemory {
    fn default() -> Self {
        Self {
            state_bytes: 0,
            frame_bytes: 0,
            line_bytes: [0; 2],
            share: Share::default(),
            unchecked_bytes: 0,
            patience: PATIENCE,
        }
    }
}

impl BatchMemory {
    /// Bytes that the batch has of the device's budget.
    pub fn bytes(&self) -> usize {
        self.share.bytes()
    }

    /// Adds a subgroup's state, and checks the limits now and then.
    #[inline]
    pub fn add_state(&mut self, bytes: usize, limits: &Limits) -> Result<(), Stopped> {
        self.state_bytes += bytes;
        self.grow(limits)?;
        self.unchecked_bytes += bytes;
        if self.unchecked_bytes > STATE_BYTES {
            self.unchecked_bytes = 0;
            limits.check()?;
        }
        Ok(())
    }

    /// Removes a subgroup's state.
    #[inline]
    pub fn remove_state(&mut self, bytes: usize) {
        self.state_bytes -= bytes;
    }

    /// Makes room for the frame of a wave.
    #[inline]
    pub fn add_frame(&mut self, bytes: usize, limits: &Limits) -> Result<(), Stopped> {
        if bytes > self.frame_bytes {
            self.frame_bytes = bytes;
            self.grow(limits)?;
        }
        Ok(())
    }

    /// Makes room for the states of callees in a line.
    pub fn add_line(&mut self, depth: usize, bytes: usize, limits: &Limits) -> Result<(), Stopped> {
        if bytes > self.line_bytes[depth] {
            self.line_bytes[depth] = bytes;
            self.grow(limits)?;
        }
        Ok(())
    }

    /// Takes bytes of the device's budget for states and frame.
    fn grow(&mut self, limits: &Limits) -> Result<(), Stopped> {
        let bytes = self.state_bytes + self.frame_bytes + self.line_bytes.iter().sum::<usize>();
        self.share.grow_to(bytes, &limits.memory)
    }

    /// Checks the limits after a wave, now and then and where fuel has run out.
    #[inline]
    pub fn check_after(&mut self, events: &Events, limits: &Limits) -> Result<(), Stopped> {
        self.patience -= 1;
        if events.contains(Event::OutOfFuel) || self.patience == 0 {
            self.patience = PATIENCE;
            limits.check()
        } else {
            Ok(())
        }
    }
}
