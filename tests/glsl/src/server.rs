//! The compiler on another side of a connection.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpStream};

use crate::{Version, compile};

/// The variable that names the server: `127.0.0.1:4000`.
pub const SERVER: &str = "TUFF_GLSL_SERVER";

/// The first byte of an answer with SPIR-V.
pub const WORDS: u8 = b'+';
/// The first byte of an answer with a message.
pub const ERROR: u8 = b'-';

/// Has the server compile GLSL for a stage, which has the name that glslang's program gives its
/// files.
///
/// # Errors
/// glslang's message, or what is wrong with the connection.
pub fn ask(stage: &str, version: Version, text: &str) -> Result<Vec<u32>, String> {
    let server = std::env::var(SERVER).map_err(|_| {
        format!("{SERVER} names no compiler of GLSL; `cargo xtask test` starts one")
    })?;
    let answer = question(&server, stage, version, text)
        .map_err(|error| format!("{SERVER}={server}: {error}"))?;
    match answer.split_first() {
        Some((&WORDS, bytes)) => Ok((bytes.chunks_exact(4))
            .map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]))
            .collect()),
        Some((&ERROR, message)) => Err(String::from_utf8_lossy(message).into_owned()),
        _ => Err(format!("{SERVER}={server}: not an answer")),
    }
}

fn question(server: &str, stage: &str, version: Version, text: &str) -> std::io::Result<Vec<u8>> {
    let mut stream = TcpStream::connect(server)?;
    write!(stream, "{stage} {}\n{text}", version.name())?;
    stream.shutdown(Shutdown::Write)?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer)?;
    Ok(answer)
}

/// Answers one question.
///
/// # Errors
/// The connection breaks.
pub fn answer(mut stream: TcpStream) -> std::io::Result<()> {
    let mut question = String::new();
    stream.read_to_string(&mut question)?;
    let (line, text) = question.split_once('\n').unwrap_or_default();
    let (stage, version) = line.split_once(' ').unwrap_or_default();
    let compiled = match Version::of_name(version) {
        Some(version) => compile(stage, version, text),
        None => Err(format!("no version of SPIR-V is named {version}")),
    };
    let mut bytes = Vec::new();
    match compiled {
        Ok(words) => {
            bytes.push(WORDS);
            bytes.extend(words.iter().flat_map(|word| word.to_le_bytes()));
        }
        Err(message) => {
            bytes.push(ERROR);
            bytes.extend(message.as_bytes());
        }
    }
    stream.write_all(&bytes)
}

#[cfg(all(test, not(windows)))]
mod tests {
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn the_server_answers_what_the_compiler_gives() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let questions = [
            ("comp", "#version 460\nvoid main() {}\n"),
            ("comp", "#version 460\nvoid main() { x; }\n"),
            ("none", ""),
        ];
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for stream in listener.incoming().take(questions.len()) {
                    answer(stream.unwrap()).unwrap();
                }
            });
            for (stage, text) in questions {
                let answer = question(&address, stage, Version::V1_6, text).unwrap();
                let expected = match compile(stage, Version::V1_6, text) {
                    Ok(words) => (
                        WORDS,
                        words.iter().flat_map(|it| it.to_le_bytes()).collect(),
                    ),
                    Err(message) => (ERROR, message.into_bytes()),
                };
                assert_eq!((answer[0], answer[1..].to_vec()), expected);
            }
        });
    }
}
