//! Headless presentation that keeps presentation timing.

#![forbid(unsafe_code)]

use std::sync::Arc;
use std::time::Instant;

use super::{Frame, Screen, ScreenEvent, SurfaceLost, WakeEvent};

/// A headless presentation target. Each image is free again at once.
pub struct HeadlessScreen {
    wake: Arc<WakeEvent>,
    pending: Vec<ScreenEvent>,
}

impl HeadlessScreen {
    pub fn new(wake: &Arc<WakeEvent>) -> Self {
        Self {
            wake: Arc::clone(wake),
            pending: Vec::new(),
        }
    }
}

impl Screen for HeadlessScreen {
    fn show(&mut self, frame: &Frame<'_>) -> Result<(), SurfaceLost> {
        let (index, serial) = (frame.index, frame.serial);
        let out = ScreenEvent::Out {
            serial,
            at_ns: None,
        };
        (self.pending).extend([
            ScreenEvent::Free { index },
            out,
            ScreenEvent::Shown { serial },
        ]);
        Ok(())
    }

    fn wait(
        &mut self,
        deadline: Option<Instant>,
        events: &mut Vec<ScreenEvent>,
    ) -> Result<(), SurfaceLost> {
        if self.pending.is_empty() {
            self.wake.wait(deadline, None);
        }
        events.append(&mut self.pending);
        Ok(())
    }

    fn is_watched(&self) -> bool {
        false
    }
}
