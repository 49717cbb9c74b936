//! Pipeline caches: programs by the key of their sources, in memory and as data from which another
//! process can start.
//!
//! ```text
//! VkPipelineCacheHeaderVersionOne | entry…
//! entry: key, 16 bytes | bytes of the module, u32 | their hash with the key's, u64 | the module (spirv_jit::ir::binary)
//! ```
//!
//! The header's UUID identifies the compiler that made the data; data of other compilers is
//! ignored. Damaged and truncated entries are skipped.

#![forbid(unsafe_code)]

use std::collections::HashMap;
use std::sync::Arc;

use ash::vk;
use parking_lot::Mutex;
use spirv_jit::Program;
use xxhash_rust::xxh3::xxh3_64_with_seed;

use super::stage_program::ProgramKey;
use crate::capabilities::properties::{DEVICE_ID, VENDOR_ID, pipeline_cache_uuid};

const HEADER_BYTES: usize = 32;
/// Key, length, hash.
const ENTRY_HEAD_BYTES: usize = 16 + 4 + 8;

/// A pipeline cache.
#[derive(Default)]
pub struct PipelineCache {
    entries: Mutex<HashMap<ProgramKey, Entry>>,
}

/// A program in its stored form, and ready to run once it has been requested.
#[derive(Clone)]
struct Entry {
    bytes: Arc<[u8]>,
    program: Option<Arc<Program>>,
}

impl PipelineCache {
    /// Creates a cache from the data of [`Self::data`], if this compiler made it, without damaged
    /// entries.
    pub fn with_data(data: &[u8]) -> Self {
        let mut entries = HashMap::new();
        for (key, bytes) in stored_modules(data) {
            if let Some(bytes) = bytes {
                entries.insert(
                    key,
                    Entry {
                        bytes: bytes.into(),
                        program: None,
                    },
                );
            }
        }
        Self {
            entries: Mutex::new(entries),
        }
    }

    /// The program of a key, with its module's bytes. A program from data is prepared on its first
    /// request.
    pub fn find(&self, key: &ProgramKey) -> Option<(Arc<Program>, Arc<[u8]>)> {
        let entry = self.entries.lock().get(key).cloned()?;
        if let Some(program) = entry.program {
            return Some((program, entry.bytes));
        }
        match spirv_jit::program::from_bytes(&entry.bytes) {
            Ok(program) => {
                if let Some(entry) = self.entries.lock().get_mut(key) {
                    entry.program = Some(Arc::clone(&program));
                }
                Some((program, entry.bytes))
            }
            Err(_) => {
                self.entries.lock().remove(key);
                None
            }
        }
    }

    /// Adds a program, with its module's bytes.
    pub fn insert(&self, key: ProgramKey, bytes: Arc<[u8]>, program: Arc<Program>) {
        let entry = Entry {
            bytes,
            program: Some(program),
        };
        self.entries.lock().insert(key, entry);
    }

    /// Adds the entries of another cache that this one lacks.
    pub fn merge(&self, other: &PipelineCache) {
        let others = other.entries.lock().clone();
        let mut entries = self.entries.lock();
        for (key, entry) in others {
            entries.entry(key).or_insert(entry);
        }
    }

    /// `vkGetPipelineCacheData`: the same bytes for the same programs, whole entries only, at most
    /// `room` bytes of them. Empty if not even the header fits. Also whether all fit.
    pub fn data(&self, room: usize) -> (Vec<u8>, bool) {
        if room < HEADER_BYTES {
            return (Vec::new(), false);
        }
        let entries = self.entries.lock();
        let mut sorted: Vec<_> = entries.iter().collect();
        sorted.sort_unstable_by_key(|(key, _)| **key);
        let mut data = header();
        for (key, entry) in sorted {
            if room - data.len() < ENTRY_HEAD_BYTES + entry.bytes.len() {
                return (data, false);
            }
            store_module(&mut data, key, &entry.bytes);
        }
        (data, true)
    }
}

