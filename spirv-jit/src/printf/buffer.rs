//! The messages of one dispatch, as words, within a limit.

use std::sync::Mutex;

use super::MAX_KEY_WORDS;

/// Bytes that count for a message besides its arguments.
const MESSAGE_BYTES: usize = 16;

/// A message of one invocation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Record {
    /// The invocation, as words that sort in invocation order, padded with zeros.
    pub key: [u32; MAX_KEY_WORDS],
    /// Distinguishes several runs of one invocation.
    pub order: u64,
    /// The program's number.
    pub program: u64,
    /// The instruction's number in the program.
    pub site: u32,
    /// Arguments.
    pub words: Box<[u32]>,
}

impl Record {
    fn bytes(&self) -> usize {
        MESSAGE_BYTES + size_of_val(&*self.words)
    }

    /// The sort key of the record. Records with equal keys keep their order.
    fn place(&self) -> MessageOrder {
        (self.key, self.order)
    }
}

type MessageOrder = ([u32; MAX_KEY_WORDS], u64);

/// The messages of one dispatch. It keeps the first ones in invocation order that fit, independent
/// of the order of execution.
#[derive(Debug)]
pub struct Prints {
    limit_bytes: usize,
    kept: Mutex<Kept>,
}

#[derive(Debug, Default)]
struct Kept {
    /// In the order of each invocation.
    records: Vec<Record>,
    bytes: usize,
    dropped: u64,
    /// The first key that did not fit. No later key fits.
    end: Option<MessageOrder>,
}

/// All messages of a dispatch.
#[derive(Debug, Default)]
pub struct Taken {
    /// In the order of invocations.
    pub records: Vec<Record>,
    /// Messages that did not fit.
    pub dropped: u64,
}

impl Prints {
    /// Creates a buffer of this size in bytes: 16 for each message, plus its arguments.
    pub fn new(limit_bytes: usize) -> Self {
        Self {
            limit_bytes,
            kept: Mutex::default(),
        }
    }

    /// Adds a message. Messages of one invocation are added in order.
    pub fn add(&self, record: Record) {
        let mut kept = self.kept.lock().unwrap_or_else(|it| it.into_inner());
        let is_past = kept.end.is_some_and(|end| record.place() >= end);
        if is_past || kept.records.try_reserve(1).is_err() {
            kept.dropped += 1;
            return;
        }
        kept.bytes += record.bytes();
        kept.records.push(record);
        if kept.bytes > self.limit_bytes.saturating_mul(2) {
            kept.trim(self.limit_bytes);
        }
    }

    /// Takes the messages so far.
    pub fn take(&self) -> Taken {
        let mut kept = self.kept.lock().unwrap_or_else(|it| it.into_inner());
        kept.trim(self.limit_bytes);
        let kept = std::mem::take(&mut *kept);
        Taken {
            records: kept.records,
            dropped: kept.dropped,
        }
    }
}

impl Kept {
    /// Sorts the messages and drops those that do not fit.
    fn trim(&mut self, limit_bytes: usize) {
        self.records.sort_by_key(Record::place);
        let mut bytes = 0;
        let fits = self.records.iter().position(|record| {
            let past = bytes + record.bytes() > limit_bytes;
            bytes += if past { 0 } else { record.bytes() };
            past
        });
        if let Some(count) = fits {
            self.end = Some(self.records[count].place());
            self.dropped += (self.records.len() - count) as u64;
            self.records.truncate(count);
        }
        self.bytes = bytes;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(invocation: u32, site: u32) -> Record {
        Record {
            key: [0, 0, 0, invocation, 0, 0],
            order: 0,
            program: 1,
            site,
            words: [invocation].into(),
        }
    }

    /// The first messages by invocation are kept, whichever came first.
    #[test]
    fn the_kept_messages_are_the_first_in_any_order_of_execution() {
        let limit = 7 * (MESSAGE_BYTES + 4) + 3;
        let mut random = fastrand::Rng::with_seed(5);
        for _ in 0..50 {
            let prints = Prints::new(limit);
            let mut invocations: Vec<u32> = (0..100).collect();
            random.shuffle(&mut invocations);
            for invocation in invocations {
                prints.add(record(invocation, 0));
                prints.add(record(invocation, 1));
            }
            let taken = prints.take();
            let found: Vec<_> = (taken.records.iter())
                .map(|record| (record.words[0], record.site))
                .collect();
            let expected = [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1), (3, 0)];
            assert_eq!(found, expected);
            assert_eq!(taken.dropped, 193);
            assert_eq!(prints.take().records, []);
        }
    }
}
