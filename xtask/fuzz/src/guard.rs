//! Memory around buffers, and in the process, that nothing is to write.

use tuff_tests::{Buffer, Gpu};

/// Bytes before and after what is bound.
pub const MARGIN: u64 = 4096;

const PATTERN: u64 = 0x5AFE_C0DE_DEAD_BEA7;

/// A buffer of which only the middle is ever bound.
pub struct Guarded {
    pub buffer: Buffer,
    pub size_bytes: u64,
}

impl Guarded {
    pub fn new(gpu: &Gpu, size_bytes: u64) -> Guarded {
        let buffer = gpu.buffer(size_bytes + 2 * MARGIN);
        let guarded = Guarded { buffer, size_bytes };
        guarded.renew();
        guarded
    }

    /// Makes margins of what somebody was allowed to write.
    pub fn renew(&self) {
        let margin = [PATTERN; MARGIN as usize / 8];
        self.buffer.write(0, &margin);
        let end = MARGIN + self.size_bytes;
        self.buffer.write(end as usize, &margin);
    }

    /// Where the middle is.
    pub fn address(&self) -> u64 {
        self.buffer.address + MARGIN
    }

    /// # Panics
    /// Something was written beside the middle.
    pub fn check(&self) {
        let words = self.buffer.read::<u64>();
        let margin = MARGIN as usize / 8;
        let middle = self.size_bytes as usize / 8;
        let sides = words[..margin].iter().chain(&words[margin + middle..]);
        if sides.into_iter().any(|&word| word != PATTERN) {
            found("a buffer was written beside what is bound of it");
        }
    }
}

/// Memory of the process that no driver knows of.
pub struct Host(Vec<Box<[u64; 512]>>);

impl Host {
    pub fn new() -> Host {
        Host((0..64).map(|_| Box::new([PATTERN; 512])).collect())
    }

    /// # Panics
    /// Something was written.
    pub fn check(&self) {
        let pages = std::hint::black_box(&self.0);
        if pages
            .iter()
            .any(|page| page.iter().any(|&word| word != PATTERN))
        {
            found("memory of the process was written");
        }
    }
}

/// Ends the process: the case at hand is a finding.
pub fn found(what: &str) -> ! {
    eprintln!("FOUND: {what}");
    std::process::abort();
}
