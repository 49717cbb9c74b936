//! The floating-point environment of threads that compute: the default one, whatever the
//! application has set.
//!
//! Rust assumes the default (round to nearest even, denormals kept, exceptions masked), and so do
//! the results: but a host may flush denormals to zero, and new threads inherit that from the one
//! that starts them.

use std::marker::PhantomData;

/// Keeps the default environment on the current thread, and brings back what was there before when
/// it is dropped.
pub struct DefaultEnvironment {
    before: Option<Word>,
    /// It belongs to its thread.
    _here: PhantomData<*const ()>,
}

impl DefaultEnvironment {
    /// Sets the default environment.
    #[inline]
    pub fn enter() -> Self {
        let now = read();
        let is_default = now & CONTROL == DEFAULT;
        if !is_default {
            write(DEFAULT);
        }
        Self {
            before: (!is_default).then_some(now),
            _here: PhantomData,
        }
    }
}

impl Drop for DefaultEnvironment {
    #[inline]
    fn drop(&mut self) {
        if let Some(before) = self.before {
            write(before);
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod register {
    use std::arch::asm;

    /// MXCSR (Intel's manual, volume 1, section 10.2.3).
    pub type Word = u32;

    /// All exceptions masked, nothing else.
    pub const DEFAULT: Word = 0x1F80;
    /// All but the flags of exceptions that have been.
    pub const CONTROL: Word = 0xFFC0;

    #[inline]
    pub fn read() -> Word {
        let mut word: Word = 0;
        // SAFETY: stores 32 bits where there are 32.
        unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut word, options(nostack, preserves_flags)) };
        word
    }

    #[inline]
    pub fn write(word: Word) {
        // SAFETY: the word is the default, which Rust asks for, or one that this thread had before
        // it called this library, to which it returns then: no reserved bit is set.
        unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const word, options(nostack, preserves_flags)) };
    }
}

#[cfg(target_arch = "aarch64")]
mod register {
    use std::arch::asm;

    /// FPCR.
    pub type Word = u64;

    pub const DEFAULT: Word = 0;
    pub const CONTROL: Word = u64::MAX;

    #[inline]
    pub fn read() -> Word {
        let word: Word;
        // SAFETY: reads a register.
        unsafe { asm!("mrs {}, fpcr", out(reg) word, options(nomem, nostack, preserves_flags)) };
        word
    }

    #[inline]
    pub fn write(word: Word) {
        // SAFETY: as for x86-64.
        unsafe { asm!("msr fpcr, {}", in(reg) word, options(nostack, preserves_flags)) };
    }
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
mod register {
    pub type Word = u32;

    pub const DEFAULT: Word = 0;
    pub const CONTROL: Word = 0;

    pub fn read() -> Word {
        0
    }

    pub fn write(_: Word) {}
}

use register::{CONTROL, DEFAULT, Word, read, write};

/// Sets an environment, for tests.
#[cfg(test)]
pub fn set(word: Word) {
    write(word);
}

/// The environment, for tests: without the flags of exceptions that have been.
#[cfg(test)]
pub fn control() -> Word {
    read() & CONTROL
}
