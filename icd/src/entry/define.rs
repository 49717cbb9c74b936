//! Macros for entry points: C functions with a guard against panics.

/// Defines entry points: C functions whose bodies run inside [`guard`](crate::guard::guard). A body
/// of a function that returns `vk::Result` gives a [`VkResult`](crate::VkResult).
macro_rules! entry {
    () => {};
    ($(#[$meta:meta])* fn $name:ident($($arg:ident: $ty:ty),* $(,)?) -> vk::Result $body:block $($rest:tt)*) => {
        $(#[$meta])*
        #[allow(non_snake_case)]
        pub(crate) unsafe extern "system" fn $name($($arg: $ty),*) -> vk::Result {
            $crate::guard::logged_code(stringify!($name), $crate::guard::guard(stringify!($name), move || -> $crate::VkResult {
                // SAFETY: the application keeps this command's valid usage: handles are alive and
                // of their type, pointers are valid for what they count, chains are well formed,
                // what is externally synchronised is not used elsewhere.
                #[allow(unused_unsafe)]
                unsafe { $body }
            }))
        }
        $crate::entry::define::entry! { $($rest)* }
    };
    ($(#[$meta:meta])* fn $name:ident($($arg:ident: $ty:ty),* $(,)?) $(-> $ret:ty)? $body:block $($rest:tt)*) => {
        $(#[$meta])*
        #[allow(non_snake_case)]
        pub(crate) unsafe extern "system" fn $name($($arg: $ty),*) $(-> $ret)? {
            $crate::guard::guard(stringify!($name), move || $(-> $ret)? {
                // SAFETY: as above.
                #[allow(unused_unsafe)]
                unsafe { $body }
            })
        }
        $crate::entry::define::entry! { $($rest)* }
    };
}
pub(crate) use entry;

/// Defines `vkCmd*` entry points. The body gets the command buffer's recorder under the first
/// argument's name and gives a [`VkResult`](crate::VkResult); an error or a panic becomes what
/// `vkEndCommandBuffer` returns.
macro_rules! commands {
    ($($(#[$meta:meta])* fn $name:ident($buffer:ident $(, $arg:ident: $ty:ty)* $(,)?) $body:block)*) => {$(
        $(#[$meta])*
        #[allow(non_snake_case)]
        pub(crate) unsafe extern "system" fn $name($buffer: ash::vk::CommandBuffer $(, $arg: $ty)*) {
            $crate::guard::guard(stringify!($name), || {
                // SAFETY: the handle is a live command buffer.
                let command_buffer = unsafe { $crate::handle::from_handle::<$crate::command::CommandBuffer>($buffer) };
                let mut recording = command_buffer.recording.lock();
                let $buffer = &mut *recording;
                let result = $crate::guard::guard(stringify!($name), || -> $crate::VkResult {
                    // SAFETY: the application keeps this command's valid usage.
                    #[allow(unused_unsafe)]
                    unsafe { $body }
                });
                if let Err(code) = result {
                    $crate::guard::refused(stringify!($name), code);
                    recording.fail(code);
                }
            });
        }
    )*};
}
pub(crate) use commands;
