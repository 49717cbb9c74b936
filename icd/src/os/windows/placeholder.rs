//! Placeholders: pieces of reserved address space that memory or views of sections can replace
//! (VirtualAlloc2, "Placeholders"). The first versions of Windows 10 lack the functions, so they
//! are looked up at run time.

use std::ffi::{CStr, c_void};
use std::sync::OnceLock;

use windows_sys::Win32::Foundation::HANDLE;
use windows_sys::Win32::System::LibraryLoader::{GetModuleHandleA, GetProcAddress};
use windows_sys::Win32::System::Memory::{
    MEM_ADDRESS_REQUIREMENTS, MEM_COMMIT, MEM_EXTENDED_PARAMETER, MEM_EXTENDED_PARAMETER_0,
    MEM_EXTENDED_PARAMETER_1, MEM_PRESERVE_PLACEHOLDER, MEM_RELEASE, MEM_REPLACE_PLACEHOLDER,
    MEM_RESERVE, MEM_RESERVE_PLACEHOLDER, MEMORY_MAPPED_VIEW_ADDRESS,
    MemExtendedParameterAddressRequirements, PAGE_NOACCESS, PAGE_READWRITE, VirtualFree,
};
use windows_sys::Win32::System::Threading::GetCurrentProcess;

type VirtualAlloc2 = unsafe extern "system" fn(
    HANDLE,
    *const c_void,
    usize,
    u32,
    u32,
    *mut MEM_EXTENDED_PARAMETER,
    u32,
) -> *mut c_void;
type MapViewOfFile3 = unsafe extern "system" fn(
    HANDLE,
    HANDLE,
    *const c_void,
    u64,
    usize,
    u32,
    u32,
    *mut MEM_EXTENDED_PARAMETER,
    u32,
) -> MEMORY_MAPPED_VIEW_ADDRESS;
type UnmapViewOfFile2 = unsafe extern "system" fn(HANDLE, MEMORY_MAPPED_VIEW_ADDRESS, u32) -> i32;

/// The system's functions.
#[derive(Clone, Copy)]
pub struct Functions {
    allocate: VirtualAlloc2,
    map: MapViewOfFile3,
    unmap: UnmapViewOfFile2,
}

/// The address of a system function, which every process has loaded if the system has it.
///
/// # Safety
/// `F` is the type of the function of this name.
pub unsafe fn system_function<F: Copy>(name: &CStr) -> Option<F> {
    // SAFETY: the caller guarantees that `F` is the type of the function of this name.
    unsafe { function_of(c"kernelbase.dll", name) }
}

/// As [`system_function`], of a library that every process has loaded and never unloads.
///
/// # Safety
/// As of [`system_function`].
pub unsafe fn function_of<F: Copy>(library: &CStr, name: &CStr) -> Option<F> {
    const { assert!(size_of::<F>() == size_of::<usize>()) };
    // SAFETY: both names end with a zero; the module is never unloaded.
    let function = unsafe {
        let module = GetModuleHandleA(library.as_ptr().cast());
        GetProcAddress(module, name.as_ptr().cast())?
    };
    // SAFETY: a function pointer of the size of another; the caller names its type.
    Some(unsafe { std::mem::transmute_copy(&function) })
}

impl Functions {
    /// All of them; `None` on older systems.
    pub fn of_system() -> Option<Self> {
        static FUNCTIONS: OnceLock<Option<Functions>> = OnceLock::new();
        // SAFETY: the types are those of the system's headers.
        *FUNCTIONS.get_or_init(|| unsafe {
            Some(Self {
                allocate: system_function(c"VirtualAlloc2")?,
                map: system_function(c"MapViewOfFile3")?,
                unmap: system_function(c"UnmapViewOfFile2")?,
            })
        })
    }

