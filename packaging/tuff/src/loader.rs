//! The Vulkan loader: the system's library between programs and drivers.

use std::ffi::c_void;
use std::path::{Path, PathBuf};

use crate::os;

/// The name with which programs open it.
pub const LIBRARY: &str = match cfg!(windows) {
    true => "vulkan-1.dll",
    false => "libvulkan.so.1",
};

/// The loader that programs find without help.
pub struct System {
    /// Its path, if known.
    pub path: Option<PathBuf>,
}

impl System {
    /// Searches for it as programs do.
    pub fn find() -> Option<System> {
        // SAFETY: the loader's initialisers only set up its own state.
        let library = unsafe { libloading::Library::new(LIBRARY) }.ok()?;
        // SAFETY: the symbol is only asked for its address.
        let symbol = unsafe { library.get::<*const c_void>(b"vkGetInstanceProcAddr\0") };
        let path = symbol.ok().and_then(|symbol| os::file_of(*symbol));
        Some(System { path })
    }
}

/// Whether the loader in a folder works here. It comes from a distribution, and may need a newer C
/// library than this system has. It is not tried if the system has its own.
///
/// # Errors
/// The reason why it is missing or cannot be loaded.
pub fn usable(folder: &Path) -> Result<(), String> {
    let file = folder.join(LIBRARY);
    if !file.exists() {
        return Err("none came along".into());
    }
    match System::find() {
        Some(_) => Ok(()),
        None => loads(&file),
    }
}

/// Whether a library can be loaded.
fn loads(file: &Path) -> Result<(), String> {
    // SAFETY: the loader's initialisers only set up its own state, and it is closed again at once.
    match unsafe { libloading::Library::new(file) } {
        Ok(_) => Ok(()),
        Err(error) => Err(format!("the one that came along does not load: {error}")),
    }
}

/// The command that installs the loader on this system.
pub fn install_command() -> &'static str {
    if cfg!(windows) {
        return "winget install KhronosGroup.VulkanRT";
    }
    let has = |program: &str| Path::new("/usr/bin").join(program).exists();
    if has("dnf") {
        "sudo dnf install vulkan-loader"
    } else if has("pacman") {
        "sudo pacman -S vulkan-icd-loader"
    } else if has("zypper") {
        "sudo zypper install libvulkan1"
    } else {
        "sudo apt-get install libvulkan1"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loader_that_does_not_load_is_none() {
        let folder = std::env::temp_dir().join(format!("tuff-loader-{}", std::process::id()));
        assert_eq!(usable(&folder), Err("none came along".into()));
        std::fs::create_dir_all(&folder).unwrap();
        let file = folder.join(LIBRARY);
        std::fs::write(&file, "of another system").unwrap();
        let why = loads(&file).unwrap_err();
        std::fs::remove_dir_all(&folder).unwrap();
        assert!(why.starts_with("the one that came along does not load: "));
    }
}
