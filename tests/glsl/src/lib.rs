//! GLSL to SPIR-V for tests.
//!
//! glslang is C++. Programs for Windows are built without a C++ compiler for it: they ask the
//! program `glsl-server` of the machine that built them, under the address that [`SERVER`] names.
//! A question is a connection: a line with stage and version, then the text; the answer is
//! [`WORDS`] and SPIR-V, or [`ERROR`] and a message.

#![forbid(unsafe_code)]

#[cfg(not(windows))]
mod compiler;
mod server;
mod stage;

#[cfg(not(windows))]
pub use compiler::compile;
#[cfg(windows)]
pub use server::ask as compile;
pub use server::{ERROR, SERVER, WORDS, answer, ask};
pub use stage::Stage;

/// Versions of SPIR-V to compile to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Version {
    V1_4,
    V1_6,
}

impl Version {
    const ALL: [Version; 2] = [Version::V1_4, Version::V1_6];

    fn name(self) -> &'static str {
        match self {
            Version::V1_4 => "1.4",
            Version::V1_6 => "1.6",
        }
    }

    fn of_name(name: &str) -> Option<Version> {
        Self::ALL.into_iter().find(|version| version.name() == name)
    }
}

/// Compiles GLSL without its version line. Extensions are enabled before it.
///
/// # Panics
/// With glslang's message and the text.
pub fn compile_with(stage: Stage, version: Version, extensions: &[&str], source: &str) -> Vec<u32> {
    let mut text = String::from("#version 460\n");
    for extension in extensions {
        text += &format!("#extension {extension} : enable\n");
    }
    text += source;
    compile(stage.name(), version, &text).unwrap_or_else(|error| panic!("{error}\n{text}"))
}
