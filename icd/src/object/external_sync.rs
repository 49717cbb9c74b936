//! Payloads of semaphores and fences in files, which are shared with other devices and processes
//! (`VK_KHR_external_semaphore_fd`, `VK_KHR_external_fence_fd` and those of `_win32`; spec,
//! "Importing Semaphore Payloads"). A file here is a system handle.
//!
//! An opaque file is a system event, set while the payload is signaled. A sync file belongs to
//! another driver or the kernel, and is only imported, for one wait. An exported sync file has been
//! signaled already, so it is the file −1.

use ash::vk;
use parking_lot::Mutex;

use crate::VkResult;
use crate::os::event::Event;
use crate::os::handle::{Handle, Sharing};
use crate::os::section::Refused;

/// The external payloads of a semaphore or fence.
#[derive(Default)]
pub struct External(Mutex<Payloads>);

#[derive(Default)]
struct Payloads {
    permanent: Option<Event>,
    /// The payload imported for one wait. It takes precedence over the others.
    temporary: Option<Temporary>,
}

enum Temporary {
    Opaque(Event),
    Sync(Event),
    /// The sync file −1.
    Signaled,
}

/// An imported payload.
pub enum Import {
    Opaque {
        file: Handle,
        is_temporary: bool,
    },
    /// A sync file, always temporary; `None` is −1. Only Linux has sync files.
    #[cfg_attr(windows, allow(dead_code))]
    Sync(Option<Handle>),
}

impl External {
    /// No payload, or one that can be exported as an opaque file.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY` if the process cannot open more files; `VK_ERROR_UNKNOWN` if
    /// another object has the name.
    pub fn new(sharing: Option<Sharing>, is_signaled: bool) -> VkResult<Self> {
        let permanent = sharing.map(|sharing| Event::exportable(is_signaled, &sharing));
        let permanent = permanent.transpose().map_err(|refused| match refused {
            Refused::Handles | Refused::Memory => vk::Result::ERROR_OUT_OF_HOST_MEMORY,
            Refused::Name => vk::Result::ERROR_UNKNOWN,
        })?;
        Ok(Self(Mutex::new(Payloads {
            permanent,
            temporary: None,
        })))
    }

    /// Whether a payload is in a file. Changes of a file cause no notification.
    pub fn is_there(&self) -> bool {
        let payloads = self.0.lock();
        payloads.permanent.is_some() || payloads.temporary.is_some()
    }

    /// Imports a payload.
    pub fn import(&self, import: Import) {
        let payloads = &mut *self.0.lock();
        match import {
            Import::Opaque {
                file,
                is_temporary: true,
            } => payloads.temporary = Some(Temporary::Opaque(Event::from_handle(file))),
            Import::Opaque { file, .. } => payloads.permanent = Some(Event::from_handle(file)),
            Import::Sync(Some(file)) => {
                payloads.temporary = Some(Temporary::Sync(Event::from_handle(file)));
            }
            Import::Sync(None) => payloads.temporary = Some(Temporary::Signaled),
        }
    }

    /// The payload as an opaque file.
    ///
    /// # Errors
    /// `VK_ERROR_INVALID_EXTERNAL_HANDLE` if there is none; `VK_ERROR_TOO_MANY_OBJECTS` if the
    /// process cannot open more files.
    pub fn export(&self) -> VkResult<Handle> {
        let payloads = self.0.lock();
        let event = match (&payloads.temporary, &payloads.permanent) {
            (Some(Temporary::Opaque(event)), _) | (None, Some(event)) => event,
            _ => return Err(vk::Result::ERROR_INVALID_EXTERNAL_HANDLE),
        };
        event.export().ok_or(vk::Result::ERROR_TOO_MANY_OBJECTS)
    }

    /// Whether the payload is signaled; `None` if it is in no file.
    pub fn is_signaled(&self) -> Option<bool> {
        let payloads = self.0.lock();
        match (&payloads.temporary, &payloads.permanent) {
            (Some(Temporary::Signaled), _) => Some(true),
            (Some(Temporary::Opaque(event) | Temporary::Sync(event)), _) | (None, Some(event)) => {
                Some(event.is_signaled())
            }
            (None, None) => None,
        }
    }

    /// Signals the payload; false if it is in no file.
    pub fn signal(&self) -> bool {
        let payloads = self.0.lock();
        match (&payloads.temporary, &payloads.permanent) {
            (Some(Temporary::Opaque(event)), _) | (_, Some(event)) => event.signal(),
            _ => return false,
        }
        true
    }

    /// Consumes the payload after a finished wait: a temporary payload is removed, a permanent one
    /// becomes unsignaled. Returns false if there was neither.
    pub fn consume(&self) -> bool {
        let payloads = &mut *self.0.lock();
        match (payloads.temporary.take(), &payloads.permanent) {
            (Some(Temporary::Opaque(event)), _) => event.clear(),
            (Some(_), _) => {}
            (None, Some(event)) => event.clear(),
            (None, None) => return false,
        }
        true
    }

    /// Resets a fence: removes a temporary payload, and unsignals the permanent one. False if that
    /// is in no file.
    pub fn reset(&self) -> bool {
        let payloads = &mut *self.0.lock();
        payloads.temporary = None;
        payloads.permanent.as_ref().map(Event::clear).is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exportable(is_signaled: bool) -> External {
        External::new(Some(Sharing::default()), is_signaled).unwrap()
    }

    #[test]
    fn opaque_files_are_one_payload() {
        let (one, other) = (exportable(false), External::default());
        assert!(!other.is_there() && !other.signal() && other.export().is_err());
        other.import(Import::Opaque {
            file: one.export().unwrap(),
            is_temporary: false,
        });
        assert_eq!(
            (one.is_signaled(), other.is_signaled()),
            (Some(false), Some(false))
        );
        assert!(one.signal() && one.signal());
        assert_eq!(other.is_signaled(), Some(true));
        assert!(other.consume());
        assert_eq!(one.is_signaled(), Some(false));
    }

    #[test]
    fn temporary_payloads_last_for_one_wait() {
        let semaphore = External::default();
        semaphore.import(Import::Sync(None));
        assert_eq!(semaphore.is_signaled(), Some(true));
        assert!(semaphore.consume());
        assert_eq!(semaphore.is_signaled(), None);
        let fence = exportable(true);
        let other = exportable(false);
        fence.import(Import::Opaque {
            file: other.export().unwrap(),
            is_temporary: true,
        });
        assert_eq!(fence.is_signaled(), Some(false));
        assert!(fence.signal());
        assert_eq!(other.is_signaled(), Some(true));
        assert!(fence.reset());
        assert_eq!(
            (fence.is_signaled(), other.is_signaled()),
            (Some(false), Some(true))
        );
    }
}