/// Appends an entry.
pub fn store_module(data: &mut Vec<u8>, key: &ProgramKey, bytes: &[u8]) {
    data.extend_from_slice(key);
    data.extend_from_slice(&(bytes.len() as u32).to_le_bytes());
    data.extend_from_slice(&hash(key, bytes).to_le_bytes());
    data.extend_from_slice(bytes);
}

/// The intact entries of data, each with its module; none if another compiler made them.
pub fn stored_modules(data: &[u8]) -> impl Iterator<Item = (ProgramKey, Option<&[u8]>)> {
    let mut rest = match data.split_at_checked(HEADER_BYTES) {
        Some((head, rest)) if head == header() => rest,
        _ => &[],
    };
    std::iter::from_fn(move || {
        let (key, bytes, tail) = split_entry(rest)?;
        rest = tail;
        Some((key, bytes))
    })
}

/// `VkPipelineCacheHeaderVersionOne`.
pub fn header() -> Vec<u8> {
    let words = [
        HEADER_BYTES as u32,
        vk::PipelineCacheHeaderVersion::ONE.as_raw() as u32,
        VENDOR_ID,
        DEVICE_ID,
    ];
    let mut header: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    header.extend(pipeline_cache_uuid());
    header
}

fn hash(key: &ProgramKey, bytes: &[u8]) -> u64 {
    let seed = key
        .iter()
        .fold(0u64, |seed, &byte| seed.rotate_left(8) ^ u64::from(byte));
    xxh3_64_with_seed(bytes, seed)
}

/// The first entry's key and module, if intact, and the remaining data; `None` at the end and for a
/// truncated entry.
fn split_entry(data: &[u8]) -> Option<(ProgramKey, Option<&[u8]>, &[u8])> {
    let (key, data) = data.split_first_chunk::<16>()?;
    let (length, data) = data.split_first_chunk::<4>()?;
    let (expected, data) = data.split_first_chunk::<8>()?;
    let (bytes, rest) = data.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    let intact = hash(key, bytes) == u64::from_le_bytes(*expected);
    Some((*key, intact.then_some(bytes), rest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use spirv_jit::ir::{binary, text};

    /// A cache with two programs.
    fn filled() -> PipelineCache {
        let cache = PipelineCache::default();
        for key in [1, 2] {
            let module = format!(
                "module compute\noutput_rows 0\nfunc f0 {{\n v0: i32 = const {key}\n end\n}}\n"
            );
            let bytes = binary::encode(&text::parse_module(&module).unwrap());
            let program = spirv_jit::program::from_bytes(&bytes).unwrap();
            cache.insert([key; 16], bytes.into(), program);
        }
        cache
    }

    #[test]
    fn data_makes_the_same_cache() {
        let (data, all) = filled().data(usize::MAX);
        assert!(all);
        let again = PipelineCache::with_data(&data);
        assert!(again.find(&[1; 16]).is_some() && again.find(&[2; 16]).is_some());
        assert!(again.find(&[3; 16]).is_none());
        assert_eq!(again.data(usize::MAX).0, data);
    }

    #[test]
    fn what_is_cut_off_or_damaged_is_left_out() {
        let (data, _) = filled().data(usize::MAX);
        let (partial, all) = filled().data(data.len() - 1);
        assert!(!all && partial.len() < data.len());
        assert_eq!(
            PipelineCache::with_data(&partial).data(usize::MAX).0,
            partial
        );
        assert!(filled().data(HEADER_BYTES - 1).0.is_empty());
        for end in 0..data.len() {
            let cache = PipelineCache::with_data(&data[..end]);
            assert!(cache.find(&[2; 16]).is_none());
        }
        for at in 0..data.len() {
            let mut damaged = data.clone();
            damaged[at] ^= 0x10;
            let cache = PipelineCache::with_data(&damaged);
            let found = [1, 2].map(|key| cache.find(&[key; 16]).is_some());
            assert!(found != [true, true], "byte {at}");
        }
    }

    #[test]
    fn merging_adds_what_is_missing() {
        let cache = PipelineCache::default();
        cache.merge(&filled());
        assert_eq!(cache.data(usize::MAX), filled().data(usize::MAX));
    }
}
