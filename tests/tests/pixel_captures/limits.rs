//! Captures of a pixel past their limits, of commands that were stopped and of programs that die,
//! and what cannot be written.

use std::process::Command;

use serde_json::json;
use tuff_tests::*;

use super::{CHILD, captured, child, folder, is_tuff, read, results, triangle};

/// Seventy commands.
pub fn many(gpu: &Gpu) -> Vec<u32> {
    let world = gpu.scene(&[Geometry::opaque(&triangle(1.0))]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0.25, 0.25, 0), 0.0, vec3(0, 0, 1), 9.0, 0);
        results[gl_LaunchIDEXT.x] += 1u;
    }";
    let output = gpu.buffer(4);
    let case = Case::with_words(raygen).bind(world).bind(output);
    let (rays, table) = (gpu.rays(&case), case.table());
    let regions = gpu.regions(&rays, &table);
    gpu.run(|commands| {
        for _ in 0..70 {
            gpu.record_trace(commands, &rays, &regions, [1, 1, 1]);
            gpu.barrier(commands);
        }
    });
    output.read()
}

#[test]
fn commands_past_the_limit_are_counted() {
    if !is_tuff() {
        return;
    }
    let (text, commands) = captured("many", "0,0", &[]);
    assert_eq!(commands.len(), 65);
    let numbers: Vec<u64> = (commands[..64].iter())
        .map(|command| command["command"].as_u64().expect("a number"))
        .collect();
    assert!(numbers.iter().copied().eq(0..64));
    assert_eq!(commands[64], json!({ "dropped_commands": 6 }));
    assert!(text.contains("64 commands are captured"), "{text}");

    // Nothing is presented: all is in frame 0.
    let (_, commands) = captured("many", "0,0", &[("TUFF_CAPTURE_FRAMES", "1..2")]);
    assert_eq!(commands, [json!({}); 0]);
    let (text, commands) = captured("many", "1,0", &[]);
    assert_eq!(commands, [json!({}); 0]);
    let outside = "invocation (1, 0, 0) is outside of a trace of 1 x 1 x 1\n";
    assert_eq!(
        text,
        format!("TUFF_CAPTURE_PIXEL: {outside}"),
        "it is said once"
    );
}

/// An endless loop behind a ray, which the time limit ends.
pub fn stopped(gpu: &Gpu) -> Vec<u32> {
    let world = gpu.scene(&[Geometry::opaque(&triangle(1.0))]);
    let raygen = r"
    layout(location = 0) rayPayloadEXT uint payload;
    void main() {
        payload = 1u;
        traceRayEXT(world, 0u, 0xff, 0, 0, 0, vec3(0.25, 0.25, 0), 0.0, vec3(0, 0, 1), 9.0, 0);
        while (results[0] == 0u) { }
    }";
    let closest =
        "layout(location = 0) rayPayloadInEXT uint payload; void main() { payload = 5u; }";
    let output = gpu.buffer(4);
    let case = Case::with_words(raygen)
        .hit(closest)
        .bind(world)
        .bind(output);
    let (rays, table) = (gpu.rays(&case), case.table());
    let regions = gpu.regions(&rays, &table);
    let ran = gpu.try_run(|commands| gpu.record_trace(commands, &rays, &regions, [1, 1, 1]));
    assert_eq!(ran, Err(vk::Result::ERROR_DEVICE_LOST));
    vec![1]
}

#[test]
fn a_command_that_was_stopped_is_captured() {
    if !is_tuff() {
        return;
    }
    let folder = folder("stopped");
    let path = folder.to_string_lossy();
    let variables = [
        ("TUFF_CAPTURE_PIXEL", "0,0"),
        ("TUFF_CAPTURE", &*path),
        ("TUFF_TIMEOUT", "0.5"),
    ];
    assert!(child("stopped", &variables).status.success());
    let (text, commands) = read(&folder);
    let _ = std::fs::remove_dir_all(&folder);
    assert_eq!(commands[0]["stopped"], true);
    assert_eq!(commands[0]["rays"][0]["payload_after"], json!([5]));
    assert!(text.contains("the command was stopped"), "{text}");
}

#[test]
fn a_program_that_dies_leaves_what_was_captured() {
    if !is_tuff() {
        return;
    }
    let folder = folder("die");
    let path = folder.to_string_lossy();
    let output = child(
        "die",
        &[("TUFF_CAPTURE_PIXEL", "1,1"), ("TUFF_CAPTURE", &path)],
    );
    assert!(!output.status.success());
    let (_, commands) = read(&folder);
    let _ = std::fs::remove_dir_all(&folder);
    assert_eq!(commands.len(), 1);
    assert_eq!(commands[0]["rays"].as_array().map(Vec::len), Some(2));
}

#[test]
fn without_a_folder_text_goes_to_standard_error() {
    if !is_tuff() {
        return;
    }
    let output = child("triangles", &[("TUFF_CAPTURE_PIXEL", "3,2")]);
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(text.contains("invocation (3, 2, 0)\n"), "{text}");
    assert!(text.contains("payload before: 3.0 2.0\n"), "{text}");
}

#[test]
fn what_cannot_be_written_is_told_once() {
    if !is_tuff() {
        return;
    }
    let file = folder("no-folder");
    std::fs::write(&file, "a file").expect("a temporary file");
    let path = file.join("inside");
    let path = path.to_string_lossy();
    let output = child(
        "many",
        &[("TUFF_CAPTURE_PIXEL", "0,0"), ("TUFF_CAPTURE", &path)],
    );
    let _ = std::fs::remove_file(&file);
    assert!(output.status.success(), "{output:?}");
    assert_eq!(results(&output), results(&child("many", &[])));
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(text.matches("TUFF_CAPTURE").count(), 1, "{text}");
    assert!(text.contains("nothing is captured"), "{text}");
}

/// No file may grow beyond some blocks, as on a disk that is full: the commands before are whole.
#[cfg(unix)]
#[test]
fn a_full_disk_leaves_whole_commands() {
    if !is_tuff() {
        return;
    }
    let folder = folder("full");
    let mut child = Command::new("/bin/sh");
    let program = std::env::current_exe().expect("this program");
    let limited = "trap '' XFSZ; ulimit -f 24; exec \"$0\" --exact work_in_a_child --nocapture";
    child.arg("-c").arg(limited).arg(program);
    child.env(CHILD, "many").env("TUFF_CAPTURE_PIXEL", "0,0");
    let output = child.env("TUFF_CAPTURE", &folder).output();
    let output = output.expect("a shell");
    assert!(output.status.success(), "{output:?}");
    let (text, commands) = read(&folder);
    let _ = std::fs::remove_dir_all(&folder);
    let numbers = commands.iter().map(|command| command["command"].as_u64());
    assert!(numbers.eq((0..commands.len() as u64).map(Some)));
    // Each command of the text has as many lines as the first one.
    let lines: Vec<usize> = text
        .split("\ncommand ")
        .map(|command| command.lines().count())
        .collect();
    assert!((2..64).contains(&lines.len()), "{text}");
    assert!(lines.iter().all(|&count| count == lines[0]) && text.ends_with('\n'));
    assert!((1..64).contains(&commands.len()), "{}", commands.len());
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(told.matches("ends here").count(), 2, "{told}");
}
