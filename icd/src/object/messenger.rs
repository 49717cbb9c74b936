//! Debug messengers: where an application hears what validation finds.

use std::ffi::{CStr, CString, c_void};

use ash::vk;
use parking_lot::RwLock;

use crate::handle::Ref;

/// `VkDebugUtilsMessengerEXT`: where the application wants to hear.
pub struct Messenger {
    pub severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    pub types: vk::DebugUtilsMessageTypeFlagsEXT,
    pub callback: vk::PFN_vkDebugUtilsMessengerCallbackEXT,
    pub user_data: *mut c_void,
}

// SAFETY: the application's callback must be callable from any thread
// (VkDebugUtilsMessengerCreateInfoEXT).
unsafe impl Send for Messenger {}

// SAFETY: as above.
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
    /// Tells the application, and `TUFF_LOG`, about a failure of validation's kind.
    pub fn error(&self, id: &CStr, message: &str) {
        log::error!("{message}");
        let _ = self.send(
            vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
            vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION,
            id,
            message,
        );
    }

    /// Whether a messenger listens to this severity and type.
    pub fn hear(
        &self,
        severity: vk::DebugUtilsMessageSeverityFlagsEXT,
        types: vk::DebugUtilsMessageTypeFlagsEXT,
    ) -> bool {
        let messengers = self.0.read();
        messengers.iter().any(|it| it.listens(severity, types))
    }

    /// Calls every messenger that listens to this severity and type; whether there is one.
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

    /// Passes a message on (`vkSubmitDebugUtilsMessageEXT`).
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
                // SAFETY: the application's callback with the data it asked for; the lock is not
                // held, so it may call back in.
                unsafe { callback(severity, types, data, messenger.user_data) };
                heard = true;
            }
        }
        heard
    }
}
