//! Payloads of semaphores and fences that lie in files, to be shared with other devices and
//! processes (`VK_KHR_external_semaphore_fd`, `VK_KHR_external_fence_fd`; spec, "Importing
//! Semaphore Payloads").
//!
//! An opaque file is an `eventfd`, whose counter is not zero while the payload is signaled. A sync
//! file is someone else's, another driver's or the kernel's, and only imported, for one wait; what
//! is exported as one has been signaled already, for which the file −1 stands.

use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};

use ash::vk;
use parking_lot::Mutex;

use crate::VkResult;

/// The payloads of a semaphore or fence that are not its own.
#[derive(Default)]
pub struct External(Mutex<Payloads>);

#[derive(Default)]
struct Payloads {
    permanent: Option<File>,
    /// The payload imported for one wait. It takes precedence over the others.
    temporary: Option<Temporary>,
}

enum Temporary {
    Opaque(File),
    Sync(File),
    /// The sync file −1.
    Signaled,
}

/// An imported payload.
pub enum Import {
    Opaque {
        file: OwnedFd,
        is_temporary: bool,
    },
    /// Temporary always. None: −1.
    Sync(Option<OwnedFd>),
}

impl External {
    /// None, or a payload that can be exported as an opaque file.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY` where the process can have no more files.
    pub fn new(is_opaque: bool, is_signaled: bool) -> VkResult<Self> {
        let permanent = is_opaque.then(|| event(is_signaled)).transpose()?;
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

    /// Takes over a payload.
    pub fn import(&self, import: Import) {
        let payloads = &mut *self.0.lock();
        match import {
            Import::Opaque {
                file,
                is_temporary: true,
            } => payloads.temporary = Some(Temporary::Opaque(file.into())),
            Import::Opaque { file, .. } => payloads.permanent = Some(file.into()),
            Import::Sync(Some(file)) => payloads.temporary = Some(Temporary::Sync(file.into())),
            Import::Sync(None) => payloads.temporary = Some(Temporary::Signaled),
        }
    }

    /// The payload as an opaque file.
    ///
    /// # Errors
    /// `VK_ERROR_INVALID_EXTERNAL_HANDLE` where there is none, `VK_ERROR_TOO_MANY_OBJECTS` where
    /// the process can have no more files.
    pub fn export(&self) -> VkResult<OwnedFd> {
        let payloads = self.0.lock();
        let file = match (&payloads.temporary, &payloads.permanent) {
            (Some(Temporary::Opaque(file)), _) | (None, Some(file)) => file,
            _ => return Err(vk::Result::ERROR_INVALID_EXTERNAL_HANDLE),
        };
        let copy = file.try_clone();
        Ok(copy.map_err(|_| vk::Result::ERROR_TOO_MANY_OBJECTS)?.into())
    }

    /// Whether the payload is signaled; none if it lies in no file.
    pub fn is_signaled(&self) -> Option<bool> {
        let payloads = self.0.lock();
        match (&payloads.temporary, &payloads.permanent) {
            (Some(Temporary::Signaled), _) => Some(true),
            (Some(Temporary::Opaque(file) | Temporary::Sync(file)), _) | (None, Some(file)) => {
                Some(is_readable(file))
            }
            (None, None) => None,
        }
    }

    /// Signals the payload; false if it lies in no file.
    pub fn signal(&self) -> bool {
        let payloads = self.0.lock();
        let file = match (&payloads.temporary, &payloads.permanent) {
            (Some(Temporary::Opaque(file)), _) | (_, Some(file)) => file,
            _ => return false,
        };
        // A counter that is full stays signaled.
        let _ = (&*file).write(&1u64.to_ne_bytes());
        true
    }

    /// Consumes the payload after a finished wait: a temporary payload is removed, a permanent one
    /// becomes unsignaled. Returns false if there was neither.
    pub fn consume(&self) -> bool {
        let payloads = &mut *self.0.lock();
        match (payloads.temporary.take(), &payloads.permanent) {
            (Some(Temporary::Opaque(file)), _) => clear(&file),
            (Some(_), _) => {}
            (None, Some(file)) => clear(file),
            (None, None) => return false,
        }
        true
    }

    /// Resets a fence: a temporary payload is gone, and the permanent one, which stands again, is
    /// unsignaled. False if that lies in no file.
    pub fn reset(&self) -> bool {
        let payloads = &mut *self.0.lock();
        payloads.temporary = None;
        payloads.permanent.as_ref().map(clear).is_some()
    }
}

/// A new `eventfd`.
fn event(is_signaled: bool) -> VkResult<File> {
    // SAFETY: a plain system call; the descriptor is owned from its creation on.
    unsafe {
        let event = libc::eventfd(
            u32::from(is_signaled),
            libc::EFD_CLOEXEC | libc::EFD_NONBLOCK,
        );
        match event {
            ..0 => Err(vk::Result::ERROR_OUT_OF_HOST_MEMORY),
            event => Ok(File::from_raw_fd(event)),
        }
    }
}

/// Whether reading would not wait: what it means for events and sync files that they are signaled.
fn is_readable(file: &File) -> bool {
    let mut poll = libc::pollfd {
        fd: file.as_raw_fd(),
        events: libc::POLLIN,
        revents: 0,
    };
    // SAFETY: one structure, which is there.
    let ready = unsafe { libc::poll(&raw mut poll, 1, 0) };
    ready == 1 && poll.revents & libc::POLLIN != 0
}

/// Empties an event's counter.
fn clear(mut file: &File) {
    if is_readable(file) {
        let _ = file.read(&mut [0; 8]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opaque_files_are_one_payload() {
        let (one, other) = (External::new(true, false).unwrap(), External::default());
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
        let fence = External::new(true, true).unwrap();
        let other = External::new(true, false).unwrap();
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
