//! The Vulkan devices and errors that a process finds. A child process asks, as drivers may fail in
//! any way.

use std::path::Path;
use std::process::{Command, Stdio};

use ash::vk;

/// A device that a program finds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Device {
    pub name: String,
    /// Of Vulkan.
    pub api_version: String,
    pub driver_version: String,
    /// Size of its first memory heap.
    pub heap_bytes: u64,
    /// Whether a device could be created, or why not.
    pub created: String,
}

impl Device {
    pub fn is_tuff(&self) -> bool {
        self.name.starts_with("Tuff (")
    }
}

/// The findings of a process.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// The highest Vulkan version of the loader; `None` without a loader.
    pub loader_version: Option<String>,
    pub devices: Vec<Device>,
    /// Messages of loader and drivers on standard error, and the process's exit status if it
    /// failed.
    pub said: Vec<String>,
}

/// Runs this program again as `tuff probe`, with additional variables.
pub fn ask(variables: &[(&'static str, std::ffi::OsString)]) -> Found {
    let program = std::env::current_exe().unwrap_or_else(|_| Path::new("tuff").into());
    let mut child = Command::new(program);
    child.arg("probe").stdin(Stdio::null());
    child.env("VK_LOADER_DEBUG", "error");
    child.envs(variables.iter().cloned());
    match child.output() {
        Err(error) => Found {
            said: vec![format!("the probe could not be started: {error}")],
            ..Found::default()
        },
        Ok(output) => {
            let mut found = read(&String::from_utf8_lossy(&output.stdout));
            let errors = String::from_utf8_lossy(&output.stderr);
            found.said.extend(errors.lines().map(str::to_owned));
            if !output.status.success() {
                found.said.push(format!(
                    "a process that asked for devices ended by {}",
                    output.status
                ));
            }
            found
        }
    }
}

/// Parses the output of [`print`].
fn read(text: &str) -> Found {
    let mut found = Found::default();
    for line in text.lines() {
        let fields: Vec<&str> = line.split('\t').collect();
        match fields[..] {
            ["loader", version] => found.loader_version = Some(version.into()),
            ["device", name, api, driver, heap, created] => found.devices.push(Device {
                name: name.into(),
                api_version: api.into(),
                driver_version: driver.into(),
                heap_bytes: heap.parse().unwrap_or(0),
                created: created.into(),
            }),
            _ => found.said.push(line.into()),
        }
    }
    found
}

/// Prints the findings of this process, one in each line.
pub fn print() {
    // SAFETY: the loader's initialisers only set up its own state.
    let Ok(entry) = (unsafe { ash::Entry::load() }) else {
        return;
    };
    // SAFETY: plain queries of the loader.
    let loader = unsafe { entry.try_enumerate_instance_version() };
    let loader = loader.ok().flatten().unwrap_or(vk::API_VERSION_1_0);
    println!("loader\t{}", version(loader));
    let application = vk::ApplicationInfo::default().api_version(loader.min(vk::API_VERSION_1_3));
    let info = vk::InstanceCreateInfo::default().application_info(&application);
    // SAFETY: the structures outlive the calls; each handle is destroyed after what was made of it.
    unsafe {
        let instance = match entry.create_instance(&info, None) {
            Ok(instance) => instance,
            Err(code) => {
                println!("vkCreateInstance: {code:?}");
                return;
            }
        };
        for physical in instance.enumerate_physical_devices().unwrap_or_default() {
            let properties = instance.get_physical_device_properties(physical);
            let memory = instance.get_physical_device_memory_properties(physical);
            let name = properties
                .device_name_as_c_str()
                .unwrap_or(c"?")
                .to_string_lossy();
            let queue = [vk::DeviceQueueCreateInfo::default().queue_priorities(&[1.0])];
            let device = vk::DeviceCreateInfo::default().queue_create_infos(&queue);
            // No device of another driver is created, because that may take seconds.
            let created = match name.starts_with("Tuff (") {
                false => "not tried".into(),
                true => match instance.create_device(physical, &device, None) {
                    Ok(device) => {
                        device.destroy_device(None);
                        "yes".into()
                    }
                    Err(code) => format!("{code:?}"),
                },
            };
            println!(
                "device\t{}\t{}\t{}\t{}\t{created}",
                name.replace(['\t', '\n'], " "),
                version(properties.api_version),
                version(properties.driver_version),
                memory.memory_heaps[0].size,
            );
        }
        instance.destroy_instance(None);
    }
}

fn version(number: u32) -> String {
    let (major, minor) = (vk::api_version_major(number), vk::api_version_minor(number));
    format!("{major}.{minor}.{}", vk::api_version_patch(number))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_read_back() {
        let found = read(
            "loader\t1.3.204\ndevice\tTuff (2 threads, AVX2)\t1.3.281\t0.1.0\t1048576\tyes\nhm\n",
        );
        assert_eq!(found.loader_version.as_deref(), Some("1.3.204"));
        assert!(found.devices[0].is_tuff());
        assert_eq!(found.devices[0].heap_bytes, 1 << 20);
        assert_eq!(found.said, ["hm"]);
    }
}
