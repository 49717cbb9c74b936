//! Threads.

use windows_sys::Win32::Foundation::{HANDLE, LocalFree};
use windows_sys::Win32::System::Threading::GetCurrentThread;
use windows_sys::core::PWSTR;

use super::placeholder::system_function;

/// The system's name of the calling thread; `None` if it is unknown.
pub fn name() -> Option<String> {
    type GetThreadDescription = unsafe extern "system" fn(HANDLE, *mut PWSTR) -> i32;
    // SAFETY: the type is that of the system's headers. The call gives a text that ends with a zero
    // and that its caller frees.
    unsafe {
        let describe: GetThreadDescription = system_function(c"GetThreadDescription")?;
        let mut text: PWSTR = std::ptr::null_mut();
        if describe(GetCurrentThread(), &mut text) < 0 || text.is_null() {
            return None;
        }
        let length = (0..).take_while(|&at| *text.add(at) != 0).count();
        let name = String::from_utf16_lossy(std::slice::from_raw_parts(text, length));
        LocalFree(text.cast());
        Some(name)
    }
}
