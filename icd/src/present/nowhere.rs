//! Headless presentation that keeps presentation timing.

#![forbid(unsafe_code)]

use std::sync::Arc;
use std::time::Instant;

use super::{Bell, Event, Frame, Gone, Screen};

/// A headless presentation target, which is done with each image at once.
pub struct Nowhere {
    bell: Arc<Bell>,
    news: Vec<Event>,
}

impl Nowhere {
    pub fn new(bell: &Arc<Bell>) -> Self {
        Self {
            bell: Arc::clone(bell),
            news: Vec::new(),
        }
    }
}

impl Screen for Nowhere {
    fn show(&mut self, frame: &Frame<'_>) -> Result<(), Gone> {
        let (index, serial) = (frame.index, frame.serial);
        let out = Event::Out {
            serial,
            at_ns: None,
        };
        (self.news).extend([Event::Free { index }, out, Event::Shown { serial }]);
        Ok(())
    }

    fn wait(&mut self, deadline: Option<Instant>, events: &mut Vec<Event>) -> Result<(), Gone> {
        if self.news.is_empty() {
            self.bell.wait(deadline, None);
        }
        events.append(&mut self.news);
        Ok(())
    }

    fn is_watched(&self) -> bool {
        false
    }
}
