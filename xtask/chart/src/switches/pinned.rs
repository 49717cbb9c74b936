//! Work on several processors at once, each piece on one of its own: a process that is started
//! there stays there.

use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Context, Result};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

/// The processors that this process may use, `at_most` so many.
pub fn processors(at_most: Option<usize>) -> Result<Vec<usize>> {
    let allowed = sched_getaffinity(None).context("which processors there are")?;
    let all = (0..CpuSet::MAX_CPU).filter(|&number| allowed.is_set(number));
    Ok(all.take(at_most.unwrap_or(usize::MAX).max(1)).collect())
}

/// Does `work` on every item, on every processor one at a time; results come in order.
pub fn map<T: Sync, R: Send>(
    processors: &[usize],
    items: &[T],
    work: impl Fn(&T) -> Result<R> + Sync,
) -> Result<Vec<R>> {
    let next = AtomicUsize::new(0);
    let on_one = |processor: usize| -> Result<Vec<(usize, R)>> {
        let mut here = CpuSet::new();
        here.set(processor);
        sched_setaffinity(None, &here).context("staying on a processor")?;
        let mut done = Vec::new();
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(item) = items.get(index) else {
                return Ok(done);
            };
            done.push((index, work(item)?));
        }
    };
    let done: Result<Vec<Vec<(usize, R)>>> = std::thread::scope(|scope| {
        let threads: Vec<_> = processors
            .iter()
            .map(|&processor| scope.spawn(move || on_one(processor)))
            .collect();
        let joined = threads.into_iter().map(|thread| thread.join());
        joined
            .map(|done| done.unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect()
    });
    let mut done: Vec<(usize, R)> = done?.into_iter().flatten().collect();
    done.sort_by_key(|(index, _)| *index);
    Ok(done.into_iter().map(|(_, result)| result).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_order() {
        let processors = processors(Some(2)).expect("processors");
        let doubled = map(&processors, &[1, 2, 3, 4, 5], |item| Ok(item * 2));
        assert_eq!(doubled.expect("doubled"), [2, 4, 6, 8, 10]);
    }
}
