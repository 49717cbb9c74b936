//! The keys of the registry by which programs find drivers and variables.

use std::io;
use std::ptr::null_mut;

use windows_registry::{CURRENT_USER, Key, LOCAL_MACHINE};
use windows_sys::Win32::UI::WindowsAndMessaging::{
    HWND_BROADCAST, SMTO_ABORTIFHUNG, SendMessageTimeoutW, WM_SETTINGCHANGE,
};

use crate::os::Hive;

/// Vulkan-Loader, "Driver Discovery on Windows": a value a driver, whose name is the manifest's
/// path and whose number is 0.
const DRIVERS: &str = r"SOFTWARE\Khronos\Vulkan\Drivers";
/// The variables that each new program of the user gets.
const VARIABLES: &str = "Environment";

fn root(hive: Hive) -> &'static Key {
    match hive {
        Hive::Machine => LOCAL_MACHINE,
        Hive::User => CURRENT_USER,
    }
}

/// The manifests of all enabled drivers.
///
/// # Errors
/// The key cannot be read. That there is none is no error.
pub fn drivers(hive: Hive) -> io::Result<Vec<String>> {
    let key = match root(hive).open(DRIVERS).map_err(io::Error::from) {
        Ok(key) => key,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error),
    };
    let enabled = key
        .values()?
        .filter(|(_, value)| u32::try_from(value.clone()).is_ok_and(|it| it == 0));
    Ok(enabled.map(|(name, _)| name).collect())
}

/// Adds a driver by its manifest.
///
/// # Errors
/// This user may not write there (`PermissionDenied`), or the system's error.
pub fn register(hive: Hive, manifest: &str) -> io::Result<()> {
    Ok(root(hive).create(DRIVERS)?.set_u32(manifest, 0)?)
}

/// Takes a driver out.
///
/// # Errors
/// As [`register`]; there is no such value.
pub fn forget(hive: Hive, manifest: &str) -> io::Result<()> {
    let key = root(hive).options().read().write().open(DRIVERS)?;
    Ok(key.remove_value(manifest)?)
}

/// A variable that all new programs of the user get.
pub fn users_variable(name: &str) -> Option<String> {
    CURRENT_USER.open(VARIABLES).ok()?.get_string(name).ok()
}

/// Sets or removes such a variable, and has open shells and desktops know.
///
/// # Errors
/// The registry cannot be written.
pub fn set_users_variable(name: &str, value: Option<&str>) -> io::Result<()> {
    let key = CURRENT_USER.create(VARIABLES)?;
    match value {
        Some(value) => key.set_string(name, value),
        None => key.remove_value(name),
    }?;
    const MOST_MILLISECONDS: u32 = 1000;
    let changed: Vec<u16> = "Environment\0".encode_utf16().collect();
    // SAFETY: the text ends with a zero and outlives the call.
    unsafe {
        SendMessageTimeoutW(
            HWND_BROADCAST,
            WM_SETTINGCHANGE,
            0,
            changed.as_ptr() as isize,
            SMTO_ABORTIFHUNG,
            MOST_MILLISECONDS,
            null_mut(),
        );
    }
    Ok(())
}
