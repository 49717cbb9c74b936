//! Tuff's variables: what they change shows, and nonsense is refused by name.

use std::ffi::CStr;
use std::process::{Command, Output};

use ash::vk;
use tuff_tests::*;

/// Says in a child what to do there: `PROBE` prints what the device says of itself, `CREATE` only
/// tries to create one.
const CHILD: &str = "TUFF_TEST_SETTINGS";

/// Runs `probe` again in a process of its own, with variables that drivers read once.
fn child(variables: &[(&str, &str)]) -> Output {
    let program = std::env::current_exe().expect("this program");
    let mut child = Command::new(program);
    child.args(["--exact", "probe", "--nocapture"]);
    child.env(CHILD, "1").envs(variables.iter().copied());
    child.output().expect("this program runs again")
}

fn is_tuff() -> bool {
    let gpu = Gpu::without_validation().with("a driver with these settings", Gpu::is_tuff);
    gpu.is_some()
}

/// In a child: prints the device's name, conformance version and heap, and the result of creating a
/// device.
#[test]
fn probe() {
    if std::env::var_os(CHILD).is_none() {
        return;
    }
    // SAFETY: plain queries and a device with nothing enabled, in the order that they depend on
    // each other.
    unsafe {
        let entry = ash::Entry::load().expect("there is a Vulkan loader");
        let version = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_3);
        let info = vk::InstanceCreateInfo::default().application_info(&version);
        let instance = entry.create_instance(&info, None).expect("an instance");
        let physical = instance.enumerate_physical_devices().expect("devices")[0];
        let mut driver = vk::PhysicalDeviceDriverProperties::default();
        let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut driver);
        instance.get_physical_device_properties2(physical, &mut properties);
        let name = properties.properties.device_name_as_c_str().unwrap_or(c"?");
        println!("name: {}", CStr::to_string_lossy(name));
        let told = driver.conformance_version;
        let told = [told.major, told.minor, told.subminor, told.patch];
        println!("conformance: {told:?}");
        let memory = instance.get_physical_device_memory_properties(physical);
        println!("heap: {}", memory.memory_heaps[0].size);
        let queue = [vk::DeviceQueueCreateInfo::default().queue_priorities(&[1.0])];
        let info = vk::DeviceCreateInfo::default().queue_create_infos(&queue);
        match instance.create_device(physical, &info, None) {
            Ok(device) => {
                println!("created: true");
                device.destroy_device(None);
            }
            Err(code) => println!("created: {code:?}"),
        }
        instance.destroy_instance(None);
    }
}

/// The text after a word in a child's output.
fn said(child: &Output, word: &str) -> String {
    let text = String::from_utf8_lossy(&child.stdout);
    let line = text.lines().find_map(|line| line.split_once(word));
    let (_, rest) = line.unwrap_or_else(|| panic!("no {word} in {text}"));
    rest.trim().to_owned()
}

#[test]
fn nonsense_is_refused_by_name() {
    if !is_tuff() {
        return;
    }
    let cases = [
        ("TUFF_ACCURACY", "best"),
        ("TUFF_TIER", "sse9"),
        ("TUFF_NATIVE", "yes"),
        ("TUFF_DISABLE", "pakets"),
        ("TUFF_WAVE", "none"),
        ("TUFF_DIRECT", "no"),
        ("TUFF_THREADS", "0"),
        ("TUFF_LOG", "loud"),
        ("TUFF_TIMEOUT", "-1"),
        ("TUFF_VALIDATE", "yes"),
        ("TUFF_STATS", "on"),
        ("TUFF_CONFORMANCE", "1.3"),
    ];
    for (name, value) in cases {
        let child = child(&[(name, value)]);
        assert_eq!(said(&child, "created:"), "ERROR_INITIALIZATION_FAILED");
        let errors = String::from_utf8_lossy(&child.stderr);
        let expected = format!("tuff: {name}: \"{value}\" is not ");
        assert!(errors.contains(&expected), "{name}: {errors}");
    }
}

#[test]
fn names_follow_threads_and_tier() {
    if !is_tuff() {
        return;
    }
    let one = child(&[("TUFF_THREADS", "1"), ("TUFF_TIER", "portable")]);
    let (name, created) = (said(&one, "name:"), said(&one, "created:"));
    assert!(name.starts_with("Tuff (1 thread, "), "{name}");
    assert!(!name.contains("AVX"), "{name}");
    assert_eq!(created, "true");
    let five = said(&child(&[("TUFF_THREADS", "5")]), "name:");
    assert!(five.starts_with("Tuff (5 threads, "), "{five}");
}

#[test]
fn conformance_is_what_the_user_says_and_else_zeros() {
    if !is_tuff() {
        return;
    }
    assert_eq!(said(&child(&[]), "conformance:"), "[0, 0, 0, 0]");
    let set = child(&[("TUFF_CONFORMANCE", "1.3.8.0")]);
    assert_eq!(said(&set, "conformance:"), "[1, 3, 8, 0]");
    assert_eq!(said(&set, "created:"), "true");
}

#[test]
fn info_says_what_a_device_has() {
    if !is_tuff() {
        return;
    }
    let quiet = child(&[("TUFF_LOG", "warn")]);
    let quiet = String::from_utf8_lossy(&quiet.stderr).into_owned();
    assert!(!quiet.contains("tuff: "), "{quiet}");
    let told = child(&[("TUFF_LOG", "info"), ("TUFF_THREADS", "2")]);
    let errors = String::from_utf8_lossy(&told.stderr).into_owned();
    let megabytes = said(&told, "heap:").parse::<u64>().expect("bytes") >> 20;
    let expected = format!("{megabytes} MiB of memory at most");
    assert!(errors.contains("tuff: Tuff (2 threads, "), "{errors}");
    assert!(errors.contains(&expected), "{errors}");
}
