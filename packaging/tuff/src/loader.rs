//! The Vulkan loader: the system's library between programs and drivers.

use std::ffi::{CStr, c_void};
use std::path::{Path, PathBuf};

/// The name by which programs open it.
pub const LIBRARY: &str = "libvulkan.so.1";

/// The loader that programs find without help.
pub struct System {
    /// Where it lies, if that can be told.
    pub path: Option<PathBuf>,
}

impl System {
    /// Looks for it as programs do.
    pub fn find() -> Option<System> {
        // SAFETY: the loader's initialisers only set up its own state.
        let library = unsafe { libloading::Library::new(LIBRARY) }.ok()?;
        // SAFETY: the symbol is only asked for its address.
        let symbol = unsafe { library.get::<*const c_void>(b"vkGetInstanceProcAddr\0") };
        let path = symbol.ok().and_then(|symbol| file_of(*symbol));
        Some(System { path })
    }
}

/// The file that a function was loaded from.
fn file_of(function: *const c_void) -> Option<PathBuf> {
    let mut found = std::mem::MaybeUninit::<libc::Dl_info>::zeroed();
    // SAFETY: `dladdr` writes the structure; on success its name is a string of the loaded library, which is still open.
    unsafe {
        if libc::dladdr(function, found.as_mut_ptr()) == 0 {
            return None;
        }
        let name = found.assume_init().dli_fname;
        (!name.is_null()).then(|| PathBuf::from(CStr::from_ptr(name).to_str().unwrap_or_default()))
    }
}

/// The command that installs the loader on this system.
pub fn install_command() -> &'static str {
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
