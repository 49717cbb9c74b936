//! `glsl-server`: compiles GLSL for the programs that connect, until its input ends. It prints its
//! address.

#![forbid(unsafe_code)]

use std::io::{Read, stdin};
use std::net::TcpListener;

fn main() -> std::io::Result<()> {
    let listener = TcpListener::bind("127.0.0.1:0")?;
    println!("{}", listener.local_addr()?);
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            // A program that ended before its answer needs none.
            let _ = glsl::answer(stream);
        }
    });
    let mut rest = Vec::new();
    stdin().read_to_end(&mut rest)?;
    Ok(())
}
