//! Pipeline binaries (`VK_KHR_pipeline_binary`): the programs of a pipeline's own stages, in order,
//! in the data form of pipeline caches.

#![forbid(unsafe_code)]

use std::sync::Arc;

use xxhash_rust::xxh3::xxh3_128_with_seed;

use super::embedded_sampler::EmbeddedSampler;
use super::pipeline_cache::{header, store_module, stored_modules};
use super::stage_program::{ProgramKey, StageProgram};

/// A program that can be stored.
#[derive(Clone)]
pub struct StoredModule {
    /// The identity of its compilation.
    pub key: ProgramKey,
    /// The samplers that the program embeds.
    pub embedded: Arc<[EmbeddedSampler]>,
    pub bytes: Arc<[u8]>,
}

impl StoredModule {
    /// Decodes the stored form: the number of samplers, the samplers, the module.
    fn from_stored(key: ProgramKey, stored: &[u8]) -> Option<Self> {
        let (&count, rest) = stored.split_first()?;
        let bytes = usize::from(count) * size_of::<EmbeddedSampler>();
        let (embedded, bytes) = rest.split_at_checked(bytes)?;
        Some(Self {
            key,
            embedded: embedded.as_chunks().0.into(),
            bytes: bytes.into(),
        })
    }

    fn stored(&self) -> Vec<u8> {
        let count = [self.embedded.len() as u8];
        [&count, self.embedded.as_flattened(), &self.bytes].concat()
    }
}

/// A pipeline binary.
#[derive(Clone)]
pub struct PipelineBinary {
    /// In the order of the pipeline's stages.
    pub modules: Vec<StoredModule>,
}

impl PipelineBinary {
    /// The binary of programs with modules; `None` without programs.
    pub fn of(programs: &[StageProgram]) -> Option<Self> {
        let stored = |it: &StageProgram| {
            Some(StoredModule {
                key: it.key,
                embedded: Arc::clone(&it.embedded),
                bytes: Arc::clone(it.module.as_ref()?),
            })
        };
        let modules: Vec<_> = programs.iter().map(stored).collect::<Option<_>>()?;
        (!modules.is_empty()).then_some(Self { modules })
    }

    /// Decodes the data of [`Self::data`]; `None` for any other data.
    pub fn with_data(data: &[u8]) -> Option<Self> {
        let stored = |(key, stored): (_, Option<&[u8]>)| StoredModule::from_stored(key, stored?);
        let modules = stored_modules(data).map(stored).collect::<Option<_>>()?;
        let binary = Self { modules };
        (!binary.modules.is_empty() && binary.data() == data).then_some(binary)
    }

    /// The binary as bytes.
    pub fn data(&self) -> Vec<u8> {
        let mut data = header();
        for module in &self.modules {
            store_module(&mut data, &module.key, &module.stored());
        }
        data
    }
}

/// The key of a binary, by its data, or of a pipeline, by the inputs of its stages' compilation.
pub fn key_of(content: &[u8]) -> [u8; 16] {
    xxh3_128_with_seed(content, 3).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::super::embedded_sampler::STORED_BYTES;
    use super::*;

    fn binary() -> PipelineBinary {
        let module = |key: u8| StoredModule {
            key: [key; 16],
            embedded: [[key; STORED_BYTES]; 2].into(),
            bytes: [key; 40].into(),
        };
        PipelineBinary {
            modules: vec![module(9), module(1)],
        }
    }

    #[test]
    fn data_makes_the_same_binary() {
        let data = binary().data();
        let again = PipelineBinary::with_data(&data).expect("a binary");
        assert_eq!(again.modules[0].key, [9; 16]);
        assert_eq!(again.modules[1].bytes[..], [1; 40]);
        assert_eq!(again.data(), data);
    }

    #[test]
    fn other_data_is_refused() {
        let data = binary().data();
        // With its first program alone it is a binary, of another pipeline.
        let of_one = (header().len() + data.len()) / 2;
        for end in (0..data.len()).filter(|&end| end != of_one) {
            assert!(PipelineBinary::with_data(&data[..end]).is_none());
        }
        for at in 0..data.len() {
            let mut damaged = data.clone();
            damaged[at] ^= 0x10;
            assert!(PipelineBinary::with_data(&damaged).is_none(), "byte {at}");
        }
        assert!(PipelineBinary::with_data(&[&data[..], &[0]].concat()).is_none());
    }
}
