//! This library in its process.

use std::sync::Once;

use windows_sys::Win32::System::LibraryLoader::{
    GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS, GET_MODULE_HANDLE_EX_FLAG_PIN, GetModuleHandleExW,
};

/// Keeps the library loaded until the process ends. Each load would take indices of thread-local
/// storage, of which the process has 1,088 and `FreeLibrary` returns none. The handler of
/// exceptions is not removed, either.
pub fn keep_loaded() {
    const HOW: u32 = GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS | GET_MODULE_HANDLE_EX_FLAG_PIN;
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let mut module = std::ptr::null_mut();
        let own = keep_loaded as *const () as *const u16;
        // SAFETY: an address of this library, and a valid pointer.
        unsafe { GetModuleHandleExW(HOW, own, &mut module) };
    });
}