    /// A placeholder at `address`, or (0) at a multiple of `alignment_bytes`, a power of two;
    /// `None` if the system refuses. It takes no memory.
    pub fn reserve(self, address: u64, size_bytes: u64, alignment_bytes: u64) -> Option<u64> {
        let mut requirements = MEM_ADDRESS_REQUIREMENTS {
            LowestStartingAddress: std::ptr::null_mut(),
            HighestEndingAddress: std::ptr::null_mut(),
            Alignment: alignment_bytes as usize,
        };
        let mut parameter = MEM_EXTENDED_PARAMETER {
            Anonymous1: MEM_EXTENDED_PARAMETER_0 {
                _bitfield: MemExtendedParameterAddressRequirements as u64,
            },
            Anonymous2: MEM_EXTENDED_PARAMETER_1 {
                Pointer: (&raw mut requirements).cast(),
            },
        };
        // SAFETY: address space that the system chooses, or that is free: others' stays as it is.
        let start = unsafe {
            (self.allocate)(
                GetCurrentProcess(),
                address as *const _,
                usize::try_from(size_bytes).ok()?,
                MEM_RESERVE | MEM_RESERVE_PLACEHOLDER,
                PAGE_NOACCESS,
                &raw mut parameter,
                (address == 0).into(),
            )
        };
        (!start.is_null()).then_some(start as u64)
    }

    /// Replaces a whole placeholder with zeroed memory; false if there is too little.
    ///
    /// # Safety
    /// It is the caller's placeholder.
    pub unsafe fn commit(self, address: u64, size_bytes: u64) -> bool {
        // SAFETY: the caller guarantees that it is the caller's placeholder.
        let start = unsafe {
            (self.allocate)(
                GetCurrentProcess(),
                address as *const _,
                size_bytes as usize,
                MEM_RESERVE | MEM_COMMIT | MEM_REPLACE_PLACEHOLDER,
                PAGE_READWRITE,
                std::ptr::null_mut(),
                0,
            )
        };
        !start.is_null()
    }

    /// Replaces a whole placeholder with a view of a section; false if the system refuses.
    ///
    /// # Safety
    /// It is the caller's placeholder, and the handle is one of a section.
    pub unsafe fn map(self, address: u64, size_bytes: u64, section: HANDLE, offset: u64) -> bool {
        // SAFETY: the caller guarantees that it is the caller's placeholder, and the handle is one
        // of a section.
        let start = unsafe {
            (self.map)(
                section,
                GetCurrentProcess(),
                address as *const _,
                offset,
                size_bytes as usize,
                MEM_REPLACE_PLACEHOLDER,
                PAGE_READWRITE,
                std::ptr::null_mut(),
                0,
            )
        };
        !start.Value.is_null()
    }

    /// Replaces a whole view with a placeholder; false if the system refuses.
    ///
    /// # Safety
    /// It is the caller's view, and no reference to it is alive.
    pub unsafe fn unmap(self, address: u64) -> bool {
        let view = MEMORY_MAPPED_VIEW_ADDRESS {
            Value: address as *mut _,
        };
        // SAFETY: the caller guarantees that it is the caller's view, and no reference to it is
        // alive.
        unsafe { (self.unmap)(GetCurrentProcess(), view, MEM_PRESERVE_PLACEHOLDER) != 0 }
    }
}

/// Replaces memory, or a part of a larger placeholder, with a separate placeholder; false if the
/// system refuses.
///
/// # Safety
/// They are the caller's, and no reference to them is alive.
pub unsafe fn separate(address: u64, size_bytes: u64) -> bool {
    let how = MEM_RELEASE | MEM_PRESERVE_PLACEHOLDER;
    // SAFETY: the caller guarantees that they are the caller's, and no reference to them is alive.
    unsafe { VirtualFree(address as *mut _, size_bytes as usize, how) != 0 }
}

/// Bindings have its neighbours alone.
const MEM_COALESCE_PLACEHOLDERS: u32 = 1;

/// Merges the adjacent placeholders that fill the range; false if the system refuses.
///
/// # Safety
/// They are the caller's.
pub unsafe fn coalesce(address: u64, size_bytes: u64) -> bool {
    let how = MEM_RELEASE | MEM_COALESCE_PLACEHOLDERS;
    // SAFETY: the caller guarantees that they are the caller's.
    unsafe { VirtualFree(address as *mut _, size_bytes as usize, how) != 0 }
}

/// Releases a placeholder's address space.
///
/// # Safety
/// It is the caller's.
pub unsafe fn release(address: u64) {
    // SAFETY: the caller guarantees that it is the caller's.
    unsafe { VirtualFree(address as *mut _, 0, MEM_RELEASE) };
}
