//! Debug messengers, which pass validation's findings to the application.

use std::ffi::{CStr, CString, c_void};

use ash::vk;
use parking_lot::RwLock;

use crate::handle::Ref;

/// `VkDebugUtilsMessengerEXT`: a callback of the application.
pub struct Messenger {
    pub severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    pub types: vk::DebugUtilsMessageTypeFlagsEXT,
    pub callback: vk::PFN_vkDebugUtilsMessengerCallbackEXT,
    pub user_data: *mut c_void,
}

// SAFETY: the application's callback must be callable from any thread
// (VkDebugUtilsMessengerCreateInfoEXT).
unsafe impl Send for Messenger {}

// SAFETY: as for `Send`.
unsafe impl Sync for Messenger {}

impl Messenger {
    fn listens(
        &self,
        severity: vk::DebugUtilsMessageSeverityFlagsEXT,
        types: vk::DebugUtilsMessageTypeFlagsEXT,
    ) -> bool {
        self.severity.contains(severity) && self.types.intersects(types)
    }
}

/// The messengers of an instance.
#[derive(Default)]
pub struct Messengers(pub RwLock<Vec<Ref<Messenger>>>);

impl Messengers {
    /// Reports an error of the validation type to the application and to `TUFF_LOG`.
    pub fn error(&self, id: &CStr, message: &str) {
        log::error!("{message}");
        let _ = self.send(
            vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
            vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION,
            id,
            message,
        );
    }

    /// Whether a messenger accepts this severity and type.
    pub fn hear(
        &self,
        severity: vk::DebugUtilsMessageSeverityFlagsEXT,
        types: vk::DebugUtilsMessageTypeFlagsEXT,
    ) -> bool {
        let messengers = self.0.read();
        messengers.iter().any(|it| it.listens(severity, types))
    }

    /// Calls every messenger that accepts this severity and type. Returns whether there is one.
    pub fn send(
        &self,
        severity: vk::DebugUtilsMessageSeverityFlagsEXT,
        types: vk::DebugUtilsMessageTypeFlagsEXT,
        id: &CStr,
        message: &str,
    ) -> bool {
        let text = CString::new(message.replace('\0', " ")).unwrap_or_default();
        let data = vk::DebugUtilsMessengerCallbackDataEXT::default()
            .message_id_name(id)
            .message(&text);
        self.forward(severity, types, &data)
    }

    /// Forwards a message of the application (`vkSubmitDebugUtilsMessageEXT`).
    pub fn forward(
        &self,
        severity: vk::DebugUtilsMessageSeverityFlagsEXT,
        types: vk::DebugUtilsMessageTypeFlagsEXT,
        data: &vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    ) -> bool {
        let mut heard = false;
        let messengers = self.0.read().clone();
        for messenger in &messengers {
            if let Some(callback) = messenger.callback
                && messenger.listens(severity, types)
            {
                // SAFETY: the application gave the callback and its user data for this call. The
                // lock is not held, so the callback may call the driver.
                unsafe { callback(severity, types, data, messenger.user_data) };
                heard = true;
            }
        }
        heard
    }
}
